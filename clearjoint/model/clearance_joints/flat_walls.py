"""A flat wall of one body, in contact with corners and pins of another."""

from dataclasses import dataclass

from ...math.vectors import Scalar, Vector, subtract
from ..bodies import Motion
from ..contact.gap import Gap, slip_velocity
from ..joints.base import Contact


@dataclass(frozen=True)
class FlatWall:
    """A plane of the first body that limits motion along its `normal`.

    `origin`, m, and `normal`, a unit vector, are in the first body's axes. A round part of the
    second body touches the wall when its centre is a distance `room`, m, from the origin along the
    normal.
    """

    origin: Vector
    normal: Vector
    room: Scalar

    def contact(
        self, first: Motion, second: Motion, centre: Vector, radius: Scalar, has_friction: bool
    ) -> Contact:
        """Return the contact of a cylinder or sphere of the second body with the wall.

        **Arguments:** `centre`: m, in the second body's axes. `radius`: m, 0.0 for a corner.
        """
        normal = first.direction(self.normal)
        apart = second.point(centre) - first.point(self.origin)
        depth = subtract(apart.dot(normal), self.room)
        centre_in_first = self.origin + first.components(apart)
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
