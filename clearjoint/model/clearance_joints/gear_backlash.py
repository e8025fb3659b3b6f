"""Two spur gears with involute teeth and play between them."""

import math
from dataclasses import dataclass

import equinox as eqx

from ...fields.checks import (
    as_shown,
    caution_above,
    checkable,
    concrete,
    require,
    require_axis,
    require_point,
    require_shape,
)
from ...fields.declarations import quantity
from ...fields.types import ArrayLike, Single, Triple
from ...math.functions import cosine, polar_angle, sine, where, wrapped
from ...math.rotations import transverse_axes, unit
from ...math.smoothing import norm_and_direction
from ...math.vectors import ZERO, Scalar, Vector, add, square_root
from ..bodies import Motion
from ..contact.flat_surfaces import require_flat_law
from ..contact.gap import Gap
from ..contact.laws import AbstractContactLaw
from ..contact.limits import Limit
from ..joints.base import AbstractConstraint, AbstractContactJoint, Contact, Motions, Row
from ..joints.constraint_rows import Pose, rows_from_residual
from ..joints.pairs import AbstractPairAtPoints
from ..pen import AbstractPen
from .flanks import FLANKS, SIDE_OF


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


LARGEST_MODULE = 0.1
"""Of teeth, m, beyond which one is warned."""
WIDEST_BACKLASH = 0.2
"""Likewise the backlash over the pitch."""
PRESSURE_ANGLES = 0.1, 0.8
"""rad, least and most."""


def _require_teeth(argument: str, value: ArrayLike) -> None:
    require_shape(argument, value, (), "pass a number of teeth")
    if (known := checkable(value)) is not None:
        (number,) = known
        require(
            (number == number.round()) & (abs(number) >= 1.0),
            argument,
            number,
            "a whole number",
            "count the teeth; those of an internal gear, the second, are negative",
        )


