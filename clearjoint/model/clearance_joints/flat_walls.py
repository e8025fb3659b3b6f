"""A flat wall of one body, which corners and pins of another may touch."""

from dataclasses import dataclass

from ...math.vectors import Scalar, Vector, subtract
from ..bodies import Motion
from ..contact.gap import Gap, slip_velocity
from ..joints.base import Contact


@dataclass(frozen=True)
class FlatWall:
    """A plane of the first body that stops what comes along its `normal`.

    `origin`, m, and `normal`, a unit vector, are in the first body's axes. A round part of the
    second body touches the wall where its centre is by `room`, m, farther along the normal than the
    origin.
    """

    origin: Vector
    normal: Vector
    room: Scalar

    def contact(
        self, first: Motion, second: Motion, centre: Vector, radius: Scalar, has_friction: bool
    ) -> Contact:
        """Contact of a cylinder or sphere of the second body with the wall.

        **Arguments:** `centre`, m, in the second body's axes; `radius`, m, 0.0 of a corner.
        """
        normal = first.direction(self.normal)
        apart = second.point(centre) - first.point(self.origin)
        depth = subtract(apart.dot(normal), self.room)
        beside = self.origin + first.components(apart)
        sliding = second.velocity_at(centre) - first.velocity_at(beside)
        gap = Gap(depth, sliding.dot(normal))
        # Friction acts on both bodies at one point, midway between the surfaces.
        reach = subtract(radius, 0.5 * depth)
        on_first = beside + self.normal * reach
        on_second = centre + second.components(normal * reach)
        slip = None
        if has_friction:
            sliding = second.velocity_at(on_second) - first.velocity_at(on_first)
            slip = slip_velocity(sliding, normal, sliding.dot(normal))
        return Contact(gap, normal, on_first, on_second, slip, beside, centre)
