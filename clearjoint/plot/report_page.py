"""Report of a run on one page: its tables and figures.

The page consists of rows: a description of the scene and the run, the paths of the journals, forces
over time, energies with a spectrum, and a table of impacts. Each row is a matplotlib `SubFigure`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from textwrap import fill
from typing import NamedTuple

import jax
import numpy as np
import xarray as xr
from matplotlib import rc, rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.transforms import ScaledTranslation

from ..fields.checks import require, require_type
from ..fields.drawn_text import literal, shown
from ..model.clearance_joints.clearance import ClearanceJoint
from ..model.clearance_joints.journal_bases import HasJournal
from ..model.clearance_joints.lubricated import LubricatedJoint
from ..model.contact.laws import whole_law
from ..model.joints.base import AbstractConstraint, AbstractContactJoint
from ..model.scene import Scene
from ..quantities.base import Quantity
from ..result_codes import RESULTS
from ..simulation.results.impact_table import Impacts
from ..simulation.results.observe import Observation, observe
from ..simulation.results.solution import Solution, Trajectory
from .forces import contact_forces, joint_forces, motion_timeline
from .journal import journal_orbit
from .polar import contact_rose
from .style import GREY, draw_lines, dress, fitting_unit, time_unit
from .time_series import energy_ledger, labelled, series, spectrum_of, suits_spectrum, trajectory_of

Cells = Sequence[str]
"""Texts of a row of a table, from left to right."""
SYMBOLS = {"restitution": "c", "coefficient": "µ", "breakaway": "µ_S", "kinetic": "µ_C"}
"""Symbols of the numbers of a contact or friction law that the table shows, by field name."""
JOINT_COLUMNS = {
    "joint": 0.0,
    "kind": 0.14,
    "bodies": 0.30,
    "play": 0.50,
    "normal law": 0.585,
    "friction": 0.81,
}
"""Left ends of the columns of the table of joints, as fractions of the width of the page, by the
columns' titles."""
IMPACT_NUMBERS = (
    ("onset, ms", 0.26, "onset", 1e3, ".4f"),
    ("duration, µs", 0.36, "duration", 1e6, ".1f"),
    ("entry speed, m/s", 0.48, "entry_speed", 1.0, ".4g"),
    ("exit speed, m/s", 0.615, "exit_speed", 1.0, ".4g"),
    ("peak force, N", 0.745, "peak_force", 1.0, ".1f"),
    ("penetration, µm", 0.86, "largest_penetration", 1e6, ".4g"),
)
"""Columns of numbers in the table of impacts: title, left end as a fraction of the page's width,
name in `Impacts`, factor from the SI unit, and format."""
IMPACT_COLUMNS = {"joint": 0.0, "contact": 0.16} | {row[0]: row[1] for row in IMPACT_NUMBERS}
"""Left ends of the columns of the table of impacts, as `JOINT_COLUMNS` for joints."""


def joint_rows(scene: Scene, most: int) -> list[Cells]:
    """Return at most `most` rows of the table of joints. A row has the texts of its cells, in the
    order of the columns `JOINT_COLUMNS`; a joint without contacts has only the first three.

    Joints with contacts come first. If there are more joints than rows, the last row tells how many
    are left out, such as "3 more".
    """
    joints = sorted(
        scene.joints.items(), key=lambda item: not isinstance(item[1], AbstractContactJoint)
    )
    rows: list[Cells] = [_joint_row(name, joint) for name, joint in joints]
    return rows if len(rows) <= most else [*rows[: most - 1], (f"{len(rows) - most + 1} more",)]


def _joint_row(name: str, joint: AbstractConstraint | AbstractContactJoint) -> Cells:
    """Return the texts of a joint's cells, in the order of the columns `JOINT_COLUMNS`; only the
    first three for a joint without contacts."""
    head = name, type(joint).__name__, " – ".join(joint.body_names())
    if not isinstance(joint, AbstractContactJoint):
        return head
    # Contacts with equal laws share one text: the keys of a dictionary are unique and ordered.
    laws = dict.fromkeys(_law(whole_law(law)) for law in joint.laws().values())
    # A joint without the field `friction`, such as a user-defined one, shows its bristle laws only.
    friction = getattr(joint, "friction", None)
    frictions = [friction] if friction is not None else [*joint.bristle_laws().values()]
    # Shoulders, which stop the journal's axial motion, may have a friction law of their own. In a
    # lubricated joint they belong to `dry`, its clearance joint without the film.
    dry = joint.dry if isinstance(joint, LubricatedJoint) else joint
    if isinstance(dry, ClearanceJoint) and (face := dry.axial.shoulder_friction()) is not None:
        frictions += [face[0]]
    texts = dict.fromkeys(map(_law, frictions))
    return (*head, _play(joint), " / ".join(laws), " / ".join(texts) or "none")


