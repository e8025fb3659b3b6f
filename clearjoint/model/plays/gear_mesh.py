"""Where two gears mesh: the line of their centres, and the involute of their teeth."""

from dataclasses import dataclass

from ...math.functions import polar_angle
from ...math.rotations import transverse_axes, unit
from ...math.smoothing import norm_and_direction
from ...math.vectors import Scalar, Vector, square_root
from ..bodies import Motion


def involute(sine: Scalar, cosine: Scalar) -> Scalar:
    """inv(alpha) = tan(alpha) - alpha, by sine and cosine of an acute angle."""
    return sine / cosine - polar_angle(sine, cosine)


def sine_of(cosine: Scalar) -> Scalar:
    """The sine of an acute angle by its cosine."""
    return square_root(1.0 - cosine * cosine)


@dataclass(frozen=True)
class LineOfCentres:
    """From the first gear's centre to the second's, seen along the first one's `axis`.

    `along` and `across`, with the axis, are right-handed unit vectors in global axes; `distance`
    and the second gear's `height` along the axis are in m.
    """

    axis: Vector
    along: Vector
    across: Vector
    distance: Scalar
    height: Scalar

    @staticmethod
    def between(
        first: Motion, second: Motion, centre_first: Vector, centre_second: Vector, axis: Vector
    ) -> "LineOfCentres":
        """That of gears with centres in m and an axis of the first, in body axes."""
        axis = first.direction(unit(axis))
        apart = second.point(centre_second) - first.point(centre_first)
        height = apart.dot(axis)
        distance, along = norm_and_direction(apart - axis * height)
        return LineOfCentres(axis, along, axis.cross(along), distance, height)

    def angle_in(self, gear: Motion, axis: Vector) -> Scalar:
        """The line's angle, rad within (-pi, pi], about a gear's axis, given in its body axes, from
        the first of the `transverse_axes`."""
        start, quarter = transverse_axes(unit(axis))
        line = gear.components(self.along)
        return polar_angle(line.dot(quarter), line.dot(start))
