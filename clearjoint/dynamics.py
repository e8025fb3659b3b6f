"""The equations of motion (eqs 27-32) of a scene, in scalar form.

Everything that a scene lacks is absent from the compiled program: no constraint, no multiplier; no
friction, no slip; no ledger, no power. That is decided here, in Python, while tracing.
"""

import abc
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from .bodies import GROUND, NO_WRENCH
from .contact import AbstractContactLaw, Gap
from .coordinates import (
    AbstractCoordinates,
    AbstractMechanics,
    Acceleration,
    Motions,
    Speeds,
    Wrenches,
    response,
    row_rate,
)
from .fields import quantity, require_positive
from .joint_coordinates import JointCoordinates
from .joints.base import Contact, Row
from .linear import AbstractSolver, Exact, LeastNorm, inner
from .readable import AbstractReadable
from .scene import Scene
from .several import total
from .vectors import Scalar, Vector, add, is_zero

Memory = dict[str, dict[str, Scalar]]
Closed = dict[str, dict[str, Scalar]]
"""Whether each contact is closed, by joint and contact."""


class AbstractStabilisation(AbstractReadable):
    """What keeps the constraints satisfied in spite of integration error."""

    @abc.abstractmethod
    def target(self, value: Scalar, rate: Scalar) -> Scalar:
        """The second derivative that a constraint of given value and rate shall have."""


class Unstabilised(AbstractStabilisation):
    """No stabilisation: the constraints drift with the integration error."""

    def target(self, value: Scalar, rate: Scalar) -> Scalar:
        """Zero."""
        del value, rate
        return 0.0


class Baumgarte(AbstractStabilisation):
    """Feedback -2 alpha rate - beta^2 value (eq. 32; J. Baumgarte 1972).

    The paper prints the first term without its dot. `alpha` and `beta` in 1/s; 5 is usual.
    """

    alpha: Any = quantity("1/s", default=5.0)
    beta: Any = quantity("1/s", default=5.0)

    def __check_init__(self):
        require_positive("alpha", self.alpha, "give a rate in 1/s", zero=True)
        require_positive("beta", self.beta, "give a rate in 1/s", zero=True)

    def target(self, value: Scalar, rate: Scalar) -> Scalar:
        """-2 alpha rate - beta^2 value."""
        return -2.0 * self.alpha * rate - self.beta**2 * value


class Projection(AbstractStabilisation):
    """Positions and velocities at the end of each step are projected onto the constraints."""

    def target(self, value: Scalar, rate: Scalar) -> Scalar:
        """Zero."""
        del value, rate
        return 0.0


class Formulation(eqx.Module):
    """How the equations of motion are set up; the choices that are not the scene's.

    - `redundant`: whether constraints depend on each other, so that multipliers of least norm are
      sought. `clearjoint.structure` finds out.
    - `ledger`: whether the dissipated energies are integrated with the state.
    """

    coordinates: AbstractCoordinates = eqx.field(default_factory=JointCoordinates)
    stabilisation: AbstractStabilisation = eqx.field(default_factory=Baumgarte)
    redundant: bool = eqx.field(default=False, static=True)
    ledger: bool = eqx.field(default=False, static=True)

    def solver(self) -> AbstractSolver:
        """The solver for the multipliers."""
        return LeastNorm() if self.redundant else Exact()


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class ContactForce:
    """A contact with the forces that it transmits: normal force N, friction vector or ``None``."""

    contact: Contact
    normal_force: Scalar
    elastic_force: Scalar
    friction: Vector | None


@dataclass(frozen=True)
class Dynamics:
    """All that the equations of motion say at one instant.

    `rows` and `multipliers` are those of the joints that the coordinates do not eliminate.
    """

    mechanics: AbstractMechanics
    contact_forces: dict[str, dict[str, ContactForce]]
    rows: dict[str, dict[str, Row]]
    rates: Speeds
    multipliers: dict[str, dict[str, Scalar]]

    @property
    def motions(self) -> Motions:
        """Pose and twist of each body, the ground included."""
        return self.mechanics.motions

    @cached_property
    def accelerations(self) -> dict[str, Acceleration]:
        """Acceleration of each body."""
        return self.mechanics.accelerations(self.rates)

    @cached_property
    def variable_rates(self) -> Any:
        """Time derivative of the variables."""
        return self.mechanics.variable_rates(self.rates)


