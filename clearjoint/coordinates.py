"""Coordinates: from what is integrated to the motion of each body, and back from accelerations.

Everything else (forces, laws, joints) is written once for bodies. A coordinate system turns its
variables into `Motion`s, with twists V = H u for its speeds u, and projects the equations of motion
onto them: H^T M H u' = H^T (F - M H' u - gyroscopic terms), with constraints J H.
"""

import abc
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from .bodies import GROUND, Anchor, BodyState, Motion, Wrench
from .joints.base import Row
from .linear import LARGEST_UNROLLED, AbstractSolver, inner
from .rotations import kept_unit, rotation_matrix
from .scene import Scene
from .vectors import Scalar, Vector, add, is_zero, multiply

Wrenches = dict[str, Wrench]
Motions = dict[str, Motion]
Speeds = list[Scalar]
"""One scalar a speed of the coordinates: their rates, forces on them, or changes of them."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class Acceleration:
    """Acceleration of a body: of its centre of mass (global), and of its spin (body axes)."""

    linear: Vector
    angular: Vector


class AbstractMechanics(abc.ABC):
    """The equations of motion at one instant. What is not asked for is not computed.

    `motions`: pose and twist of each body, the ground included.
    """

    motions: Motions

    @abc.abstractmethod
    def free_rates(self, wrenches: Wrenches) -> Speeds:
        """Rates of the speeds under the given wrenches and gravity, without constraints."""

    @abc.abstractmethod
    def projected(self, wrenches: Wrenches) -> Speeds:
        """H^T times wrenches, or times a row's Jacobian; the ground's is left out."""

    @abc.abstractmethod
    def solved(self, forces: Speeds) -> Speeds:
        """The inverse of the mass matrix H^T M H times forces."""

    @abc.abstractmethod
    def bias(self, row: Row) -> Scalar:
        """The row's Jacobian times the body accelerations at zero rates: H' u, and gravity where
        rates are those against free fall."""

    @abc.abstractmethod
    def accelerations(self, rates: Speeds) -> dict[str, Acceleration]:
        """Accelerations of the bodies for rates of the speeds."""

    @abc.abstractmethod
    def variable_rates(self, rates: Speeds) -> Any:
        """Time derivative of the variables for rates of the speeds."""

    @abc.abstractmethod
    def moved(self, changes: Speeds) -> Any:
        """The variables after a small motion along the speeds (m and rad)."""

    @abc.abstractmethod
    def kicked(self, changes: Speeds) -> Any:
        """The variables after changes of the speeds."""


class AbstractCoordinates(eqx.Module):
    """The variables of integration; ``bodies`` is the dictionary of a `State`, in scalar form."""

    @abc.abstractmethod
    def eliminated(self, scene: Scene) -> frozenset[str]:
        """Names of the ideal joints that hold by the choice of variables: no constraints."""

    @abc.abstractmethod
    def encode(self, scene: Scene, bodies: dict[str, BodyState]) -> Any:
        """The variables of a state."""

    @abc.abstractmethod
    def decode(self, scene: Scene, variables: Any) -> dict[str, BodyState]:
        """The state of the variables."""

    @abc.abstractmethod
    def motions(self, scene: Scene, variables: Any) -> Motions:
        """Pose and twist of each body, the ground included."""

    @abc.abstractmethod
    def mechanics(self, scene: Scene, variables: Any) -> AbstractMechanics:
        """The equations of motion."""

    @abc.abstractmethod
    def settled(self, scene: Scene, variables: Any) -> Any:
        """The same motion in numbers that don't drift in many steps, for the end of each: Euler
        parameters of unit norm, angles within two turns. Exactly as they are if they are that."""


def response(
    mechanics: AbstractMechanics,
    directions: Sequence[Speeds],
    targets: Sequence[Scalar],
    solver: AbstractSolver,
) -> tuple[Speeds, list[Scalar]]:
    """The change M^-1 D^T lambda of the rates with D times it equal to the targets (eqs 30, 32).

    `directions` are the rows D = J H. Also returns lambda. The same map gives the projections: with
    speeds or displacements for rates it is the correction of least kinetic energy. A row that is
    structurally zero, as of a planar loop out of its plane, holds by itself and has no multiplier.
    """
    kept = [k for k, row in enumerate(directions) if not all(map(is_zero, row))]
    multipliers: list[Scalar] = [0.0] * len(directions)
    if not kept:
        return [0.0] * len(directions[0]), multipliers
    rows, aims = [directions[k] for k in kept], [targets[k] for k in kept]
    weighted = [mechanics.solved(row) for row in rows]
    solve = _dense_response if len(rows) > LARGEST_UNROLLED else _unrolled_response
    change, found = solve(rows, weighted, aims, solver)
    for k, multiplier in zip(kept, found, strict=True):
        multipliers[k] = multiplier
    return change, multipliers


def _unrolled_response(
    directions: Sequence[Speeds],
    weighted: Sequence[Speeds],
    targets: Sequence[Scalar],
    solver: AbstractSolver,
) -> tuple[Speeds, list[Scalar]]:
    """In scalar form, from the directions and M^-1 times them."""
    schur = [
        [inner(row, column) for column in weighted[: i + 1]] for i, row in enumerate(directions)
    ]
    multipliers = solver.unrolled(schur, targets)
    change: Speeds = [0.0] * len(directions[0])
    for part, multiplier in zip(weighted, multipliers, strict=True):
        change = [add(a, multiply(b, multiplier)) for a, b in zip(change, part, strict=True)]
    return change, multipliers


def _dense_response(
    directions: Sequence[Speeds],
    weighted: Sequence[Speeds],
    targets: Sequence[Scalar],
    solver: AbstractSolver,
) -> tuple[Speeds, list[Scalar]]:
    """The same in arrays, for systems too large to be unrolled."""
    jacobian, inverse = (
        jnp.stack([stacked(row) for row in rows]) for rows in (directions, weighted)
    )
    multipliers = solver.dense(jacobian @ inverse.T, stacked(targets))
    change = multipliers @ inverse
    return list(change), list(multipliers)


def stacked(numbers: Sequence[Scalar]) -> jax.Array:
    """An array of scalars."""
    return jnp.stack([jnp.asarray(number, dtype=float) for number in numbers])


def row_rate(row: Row, motions: Motions) -> Scalar:
    """First derivative of a row's value."""
    total = row.time_rate
    for name, pair in row.jacobian.items():
        if name != GROUND:
            motion = motions[name]
            part = add(pair.force.dot(motion.velocity), pair.moment.dot(motion.spin))
            total = add(total, part)
    return total


def anchors(scene: Scene) -> dict[str, tuple[Vector, Vector]]:
    """Point of the body and point of the ground for each body that has an `Anchor`."""
    found = {}
    for joint in scene.contact_joints().values():
        anchor = joint.anchor()
        if anchor is not None and anchor[0] not in found:
            found[anchor[0]] = anchor[1:]
    return found


def settled_body(body: BodyState) -> BodyState:
    """The state with Euler parameters of unit norm."""
    return BodyState(body.position, kept_unit(body.orientation), body.velocity, body.spin)


def free_motion(body: BodyState, anchor: tuple[Vector, Vector] | None) -> Motion:
    """Motion of a body whose position is its centre of mass's, or its anchor's if it has one."""
    rotation = rotation_matrix(body.orientation)
    if anchor is None:
        return Motion(body.position, rotation, body.velocity, body.spin)
    local, origin = anchor
    position = (origin + body.position) - rotation @ local
    velocity = body.velocity + rotation @ body.spin.cross(local)
    near = Anchor(local, origin, body.position, velocity)
    return Motion(position, rotation, body.velocity, body.spin, near)
