"""The equations of motion (eqs 27-32) of a scene, in scalar form.

Everything that a scene lacks is absent from the compiled program: no constraint, no multiplier; no
friction, no slip; no ledger, no power. That is decided here, in Python, while tracing.
"""

from dataclasses import dataclass
from functools import cached_property

from ..math.linear_solvers import inner
from ..math.vectors import Scalar, add
from ..model.bodies import GROUND, NO_WRENCH, Wrench
from ..model.joints.base import ByLabel, Motions, Row
from ..model.scene import Scene
from .contact_forces import LoadedContact, contact_wrenches
from .coordinates import (
    AbstractCoordinates,
    AbstractMechanics,
    BodyAcceleration,
    MotionVariables,
    Speeds,
    Wrenches,
)
from .formulation import Formulation
from .multipliers import response, row_rate


@dataclass(frozen=True)
class Dynamics:
    """All that the equations of motion say at one instant.

    `rows` and `multipliers` are those of the joints that the coordinates do not eliminate.
    """

    mechanics: AbstractMechanics
    contact_forces: ByLabel[LoadedContact]
    rows: ByLabel[Row]
    rates: Speeds
    multipliers: ByLabel[Scalar]

    @property
    def motions(self) -> Motions:
        """Pose and twist of each body, the ground included."""
        return self.mechanics.motions

    @cached_property
    def accelerations(self) -> dict[str, BodyAcceleration]:
        """Acceleration of each body."""
        return self.mechanics.accelerations(self.rates)

    @cached_property
    def variable_rates(self) -> MotionVariables:
        """Time derivative of the variables."""
        return self.mechanics.variable_rates(self.rates)


def applied_wrenches(
    scene: Scene, motions: Motions, forces: ByLabel[LoadedContact], t: Scalar
) -> Wrenches:
    """Wrenches of forces, films and contacts; gravity, an acceleration, is the mechanics' own."""
    wrenches = dict.fromkeys(scene.bodies, NO_WRENCH)

    def apply(name: str, wrench: Wrench) -> None:
        wrenches[name] = wrenches.get(name, NO_WRENCH) + wrench

    for element in scene.forces.values():
        for name, wrench in element.wrenches(motions, t).items():
            if name != GROUND:
                apply(name, wrench)
    for joint_name, joint in scene.contact_joints().items():
        for name, wrench in joint.film_wrenches(motions).items():
            if name != GROUND:
                apply(name, wrench)
        for force in forces.get(joint_name, {}).values():
            pushes = contact_wrenches(
                joint, force.contact, force.normal_force, force.friction, motions
            )
            for name, wrench in pushes:
                apply(name, wrench)
    return wrenches


def constraint_rows(
    scene: Scene, coordinates: AbstractCoordinates, motions: Motions, t: Scalar
) -> ByLabel[Row]:
    """The constraint equations by joint and label; joints without any are left out, and so are
    those that the coordinates eliminate."""
    eliminated = coordinates.eliminated(scene)
    rows = {
        name: joint.rows(motions, t)
        for name, joint in scene.joints.items()
        if name not in eliminated
    }
    return {name: family for name, family in rows.items() if family}


def flattened(rows: ByLabel[Row]) -> list[Row]:
    """The rows in the order of their multipliers."""
    return [row for family in rows.values() for row in family.values()]


def solved(
    formulation: Formulation,
    mechanics: AbstractMechanics,
    forces: ByLabel[LoadedContact],
    rows: ByLabel[Row],
    rates: Speeds,
) -> Dynamics:
    """The equations of motion solved: `rates` of the speeds without constraints, and what the
    `rows` change of them."""
    multipliers: ByLabel[Scalar] = {}
    if rows:
        change, in_order = _constraint_response(formulation, mechanics, flattened(rows), rates)
        rates = [add(a, b) for a, b in zip(rates, change, strict=True)]
        remaining = iter(in_order)
        multipliers = {
            name: {label: next(remaining) for label in family} for name, family in rows.items()
        }
    return Dynamics(mechanics, forces, rows, rates, multipliers)


def _constraint_response(
    formulation: Formulation, mechanics: AbstractMechanics, rows: list[Row], rates: Speeds
) -> tuple[Speeds, list[Scalar]]:
    """What the constraints change of the rates, and the multipliers."""
    directions = [mechanics.projected(row.jacobian) for row in rows]
    targets = [
        formulation.stabilisation.target(row.value, row_rate(row, mechanics.motions))
        - add(row.bias, mechanics.bias(row))
        - inner(direction, rates)
        for row, direction in zip(rows, directions, strict=True)
    ]
    return response(mechanics, directions, targets, formulation.solver())