def _law(law: object) -> str:
    """Return the class name of a law, and its restitution or coefficients of friction, such as
    "LankaraniNikravesh, c 0.9"."""
    numbers = [
        f"{symbol} {number:.3g}"
        for field, symbol in SYMBOLS.items()
        if (number := _single_number(law, field)) is not None
    ]
    return ", ".join([type(law).__name__, *numbers])


def _single_number(owner: object, field: str) -> float | None:
    """Return the value of a field of `owner`; ``None`` if there is no such field, or if its value
    is not a single number."""
    value = getattr(owner, field, None)
    return float(np.asarray(value)) if value is not None and np.shape(value) == () else None


def _play(joint: AbstractContactJoint) -> str:
    """Return the joint's clearance, play and backlash with their units, such as "0.5 mm".

    Only attributes that are a single number with a unit are listed; if there are none, the text is
    "yes".
    """
    units = {field.name: field.metadata.get("unit", "") for field in fields(joint)}
    if isinstance(joint, HasJournal):  # its clearance may be a property
        units["clearance"] = "m"
    texts = []
    for name in ("clearance", "play", "backlash"):
        if units.get(name) and (play := _single_number(joint, name)) is not None:
            factor, unit = fitting_unit(np.array(play), str(units[name]))
            texts.append(f"{play * factor:.4g} {unit}")
    return ", ".join(texts) or "yes"


def run_lines(scene: Scene, solution: Solution) -> list[str]:
    """Return the lines of text that describe the scene, the run, its steps, its equations, and its
    redundant constraints if there are any."""
    masses = sum(float(np.asarray(body.mass)) for body in scene.bodies.values())
    gravity = "no gravity"
    if scene.gravity is not None:
        gravity = f"gravity ({', '.join(f'{g:.4g}' for g in np.asarray(scene.gravity))}) m/s²"
    elements = [
        f"{_counted(len(scene.bodies), 'bod', 'y', 'ies')} of {masses:.4g} kg",
        _counted(len(scene.joints), "joint"),
        _counted(len(scene.forces), "force"),
    ]
    formulation = solution.formulation
    equations = [
        *_tolerances(solution),
        type(formulation.coordinates).__name__,
        type(formulation.stabilisation).__name__,
        "with energy ledger" if formulation.ledger else "without energy ledger",
    ]
    steps = f"{int(solution.accepted)} steps accepted of {int(solution.attempts)} tried"
    redundant = ", ".join(solution.redundant_constraints)
    return [
        f"Scene: {', '.join([*elements, gravity])}",
        f"Run: to {float(solution.time):.6g} s; {RESULTS[solution.result]}",
        f"Steps: {steps}; {_impacts(solution.impacts)}",
        f"Equations: {', '.join(equations)}",
        *([f"Redundant constraints: {redundant}"] if redundant else []),
    ]


def _counted(number: int, name: str, one: str = "", many: str = "s") -> str:
    return f"{number} {name}{one if number == 1 else many}"


def _tolerances(solution: Solution) -> list[str]:
    """Return a list with one text: the solver and its tolerances, such as "Tsit5, rtol 1e-06".

    The absolute tolerance is left out if it was not given. If a step-size controller was given, its
    name replaces the tolerances. The list is empty if the solution does not contain its settings.
    """
    notes = {name.removeprefix("setting_"): value for name, value in solution.settings}
    if "solver" not in notes:
        return []
    solver, controller = (str(notes[name]).split("(")[0] for name in ("solver", "controller"))
    if controller != "None":
        return [f"{solver}, {controller}"]
    atol = f", atol {notes['atol']:.0e}" if isinstance(notes["atol"], float) else ""
    return [f"{solver}, rtol {notes['rtol']:.0e}{atol}"]


def _impacts(impacts: Impacts | None) -> str:
    if impacts is None:
        return "impacts not recorded"
    if len(impacts) == 0:
        return "no finished impact"
    factor, unit = fitting_unit(impacts.peak_force, "N")
    largest = f"{factor * impacts.peak_force.max():.4g} {unit}"
    return f"{_counted(len(impacts), 'finished impact')}, the largest of {largest} at one contact"


