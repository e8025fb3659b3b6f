"""The journal in its bearing: eccentricities, orbits, frames, and an animation."""

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Annulus, Circle

from ..joints.clearance import BASES
from ..observables import Observation
from .style import DARK, GREY, LIGHT, Window, axes_or_new, dress, inside, lines

XY: Mapping[str, Any] = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0)}
"""The cross-section of a bearing at rest whose axis is Z."""

DRAWN_GAP = 0.3
"""Clearance as drawn in frames, as a share of the bearing's radius."""


def eccentricities(
    observation: Observation,
    joint: str,
    clearance: float,
    *,
    window: Window | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Magnitude of the eccentricity of both bases over time (Fig. 16).

    **Arguments:** `joint`: name of the clearance joint. `clearance`: radial, m, drawn as the line
    above which a base touches the wall. `window`: instants between which to draw, s.

    **Returns:** the axes; time in ms, eccentricity in mm.
    """
    axes = axes_or_new(axes)
    shown = inside(observation.times, window)
    times = observation.times[shown] * 1e3
    for base, (colour, style) in zip(BASES, lines(), strict=False):
        values = observation.contacts[joint][base].eccentricity[shown] * 1e3
        axes.plot(times, values, color=colour, linestyle=style, linewidth=1.5, label=f"base {base}")
    axes.axhline(clearance * 1e3, color="black", linewidth=1.0, label="clearance")
    axes.set_xlim(times[0], times[-1])
    axes.set_ylim(bottom=0.0)
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False)
    return dress(axes, "time, ms", "eccentricity, mm")


def eccentricity_vectors(
    observation: Observation, joint: str, base: str, section: Mapping[str, Any] = XY
) -> np.ndarray:
    """Vector from the bearing's axis to a base, in the bearing's cross-section, (N, 2) m.

    **Arguments:** `section`: two perpendicular unit vectors across the bearing's axis, global, by
    their labels: (3,) each, or (N, 3) for a bearing that moves.
    """
    seen = observation.contacts[joint][base]
    vectors = seen.normal * np.asarray(seen.eccentricity)[:, None]
    along = [np.sum(vectors * np.asarray(direction), axis=1) for direction in section.values()]
    return np.stack(along, axis=1)


def journal_orbit(
    observation: Observation,
    joint: str,
    clearance: float,
    *,
    section: Mapping[str, Any] = XY,
    window: Window | None = None,
    axes: Axes | None = None,
) -> Axes:
    """Paths of both bases' centres in the bearing's cross-section, within the clearance circle.

    **Arguments:** `clearance`: radial, m. `section`: see `eccentricity_vectors`. `window`: instants
    between which to draw, s.

    **Returns:** the axes, of equal scale, in mm.
    """
    axes = axes_or_new(axes, (4.8, 4.8))
    shown = inside(observation.times, window)
    wall = Circle(
        (0.0, 0.0), clearance * 1e3, fill=False, color="black", linewidth=1.2, label="clearance"
    )
    axes.add_patch(wall)
    for base, (colour, style) in zip(BASES, lines(), strict=False):
        orbit = eccentricity_vectors(observation, joint, base, section)[shown] * 1e3
        axes.plot(*orbit.T, color=colour, linestyle=style, linewidth=1.2, label=f"base {base}")
    limit = 1.08 * clearance * 1e3
    axes.set(xlim=(-limit, limit), ylim=(-limit, limit), aspect="equal")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False)
    right, up = section
    return dress(axes, f"eccentricity along {right}, mm", f"eccentricity along {up}, mm")


def journal_frames(
    observation: Observation,
    joint: str,
    clearance: float,
    instants: Sequence[float] | np.ndarray,
    *,
    section: Mapping[str, Any] = XY,
    columns: int = 8,
    figure: Figure | None = None,
) -> Figure:
    """A sequence of pictures of the journal in its bearing, base V above base W (Fig. 17).

    The clearance is exaggerated. A journal in contact is dark, one in flight light.

    **Arguments:** `clearance`: radial, m. `instants`: (M,) s; each shows the nearest observed one.
    `section`: see `eccentricity_vectors`. `columns`: pictures in a line.

    **Returns:** the figure.
    """
    blocks = -(-len(instants) // columns)
    if figure is None:
        figure = Figure(figsize=(1.3 * columns, 3.0 * blocks), layout="constrained")
    grid = figure.subplots(2 * blocks, columns, squeeze=False)
    drawn = {base: _drawn(observation, joint, base, clearance, section) for base in BASES}
    for axes in grid.flat:
        axes.set_axis_off()
    for k, index in enumerate(_nearest(observation.times, instants)):
        line, column = divmod(k, columns)
        for row, base in enumerate(BASES, 2 * line):
            axes = grid[row, column]
            _picture(axes, *(part[index] for part in drawn[base]))
            if column == 0:
                axes.text(-1.35, 0.0, base, ha="right", va="center", fontsize=11)
        grid[2 * line, column].set_title(f"{observation.times[index] * 1e3:.1f} ms", fontsize=10)
    return figure


def animate_journal(
    observation: Observation,
    joint: str,
    clearance: float,
    file: str | PathLike[str],
    instants: Sequence[float] | np.ndarray,
    *,
    section: Mapping[str, Any] = XY,
    frames_per_second: int = 15,
) -> None:
    """Write an animation of both bases of the journal in the bearing, as a GIF.

    The clearance is exaggerated. A journal in contact is dark, one in flight light.

    **Arguments:** `clearance`: radial, m. `instants`: (M,) s, one a frame; each shows the nearest
    observed one. `section`: see `eccentricity_vectors`.
    """
    figure = Figure(figsize=(5.0, 2.9))
    pair = figure.subplots(1, 2)
    figure.subplots_adjust(left=0.02, right=0.98, bottom=0.02, top=0.8, wspace=0.05)
    drawn = {base: _drawn(observation, joint, base, clearance, section) for base in BASES}
    nearest = _nearest(observation.times, instants)

    def draw(frame: int) -> list[Any]:
        index = nearest[frame]
        for axes, base in zip(pair, BASES, strict=True):
            axes.clear()
            axes.set_axis_off()
            axes.set_title(f"base {base}", fontsize=10)
            _picture(axes, *(part[index] for part in drawn[base]))
        figure.suptitle(f"{observation.times[index] * 1e3:.1f} ms", fontsize=11)
        return []

    animation = FuncAnimation(figure, draw, frames=len(nearest), init_func=lambda: [])
    animation.save(file, writer=PillowWriter(frames_per_second), dpi=80)


def _drawn(
    observation: Observation, joint: str, base: str, clearance: float, section: Mapping[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """Offsets as drawn, (N, 2) in bearing radii, and whether the base touches, (N,)."""
    vectors = eccentricity_vectors(observation, joint, base, section)
    touching = observation.contacts[joint][base].penetration > 0.0
    return vectors * (DRAWN_GAP / clearance), touching


def _nearest(times: np.ndarray, instants: Sequence[float] | np.ndarray) -> np.ndarray:
    """Index of the observed time nearest to each instant."""
    return np.array([np.argmin(np.abs(times - instant)) for instant in instants])


def _picture(axes: Axes, offset: np.ndarray, touching: bool) -> None:
    axes.add_patch(Annulus((0.0, 0.0), 1.14, 0.14, facecolor=GREY, edgecolor="none"))
    face = DARK if touching else LIGHT
    x, y = float(offset[0]), float(offset[1])
    axes.add_patch(Circle((x, y), 1.0 - DRAWN_GAP, facecolor=face, edgecolor=DARK))
    axes.plot(0.0, 0.0, "+", color=GREY, markersize=7)
    axes.plot(x, y, ".", color="white" if touching else DARK, markersize=5)
    axes.set(xlim=(-1.16, 1.16), ylim=(-1.16, 1.16), aspect="equal")
