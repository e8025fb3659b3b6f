"""Ideal joints: points, lines or planes of two bodies kept together, a screw, and a massless rod.

Equation numbers are those of P. Flores, J. Ambrosio, J. C. P. Claro, H. M. Lankarani, Spatial
revolute joints with clearances for dynamic analysis of multi-body systems, 2006.
"""

import abc
import math
from dataclasses import replace
from typing import TypeAlias, TypeVar

import equinox as eqx
from typing_extensions import override

from ..._fields.checks import require_axis, require_euler_parameters, require_numbers, require_shape
from ..._fields.objects import optional_quantity, quantity
from ..._fields.types import ArrayLike, Quadruple, Single, Triple
from ..._math.rotations import conjugate, rotation_matrix, transverse_axes, unit
from ..._math.smoothing import wrapped
from ..._math.vectors import UNIT_X, UNIT_Y, UNIT_Z, EulerParameters, Scalar, Vector
from ..pen import AbstractPen
from .base import PARALLEL, AbstractConstraint, AbstractPairAtPoints, Motions, Row
from .constraint_rows import (
    coincident_points,
    distance_row,
    perpendicular,
    plus_multiple,
    point_in_plane,
    relative_angle_row,
    reversed_if_opposite,
)
from .motion_subspaces import (
    Ball,
    Hinge,
    PlanarMotion,
    ScrewMotion,
    Slider,
    UniversalMotion,
    Weld,
    aligning,
)

T = TypeVar("T")


class AbstractPairJoint(AbstractPairAtPoints, AbstractConstraint):
    """Base class of ideal joints between points of two bodies, with methods for their rows."""

    def _ordered(self, parent: str, of_first: T, of_second: T) -> tuple[T, T]:
        """Return two values, one of each body, in the order parent, child."""
        return (of_first, of_second) if parent == self.first else (of_second, of_first)

    def _points(self, parent: str) -> tuple[Vector, Vector]:
        return self._ordered(parent, self.point_first, self.point_second)

    def _coincidence(self, motions: Motions) -> dict[str, Row]:
        """Return three rows: the components of the vector from the second point to the first, m."""
        return coincident_points(*self._between(motions), self.point_first, self.point_second)

    def _perpendicular(self, motions: Motions, a: Vector, b: Vector) -> Row:
        return perpendicular(*self._between(motions), a, b)

    def _in_plane(self, motions: Motions, normal: Vector) -> Row:
        """Return the row of the distance, m, from the first point to the second along `normal`, a
        unit vector in the first body's axes."""
        points = self.point_first, normal, self.point_second
        return point_in_plane(*self._between(motions), *points)

    def _height(self, motions: Motions, normal: Vector) -> dict[str, Row]:
        return {"height": self._in_plane(motions, unit(normal))}

    def _point_on_line(self, motions: Motions, axis: Vector) -> dict[str, Row]:
        """Return the rows of the second point's distances, m, along two directions across `axis`,
        from the line through the first point along `axis`, which is in the first body's axes."""
        across = transverse_axes(unit(axis))
        return {f"offset {k}": self._in_plane(motions, a) for k, a in enumerate(across, 1)}


class AbstractOrientedJoint(AbstractPairJoint):
    """Base class of ideal joints that hold the second body at an `orientation` in the first, (4,)
    Euler parameters, scalar first, that transform components in the second body's frame to the
    first's. Its rows are also zero at a few other orientations, such as after half a revolution
    about one of the axes, which `assemble` and the check of an initial state refuse."""

    orientation: eqx.AbstractVar[Quadruple]  # pyright: ignore[reportGeneralTypeIssues]

    def _same_orientation(self, motions: Motions) -> dict[str, Row]:
        """Return three rows that hold the second body at `orientation` in the first."""
        relative = rotation_matrix(self.orientation)
        # `transposed_times` gives the axes of the frame on the second body that is parallel to the
        # first body's frame at this orientation. Parallel frames have y perpendicular to z, z to x,
        # and x to y. A small rotation about x changes only the first of these products, and so on.
        return {
            label: self._perpendicular(motions, a, relative.transposed_times(b))
            for label, a, b in (
                ("rotation x", UNIT_Y, UNIT_Z),
                ("rotation y", UNIT_Z, UNIT_X),
                ("rotation z", UNIT_X, UNIT_Y),
            )
        }

    def _child_to_parent(self, parent: str) -> EulerParameters:
        # The inverse of `orientation` if the second body is the parent.
        return self._ordered(parent, self.orientation, conjugate(self.orientation))[0]


