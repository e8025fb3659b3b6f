"""Two spur gears with involute teeth and backlash."""

import math
import operator
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

from typing_extensions import override

from ..._fields.checks import (
    caution_outside,
    concrete,
    require_axis,
    require_numbers,
    require_shape,
)
from ..._fields.objects import quantity
from ..._fields.types import ArrayLike, Single, Triple
from ..._math.interpolation import Slope
from ..._math.rotations import transverse_axes, unit
from ..._math.smoothing import cosine, norm_and_direction, polar_angle, sine, where, wrapped
from ..._math.vectors import ZERO, Scalar, Vector, add, square_root
from ..bodies import Motion
from ..contact.laws import AbstractContactLaw, Gap, VaryingLaw, require_instance
from ..joints.base import AbstractPairAtPoints, Contact, Motions, Row, SideForce
from ..joints.constraint_rows import Pose, rows_from_residual
from ..pen import AbstractPen
from ..profiles import AbstractProfile
from .common import FLANKS, AbstractFlankJoint
from .mesh_stiffness import AbstractMeshStiffness, require_positive_factor


def involute(sine: Scalar, cosine: Scalar) -> Scalar:
    """Return inv(alpha) = tan(alpha) - alpha from the sine and cosine of an acute angle alpha."""
    return sine / cosine - polar_angle(sine, cosine)


@dataclass(frozen=True)
class LineOfCentres:
    """The line from the first gear's centre to the second's, projected along the first gear's axis.

    Global unit vectors form a right-handed frame: `along` the line, `across` it, and `axis` of the
    first gear. `distance` is the length of the line, m, and `height` the distance of the second
    centre from the first along the axis, m.
    """

    axis: Vector
    along: Vector
    across: Vector
    distance: Scalar
    height: Scalar

    def angle_in(self, gear: Motion, axis: Vector) -> Scalar:
        """Return the angle of the line of centres about the axis of a gear, rad in [-pi, pi]. The
        `axis` is in the axes of the gear's body; the first of its `transverse_axes` is at zero."""
        start, quarter = transverse_axes(unit(axis))
        line = gear.components(self.along)
        return polar_angle(line.dot(quarter), line.dot(start))


AtFlank: TypeAlias = Callable[[Gap, float], tuple[Gap, SideForce | None]]
"""Function of a flank's gap and of the flank's sign in `FLANKS` that returns the complete gap and
the `SideForce`, ``None`` for none. In the given gap, the depth already includes the transmission
error; the error's rate and the stiffness factor are added."""


def _require_teeth(argument: str, value: ArrayLike) -> None:
    require_shape(argument, value, (), "pass a number of teeth")
    whole = "a whole number", "count the teeth; use a negative number for an internal second gear"
    require_numbers(lambda n: (n == n.round()) & (abs(n) >= 1.0), argument, (value,), *whole)


