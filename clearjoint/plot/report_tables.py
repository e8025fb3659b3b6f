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
IMPACT_COLUMNS = {
    "joint": 0.0,
    "contact": 0.16,
    "onset, ms": 0.26,
    "duration, µs": 0.36,
    "entry speed, m/s": 0.48,
    "exit speed, m/s": 0.615,
    "peak force, N": 0.745,
    "penetration, µm": 0.86,
}
"""Titles of the columns of the tables of joints and impacts, and the columns' left ends as
fractions of the width of the page."""


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
    numbers = [
        f"{symbol} {number:.3g}"
        for field, symbol in SYMBOLS.items()
        if (number := _single(law, field)) is not None
    ]
    return ", ".join([type(law).__name__, *numbers])


def _single(owner: object, field: str) -> float | None:
    """Return the value of a field that is a single number; ``None`` for all others."""
    value = getattr(owner, field, None)
    return float(np.asarray(value)) if value is not None and np.shape(value) == () else None


def _play(joint: AbstractContactJoint) -> str:
    """Return the joint's clearance or play with its unit, such as "0.5 mm"; "yes" if the joint has
    no field of one of these names that is a single number with a unit."""
    units = {field.name: field.metadata.get("unit", "") for field in fields(joint)}
    texts = []
    for name in ("clearance", "play", "backlash"):
        if units.get(name) and (play := _single(joint, name)) is not None:
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
