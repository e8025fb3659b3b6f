"""Draw pictures and animations of a view by matplotlib.

Each pixel has the colour of the triangle that is nearest there: matplotlib's order of whole
triangles would show some through walls.
"""

import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from textwrap import fill

import numpy as np
from jaxtyping import Float
from matplotlib.animation import FFMpegWriter, PillowWriter
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from .._fields.checks import require
from .._fields.drawn_text import literal, shown
from .meshes import DrawnPart
from .page import Legend
from .proportions import WIDE, Camera, in_perspective

LIGHT = np.array([0.35, 0.55, 0.75])
"""Direction to the light, with components to the right, upwards and to the viewer."""
SHADE = 0.45
"""Brightness of surfaces that face away from the light, from 0 to 1."""
DPI = 100
"""Pixels per inch of an animation; a still picture has twice as many."""
SAMPLES = 4 * DPI
"""Computed points per inch, of which several are averaged in a pixel."""
MOST_POINTS = 1_000_000
"""Largest number of points computed at once, unless a single triangle has more."""
FRAMES_PER_SECOND = 25


class Film:
    """A matplotlib figure of a view, in which `show` draws the frame with the index `k`, and `save`
    writes an animation. `times`: of the frames, s, ``None`` for a single state; `samples`: number
    of computed points per inch."""

    def __init__(
        self,
        parts: Sequence[DrawnPart],
        camera: Camera,
        legend: Legend,
        times: np.ndarray | None,
        samples: int = SAMPLES,
    ):
        self._times, self._parts = times, parts
        self._view, self._target = camera.axes(), camera.target
        self._distance = float(np.linalg.norm(camera.eye - camera.target))
        self.figure = Figure(figsize=(8.0, 4.8), dpi=DPI)
        # The legend has 28 % of the width on the left, the picture the rest. The coordinates of the
        # picture are m in the plane through the target, onto which the triangles are projected.
        self._axes = self.figure.add_axes((0.28, 0.0, 0.72, 1.0))
        self._axes.set_axis_off()
        half_width, half_height = WIDE * camera.reach, camera.reach
        box = self._axes.get_window_extent()
        self._shape = round(box.height / DPI * samples), round(box.width / DPI * samples)
        # Points per m, so that the picture's whole width and height are seen.
        self._scale = min(self._shape[0] / half_height, self._shape[1] / half_width) / 2.0
        self._image = self._axes.imshow(np.ones((*self._shape, 3)), origin="lower", aspect="auto")
        self._time_text = self.figure.text(0.98, 0.02, "", ha="right", va="bottom", fontsize=11)
        patches = [
            Patch(facecolor=c, edgecolor="#777777", label=shown(name)) for c, name in legend.entries
        ]
        self.figure.legend(
            handles=patches,
            title=fill(literal(legend.title), 24),
            title_fontproperties={"weight": "bold"},
            loc="upper left",
            fontsize=min(9.0, 160.0 / (len(patches) + 1)),  # so that all are in the picture
            frameon=False,
            alignment="left",
        )
        # A line of 30 characters of this size, or of 24 of the title's, is as wide as the legend.
        notes = "\n".join(fill(literal(note), 30) for note in legend.notes)
        self.figure.text(0.02, 0.02, notes, ha="left", va="bottom", fontsize=8, color="#444444")
        self.show(0)

    def show(self, k: int) -> None:
        height, width = self._shape
        # `nearest` has the closeness (inverse distance) of the nearest opaque triangle at each
        # point. The transparent parts come last, when it is complete.
        picture, nearest = np.ones((height * width, 3)), np.zeros(height * width)
        middle = 0.5 * np.array([width, height])
        for part in sorted(self._parts, key=lambda part: self._order(part, k)):
            moved = part.mesh.moved(part.pose(k)).vertices
            # Corners (F, 3, 3), m: to the right, upwards and to the viewer, from the target.
            triangles = ((moved - self._target) @ self._view.T)[part.mesh.faces]
            normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
            sizes = np.linalg.norm(normals, axis=1)
            # In these axes the camera is at (0, 0, distance). Triangles without area or seen from
            # behind are left out.
            towards = (0.0, 0.0, self._distance) - triangles[:, 0]
            facing = np.sum(normals * towards, axis=1) > 1e-9 * self._distance * sizes
            triangles, normals = triangles[facing], normals[facing] / sizes[facing, None]
            light = SHADE + (1.0 - SHADE) * np.clip(normals @ LIGHT, 0.0, 1.0)
            shades = light[:, None] * np.array(to_rgb(part.colour_at(k)))
            projected = in_perspective(triangles, self._distance) * self._scale + middle
            closeness = 1.0 / (self._distance - triangles[:, :, 2])
            # A transparent part does not hide those behind it, so it leaves `nearest` as it is.
            closest = nearest if part.opacity == 1.0 else nearest.copy()
            # Index of the triangle of this part that is seen at each point, -1 for none.
            shown = np.full(len(nearest), -1)
            for point, triangle, near in _covered(projected, closeness, width, height):
                np.maximum.at(closest, point, near)  # a point may occur in several triangles
                is_nearest = near == closest[point]
                shown[point[is_nearest]] = triangle[is_nearest]
            seen = shown >= 0
            behind = (1.0 - part.opacity) * picture[seen]
            picture[seen] = behind + part.opacity * shades[shown[seen]]
        self._image.set_data(picture.reshape(height, width, 3))
        if self._times is not None:
            self._time_text.set_text(_time_text(self._times[k], self._times[-1] - self._times[0]))

    def _order(self, part: DrawnPart, k: int) -> tuple[bool, float]:
        """Return the key by which the parts in frame `k` are sorted to be painted in turn:
        transparent parts last, from the farthest to the nearest, over what is behind them."""
        centre = part.mesh.moved(part.pose(k)).vertices.mean(axis=0)
        return part.opacity < 1.0, float(centre @ self._view[2])

    def save(self, file: Path, frames: Sequence[int]) -> None:
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