def impact_rows(impacts: Impacts, most: int) -> list[Cells]:
    """Return the rows of the table of impacts, with the texts of `IMPACT_COLUMNS`.

    The rows are the `most` impacts with the largest peak forces, in descending order. Equal
    simultaneous impacts of several contacts of a joint, such as both ends of a journal in planar
    motion, count as one impact and share a row, which has the numbers of the first of them.
    """
    groups = _equal_impacts(impacts)
    rows = []
    for k in sorted(groups, key=lambda k: -impacts.peak_force[k])[:most]:
        texts = [
            f"{factor * getattr(impacts, name)[k]:{digits}}"
            for _, _, name, factor, digits in IMPACT_NUMBERS
        ]
        rows.append([str(impacts.joint[k]), " and ".join(sorted(groups[k])), *texts])
    return rows


def _equal_impacts(impacts: Impacts) -> dict[int, list[str]]:
    """Group the equal simultaneous impacts of a joint's contacts: their onsets differ by at most a
    thousandth of the duration, and their peak forces by at most a thousandth.

    **Returns:** for each group, the labels of the contacts, by the index of the group's first
    impact in `impacts`.
    """
    groups: dict[int, list[str]] = {}
    # In the order of the onsets, simultaneous impacts follow each other, so that an impact can only
    # belong to one of the latest groups. Eight are examined, since impacts of other joints may lie
    # between. A contact has at most one impact in a group.
    for k in np.lexsort((impacts.contact.astype(str), impacts.onset)):
        same = [
            j
            for j in list(groups)[-8:]
            if impacts.joint[j] == impacts.joint[k]
            and impacts.contact[k] not in groups[j]
            and abs(impacts.onset[j] - impacts.onset[k]) <= 1e-3 * impacts.duration[k]
            and np.isclose(impacts.peak_force[j], impacts.peak_force[k], rtol=1e-3)
        ]
        if same:
            groups[same[0]].append(str(impacts.contact[k]))
        else:
            groups[int(k)] = [str(impacts.contact[k])]
    return groups


TITLE = 26
"""Largest number of characters of a name in the title of a figure."""
LINE = 0.145
"""Height of a line of text, inches."""
PAGE = (8.27, 11.69)
"""Width and height, inches: A4."""
MOST_ROWS = 8
"""Largest number of joints or impacts that a table lists."""
TABLE_EXTRA_LINES = 2.6
"""Height of a table's head and of the gaps around the table, in lines of text."""
MARGIN = 0.4
"""Margin of the page, inches."""


