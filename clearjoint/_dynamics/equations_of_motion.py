"""Equations of motion of a scene whose vectors are separate scalars (eqs 27-32 of P. Flores et al.,
Spatial revolute joints with clearances for dynamic analysis of multi-body systems, 2006).

All that a scene lacks is left out while JAX traces, such as multipliers without constraints.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

from .._fields.checks import require
from .._math.vectors import Scalar
from .._model.bodies import GROUND, NO_WRENCH, Wrench
from .._model.joints.base import (
    AbstractConstraint,
    AbstractContactJoint,
    AbstractForce,
    ByLabel,
    Motions,
    Row,
)
from .._model.scene import Scene
from .contact_forces import LoadedContact, LoadedContacts, contact_wrenches
from .coordinates import (
    AbstractCoordinates,
    AbstractMechanics,
    BodyAcceleration,
    MotionVariables,
    Speeds,
    Wrenches,
)
from .kinds import Kinds


@dataclass(frozen=True)
class Dynamics:
    """Solution of the equations of motion at one instant.

    - `mechanics`: kinematics and mass matrix in the chosen coordinates.
    - `contact_forces`: forces of each contact, with which the equations were solved.
    - `rows`: constraint rows of the joints that the coordinates do not eliminate.
    - `rates`: accelerations in the form that the methods of `mechanics` return and accept. In joint
      coordinates these are not the time derivatives of the speeds but linear combinations of them
      (see `.joint_coordinates.coordinates`); `variable_rates` has the time derivatives.
    - `multipliers`: Lagrange multipliers of `rows`; a row's Jacobian times its multiplier is the
      reaction on the bodies (N or N m).
    """

    mechanics: AbstractMechanics
    contact_forces: LoadedContacts
    rows: ByLabel[Row]
    rates: Speeds
    multipliers: ByLabel[Scalar]

    @property
    def motions(self) -> Motions:
        """Pose and velocities of each body and of "ground"."""
        return self.mechanics.motions

    @cached_property
    def accelerations(self) -> dict[str, BodyAcceleration]:
        return self.mechanics.accelerations(self.rates)

    @cached_property
    def variable_rates(self) -> MotionVariables:
        return self.mechanics.variable_rates(self.rates)


def applied_wrenches(scene: Scene, motions: Motions, forces: LoadedContacts, t: Scalar) -> Wrenches:
    """Return the wrench of force elements, films and contacts on each body; coordinates add gravity
    as an acceleration. A joint without an entry in `forces` has no contact forces."""
    wrenches = dict.fromkeys(scene.bodies, NO_WRENCH)

    def apply(by_body: Iterable[tuple[str, Wrench]]) -> None:
        for name, wrench in by_body:
            if name != GROUND:
                expected, remedy = f"on bodies {[*wrenches]}", "return those of `body_names`"
                require(name in wrenches, "wrenches", name, expected, remedy)
                wrenches[name] = wrenches[name] + wrench

    kinds = Kinds(scene)
    for element in scene.forces.values():
        # If a class has many elements, JAX traces the function once for all those of one kind.
        apply(kinds.evaluate(_wrenches_of_element, element, motions, t))
    for name, joint in scene.contact_joints().items():
        of_joint = list(forces.get(name, {}).values())
        apply(kinds.evaluate(_wrenches_of_joint, joint, motions, of_joint))
    return wrenches


def _wrenches_of_element(
    element: AbstractForce, motions: Motions, t: Scalar
) -> list[tuple[str, Wrench]]:
    return list(element.wrenches(motions, t).items())


def _wrenches_of_joint(
    joint: AbstractContactJoint, motions: Motions, forces: list[LoadedContact]
) -> list[tuple[str, Wrench]]:
    wrenches = list(joint.film_wrenches(motions).items())
    for force in forces:
        wrenches += contact_wrenches(joint, force, motions)
    return wrenches


def constraint_rows(
    scene: Scene, coordinates: AbstractCoordinates, motions: Motions, t: Scalar
) -> ByLabel[Row]:
    """Return the constraint rows of joints that the coordinates do not eliminate."""
    eliminated = coordinates.eliminated(scene)
    # The Jacobians become dictionaries again, by name of body.
    kinds, rows = Kinds(scene), {}
    for name, joint in scene.joints.items():
        if name not in eliminated:
            family = kinds.evaluate(_rows_of_joint, joint, motions, t)
            rows[name] = {label: replace(row, jacobian=dict(pairs)) for label, row, pairs in family}
    return {name: family for name, family in rows.items() if family}


def _rows_of_joint(
    joint: AbstractConstraint | AbstractContactJoint, motions: Motions, t: Scalar
) -> list[tuple[str, Row, list[tuple[str, Wrench]]]]:
    """Return label, row without Jacobian, and Jacobian of each constraint row of a joint. Each
    Jacobian is a list of pairs, since JAX would sort a dictionary (see `Kinds.evaluate`)."""
    rows = joint.rows(motions, t).items()
    return [(label, replace(row, jacobian={}), list(row.jacobian.items())) for label, row in rows]


def flattened(rows: ByLabel[Row]) -> list[Row]:
    """Return all rows in one list, in the order of the dictionaries: by joint, then by label."""
    return [row for family in rows.values() for row in family.values()]


def constraint_wrenches(dynamics: Dynamics, joint: str) -> dict[str, Wrench]:
    """Return the wrench of a joint's constraints on each of its bodies, by name: the sum of the
    Jacobians of the joint's rows times the Lagrange multipliers of the rows."""
    wrenches: dict[str, Wrench] = {}
    for label, row in dynamics.rows[joint].items():
        multiplier = dynamics.multipliers[joint][label]
        # A Jacobian is the wrench on each body for a multiplier of 1.
        for body, unit_wrench in row.jacobian.items():
            wrenches[body] = wrenches.get(body, NO_WRENCH) + unit_wrench * multiplier
    return wrenches
