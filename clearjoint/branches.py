"""How a body of a tree moves: freely, or carried by an ideal joint.

Each kind has variables of its own, and turns them into motions and rates.
"""

import abc
from dataclasses import dataclass
from typing import Any

from .bodies import Anchor, BodyState, Motion
from .coordinates import Speeds
from .joints.freedoms import AbstractFreedom, JointState, Relative, Twist
from .links import Link, free_link, jointed_link
from .rotations import (
    composed,
    conjugate,
    euler_parameter_rates,
    normalised,
    rotation_matrix,
    turned,
)
from .vectors import EulerParameters, Matrix, Vector, add

UPRIGHT = EulerParameters(1.0, 0.0, 0.0, 0.0)
BodyPose = tuple[EulerParameters, Motion]


@dataclass(frozen=True)
class AbstractBranch(abc.ABC):
    """A body and its parent, by name."""

    body: str
    parent: str

    @abc.abstractmethod
    def encode(self, parent: BodyPose, body: BodyPose) -> Any:
        """The variables, from orientations and motions."""

    @abc.abstractmethod
    def orientation(self, parent: EulerParameters, state: Any) -> EulerParameters:
        """The body's Euler parameters."""

    @abc.abstractmethod
    def motion(self, parent: Motion, state: Any) -> Motion:
        """The body's motion."""

    @abc.abstractmethod
    def link(self, parent: Link | None, state: Any) -> Link:
        """The body as a link of its tree, of which it is the root if it has no parent there."""

    @abc.abstractmethod
    def rates(self, state: Any, speeds: Speeds, axes: Matrix, gravity: Vector) -> Any:
        """Time derivative of the variables for rates of the speeds; `axes` turn the root's
        components into global ones."""

    @abc.abstractmethod
    def moved(self, state: Any, changes: Speeds) -> Any:
        """The variables after a small motion along the speeds."""

    @abc.abstractmethod
    def kicked(self, state: Any, changes: Speeds) -> Any:
        """The variables after changes of the speeds."""

    @abc.abstractmethod
    def count(self, state: Any) -> int:
        """Number of speeds."""

    @abc.abstractmethod
    def falls(self) -> bool:
        """Whether the rates of the speeds are those against free fall."""


@dataclass(frozen=True)
class FreeBranch(AbstractBranch):
    """A body that nothing carries: a `BodyState` of its point `local`, from the ground's `origin`.

    Speeds are the velocity of that point and the spin, both in body axes; rates of the former are
    those against free fall, since gravity changes nothing else of a free tree.
    """

    local: Vector
    origin: Vector
    anchored: bool

    def encode(self, parent: BodyPose, body: BodyPose) -> BodyState:
        """Position and velocity of the point."""
        orientation, motion = body
        arm = motion.rotation @ self.local
        velocity = motion.velocity_at(self.local)
        return BodyState((motion.position + arm) - self.origin, orientation, velocity, motion.spin)

    def orientation(self, parent: EulerParameters, state: BodyState) -> EulerParameters:
        """As it is."""
        return state.orientation

    def motion(self, parent: Motion, state: BodyState) -> Motion:
        """From the point to the centre of mass."""
        rotation = rotation_matrix(state.orientation)
        position = (self.origin + state.position) - rotation @ self.local
        velocity = state.velocity - rotation @ state.spin.cross(self.local)
        anchor = Anchor(self.local, self.origin, state.position, state.velocity)
        return Motion(position, rotation, velocity, state.spin, anchor if self.anchored else None)

    def link(self, parent: Link | None, state: BodyState) -> Link:
        """The root of its tree."""
        return free_link(self.local, state.spin)

    def rates(self, state: BodyState, speeds: Speeds, axes: Matrix, gravity: Vector) -> BodyState:
        """Velocity, Euler parameter rates, and accelerations."""
        return BodyState(
            state.velocity,
            euler_parameter_rates(state.orientation, state.spin),
            axes @ Vector(*speeds[:3]) + gravity,
            Vector(*speeds[3:]),
        )

    def moved(self, state: BodyState, changes: Speeds) -> BodyState:
        """Shifted and turned."""
        shift = rotation_matrix(state.orientation) @ Vector(*changes[:3])
        orientation = turned(state.orientation, Vector(*changes[3:]))
        return BodyState(state.position + shift, orientation, state.velocity, state.spin)

    def kicked(self, state: BodyState, changes: Speeds) -> BodyState:
        """Velocity and spin changed."""
        velocity = state.velocity + rotation_matrix(state.orientation) @ Vector(*changes[:3])
        spin = state.spin + Vector(*changes[3:])
        return BodyState(state.position, state.orientation, velocity, spin)

    def count(self, state: BodyState) -> int:
        """Six."""
        return 6

    def falls(self) -> bool:
        """They are."""
        return True


@dataclass(frozen=True)
class JointedBranch(AbstractBranch):
    """A body carried by an ideal joint: a `JointState` of the joint's freedom."""

    joint: str
    freedom: AbstractFreedom

    def encode(self, parent: BodyPose, body: BodyPose) -> JointState:
        """The relative motion, as far as the joint allows it."""
        here, there = self.freedom.point_child, self.freedom.point_parent
        (turn_parent, first), (turn, second) = parent, body
        displacement = second.components(second.point(here) - first.point(there))
        spin = second.spin - second.components(first.direction(first.spin))
        velocity = second.components(second.velocity_at(here) - first.velocity_at(there))
        slide = velocity - second.spin.cross(displacement)
        orientation = composed(conjugate(turn_parent), turn)
        return self.freedom.encode(Relative(orientation, displacement, Twist(spin, slide)))

    def orientation(self, parent: EulerParameters, state: JointState) -> EulerParameters:
        """The parent's, and then the joint's."""
        return normalised(composed(parent, self.freedom.orientation(state.position)))

    def motion(self, parent: Motion, state: JointState) -> Motion:
        """The parent's motion, and the joint's on top."""
        turn, twist = self.freedom.rotation(state.position), self.freedom.twist(state)
        rotation = parent.rotation.times(turn)
        spin = turn.transposed_times(parent.spin) + twist.turn
        arm = self.freedom.displacement(state.position) - self.freedom.point_child
        point = self.freedom.point_parent
        return Motion(
            parent.point(point) + rotation @ arm,
            rotation,
            parent.velocity_at(point) + rotation @ (spin.cross(arm) + twist.slide),
            spin,
        )

    def link(self, parent: Link | None, state: JointState) -> Link:
        """The root of a tree if the parent is the ground."""
        return jointed_link(parent, self.freedom, state)

    def rates(self, state: JointState, speeds: Speeds, axes: Matrix, gravity: Vector) -> JointState:
        """The position's rates, and the speeds'."""
        return JointState(self.freedom.rates(state), tuple(speeds))

    def moved(self, state: JointState, changes: Speeds) -> JointState:
        """Moved along the freedom."""
        return JointState(self.freedom.moved(state.position, tuple(changes)), state.speeds)

    def kicked(self, state: JointState, changes: Speeds) -> JointState:
        """The speeds changed."""
        speeds = tuple(add(a, b) for a, b in zip(state.speeds, changes, strict=True))
        return JointState(state.position, speeds)

    def count(self, state: JointState) -> int:
        """As many as the joint leaves free."""
        return len(state.speeds)

    def falls(self) -> bool:
        """They are not."""
        return False
