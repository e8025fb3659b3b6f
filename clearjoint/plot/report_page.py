"""Report of a run on one page."""

from collections.abc import Callable
from pathlib import Path
from textwrap import fill
from typing import NamedTuple

import jax
import numpy as np
import xarray as xr
from matplotlib import rc, rc_context
from matplotlib.figure import Figure, SubFigure

from ..fields.checks import require
from ..fields.drawn_text import literal, shown
from ..model.scene import Scene
from ..quantities.base import Quantity
from ..simulation.results.observe import Observation, observe
from ..simulation.results.solution import Solution, Trajectory
from ..simulation.step.settings import Settings
from .report_panels import (
    LINE,
    draw_description,
    draw_energies,
    draw_impacts,
    draw_motion,
    draw_over_time,
)
from .report_tables import impact_rows, joint_rows, run_lines
from .time_series import series, trajectory_of

PAGE = (8.27, 11.69)
"""Width and height, inches: A4."""
SUFFIXES = (".png", ".pdf")
MOST_JOINTS, MOST_IMPACTS = 8, 8
"""Largest numbers of joints and impacts that the tables list."""
TABLE_EXTRA_LINES = 2.6
"""Height of a table's head and of the gaps around the table, in lines of text."""
MOTION_HEIGHT, FORCES_HEIGHT, CONTACT_HEIGHT, ENERGY_HEIGHT = 2.6, 2.4, 0.2, 2.5
"""Heights of figures, inches, before they are stretched to fill the page: motion, forces with
contact phases, addition to these for each contact, energies with the spectrum."""
TITLE_HEIGHT = 0.4
"""Height of the title, inches."""
MARGIN = 0.4
"""Margin of the page, inches."""
DPI = 200
"""Pixels per inch of a PNG, and of rasterised curves in a PDF."""
TITLE_LENGTH = 70
"""Characters in a line of the title."""


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
    """Draw a report of a run on one page: descriptions of scene and run, journal orbits, forces,
    contact phases, energies, a spectrum, and the largest impacts.

    For a scene without clearance joints, paths of the bodies replace the orbits, and there are no
    contact forces.

    **Arguments:**

    - `scene`: the simulated scene. `solution`: with saved states, best from a run with
      ``Saving(np.linspace(0, end, count), steps=True, impacts=True)`` and
      ``Settings(ledger=True)``. Orbits, forces and phases are drawn along the accepted steps, which
      resolve impacts, and inside them (`Trajectory.between`), if these are saved.
    - `file`: path of the page, with the suffix ".png" or ".pdf"; not written by default.
    - `title`: by default "Run of" and the names of the bodies.
    - `settings`: those of the run, for the description; by default those that the solution has.
    - `quantity`, `unit`: quantity of the spectrum, see `plot.series`; by default the velocity
      component of the last body's centre that changes most.

    **Returns:** the figure, of size A4.

    **Raises:** `ValueError` for another suffix, and for a solution without states.

    >>> save = cj.Saving(np.linspace(0, 0.5, 101))
    >>> solution = cj.simulate(scene, state, 0.5, save=save, progress=False)
    >>> figure = plot.report(scene, solution, "ball.pdf", title="Ball on a spring")
    """
    if file is not None:
        suffix, remedy = Path(file).suffix.lower(), "name a PNG or a PDF"
        require(suffix in SUFFIXES, "file", str(file), "with the suffix .png or .pdf", remedy)
    kind, remedy = type(solution).__name__, "draw other results by the other functions of plot"
    require(isinstance(solution, Solution), "solution", kind, "a Solution of simulate()", remedy)
    if solution.steps is not None and len(solution.steps) > 1:
        path = solution.steps.between()
        along = observe(scene, solution, path)
        # The integrals of the energy ledger are only known at the ends of steps.
        ends = np.isin(along.times, np.asarray(solution.steps.times))
        at_ends = jax.tree.map(lambda rows: np.asarray(rows)[ends], along)
    else:
        path = trajectory_of(solution, solution.saved or solution.steps)
        along = at_ends = observe(scene, solution, path)
    record = _record(scene, solution, quantity, unit)
    with rc_context():
        rc("font", size=7.0)
        rc("axes", titlesize=7.5, labelsize=7.0, linewidth=0.6)
        rc("hatch", linewidth=0.5)
        figure = Figure(figsize=PAGE, layout="constrained")
        parts = _parts(scene, solution, settings, ObservedRun(path, along, at_ends), record)
        heights = _heights(parts)
        page = _inside_margins(figure)
        names = ", ".join(shown(name) for name in scene.bodies)
        page.suptitle(fill(literal(title) or f"Run of {names}", TITLE_LENGTH), fontsize=12)
        rows = page.subfigures(len(parts), 1, height_ratios=heights, squeeze=False)[:, 0]
        for row, part in zip(rows, parts, strict=True):
            part.draw(row)
        if file is not None:
            figure.savefig(file, dpi=DPI)
    return figure


