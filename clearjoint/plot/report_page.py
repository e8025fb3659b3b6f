"""Report of a run on one page, in rows that are matplotlib `SubFigure` objects."""

from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from textwrap import fill, wrap
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib import rc, rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.transforms import ScaledTranslation

from .._fields.checks import require, require_type
from .._fields.drawn_text import literal, shown
from .._model.clearance_joints.clearance import ClearanceJoint
from .._model.clearance_joints.journal_bases import HasJournal
from .._model.clearance_joints.lubricated import LubricatedJoint
from .._model.contact.laws import whole_law
from .._model.joints.base import AbstractContactJoint
from .._model.scene import Scene
from .._result_codes import RESULTS
from .._simulation.results.impact_table import Impacts
from .._simulation.results.observe import Observation, observe
from .._simulation.results.solution import Solution, Trajectory
from ..quantities.base import Quantity
from .forces import contact_forces, joint_forces, motion_timeline
from .journal import journal_orbit
from .polar import contact_rose
from .style import GREY, draw_lines, dress, fit_labels, fitting_unit, time_unit
from .time_series import energy_ledger, labelled, series, spectrum_of, suits_spectrum, trajectory_of

Cells = Sequence[str]
"""Texts of a row of a table, from left to right."""
SYMBOLS = {"restitution": "c", "coefficient": "µ", "breakaway": "µ_S", "kinetic": "µ_C"}
"""Symbols of the numbers of a contact or friction law that the table shows, by field name."""
JOINT_COLUMNS = "joint", "kind", "bodies", "play", "normal law", "friction"
IMPACT_NUMBERS = (
    ("onset, ms", "onset", 1e3, ".4f"),
    ("duration, µs", "duration", 1e6, ".1f"),
    ("entry speed, m/s", "entry_speed", 1.0, ".4g"),
    ("exit speed, m/s", "exit_speed", 1.0, ".4g"),
    ("peak force, N", "peak_force", 1.0, ".1f"),
    ("penetration, µm", "largest_penetration", 1e6, ".4g"),
)
"""Number columns of the table of impacts: title, name in `Impacts`, factor from SI unit, format."""
IMPACT_COLUMNS = "joint", "contact", *(title for title, *_ in IMPACT_NUMBERS)


def joint_rows(scene: Scene, most: int) -> list[Cells]:
    """Return the texts of `JOINT_COLUMNS` for each joint with contacts; if there are more than
    `most`, the last row names those that are left out."""
    joints = scene.contact_joints()
    rows = [_joint_row(name, joint) for name, joint in joints.items()]
    if len(rows) <= most:
        return rows
    others = ", ".join(map(shown, list(joints)[most - 1 :]))
    return [*rows[: most - 1], (f"and {others}", *[""] * (len(JOINT_COLUMNS) - 1))]


def _joint_row(name: str, joint: AbstractContactJoint) -> Cells:
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
    rubbing = " / ".join(dict.fromkeys(map(_law, frictions))) or "none"
    bodies = " – ".join(map(shown, joint.body_names()))
    return shown(name), type(joint).__name__, bodies, _play(joint), " / ".join(laws), rubbing


def _law(law: object) -> str:
    numbers = [
        f"{symbol} {number:.3g}"
        for field, symbol in SYMBOLS.items()
        if (number := _single_number(law, field)) is not None
    ]
    return ", ".join([type(law).__name__, *numbers])


def _single_number(owner: object, field: str) -> float | None:
    value = getattr(owner, field, None)
    return float(np.asarray(value)) if value is not None and np.shape(value) == () else None


def _play(joint: AbstractContactJoint) -> str:
    units = {field.name: field.metadata.get("unit", "") for field in fields(joint)}
    if isinstance(joint, HasJournal):  # its clearance may be a property
        units["clearance"] = "m"
    texts = []
    for name in ("clearance", "play", "backlash"):
        if units.get(name) and (play := _single_number(joint, name)) is not None:
            factor, unit = fitting_unit(np.array(play), str(units[name]))
            texts.append(f"{play * factor:.4g} {unit}")
    return ", ".join(texts) or "yes"  # a joint with contacts has play, but maybe no single number


