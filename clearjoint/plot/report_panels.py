"""The rows of a report: each draws into its part of the page."""

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import SubFigure
from matplotlib.transforms import ScaledTranslation

from ..fields.drawn_text import shown
from ..model.clearance_joints.journal_bases import HasJournal
from ..model.scene import Scene
from ..simulation.results.observe import Observation
from ..simulation.results.solution import Trajectory
from .energies import energy_ledger
from .forces import contact_forces, joint_forces
from .journal import journal_orbit
from .labels import time_unit
from .polar import contact_rose
from .report_tables import IMPACT_COLUMNS, JOINT_COLUMNS, Cells
from .style import GREY, dress, hide_legend, lines
from .time_series import is_even, spectrum_of
from .timelines import motion_timeline

MOST_ORBITS = 2
WIDTH = 7.4
"""Inches, between the margins of the page."""
LETTER = 0.066
"""Width of a letter of a table, inches: of bold ones a little more than the usual."""
LINE_LENGTH = 125
"""Characters in a line of the page."""
TITLE = 26
"""Characters of a name above a panel."""
LINE = 0.145
"""Height of a line of text, inches."""
THINNER = 0.6
"""Width of a line on the page, over that of a line in a figure of its own."""
MANY = 5000
"""Points from which on a line is pixels in a PDF."""
HARDLY = 0.02
"""Largest movement of a centre, over the size of the mechanism, of which no path is drawn."""
NO_SPECTRUM = "no spectrum: states are not saved\nat equal intervals of time"
JOINT_PLACES = (0.0, 0.14, 0.30, 0.50, 0.585, 0.81)
IMPACT_PLACES = (0.0, 0.16, 0.26, 0.36, 0.48, 0.615, 0.745, 0.86)


def draw_words(row: SubFigure, words: list[str], joints: list[Cells]) -> None:
    """The scene and the run in words, above a table of joints."""
    axes = row.add_subplot()
    for line, text in enumerate(words):
        _write(axes, 0.0, line, shown(text, LINE_LENGTH))
    _table(axes, JOINT_COLUMNS, joints, JOINT_PLACES, len(words) + 0.5)


def draw_impacts(row: SubFigure, impacts: list[Cells]) -> None:
    """A table of impacts."""
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
    rooms = [int(WIDTH * wide / LETTER) for wide in np.diff([*places, 1.0])]
    for place, cell in zip(places, head, strict=True):
        _write(axes, place, first, cell, weight="bold")
    for line, row in enumerate(rows):
        for place, room, cell in zip(places, rooms, row, strict=False):
            _write(axes, place, first + 1.3 + line, shown(cell, room))
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


def draw_motion(row: SubFigure, scene: Scene, path: Trajectory, seen: Observation) -> None:
    """Orbits of the journals that are pressed hardest, and where the first one is pressed; or the
    paths of the bodies."""
    journals = [name for name, joint in scene.joints.items() if isinstance(joint, HasJournal)]
    if not journals:
        _bodies(row.add_subplot(), path)
        return
    hardest = sorted(journals, key=lambda name: -_peak(seen, name))[:MOST_ORBITS]
    grid = row.add_gridspec(1, len(hardest) + 1)
    for k, name in enumerate(hardest):
        axes = journal_orbit(seen, name, axes=row.add_subplot(grid[k]))
        axes.set_title(f"{shown(name, TITLE)}: orbit")
        _small(axes)
    axes = contact_rose(seen, hardest[0], axes=row.add_subplot(grid[-1], projection="polar"))
    axes.set_title(f"{shown(hardest[0], TITLE)}: directions")
    orbits, bars = (some.get_legend_handles_labels() for some in (row.axes[0], axes))
    names = [*map(str, orbits[1]), *(f"{label}, direction" for label in bars[1])]
    handles = [*orbits[0], *bars[0]]
    for axes in row.axes:
        hide_legend(axes)
    row.legend(handles, names, loc="outside lower center", ncols=5, frameon=False)


def _peak(seen: Observation, joint: str) -> float:
    """Largest normal force of a joint, N."""
    return max(float(np.max(one.normal_force)) for one in seen.contacts[joint].values())


def _bodies(axes: Axes, trajectory: Trajectory) -> None:
    """Paths of the bodies' centres in the plane in which they move most; their spins over time
    where the centres hardly move."""
    bodies = trajectory.states.bodies
    places = {name: np.asarray(body.position) for name, body in bodies.items()}
    spread = np.ptp(np.concatenate(list(places.values())), axis=0)
    moved = max(np.ptp(path, axis=0).max() for path in places.values())
    if moved > HARDLY * spread.max():
        right, up = sorted(np.argsort(-spread, kind="stable")[:2])
        curves = {name: (path[:, right], path[:, up]) for name, path in places.items()}
        labels = f"{'XYZ'[right]} of the centres, m", f"{'XYZ'[up]}, m"
        axes.set_aspect("equal")
    else:
        factor, unit = time_unit(np.asarray(trajectory.times))
        times = factor * np.asarray(trajectory.times)
        spins = {name: np.linalg.norm(body.spin, axis=1) for name, body in bodies.items()}
        curves = {name: (times, spin) for name, spin in spins.items()}
        labels = f"time, {unit}", "spin of the bodies, rad/s"
        axes.margins(x=0.0)
    for (name, (x, y)), (colour, style) in zip(curves.items(), lines(), strict=False):
        axes.plot(x, y, color=colour, linestyle=style, label=shown(name))
    look = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5), "handlelength": 3.0}
    axes.legend(frameon=False, **look)
    dress(axes, *labels)
    _small(axes)


def draw_over_time(row: SubFigure, seen: Observation) -> None:
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


def draw_energies(row: SubFigure, seen: Observation, record: xr.DataArray) -> None:
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
