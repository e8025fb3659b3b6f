"""Ideal joints that couple two rotations, or a rotation and a translation.

They are a mesh of gears, a screw, and a universal joint. A joint is defined by its rows: scalar
constraint equations with their derivatives. In joint coordinates, a motion subspace replaces the
rows of a screw or universal joint, unless the joint closes a loop. It describes the motion that the
joint allows one body, the child, relative to the other, the parent. A gear joint keeps its row.
"""

import math
from dataclasses import replace

import equinox as eqx

from ..._fields.checks import (
    require,
    require_axis,
    require_euler_parameters,
    require_numbers,
    require_positive,
    require_shape,
)
from ..._fields.objects import quantity
from ..._fields.types import ArrayLike, Quadruple, Single, Triple
from ..._math.rotations import composed, rotation_matrix, transverse_axes, unit, within_two_turns
from ..._math.smoothing import cosine, polar_angle, sine, where, wrapped
from ..._math.vectors import ZERO, EulerParameters, Scalar, Vector
from ..pen import AbstractPen
from .base import PARALLEL, AbstractConstraint, Motions, Row, require_distinct
from .constraint_rows import angle_about, plus_multiple
from .ideal import AbstractAxisJoint, AbstractPairJoint
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
    """Fixed speed ratio of two gears on a carrier, from their numbers of teeth; one row.

    The carrier is the housing, usually "ground", or the moving arm of an epicyclic gear. The gears
    rotate in opposite senses about axes of the same direction, unless `internal` is set for a ring
    gear or for two pulleys of a belt. For bevel gears the axes may have any directions. The gear
    joint doesn't hold the axes: add revolute joints, ideal or with clearance.

    Angles are taken modulo a tooth, so that the number of revolutions is unlimited: of all meshing
    positions, the gear joint holds the nearest.

    The Lagrange multiplier is the moment on the first gear about its axis in N m. The moments on
    gears and carrier equal those of a real mesh, but the force between the teeth, which loads the
    bearings, is not modelled.

    ```python
    import clearjoint as cj

    gears = cj.GearJoint("ground", "pinion", "wheel", (0, 0, 1), (0, 0, 1), 17, 51)
    ```

    **Arguments:**

    - `carrier`, `first`, `second`: names of the carrier's and the two gears' bodies.
    - `axis_first`, `axis_second`: axis of each gear, (3,) in the carrier's axes, any length.
    - `teeth_first`, `teeth_second`: numbers of teeth, whole and positive; for two pulleys, whole
      numbers in the ratio of their radii.
    - `internal`: whether the gears rotate in the same sense; by default they don't.
    - `offset`: rad, the first gear's angle when the second gear's angle is zero; zero by default.
    - `orientation_first`, `orientation_second`: (4,) Euler parameters, scalar first, that transform
      components in the gear's frame to the carrier's frame at gear angle zero; parallel frames by
      default.

    **Raises:** `ValueError` if two of the bodies are the same, a number of teeth is not whole and
    positive, or an axis, an orientation or the offset is invalid.
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

    def __check_init__(self):
        # Two gears and their carrier are three bodies.
        require_distinct(self.first, self.second)
        remedy, is_name = "name the body that carries the gears", isinstance(self.carrier, str)
        require(is_name, "carrier", self.carrier, "the name of a body", remedy)
        for gear in (self.first, self.second):
            require(self.carrier != gear, "carrier", gear, "another body than the gears", remedy)

    def body_names(self) -> tuple[str, ...]:
        """Return the names of the carrier, the first and the second gear."""
        return self.carrier, self.first, self.second

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return the row "mesh": the error of the first gear's angle, rad.

        The error is angle_first + angle_second teeth_second/teeth_first - offset; for an internal
        gear the second term is subtracted. Whole multiples of 2 pi/teeth_first, the angle between
        two teeth of the first gear, are left out, so that the size of the error is at most half
        this angle.
        """

        def angle(gear: str, axis: Vector, orientation: EulerParameters) -> Row:
            names, carrier = (self.carrier, gear), motions[self.carrier]
            return angle_about(names, carrier, motions[gear], axis, orientation)

        first = angle(self.first, self.axis_first, self.orientation_first)
        second = angle(self.second, self.axis_second, self.orientation_second)
        # External gears rotate in opposite senses: their angles, times their teeth, add up to zero.
        ratio = self.teeth_second / self.teeth_first
        mesh = plus_multiple(first, second, -ratio if self.internal else ratio)
        # The angles are known only up to whole revolutions. A revolution of either gear changes the
        # error by a whole number of teeth.
        tooth = 2.0 * math.pi / self.teeth_first
        return {"mesh": replace(mesh, value=wrapped(mesh.value - self.offset, tooth))}


