"""Coordinates: from what is integrated to the motion of each body, and back from accelerations.

Everything else (forces, laws, joints) is written once for bodies. A coordinate system turns its
variables into `Motion`s and solves the equations of motion projected onto itself.
"""

import abc
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from .bodies import (
    GROUND,
    GROUND_MOTION,
    NO_WRENCH,
    Anchor,
    Body,
    BodyState,
    Motion,
    Wrench,
)
from .joints.base import Row
from .linear import LARGEST_UNROLLED, AbstractSolver
from .rotations import euler_parameter_rates, rotation_matrix, turned
from .scene import Scene
from .vectors import ZERO, Matrix, Scalar, Vector, add

Wrenches = dict[str, Wrench]
Motions = dict[str, Motion]


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class Acceleration:
    """Acceleration of a body: of its centre of mass (global), and of its spin (body axes)."""

    linear: Vector
    angular: Vector

    def __add__(self, other: "Acceleration") -> "Acceleration":
        return Acceleration(self.linear + other.linear, self.angular + other.angular)


STILL = Acceleration(ZERO, ZERO)


class AbstractCoordinates(eqx.Module):
    """The variables of integration; ``bodies`` is the dictionary of a `State`, in scalar form."""

    @abc.abstractmethod
    def encode(self, scene: Scene, bodies: dict[str, BodyState]) -> Any:
        """The variables of a state."""

    @abc.abstractmethod
    def decode(self, scene: Scene, variables: Any) -> dict[str, BodyState]:
        """The state of the variables."""

    @abc.abstractmethod
    def motions(self, scene: Scene, variables: Any) -> Motions:
        """Pose, twist and bias of each body, the ground included."""

    @abc.abstractmethod
    def free_accelerations(
        self, scene: Scene, motions: Motions, wrenches: Wrenches
    ) -> dict[str, Acceleration]:
        """Accelerations of the bodies under the given wrenches, without further constraints."""

    @abc.abstractmethod
    def response(
        self,
        scene: Scene,
        motions: Motions,
        rows: list[Row],
        targets: list[Scalar],
        solver: AbstractSolver,
    ) -> tuple[dict[str, Acceleration], list[Scalar]]:
        """The change M^-1 J^T lambda of the accelerations with J times it equal to the targets.

        Also returns lambda. The same map gives the projections: with velocities or displacements
        for accelerations it is the correction of least kinetic energy.
        """

    @abc.abstractmethod
    def rates(self, scene: Scene, variables: Any, accelerations: dict[str, Acceleration]) -> Any:
        """Time derivative of the variables."""

    @abc.abstractmethod
    def moved(self, scene: Scene, variables: Any, displacements: dict[str, Acceleration]) -> Any:
        """The variables after small displacements (m) and turns (rad, body axes)."""

    @abc.abstractmethod
    def kicked(self, variables: Any, changes: dict[str, Acceleration]) -> Any:
        """The variables after changes of velocity (m/s) and spin (rad/s)."""


