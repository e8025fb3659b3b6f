"""Draw pictures and animations of a view by matplotlib.

A view consists of solids (`DrawnPart`), each with a triangle mesh and a pose in every frame. They
are projected on the picture, and their triangles are painted from back to front.
"""

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from textwrap import fill

import numpy as np
from matplotlib.animation import FFMpegWriter, PillowWriter
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ..fields.checks import require
from ..fields.drawn_text import literal, shown
from .meshes import DrawnPart, Mesh, needed
from .page import Legend
from .proportions import WIDE, Camera, in_perspective

LIGHT = np.array([0.35, 0.55, 0.75])
"""Direction to the light: components to the right, upwards and to the viewer."""
SHADE = 0.45
"""Brightness of surfaces that face away from the light, as a fraction of full brightness."""
DPI = 100
"""Pixels per inch of an animation; a still picture has twice as many."""
FRAMES_PER_SECOND = 25
"""Number of frames that an animation shows in a second."""


class Film:
    """A matplotlib figure of a view, in which `show` draws one frame.

    Triangles are drawn from the farthest to the nearest. Triangles that face away from the camera
    are omitted.

    **Arguments:** `parts`: solids with a pose for each frame; `camera`: positions of the viewer and
    of the picture's middle; `legend`: texts and colours on the left of the picture; `times`: times
    of the frames, (N,) s, None for a single state.
    """

    def __init__(
        self,
        parts: Sequence[DrawnPart],
        camera: Camera,
        legend: Legend,
        times: np.ndarray | None,
    ):
        self._times = times
        # Large triangles can't be painted in a correct order, since one may be partly before and
        # partly behind another: they are divided. The reach is half the height of the picture.
        self._parts = [_divided(part, 0.3 * camera.reach) for part in parts]
        self._view, self._target = camera.axes(), camera.target
        self._distance = float(np.linalg.norm(camera.eye - camera.target))
        self.figure = Figure(figsize=(8.0, 4.8), dpi=DPI)
        # The legend has 28 % of the width on the left, the picture the rest. The coordinates of the
        # picture are m in the plane through the target, onto which the triangles are projected.
        self._axes = self.figure.add_axes((0.28, 0.0, 0.72, 1.0))
        self._axes.set_axis_off()
        wide, high = WIDE * camera.reach, camera.reach
        self._axes.set(xlim=(-wide, wide), ylim=(-high, high), aspect="equal")
        self._triangles = PolyCollection([], linewidths=0.3)
        self._axes.add_collection(self._triangles)
        self._time_text = self.figure.text(0.98, 0.02, "", ha="right", va="bottom", fontsize=11)
        patches = [
            Patch(facecolor=c, edgecolor="#777777", label=shown(name)) for c, name in legend.entries
        ]
        self.figure.legend(
            handles=patches,
            title=fill(literal(legend.title), 24),
            title_fontproperties={"weight": "bold"},
            loc="upper left",
            fontsize=9,
            frameon=False,
            alignment="left",
        )
        # A line of 30 characters of this size, or of 24 of the title's, is as wide as the legend.
        notes = "\n".join(fill(literal(note), 30) for note in legend.notes)
        self.figure.text(0.02, 0.02, notes, ha="left", va="bottom", fontsize=8, color="#444444")
        self.show(0)

    def show(self, k: int) -> None:
        """Draw the parts in frame `k` and, unless the view is of a single state, the frame's time
        as text."""
        corners, colours = [], []
        for part in self._parts:
            moved = part.mesh.moved(part.pose(k)).vertices
            # Corners (F, 3, 3), m: to the right, upwards and to the viewer, from the target.
            triangles = ((moved - self._target) @ self._view.T)[part.mesh.faces]
            normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
            sizes = np.linalg.norm(normals, axis=1)
            # In these axes the camera is at (0, 0, distance). Triangles without area or seen from
            # behind are left out.
            towards = (0.0, 0.0, self._distance) - triangles[:, 0]
            facing = np.sum(normals * towards, axis=1) > 1e-9 * self._distance * sizes
            normals = normals[facing] / sizes[facing, None]
            light = SHADE + (1.0 - SHADE) * np.clip(normals @ LIGHT, 0.0, 1.0)
            shades = light[:, None] * np.array(to_rgb(part.colour_at(k)))
            colours.append(np.insert(shades, 3, part.opacity, axis=1))
            corners.append(triangles[facing])
        everything, painted = np.concatenate(corners), np.concatenate(colours)
        order = np.argsort(everything[:, :, 2].mean(axis=1))  # the farthest first
        self._triangles.set_verts([*in_perspective(everything[order], self._distance)])
        self._triangles.set_facecolor([*painted[order]])
        # Edges in the colour of the face close gaps between opaque triangles. Edges of transparent
        # ones are invisible, because they would overlap and show as lines.
        seams = np.where(painted[order, 3:] < 1.0, 0.0, 1.0) * (0.0, 0.0, 0.0, 1.0)
        self._triangles.set_edgecolor([*(painted[order] * (1.0, 1.0, 1.0, 0.0) + seams)])
        if self._times is not None:
            self._time_text.set_text(_time_text(self._times[k], self._times[-1] - self._times[0]))

    def save(self, file: Path, frames: Sequence[int]) -> None:
        """Write an animation of the frames with the indices `frames` to a file: a GIF or an MP4,
        depending on whether its name ends in ".gif" or ".mp4".

        **Raises:** `ValueError` for an MP4 if ffmpeg is not installed.
        """
        writer = PillowWriter(FRAMES_PER_SECOND)
        if file.suffix.lower() == ".mp4":
            has_ffmpeg = shutil.which("ffmpeg") is not None
            remedy = "install ffmpeg, or save a GIF, which does not need it"
            require(has_ffmpeg, "file", str(file), "a GIF, since ffmpeg is missing", remedy)
            writer = FFMpegWriter(FRAMES_PER_SECOND)
        with writer.saving(self.figure, str(file), DPI):
            for k in frames:
                self.show(k)
                writer.grab_frame()


def _divided(part: DrawnPart, longest: float) -> DrawnPart:
    """Return a part with its triangles divided until no edge is longer than `longest`, m, so that
    they can be sorted by their distance. A part that its pose stretches, such as an arrow, is
    returned unchanged, since its edges have other lengths in each frame."""
    is_rigid = np.allclose(np.linalg.norm(part.poses[0, :3, :3], axis=0), 1.0)
    edges = part.mesh.vertices[part.mesh.faces] - part.mesh.vertices[part.mesh.faces[:, [1, 2, 0]]]
    if not is_rigid or np.linalg.norm(edges, axis=2).max() <= longest:
        return part
    remesh = needed("trimesh").remesh
    vertices, faces = remesh.subdivide_to_size(*part.mesh, max_edge=longest)
    return replace(part, mesh=Mesh(vertices, faces))


def _time_text(time: float, whole: float) -> str:
    """Return the text of a time, s, with the unit and the digits that suit a run of duration
    `whole`, s: one unit of the last digit is at most a hundredth of the duration. If the duration
    is zero, as for a single frame, unit and digits suit the time itself."""
    whole = whole or abs(time) or 1.0
    factor, unit = (1e6, "µs") if whole < 1e-3 else (1e3, "ms") if whole < 1.0 else (1.0, "s")
    digits = max(0, 2 - int(np.floor(np.log10(whole * factor))))
    return f"t = {time * factor:.{digits}f} {unit}"
