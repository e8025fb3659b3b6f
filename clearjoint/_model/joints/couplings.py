"""Ideal joints that couple rotations and translations: gears, screw, universal joint, and the
positions of any two hinges or sliders."""

import math
from dataclasses import replace
from typing import TypeAlias

import equinox as eqx
import jax.numpy as jnp
from typing_extensions import override

from ..._fields.checks import (
    require,
    require_axis,
    require_euler_parameters,
    require_numbers,
    require_positive,
    require_shape,
    require_type,
)
from ..._fields.objects import quantity
from ..._fields.types import ArrayLike, Quadruple, Single, Triple
from ..._math.rotations import composed, rotation_matrix, transverse_axes, unit, within_two_turns
from ..._math.smoothing import TURN, cosine, polar_angle, sine, wrapped
from ..._math.vectors import ZERO, EulerParameters, Scalar, Vector
from ..drives.functions_of_time import FunctionOfTime, as_function_of_time, require_continuous
from ..pen import AbstractPen
from .base import PARALLEL, AbstractConstraint, Motions, Row, require_distinct
from .constraint_rows import (
    angle_about,
    plus_multiple,
    reversed_if_opposite,
    row_rate,
    slope_and_curvature,
)
from .ideal import AbstractAxisJoint, AbstractPairJoint, PrismaticJoint, RevoluteJoint
from .motion_subspaces import (
    AbstractMotionAtPoints,
    AbstractTurning,
    Hinge,
    JointState,
    Relative,
    Twist,
    aligning,
    rotation_about,
)


def _require_teeth(argument: str, value: ArrayLike) -> None:
    remedy = "give a whole number of teeth; of two pulleys, whole numbers in their radii's ratio"
    require_positive(argument, value, remedy)
    expected = "a whole number, positive"
    require_numbers(lambda number: number.round() == number, argument, (value,), expected, remedy)


