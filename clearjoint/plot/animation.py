"""Draw still pictures and animations of a journal that moves in its bearing."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Annulus, Circle

from .._fields.checks import as_number, require, require_count, require_positive
from .._model.clearance_joints.journal_bases import BASES
from .._simulation.results.observe import Observation
from .journal import CrossSection, eccentricity_vectors
from .style import DARK, GREY, LIGHT

DRAWN_GAP = 0.3
"""Clearance in the pictures, in radii of the bearing; true ones would hardly be seen."""
NOTE = f"clearance drawn larger, as {DRAWN_GAP:g} of the bearing's radius"
WALL = 0.14
"""Thickness of the bearing's wall in the pictures, in radii of the bearing."""
Instants = Sequence[float] | np.ndarray
"""Times (M,) to draw, s."""


def journal_frames(
    observation: Observation,
    joint: str,
    clearance: float,
    instants: Instants,
    *,
    section: CrossSection | None = None,
    columns: int = 8,
    figure: Figure | None = None,
) -> Figure:
    """Draw the journal in its bearing, with one picture for each instant and each base.

    In each pair of rows, the upper one shows base V, the lower one base W. Clearance and
    eccentricity are enlarged by the same factor, so that the drawn clearance is 0.3 of the
    bearing's radius. The journal is dark in contact and light in flight.

    **Arguments:** `instants`: (M,) times, s; each picture shows the nearest observed time.
    `section`: directions as in `eccentricity_vectors`. `columns`: instants in a row; further ones
    continue in a new pair of rows. `figure`: empty figure to draw into; a new one by default.

    >>> figure = plot.journal_frames(observed, "shoulder", 0.5e-3, [0.0, 0.01, 0.02])
    """
    require_positive("clearance", clearance, "give it in m")
    require_count("columns", columns, "give a number of pictures in a row")
    nearest = _nearest(observation.times, instants)
    blocks = -(-len(nearest) // columns)  # pairs of rows, rounded up
    if figure is None:
        # Inches: a picture is 1.3 wide, a pair of rows with titles 2.75 high, the legend 0.3.
        figure = Figure(figsize=(1.3 * columns, 2.75 * blocks + 0.3), layout="constrained")
    grid = figure.subplots(2 * blocks, columns, squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
    for row_of_pair, base in enumerate(BASES):
        # Lengths in pictures are in radii of the bearing, of which the clearance is `DRAWN_GAP`.
        offsets = eccentricity_vectors(observation, joint, base, section) * (DRAWN_GAP / clearance)
        touching = observation.contacts[joint][base].penetration > 0.0
        for k, index in enumerate(nearest):
            axes = grid[2 * (k // columns) + row_of_pair, k % columns]
            Picture(axes).show(offsets[index], touching[index])
            if row_of_pair == 0:  # a title above the upper picture holds for both bases
                axes.set_title(f"{observation.times[index] * 1e3:.1f} ms", fontsize=10)
            if k % columns == 0:  # left of the bearing's wall, which ends at -(1 + WALL)
                axes.text(-1.25, 0.0, f"base {base}", rotation=90, ha="right", va="center")
    samples = [Circle((0, 0), 1, facecolor=face, edgecolor=DARK) for face in (DARK, LIGHT)]
    samples += [Circle((0, 0), 0, visible=False)]  # the note on the clearance has no symbol
    texts = ["in contact", "in flight", NOTE]
    figure.legend(samples, texts, loc="outside lower center", ncols=3, frameon=False)
    return figure


def animate_journal(
    observation: Observation,
    joint: str,
    clearance: float,
    file: str | Path,
    instants: Instants,
    *,
    section: CrossSection | None = None,
    frames_per_second: int = 15,
) -> None:
    """Write a GIF file in which the journal moves in its bearing, base V on the left, base W on the
    right, dark in contact and light in flight. Clearance and eccentricity are enlarged.

    **Arguments:** `file`: path, with the suffix ".gif". `instants`: (M,) times, s, one for each
    frame, which shows the nearest observed time. `section`: as in `eccentricity_vectors`.

    >>> plot.animate_journal(observed, "shoulder", 0.5e-3, "journal.gif", np.linspace(0, 0.02, 5))
    """
    require_positive("clearance", clearance, "give it in m")
    require_positive("frames_per_second", frames_per_second, "take the default of 15")
    is_gif = Path(file).suffix.lower() == ".gif"
    require(is_gif, "file", str(file), "with the suffix .gif", "name a GIF")
    nearest = _nearest(observation.times, instants)
    # Inches: two square pictures, and above them space for their titles and the time.
    figure = Figure(figsize=(5.0, 2.9))
    pair = figure.subplots(1, 2)
    figure.subplots_adjust(left=0.02, right=0.98, bottom=0.08, top=0.82, wspace=0.05)
    figure.text(0.5, 0.02, NOTE, ha="center", fontsize=8)
    time_text = figure.suptitle("", fontsize=11)
    pictures = []
    for axes, base in zip(pair, BASES, strict=True):
        axes.set_axis_off()
        axes.set_title(f"base {base}", fontsize=10)
        # Lengths in pictures are in radii of the bearing, of which the clearance is `DRAWN_GAP`.
        offsets = eccentricity_vectors(observation, joint, base, section) * (DRAWN_GAP / clearance)
        touching = observation.contacts[joint][base].penetration > 0.0
        pictures.append((Picture(axes), offsets, touching))
    writer = PillowWriter(frames_per_second)
    with writer.saving(figure, str(file), dpi=80):  # a low resolution keeps the file small
        for index in nearest:
            for picture, offsets, touching in pictures:
                picture.show(offsets[index], touching[index])
            time_text.set_text(f"{observation.times[index] * 1e3:.1f} ms")
            writer.grab_frame()


class Picture:
    """Circle of a journal inside the ring of its bearing. Lengths are in radii of the bearing."""

    def __init__(self, axes: Axes):
        axes.add_patch(Annulus((0.0, 0.0), 1.0 + WALL, WALL, facecolor=GREY, edgecolor="none"))
        self._journal = Circle((0.0, 0.0), 1.0 - DRAWN_GAP, edgecolor=DARK)
        axes.add_patch(self._journal)
        axes.plot(0.0, 0.0, "+", color=GREY, markersize=7)
        (self._centre,) = axes.plot(0.0, 0.0, ".", markersize=5)
        limit = 1.02 + WALL
        axes.set(xlim=(-limit, limit), ylim=(-limit, limit), aspect="equal")

    def show(self, offset: np.ndarray, touching: bool) -> None:
        """Move the journal's centre to `offset` (2,); colour it dark if `touching`, else light."""
        self._journal.set_center((float(offset[0]), float(offset[1])))
        self._journal.set_facecolor(DARK if touching else LIGHT)
        self._centre.set_data(offset[:1], offset[1:])
        self._centre.set_color("white" if touching else DARK)


def _nearest(times: np.ndarray, instants: Instants) -> list[int]:
    row = np.asarray(as_number(instants, "instants", "s"))
    suits = row.ndim == 1 and row.size > 0 and bool(np.isfinite(row).all())
    require(suits, "instants", row, "a row of finite times", "give one time or more, s")
    return [int(np.argmin(np.abs(times - instant))) for instant in row]