def contact_normal_force(law: AbstractContactLaw, gap: Gap, entry_speed: Scalar | None) -> Scalar:
    """Normal force of a contact, N. Without an entry speed on record (memory zero) the present rate
    stands for it, which it is at the onset."""
    if law.has_memory:
        assert entry_speed is not None
        entry_speed = jnp.where(entry_speed > 0.0, entry_speed, gap.rate)
    return law.force(gap, entry_speed)


def contact_forces(
    scene: Scene, motions: Motions, memory: Memory, closed: Closed | None = None
) -> dict[str, dict[str, ContactForce]]:
    """Forces of all contacts, by joint and contact; only `closed` ones push, if these are given."""
    forces: dict[str, dict[str, ContactForce]] = {}
    for name, joint in scene.contact_joints().items():
        laws, contacts = joint.laws(), joint.contacts(motions)
        forces[name] = {}
        for label, contact in contacts.items():
            entry_speed = memory[name][label] if laws[label].has_memory else None
            normal = contact_normal_force(laws[label], contact.gap, entry_speed)
            if closed is not None:
                normal = jnp.where(closed[name][label], normal, 0.0)
            friction = joint.friction_force(label, contact, normal)
            elastic = laws[label].elastic_force(contact.gap)
            if closed is not None:
                elastic = jnp.where(closed[name][label], elastic, 0.0)
            forces[name][label] = ContactForce(contact, normal, elastic, friction)
    return forces


def _applied_wrenches(
    scene: Scene, motions: Motions, forces: dict[str, dict[str, ContactForce]], t: Scalar
) -> Wrenches:
    """Wrenches of forces and contacts; gravity is an acceleration, and the mechanics' own."""
    wrenches = dict.fromkeys(scene.bodies, NO_WRENCH)

    def apply(name: str, wrench: Any) -> None:
        wrenches[name] = wrenches.get(name, NO_WRENCH) + wrench

    for element in scene.forces.values():
        for name, wrench in element.wrenches(motions, t).items():
            if name != GROUND:
                apply(name, wrench)
    for joint_name, joint in scene.contact_joints().items():
        first, second = joint.pair()
        for force in forces.get(joint_name, {}).values():
            push = -(force.contact.normal * force.normal_force)
            if force.friction is not None:
                push = push + force.friction
            on_first, on_second = force.contact.points_of_force(force.friction is not None)
            if second != GROUND:
                apply(second, motions[second].wrench(push, on_second))
            if first != GROUND:
                apply(first, motions[first].wrench(-push, on_first))
    return wrenches


def constraint_rows(
    scene: Scene, coordinates: AbstractCoordinates, motions: Motions, t: Scalar
) -> dict[str, dict[str, Row]]:
    """The constraint equations by joint and label; joints without any are left out, and so are
    those that the coordinates eliminate."""
    eliminated = coordinates.eliminated(scene)
    rows = {
        name: joint.rows(motions, t)
        for name, joint in scene.joints.items()
        if name not in eliminated
    }
    return {name: family for name, family in rows.items() if family}


def flattened(rows: dict[str, dict[str, Row]]) -> list[Row]:
    """The rows in the order of their multipliers."""
    return [row for family in rows.values() for row in family.values()]


def evaluate(
    scene: Scene,
    formulation: Formulation,
    variables: Any,
    memory: Memory,
    t: Scalar,
    closed: Closed | None = None,
) -> Dynamics:
    """Solve the equations of motion at one instant. Only `closed` contacts push, if they are given;
    otherwise those that penetrate."""
    mechanics = formulation.coordinates.mechanics(scene, variables)
    forces = contact_forces(scene, mechanics.motions, memory, closed)
    return _solved(scene, formulation, mechanics, forces, t)