class AbstractDriveableJoint(AbstractPairJoint):
    """Base class of ideal joints with one degree of freedom. The `armature` of a drive adds the
    kinetic energy armature q'^2/2, with the rate q' of the joint's `position`: it is the rotor's
    moment of inertia, kg m^2 (its mass, kg, for a translation), times the square of the gear ratio,
    or ``None`` for no drive."""

    armature: eqx.AbstractVar[Single | None]  # pyright: ignore[reportGeneralTypeIssues]

    @abc.abstractmethod
    def position(self, motions: Motions) -> Row:
        """Return the position of the second body relative to the first, rad or m, as a `Row`."""


class AbstractAxisJoint(AbstractPairJoint):
    """Base class of ideal joints that keep an axis of one body parallel to an axis of another.
    `axis_first` and `axis_second` are the axes, (3,) in each body's axes, any length."""

    axis_first: Triple = quantity("1", check=require_axis)
    axis_second: Triple = quantity("1", check=require_axis)

    def _tilts(self, motions: Motions) -> dict[str, Row]:
        """Return rows of the cosines between the first axis and the second's `transverse_axes`."""
        axis, across = unit(self.axis_first), transverse_axes(unit(self.axis_second))
        return {f"tilt {k}": self._perpendicular(motions, axis, a) for k, a in enumerate(across, 1)}

    def relative_angle(self, motions: Motions) -> Row:
        """Return the second body's angle about the first's axis, rad in [-pi, pi], as a `Row`. It
        is zero after the shortest rotation from parallel frames that makes the axes parallel, or
        antiparallel if the axes enclose more than 170 degrees in parallel frames."""
        return relative_angle_row(*self._between(motions), self.axis_first, self.axis_second)

    @override
    def draw(self, pen: AbstractPen) -> None:
        pen.slide(*self.ends(self.axis_first, self.axis_second), turning=True)


class SphericalJoint(AbstractPairJoint):
    """Keeps two points together; three constraints (Flores et al. 2006, eq. 25).

    **Arguments:** `point_first`, `point_second`: the joint's point on each body, (3,) m from its
    centre of mass in its axes.

    >>> joint = cj.SphericalJoint("ground", "arm", (0, 0, 0), (-0.5, 0, 0))
    >>> rows = extend.unpack(joint).rows(motions, 0.0)
    >>> {name: float(row.value) for name, row in rows.items()}  # m, components of the distance
    {'translation x': 0.5, 'translation y': 0.0, 'translation z': 0.0}
    """

    @override
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        return self._coincidence(motions)

    @override
    def motion_subspace(self, parent: str) -> Ball:
        return Ball(*self._points(parent))

    @override
    def draw(self, pen: AbstractPen) -> None:
        pen.ball(*self.ends())


class RevoluteJoint(AbstractAxisJoint, AbstractDriveableJoint):
    """Keeps two points together and two axes parallel: a hinge; five constraints.

    A state with opposite axes satisfies the constraints too, but can only be simulated in
    `AbsoluteCoordinates`.

    **Arguments:**

    - `point_first`, `point_second`: on each body, (3,) m from its centre of mass in its axes.
    - `axis_first`, `axis_second`: the axis of rotation on each body, (3,) in its axes, any length.
    - `armature`: kg m^2, moment of inertia of a drive's rotor times the square of its gear ratio;
      none by default. It adds the kinetic energy armature speed^2/2.

    >>> joint = cj.RevoluteJoint("ground", "arm", (0, 0, 0), (0, 0, 0), (0, 0, 1), (0, 0, 1))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['translation x', 'translation y', 'translation z', 'tilt 1', 'tilt 2']
    """

    armature: Single | None = optional_quantity(
        "kg m^2", positive=True, remedy="give it in kg m^2, or None for none"
    )

    @override
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        return self._coincidence(motions) | self._tilts(motions)

    @override
    def position(self, motions: Motions) -> Row:
        return self.relative_angle(motions)

    @override
    def motion_subspace(self, parent: str) -> Hinge:
        in_parent, in_child = self._ordered(parent, unit(self.axis_first), unit(self.axis_second))
        return Hinge(*self._points(parent), in_child, aligning(in_parent, in_child))

    @override
    def draw(self, pen: AbstractPen) -> None:
        pen.pin(*self.ends(self.axis_first, self.axis_second))


