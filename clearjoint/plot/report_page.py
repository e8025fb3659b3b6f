"""A run on one page."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib import rc, rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.transforms import ScaledTranslation

from ..fields.checks import require
from ..model.plays.journal_bases import HasJournal
from ..model.scene import Scene
from ..quantities.base import Quantity
from ..simulation.observe import Observation, observe
from ..simulation.settings import Settings
from ..simulation.solution import Solution
from .along import series, trajectory_of
from .energies import energy_ledger
from .forces import contact_forces, joint_forces
from .journal import journal_orbit
from .polar import contact_rose
from .report_tables import IMPACT_COLUMNS, JOINT_COLUMNS, Cells, impact_rows, joint_rows, run_lines
from .spectra import is_even, spectrum_of
from .style import GREY, dress, hide_legend, lines
from .timelines import motion_timeline

PAGE = (8.27, 11.69)
"""Width and height, inches: A4."""
ENDINGS = (".png", ".pdf")
MOST_JOINTS, MOST_ORBITS, MOST_IMPACTS = 8, 2, 8
LINE = 0.145
"""Height of a line of text, inches."""
MARGIN = 0.4
"""Around the page, inches."""
THINNER = 0.6
"""Width of a line on the page, over that of a line in a figure of its own."""
MANY = 5000
"""Points from which on a line is pixels in a PDF."""
DOTS = 200
"""Pixels per inch of a PNG, and of what is pixels in a PDF."""
NO_SPECTRUM = "no spectrum: states are not saved\nat equal intervals of time"
JOINT_PLACES = (0.0, 0.14, 0.30, 0.50, 0.60, 0.83)
IMPACT_PLACES = (0.0, 0.16, 0.24, 0.34, 0.46, 0.605, 0.745, 0.87)


def report(
    scene: Scene,
    solution: Solution,
    file: str | Path | None = None,
    *,
    title: str = "",
    settings: Settings | None = None,
    quantity: Quantity | None = None,
    unit: str | None = None,
) -> Figure:
    """A run on one page: the scene and the run in words, orbits in their clearance circles, forces,
    motion modes, energies, a spectrum, and the largest impacts.

    What a run has not is left out: a scene without play has paths of its bodies instead of orbits,
    and no forces of contacts.

    **Arguments:**

    - `scene`: the one that was simulated. `solution`: with saved states, best with
      ``Saving(np.linspace(0, end, count), steps=True, impacts=True)`` of a run with
      ``Settings(ledger=True)``: forces and modes are drawn along the steps, which resolve impacts,
      if they were kept.
    - `file`: where to write the page, which ends in ".png" or ".pdf"; nowhere unless given.
    - `title`: in the first line; "Run of" and the names of the bodies unless given.
    - `settings`: those of the run, for the table; what the solution knows of them unless given.
    - `quantity`, `unit`: whose spectrum to draw, as of `plot.series`; the velocity that changes
      most of the last body's centre unless given.

    **Returns:** the figure, of the size A4.

    **Raises:** `ValueError` for another ending, and a solution without states.

        plot.report(scene, solution, "four_bar.pdf", title="Four-bar, two plays")
    """
    if file is not None:
        ending, remedy = Path(file).suffix.lower(), "name a PNG or a PDF"
        require(ending in ENDINGS, "file", str(file), "with the ending .png or .pdf", remedy)
    seen = observe(scene, solution, solution.steps or trajectory_of(solution, None))
    record = _record(scene, solution, quantity, unit)
    with rc_context():
        rc("font", size=7.0)
        rc("axes", titlesize=7.5, labelsize=7.0, linewidth=0.6)
        rc("hatch", linewidth=0.5)
        figure = Figure(figsize=PAGE, layout="constrained")
        parts = _parts(scene, solution, settings, seen, record)
        heights = [part.height for part in parts]
        page = _inside_margins(figure)
        page.suptitle(title or f"Run of {', '.join(scene.bodies)}", fontsize=12)
        rows = page.subfigures(len(parts), 1, height_ratios=heights, squeeze=False)[:, 0]
        for row, part in zip(rows, parts, strict=True):
            part.draw(row)
        if file is not None:
            figure.savefig(file, dpi=DOTS)
    return figure


def _inside_margins(figure: Figure) -> SubFigure:
    """What the margins leave of a page."""
    width, height = (length - 2.0 * MARGIN for length in PAGE)
    rows = figure.subfigures(3, 1, height_ratios=(MARGIN, height, MARGIN), squeeze=False)
    middle: SubFigure = rows[1, 0]
    return middle.subfigures(1, 3, width_ratios=(MARGIN, width, MARGIN), squeeze=False)[0, 1]


class _Part(NamedTuple):
    """A row of the page: its height, inches, and what draws it."""

    height: float
    draw: Callable[[SubFigure], None]


def _parts(
    scene: Scene,
    solution: Solution,
    settings: Settings | None,
    seen: Observation,
    record: xr.DataArray,
) -> list[_Part]:
    """The rows of the page from above; those for which the run has something."""
    words, joints = run_lines(scene, solution, settings), joint_rows(scene, MOST_JOINTS)
    tall = LINE * (len(words) + len(joints) + 2.5)
    parts = [_Part(tall, lambda row: _words(row, words, joints))]
    parts += [_Part(2.6, lambda row: _motion(row, scene, solution, seen))]
    if seen.contacts:
        tall = 2.4 + 0.2 * len(seen.contacts)
        parts += [_Part(tall, lambda row: _over_time(row, seen))]
    parts += [_Part(2.5, lambda row: _energies(row, seen, record))]
    if solution.impacts:
        impacts = impact_rows(solution.impacts, MOST_IMPACTS)
        tall = LINE * (len(impacts) + 2.5)
        parts += [_Part(tall, lambda row: _impacts(row, impacts))]
    return parts


def _words(row: SubFigure, words: list[str], joints: list[Cells]) -> None:
    axes = row.add_subplot()
    for line, text in enumerate(words):
        _write(axes, 0.0, line, text)
    _table(axes, JOINT_COLUMNS, joints, JOINT_PLACES, len(words) + 0.5)


def _impacts(row: SubFigure, impacts: list[Cells]) -> None:
    axes = row.add_subplot()
    _write(axes, 0.0, 0.0, "Impacts of largest force", "bold")
    _table(axes, IMPACT_COLUMNS, impacts, IMPACT_PLACES, 1.2)


def _table(
    axes: Axes,
    head: Cells,
    rows: list[Cells],
    places: tuple[float, ...],
    first: float,
) -> None:
    """A table from a line of the axes on, its columns at shares of the width; a rule below the
    head."""
    axes.set_axis_off()
    for place, cell in zip(places, head, strict=True):
        _write(axes, place, first, cell, weight="bold")
    for line, row in enumerate(rows):
        for place, cell in zip(places, row, strict=False):
            _write(axes, place, first + 1.2 + line, cell)
    _rule(axes, first + 1.1)


def _rule(axes: Axes, line: float) -> None:
    """A rule across the axes, so many lines from the top."""
    lower = ScaledTranslation(0.0, -LINE * line, axes.figure.dpi_scale_trans)
    where = axes.transAxes + lower
    axes.plot([0.0, 1.0], [1.0, 1.0], color=GREY, linewidth=0.6, transform=where, clip_on=False)


def _write(axes: Axes, place: float, line: float, text: str, weight: str = "normal") -> None:
    """Text at a share of the width, so many lines from the top."""
    axes.annotate(
        text,
        (place, 1.0),
        (0.0, -72.0 * LINE * line),
        xycoords="axes fraction",
        textcoords="offset points",
        va="top",
        weight=weight,
        annotation_clip=False,
    )


def _motion(row: SubFigure, scene: Scene, solution: Solution, seen: Observation) -> None:
    """Orbits of the journals that are pressed hardest, and where the first one is pressed; or the
    paths of the bodies."""
    journals = [name for name, joint in scene.joints.items() if isinstance(joint, HasJournal)]
    if not journals:
        _paths(row.add_subplot(), solution)
        return
    hardest = sorted(journals, key=lambda name: -_peak(seen, name))[:MOST_ORBITS]
    grid = row.add_gridspec(1, len(hardest) + 1)
    for k, name in enumerate(hardest):
        axes = journal_orbit(seen, name, axes=row.add_subplot(grid[k]))
        axes.set_title(f"{name}: orbit")
        _small(axes)
    axes = contact_rose(seen, hardest[0], axes=row.add_subplot(grid[-1], projection="polar"))
    axes.set_title(f"{hardest[0]}: directions")
    orbits, bars = (some.get_legend_handles_labels() for some in (row.axes[0], axes))
    names = [*map(str, orbits[1]), *(f"{label}, direction" for label in bars[1])]
    handles = [*orbits[0], *bars[0]]
    for axes in row.axes:
        hide_legend(axes)
    row.legend(handles, names, loc="outside lower center", ncols=5, frameon=False)


def _peak(seen: Observation, joint: str) -> float:
    """Largest normal force of a joint, N."""
    return max(float(np.max(one.normal_force)) for one in seen.contacts[joint].values())


def _paths(axes: Axes, solution: Solution) -> None:
    """Paths of the bodies' centres in the plane in which they move most."""
    bodies = trajectory_of(solution, solution.steps).states.bodies
    places = {name: np.asarray(body.position) for name, body in bodies.items()}
    spread = np.ptp(np.concatenate(list(places.values())), axis=0)
    right, up = sorted(np.argsort(-spread, kind="stable")[:2])
    for (name, path), (colour, style) in zip(places.items(), lines(), strict=False):
        axes.plot(path[:, right], path[:, up], color=colour, linestyle=style, label=name)
    axes.set_aspect("equal")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    dress(axes, f"{'XYZ'[right]} of the centres, m", f"{'XYZ'[up]}, m")


