"""Interface of coordinates, the variables that describe the motion of a scene and are integrated.

Forces, contact laws and joints are written for the motions of bodies, not for coordinates. A class
of coordinates converts its variables to one `Motion` (pose and velocities) for each body. Let V be
the velocities (m/s, global) and spins (rad/s, body axes) of all bodies, and u the speeds of the
coordinates, so that V = H u. The equations of motion in the speeds are H^T M H u' = H^T (F - M H' u
- gyroscopic terms), where M is the matrix of masses and inertias, F are the forces (including
weights) and moments on the bodies, and ' is the time derivative. A constraint with the Jacobian J
by V has the Jacobian J H by u. Force and moment on a body together are a wrench.

`JointCoordinates` solve for other unknowns r, which are linear combinations of the u'. In lists of
rates of the type `Speeds`, r takes the place of u', and H is then the matrix with V' = H r + terms
without r. In lists of changes of speeds, or of displacements, the same linear combinations take the
place of the changes.
"""

import abc
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import TypeAlias

import equinox as eqx
from jaxtyping import PyTree

from .._math.rotations import rotation_matrix
from .._math.vectors import ZERO, Scalar, Vector
from .._model.bodies import Anchor, BodyState, Motion, Wrench
from .._model.joints.base import Motions, Row
from .._model.scene import Scene
from .._model.tree_dataclass import tree_dataclass

MotionVariables: TypeAlias = PyTree
"""Positions and speeds in some coordinates: a PyTree of scalars, whose structure depends on the
coordinates. The time derivative of the variables has the same structure."""
Wrenches: TypeAlias = dict[str, Wrench]
Speeds: TypeAlias = list[Scalar]
"""One scalar for each speed u: rates, generalised forces, or changes of speeds or positions."""


@tree_dataclass
class BodyAcceleration:
    """Acceleration of the centre of mass, m/s^2, global; rate of the spin, rad/s^2, body axes."""

    linear: Vector
    angular: Vector


class AbstractMechanics(abc.ABC):
    """Equations of motion of a scene at one instant, in the speeds u of some coordinates.

    The matrix H maps the speeds to the velocities and spins of the bodies, and M is the matrix of
    their masses and inertias. `motions` contains pose and velocities of each body and of "ground".
    Values of bodies are dictionaries by name.

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
        """Return the rates of the speeds that gravity and a wrench on each body cause, without the
        reactions of constraints.

        For a tree of bodies without an eliminated joint to the ground, the rates may be relative to
        free fall: they leave gravity out, and `accelerations` and `variable_rates` add it.
        """

    @abc.abstractmethod
    def projected(self, wrenches: Wrenches) -> Speeds:
        """Return H^T times the wrenches on the bodies: one generalised force for each speed. An
        entry for the ground is ignored; a body without entry has no wrench. For the `jacobian` of a
        constraint's `Row`, the result is the row's Jacobian by the speeds."""

    @abc.abstractmethod
    def solved(self, forces: Speeds) -> Speeds:
        """Return (H^T M H)^-1 times generalised forces: the rates of the speeds that they cause."""

    @abc.abstractmethod
    def bias(self, row: Row) -> Scalar:
        """Return the row's Jacobian times the accelerations of the bodies at zero rates of all
        speeds: H' u and, if the rates are relative to free fall (see `free_rates`), gravity. This
        plus ``row.bias`` is the second time derivative of the row's value at these rates."""

    @abc.abstractmethod
    def accelerations(self, rates: Speeds) -> dict[str, BodyAcceleration]:
        """Return the acceleration of each body for given rates of the speeds."""

    @abc.abstractmethod
    def variable_rates(self, rates: Speeds) -> MotionVariables:
        """Return the time derivatives of the variables for given rates of the speeds."""

    @abc.abstractmethod
    def after_displacement(self, changes: Speeds) -> MotionVariables:
        """Return the variables after a small displacement along each speed, m or rad."""

    @abc.abstractmethod
    def after_speed_change(self, changes: Speeds) -> MotionVariables:
        """Return the variables with a change, m/s or rad/s, added to each speed."""