def report(
    scene: Scene,
    solution: Solution,
    file: str | Path | None = None,
    *,
    title: str = "",
    quantity: Quantity | None = None,
    unit: str | None = None,
) -> Figure:
    """Draw a report of a run on one page: descriptions of scene and run, paths of the journals in
    their bearings (orbits), contact forces, phases of free flight, impact and lasting contact,
    energies, the spectrum of one quantity, and the largest impacts.

    In a scene without journals, the paths of the bodies' centres replace the orbits, or the bodies'
    angular velocities over time if the centres hardly move. A scene without contacts has no forces
    and phases, and a solution without recorded impacts has no table of them.

    **Arguments:**

    - `scene`: the simulated scene. `solution`: with saved states, best from a run with
      ``Saving(np.linspace(0, end, count), steps=True, impacts=True)`` and
      ``Settings(ledger=True)``. If the accepted steps are saved (``steps=True``), orbits, forces
      and phases are drawn at the ends of the steps and at further times inside them
      (`Trajectory.between`), which resolves impacts; if not, at the saved times only.
    - `file`: path of the page, with the suffix ".png" or ".pdf"; not written by default.
    - `title`: by default "Run of" and the names of the bodies.
    - `quantity`, `unit`: quantity whose spectrum is drawn, and its SI unit if it does not declare
      one, see `plot.series`. By default it is the velocity component of the last body's centre that
      changes most, or a component of this body's angular velocity if its centre has a constant
      velocity.

    **Returns:** the figure, of size A4.

    **Raises:** `ValueError` for another suffix, for results that are not a `Solution`, for a
    solution without states, for a quantity without a unit, and for a quantity of an element that
    the scene lacks.

    >>> save = cj.Saving(np.linspace(0, 0.5, 101))
    >>> solution = cj.simulate(scene, state, 0.5, save=save, progress=False)
    >>> figure = plot.report(scene, solution, "ball.pdf", title="Ball on a spring")
    """
    if file is not None:
        suffix, remedy = Path(file).suffix.lower(), "name a PNG or a PDF"
        is_known, expected = suffix in (".png", ".pdf"), "with the suffix .png or .pdf"
        require(is_known, "file", str(file), expected, remedy)
    remedy = "draw other results by the other functions of plot"
    require_type("solution", solution, Solution, "a Solution of simulate()", remedy)
    parts = _parts(scene, solution, _record(scene, solution, quantity, unit))
    # Tables have the heights that they need, the title 0.4 inches; figures share the rest.
    width, height = (length - 2.0 * MARGIN for length in PAGE)
    tables = sum(part.height for part in parts if part.is_table)
    figures = sum(part.height for part in parts if not part.is_table)
    stretch = (height - 0.4 - tables) / figures
    heights = [part.height * (1.0 if part.is_table else stretch) for part in parts]
    # A page has small texts and thin lines; other figures keep matplotlib's settings.
    with rc_context():
        rc("font", size=7.0)
        rc("axes", titlesize=7.5, labelsize=7.0, linewidth=0.6)
        rc("hatch", linewidth=0.5)
        figure = Figure(figsize=PAGE, layout="constrained")
        # The page is the part of the figure inside the margins.
        grid = figure.subfigures(3, 1, height_ratios=(MARGIN, height, MARGIN), squeeze=False)
        middle: SubFigure = grid[1, 0]
        page = middle.subfigures(1, 3, width_ratios=(MARGIN, width, MARGIN), squeeze=False)[0, 1]
        names = ", ".join(shown(name) for name in scene.bodies)
        # At this size of the font, about 70 letters fit into the width of the page.
        page.suptitle(fill(literal(title) or f"Run of {names}", 70), fontsize=12)
        rows = page.subfigures(len(parts), 1, height_ratios=heights, squeeze=False)[:, 0]
        for row, part in zip(rows, parts, strict=True):
            part.draw(row)
        if file is not None:
            figure.savefig(file, dpi=200)  # for a PNG, and for rasterised curves in a PDF
    return figure


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


def _parts(scene: Scene, solution: Solution, record: xr.DataArray) -> list[_Part]:
    """Return the rows of the page from top to bottom, without those that would be empty.

    Forces need joints with contacts, and the table of impacts needs recorded impacts.

    **Arguments:** `record`: values (N,) over "time", s, of the quantity whose spectrum is drawn.

    **Raises:** `ValueError` for a solution without states.
    """
    if solution.steps is not None and len(solution.steps) > 1:
        path = solution.steps.between()
        along = observe(scene, solution, path)
        # The integrals of the energy ledger are only known at the ends of steps.
        ends = np.isin(along.times, np.asarray(solution.steps.times))
        at_ends = jax.tree.map(lambda rows: np.asarray(rows)[ends], along)
    else:
        path = trajectory_of(solution, solution.saved or solution.steps)
        along = at_ends = observe(scene, solution, path)
    lines, joints = run_lines(scene, solution), joint_rows(scene, MOST_ROWS)
    height = LINE * (len(lines) + len(joints) + TABLE_EXTRA_LINES)
    # The functions draw later, when the heights of all rows are known.
    parts = [_Part(height, lambda row: draw_description(row, lines, joints), is_table=True)]
    parts += [_Part(2.6, lambda row: draw_motion(row, scene, path, along))]
    if along.contacts:  # the phases of the motion below the forces have a row for each joint
        height = 2.4 + 0.2 * len(along.contacts)
        parts += [_Part(height, lambda row: draw_over_time(row, along))]
    parts += [_Part(2.5, lambda row: draw_energies(row, at_ends, record))]
    if solution.impacts:
        impacts = impact_rows(solution.impacts, MOST_ROWS)
        height = LINE * (len(impacts) + TABLE_EXTRA_LINES)
        parts += [_Part(height, lambda row: draw_impacts(row, impacts), is_table=True)]
    return parts


