"""Interface of coordinates: integrated variables to motions of bodies, and accelerations back.

Forces, laws and joints are written once, for bodies. Coordinates convert their variables into
`Motion`s, with twists V = H u for the speeds u, and project the equations of motion onto the
speeds: H^T M H u' = H^T (F - M H' u - gyroscopic terms), with constraint Jacobians J H.
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
"""Positions and speeds of a coordinate system: scalars in a PyTree of its own structure. Their
time derivatives have the same structure."""
Wrenches: TypeAlias = dict[str, Wrench]
"""Wrenches by the name of the body on which they act."""
Speeds: TypeAlias = list[Scalar]
"""One scalar for each speed u of the coordinates: its rate, generalised force, or a change."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class BodyAcceleration:
    """Acceleration of a body: of its centre of mass (global), and of its spin (body axes)."""

    linear: Vector
    angular: Vector


class AbstractMechanics(abc.ABC):
    """The equations of motion at one instant; each method computes only what it returns.

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
        """Return the rates of the speeds under wrenches and gravity, without constraints."""

    @abc.abstractmethod
    def projected(self, wrenches: Wrenches) -> Speeds:
        """Return H^T times wrenches, or times a row's Jacobian; the ground is left out."""

    @abc.abstractmethod
    def solved(self, forces: Speeds) -> Speeds:
        """Return the inverse of the mass matrix H^T M H times forces."""

    @abc.abstractmethod
    def bias(self, row: Row) -> Scalar:
        """Return the row's Jacobian times the accelerations of the bodies at zero rates.

        These are H' u, and gravity if the rates are relative to free fall.
        """

    @abc.abstractmethod
    def accelerations(self, rates: Speeds) -> dict[str, BodyAcceleration]:
        """Return the accelerations of the bodies for rates of the speeds."""

    @abc.abstractmethod
    def variable_rates(self, rates: Speeds) -> MotionVariables:
        """Return the time derivative of the variables for rates of the speeds."""

    @abc.abstractmethod
    def after_displacement(self, changes: Speeds) -> MotionVariables:
        """Return the variables after a small displacement along the speeds (m and rad)."""

    @abc.abstractmethod
    def after_speed_change(self, changes: Speeds) -> MotionVariables:
        """Return the variables after changes of the speeds."""


class AbstractCoordinates(eqx.Module):
    """The integrated variables; ``bodies`` is the dictionary of a `State`, in scalar form.

    >>> scene, _ = cj.mechanisms.double_pendulum()
    >>> cj.JointCoordinates().eliminated(extend.unpack(scene))  # is one
    frozenset({'elbow'})
    """

    @abc.abstractmethod
    def eliminated(self, scene: Scene) -> frozenset[str]:
        """Return the names of the ideal joints that the choice of variables satisfies.

        The other ideal joints are constraints.
        """

    @abc.abstractmethod
    def encode(self, scene: Scene, bodies: dict[str, BodyState]) -> MotionVariables:
        """Return the variables of a state."""

    @abc.abstractmethod
    def decode(self, scene: Scene, variables: MotionVariables) -> dict[str, BodyState]:
        """Return the state of the variables."""

    @abc.abstractmethod
    def motions(self, scene: Scene, variables: MotionVariables) -> Motions:
        """Return pose and twist of each body, the ground included."""

    @abc.abstractmethod
    def mechanics(self, scene: Scene, variables: MotionVariables) -> AbstractMechanics:
        """Return the equations of motion."""

    @abc.abstractmethod
    def without_drift(self, scene: Scene, variables: MotionVariables) -> MotionVariables:
        """Return the variables of the same motion, normalised.

        Euler parameters get unit norm, angles are moved to within two turns.

        It is applied at the end of each step, and leaves normalised variables unchanged to the bit.
        """

    @abc.abstractmethod
    def with_speeds(
        self, scene: Scene, variables: MotionVariables, others: MotionVariables
    ) -> MotionVariables:
        """Return `variables` with the speeds of `others`."""


def anchors(scene: Scene) -> dict[str, tuple[Vector, Vector]]:
    """Return the points of body and ground, m, for each body with an `Anchor`."""
    points = {}
    for joint in scene.contact_joints().values():
        anchor = joint.anchor()
        if anchor is not None and anchor[0] not in points:
            points[anchor[0]] = anchor[1:]
    return points


def normalised_body(body: BodyState) -> BodyState:
    """Return the state with Euler parameters of unit norm."""
    return BodyState(body.position, kept_unit(body.orientation), body.velocity, body.spin)


def body_with_speeds(body: BodyState, other: BodyState) -> BodyState:
    """Return the position of one state with the velocities of another."""
    return BodyState(body.position, body.orientation, other.velocity, other.spin)


def free_motion(body: BodyState, anchor: tuple[Vector, Vector] | None) -> Motion:
    """Return the motion of a body.

    Its position variable is that of its centre of mass, or of its anchor's point if it has one.
    """
    rotation = rotation_matrix(body.orientation)
    if anchor is None:
        return Motion(body.position, rotation, body.velocity, body.spin)
    local, origin = anchor
    position = (origin + body.position) - rotation @ local
    velocity = body.velocity + rotation @ body.spin.cross(local)
    near = Anchor(local, origin, body.position, velocity)
    return Motion(position, rotation, body.velocity, body.spin, near)
