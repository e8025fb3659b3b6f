"""Draw the rows of the page of `plot.report`, each into its own subfigure."""

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
from .style import GREY, draw_lines, dress
from .time_series import is_even, spectrum_of
from .timelines import motion_timeline

MOST_ORBITS = 2
WIDTH = 7.4
"""Width between the margins of the page, inches."""
LETTER = 0.066
"""Width of a letter in a table, inches; a little more than that of bold text."""
LINE_LENGTH = 125
"""Characters in a line of the page."""
TITLE = 26
"""Characters of a name in the title of a panel."""
LINE = 0.145
"""Height of a line of text, inches."""
THINNER = 0.6
"""Line widths on the page relative to those of single figures."""
MANY = 5000
"""Points from which on a curve is rasterised in a PDF."""
SMALL_MOTION = 0.02
"""Paths of the bodies are not drawn if no centre moves farther than this fraction of the size of
the mechanism."""
NO_SPECTRUM = "no spectrum: states are not saved\nat equal intervals of time"
JOINT_POSITIONS = (0.0, 0.14, 0.30, 0.50, 0.585, 0.81)
IMPACT_POSITIONS = (0.0, 0.16, 0.26, 0.36, 0.48, 0.615, 0.745, 0.86)


def draw_description(row: SubFigure, lines: list[str], joints: list[Cells]) -> None:
    """Write the `lines` that describe scene and run, and below them a table with the rows
    `joints`, whose columns are `JOINT_COLUMNS`."""
    axes = row.add_subplot()
    for line, text in enumerate(lines):
        _write(axes, 0.0, line, shown(text, LINE_LENGTH))
    _table(axes, JOINT_COLUMNS, joints, JOINT_POSITIONS, len(lines) + 0.5)


def draw_impacts(row: SubFigure, impacts: list[Cells]) -> None:
    """Write a table with the rows `impacts`, whose columns are `IMPACT_COLUMNS`."""
    axes = row.add_subplot()
    _write(axes, 0.0, 0.0, "Impacts of largest force", "bold")
    _table(axes, IMPACT_COLUMNS, impacts, IMPACT_POSITIONS, 1.2)


def _table(
    axes: Axes,
    head: Cells,
    rows: list[Cells],
    positions: tuple[float, ...],
    first: float,
) -> None:
    """Write a table from the line `first` on, with a rule below the head.

    **Arguments:** `positions`: left ends of the columns, as fractions of the width.
    """
    axes.set_axis_off()
    lengths = [int(WIDTH * width / LETTER) for width in np.diff([*positions, 1.0])]
    for position, cell in zip(positions, head, strict=True):
        _write(axes, position, first, cell, weight="bold")
    for line, row in enumerate(rows):
        for position, length, cell in zip(positions, lengths, row, strict=False):
            _write(axes, position, first + 1.3 + line, shown(cell, length))
    shift = ScaledTranslation(0.0, -LINE * (first + 1.1), axes.figure.dpi_scale_trans)
    transform = axes.transAxes + shift
    axes.plot([0, 1], [1, 1], color=GREY, linewidth=0.6, transform=transform, clip_on=False)


def _write(axes: Axes, position: float, line: float, text: str, weight: str = "normal") -> None:
    """Write a text whose left end is at the fraction `position` of the width, `line` lines below
    the top."""
    axes.annotate(
        text,
        (position, 1.0),
        (0.0, -72.0 * LINE * line),
        xycoords="axes fraction",
        textcoords="offset points",
        va="top",
        weight=weight,
        annotation_clip=False,
    )