def run_lines(scene: Scene, solution: Solution) -> list[str]:
    """Return the lines of text that describe the scene and the run."""
    masses = sum(float(np.asarray(body.mass)) for body in scene.bodies.values())
    gravity = "no gravity"
    if scene.gravity is not None:
        gravity = f"gravity ({', '.join(f'{g:.4g}' for g in np.asarray(scene.gravity))}) m/s²"
    bodies = f"{_counted(len(scene.bodies), 'bod', 'y', 'ies')} of {masses:.4g} kg"
    elements = _counted(len(scene.joints), "joint"), _counted(len(scene.forces), "force")
    formulation = solution.formulation
    parts = formulation.coordinates, formulation.stabilisation
    equations = [*_tolerances(solution), *(type(part).__name__ for part in parts)]
    ledger = "with energy ledger" if formulation.ledger else "without energy ledger"
    # Names of the joints without contacts, by the name of their class.
    ideal: dict[str, list[str]] = {}
    for name, joint in scene.joints.items():
        if not isinstance(joint, AbstractContactJoint):
            ideal.setdefault(type(joint).__name__, []).append(shown(name))
    kinds = [f"{kind} {', '.join(names)}" for kind, names in ideal.items()]
    steps = f"{int(solution.accepted)} steps accepted of {int(solution.attempts)} tried"
    redundant = ", ".join(solution.redundant_constraints)
    return [
        f"Scene: {', '.join([bodies, *elements, gravity])}",
        f"Run: to {float(solution.time):.6g} s; {RESULTS[solution.result]}",
        f"Steps: {steps}; {_impacts(solution.impacts)}",
        f"Equations: {', '.join([*equations, ledger])}",
        *([f"Joints without contacts: {'; '.join(kinds)}"] if kinds else []),
        *([f"Redundant constraints: {redundant}"] if redundant else []),
    ]


def _counted(number: int, name: str, singular: str = "", plural: str = "s") -> str:
    return f"{number} {name}{singular if number == 1 else plural}"


def _tolerances(solution: Solution) -> list[str]:
    notes = {name.removeprefix("setting_"): value for name, value in solution.settings}
    # The solution records no settings, or those of a version in which they had other names.
    if not {"solver", "controller", "rtol", "atol"} <= notes.keys():
        return []
    # The notes are texts such as "Tsit5(scan_kind=None)", of which the name of the class is shown.
    solver, controller = (str(notes[name]).split("(")[0] for name in ("solver", "controller"))
    if controller != "None":  # a controller has its own tolerances: rtol and atol have no effect
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
    """Return the texts of `IMPACT_COLUMNS` for the `most` impacts with the largest peak forces.
    Simultaneous ones of a joint, as at both ends of a journal, share the row of the largest."""
    force = impacts.peak_force
    # Each group of simultaneous impacts, by the index of its impact with the largest force.
    hardest = {max(group, key=lambda k: force[k]): group for group in _simultaneous(impacts)}
    rows = []
    for k in sorted(hardest, key=lambda k: -force[k])[:most]:
        texts = [
            f"{factor * getattr(impacts, name)[k]:{digits}}"
            for _, name, factor, digits in IMPACT_NUMBERS
        ]
        contacts = sorted(str(impacts.contact[j]) for j in hardest[k])
        rows.append([shown(impacts.joint[k]), " and ".join(contacts), *texts])
    return rows


def _simultaneous(impacts: Impacts) -> list[list[int]]:
    """Return the indices of impacts in groups, each of one joint and different contacts. An impact
    overlaps the first of its group for more than half of the shorter duration of the two."""
    groups: list[list[int]] = []
    # In the order of the onsets, simultaneous impacts follow each other, so that an impact can only
    # belong to one of the latest groups. Eight are examined, since impacts of other joints may lie
    # between. A contact has at most one impact in a group.
    for k in np.lexsort((impacts.contact.astype(str), impacts.onset)).tolist():
        for group in groups[-8:]:
            first = group[0]
            end = min(impacts.separation[first], impacts.separation[k])
            shorter = min(impacts.duration[first], impacts.duration[k])
            if (
                impacts.joint[first] == impacts.joint[k]
                and impacts.contact[k] not in impacts.contact[group]
                and end - impacts.onset[k] > 0.5 * shorter
            ):
                group.append(k)
                break
        else:
            groups.append([k])
    return groups


