"""How a body of a tree moves: freely, or carried by an ideal joint.

Each kind has variables of its own, and turns them into motions and rates.
"""

import abc
from dataclasses import dataclass
from typing import TypeAlias

from ...math.rotations import composed, conjugate, euler_parameter_rates, normalised, turned
from ...math.vectors import EulerParameters, Matrix, Vector, add
from ...model.bodies import BodyState, Motion
from ...model.joints.motion_subspaces import AbstractMotionSubspace, JointState, Relative, Twist
from ..coordinates import (
    MotionVariables,
    Speeds,
    body_with_speeds,
    free_motion,
    settled_body,
)
from .links import Link, free_link, jointed_link

UPRIGHT = EulerParameters(1.0, 0.0, 0.0, 0.0)
BodyPose: TypeAlias = tuple[EulerParameters, Motion]


@dataclass(frozen=True)
class AbstractBranch(abc.ABC):
    """A body and its parent, by name."""

    body: str
    parent: str

    @abc.abstractmethod
    def encode(self, parent: BodyPose, body: BodyPose) -> MotionVariables:
        """The variables, from orientations and motions."""

    @abc.abstractmethod
    def orientation(self, parent: EulerParameters, state: MotionVariables) -> EulerParameters:
        """The body's Euler parameters."""

    @abc.abstractmethod
    def motion(self, parent: Motion, state: MotionVariables) -> Motion:
        """Pose and twist of the body, from those of its parent."""

    @abc.abstractmethod
    def link(self, parent: Link | None, state: MotionVariables) -> Link:
        """The body as a link of its tree, of which it is the root if it has no parent there."""

    @abc.abstractmethod
    def rates(
        self, state: MotionVariables, speeds: Speeds, axes: Matrix, gravity: Vector
    ) -> MotionVariables:
        """Time derivative of the variables for rates of the speeds; `axes` turn the root's
        components into global ones."""

    @abc.abstractmethod
    def after_displacement(
        self, state: MotionVariables, changes: Speeds, axes: Matrix
    ) -> MotionVariables:
        """The variables after a small motion along the speeds."""

    @abc.abstractmethod
    def after_speed_change(
        self, state: MotionVariables, changes: Speeds, axes: Matrix
    ) -> MotionVariables:
        """The variables after changes of the speeds."""

    @abc.abstractmethod
    def without_drift(self, state: MotionVariables) -> MotionVariables:
        """The same variables in numbers that don't drift in many steps."""

    @abc.abstractmethod
    def with_speeds(self, state: MotionVariables, other: MotionVariables) -> MotionVariables:
        """The variables with the speeds of others."""

    @abc.abstractmethod
    def falls(self) -> bool:
        """Whether the rates of the speeds are those against free fall."""


@dataclass(frozen=True)
class FreeBranch(AbstractBranch):
    """A body that nothing carries: a `BodyState` as in absolute coordinates.

    With an anchor, a point of the body and one of the ground, its position is the former's from the
    latter. Speeds are velocity and spin, both in body axes; rates of the former are those against
    free fall, since gravity changes nothing else of a free tree.
    """

    anchor: tuple[Vector, Vector] | None

    def encode(self, parent: BodyPose, body: BodyPose) -> BodyState:
        """Position of the centre of mass or of the anchor's point."""
        orientation, motion = body
        position = motion.position
        if self.anchor is not None:
            local, origin = self.anchor
            position = (position + motion.rotation @ local) - origin
        return BodyState(position, orientation, motion.velocity, motion.spin)

    def orientation(self, parent: EulerParameters, state: BodyState) -> EulerParameters:
        """The Euler parameters that the state holds."""
        return state.orientation

    def motion(self, parent: Motion, state: BodyState) -> Motion:
        """The motion of the centre of mass, from that of the anchor's point if there is one."""
        return free_motion(state, self.anchor)

    def link(self, parent: Link | None, state: BodyState) -> Link:
        """The root of its tree."""
        return free_link(state.spin)

    def rates(self, state: BodyState, speeds: Speeds, axes: Matrix, gravity: Vector) -> BodyState:
        """Velocity, Euler parameter rates, and accelerations."""
        return BodyState(
            self._shift(axes, state.velocity, state.spin),
            euler_parameter_rates(state.orientation, state.spin),
            axes @ Vector(*speeds[:3]) + gravity,
            Vector(*speeds[3:]),
        )

    def _shift(self, axes: Matrix, velocity: Vector, spin: Vector) -> Vector:
        """Velocity, or displacement, of the position's point."""
        if self.anchor is None:
            return velocity
        return velocity + axes @ spin.cross(self.anchor[0])

    def after_displacement(self, state: BodyState, changes: Speeds, axes: Matrix) -> BodyState:
        """The position shifted, and the orientation turned."""
        turn = Vector(*changes[3:])
        shift = self._shift(axes, axes @ Vector(*changes[:3]), turn)
        orientation = turned(state.orientation, turn)
        return BodyState(state.position + shift, orientation, state.velocity, state.spin)

    def after_speed_change(self, state: BodyState, changes: Speeds, axes: Matrix) -> BodyState:
        """Velocity and spin changed."""
        velocity = state.velocity + axes @ Vector(*changes[:3])
        spin = state.spin + Vector(*changes[3:])
        return BodyState(state.position, state.orientation, velocity, spin)

    def without_drift(self, state: BodyState) -> BodyState:
        """Euler parameters of unit norm."""
        return settled_body(state)

    def with_speeds(self, state: BodyState, other: BodyState) -> BodyState:
        """Velocity and spin of the other."""
        return body_with_speeds(state, other)

    def falls(self) -> bool:
        """True: its rates leave gravity out."""
        return True