def _record(
    scene: Scene, solution: Solution, quantity: Quantity | None, unit: str | None
) -> xr.DataArray:
    """Return the values over time of the quantity whose spectrum the page shows.

    They are taken at the saved states, or at the ends of the steps if no states are saved.

    **Arguments:** `quantity`: ``None`` for the component of the last body's velocity that changes
    most, or of its angular velocity (spin) if its centre has a constant velocity. `unit`: SI unit
    of a given quantity that declares none.

    **Returns:** array (N,) with the coordinate "time", s.

    **Raises:** `ValueError` for a solution without states, for a quantity without a unit, and for a
    quantity of an element that the scene lacks.
    """
    trajectory = trajectory_of(solution, solution.saved or solution.steps)
    if quantity is not None:
        return series(scene, solution, quantity, unit=unit, trajectory=trajectory)
    # The scene has its author's order; JAX has sorted the names of the states.
    body = list(scene.bodies)[-1]
    state = trajectory.states.bodies[body]
    vectors, name, unit = np.asarray(state.velocity), f"velocity of {body}", "m/s"
    if not np.ptp(vectors, axis=0).max() > 0.0:  # constant, or NaN after a failed run
        vectors, name, unit = np.asarray(state.spin), f"spin of {body} about its", "rad/s"
    axis = int(np.argmax(np.ptp(vectors, axis=0)))
    return labelled(trajectory, vectors[:, axis], f"{name} {'xyz'[axis]}", unit)


def draw_description(row: SubFigure, lines: list[str], joints: list[Cells]) -> None:
    """Write the `lines` that describe scene and run, and below them a table with the rows
    `joints`, whose columns are `JOINT_COLUMNS`."""
    axes = row.add_subplot()
    for line, text in enumerate(lines):
        _write(axes, 0.0, line, shown(text, 125))  # as many letters as fit into the page's width
    _table(axes, JOINT_COLUMNS, joints, len(lines) + 0.5)


def draw_impacts(row: SubFigure, impacts: list[Cells]) -> None:
    """Write a table with the rows `impacts`, whose columns are `IMPACT_COLUMNS`."""
    axes = row.add_subplot()
    _write(axes, 0.0, 0.0, "Impacts of largest force", "bold")
    _table(axes, IMPACT_COLUMNS, impacts, 1.2)


def _table(axes: Axes, columns: Mapping[str, float], rows: list[Cells], first: float) -> None:
    """Write a table with a rule below the head.

    **Arguments:** `columns`: left ends of the columns, as fractions of the width, by their titles;
    `first`: line of the head, counted from the top of the axes.
    """
    axes.set_axis_off()
    # Number of letters for which each column has space; longer texts are shortened. The page is
    # 7.4 inches wide, and a letter of bold text a little less than 0.066.
    lengths = [int(7.4 * width / 0.066) for width in np.diff([*columns.values(), 1.0])]
    for title, position in columns.items():
        _write(axes, position, first, title, weight="bold")
    for line, row in enumerate(rows):
        for position, length, cell in zip(columns.values(), lengths, row, strict=False):
            _write(axes, position, first + 1.3 + line, shown(cell, length))
    # The rule is 1.1 lines below the top of the head, just above the first row at 1.3 lines.
    shift = ScaledTranslation(0.0, -LINE * (first + 1.1), axes.figure.dpi_scale_trans)
    transform = axes.transAxes + shift
    axes.plot([0, 1], [1, 1], color=GREY, linewidth=0.6, transform=transform, clip_on=False)


def _write(axes: Axes, position: float, line: float, text: str, weight: str = "normal") -> None:
    """Write a text whose left end is at the fraction `position` of the width, `line` lines below
    the top."""
    axes.annotate(
        text,
        (position, 1.0),
        (0.0, -72.0 * LINE * line),  # an inch has 72 points
        xycoords="axes fraction",
        textcoords="offset points",
        va="top",
        weight=weight,
        annotation_clip=False,
    )


