"""Constraints that couple rotations of gears, and positions of any two hinges or sliders."""

import math
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
from typing_extensions import override

from ..._fields.checks import (
    require,
    require_axis,
    require_euler_parameters,
    require_numbers,
    require_positive,
    require_type,
)
from ..._fields.objects import quantity
from ..._fields.types import ArrayLike, Quadruple, Single, Triple
from ..._math.smoothing import TURN, wrapped
from ..._math.vectors import EulerParameters, Scalar, Vector
from ..drives.functions_of_time import FunctionOfTime, as_function_of_time, require_continuous
from .base import PARALLEL, AbstractConstraint, Motions, Row, require_distinct
from .constraint_rows import (
    angle_about,
    plus_multiple,
    row_rate,
    slope_and_curvature,
)
from .ideal import HingeOrSlider, PrismaticJoint, RevoluteJoint


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


class JointCoupling(AbstractConstraint):
    """Makes the position of a hinge or slider a function of another's; one constraint.

    Examples are the fingers of a gripper that one motor drives (`mimic` in URDF files), a rack, and
    a cam that drives a follower. The coupling holds neither joint: add both to the scene too. Its
    Lagrange multiplier is the moment (N m) or force (N) on the second body of the follower.

    A hinge's angle is taken between -pi and pi. A hinge as leader may turn further only if the
    `function` has the same value at both ends or, for a hinge as follower, values that differ by
    whole revolutions. Otherwise a run ends there with `RESULTS.not_followed`. For gears of any
    ratio, use `GearJoint`.

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
