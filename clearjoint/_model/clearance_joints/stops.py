"""One-sided contacts: a point, an edge or a sphere against a plane, and two spheres."""

from dataclasses import KW_ONLY

import numpy as np
from typing_extensions import override

from ..._fields.checks import require_axis, require_numbers, require_point
from ..._fields.objects import optional_quantity, quantity
from ..._fields.types import Single, Triple
from ..._math.rotations import unit
from ..._math.smoothing import norm_and_direction
from ..._math.vectors import Scalar, add
from ..contact.friction import FrictionLaw
from ..contact.laws import AbstractContactLaw, Gap, require_flat_law, require_round_law
from ..joints.base import AbstractConstraint, AbstractNamedPair, Contact, Motions
from ..joints.ideal import DistanceJoint, LineInPlaneJoint, PointInPlaneJoint, SphericalJoint
from ..pen import AbstractPen, Marker
from .common import LEAST_TRANSVERSE_LOAD, AbstractFrictionJoint

POINT, END_POINT, BALLS = "point", "end point", "balls"
"""Labels of the contacts of a `Stop` (the second for an edge only) and of a `BallOnBall`."""


class Stop(AbstractNamedPair, AbstractFrictionJoint):
    """A plane of the first body that stops a point, a sphere or an edge of the second body.

    The plane is unbounded and moves with the first body; the wall is behind it, on the side to
    which `normal` does not point. Give `radius` for a sphere, `end_point_second` for a straight
    edge, whose two end points strike the plane independently, and both for a capsule. The contacts
    are called "point" and, for the other end of an edge, "end point".

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `point`: any point of the plane, (3,) m from the first body's centre of mass in its axes; on
      the ground from the origin.
    - `normal`: of the plane, out of the wall, (3,) in the first body's axes, any length.
    - `point_second`: the point that strikes, the centre of the sphere, or one end of the edge, (3,)
      m from the second body's centre of mass in its axes.
    - `end_point_second`: the other end of the edge; ``None``, the default, for a point or sphere.
    - `radius`: m; ``None``, the default, for a point or a sharp edge.
    - `law`: normal law of each contact. For a sphere its stiffness may be a `RavnStiffness`, which
      is then Hertz's for a sphere on a plane; otherwise it must be a number.
    - `friction`: an `AbstractFriction` or an `AbstractBristleFriction`, whose force acts at the
      point of contact; ``None``, the default, for no friction.
    - `thickness`: m, of the wall; deeper penetration ends a run. By default the radius, else 10 mm.

    >>> law = cj.laws.LankaraniNikravesh(0.8, cj.laws.RavnStiffness(207e9, 0.3))
    >>> floor = cj.Stop("ground", "ball", point=(0, 0, 0), normal=(0, 0, 1), radius=0.02, law=law)
    >>> bumper = cj.laws.HuntCrossley(0.5, 1e8)
    >>> edge = cj.Stop("case", "door", normal=(0, 1, 0), law=bumper, end_point_second=(0, 0, 2))
    >>> list(floor.laws()), list(edge.laws())
    (['point'], ['point', 'end point'])
    """

    _: KW_ONLY
    normal: Triple = quantity("1", check=require_axis)
    law: AbstractContactLaw  # pyright: ignore[reportGeneralTypeIssues]
    point: Triple = quantity("m", check=require_point, default=(0.0, 0.0, 0.0))
    point_second: Triple = quantity("m", check=require_point, default=(0.0, 0.0, 0.0))
    end_point_second: Triple | None = optional_quantity("m", shape=(3,), check=require_point)
    radius: Single | None = optional_quantity("m", positive=True)
    friction: FrictionLaw | None = None  # pyright: ignore[reportGeneralTypeIssues]
    thickness: Single | None = optional_quantity("m", positive=True)
    point_fields = {"point": "first", "point_second": "second"}

    @override
    def _check_together(self) -> None:
        if self.radius is None:
            require_flat_law(self.law, "a point and a plane")
        else:
            require_round_law(self.law)
        if self.end_point_second is not None:
            ends = self.end_point_second, self.point_second
            expected, remedy = "another point than `point_second`", "leave it out for a point"
            require_numbers(lambda a, b: (a != b).any(), "end_point_second", ends, expected, remedy)

    @override
    def contact_labels(self) -> tuple[str, ...]:
        return (POINT,) if self.end_point_second is None else (POINT, END_POINT)

    @override
    def contacts(self, motions: Motions) -> dict[str, Contact]:
        # The wall begins where the centre of the sphere is a radius before the plane.
        radius = 0.0 if self.radius is None else self.radius
        into_wall = -unit(self.normal)
        points = {POINT: self.point_second}
        if self.end_point_second is not None:
            points[END_POINT] = self.end_point_second
        return {
            label: self._contact_with_wall(motions, self.point, into_wall, -radius, point, radius)
            for label, point in points.items()
        }

    @override
    def deepest_penetration(self) -> Scalar:
        if self.thickness is not None:
            return self.thickness
        # A point has no size with which to compare the penetration.
        return 0.01 if self.radius is None else self.radius

    @override
    def _gap(self, depth: Scalar, rate: Scalar) -> Gap:
        return Gap(depth, rate, reduced_radius=self.radius)

    @override
    def centred_joint(self) -> AbstractConstraint:
        """Return a joint that keeps the point, sphere or edge on the plane, where it may slide."""
        return self._ideal(0.0)

    @override
    def resting_joint(self, load: np.ndarray) -> AbstractConstraint | None:
        # The load is the force on the first body, which must push into the wall.
        into_wall = -np.asarray(self.normal) / np.linalg.norm(self.normal)
        size = float(load @ into_wall)
        # A load along the plane or out of the wall presses nothing against the wall.
        if not size > LEAST_TRANSVERSE_LOAD * np.linalg.norm(load):
            return None
        return self._ideal(self._resting_depth(size, [*self.laws().values()]))

    def _ideal(self, depth: Scalar) -> AbstractConstraint:
        outward = np.asarray(self.normal) / np.linalg.norm(self.normal)
        height = (0.0 if self.radius is None else self.radius) - depth
        points = self.point + height * outward, self.point_second
        if self.end_point_second is None:
            return PointInPlaneJoint(*self.pair(), *points, self.normal)
        along = np.asarray(self.end_point_second) - np.asarray(self.point_second)
        return LineInPlaneJoint(*self.pair(), *points, self.normal, along)

    @override
    def draw(self, pen: AbstractPen) -> None:
        tips = [Marker(self.second, self.point_second)]
        if self.end_point_second is not None:
            tips.append(Marker(self.second, self.end_point_second))
            pen.rod(*tips)
        radius = 0.0 if self.radius is None else self.radius
        pen.wall(Marker(self.first, self.point, self.normal), tips[0], radius=radius)
        for tip in tips:
            pen.mark(tip) if self.radius is None else pen.sphere(tip, radius=radius)


