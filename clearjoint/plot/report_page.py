"""A run on one page."""

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
    draw_energies,
    draw_impacts,
    draw_motion,
    draw_over_time,
    draw_words,
)
from .report_tables import impact_rows, joint_rows, run_lines
from .time_series import series, trajectory_of

PAGE = (8.27, 11.69)
"""Width and height, inches: A4."""
ENDINGS = (".png", ".pdf")
MOST_JOINTS, MOST_IMPACTS = 8, 8
HEAD = 0.4
"""Height of the title, inches."""
MARGIN = 0.4
"""Around the page, inches."""
DOTS = 200
TITLE = 70
"""Characters in a line of the title."""
"""Pixels per inch of a PNG, and of what is pixels in a PDF."""


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
      ``Settings(ledger=True)``: orbits, forces and modes are drawn along the steps, which resolve
      impacts, and inside them (`Trajectory.between`), if they were kept.
    - `file`: where to write the page, which ends in ".png" or ".pdf"; nowhere unless given.
    - `title`: in the first line; "Run of" and the names of the bodies unless given.
    - `settings`: those of the run, for the table; what the solution knows of them unless given.
    - `quantity`, `unit`: whose spectrum to draw, as of `plot.series`; the velocity that changes
      most of the last body's centre unless given.

    **Returns:** the figure, of the size A4.

    **Raises:** `ValueError` for another ending, and a solution without states.

    >>> save = cj.Saving(np.linspace(0, 0.5, 101))
    >>> solution = cj.simulate(scene, state, 0.5, save=save, progress=False)
    >>> figure = plot.report(scene, solution, "ball.pdf", title="Ball on a spring")
    """
    if file is not None:
        ending, remedy = Path(file).suffix.lower(), "name a PNG or a PDF"
        require(ending in ENDINGS, "file", str(file), "with the ending .png or .pdf", remedy)
    kind, remedy = type(solution).__name__, "draw what is left of other runs by single calls"
    require(isinstance(solution, Solution), "solution", kind, "a Solution of simulate()", remedy)
    if solution.steps is not None and len(solution.steps) > 1:
        path = solution.steps.between()
        seen = observe(scene, solution, path)
        # Integrals of the ledger are known at the steps' ends alone.
        ends = np.isin(seen.times, np.asarray(solution.steps.times))
        at_ends = jax.tree.map(lambda rows: np.asarray(rows)[ends], seen)
    else:
        path = trajectory_of(solution, solution.saved or solution.steps)
        seen = at_ends = observe(scene, solution, path)
    record = _record(scene, solution, quantity, unit)
    with rc_context():
        rc("font", size=7.0)
        rc("axes", titlesize=7.5, labelsize=7.0, linewidth=0.6)
        rc("hatch", linewidth=0.5)
        figure = Figure(figsize=PAGE, layout="constrained")
        parts = _parts(scene, solution, settings, Seen(path, seen, at_ends), record)
        heights = _heights(parts)
        page = _inside_margins(figure)
        names = ", ".join(shown(name) for name in scene.bodies)
        page.suptitle(fill(literal(title) or f"Run of {names}", TITLE), fontsize=12)
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


class Seen(NamedTuple):
    """A run as it is drawn: its states in a smooth `path`, what is observed `along` it, and the
    part of that `at_ends` of steps."""

    path: Trajectory
    along: Observation
    at_ends: Observation


class _Part(NamedTuple):
    """A row of the page: its height, inches, what draws it, and whether it is a table, which is as
    high as its lines; pictures share what tables leave."""

    height: float
    draw: Callable[[SubFigure], None]
    is_table: bool = False


def _heights(parts: list[_Part]) -> list[float]:
    """Heights of the rows, inches, that fill the page."""
    tables = sum(part.height for part in parts if part.is_table)
    pictures = sum(part.height for part in parts if not part.is_table)
    stretch = (PAGE[1] - 2.0 * MARGIN - HEAD - tables) / pictures
    return [part.height * (1.0 if part.is_table else stretch) for part in parts]


def _parts(
    scene: Scene,
    solution: Solution,
    settings: Settings | None,
    seen: Seen,
    record: xr.DataArray,
) -> list[_Part]:
    """The rows of the page from above; those for which the run has something."""
    words, joints = run_lines(scene, solution, settings), joint_rows(scene, MOST_JOINTS)
    tall = LINE * (len(words) + len(joints) + 2.6)
    parts = [_Part(tall, lambda row: draw_words(row, words, joints), True)]
    parts += [_Part(2.6, lambda row: draw_motion(row, scene, seen.path, seen.along))]
    if seen.along.contacts:
        tall = 2.4 + 0.2 * len(seen.along.contacts)
        parts += [_Part(tall, lambda row: draw_over_time(row, seen.along))]
    parts += [_Part(2.5, lambda row: draw_energies(row, seen.at_ends, record))]
    if solution.impacts:
        impacts = impact_rows(solution.impacts, MOST_IMPACTS)
        tall = LINE * (len(impacts) + 2.6)
        parts += [_Part(tall, lambda row: draw_impacts(row, impacts), True)]
    return parts


def _record(
    scene: Scene, solution: Solution, quantity: Quantity | None, unit: str | None
) -> xr.DataArray:
    """What the spectrum is of, at the saved states, or along the steps without."""
    trajectory = trajectory_of(solution, solution.saved or solution.steps)
    if quantity is not None:
        return series(scene, solution, quantity, unit=unit, trajectory=trajectory)
    body, state = list(trajectory.states.bodies.items())[-1]
    velocity, spin = np.asarray(state.velocity), np.asarray(state.spin)
    if np.ptp(velocity, axis=0).max() > 0.0:
        return _component(trajectory, velocity, f"velocity of {body}", "m/s")
    return _component(trajectory, spin, f"spin of {body} about its", "rad/s")


def _component(trajectory: Trajectory, vectors: np.ndarray, name: str, unit: str) -> xr.DataArray:
    """The component of vectors (N, 3) that changes most."""
    axis = int(np.argmax(np.ptp(vectors, axis=0)))
    times = xr.DataArray(np.asarray(trajectory.times), dims="time", attrs={"units": "s"})
    name, attrs = f"{name} {'xyz'[axis]}", {"units": unit}
    return xr.DataArray(vectors[:, axis], {"time": times}, ("time",), name=name, attrs=attrs)
