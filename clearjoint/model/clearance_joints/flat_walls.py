"""A flat wall of one body, in contact with corners and pins of another."""

from dataclasses import dataclass

from ...math.vectors import Scalar, Vector, subtract
from ..bodies import Motion
from ..contact.gap import Gap, slip_velocity
from ..joints.base import Contact


@dataclass(frozen=True)
class FlatWall:
    """A flat wall of the first body that stops a part of the second body.

    - `origin`: a point in front of the wall, m in the first body's axes.
    - `normal`: unit vector in the first body's axes, from the origin to the wall.
    - `room`: m, distance from the origin along the normal at which the part's centre is when the
      part touches the wall.
    """

    origin: Vector
    normal: Vector
    room: Scalar

    def contact(
        self, first: Motion, second: Motion, centre: Vector, radius: Scalar, has_friction: bool
    ) -> Contact:
        """Return the contact of a cylinder, sphere or corner of the second body with the wall.

        **Arguments:**

        - `first`, `second`: motions of the wall's body and of the part's body.
        - `centre`: of the part, m in the second body's axes.
        - `radius`: of the part, m; 0.0 for a corner.
        - `has_friction`: whether the contact needs a slip.
        """
        normal = first.direction(self.normal)
        apart = second.point(centre) - first.point(self.origin)
        depth = subtract(apart.dot(normal), self.room)
        centre_in_first = self.origin + first.components(apart)
        # Relative to the first body's point at the centre, so that a common rotation doesn't count.
        sliding = second.velocity_at(centre) - first.velocity_at(centre_in_first)
        gap = Gap(depth, sliding.dot(normal))
        # Friction acts on both bodies at one point, midway between the surfaces.
        to_surface = subtract(radius, 0.5 * depth)
        on_first = centre_in_first + self.normal * to_surface
        on_second = centre + second.components(normal * to_surface)
        slip = None
        if has_friction:
            sliding = second.velocity_at(on_second) - first.velocity_at(on_first)
            slip = slip_velocity(sliding, normal, sliding.dot(normal))
        return Contact(gap, normal, on_first, on_second, slip, centre_in_first, centre)