@dataclass(frozen=True)
class JointedBranch(AbstractBranch):
    """A body carried by an ideal joint: a `JointState` of the joint's freedom."""

    joint: str
    motion_subspace: AbstractMotionSubspace

    def encode(self, parent: BodyPose, body: BodyPose) -> JointState:
        """The relative motion, as far as the joint allows it."""
        here, there = self.motion_subspace.point_child, self.motion_subspace.point_parent
        (turn_parent, first), (turn, second) = parent, body
        displacement = second.components(second.point(here) - first.point(there))
        spin = second.spin - second.components(first.direction(first.spin))
        velocity = second.components(second.velocity_at(here) - first.velocity_at(there))
        slide = velocity - second.spin.cross(displacement)
        orientation = composed(conjugate(turn_parent), turn)
        return self.motion_subspace.encode(Relative(orientation, displacement, Twist(spin, slide)))

    def orientation(self, parent: EulerParameters, state: JointState) -> EulerParameters:
        """The parent's, and then the joint's."""
        return normalised(composed(parent, self.motion_subspace.orientation(state.position)))

    def motion(self, parent: Motion, state: JointState) -> Motion:
        """The parent's motion, and the joint's on top."""
        turn, twist = (
            self.motion_subspace.rotation(state.position),
            self.motion_subspace.twist(state),
        )
        rotation = parent.rotation @ turn
        spin = turn.transposed_times(parent.spin) + twist.angular
        arm = self.motion_subspace.displacement(state.position) - self.motion_subspace.point_child
        point = self.motion_subspace.point_parent
        return Motion(
            parent.point(point) + rotation @ arm,
            rotation,
            parent.velocity_at(point) + rotation @ (spin.cross(arm) + twist.linear),
            spin,
        )

    def link(self, parent: Link | None, state: JointState) -> Link:
        """The root of a tree if the parent is the ground."""
        return jointed_link(parent, self.motion_subspace, state)

    def rates(self, state: JointState, speeds: Speeds, axes: Matrix, gravity: Vector) -> JointState:
        """The position's rates, and the speeds'."""
        return JointState(self.motion_subspace.rates(state), tuple(speeds))

    def after_displacement(self, state: JointState, changes: Speeds, axes: Matrix) -> JointState:
        """The position moved along the directions that the joint leaves free."""
        return JointState(
            self.motion_subspace.after_displacement(state.position, tuple(changes)), state.speeds
        )

    def after_speed_change(self, state: JointState, changes: Speeds, axes: Matrix) -> JointState:
        """The position, and the speeds plus their changes."""
        speeds = tuple(add(a, b) for a, b in zip(state.speeds, changes, strict=True))
        return JointState(state.position, speeds)

    def without_drift(self, state: JointState) -> JointState:
        """The position as the joint's freedom keeps it in range."""
        return JointState(self.motion_subspace.without_drift(state.position), state.speeds)

    def with_speeds(self, state: JointState, other: JointState) -> JointState:
        """The speeds of the other."""
        return JointState(state.position, other.speeds)

    def falls(self) -> bool:
        """False: its rates are against the parent."""
        return False