def draw_motion(row: SubFigure, scene: Scene, path: Trajectory, observed: Observation) -> None:
    """Draw the orbits of the two journals with the largest forces, and the contact directions of
    the journal with the largest force; for a scene without journals, the paths of the bodies.

    **Arguments:** `path`: states along the run; `observed`: observation of the same states.
    """
    journals = [name for name, joint in scene.joints.items() if isinstance(joint, HasJournal)]
    if not journals:
        _bodies(row.add_subplot(), path)
        return
    hardest = sorted(journals, key=lambda name: -_peak(observed, name))[:MOST_ORBITS]
    grid = row.add_gridspec(1, len(hardest) + 1)
    for k, name in enumerate(hardest):
        axes = journal_orbit(observed, name, axes=row.add_subplot(grid[k]))
        axes.set_title(f"{shown(name, TITLE)}: orbit")
        _small(axes)
    axes = contact_rose(observed, hardest[0], axes=row.add_subplot(grid[-1], projection="polar"))
    axes.set_title(f"{shown(hardest[0], TITLE)}: directions")
    orbits, bars = (panel.get_legend_handles_labels() for panel in (row.axes[0], axes))
    names = [*map(str, orbits[1]), *(f"{label}, direction" for label in bars[1])]
    handles = [*orbits[0], *bars[0]]
    # The legends keep their space in the layout, which is then the same for all panels.
    for legend in filter(None, (axes.get_legend() for axes in row.axes)):
        legend.set_visible(False)
    row.legend(handles, names, loc="outside lower center", ncols=5, frameon=False)


def _peak(observed: Observation, joint: str) -> float:
    """Return the largest normal force of a joint's contacts, N."""
    contacts = observed.contacts[joint].values()
    return max(float(np.max(contact.normal_force)) for contact in contacts)


def _bodies(axes: Axes, trajectory: Trajectory) -> None:
    """Draw the paths of the bodies' centres in the plane with the largest motion, or the spins over
    time if the centres hardly move."""
    bodies = trajectory.states.bodies
    paths = {name: np.asarray(body.position) for name, body in bodies.items()}
    spread = np.ptp(np.concatenate(list(paths.values())), axis=0)
    motion = max(np.ptp(path, axis=0).max() for path in paths.values())
    if motion > SMALL_MOTION * spread.max():
        right, up = sorted(np.argsort(-spread, kind="stable")[:2])
        curves = {name: (path[:, right], path[:, up]) for name, path in paths.items()}
        labels = f"{'XYZ'[right]} of the centres, m", f"{'XYZ'[up]}, m"
        axes.set_aspect("equal")
    else:
        factor, unit = time_unit(np.asarray(trajectory.times))
        times = factor * np.asarray(trajectory.times)
        spins = {name: np.linalg.norm(body.spin, axis=1) for name, body in bodies.items()}
        curves = {name: (times, spin) for name, spin in spins.items()}
        labels = f"time, {unit}", "spin of the bodies, rad/s"
        axes.margins(x=0.0)
    draw_lines(axes, ((shown(name), x, y) for name, (x, y) in curves.items()))
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), handlelength=3.0, frameon=False)
    dress(axes, *labels)
    _small(axes)


def draw_over_time(row: SubFigure, observed: Observation) -> None:
    """Draw the normal forces over time, and below them the contact phases."""
    heights = 1.6, 0.4 + 0.2 * len(observed.contacts)
    above, below = row.subplots(2, 1, sharex=True, height_ratios=heights)
    if len(observed.contacts) == 1:
        contact_forces(observed, *observed.contacts, axes=above)
    else:
        joint_forces(observed, axes=above)
    above.set_xlabel("")
    motion_timeline(observed, axes=below)
    _small(above)


def draw_energies(row: SubFigure, observed: Observation, record: xr.DataArray) -> None:
    """Draw the energy ledger on the left, and on the right the amplitude spectrum of `record` (N,)
    over "time", s."""
    panels = row.subplot_mosaic([["stored", "lines"], ["drift", "lines"]], height_ratios=(2.0, 1.0))
    panels["stored"].sharex(panels["drift"])
    energy_ledger(observed, axes=np.array([panels["stored"], panels["drift"]]))
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
    """Make lines thinner, and rasterise those of many points so that a PDF stays small."""
    for line in axes.get_lines():
        line.set_linewidth(THINNER * line.get_linewidth())
        line.set_rasterized(len(np.asarray(line.get_xdata())) > MANY)