class AbstractCoordinates(eqx.Module):
    """Base class of coordinates, the choice of the variables that describe the motion of a scene.

    In all methods, scene and bodies are in scalar form (each vector is three separate scalars, see
    `clearjoint.extend.unpack`), and dictionaries are by name of body.

    >>> scene, _ = cj.mechanisms.double_pendulum()
    >>> cj.JointCoordinates().eliminated(extend.unpack(scene))  # the elbow's angle is a variable
    frozenset({'elbow'})
    """

    @abc.abstractmethod
    def eliminated(self, scene: Scene) -> frozenset[str]:
        """Return the names of the ideal joints that these coordinates always satisfy. The other
        ideal joints remain constraints."""

    @abc.abstractmethod
    def encode(self, scene: Scene, bodies: dict[str, BodyState]) -> MotionVariables:
        """Return the variables that represent given states of all bodies. A violation of an
        eliminated joint by the states is ignored."""

    @abc.abstractmethod
    def decode(self, scene: Scene, variables: MotionVariables) -> dict[str, BodyState]:
        """Return the states of all bodies that the variables represent."""

    @abc.abstractmethod
    def motions(self, scene: Scene, variables: MotionVariables) -> Motions:
        """Return pose and velocities of each body and of "ground"."""

    @abc.abstractmethod
    def mechanics(self, scene: Scene, variables: MotionVariables) -> AbstractMechanics:
        """Return the equations of motion at the instant that the variables describe."""

    @abc.abstractmethod
    def without_drift(self, scene: Scene, variables: MotionVariables) -> MotionVariables:
        """Return normalised variables of the same motion. Runs call this at the end of each step.

        Euler parameters whose squared norm differs from one by more than 1e-6 are scaled to unit
        norm, and angles, except those of screws, are moved to between -2 pi and 2 pi. Other
        variables are unchanged to the bit.
        """

    @abc.abstractmethod
    def with_speeds(
        self, scene: Scene, variables: MotionVariables, others: MotionVariables
    ) -> MotionVariables:
        """Return variables with the positions of `variables` and the speeds of `others`."""

    def rotation_rates(self, scene: Scene, variables: MotionVariables) -> dict[str, Scalar]:
        """Return for some bodies the rate, rad/s, not negative, at which a body rotates relative to
        the body that carries it in a joint; no bodies by default.

        A uniform rotation has no integration error that could limit the step. Where a run searches
        its steps for events, it therefore limits the angles by which these bodies rotate in a step.
        The variables of these bodies must have an attribute `position`.
        """
        return {}

    def carriers(self, scene: Scene, bodies: Collection[str]) -> frozenset[str]:
        """Return the bodies whose joints can move `bodies` relative to each other; none by default.
        A run calls it for each contact joint, and limits the rotations of the result in a step."""
        return frozenset()


def anchors(scene: Scene) -> dict[str, tuple[Vector, Vector]]:
    """Return the two points of each anchor (see `AbstractContactJoint.anchor`), by body: on the
    body, m in body axes, and on the ground, m. The first anchor of a body counts. The vector
    between the points, as a variable, keeps digits that a difference of global positions loses."""
    points = {}
    for joint in scene.contact_joints().values():
        anchor = joint.anchor()
        if anchor is not None:
            body, local, origin = anchor
            points.setdefault(body, (local, origin))
    return points


def at_rest(bodies: Mapping[str, BodyState]) -> dict[str, BodyState]:
    """Return the states with velocities and spins of Python zeros, which compiled programs omit."""
    return {n: replace(body, velocity=ZERO, spin=ZERO) for n, body in bodies.items()}


def free_motion(body: BodyState, anchor: tuple[Vector, Vector] | None) -> Motion:
    """Return the motion of a free body, whose variable `position`, m, is that of the centre of mass
    or, with an `anchor` (the two points of `anchors`), the vector from the point on the ground to
    the point on the body."""
    rotation = rotation_matrix(body.orientation)
    if anchor is None:
        return Motion(body.position, rotation, body.velocity, body.spin)
    local, origin = anchor
    position = (origin + body.position) - rotation @ local
    velocity = body.velocity + rotation @ body.spin.cross(local)
    moving_anchor = Anchor(local, origin, body.position, velocity)
    return Motion(position, rotation, body.velocity, body.spin, moving_anchor)
