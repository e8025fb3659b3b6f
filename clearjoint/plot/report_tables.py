"""Write the texts and tables of `plot.report`: the scene, the run, and the largest impacts."""

from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from ..model.contact.weighted import whole_law
from ..model.joints.base import AbstractConstraint, AbstractContactJoint
from ..model.scene import Scene
from ..result_codes import RESULTS
from ..simulation.results.impact_table import Impacts
from ..simulation.results.solution import Solution
from .labels import fitting_unit

Cells = Sequence[str]
"""Texts of a row of a table, from left to right."""
PLAYS = ("clearance", "play", "backlash")
"""Names of the fields in which joints store their clearance or play."""
SYMBOLS = {"restitution": "c", "coefficient": "µ", "breakaway": "µ_S", "kinetic": "µ_C"}
"""Symbols of the numbers of a contact or friction law that the table shows, by field name."""
JOINT_COLUMNS = ("joint", "kind", "bodies", "play", "normal law", "friction")
"""Titles of the columns of the table of joints."""
IMPACT_COLUMNS = (
    "joint",
    "contact",
    "onset, ms",
    "duration, µs",
    "entry speed, m/s",
    "exit speed, m/s",
    "peak force, N",
    "penetration, µm",
)
"""Titles of the columns of the table of impacts."""

ALIKE, ALIKE_AT_ONCE = 1e-3, 8
"""Two impacts count as equal if their onsets differ by at most the first number times the duration,
and their peak forces by at most the first number times the force. The second number is that of the
latest groups of equal impacts with which each impact is compared."""


def joint_rows(scene: Scene, most: int) -> list[Cells]:
    """Return the rows of the table of joints, at most `most`, with the texts of `JOINT_COLUMNS`.

    Joints with contacts come first. If there are more joints than rows, the last row tells how many
    are left out, such as "3 more".
    """
    joints = sorted(
        scene.joints.items(), key=lambda item: not isinstance(item[1], AbstractContactJoint)
    )
    rows: list[Cells] = [_joint_row(name, joint) for name, joint in joints]
    return rows if len(rows) <= most else [*rows[: most - 1], (f"{len(rows) - most + 1} more",)]


def _joint_row(name: str, joint: AbstractConstraint | AbstractContactJoint) -> Cells:
    """Return the texts of `JOINT_COLUMNS`; only the first three for a joint without contacts."""
    head = name, type(joint).__name__, " – ".join(joint.body_names())
    if not isinstance(joint, AbstractContactJoint):
        return head
    # Contacts with equal laws share one text: the keys of a dictionary are unique and ordered.
    laws = dict.fromkeys(_law(whole_law(law)) for law in joint.laws().values())
    friction = getattr(joint, "friction", None)
    frictions = [friction] if friction is not None else joint.bristle_laws().values()
    texts = dict.fromkeys(_law(law) for law in frictions)
    return (*head, _play(joint), " / ".join(laws), " / ".join(texts) or "none")


def _law(law: object) -> str:
    """Return the class name of a law, and its restitution or coefficients of friction, such as
    "LankaraniNikravesh, c 0.9"."""
    values = {symbol: getattr(law, field, None) for field, symbol in SYMBOLS.items()}
    numbers = [
        f"{symbol} {float(np.asarray(value)):.3g}"
        for symbol, value in values.items()
        if value is not None and np.shape(value) == ()
    ]
    return ", ".join([type(law).__name__, *numbers])


def _play(joint: AbstractContactJoint) -> str:
    """Return the joint's clearance or play with its unit, such as "0.5 mm"; "yes" if the joint has
    no field of one of these names that is a single number with a unit."""
    units = {field.name: field.metadata.get("unit", "") for field in fields(joint)}
    texts = []
    for name in PLAYS:
        value = getattr(joint, name, None)
        if units.get(name) and value is not None and np.shape(value) == ():
            factor, unit = fitting_unit(np.asarray(value), str(units[name]))
            texts.append(f"{float(np.asarray(value)) * factor:.4g} {unit}")
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
    """Return the solver and its tolerances, or its step-size controller, as one text in a list; an
    empty list if the solution does not contain its settings."""
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
    return f"{_counted(len(impacts), 'finished impact')}, the largest of {largest}"


def impact_rows(impacts: Impacts, most: int) -> list[Cells]:
    """Return the rows of the table of impacts, with the texts of `IMPACT_COLUMNS`.

    The rows are the `most` impacts with the largest peak forces, in descending order. Equal
    simultaneous impacts of several contacts of a joint, such as both ends of a journal in planar
    motion, share a row.
    """
    groups = _alike(impacts)
    order = sorted(groups, key=lambda k: -impacts.peak_force[k])[:most]
    # Factor from the SI unit to that of the column, and format, for each column with a number.
    columns = {
        "onset": (1e3, ".4f"),
        "duration": (1e6, ".1f"),
        "entry_speed": (1.0, ".4g"),
        "exit_speed": (1.0, ".4g"),
        "peak_force": (1.0, ".1f"),
        "largest_penetration": (1e6, ".4g"),
    }
    rows = []
    for k in order:
        numbers = ((getattr(impacts, name)[k], *form) for name, form in columns.items())
        texts = [f"{factor * number:{digits}}" for number, factor, digits in numbers]
        rows.append([str(impacts.joint[k]), " and ".join(sorted(groups[k])), *texts])
    return rows


def _alike(impacts: Impacts) -> dict[int, list[str]]:
    """Group the equal simultaneous impacts of a joint's contacts.

    **Returns:** for each group, the labels of the contacts, by the index of the group's first
    impact in `impacts`.
    """
    groups: dict[int, list[str]] = {}
    # In the order of the onsets, an impact can only belong to one of the latest groups, in which
    # its contact has no other impact.
    for k in np.lexsort((impacts.contact.astype(str), impacts.onset)):
        same = [
            j
            for j in list(groups)[-ALIKE_AT_ONCE:]
            if impacts.joint[j] == impacts.joint[k]
            and impacts.contact[k] not in groups[j]
            and abs(impacts.onset[j] - impacts.onset[k]) <= ALIKE * impacts.duration[k]
            and np.isclose(impacts.peak_force[j], impacts.peak_force[k], rtol=ALIKE)
        ]
        if same:
            groups[same[0]].append(str(impacts.contact[k]))
        else:
            groups[int(k)] = [str(impacts.contact[k])]
    return groups