class ScrewMotion(AbstractTurning):
    """Rotation by an angle about an axis, with a proportional advance along the axis.

    It is the motion that a `ScrewJoint` allows a child body relative to its parent body. The
    position is the angle, rad; its rate is the only speed. The angle counts all revolutions,
    because the advance depends on it.

    - `point_parent`, `point_child`: points of the joint, m from each body's centre of mass in its
      axes.
    - `axis`: unit vector in the child's axes.
    - `reference`: Euler parameters that transform the child's components to the parent's at angle
      zero.
    - `pitch`: advance per angle, m/rad.
    """

    pitch: Scalar

    def encode(self, relative: Relative) -> JointState:
        """Return the angle, rad, and its rate, rad/s, for a relative motion of the child.

        The orientation gives the angle up to whole revolutions, and the advance along the axis
        gives the number of revolutions.
        """
        angle, rate = self.angle(relative), relative.twist.angular.dot(self.axis)
        angle_by_advance = relative.displacement.dot(self.axis) / self.pitch
        error = wrapped(angle_by_advance - angle, 2.0 * math.pi)
        return JointState(angle_by_advance - error, (rate,))

    def displacement(self, position: Scalar) -> Vector:
        """Return the vector from the parent's point to the child's, m in the child's axes."""
        return self.axis * (self.pitch * position)

    def columns(self, position: Scalar) -> tuple[Twist, ...]:
        """Return the relative motion for a speed of 1 rad/s, in the child's axes.

        It is a rotation about the axis and the advance along it.
        """
        return (Twist(self.axis, self.axis * self.pitch),)


def shortest_rotation(first: Vector, second: Vector) -> EulerParameters:
    """Return Euler parameters of the shortest rotation that turns the second unit vector into the
    first.

    Their norm need not be 1. The vectors must not be opposite.
    """
    vector = second.cross(first)
    return EulerParameters(1.0 + first.dot(second), vector.x, vector.y, vector.z)


def _require_lead(argument: str, value: ArrayLike) -> None:
    require_shape(argument, value, (), "pass a single number in m")
    remedy = "give the advance per revolution in m; use a RevoluteJoint for no advance"
    require_numbers(lambda lead: lead != 0.0, argument, (value,), "other than zero", remedy)