class FixedJoint(AbstractOrientedJoint):
    """Holds two bodies rigidly together; six constraints.

    **Arguments:** `point_first`, `point_second`: the joint's point on each body, (3,) m from its
    centre of mass in its axes. `orientation`: (4,) Euler parameters, scalar first, that transform
    components in the second body's frame to the first body's frame; parallel frames by default.

    >>> joint = cj.FixedJoint("ground", "arm", (0, 0, 0), (0, 0, 0))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['translation x', 'translation y', 'translation z', 'rotation x', 'rotation y', 'rotation z']
    """

    orientation: Quadruple = quantity("1", check=require_euler_parameters, default=PARALLEL)

    @override
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        return self._coincidence(motions) | self._same_orientation(motions)

    @override
    def motion_subspace(self, parent: str) -> Weld:
        return Weld(*self._points(parent), self._child_to_parent(parent))

    @override
    def draw(self, pen: AbstractPen) -> None:
        pen.weld(*self.ends())


class InlineJoint(AbstractPairJoint):
    """Keeps a point of the second body on a line of the first; two constraints.

    Choose it as a pin of a planar mechanism whose other joints hold the bodies in the plane: with
    an axis perpendicular to the plane, no constraint is redundant.

    **Arguments:** `point_first`, `point_second`: a point of the line, and the point that stays on
    it, (3,) m from each body's centre of mass in its axes. `axis`: direction of the line, (3,) in
    the first body's axes, any length.

    >>> joint = cj.InlineJoint("ground", "arm", (0, 0, 0), (0, 0, 0), axis=(1, 0, 0))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['offset 1', 'offset 2']
    """

    axis: Triple = quantity("1", check=require_axis)

    @override
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        return self._point_on_line(motions, self.axis)

    @override
    def draw(self, pen: AbstractPen) -> None:
        pen.slide(*self.ends(self.axis), turning=True)


class CylindricalJoint(AbstractAxisJoint):
    """Allows rotation about a common axis and sliding along it; four constraints.

    **Arguments:** `point_first`, `point_second`: a point of the axis on each body, (3,) m from its
    centre of mass in its axes. `axis_first`, `axis_second`: the axis on each body, (3,) in its
    axes, any length.

    >>> joint = cj.CylindricalJoint("ground", "arm", (0, 0, 0), (0, 0, 0), (0, 0, 1), (0, 0, 1))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['offset 1', 'offset 2', 'tilt 1', 'tilt 2']
    """

    @override
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        return self._point_on_line(motions, self.axis_first) | self._tilts(motions)


class PrismaticJoint(AbstractOrientedJoint, AbstractDriveableJoint):
    """Allows sliding along an axis of the first body without rotation; five constraints.

    **Arguments:**

    - `point_first`, `point_second`: a point of the line of sliding, and the point that stays on it,
      (3,) m from each body's centre of mass in its axes.
    - `axis`: direction of sliding, (3,) in the first body's axes, any length.
    - `orientation`: (4,) Euler parameters, scalar first, that transform components in the second
      body's frame to the first body's frame; parallel frames by default.
    - `armature`: kg, mass of a drive's rotor, or its moment of inertia times the square of its
      turns per metre, rad/m; none by default. It adds the kinetic energy armature speed^2/2.

    >>> joint = cj.PrismaticJoint("ground", "arm", (0, 0, 0), (0, 0, 0), axis=(1, 0, 0))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['offset 1', 'offset 2', 'rotation x', 'rotation y', 'rotation z']
    """

    axis: Triple = quantity("1", check=require_axis)
    orientation: Quadruple = quantity("1", check=require_euler_parameters, default=PARALLEL)
    armature: Single | None = optional_quantity(
        "kg", positive=True, remedy="give it in kg, or None for none"
    )

    @override
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        rotations = self._same_orientation(motions)
        return self._point_on_line(motions, self.axis) | rotations

    @override
    def position(self, motions: Motions) -> Row:
        return self._in_plane(motions, unit(self.axis))

    @override
    def motion_subspace(self, parent: str) -> Slider:
        orientation, axis = self._child_to_parent(parent), unit(self.axis)
        in_second = rotation_matrix(self.orientation).transposed_times(axis)
        _, in_child = self._ordered(parent, axis, in_second)
        return Slider(*self._points(parent), in_child, orientation)

    @override
    def draw(self, pen: AbstractPen) -> None:
        pen.slide(*self.ends(self.axis), turning=False)