def evaluate_smooth(scene: Scene, formulation: Formulation, variables: Any, t: Scalar) -> Dynamics:
    """Solve the equations of motion at one instant as if no contact were closed."""
    mechanics = formulation.coordinates.mechanics(scene, variables)
    return _solved(scene, formulation, mechanics, {}, t)


def _solved(
    scene: Scene,
    formulation: Formulation,
    mechanics: AbstractMechanics,
    forces: dict[str, dict[str, ContactForce]],
    t: Scalar,
) -> Dynamics:
    """The equations of motion under the given contact forces."""
    rates = mechanics.free_rates(_applied_wrenches(scene, mechanics.motions, forces, t))
    rows = constraint_rows(scene, formulation.coordinates, mechanics.motions, t)
    multipliers: dict[str, dict[str, Scalar]] = {}
    if rows:
        change, solved = _constraint_response(formulation, mechanics, flattened(rows), rates)
        rates = [add(a, b) for a, b in zip(rates, change, strict=True)]
        remaining = iter(solved)
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


def state_rates(
    scene: Scene,
    formulation: Formulation,
    variables: Any,
    memory: Memory,
    t: Scalar,
    closed: Closed | None = None,
) -> tuple[Any, dict[str, Scalar]]:
    """Time derivatives of the variables and of the ledger's integrals; see `evaluate`."""
    dynamics = evaluate(scene, formulation, variables, memory, t, closed)
    powers = ledger_powers(scene, dynamics, t) if formulation.ledger else {}
    return dynamics.variable_rates, powers


def ledger_powers(scene: Scene, dynamics: Dynamics, t: Scalar) -> dict[str, Scalar]:
    """Powers of the energy ledger in W, dissipated ones positive; only those the scene can have."""
    powers: dict[str, Scalar] = {}

    def book(name: str, power: Scalar) -> None:
        powers[name] = add(powers.get(name, 0.0), total(power))

    for family in dynamics.contact_forces.values():
        for force in family.values():
            rate = force.contact.gap.rate
            book("normal damping", (force.normal_force - force.elastic_force) * rate)
            if force.friction is not None and force.contact.slip is not None:
                book("friction", -force.friction.dot(force.contact.slip))
    for element in scene.forces.values():
        book("supplied", element.supplied_power(dynamics.motions, t))
    for name, family in dynamics.rows.items():
        for label, row in family.items():
            multiplier = dynamics.multipliers[name][label]
            book("stabilisation", -multiplier * row_rate(row, dynamics.motions))
            if not is_zero(row.time_rate):
                book("supplied", -multiplier * row.time_rate)
    return powers


def mechanical_energy(scene: Scene, motions: Motions, t: Scalar) -> dict[str, Scalar]:
    """Kinetic, gravitational and elastic energies in J; those a scene lacks are left out."""
    energies: dict[str, Scalar] = {"kinetic": 0.0}
    for name, body in scene.bodies.items():
        motion = motions[name]
        linear = body.mass * motion.velocity.dot(motion.velocity)
        angular = motion.spin.dot(body.angular_momentum(motion.spin))
        energies["kinetic"] = energies["kinetic"] + total(0.5 * (linear + angular))
    if scene.gravity is not None:
        energies["gravity"] = 0.0
        for name, body in scene.bodies.items():
            height = scene.gravity.dot(motions[name].position)
            energies["gravity"] = energies["gravity"] - total(body.mass * height)
    if scene.forces:
        stored = [element.stored_energy(motions, t) for element in scene.forces.values()]
        energies["springs"] = sum(stored[1:], stored[0])
    for joint in scene.contact_joints().values():
        laws = joint.laws()
        for label, contact in joint.contacts(motions).items():
            stored_energy = laws[label].stored_energy(contact.gap)
            energies["contacts"] = add(energies.get("contacts", 0.0), total(stored_energy))
    return energies