class ScrewJoint(AbstractAxisJoint):
    r"""Couples rotation about an axis with an advance along it; five rows.

    $$a = \frac{g}{1 + \frac{J}{m} \left(\frac{2 \pi}{l}\right)^2}$$

    The equation gives the acceleration a of a nut of mass m and moment of inertia J that descends
    under gravity g, without friction, on a fixed vertical screw of lead l.

    The advance is taken modulo the lead, so that the number of revolutions is unlimited. The
    advances that belong to an angle differ by multiples of the lead: the joint holds the nearest.

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `point_first`, `point_second`: a point of the axis on each body, (3,) m from the centre of
      mass in body axes. The two points coincide at angle zero.
    - `axis_first`, `axis_second`: direction of the axis on each body, (3,) in body axes, any
      length. At angle zero, the bodies' frames differ by the shortest rotation that makes the two
      directions parallel.
    - `lead`: advance of the second body per revolution, m, positive for a right-handed thread and
      negative for a left-handed one.

    **Raises:** `ValueError` if the bodies are the same, the lead is zero or not finite, or a point
    or axis is invalid.

    >>> axes = (0, 0, 1), (0, 0, 1)
    >>> joint = cj.ScrewJoint("ground", "arm", (0, 0, 0), (0, 0, 0), *axes, lead=5e-3)
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['offset 1', 'offset 2', 'tilt 1', 'tilt 2', 'thread']
    """

    lead: Single = quantity("m", check=_require_lead)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return five rows: the position across the axis, the tilts, and the thread.

        "offset 1" and "offset 2" are the second point's coordinates perpendicular to the first
        body's axis, m. "tilt 1" and "tilt 2" are the cosines of the angles between the first body's
        axis and two directions across the second body's axis. "thread" is the error of the advance,
        m.
        """
        cylindrical = self._point_on_line(motions, self.axis_first) | self._tilts(motions)
        return cylindrical | {"thread": self._thread(motions)}

    def _thread(self, motions: Motions) -> Row:
        """Return the row of the error of the advance, m.

        The error is advance - lead * angle/(2 pi), where `angle` is the second body's rotation
        about the axis. Whole multiples of the lead are left out, so that the size of the error is
        at most half that of the lead.
        """
        advance = self._in_plane(motions, unit(self.axis_first))
        angle, factor = self.relative_angle(motions), self.lead * (-0.5 / math.pi)
        row = plus_multiple(advance, angle, factor)
        return replace(row, value=wrapped(row.value, self.lead))

    def motion_subspace(self, parent: str) -> ScrewMotion:
        """Return the subspace of rotation about the axis with its advance along the axis."""
        first, second = unit(self.axis_first), unit(self.axis_second)
        # Opposite axes have no shortest rotation: reverse the second one, as in `relative_angle`.
        second = second * where(first.dot(second) < 0.0, -1.0, 1.0)
        in_parent, in_child = self._ordered(parent, first, second)
        pitch = self.lead * (0.5 / math.pi)
        reference = shortest_rotation(in_parent, in_child)
        return ScrewMotion(*self._points(parent), in_child, reference, pitch)

    def draw(self, pen: AbstractPen) -> None:
        """Draw a sleeve on a rail."""
        pen.slide(*self.ends(self.axis_first, self.axis_second), turning=True)


Angles = tuple[Scalar, Scalar]
"""Angle of the cross about the arm fixed to the parent, and angle of the child about the other arm,
rad."""


class UniversalMotion(AbstractMotionAtPoints):
    """Rotation by two angles (rad) about the arms of a universal joint's cross.

    It is the motion that a `UniversalJoint` allows a child body relative to its parent body. The
    cross rotates in the parent about one arm, and the child rotates about the other arm, which is
    perpendicular to the first. The position consists of the two angles; the speeds are their rates,
    rad/s.

    - `point_parent`, `point_child`: points of the joint, m from each body's centre of mass in its
      axes.
    - `arm_parent`, `arm_child`: arms of the cross, a unit vector fixed to each body, in its axes.
    """

    arm_parent: Vector
    arm_child: Vector

    def _reference(self) -> EulerParameters:
        """Return the Euler parameters that transform components in the child's axes to the parent's
        if both angles are zero.

        At zero angles, the child's arm has the direction of the first of two unit vectors across
        the parent's arm (`transverse_axes`).
        """
        return aligning(transverse_axes(self.arm_parent)[0], self.arm_child)

    def _about_child(self, reference: EulerParameters) -> Hinge:
        """Return the subspace of the child's rotation about its arm.

        `reference` is the orientation at which the second angle is zero, as Euler parameters that
        transform components in the child's axes to the parent's.
        """
        return Hinge(self.point_parent, self.point_child, self.arm_child, reference)

    def _parents_arm(self, angle: Scalar) -> tuple[Vector, Vector]:
        """Return the arm that is fixed to the parent, a unit vector in the child's axes, and its
        derivative by `angle`, 1/rad.

        `angle` is the second angle of the position, rad, about the child's arm.
        """
        start = rotation_matrix(self._reference()).transposed_times(self.arm_parent)
        quarter = self.arm_child.cross(start)
        c, s = cosine(angle), sine(angle)
        return start * c - quarter * s, -(start * s + quarter * c)

    def encode(self, relative: Relative) -> JointState:
        """Return both angles and their rates, rad/s, for a relative motion of the child.

        The first angle is in [-pi, pi], rad, the second in [-2 pi, 2 pi].
        """
        start, quarter = transverse_axes(self.arm_parent)
        arm = rotation_matrix(relative.orientation) @ self.arm_child
        # The child's arm rotates with the cross about the parent's arm, which gives the first
        # angle. What remains of the orientation is the rotation about the child's arm.
        first = polar_angle(arm.dot(quarter), arm.dot(start))
        reference = composed(rotation_about(self.arm_parent, first), self._reference())
        second = self._about_child(reference).encode(relative)
        # The relative spin is the sum of the arms, each times the rate of the angle about it. The
        # arms are perpendicular, so that the scalar product of spin and arm is this rate.
        along, _ = self._parents_arm(second.position)
        rate = relative.twist.angular.dot(along)
        return JointState((first, second.position), (rate, *second.speeds))

    def orientation(self, position: Angles) -> EulerParameters:
        """Return Euler parameters that transform components in the child's axes to the parent's."""
        about_parent = rotation_about(self.arm_parent, position[0])
        reference = composed(about_parent, self._reference())
        return self._about_child(reference).orientation(position[1])

    def columns(self, position: Angles) -> tuple[Twist, ...]:
        """Return the rotations about the two arms at 1 rad/s, in the child's axes."""
        return Twist(self._parents_arm(position[1])[0], ZERO), Twist(self.arm_child, ZERO)

    def bias(self, state: JointState) -> Twist:
        """Return the rate of the relative twist at constant speeds, in the child's axes.

        Its unit is rad/s^2 and m/s^2. It isn't zero, because the parent's arm rotates as seen from
        the child.
        """
        _, change = self._parents_arm(state.position[1])
        return Twist(change * (state.speeds[0] * state.speeds[1]), ZERO)

    def without_drift(self, position: Angles) -> Angles:
        """Return the angles less multiples of 4 pi, within [-2 pi, 2 pi]."""
        return within_two_turns(position[0]), within_two_turns(position[1])