class GearBacklash(AbstractPairAtPoints, AbstractFlankJoint):
    r"""Two spur gears in mesh, with backlash between their involute teeth.

    $$\delta = \pm s - (r_1 + r_2) (\mathrm{inv}\, \alpha' - \mathrm{inv}\, \alpha) - \frac{j}{2}
    \cos \alpha$$

    Each flank touches along its line of action, a common tangent of the base circles of radii r = m
    z cos(alpha)/2, with module m, numbers of teeth z and pressure angle alpha. The penetration
    delta is that of the upper (+) or lower (-) flank, and j the backlash. The working pressure
    angle alpha' follows from cos(alpha') = |r1 + r2|/a at the distance a of the centres, and inv(x)
    = tan(x) - x (involute gearing after ISO 21771). The displacement along the line of action is s
    = r1 (theta1 - phase) + r2 theta2, modulo the base pitch pi m cos(alpha), with the gears' angles
    theta from the line of centres about the first gear's axis. Revolutions are thus unlimited.

    The normal force acts along the line of action in the plane of the first gear. It drives the
    gears in the ratio of their teeth, and loads their bearings with its radial component too. The
    centres may move, in bearings with clearance or on a planet carrier: the backlash changes with
    their distance. One law represents all tooth pairs in mesh (A. Kahraman, R. Singh, Non-linear
    dynamics of a spur gear pair, J. Sound Vib. 142, 1990). There is no friction, and other joints
    have to keep the axes parallel.

    The force may vary over the mesh cycle, as a function of the mesh angle phi = z1 (theta1 -
    phase): a `stiffness` multiplies the force of the law by a factor k, and a `transmission_error`
    e shifts the flanks along the line of action, so that s - e replaces s in delta. The stored
    energy k U(delta) then depends on phi too, and so do the forces that are its gradient: in
    addition to the normal force F, a moment z1 (F' de/dphi - U dk/dphi) acts on the first gear,
    where F' is F on the upper flank and -F on the lower. Its reaction acts on the centres, across
    the line between them. This conserves energy (S. Oh, K. Grosh, J. R. Barber, Energy conserving
    equations of motion for gear systems, J. Vib. Acoust. 127, 2005). Classical equations of the
    relative displacement, such as those of Kahraman and Singh, prescribe phi(t) and lack the
    moment; they are exact for a constant speed of the first gear.

    **Arguments:**

    - `point_first`, `point_second`: the gears' centres, (3,) m from each body's centre of mass in
      its axes. `axis_first`, `axis_second`: the gears' axes, (3,) in each body's axes; in space
      they are parallel or antiparallel.
    - `teeth_first`, `teeth_second`: z1 and z2, whole numbers of teeth; as in ISO 21771, z2 is
      negative for an internal second gear, which must be larger than the first.
    - `module`: m, in m.
    - `backlash`: j, m, along the pitch circle, from flank to flank, at the centre distance m |z1 +
      z2|/2; smaller than the pitch, pi m.
    - `law`: normal law of the mesh, whose stiffness is given as a number. ISO 6336 gives about 20
      N/um per mm of tooth width for steel.
    - `pressure_angle`: alpha, rad, 0.1 to 0.8; 20 degrees by default.
    - `phase`: rad, rotation of the first gear from its reference position; zero by default. Each
      gear has a frame, fixed to its body, whose z axis is the gear's axis (see
      `quantities.JournalOffset`). At phase 0, the gears are in the middle of the play if the line
      from the first centre to the second is along the x axes of both frames.
    - `stiffness`: the factor k over the mesh cycle, such as `clearjoint.profiles.TeethInMesh` for a
      contact ratio; ``None``, the default, for 1.
    - `transmission_error`: the static transmission error e over the mesh cycle, m, positive where
      the teeth of the first gear are behind, such as `clearjoint.profiles.Harmonics`, at the angle
      phi; ``None``, the default, for none.

    **Warns:** `UnusualValueWarning` for a module above 0.1 m or a backlash above 0.2 of the pitch.

    >>> law, axis, centre = cj.laws.ExactRestitution(0.8, 1.8e11), (0, 0, 1), (0, 0, 0)
    >>> sizes = {"teeth_first": 20, "teeth_second": 50, "module": 3e-3, "backlash": 0.1e-3}
    >>> mesh = cj.GearBacklash("pinion", "wheel", centre, centre, axis, axis, **sizes, law=law)
    >>> list(mesh.laws())
    ['lower flank', 'upper flank']
    """

    axis_first: Triple = quantity("1", check=require_axis)
    axis_second: Triple = quantity("1", check=require_axis)
    teeth_first: Single = quantity("1", check=_require_teeth)
    teeth_second: Single = quantity("1", check=_require_teeth)
    module: Single = quantity(
        "m", positive=True, usual=(0.0, 0.1), remedy="give it in m; 3 mm is 3e-3 m"
    )
    backlash: Single = quantity("m", positive=True, remedy="give the whole play in m")
    law: AbstractContactLaw  # pyright: ignore[reportGeneralTypeIssues]
    pressure_angle: Single = quantity(
        "rad",
        default=math.radians(20.0),
        within=(0.1, 0.8),  # common gears have 0.25 to 0.52
        remedy="give it in rad; 20 degrees are 0.349 rad",
    )
    phase: Single = quantity("rad", shape=(), default=0.0)
    stiffness: AbstractMeshStiffness | None = None
    transmission_error: AbstractProfile | None = None

    @override
    def _check_together(self) -> None:
        if self.stiffness is not None:
            require_instance("stiffness", self.stiffness, AbstractMeshStiffness)
            require_positive_factor(self.stiffness)
        if self.transmission_error is not None:
            require_instance("transmission_error", self.transmission_error, AbstractProfile)
        require_numbers(
            lambda second, first: (first > 0.0) & ((second > 0.0) | (-second > first)),
            "teeth_second",
            (self.teeth_second, self.teeth_first),
            "positive, or more than the first gear's {1} for an internal gear",
            "name the inner gear first, with a positive number, and the internal one second",
        )
        values, expected = (self.backlash, math.pi * self.module), "smaller than the pitch of {1} m"
        require_numbers(operator.lt, "backlash", values, expected, "check the units (m)")

    @override
    def _caution_together(self) -> None:
        module = concrete(self.module)
        if module is not None:
            widest = 0.2 * math.pi * float(module)
            remedy = "give the play along the pitch circle in m"
            caution_outside("backlash", self.backlash, "m", 0.0, widest, remedy)

    @override
    def deepest_penetration(self) -> Scalar:
        # Half of a tooth's thickness along the line of action.
        play = self.backlash * cosine(self.pressure_angle)
        return 0.25 * (self._base_pitch() - play)

    def _base_pitch(self) -> Scalar:
        """Return the distance from tooth to tooth along the line of action, m."""
        return math.pi * self.module * cosine(self.pressure_angle)

    def _base_radii(self) -> tuple[Scalar, Scalar]:
        """Return the base radii of both gears, m; the second is negative for an internal gear."""
        half = 0.5 * self.module * cosine(self.pressure_angle)
        return half * self.teeth_first, half * self.teeth_second

    def displacement(self, first: Motion, second: Motion) -> Scalar:
        """Return the displacement s - e along the line of action from the middle of the play, m."""
        line = self._line(first, second)
        axis = second.direction(unit(self.axis_second))
        # The second axis may be antiparallel to the first: its angle then counts backwards.
        sense = where(line.axis.dot(axis) < 0.0, -1.0, 1.0)
        radius_first, radius_second = self._base_radii()
        rolled = radius_first * (line.angle_in(first, self.axis_first) + self.phase)
        rolled = rolled + radius_second * sense * line.angle_in(second, self.axis_second)
        # The angle of the line in a gear is minus the angle of the gear from the line.
        displacement = -rolled
        if self.transmission_error is not None:
            error = self.transmission_error.at(self._mesh_angle(line, first)).value
            displacement = displacement - error
        return wrapped(displacement, self._base_pitch())

    def _mesh_angle(self, line: LineOfCentres, first: Motion) -> Scalar:
        """Return the mesh angle phi = z1 (theta1 - phase), rad; the mesh has the period 2 pi."""
        return -self.teeth_first * (line.angle_in(first, self.axis_first) + self.phase)

    def _line(self, first: Motion, second: Motion) -> LineOfCentres:
        axis = first.direction(unit(self.axis_first))
        apart = second.point(self.point_second) - first.point(self.point_first)
        height = apart.dot(axis)
        distance, along = norm_and_direction(apart - axis * height)
        return LineOfCentres(axis, along, axis.cross(along), distance, height)

    @override
    def contacts(self, motions: Motions) -> dict[str, Contact]:
        first, second = motions[self.first], motions[self.second]
        line, displacement = self._line(first, second), self.displacement(first, second)
        # The pitch point divides the line of centres in the ratio of the teeth. For an internal
        # gear it is outside the line, beyond the first centre. It is in the plane of the first
        # gear; the second centre is at the distance `height` from this plane, along the axis.
        share = self.teeth_first / (self.teeth_first + self.teeth_second)
        from_first = line.along * (line.distance * share)
        from_second = line.along * (line.distance * (share - 1.0)) - line.axis * line.height
        at_first = self.point_first + first.components(from_first)
        at_second = self.point_second + second.components(from_second)
        # The component of this velocity along a flank's normal is the rate of its penetration, also
        # where the distance of the centres changes.
        sliding = second.velocity_at(at_second) - first.velocity_at(at_first)
        radii_sum = add(*self._base_radii())
        # The sum of the base radii is negative for an internal gear, on whose teeth the force has
        # the opposite direction.
        sense = where(radii_sum < 0.0, -1.0, 1.0)
        # Cosine and sine of the working pressure angle alpha', which grows with the distance of the
        # centres (ISO 21771): cos(alpha') is the sum of the base radii over this distance.
        tangential = radii_sum * sense / line.distance
        sine_squared = 1.0 - tangential * tangential
        # Involutes have no common normal if the gears are closer than the sum of their base radii.
        meshes = sine_squared > 0.0
        radial = square_root(where(meshes, sine_squared, 1.0))
        # Half the play along the line of action at the gears' actual distance.
        nominal_sine, nominal_cosine = sine(self.pressure_angle), cosine(self.pressure_angle)
        change = involute(radial, tangential) - involute(nominal_sine, nominal_cosine)
        opening = radii_sum * change + 0.5 * self.backlash * nominal_cosine
        at_flank = self._mesh_cycle(line, first, second)  # adds what varies over the mesh cycle
        contacts = {}
        for label, side in FLANKS.items():
            # `push` is a unit vector along the line of action, which has the angle alpha' from the
            # tangent of the pitch circles. An external second gear is pushed in this direction, and
            # an internal one against it. The normal points in the opposite direction of the force
            # on the second gear: that in which the second gear penetrates the first.
            push = line.across * (side * tangential) + line.along * radial
            normal = push * -sense
            # An infinite penetration is beyond every limit, so that a run refuses such gears.
            depth = where(meshes, side * displacement - opening, math.inf)
            gap, side_force = at_flank(Gap(depth, sliding.dot(normal)), side)
            # The mesh has no friction, so that its slip is ``None``.
            contacts[label] = Contact(gap, normal, at_first, at_second, None, side=side_force)
        return contacts

    @override
    def laws(self) -> dict[str, AbstractContactLaw]:
        law = self.law if self.stiffness is None else VaryingLaw(self.law)
        return dict.fromkeys(self.contact_labels(), law)

    def _mesh_cycle(self, line: LineOfCentres, first: Motion, second: Motion) -> AtFlank:
        """Return a function that adds the rate of the transmission error and the factor of the
        stiffness to a flank's gap. It returns the new gap and the flank's `SideForce`, or ``None``
        without either. The given depth contains the error already (see `displacement`)."""
        error, stiffness = self.transmission_error, self.stiffness
        # Nothing varies over the mesh cycle.
        if error is None and stiffness is None:
            return lambda gap, side: (gap, None)
        angle = self._mesh_angle(line, first)
        # The mesh angle changes as the second centre moves across the line, as seen from the first
        # gear: its rate, rad/s, is the product of `gradient`, rad/m, with this `relative` velocity.
        to_second = line.along * line.distance + line.axis * line.height
        arm_first, arm_second = self.point_first + first.components(to_second), self.point_second
        gradient = line.across * (-self.teeth_first / line.distance)
        relative = second.velocity_at(arm_second) - first.velocity_at(arm_first)
        error_slope = None if error is None else error.at(angle).slope
        stiffness_factor = None if stiffness is None else stiffness.factor_and_slope(angle)
        rate = gradient.dot(relative)

        def at_flank(gap: Gap, side: float) -> tuple[Gap, SideForce]:
            slope = elastic = ZERO
            # The penetration contains -side e, with the transmission error e.
            if error_slope is not None:
                depth_by_angle = -side * error_slope
                gap = replace(gap, rate=gap.rate + depth_by_angle * rate)
                slope = gradient * depth_by_angle
            if stiffness_factor is not None:
                value, by_angle = stiffness_factor
                # At constant penetration, the stored energy changes with the angle, by the
                # stiffness: minus its gradient is a force.
                elastic = gradient * (-by_angle * self.law.stored_energy(gap))
                gap = replace(gap, factor=Slope(value, by_angle * rate))
            return gap, SideForce(arm_first, arm_second, slope, elastic)

        return at_flank

    @override
    def centred_rows(self, motions: Motions) -> dict[str, Row]:
        def residual(first: Pose, second: Pose) -> tuple[Scalar]:
            # The displacement depends on positions only, so that the velocities may be zero.
            poses = (Motion(*pose, ZERO, ZERO) for pose in (first, second))
            return (self.displacement(*poses),)

        names, *bodies = self._between(motions)
        return rows_from_residual(names, ("mesh",), residual, *bodies)

    @override
    def draw(self, pen: AbstractPen) -> None:
        first, second = self.ends(self.axis_first, self.axis_second)
        # A rotation by half a pitch puts a gap of the first gear where the teeth mesh. With an
        # internal gear this is on the side away from the internal gear's centre.
        half_module, half_turn = 0.5 * self.module, math.pi if self.teeth_second < 0.0 else 0.0
        phase = math.pi / self.teeth_first - self.phase + half_turn
        teeth_first, teeth_second = self.teeth_first, self.teeth_second
        pen.gear(first, radius=half_module * teeth_first, teeth=teeth_first, phase=phase)
        pen.gear(second, radius=half_module * teeth_second, teeth=teeth_second, phase=math.pi)