TITLE = 26
"""Largest number of characters of a name in the title of a figure."""
LINE = 0.145
"""Height of a line of text, inches."""
PAGE = (8.27, 11.69)
"""Width and height of A4, inches."""
MOST_ROWS = 8
"""Largest number of impacts that a table lists; twice as many joints with contacts."""
LETTERS = 112
"""Number of letters in a line of the page, 7.4 inches, if bold; a letter has up to 0.066 inches."""
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
    """Draw a report of a run on one A4 page: descriptions of scene and run, paths of the journals
    in their bearings (orbits), contact forces, phases of free flight, impact and lasting contact,
    energies, the spectrum of one quantity, and the largest impacts. Parts that the scene or the
    solution lacks are left out; without journals, the motion of the bodies is drawn.

    **Arguments:**

    - `solution`: with saved states, best from a run with ``Saving(np.linspace(0, end, count),
      steps=True, impacts=True)`` and ``Settings(ledger=True)``. Without the accepted steps, orbits,
      forces and phases are drawn at the saved times only, which may miss impacts.
    - `file`: path of the page, with the suffix ".png" or ".pdf"; not written by default.
    - `title`: by default "Run of" and the names of the bodies.
    - `quantity`: whose spectrum is drawn, with its SI `unit` if it declares none; by default the
      component of the last body's velocity that changes most; of its spin if that is constant.

    **Raises:** `ValueError` for another suffix, and for results that are not a `Solution`.

    >>> figure = plot.report(scene, swing, "ball.pdf", title="Ball on a spring")
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
    tables = sum(part.height for part in parts if part.is_text)
    figures = sum(part.height for part in parts if not part.is_text)
    stretch = (height - 0.4 - tables) / figures
    heights = [part.height * (1.0 if part.is_text else stretch) for part in parts]
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
        # At this size of the font, about 70 letters fit into the width of the page. The names take
        # up to two lines.
        names = shown(f"Run of {', '.join(scene.bodies)}", longest=140)
        page.suptitle(fill(literal(title) or names, width=70), fontsize=12)
        rows = page.subfigures(len(parts), 1, height_ratios=heights, squeeze=False)[:, 0]
        for row, part in zip(rows, parts, strict=True):
            part.draw(row)
        fit_labels(figure)
        if file is not None:
            figure.savefig(file, dpi=200)  # for a PNG, and for rasterised curves in a PDF
    return figure


class _Part(NamedTuple):
    """A row of the page, which `draw` fills. Rows of text have exactly their `height`, inches; rows
    of figures share the rest of the page in proportion to their `height`."""

    height: float
    draw: Callable[[SubFigure], None]
    is_text: bool = False


def _parts(scene: Scene, solution: Solution, record: xr.DataArray) -> list[_Part]:
    # `record`: values over time of the quantity whose spectrum is drawn.
    # The motion to draw: states at and between the ends of the steps, or else the saved states.
    if solution.steps is not None and len(solution.steps) > 1:
        path = solution.steps.between()
    else:
        path = trajectory_of(solution, solution.saved or solution.steps)
    observed = observe(scene, solution, path)
    # `LETTERS` are bold. Light letters are narrower: 13 more of them fit into a line.
    lines = [line for text in run_lines(scene, solution) for line in wrap(text, LETTERS + 13)]
    # Numbers are heights, inches, which `report` stretches. The functions draw later, when the
    # heights of all rows are known.
    parts = [_text_part(lines, "normal", JOINT_COLUMNS, joint_rows(scene, 2 * MOST_ROWS))]
    parts += [_Part(2.6, lambda row: draw_motion(row, scene, path, observed))]
    if observed.contacts:  # the phases of the motion below the forces have a row for each joint
        height = 2.4 + 0.2 * len(observed.contacts)
        parts += [_Part(height, lambda row: draw_over_time(row, observed))]
    parts += [_Part(2.5, lambda row: draw_energies(row, observed, record))]
    if solution.impacts:
        rows = impact_rows(solution.impacts, MOST_ROWS)
        parts += [_text_part(["Impacts of largest force"], "bold", IMPACT_COLUMNS, rows)]
    return parts


def _record(
    scene: Scene, solution: Solution, quantity: Quantity | None, unit: str | None
) -> xr.DataArray:
    # The quantity whose spectrum is drawn, by default the velocity or spin that changes most.
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


def _text_part(lines: Sequence[str], weight: str, titles: Cells, rows: Sequence[Cells]) -> _Part:
    """Return a row of the page with lines of text of the font weight `weight` and, if there are
    `rows`, a table with the column titles `titles`. If the page is too narrow for the table, its
    widest columns are made narrower, and their texts are broken into lines."""
    # Left end, as a fraction of the width; lines from the top; text; and weight of the letters.
    texts = [(0.0, float(k), text, weight) for k, text in enumerate(lines)]
    # The head of the table is 0.4 lines below the text, and its first row 1.3 lines below the head.
    # `line` is the distance from the top at which the next row begins, in heights of a line.
    head = line = len(lines) + 0.4
    if rows:
        # Widths of the columns in letters, with two letters between columns.
        needed = np.array([max(map(len, column)) + 2 for column in zip(titles, *rows, strict=True)])
        widest = needed.max()
        while np.minimum(needed, widest).sum() > LETTERS:
            widest -= 1
        widths = np.minimum(needed, widest)
        # Left ends. A table narrower than 80 % of the page is not stretched over its whole width.
        lefts = np.cumsum([0, *widths[:-1]]) * (1.0 / max(widths.sum(), 0.8 * LETTERS))
        texts += [(x, head, title, "bold") for x, title in zip(lefts, titles, strict=True)]
        line += 1.3
        for row in rows:
            broken = [wrap(cell, width - 2) for cell, width in zip(row, widths, strict=True)]
            for x, cell in zip(lefts, broken, strict=True):
                texts += [(x, line + k, text, "normal") for k, text in enumerate(cell)]
            line += max(map(len, broken))

    def draw(row: SubFigure) -> None:
        # Writes the texts into a row of the page, whose size in inches is known only then.
        axes = row.add_subplot()
        axes.set_axis_off()
        for x, down, text, weight in texts:
            axes.annotate(
                text,
                (x, 1.0),
                (0.0, -72.0 * LINE * down),  # an inch has 72 points
                xycoords="axes fraction",
                textcoords="offset points",
                va="top",
                weight=weight,
                annotation_clip=False,
            )
        if rows:  # a rule below the head, just above the first row
            shift = ScaledTranslation(0.0, -LINE * (head + 1.1), row.dpi_scale_trans)
            look = {"color": GREY, "linewidth": 0.6, "clip_on": False}
            axes.plot([0, 1], [1, 1], transform=axes.transAxes + shift, **look)

    # A gap of about a line is below the text or the table.
    return _Part(LINE * (line + (0.9 if rows else 0.6)), draw, is_text=True)


def draw_motion(row: SubFigure, scene: Scene, path: Trajectory, observed: Observation) -> None:
    """Draw the orbits of the two journals with the largest forces, and the contact directions of
    the first; without journals, the paths of the bodies. `observed`: observation along `path`."""
    journals = [name for name, joint in scene.joints.items() if isinstance(joint, HasJournal)]
    if not journals:
        _bodies(row.add_subplot(), path)
        return
    peaks = {
        n: max(np.max(c.normal_force) for c in observed.contacts[n].values()) for n in journals
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
    """Draw the paths of the bodies' centres on the coordinate plane in which they extend farthest;
    of bodies that do little more than turn, the angular velocities over time."""
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
    """Draw the normal forces over time, and below them the `ContactPhase`s of each joint."""
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
    """Draw the energies and the error of their balance, and beside them the amplitude spectrum of
    `record` (N,) over "time", s, or a note if its times don't suit a spectrum."""
    panels = row.subplot_mosaic([["stored", "lines"], ["drift", "lines"]], height_ratios=(2.0, 1.0))
    panels["stored"].sharex(panels["drift"])
    energy_ledger(observed, axes=np.array([panels["stored"], panels["drift"]]))
    panels["stored"].tick_params(labelbottom=False)  # the times are below the lower axes
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
    """Make curves thinner; rasterise curves of more than 5000 points, which keeps a PDF small."""
    for line in axes.get_lines():
        line.set_linewidth(0.6 * line.get_linewidth())
        line.set_rasterized(len(np.asarray(line.get_xdata())) > 5000)