def _covered(
    corners: Float[np.ndarray, "F 3 2"], values: Float[np.ndarray, "F 3"], width: int, height: int
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yield, in groups, the points that each triangle covers in a grid of `width` by `height`
    points: indices of the points, (M,), counted row by row; indices of their triangles, (M,); and
    values, (M,), interpolated linearly between the `values` at the `corners`. Corners are x and y
    in spacings of the grid, whose first point is at (0.5, 0.5)."""
    a, b, c = (corners[:, j] for j in range(3))
    # Point (i, k) of the grid is at x = i + 0.5, y = k + 0.5. A line is the part of a row of points
    # inside a triangle; lines are numbered triangle by triangle.
    low, high = (
        np.clip(np.ceil(f(corners[:, :, 1], axis=1) - 0.5), 0, height).astype(int)
        for f in (np.min, np.max)
    )
    triangle, row = _whole_numbers(low, high)
    # A line is between the two edges of its triangle that cross its row. An edge that does not
    # cross the row gives NaN, which `fmin` and `fmax` ignore; a line without points is empty.
    y, crossings = row + 0.5, []
    for p, q in ((a, b), (b, c), (c, a)):
        p, q = p[triangle], q[triangle]
        with np.errstate(divide="ignore", invalid="ignore"):  # horizontal edges
            fraction = (y - p[:, 1]) / (q[:, 1] - p[:, 1])  # of the edge from p to q
            x = p[:, 0] + fraction * (q[:, 0] - p[:, 0])
        crossings.append(np.where((fraction >= 0.0) & (fraction <= 1.0), x, np.nan))
    left, right = (
        np.clip(np.nan_to_num(np.ceil(f(crossings, axis=0) - 0.5)), 0, width).astype(int)
        for f in (np.fmin.reduce, np.fmax.reduce)
    )
    # The values are linear functions of x and y: their slopes, from the differences to corner a.
    (bx, by), (cx, cy) = (b - a).T, (c - a).T
    rise_b, rise_c = values[:, 1] - values[:, 0], values[:, 2] - values[:, 0]
    double_area = bx * cy - cx * by
    slopes = np.array([rise_b * cy - rise_c * by, rise_c * bx - rise_b * cx]) / double_area
    # Lines are taken in groups of about `MOST_POINTS` points, which limits the memory. A group has
    # the lines from `first_line` to `end_line` - 1; `points` counts the points up to each line.
    first_line, points = 0, np.cumsum(np.maximum(right - left, 0))
    while first_line < len(row):
        done = points[first_line - 1] if first_line else 0
        # At least one line, which alone may have more points.
        end_line = max(first_line + 1, int(np.searchsorted(points, done + MOST_POINTS)))
        line, x = _whole_numbers(left[first_line:end_line], right[first_line:end_line])
        line += first_line  # indices within the group become those of all lines
        k = triangle[line]
        slope_x, slope_y = slopes[:, k]
        value = values[k, 0] + slope_x * (x + 0.5 - a[k, 0]) + slope_y * (y[line] - a[k, 1])
        yield row[line] * width + x, k, value
        first_line = end_line


def _whole_numbers(starts: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return, for each integer in the intervals `starts[k]` to `ends[k]` - 1, the index k of its
    interval, and itself: [0, 0, 2] and [3, 4, 7] for starts [3, 9, 7] and ends [5, 9, 8]."""
    counts = np.maximum(ends - starts, 0)
    interval = np.repeat(np.arange(len(counts)), counts)
    before = np.repeat(np.cumsum(counts) - counts, counts)  # numbers of the intervals before
    return interval, starts[interval] + np.arange(len(interval)) - before


def _time_text(time: float, duration: float) -> str:
    """Text of a time, s, to a hundredth of the run's `duration`, s, or finer."""
    duration = duration or abs(time) or 1.0  # a run of a single frame has no duration
    factor, unit = (1e6, "µs") if duration < 1e-3 else (1e3, "ms") if duration < 1.0 else (1.0, "s")
    digits = max(0, 2 - int(np.floor(np.log10(duration * factor))))
    return f"t = {time * factor:.{digits}f} {unit}"
