"""Coordinates: from what is integrated to the motion of each body, and back from accelerations.

Everything else (forces, laws, joints) is written once for bodies. A coordinate system turns its
variables into `Motion`s, with twists V = H u for its speeds u, and projects the equations of motion
onto them: H^T M H u' = H^T (F - M H' u - gyroscopic terms), with constraints J H.
"""

import abc
from dataclasses import dataclass
from typing import TypeAlias

import equinox as eqx
import jax
from jaxtyping import PyTree

from ..math.rotations import kept_unit, rotation_matrix
from ..math.vectors import Scalar, Vector
from ..model.bodies import Anchor, BodyState, Motion, Wrench
from ..model.joints.base import Motions, Row
from ..model.scene import Scene

MotionVariables: TypeAlias = PyTree
"""Positions and speeds as coordinates hold them: scalars in a tree of each coordinate system's own.
Their time derivatives have the same form."""
Wrenches: TypeAlias = dict[str, Wrench]
"""Wrenches by the name of the body that they act on."""
Speeds: TypeAlias = list[Scalar]
"""One scalar a speed of the coordinates: their rates, forces on them, or changes of them."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class BodyAcceleration:
    """Acceleration of a body: of its centre of mass (global), and of its spin (body axes)."""

    linear: Vector
    angular: Vector


class AbstractMechanics(abc.ABC):
    """The equations of motion at one instant. What is not asked for is not computed.

    `motions`: pose and twist of each body, the ground included.

    >>> scene, state = extend.unpack(cj.mechanisms.double_pendulum())
    >>> system = extend.System(scene, extend.Formulation())
    >>> variables = system.encode(state.bodies)
    >>> mechanics = system.mechanics(variables)
    >>> float(mechanics.motions["arm 2"].position.x)
    0.5
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
    def accelerations(self, rates: Speeds) -> dict[str, BodyAcceleration]:
        """Accelerations of the bodies for rates of the speeds."""

    @abc.abstractmethod
    def variable_rates(self, rates: Speeds) -> MotionVariables:
        """Time derivative of the variables for rates of the speeds."""

    @abc.abstractmethod
    def after_displacement(self, changes: Speeds) -> MotionVariables:
        """The variables after a small motion along the speeds (m and rad)."""

    @abc.abstractmethod
    def after_speed_change(self, changes: Speeds) -> MotionVariables:
        """The variables after changes of the speeds."""


class AbstractCoordinates(eqx.Module):
    """The variables of integration; ``bodies`` is the dictionary of a `State`, in scalar form.

    >>> scene, _ = cj.mechanisms.double_pendulum()
    >>> cj.JointCoordinates().eliminated(extend.unpack(scene))  # is one
    frozenset({'elbow'})
    """

    @abc.abstractmethod
    def eliminated(self, scene: Scene) -> frozenset[str]:
        """Names of the ideal joints that hold by the choice of variables: no constraints."""

    @abc.abstractmethod
    def encode(self, scene: Scene, bodies: dict[str, BodyState]) -> MotionVariables:
        """The variables of a state."""

    @abc.abstractmethod
    def decode(self, scene: Scene, variables: MotionVariables) -> dict[str, BodyState]:
        """The state of the variables."""

    @abc.abstractmethod
    def motions(self, scene: Scene, variables: MotionVariables) -> Motions:
        """Pose and twist of each body, the ground included."""

    @abc.abstractmethod
    def mechanics(self, scene: Scene, variables: MotionVariables) -> AbstractMechanics:
        """The equations of motion."""

    @abc.abstractmethod
    def without_drift(self, scene: Scene, variables: MotionVariables) -> MotionVariables:
        """The same motion in numbers that don't drift in many steps, for the end of each: Euler
        parameters of unit norm, angles within two turns. Exactly as they are if they are that."""

    @abc.abstractmethod
    def with_speeds(
        self, scene: Scene, variables: MotionVariables, others: MotionVariables
    ) -> MotionVariables:
        """The variables with the speeds of others; positions stay."""


def anchors(scene: Scene) -> dict[str, tuple[Vector, Vector]]:
    """Point of the body and point of the ground for each body that has an `Anchor`."""
    points = {}
    for joint in scene.contact_joints().values():
        anchor = joint.anchor()
        if anchor is not None and anchor[0] not in points:
            points[anchor[0]] = anchor[1:]
    return points


def settled_body(body: BodyState) -> BodyState:
    """The state with Euler parameters of unit norm."""
    return BodyState(body.position, kept_unit(body.orientation), body.velocity, body.spin)


def body_with_speeds(body: BodyState, other: BodyState) -> BodyState:
    """The position of one state and the velocities of another."""
    return BodyState(body.position, body.orientation, other.velocity, other.spin)


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