class UniversalJoint(AbstractPairJoint):
    r"""A Hooke or Cardan joint: keeps two points together and two axes perpendicular; four rows.

    $$\frac{\omega_2}{\omega_1} = \frac{\cos \beta}{1 - \sin^2 \beta \cos^2 \theta}$$

    The axes are the arms of a massless cross. The equation is the ratio of the speeds omega of two
    shafts that enclose the angle beta. Here theta is the first shaft's angle of rotation, zero
    where its arm lies in the plane of the shafts (C. E. Wilson, J. P. Sadler, Kinematics and
    Dynamics of Machinery, 1993).

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `point_first`, `point_second`: centre of the cross on each body, (3,) m from the centre of
      mass in body axes.
    - `axis_first`, `axis_second`: arm of the cross on each body, (3,) in body axes, any length.

    **Raises:** `ValueError` if the bodies are the same, or a point or axis is invalid.

    >>> joint = cj.UniversalJoint("ground", "arm", (0, 0, 0), (0, 0, 0), (0, 0, 1), (1, 0, 0))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['translation x', 'translation y', 'translation z', 'cross']
    """

    axis_first: Triple = quantity("1", check=require_axis)
    axis_second: Triple = quantity("1", check=require_axis)

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """Return three components of the vector between the two points, m, and "cross", the cosine
        of the angle between the arms."""
        arms = self._perpendicular(motions, unit(self.axis_first), unit(self.axis_second))
        return self._coincidence(motions) | {"cross": arms}

    def motion_subspace(self, parent: str) -> UniversalMotion:
        """Return the subspace of rotation about the two arms of the cross."""
        arms = self._ordered(parent, unit(self.axis_first), unit(self.axis_second))
        return UniversalMotion(*self._points(parent), *arms)

    def draw(self, pen: AbstractPen) -> None:
        """Draw a cross."""
        pen.cross(*self.ends(self.axis_first, self.axis_second))