class DistanceJoint(AbstractPairJoint):
    """A massless rod between a point of one body and a point of another; one constraint.

    The Lagrange multiplier is the force in the rod in N, positive in compression.

    **Arguments:** `point_first`, `point_second`: the end of the rod on each body, (3,) m from its
    centre of mass in its axes. `length`: length of the rod, m, positive.

    >>> rod = cj.DistanceJoint("ground", "arm", (0, 0, 0), (0.5, 0, 0), length=0.5)
    >>> rows = extend.unpack(rod).rows(motions, 0.0)
    >>> {name: float(row.value) for name, row in rows.items()}
    {'length': 0.0}
    """

    length: Single = quantity("m", shape=(), positive=True, remedy="give the rod's length in m")

    @override
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        apart = self._coincidence(motions).values()
        return {"length": distance_row(apart, self.length, motions)}

    @override
    def draw(self, pen: AbstractPen) -> None:
        pen.rod(*self.ends())


class PointInPlaneJoint(AbstractPairJoint):
    """Keeps a point of the second body in a plane of the first; one constraint.

    Choose it for a pin in a slot without clearance, with walls parallel to the plane.

    **Arguments:** `point_first`, `point_second`: a point of the plane, and the point that stays in
    it, (3,) m from each body's centre of mass in its axes. `normal`: normal of the plane, (3,) in
    the first body's axes, any length.

    >>> joint = cj.PointInPlaneJoint("ground", "arm", (0, 0, 0), (0, 0.1, 0), normal=(0, 1, 0))
    >>> rows = extend.unpack(joint).rows(motions, 0.0)
    >>> {name: float(row.value) for name, row in rows.items()}  # m off the plane
    {'height': 0.1}
    """

    normal: Triple = quantity("1", check=require_axis)

    @override
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        return self._height(motions, self.normal)

    @override
    def draw(self, pen: AbstractPen) -> None:
        pen.plane(*self.ends(self.normal))


class LineInPlaneJoint(AbstractPairJoint):
    """Keeps a line of the second body in a plane of the first; two constraints.

    Choose it for a slider that slides freely, without clearance, between two walls.

    **Arguments:**

    - `point_first`, `point_second`: a point of the plane, and one of the line, (3,) m from each
      body's centre of mass in its axes.
    - `normal`: normal of the plane, (3,) in the first body's axes, any length.
    - `axis`: direction of the line, (3,) in the second body's axes, any length.

    >>> points = (0, 0, 0), (0, 0, 0)
    >>> joint = cj.LineInPlaneJoint("ground", "arm", *points, normal=(0, 1, 0), axis=(1, 0, 0))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['height', 'tilt']
    """

    normal: Triple = quantity("1", check=require_axis)
    axis: Triple = quantity("1", check=require_axis)

    @override
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        tilt = self._perpendicular(motions, unit(self.normal), unit(self.axis))
        return self._height(motions, self.normal) | {"tilt": tilt}

    @override
    def draw(self, pen: AbstractPen) -> None:
        pen.plane(*self.ends(self.normal))


class PlanarJoint(AbstractAxisJoint):
    """Allows sliding in a plane and rotation about its normal; three constraints.

    A state with opposite normals satisfies the constraints too, but can only be simulated in
    `AbsoluteCoordinates`.

    **Arguments:** `point_first`, `point_second`: a point of the plane on each body, (3,) m from its
    centre of mass in its axes. `axis_first`, `axis_second`: the plane's normal on each body, (3,)
    in its axes, any length.

    >>> joint = cj.PlanarJoint("ground", "arm", (0, 0, 0), (0, 0, 0), (0, 0, 1), (0, 0, 1))
    >>> list(extend.unpack(joint).rows(motions, 0.0))  # each has a multiplier
    ['height', 'tilt 1', 'tilt 2']
    """

    @override
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        return self._height(motions, self.axis_first) | self._tilts(motions)

    @override
    def motion_subspace(self, parent: str) -> PlanarMotion:
        normals = self._ordered(parent, unit(self.axis_first), unit(self.axis_second))
        return PlanarMotion(*self._points(parent), normals[1], aligning(*normals), normals[0])

    @override
    def draw(self, pen: AbstractPen) -> None:
        pen.plane(*self.ends(self.axis_first, self.axis_second))


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
"""A hinge or a slider."""