def draw_motion(row: SubFigure, scene: Scene, path: Trajectory, observed: Observation) -> None:
    """Draw the orbits of the two journals with the largest forces, and the contact directions of
    the journal with the largest force; for a scene without journals, the paths of the bodies.

    An orbit is the path of a journal in the cross-section of its bearing.

    **Arguments:** `path`: states along the run; `observed`: observation of the same states.
    """
    journals = [name for name, joint in scene.joints.items() if isinstance(joint, HasJournal)]
    if not journals:
        _bodies(row.add_subplot(), path)
        return
    peaks = {
        name: max(np.max(contact.normal_force) for contact in observed.contacts[name].values())
        for name in journals
    }
    hardest = sorted(journals, key=lambda name: -peaks[name])[:2]
    grid = row.add_gridspec(1, len(hardest) + 1)
    for k, name in enumerate(hardest):
        axes = journal_orbit(observed, name, axes=row.add_subplot(grid[k]))
        axes.set_title(f"{shown(name, TITLE)}: orbit")
        _small(axes)
    axes = contact_rose(observed, hardest[0], axes=row.add_subplot(grid[-1], projection="polar"))
    axes.set_title(f"{shown(hardest[0], TITLE)}: directions")
    # One legend below replaces those of the panels, whose entries are the same for all orbits.
    orbits, bars = (panel.get_legend_handles_labels() for panel in (row.axes[0], axes))
    names = [*map(str, orbits[1]), *(f"{label}, direction" for label in bars[1])]
    # The panels' legends are hidden, not removed: they keep their space in the layout, so that all
    # panels have the same size.
    for legend in filter(None, (axes.get_legend() for axes in row.axes)):
        legend.set_visible(False)
    row.legend([*orbits[0], *bars[0]], names, loc="outside lower center", ncols=5, frameon=False)


def _bodies(axes: Axes, trajectory: Trajectory) -> None:
    """Draw the paths of the bodies' centres of mass, projected on a coordinate plane.

    Its two axes are those of X, Y and Z along which the set of all paths extends farthest. If no
    coordinate of any centre varies by more than a fiftieth of the largest extent of this set, the
    bodies do little more than turn: draw the magnitudes of their angular velocities over time
    instead.
    """
    bodies = trajectory.states.bodies
    paths = {name: np.asarray(body.position) for name, body in bodies.items()}
    spread = np.ptp(np.concatenate(list(paths.values())), axis=0)
    motion = max(np.ptp(path, axis=0).max() for path in paths.values())
    if motion > 0.02 * spread.max():
        # The two coordinates with the largest extents, in the order x, y, z.
        right, up = sorted(np.argsort(-spread, kind="stable")[:2])
        curves = {name: (path[:, right], path[:, up]) for name, path in paths.items()}
        labels = f"{'XYZ'[right]} of the centres, m", f"{'XYZ'[up]}, m"
        axes.set_aspect("equal")
    else:
        factor, unit = time_unit(np.asarray(trajectory.times))
        times = factor * np.asarray(trajectory.times)
        curves = {name: (times, np.linalg.norm(b.spin, axis=1)) for name, b in bodies.items()}
        labels = f"time, {unit}", "spin of the bodies, rad/s"
        axes.margins(x=0.0)
    draw_lines(axes, ((shown(name), x, y) for name, (x, y) in curves.items()))
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), handlelength=3.0, frameon=False)
    dress(axes, *labels)
    _small(axes)


def draw_over_time(row: SubFigure, observed: Observation) -> None:
    """Draw the normal forces over time, and below them when each joint is in free flight, in impact
    or in lasting contact."""
    # Relative heights: the lower axes have a row for each joint.
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
    """Draw the energies and the error of their balance on the left, and on the right the amplitude
    spectrum of `record` (N,) over "time", s.

    A note replaces the spectrum if there are fewer than four times, or if they are not at equal
    intervals. `observed` is the observation at saved states or at ends of steps, where the energies
    are known.
    """
    panels = row.subplot_mosaic([["stored", "lines"], ["drift", "lines"]], height_ratios=(2.0, 1.0))
    panels["stored"].sharex(panels["drift"])
    energy_ledger(observed, axes=np.array([panels["stored"], panels["drift"]]))
    panels["stored"].tick_params(labelbottom=False)
    axes = panels["lines"]
    if suits_spectrum(np.diff(record["time"].values)):
        spectrum_of(record, axes=axes)
    else:
        axes.set_axis_off()
        text = "no spectrum: states are not saved\nat equal intervals of time"
        axes.text(0.5, 0.5, text, ha="center", va="center", transform=axes.transAxes)
    for axes in panels.values():
        _small(axes)


def _small(axes: Axes) -> None:
    """Make the lines of axes thinner, for the small figures of the page, and rasterise those of
    more than 5000 points so that a PDF file stays small."""
    for line in axes.get_lines():
        line.set_linewidth(0.6 * line.get_linewidth())
        line.set_rasterized(len(np.asarray(line.get_xdata())) > 5000)