def _inside_margins(figure: Figure) -> SubFigure:
    """Return the part of the page inside the margins."""
    width, height = (length - 2.0 * MARGIN for length in PAGE)
    rows = figure.subfigures(3, 1, height_ratios=(MARGIN, height, MARGIN), squeeze=False)
    middle: SubFigure = rows[1, 0]
    return middle.subfigures(1, 3, width_ratios=(MARGIN, width, MARGIN), squeeze=False)[0, 1]


class ObservedRun(NamedTuple):
    """A dense `path` of states, the observation `along` it, and its part `at_ends` of steps."""

    path: Trajectory
    along: Observation
    at_ends: Observation


class _Part(NamedTuple):
    """A row of the page.

    - `height`: inches. A table has exactly this height; figures share the rest of the page in
      proportion to their heights.
    - `draw`: function that draws the row.
    - `is_table`: whether the row is a table.
    """

    height: float
    draw: Callable[[SubFigure], None]
    is_table: bool = False


def _heights(parts: list[_Part]) -> list[float]:
    """Return the heights of the rows, inches, with figures stretched so that the page is full."""
    tables = sum(part.height for part in parts if part.is_table)
    pictures = sum(part.height for part in parts if not part.is_table)
    stretch = (PAGE[1] - 2.0 * MARGIN - TITLE_HEIGHT - tables) / pictures
    return [part.height * (1.0 if part.is_table else stretch) for part in parts]


def _parts(
    scene: Scene,
    solution: Solution,
    settings: Settings | None,
    run: ObservedRun,
    record: xr.DataArray,
) -> list[_Part]:
    """Return the rows of the page from top to bottom, without those that would be empty.

    Forces need clearance joints, and the table of impacts needs recorded impacts.

    **Arguments:** `run`: the run, for the figures; `record`: quantity of the spectrum over time.
    """
    lines, joints = run_lines(scene, solution, settings), joint_rows(scene, MOST_JOINTS)
    height = LINE * (len(lines) + len(joints) + TABLE_EXTRA_LINES)
    parts = [_Part(height, lambda row: draw_description(row, lines, joints), is_table=True)]
    parts += [_Part(MOTION_HEIGHT, lambda row: draw_motion(row, scene, run.path, run.along))]
    if run.along.contacts:
        height = FORCES_HEIGHT + CONTACT_HEIGHT * len(run.along.contacts)
        parts += [_Part(height, lambda row: draw_over_time(row, run.along))]
    parts += [_Part(ENERGY_HEIGHT, lambda row: draw_energies(row, run.at_ends, record))]
    if solution.impacts:
        impacts = impact_rows(solution.impacts, MOST_IMPACTS)
        height = LINE * (len(impacts) + TABLE_EXTRA_LINES)
        parts += [_Part(height, lambda row: draw_impacts(row, impacts), is_table=True)]
    return parts


def _record(
    scene: Scene, solution: Solution, quantity: Quantity | None, unit: str | None
) -> xr.DataArray:
    """Return the quantity of the spectrum over time.

    It is taken at the saved states, or at the ends of the steps if no states are saved. Without a
    given quantity it is the component of the last body's velocity that changes most, or of its spin
    if its centre has a constant velocity.
    """
    trajectory = trajectory_of(solution, solution.saved or solution.steps)
    if quantity is not None:
        return series(scene, solution, quantity, unit=unit, trajectory=trajectory)
    body, state = list(trajectory.states.bodies.items())[-1]
    velocity, spin = np.asarray(state.velocity), np.asarray(state.spin)
    if np.ptp(velocity, axis=0).max() > 0.0:
        return _component(trajectory, velocity, f"velocity of {body}", "m/s")
    return _component(trajectory, spin, f"spin of {body} about its", "rad/s")


def _component(trajectory: Trajectory, vectors: np.ndarray, name: str, unit: str) -> xr.DataArray:
    """Return the component of vectors (N, 3) that has the largest range, as a labelled array."""
    axis = int(np.argmax(np.ptp(vectors, axis=0)))
    times = xr.DataArray(np.asarray(trajectory.times), dims="time", attrs={"units": "s"})
    name, attrs = f"{name} {'xyz'[axis]}", {"units": unit}
    return xr.DataArray(vectors[:, axis], {"time": times}, ("time",), name=name, attrs=attrs)