class GearBacklash(AbstractPairAtPoints, AbstractContactJoint):
    r"""Two spur gears in mesh, with backlash between their involute teeth.

    $$\delta = \pm s - (r_1 + r_2) (\mathrm{inv}\, \alpha' - \mathrm{inv}\, \alpha) - \frac{j}{2}
    \cos \alpha$$

    Each flank touches along its line of action, a common tangent of the base circles of radii
    r = m z cos(alpha)/2. With theta the gears' angles from the line of centres, of length a,

        s = r1 theta1 + r2 theta2, modulo the base pitch pi m cos(alpha),
        delta = +-s - (r1 + r2)(inv(alpha') - inv(alpha)) - j cos(alpha)/2,
        cos(alpha') = |r1 + r2|/a, inv(x) = tan(x) - x,

    are the way along it and the penetrations of upper and lower flank. The normal force acts on
    that line, in the plane of the first gear: it turns the gears in the ratio of their teeth, and
    their bearings feel it whole, pressure angle included. Centres may move, in bearings with
    clearance or on a planet's carrier: the play follows their distance as involutes have it. Since
    only angles modulo the pitch count, the number of revolutions is unlimited.

    One law stands for all pairs of teeth in mesh, which stay in it: the contact ratio is not
    modelled, nor are friction and tilt of the axes, which bearings elsewhere keep parallel.

    **Arguments:**

    - `first`, `second`: names of the gears' bodies.
    - `point_first`, `point_second`: the gears' centres, (3,) m in body axes.
    - `axis_first`, `axis_second`: their axes, (3,) in body axes, parallel to each other.
    - `teeth_first`, `teeth_second`: numbers of teeth; negative for an internal second gear, as in
      ISO 21771.
    - `module`: m.
    - `backlash`: j, m, along the pitch circle, from flank to flank, at the centre distance
      m |z1 + z2|/2.
    - `law`: the normal law of the mesh, with a given stiffness. ISO 6336 has some 20 N/(mm um) of
      tooth width for steel.
    - `pressure_angle`: alpha, rad; 20 degrees unless given.
    - `phase`: rad, how far the first gear is turned against where, with the gears in the middle of
      the play, the line of centres has the direction of the first transverse axis (x for an axis
      along z) in both bodies.

    **Raises:** `ValueError` for teeth that are no whole numbers, a backlash not smaller than the
    pitch, an internal gear not larger than the first, and a law whose stiffness needs a bearing.

    Source: involute gearing after ISO 21771; backlash as a dead zone with impacts after
    A. Kahraman, R. Singh, Non-linear dynamics of a spur gear pair, J. Sound Vib. 142, 1990.

    >>> law = cj.laws.ExactRestitution(0.8, 1.8e11)
    >>> mesh = cj.GearBacklash(
    ...     "pinion",
    ...     "wheel",
    ...     (0, 0, 0),
    ...     (0, 0, 0),
    ...     (0, 0, 1),
    ...     (0, 0, 1),
    ...     teeth_first=20,
    ...     teeth_second=50,
    ...     module=3e-3,
    ...     backlash=0.1e-3,
    ...     law=law,
    ... )
    >>> mesh.pair(), list(mesh.laws())
    (('pinion', 'wheel'), ['lower flank', 'upper flank'])
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    point_first: Triple = quantity("m", check=require_point)
    point_second: Triple = quantity("m", check=require_point)
    axis_first: Triple = quantity("1", check=require_axis)
    axis_second: Triple = quantity("1", check=require_axis)
    teeth_first: Single = quantity("1", check=_require_teeth)
    teeth_second: Single = quantity("1", check=_require_teeth)
    module: Single = quantity(
        "m", positive=True, usual=(0.0, LARGEST_MODULE), remedy="give it in m; 3 mm is 3e-3 m"
    )
    backlash: Single = quantity("m", positive=True, remedy="give the whole play in m")
    law: AbstractContactLaw  # pyright: ignore[reportGeneralTypeIssues]
    pressure_angle: Single = quantity(
        "rad",
        default=math.radians(20.0),
        within=PRESSURE_ANGLES,
        remedy="give it in rad; 20 degrees are 0.349 rad",
    )
    phase: Single = quantity("rad", shape=(), default=0.0)

    def __check_init__(self):
        require_flat_law(self.law, "flanks")

    def _check_together(self) -> None:
        if (known := checkable(self.teeth_first, self.teeth_second)) is not None:
            first, second = known
            require(
                (first > 0.0) & ((second > 0.0) | (-second > first)),
                "teeth_second",
                second,
                f"positive, or more than the first gear's {as_shown(first)} for an internal gear",
                "name the inner gear first, with a positive number, and the internal one second",
            )
        if (known := checkable(self.backlash, self.module)) is not None:
            backlash, module = known
            require(
                backlash < math.pi * module,
                "backlash",
                backlash,
                f"smaller than the pitch of {as_shown(math.pi * module)} m",
                "check the units (m)",
            )

    def _caution_together(self) -> None:
        module = concrete(self.module)
        if module is not None:
            widest = WIDEST_BACKLASH * math.pi * float(module)
            remedy = "give the play along the pitch circle in m"
            caution_above("backlash", self.backlash, "m", widest, remedy)

    def pair(self) -> tuple[str, str]:
        """The bodies of the first and the second gear."""
        return self.first, self.second

    def laws(self) -> dict[str, AbstractContactLaw]:
        """The law of each flank."""
        return dict.fromkeys(FLANKS, self.law)

    def law_limits(self, name: str, depth: Scalar) -> tuple[Limit, ...]:
        """Those of the law at a flat surface."""
        return self.laws()[name].limits(Gap(depth, 0.0))

    def deepest(self) -> dict[str, Scalar]:
        """Half of a tooth's thickness."""
        play = self.backlash * cosine(self.pressure_angle)
        return dict.fromkeys(FLANKS, 0.25 * (self._base_pitch() - play))

    def _base_pitch(self) -> Scalar:
        return math.pi * self.module * cosine(self.pressure_angle)

    def _base_radii(self) -> tuple[Scalar, Scalar]:
        """Of both gears, m; negative that of an internal one."""
        half = 0.5 * self.module * cosine(self.pressure_angle)
        return half * self.teeth_first, half * self.teeth_second

    def displacement(self, first: Motion, second: Motion) -> Scalar:
        """How far the gears are along the line of action from the middle of the play, m, within
        half a base pitch: positive towards the upper flank."""
        line = self._line(first, second)
        axis = second.direction(unit(self.axis_second))
        sense = where(line.axis.dot(axis) < 0.0, -1.0, 1.0)
        of_first, of_second = self._base_radii()
        turned = of_first * (line.angle_in(first, self.axis_first) + self.phase)
        turned = turned + of_second * sense * line.angle_in(second, self.axis_second)
        return wrapped(-turned, self._base_pitch())

    def _line(self, first: Motion, second: Motion) -> LineOfCentres:
        points = self.point_first, self.point_second
        return LineOfCentres.between(first, second, *points, self.axis_first)

    def contacts(self, motions: Motions) -> dict[str, Contact]:
        """Contact geometry of both flanks, at the pitch point."""
        first, second = motions[self.first], motions[self.second]
        line, displacement = self._line(first, second), self.displacement(first, second)
        at_first, at_second = self._pitch_point(first, second, line)
        sliding = second.velocity_at(at_second) - first.velocity_at(at_first)
        radii = add(*self._base_radii())
        outside = where(radii < 0.0, -1.0, 1.0)
        tangential = radii * outside / line.distance
        radial = sine_of(tangential)
        opening = self._opening(radii, tangential, radial)
        contacts = {}
        for label in FLANKS:
            side = SIDE_OF[label]
            push = line.across * (side * tangential) + line.along * radial
            normal = push * -outside
            gap = Gap(side * displacement - opening, sliding.dot(normal))
            contacts[label] = Contact(gap, normal, at_first, at_second, None)
        return contacts

    def _opening(self, radii: Scalar, tangential: Scalar, radial: Scalar) -> Scalar:
        """Half of the play along the line of action, m, at the gears' distance: by the sum of base
        radii, m, and cosine and sine of the pressure angle there."""
        nominal = sine(self.pressure_angle), cosine(self.pressure_angle)
        wider = involute(radial, tangential) - involute(*nominal)
        return radii * wider + 0.5 * self.backlash * nominal[1]

    def _pitch_point(
        self, first: Motion, second: Motion, line: LineOfCentres
    ) -> tuple[Vector, Vector]:
        """The point that divides the line of centres as the teeth, m in the axes of each body."""
        share = self.teeth_first / (self.teeth_first + self.teeth_second)
        from_first = line.along * (line.distance * share)
        from_second = line.along * (line.distance * (share - 1.0)) - line.axis * line.height
        return (
            self.point_first + first.components(from_first),
            self.point_second + second.components(from_second),
        )

    def friction_force(self, name: str, contact: Contact, normal_force: Scalar) -> Vector | None:
        """None: teeth roll and slide on each other without friction here."""
        del name, contact, normal_force

    def centred_joint(self) -> AbstractConstraint:
        """Holds the gears in the middle of the play."""
        return MeshedInPlay(self)

    def draw(self, pen: AbstractPen) -> None:
        """Two gears, a tooth of the second in a gap of the first."""
        first, second = self.ends(self.axis_first, self.axis_second)
        half, beyond = 0.5 * self.module, math.pi if self.teeth_second < 0.0 else 0.0
        gap = math.pi / self.teeth_first - self.phase
        teeth = self.teeth_first, self.teeth_second
        pen.gear(first, radius=half * teeth[0], teeth=teeth[0], phase=gap + beyond)
        pen.gear(second, radius=half * teeth[1], teeth=teeth[1], phase=math.pi)


class MeshedInPlay(AbstractConstraint):
    """Holds two gears in the middle of their play; one row."""

    gears: GearBacklash

    def body_names(self) -> tuple[str, ...]:
        """Names of the gears' bodies."""
        return self.gears.pair()

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """The displacement along the line of action, m."""
        del t

        def residual(first: Pose, second: Pose) -> tuple[Scalar]:
            poses = (Motion(*pose, ZERO, ZERO) for pose in (first, second))
            return (self.gears.displacement(*poses),)

        names = self.gears.pair()
        return rows_from_residual(names, ("mesh",), residual, *(motions[name] for name in names))
