"""Equations of motion (eqs 27-32) of a scene, in scalar form.

While tracing, Python omits everything that a scene lacks: without constraints the compiled program
has no multipliers, without friction no slip, without a ledger no powers.
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
    """Solution of the equations of motion at one instant.

    - `contact_forces`: by joint and contact label.
    - `rows`, `multipliers`: of the joints that the coordinates do not eliminate.
    - `rates`: of the speeds of the coordinates.
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
    """Return the wrenches of forces, films and contacts on each body.

    Gravity is not among them: the mechanics add it as an acceleration.
    """
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
    """Return the constraint rows by joint and label, without the joints that the coordinates
    eliminate."""
    eliminated = coordinates.eliminated(scene)
    rows = {
        name: joint.rows(motions, t)
        for name, joint in scene.joints.items()
        if name not in eliminated
    }
    return {name: family for name, family in rows.items() if family}


def flattened(rows: ByLabel[Row]) -> list[Row]:
    """Return the rows as a list, in the order of their multipliers."""
    return [row for family in rows.values() for row in family.values()]


def solved(
    formulation: Formulation,
    mechanics: AbstractMechanics,
    forces: ByLabel[LoadedContact],
    rows: ByLabel[Row],
    rates: Speeds,
) -> Dynamics:
    """Solve the equations of motion: add the effect of the constraint `rows` to the `rates` of the
    speeds without constraints."""
    multipliers: ByLabel[Scalar] = {}
    if rows:
        change, in_order = _constraint_response(formulation, mechanics, flattened(rows), rates)
        rates = [add(a, b) for a, b in zip(rates, change, strict=True)]
        values = iter(in_order)
        multipliers = {
            name: {label: next(values) for label in family} for name, family in rows.items()
        }
    return Dynamics(mechanics, forces, rows, rates, multipliers)


def _constraint_response(
    formulation: Formulation, mechanics: AbstractMechanics, rows: list[Row], rates: Speeds
) -> tuple[Speeds, list[Scalar]]:
    """Return the change of the rates by the constraints, and the multipliers."""
    directions = [mechanics.projected(row.jacobian) for row in rows]
    # Second derivative of each row: its target by the stabilisation, minus the part that does not
    # depend on the rates, minus the part of the unconstrained rates.
    targets = [
        formulation.stabilisation.target(row.value, row_rate(row, mechanics.motions))
        - add(row.bias, mechanics.bias(row))
        - inner(direction, rates)
        for row, direction in zip(rows, directions, strict=True)
    ]
    return response(mechanics, directions, targets, formulation.solver())