class GearJoint(AbstractConstraint):
    """Fixed speed ratio of two gears on a carrier, from their numbers of teeth; one constraint.

    The carrier is the housing, usually "ground", or the moving arm of an epicyclic gear. The gears
    rotate in opposite senses about axes of the same direction, unless `internal` is set for a ring
    gear or for two pulleys of a belt. For bevel gears the axes may have any directions. The gear
    joint doesn't hold the axes: add revolute joints, ideal or with clearance. Angles are taken
    modulo a tooth, so that the number of revolutions is unlimited: of all meshing positions, the
    gear joint holds the nearest.

    The Lagrange multiplier is the moment on the first gear about its axis in N m. The moments on
    gears and carrier equal those of a real mesh, but the force between the teeth, which loads the
    bearings, is not modelled; `GearBacklash` has it.

    **Arguments:**

    - `carrier`, `first`, `second`: names of the carrier's and the two gears' bodies.
    - `axis_first`, `axis_second`: axis of each gear, (3,) in the carrier's axes, any length.
    - `teeth_first`, `teeth_second`: numbers of teeth, whole and positive; for two pulleys, whole
      numbers in the ratio of their radii.
    - `internal`: whether the gears rotate in the same sense; by default they don't.
    - `offset`: rad, the first gear's angle when the second gear's angle is zero; zero by default.
    - `orientation_first`, `orientation_second`: (4,) Euler parameters, scalar first, that transform
      components in the gear's frame to the carrier's frame at gear angle zero; parallel by default.

    >>> gears = cj.GearJoint("ground", "pinion", "wheel", (0, 0, 1), (0, 0, 1), 17, 51)
    >>> gears.body_names()
    ('ground', 'pinion', 'wheel')
    """

    carrier: str = eqx.field(static=True)
    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    axis_first: Triple = quantity("1", check=require_axis)
    axis_second: Triple = quantity("1", check=require_axis)
    teeth_first: Single = quantity("1", check=_require_teeth)
    teeth_second: Single = quantity("1", check=_require_teeth)
    internal: bool = eqx.field(default=False, static=True)
    offset: Single = quantity("rad", shape=(), default=0.0)
    orientation_first: Quadruple = quantity("1", check=require_euler_parameters, default=PARALLEL)
    orientation_second: Quadruple = quantity("1", check=require_euler_parameters, default=PARALLEL)

    @override
    def __check_init__(self):
        # Two gears and their carrier are three bodies.
        require_distinct(self.first, self.second)
        remedy, is_name = "name the body that carries the gears", isinstance(self.carrier, str)
        require(is_name, "carrier", self.carrier, "the name of a body", remedy)
        for gear in (self.first, self.second):
            require(self.carrier != gear, "carrier", gear, "another body than the gears", remedy)

    @override
    def body_names(self) -> tuple[str, ...]:
        return self.carrier, self.first, self.second

    @override
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return the row "mesh": angle_first + r angle_second - offset, rad, without whole
        multiples of 2 pi/teeth_first, the angle of a tooth; r is teeth_second/teeth_first, negative
        for an internal gear."""

        def angle(gear: str, axis: Vector, orientation: EulerParameters) -> Row:
            names, carrier = (self.carrier, gear), motions[self.carrier]
            return angle_about(names, carrier, motions[gear], axis, orientation)

        angle_first = angle(self.first, self.axis_first, self.orientation_first)
        angle_second = angle(self.second, self.axis_second, self.orientation_second)
        # External gears rotate in opposite senses: their angles, times their teeth, add up to zero.
        ratio = self.teeth_second / self.teeth_first
        mesh = plus_multiple(angle_first, angle_second, -ratio if self.internal else ratio)
        # The angles are known only up to whole revolutions. A revolution of either gear changes the
        # error by a whole number of teeth.
        tooth = TURN / self.teeth_first
        return {"mesh": replace(mesh, value=wrapped(mesh.value - self.offset, tooth))}


class ScrewMotion(AbstractTurning):
    """Rotation about an axis with an advance of `pitch`, m/rad; its angle counts revolutions."""

    pitch: Scalar

    @override
    def encode(self, relative: Relative) -> JointState:
        angle, rate = self.angle(relative), relative.twist.angular.dot(self.axis)
        # The advance determines the number of revolutions, and the orientation the angle up to
        # whole revolutions, exactly.
        angle_by_advance = relative.displacement.dot(self.axis) / self.pitch
        error = wrapped(angle_by_advance - angle, TURN)
        return JointState(angle_by_advance - error, (rate,))

    @override
    def displacement(self, position: Scalar) -> Vector:
        return self.axis * (self.pitch * position)

    @override
    def columns(self, position: Scalar) -> tuple[Twist, ...]:
        return (Twist(self.axis, self.axis * self.pitch),)


def _require_lead(argument: str, value: ArrayLike) -> None:
    require_shape(argument, value, (), "pass a single number in m")
    remedy = "give the advance per revolution in m; use a RevoluteJoint for no advance"
    require_numbers(lambda lead: lead != 0.0, argument, (value,), "other than zero", remedy)


class ScrewJoint(AbstractAxisJoint):
    """Couples rotation about an axis with an advance along it; five constraints.

    The advance is taken modulo the lead, so that the number of revolutions is unlimited: of the
    advances that belong to an angle, the joint holds the nearest.

    **Arguments:**

    - `point_first`, `point_second`: a point of the axis on each body, (3,) m from its centre of
      mass in its axes. The two points coincide at angle zero.
    - `axis_first`, `axis_second`: direction of the axis on each body, (3,) in its axes, any length.
      At angle zero, the bodies' frames differ by the shortest rotation that makes the two
      directions parallel, or opposite if they enclose more than 170 degrees.
    - `lead`: advance of the second body per revolution, m, positive for a right-handed thread and
      negative for a left-handed one.

    >>> axes = (0, 0, 1), (0, 0, 1)
    >>> joint = cj.ScrewJoint("ground", "arm", (0, 0, 0), (0, 0, 0), *axes, lead=5e-3)
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['offset 1', 'offset 2', 'tilt 1', 'tilt 2', 'thread']
    """

    lead: Single = quantity("m", check=_require_lead)

    @override
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        cylindrical = self._point_on_line(motions, self.axis_first) | self._tilts(motions)
        return cylindrical | {"thread": self._thread(motions)}

    def _thread(self, motions: Motions) -> Row:
        """Return the row advance - lead angle/(2 pi), m, without whole multiples of the lead."""
        advance = self._in_plane(motions, unit(self.axis_first))
        angle, factor = self.relative_angle(motions), self.lead * (-0.5 / math.pi)
        row = plus_multiple(advance, angle, factor)
        return replace(row, value=wrapped(row.value, self.lead))

    @override
    def motion_subspace(self, parent: str) -> ScrewMotion:
        first = unit(self.axis_first)
        # Opposite axes define the same screw: as in `relative_angle`, the second is then reversed.
        second = reversed_if_opposite(first, unit(self.axis_second))
        in_parent, in_child = self._ordered(parent, first, second)
        # Euler parameters, of any norm, of the shortest rotation from the child's axis to the
        # parent's.
        shortest = EulerParameters(1.0 + in_parent.dot(in_child), *in_child.cross(in_parent))
        return ScrewMotion(*self._points(parent), in_child, shortest, self.lead * (0.5 / math.pi))

    @override
    def draw(self, pen: AbstractPen) -> None:
        pen.slide(*self.ends(self.axis_first, self.axis_second), turning=True)


Angles = tuple[Scalar, Scalar]
"""Angle of the cross about the arm fixed to the parent, and of the child about the other, rad."""


class UniversalMotion(AbstractMotionAtPoints):
    """Rotation by two angles, rad, about the arms of a universal joint's cross. The cross rotates
    in the parent about `arm_parent`, and the child rotates about `arm_child`, which is
    perpendicular to `arm_parent`; each arm is a unit vector fixed to its body, in its axes."""

    arm_parent: Vector
    arm_child: Vector

    def _reference(self) -> EulerParameters:
        """Return the Euler parameters from the child's axes to the parent's at zero angles."""
        return aligning(transverse_axes(self.arm_parent)[0], self.arm_child)

    def _about_child(self, reference: EulerParameters) -> Hinge:
        return Hinge(self.point_parent, self.point_child, self.arm_child, reference)

    def _parents_arm(self, angle: Scalar) -> tuple[Vector, Vector]:
        """Return `arm_parent` in the child's axes at the second angle, `angle`, rad, and the
        derivative of this vector by this angle."""
        # In the child's axes, the parent's arm rotates backwards about the child's arm.
        start = rotation_matrix(self._reference()).transposed_times(self.arm_parent)
        quarter = self.arm_child.cross(start)
        c, s = cosine(angle), sine(angle)
        return start * c - quarter * s, -(start * s + quarter * c)

    @override
    def encode(self, relative: Relative) -> JointState:
        start, quarter = transverse_axes(self.arm_parent)
        arm = rotation_matrix(relative.orientation) @ self.arm_child
        # The child's arm rotates with the cross about the parent's arm, which gives the first
        # angle. What remains of the orientation is the rotation about the child's arm.
        first_angle = polar_angle(arm.dot(quarter), arm.dot(start))
        reference = composed(rotation_about(self.arm_parent, first_angle), self._reference())
        about_child = self._about_child(reference).encode(relative)
        # The relative spin is the sum of the arms, each times the rate of the angle about it. The
        # arms are perpendicular, so that the scalar product of spin and arm is this rate.
        parents_arm, _ = self._parents_arm(about_child.position)
        first_rate = relative.twist.angular.dot(parents_arm)
        position = first_angle, about_child.position
        return JointState(position, (first_rate, *about_child.speeds))

    @override
    def orientation(self, position: Angles) -> EulerParameters:
        about_parent = rotation_about(self.arm_parent, position[0])
        reference = composed(about_parent, self._reference())
        return self._about_child(reference).orientation(position[1])

    @override
    def columns(self, position: Angles) -> tuple[Twist, ...]:
        return Twist(self._parents_arm(position[1])[0], ZERO), Twist(self.arm_child, ZERO)

    @override
    def bias(self, state: JointState) -> Twist:
        _, change = self._parents_arm(state.position[1])
        return Twist(change * (state.speeds[0] * state.speeds[1]), ZERO)

    @override
    def without_drift(self, position: Angles) -> Angles:
        return within_two_turns(position[0]), within_two_turns(position[1])


class UniversalJoint(AbstractPairJoint):
    r"""A Hooke or Cardan joint: two points together, two axes perpendicular; four constraints.

    $$\frac{\omega_2}{\omega_1} = \frac{\cos \beta}{1 - \sin^2 \beta \cos^2 \theta}$$

    The axes are the arms of a massless cross. The equation is the ratio of the speeds omega of two
    shafts that enclose the angle beta. Here theta is the first shaft's angle of rotation, zero
    where its arm lies in the plane of the shafts (C. E. Wilson, J. P. Sadler, Kinematics and
    Dynamics of Machinery, 1993).

    **Arguments:**

    - `point_first`, `point_second`: centre of the cross on each body, (3,) m from its centre of
      mass in its axes.
    - `axis_first`, `axis_second`: arm of the cross on each body, (3,) in its axes, any length.

    >>> joint = cj.UniversalJoint("ground", "arm", (0, 0, 0), (0, 0, 0), (0, 0, 1), (1, 0, 0))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['translation x', 'translation y', 'translation z', 'cross']
    """

    axis_first: Triple = quantity("1", check=require_axis)
    axis_second: Triple = quantity("1", check=require_axis)

    @override
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        arms = self._perpendicular(motions, unit(self.axis_first), unit(self.axis_second))
        return self._coincidence(motions) | {"cross": arms}

    @override
    def motion_subspace(self, parent: str) -> UniversalMotion:
        arms = self._ordered(parent, unit(self.axis_first), unit(self.axis_second))
        return UniversalMotion(*self._points(parent), *arms)

    @override
    def draw(self, pen: AbstractPen) -> None:
        pen.cross(*self.ends(self.axis_first, self.axis_second))


HingeOrSlider: TypeAlias = RevoluteJoint | PrismaticJoint
"""A joint with one coordinate."""


class JointCoupling(AbstractConstraint):
    """Makes the position of a hinge or slider a function of another's; one constraint.

    Examples are the fingers of a gripper that one motor drives (`mimic` in URDF files), a rack, and
    a cam that drives a follower. The coupling holds neither joint: add both to the scene too. Its
    Lagrange multiplier is the moment (N m) or force (N) on the second body of the follower.

    A leader's angle is taken within half a revolution. Only if the follower is a hinge with a whole
    number of revolutions for each revolution of the leader, the leader may turn further; otherwise
    a run ends there with `RESULTS.not_followed`. For gears of any ratio, use `GearJoint`.

    **Arguments:**

    - `leader`, `follower`: a `RevoluteJoint` or `PrismaticJoint` each, as in the scene. The
      position of a hinge is its angle, as `quantities.JointAngle`, rad; that of a slider is the
      distance from its first to its second point along its axis, m.
    - `function`: the follower's position as a function of the leader's: a `Polynomial` such as
      ``Polynomial((offset, ratio))``, another function as for `PrescribedAngle` with the leader's
      position in place of the time, or a number for a constant. The function must be smooth:
      steps don't end where the leader passes a breakpoint.

    >>> left = cj.PrismaticJoint("ground", "left", (0, 0, 0), (0, 0, 0), axis=(1, 0, 0))
    >>> right = cj.PrismaticJoint("ground", "right", (0, 0, 0), (0, 0, 0), axis=(1, 0, 0))
    >>> gripper = cj.JointCoupling(left, right, cj.Polynomial((0.0, -1.0)))
    >>> gripper.body_names()
    ('ground', 'left', 'right')
    """

    leader: HingeOrSlider
    follower: HingeOrSlider
    function: FunctionOfTime = quantity("1", converter=as_function_of_time)

    @override
    def __check_init__(self):
        expected = "a RevoluteJoint or PrismaticJoint"
        remedy = "pass the joint that is in the scene"
        require_type("leader", self.leader, HingeOrSlider, expected, remedy)
        require_type("follower", self.follower, HingeOrSlider, expected, remedy)
        require_continuous(self.function)

    @override
    def body_names(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((*self.leader.body_names(), *self.follower.body_names())))

    @override
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        leader, follower = (joint.position(motions) for joint in (self.leader, self.follower))
        function = as_function_of_time(self.function)
        # The row is the follower's position minus f of the leader's, x. Its rate contains -f' times
        # the leader's rate, and its second time derivative -f'' times the square of this rate.
        x = jnp.asarray(leader.value, dtype=float)
        slope, curvature = slope_and_curvature(function, x)
        row = plus_multiple(follower, leader, -slope)
        value = self._known(follower.value - function(x))
        bias = row.bias - curvature * row_rate(leader, motions) ** 2
        return {"coupling": replace(row, value=value, bias=bias)}

    def _known(self, difference: Scalar) -> Scalar:
        """Return a difference of positions of the follower, rad or m: for a hinge in [-pi, pi], as
        its angles are known only up to whole revolutions."""
        is_angle = isinstance(self.follower, RevoluteJoint)
        return wrapped(difference, TURN) if is_angle else difference

    def jump(self) -> Scalar:
        """Return by how much the value of the row jumps where the leader's angle passes half a
        revolution, rad or m; zero for a slider."""
        if isinstance(self.leader, PrismaticJoint):
            return 0.0
        function = as_function_of_time(self.function)
        half_turns = (jnp.asarray(angle, dtype=float) for angle in (math.pi, -math.pi))
        at_half_turn, at_minus_half_turn = map(function, half_turns)
        return self._known(at_half_turn - at_minus_half_turn)