class AbsoluteCoordinates(AbstractCoordinates):
    """Position, Euler parameters, velocity and body spin of each body, as in the paper.

    A body's position variable is that of its centre of mass, or of its `Anchor` if it hangs on the
    ground by a clearance joint: from the bearing's centre to the journal's, which in metre-sized
    coordinates would lose the digits that impacts amplify.
    """

    def encode(self, scene: Scene, bodies: dict[str, BodyState]) -> dict[str, BodyState]:
        """The bodies' states, those with an anchor by its offset."""
        anchors = _anchors(scene)

        def encoded(name: str, body: BodyState) -> BodyState:
            if name not in anchors:
                return body
            local, origin = anchors[name]
            arm = rotation_matrix(body.orientation) @ local
            return BodyState(
                (body.position + arm) - origin, body.orientation, body.velocity, body.spin
            )

        return {name: encoded(name, body) for name, body in bodies.items()}

    def decode(self, scene: Scene, variables: dict[str, BodyState]) -> dict[str, BodyState]:
        """The states of the bodies' centres of mass."""
        motions = self.motions(scene, variables)
        return {
            name: BodyState(motions[name].position, body.orientation, body.velocity, body.spin)
            for name, body in variables.items()
        }

    def motions(self, scene: Scene, variables: dict[str, BodyState]) -> Motions:
        """Motion of each body; no bias."""
        anchors = _anchors(scene)
        motions = {GROUND: GROUND_MOTION}
        for name, body in variables.items():
            rotation = rotation_matrix(body.orientation)
            position, anchor = body.position, None
            if name in anchors:
                local, origin = anchors[name]
                anchor = Anchor(local, origin, body.position)
                position = (origin + body.position) - rotation @ local
            motions[name] = Motion(position, rotation, body.velocity, body.spin, NO_WRENCH, anchor)
        return motions

    def free_accelerations(
        self, scene: Scene, motions: Motions, wrenches: Wrenches
    ) -> dict[str, Acceleration]:
        """Newton and Euler for each body (eq. 29)."""
        return {
            name: InverseMass(body)(wrenches[name] + _gyroscopic(body, motions[name]))
            for name, body in scene.bodies.items()
        }

    def response(
        self,
        scene: Scene,
        motions: Motions,
        rows: list[Row],
        targets: list[Scalar],
        solver: AbstractSolver,
    ) -> tuple[dict[str, Acceleration], list[Scalar]]:
        """Solves the KKT system (eqs 30 and 32) by its Schur complement J M^-1 J^T."""
        del motions
        inverse_masses = {name: InverseMass(body) for name, body in scene.bodies.items()}
        weighted = [
            {
                name: inverse_masses[name](pair)
                for name, pair in row.jacobian.items()
                if name != GROUND
            }
            for row in rows
        ]
        if len(rows) > LARGEST_UNROLLED:
            return _dense_response(list(scene.bodies), rows, weighted, targets, solver)
        schur = [[along(row, column) for column in weighted[: i + 1]] for i, row in enumerate(rows)]
        multipliers = solver.unrolled(schur, targets)
        still = dict.fromkeys(scene.bodies, STILL)
        return _combined(still, weighted, multipliers), multipliers

    def rates(
        self,
        scene: Scene,
        variables: dict[str, BodyState],
        accelerations: dict[str, Acceleration],
    ) -> dict[str, BodyState]:
        """Velocity, Euler parameter rates, and accelerations."""
        twists = {name: Acceleration(body.velocity, body.spin) for name, body in variables.items()}
        shifts = self._shifts(scene, variables, twists)
        return {
            name: BodyState(
                shifts[name],
                euler_parameter_rates(body.orientation, body.spin),
                accelerations[name].linear,
                accelerations[name].angular,
            )
            for name, body in variables.items()
        }

    def moved(
        self,
        scene: Scene,
        variables: dict[str, BodyState],
        displacements: dict[str, Acceleration],
    ) -> dict[str, BodyState]:
        """Positions shifted and orientations turned."""
        shifts = self._shifts(scene, variables, displacements)
        return {
            name: BodyState(
                body.position + shifts[name],
                turned(body.orientation, displacements[name].angular),
                body.velocity,
                body.spin,
            )
            for name, body in variables.items()
        }

    def _shifts(
        self,
        scene: Scene,
        variables: dict[str, BodyState],
        displacements: dict[str, Acceleration],
    ) -> dict[str, Vector]:
        """Displacement, or velocity, of each position variable for those of the bodies."""
        shifts = {name: part.linear for name, part in displacements.items()}
        for name, (local, _) in _anchors(scene).items():
            turn = displacements[name].angular.cross(local)
            rotation = rotation_matrix(variables[name].orientation)
            shifts[name] = shifts[name] + rotation @ turn
        return shifts

    def kicked(
        self, variables: dict[str, BodyState], changes: dict[str, Acceleration]
    ) -> dict[str, BodyState]:
        """Velocities and spins changed."""
        return {
            name: BodyState(
                body.position,
                body.orientation,
                body.velocity + changes[name].linear,
                body.spin + changes[name].angular,
            )
            for name, body in variables.items()
        }


