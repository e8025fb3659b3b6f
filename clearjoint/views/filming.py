"""Still pictures and animations by matplotlib, for reports and talks."""

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from textwrap import fill

import numpy as np
from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ..fields.checks import require
from ..fields.drawn_text import literal, shown
from .camera import WIDE, Camera, in_perspective
from .meshes import Mesh, needed
from .page import Legend
from .parts import DrawnPart

LIGHT = np.array([0.35, 0.55, 0.75])
"""Direction of the light: to the right, upwards, towards the viewer."""
SHADE = 0.45
"""Brightness of what the light does not reach."""
BESIDE = 0.28
"""Share of the width that the legend takes."""
LONGEST_EDGE = 0.3
"""Of a triangle, over half the height of the picture."""
TITLE = 24
"""Characters in a line of the title."""
DOTS = 100
FRAMES_PER_SECOND = 25


class Film:
    """A figure of parts seen by a camera, which shows one instant after the other.

    Triangles are drawn from the farthest to the nearest one, those that face away left out.
    """

    def __init__(
        self,
        parts: Sequence[DrawnPart],
        camera: Camera,
        legend: Legend,
        times: np.ndarray | None,
        size: tuple[float, float] = (8.0, 4.8),
    ):
        self._times = times
        self._parts = [_divided(part, LONGEST_EDGE * camera.reach) for part in parts]
        self._view, self._target = camera.axes(), camera.target
        self._distance = float(np.linalg.norm(camera.eye - camera.target))
        self.figure = Figure(figsize=size, dpi=DOTS)
        self._axes = self.figure.add_axes((BESIDE, 0.0, 1.0 - BESIDE, 1.0))
        self._axes.set_axis_off()
        wide, high = WIDE * camera.reach, camera.reach
        self._axes.set(xlim=(-wide, wide), ylim=(-high, high), aspect="equal")
        self._triangles = PolyCollection([], linewidths=0.3)
        self._axes.add_collection(self._triangles)
        self._clock = self.figure.text(0.98, 0.02, "", ha="right", va="bottom", fontsize=11)
        self._describe(legend)
        self.show(0)

    def show(self, k: int) -> None:
        """Show an instant by its number."""
        corners, colours = [], []
        for part in self._parts:
            moved = part.mesh.moved(part.pose(k)).vertices
            triangles = ((moved - self._target) @ self._view.T)[part.mesh.faces]
            normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
            sizes = np.linalg.norm(normals, axis=1)
            towards = (0.0, 0.0, self._distance) - triangles[:, 0]
            facing = np.sum(normals * towards, axis=1) > 1e-9 * self._distance * sizes
            normals = normals[facing] / sizes[facing, None]
            light = SHADE + (1.0 - SHADE) * np.clip(normals @ LIGHT, 0.0, 1.0)
            base = np.array(to_rgb(part.colour_at(k)))
            colours.append(
                np.column_stack([light[:, None] * base, np.full(len(light), part.opacity)])
            )
            corners.append(triangles[facing])
        everything, painted = np.concatenate(corners), np.concatenate(colours)
        order = np.argsort(everything[:, :, 2].mean(axis=1))
        self._triangles.set_verts([*in_perspective(everything[order], self._distance)])
        self._triangles.set_facecolor([*painted[order]])
        seams = np.where(painted[order, 3:] < 1.0, 0.0, 1.0) * (0.0, 0.0, 0.0, 1.0)
        self._triangles.set_edgecolor([*(painted[order] * (1.0, 1.0, 1.0, 0.0) + seams)])
        if self._times is not None:
            self._clock.set_text(_time(self._times[k], self._times[-1] - self._times[0]))

    def save(self, file: Path, frames: Sequence[int]) -> None:
        """Write a GIF or an MP4 of some instants, or a picture of the first one.

        **Raises:** `ValueError` for an MP4 where there is no ffmpeg.
        """
        if file.suffix.lower() not in (".gif", ".mp4"):
            self.show(frames[0])
            self.figure.savefig(file, dpi=2 * DOTS)
            return
        writer = PillowWriter(FRAMES_PER_SECOND)
        if file.suffix.lower() == ".mp4":
            found = shutil.which("ffmpeg") is not None
            remedy = 'install ffmpeg, or save an animation that needs none: "....gif"'
            require(found, "file", str(file), "an animation that can be written here", remedy)
            writer = FFMpegWriter(FRAMES_PER_SECOND)

        def draw(k: int) -> list[PolyCollection]:
            self.show(k)
            return [self._triangles]

        animation = FuncAnimation(self.figure, draw, frames=frames, init_func=list)
        animation.save(file, writer=writer, dpi=DOTS)

    def _describe(self, legend: Legend) -> None:
        patches = [
            Patch(facecolor=c, edgecolor="#777777", label=shown(name)) for c, name in legend.entries
        ]
        self.figure.legend(
            handles=patches,
            title=fill(literal(legend.title), TITLE),
            title_fontproperties={"weight": "bold"},
            loc="upper left",
            fontsize=9,
            frameon=False,
            alignment="left",
        )
        notes = "\n".join(fill(literal(note), 30) for note in legend.notes)
        self.figure.text(0.02, 0.02, notes, ha="left", va="bottom", fontsize=8, color="#444444")


def _divided(part: DrawnPart, longest: float) -> DrawnPart:
    """The part with edges no longer than so many m, so that its triangles can be told apart in
    depth; as it is if its pose stretches it."""
    still = np.allclose(np.linalg.norm(part.poses[0, :3, :3], axis=0), 1.0)
    edges = part.mesh.vertices[part.mesh.faces] - part.mesh.vertices[part.mesh.faces[:, [1, 2, 0]]]
    if not still or np.linalg.norm(edges, axis=2).max() <= longest:
        return part
    remesh = needed("trimesh").remesh
    vertices, faces = remesh.subdivide_to_size(*part.mesh, max_edge=longest)
    return replace(part, mesh=Mesh(vertices, faces))


def _time(time: float, whole: float) -> str:
    factor, unit = (1e6, "µs") if whole < 1e-3 else (1e3, "ms") if whole < 1.0 else (1.0, "s")
    digits = max(0, 2 - int(np.floor(np.log10(whole * factor)))) if whole > 0.0 else 3
    return f"t = {time * factor:.{digits}f} {unit}"