def _over_time(row: SubFigure, seen: Observation) -> None:
    """Forces, and below them motion modes."""
    heights = 1.6, 0.4 + 0.2 * len(seen.contacts)
    above, below = row.subplots(2, 1, sharex=True, height_ratios=heights)
    if len(seen.contacts) == 1:
        contact_forces(seen, *seen.contacts, axes=above)
    else:
        joint_forces(seen, axes=above)
    above.set_xlabel("")
    motion_timeline(seen, axes=below)
    _small(above)


def _energies(row: SubFigure, seen: Observation, record: xr.DataArray) -> None:
    """The ledger at the left, the spectrum at the right."""
    panels = row.subplot_mosaic([["stored", "lines"], ["drift", "lines"]], height_ratios=(2.0, 1.0))
    panels["stored"].sharex(panels["drift"])
    energy_ledger(seen, axes=np.array([panels["stored"], panels["drift"]]))
    panels["stored"].tick_params(labelbottom=False)
    axes = panels["lines"]
    if is_even(np.diff(record["time"].values)):
        spectrum_of(record, axes=axes)
    else:
        axes.set_axis_off()
        axes.text(0.5, 0.5, NO_SPECTRUM, ha="center", va="center", transform=axes.transAxes)
    for axes in panels.values():
        _small(axes)


def _small(axes: Axes) -> None:
    """Make lines thin, and those of many points pixels, so that a PDF stays small."""
    for line in axes.get_lines():
        line.set_linewidth(THINNER * line.get_linewidth())
        line.set_rasterized(len(np.asarray(line.get_xdata())) > MANY)


def _record(
    scene: Scene, solution: Solution, quantity: Quantity | None, unit: str | None
) -> xr.DataArray:
    """What the spectrum is of, at the saved states, or along the steps without."""
    trajectory = trajectory_of(solution, solution.saved or solution.steps)
    if quantity is not None:
        return series(scene, solution, quantity, unit=unit, trajectory=trajectory)
    body, state = list(trajectory.states.bodies.items())[-1]
    velocity = np.asarray(state.velocity)
    axis = int(np.argmax(np.ptp(velocity, axis=0)))
    times = xr.DataArray(np.asarray(trajectory.times), dims="time", attrs={"units": "s"})
    name, attrs = f"velocity of {body} {'xyz'[axis]}", {"units": "m/s"}
    return xr.DataArray(velocity[:, axis], {"time": times}, ("time",), name=name, attrs=attrs)