def _anchors(scene: Scene) -> dict[str, tuple[Vector, Vector]]:
    """Point of the body and point of the ground for each body that has an anchor."""
    anchors = {}
    for joint in scene.contact_joints().values():
        anchor = joint.anchor()
        if anchor is not None and anchor[0] not in anchors:
            anchors[anchor[0]] = anchor[1:]
    return anchors


class InverseMass:
    """Turns a wrench on a free body into its acceleration, without gyroscopic terms."""

    def __init__(self, body: Body):
        self._inverse = 1.0 / body.mass
        self._tensor: Matrix | None = None
        if isinstance(body.inertia, Matrix):
            self._tensor = body.inertia.inverse()
        else:
            moments = body.inertia
            self._principal = Vector(1.0 / moments.x, 1.0 / moments.y, 1.0 / moments.z)

    def __call__(self, wrench: Wrench) -> Acceleration:
        """Acceleration of the centre of mass, and of the spin in body axes."""
        if self._tensor is not None:
            angular = self._tensor @ wrench.moment
        else:
            angular = wrench.moment.times(self._principal)
        return Acceleration(wrench.force * self._inverse, angular)


def angular_momentum(body: Body, spin: Vector) -> Vector:
    """Inertia times spin, body axes, kg m^2/s."""
    if isinstance(body.inertia, Matrix):
        return body.inertia @ spin
    return spin.times(body.inertia)


def _gyroscopic(body: Body, motion: Motion) -> Wrench:
    return Wrench(ZERO, angular_momentum(body, motion.spin).cross(motion.spin))


def along(row: Row, accelerations: dict[str, Acceleration]) -> Scalar:
    """The row's Jacobian times accelerations (or any other change of the twists)."""
    total: Scalar = 0.0
    for name, pair in row.jacobian.items():
        if name in accelerations:
            part = accelerations[name]
            total = add(total, add(pair.force.dot(part.linear), pair.moment.dot(part.angular)))
    return total


def row_rate(row: Row, motions: Motions) -> Scalar:
    """First derivative of a row's value."""
    twists = {
        name: Acceleration(motion.velocity, motion.spin)
        for name, motion in motions.items()
        if name != GROUND
    }
    return add(along(row, twists), row.time_rate)


def _combined(
    start: dict[str, Acceleration],
    weighted: list[dict[str, Acceleration]],
    multipliers: list[Scalar],
) -> dict[str, Acceleration]:
    result = dict(start)
    for parts, multiplier in zip(weighted, multipliers, strict=True):
        for name, part in parts.items():
            result[name] = result[name] + Acceleration(
                part.linear * multiplier, part.angular * multiplier
            )
    return result


def _dense_response(
    names: list[str],
    rows: list[Row],
    weighted: list[dict[str, Acceleration]],
    targets: list[Scalar],
    solver: AbstractSolver,
) -> tuple[dict[str, Acceleration], list[Scalar]]:
    """`AbsoluteCoordinates.response` in arrays, for systems too large to be unrolled."""
    jacobian = jnp.stack(
        [_gathered([row.jacobian.get(name, NO_WRENCH) for name in names]) for row in rows]
    )
    inverse = jnp.stack([_gathered([row.get(name, STILL) for name in names]) for row in weighted])
    multipliers = solver.dense(jacobian @ inverse.T, _gathered(targets))
    change = multipliers @ inverse
    accelerations = {
        name: Acceleration(
            Vector(*(change[6 * k + i] for i in range(3))),
            Vector(*(change[6 * k + i] for i in range(3, 6))),
        )
        for k, name in enumerate(names)
    }
    return accelerations, [multipliers[i] for i in range(len(rows))]


def _gathered(tree: Any) -> jax.Array:
    return jnp.stack([jnp.asarray(leaf, dtype=float) for leaf in jax.tree.leaves(tree)])