class BallOnBall(AbstractNamedPair, AbstractFrictionJoint):
    """Two spheres that strike each other from outside.

    The joint has one contact, "balls", along the line of centres. Its penetration is the sum of the
    radii less the distance of the centres.

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `radius_first`, `radius_second`: m.
    - `point_first`, `point_second`: centres, (3,) m from each body's centre of mass in its axes; on
      the ground from the origin.
    - `law`: normal law of the contact. Its stiffness may be a number, or a `RavnStiffness`, which
      is then Hertz's for two spheres.
    - `friction`: an `AbstractFriction` or `AbstractBristleFriction`; by default ``None``, for none.

    >>> law = cj.laws.Hertz(cj.laws.RavnStiffness(207e9, 0.3))
    >>> balls = cj.BallOnBall("left", "right", radius_first=0.02, radius_second=0.03, law=law)
    >>> print(f"{balls.deepest_penetration():.3f} m")
    0.012 m
    """

    _: KW_ONLY
    radius_first: Single = quantity("m", positive=True)
    radius_second: Single = quantity("m", positive=True)
    law: AbstractContactLaw  # pyright: ignore[reportGeneralTypeIssues]
    point_first: Triple = quantity("m", check=require_point, default=(0.0, 0.0, 0.0))
    point_second: Triple = quantity("m", check=require_point, default=(0.0, 0.0, 0.0))
    friction: FrictionLaw | None = None  # pyright: ignore[reportGeneralTypeIssues]
    point_fields = {"point_first": "first", "point_second": "second"}

    @override
    def _check_together(self) -> None:
        require_round_law(self.law)

    @override
    def contact_labels(self) -> tuple[str, ...]:
        return (BALLS,)

    def reduced_radius(self) -> Scalar:
        """Return R1 R2/(R1 + R2), m, of the two radii."""
        return self.radius_first * self.radius_second / add(self.radius_first, self.radius_second)

    @override
    def contacts(self, motions: Motions) -> dict[str, Contact]:
        _, first, second = self._between(motions)
        apart = first.point(self.point_first) - second.point(self.point_second)
        distance, normal = norm_and_direction(apart)
        depth = add(self.radius_first, self.radius_second) - distance
        closing = second.velocity_at(self.point_second) - first.velocity_at(self.point_first)
        gap = self._gap(depth, closing.dot(normal))
        # Friction acts on both bodies at one point, midway between the surfaces.
        shift = 0.5 * depth
        on_first = self.point_first - first.components(normal * (self.radius_first - shift))
        on_second = self.point_second + second.components(normal * (self.radius_second - shift))
        # Without friction the force acts at the two centres, which are on its line of action.
        centres = self.point_first, self.point_second
        return {BALLS: self._contact_at(motions, gap, normal, on_first, on_second, *centres)}

    @override
    def deepest_penetration(self) -> Scalar:
        # No centre is in the other sphere.
        return self.reduced_radius()

    @override
    def _gap(self, depth: Scalar, rate: Scalar) -> Gap:
        return Gap(depth, rate, reduced_radius=self.reduced_radius())

    @override
    def centred_joint(self) -> AbstractConstraint:
        distance = self.radius_first + self.radius_second
        return DistanceJoint(*self.pair(), self.point_first, self.point_second, length=distance)

    @override
    def resting_joint(self, load: np.ndarray) -> AbstractConstraint | None:
        size = float(np.linalg.norm(load))
        # Without a load, no direction of the line of centres is preferred.
        if not size > 0.0:
            return None
        depth = self._resting_depth(size, [self.law])
        # The load pushes the first ball away from the centre of the second.
        away = load * ((self.radius_first + self.radius_second - depth) / size)
        return SphericalJoint(self.first, self.second, self.point_first - away, self.point_second)

    @override
    def draw(self, pen: AbstractPen) -> None:
        pen.sphere(Marker(self.first, self.point_first), radius=self.radius_first)
        pen.sphere(Marker(self.second, self.point_second), radius=self.radius_second)
