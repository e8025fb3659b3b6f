"""The spatial revolute joint with clearance, and its axial behaviour.

Equation numbers are those of P. Flores, J. Ambrosio, J. C. P. Claro, H. M. Lankarani, Spatial
revolute joints with clearances for dynamic analysis of multi-body systems, 2006.
"""

import itertools
import math
from collections.abc import Callable
from typing import Annotated, ClassVar

import equinox as eqx
import numpy as np
from typing_extensions import override

from ..._fields.checks import (
    as_number,
    as_shown,
    caution_outside,
    caution_unless,
    concrete,
    require,
    require_axis,
    require_count,
    require_point,
)
from ..._fields.objects import AbstractConverting, optional_quantity, quantity
from ..._fields.types import Single, Triple, TripleLike
from ..._math.rotations import transverse_axes, unit
from ..._math.smoothing import norm_and_direction, where
from ..._math.vectors import Scalar, Vector, add, subtract
from ..bodies import Motion
from ..contact.friction import AbstractFriction, FrictionLaw
from ..contact.laws import (
    AbstractContactLaw,
    Gap,
    WeightedLaw,
    caution_beyond,
    require_flat_law,
    require_instance,
    slip_velocity,
)
from ..joints.base import AbstractConstraint, Contact, Motions, Row
from ..joints.constraint_rows import point_in_plane, relative_angle_row
from ..joints.ideal import CylindricalJoint, RevoluteJoint
from ..pen import AbstractPen, Marker
from ..profiles import (
    AbstractProfile,
    JournalInBearing,
    PlanarAxes,
    caution_two_contacts,
    require_room,
)
from .common import (
    LEAST_TRANSVERSE_LOAD,
    AbstractCentredJoint,
    require_smaller_clearance,
)
from .journal_bases import BASES, SIDES, AxialPoint, JournalBase, axial_points


class AbstractAxialPolicy(AbstractConverting):
    """Axial behaviour of a `ClearanceJoint`: a free, held or stopped journal.

    A subclass may set ``holds_centre = True``: an ideal constraint keeps the journal's centre in
    the bearing's middle plane. Or it may define two shoulders, which stop the journal at the
    bearing's ends, by `shoulder_law`, `shoulder_gap` for the play, and perhaps `shoulder_friction`.
    Otherwise the journal is free. This example defines washers at different distances:

    ```python
    import clearjoint as cj

    class ThrustWashers(cj.extend.AbstractAxialPolicy):
        lower_play: float  # m, from the journal's end to the washer
        upper_play: float
        stiffness: float  # N/m^1.5

        def shoulder_law(self):
            return cj.laws.Hertz(self.stiffness)

        def shoulder_gap(self, side, offset, rate):
            play = self.lower_play if side < 0 else self.upper_play
            return cj.extend.Gap(offset - play, rate)

    washers = ThrustWashers(lower_play=1e-4, upper_play=3e-4, stiffness=1e9)
    scene, state = cj.mechanisms.double_pendulum(axial=washers)
    ```
    """

    holds_centre: ClassVar[bool] = False

    def shoulder_law(self) -> AbstractContactLaw | None:
        """Return the normal law of the shoulders; ``None``, the default, for no shoulders."""
        return None

    def shoulder_friction(self) -> tuple[AbstractFriction, Scalar] | None:
        """Return the friction law of the shoulders and the mean radius of their faces, m; ``None``,
        the default, for no friction."""
        return None

    def shoulder_gap(self, side: float, offset: Scalar, rate: Scalar) -> Gap:
        """Return the penetration of the journal into one shoulder, m, and its rate, m/s.

        By default there is no play: the penetration is `offset`.

        **Arguments:** `side`: 1.0 for the upper shoulder, at the end of the bearing to which its
        axis points, -1.0 for the lower one. `offset`: displacement of the journal's end towards the
        shoulder, m, zero for a centred journal; `rate`: its rate, m/s.
        """
        return Gap(offset, rate)


class FreeAxially(AbstractAxialPolicy):
    """No axial support: the journal slides freely, as in a bearing of unlimited length.

    Use it in a mechanism whose other joints hold the bodies in a plane, such as a slider-crank.
    Elsewhere the journal eventually slides out and `simulate` warns with a `LeftBearingWarning`;
    use `EndPlay` for a bearing with shoulders, or `FixedAxially` if axial motion does not matter.

    >>> scene, state = cj.mechanisms.double_pendulum(axial=cj.FreeAxially())
    >>> scene.joints["shoulder"].axial
    FreeAxially()
    """


class FixedAxially(AbstractAxialPolicy):
    """An ideal constraint that keeps the journal's centre in the bearing's middle plane.

    >>> scene, state = cj.mechanisms.double_pendulum(axial=cj.FixedAxially())
    >>> scene.joints["shoulder"].axial
    FixedAxially()
    """

    holds_centre = True


class EndPlay(AbstractAxialPolicy):
    """Shoulders at both ends of the bearing that stop the journal after half the play to each side.

    Each shoulder's force acts along the bearing's axis, at the centre of the base that touches it.
    A shoulder with friction is a thrust face, which resists sliding across the axis and rotation
    about it, but not tilting: for the sliding velocity v of the base's centre and the relative spin
    w about the axis, the slip speed is sqrt(v^2 + (r w)^2) with the face's mean radius r.

    **Arguments:**

    - `play`: m, total axial travel between the shoulders.
    - `law`: normal law of a shoulder; its stiffness must be a number, since the surfaces are flat.
    - `friction`: an `AbstractFriction`, or ``None``, the default, for no friction.
    - `radius`: mean radius of the faces, m, if and only if they have friction. For a face between
      the radii a and b, (2/3) (b^3 - a^3)/(b^2 - a^2) gives the moment of a uniform pressure.

    >>> collars = cj.EndPlay(play=0.2e-3, law=cj.laws.Hertz(1e9))
    >>> gap = collars.shoulder_gap(1.0, offset=0.15e-3, rate=0.0)
    >>> print(f"{gap.depth:.2e} m")  # beyond half the play
    5.00e-05 m
    """

    play: Single = quantity("m", positive=True, zero=True, remedy="give the axial travel in m")
    law: AbstractContactLaw  # pyright: ignore[reportGeneralTypeIssues]
    friction: AbstractFriction | None = None
    radius: Single | None = optional_quantity("m", positive=True, remedy="give the radius in m")

    @override
    def __check_init__(self):
        require_flat_law(self.law, "shoulders")
        if self.friction is not None:
            require_instance("friction", self.friction, AbstractFriction)
        agree = (self.friction is None) == (self.radius is None)
        expected = "given if and only if `friction` is"
        require(agree, "radius", self.radius, expected, "pass both, or none of the two")

    @override
    def shoulder_law(self) -> AbstractContactLaw:
        return self.law

    @override
    def shoulder_friction(self) -> tuple[AbstractFriction, Scalar] | None:
        if self.friction is None or self.radius is None:
            return None
        return self.friction, self.radius

    @override
    def shoulder_gap(self, side: float, offset: Scalar, rate: Scalar) -> Gap:
        return Gap(offset - 0.5 * self.play, rate)


SHOULDERS = ("lower shoulder", "upper shoulder")
"""Contact labels of the shoulders; the upper is at the end to which the bearing's axis points."""
MOST_POINTS = 64
"""Largest number of points along the journal; the force at each is computed at every evaluation of
the equations of motion."""


class ClearanceJoint(AbstractCentredJoint):
    """A revolute joint with clearance: a journal inside a slightly larger bearing.

    The journal's bases V and W are the circles at its two ends. Each base can touch the bearing's
    wall and then applies the full normal law. The tilt between journal and bearing is taken as
    small: the bases' circles lie in the bearing's cross-section (Flores et al. 2006).

    **Arguments:**

    - `bearing_body`, `journal_body`: names of the bodies; one may be the ground.
    - `bearing_point`, `bearing_axis`: centre (m) and axis of the bearing, (3,) in its body's axes.
      The centre is measured from the body's centre of mass; on the ground, from the origin.
    - `journal_point`, `journal_axis`: centre and axis of the journal, likewise. Base V is half a
      length from the centre against the axis, base W half a length along it.
    - `bearing_radius`: m.
    - `journal_radius` or `clearance`: m, exactly one of them, positive; `clearance` is the
      difference of the radii.
    - `journal_length`: m, distance between the bases.
    - `law`: normal law of the contact of each base; with `line_points`, of the contact along the
      journal's whole length.
    - `friction`: an `AbstractFriction` or an `AbstractBristleFriction` for the contacts with the
      wall; ``None``, the default, for no friction. Shoulders have a friction law of their own.
    - `axial`: `FreeAxially()`, the default, if other joints support the journal along the axis;
      `EndPlay(...)` or `FixedAxially()` if not.
    - `bearing_profile`, `journal_profile`: deviations of the wall and of the journal from their
      circles, positive outward, such as `clearjoint.profiles.Harmonics`; ``None``, the default, for
      circles. Laws get the radii of the circles. A wall that is curved more strongly than the
      journal, of which a warning tells, can touch it at two points; only the deeper has a force.
    - `line_points`: ``None``, the default, for contact at the two bases only. A number of points n,
      from 2 to 64, for contact along the whole length: `law` at the local penetration, divided by
      the length, is then the force per unit of length, which the Gauss-Lobatto rule with n points
      integrates. Each point is a contact, "V", "point 2", ..., "W"; `cj.quantities.Reaction` gives
      their sum. A parallel journal thus has the force of `law` once, and not at each of two bases.
      The error of force and moment is largest if a part of the length touches: it decreases as n^-2
      for a linear law and as n^-2.5 for the exponent 1.5. With 5 points it is typically 3 % of the
      force at the deepest penetration along the whole length, with 8 points 1 %.

    **Raises:** `ValueError` if a value is invalid, such as profiles that leave a centred journal no
    room. **Warns:** `UnusualValueWarning` for a clearance of more than a tenth of the bearing's
    radius, a bearing radius of more than 2 m, or a journal longer than 100 bearing radii;
    `LawRangeWarning` for a clearance outside the range of `law`.

    >>> pin = cj.ClearanceJoint(
    ...     "ground",
    ...     "arm",
    ...     journal_point=(-0.5, 0, 0),
    ...     bearing_radius=10e-3,
    ...     clearance=0.5e-3,
    ...     journal_length=20e-3,
    ...     law=cj.laws.LankaraniNikravesh(restitution=0.9, stiffness=cj.mechanisms.STEEL),
    ... )
    >>> print(f"{pin.journal_radius:.4f} m")
    0.0095 m
    """

    bearing_body: str = eqx.field(static=True)
    journal_body: str = eqx.field(static=True)
    bearing_point: Triple = quantity("m", check=require_point)
    bearing_axis: Triple = quantity("1", check=require_axis)
    journal_point: Triple = quantity("m", check=require_point)
    journal_axis: Triple = quantity("1", check=require_axis)
    bearing_radius: Single = quantity(
        "m", positive=True, usual=(0.0, 2.0), remedy="give lengths in m; 1 mm is 1e-3 m"
    )
    clearance: Single = quantity("m", positive=True, remedy="give the radial clearance in m")
    journal_length: Single = quantity("m", positive=True)
    law: AbstractContactLaw  # pyright: ignore[reportGeneralTypeIssues]
    friction: FrictionLaw | None  # pyright: ignore[reportGeneralTypeIssues]
    axial: AbstractAxialPolicy  # pyright: ignore[reportGeneralTypeIssues]
    bearing_profile: AbstractProfile | None  # pyright: ignore[reportGeneralTypeIssues]
    journal_profile: AbstractProfile | None  # pyright: ignore[reportGeneralTypeIssues]
    line_points: int | None = eqx.field(static=True)  # pyright: ignore[reportGeneralTypeIssues]
    point_fields = {"bearing_point": "bearing_body", "journal_point": "journal_body"}

    def __init__(
        self,
        bearing_body: str,
        journal_body: str,
        *,
        bearing_point: TripleLike = (0.0, 0.0, 0.0),
        bearing_axis: TripleLike = (0.0, 0.0, 1.0),
        journal_point: TripleLike = (0.0, 0.0, 0.0),
        journal_axis: TripleLike = (0.0, 0.0, 1.0),
        bearing_radius: Scalar,
        journal_radius: Annotated[Scalar | None, "m"] = None,
        clearance: Scalar | None = None,
        journal_length: Scalar,
        law: AbstractContactLaw,
        friction: FrictionLaw | None = None,
        axial: AbstractAxialPolicy | None = None,
        bearing_profile: AbstractProfile | None = None,
        journal_profile: AbstractProfile | None = None,
        line_points: int | None = None,
    ):
        exactly_one = (journal_radius is None) != (clearance is None)
        expected = "given if and only if `journal_radius` is not"
        require(exactly_one, "clearance", clearance, expected, "pass one of the two, in m")
        # Of the two, the joint stores the clearance: it is small, and a difference of stored radii
        # would lose its digits.
        radius = as_number(bearing_radius, "bearing_radius", "m")
        if clearance is not None:
            difference = as_number(clearance, "clearance", "m")
        else:
            difference = radius - as_number(journal_radius, "journal_radius", "m")
            known = concrete(difference)
            # A later check would refuse the clearance, which the user has not given. NaN and arrays
            # are left to the later checks.
            if known is not None and known.shape == ():
                expected = f"smaller than the bearing's {as_shown(float(radius))} m"
                remedy = "swap the radii, or use an ideal RevoluteJoint for no clearance"
                require(not known <= 0.0, "journal_radius", journal_radius, expected, remedy)
        self.bearing_body, self.journal_body = bearing_body, journal_body
        self.bearing_point, self.bearing_axis = bearing_point, bearing_axis
        self.journal_point, self.journal_axis = journal_point, journal_axis
        self.bearing_radius, self.clearance = radius, difference
        self.journal_length = journal_length
        self.law, self.friction = law, friction
        self.axial = FreeAxially() if axial is None else axial
        self.bearing_profile, self.journal_profile = bearing_profile, journal_profile
        self.line_points = line_points

    @override
    def __check_init__(self):
        require_instance("axial", self.axial, AbstractAxialPolicy)
        for name in ("bearing_profile", "journal_profile"):
            if (profile := getattr(self, name)) is not None:
                require_instance(name, profile, AbstractProfile)
        if (points := self.line_points) is not None:
            remedy = "give the number of points along the journal, or None for its two bases"
            require_count("line_points", points, remedy)
            expected = f"from {len(BASES)} to {MOST_POINTS}"
            require(len(BASES) <= points <= MOST_POINTS, "line_points", points, expected, remedy)

    @override
    def _check_together(self) -> None:
        require_smaller_clearance(self.clearance, self.bearing_radius, "the bearing's radius")
        require_room(self.clearance, self.bearing_profile, self.journal_profile)

    @override
    def _caution_together(self) -> None:
        radius, clearance = concrete(self.bearing_radius), concrete(self.clearance)
        if radius is not None and clearance is not None:
            is_usual = bool(clearance <= 0.1 * radius)
            expected = f"at most a tenth of the bearing's radius of {float(radius):g} m"
            remedy = "give the journal's radius as `journal_radius`, and the radial clearance in m"
            caution_unless(is_usual, "clearance", float(clearance), "m", expected, remedy)
            longest, remedy = 100.0 * float(radius), "give lengths in m; 1 mm is 1e-3 m"
            caution_outside("journal_length", self.journal_length, "m", 0.0, longest, remedy)
            # The penetration, given as zero here, makes no difference to a limit of the clearance.
            caution_beyond(self.law_limits(BASES[0], 0.0), "clearance")
        caution_two_contacts(self.clearance, self.bearing_profile, self.journal_profile)

    @property
    def journal_radius(self) -> Single:
        """Bearing radius minus clearance, m."""
        return self.bearing_radius - self.clearance

    @override
    def contact_labels(self) -> tuple[str, ...]:
        return tuple(self._axial_points())

    def _axial_points(self) -> dict[str, AxialPoint]:
        return axial_points(len(BASES) if self.line_points is None else self.line_points)

    @override
    def laws(self) -> dict[str, AbstractContactLaw]:
        laws, shoulder_law = super().laws(), self.axial.shoulder_law()
        if self.line_points is not None:
            for label, point in self._axial_points().items():
                laws[label] = WeightedLaw(self.law, point.weight)
        return laws if shoulder_law is None else laws | dict.fromkeys(SHOULDERS, shoulder_law)

    @override
    def deepest_penetration(self) -> Scalar:
        return subtract(self.bearing_radius, self.clearance)

    @override
    def _gap(self, depth: Scalar, rate: Scalar) -> Gap:
        return Gap(depth, rate, self.bearing_radius, self.clearance)

    @override
    def contacts(self, motions: Motions) -> dict[str, Contact]:
        base_at = self.journal_bases(motions)
        contacts = {
            label: self._wall_contact(motions, base_at(point.position))
            for label, point in self._axial_points().items()
        }
        if self.axial.shoulder_law() is not None:
            # The journal's axis may point along the bearing's, or against it: then base V, at the
            # position -1 on the journal's axis, is the one at the upper shoulder.
            axis = motions[self.bearing_body].direction(unit(self.bearing_axis))
            half = motions[self.journal_body].direction(self._half())
            facing = where(half.dot(axis) < 0.0, -1.0, 1.0)
            for side, label in zip(SIDES, SHOULDERS, strict=True):
                base = base_at(side * facing)
                contacts[label] = self._shoulder_contact(motions, side, base)
        return contacts

    def _wall_contact(self, motions: Motions, base: JournalBase) -> Contact:
        """Return the contact of a base with the wall (Flores et al. 2006, eqs 10-21)."""
        if self.bearing_profile is not None or self.journal_profile is not None:
            return self._profile_contact(motions, base)
        bearing, journal = motions[self.bearing_body], motions[self.journal_body]
        # The eccentricity vector is perpendicular to the bearing's axis. It leads from the axis to
        # the journal's centre (`centre`) and on to the base (`arm`, without its axial part).
        eccentricity, normal = norm_and_direction(base.centre + base.arm)
        gap = self._gap(self._depth(base, eccentricity), base.velocity.dot(normal))
        along = base.axis * base.height
        # The points of eqs (15)-(16) are a penetration apart, so that friction there would leave a
        # net moment. Friction therefore acts on both bodies at the point midway between the
        # surfaces.
        shift = 0.0 if self.friction is None else 0.5 * gap.depth
        to_wall = along + normal * add(self.bearing_radius, shift)
        on_bearing = self.bearing_point + bearing.components(to_wall)
        on_journal = base.local + journal.components(normal * subtract(gap.journal_radius, shift))
        # Without friction the force acts along the line through the bearing's axis and the base's
        # centre, at these two points.
        on_axis = self.bearing_point + unit(self.bearing_axis) * base.height
        points = on_bearing, on_journal, on_axis, base.local
        return self._contact_at(motions, gap, normal, *points)

    def _profile_contact(self, motions: Motions, base: JournalBase) -> Contact:
        """Return the contact of a base with the wall if the wall or the journal has a profile."""
        bearing, journal = motions[self.bearing_body], motions[self.journal_body]
        x_axis, y_axis = map(bearing.direction, transverse_axes(unit(self.bearing_axis)))
        eccentricity = base.centre + base.arm
        x, y = eccentricity.dot(x_axis), eccentricity.dot(y_axis)
        profiles = self.bearing_profile, self.journal_profile
        surfaces = JournalInBearing(x, y, *profiles, self.planar_axes(bearing, journal))
        near = surfaces.closest_approach(self.clearance)
        normal = x_axis * near.cosine + y_axis * near.sine
        # The force acts on both bodies at one point, midway between the surfaces. A profile is
        # given by its support function, the distance from the centre to the tangent that is
        # perpendicular to a normal. The point of the surface with this normal is the gradient of
        # the support function by the normal. So this point is not on the line through the base's
        # centre along the normal. `beside` is the vector from this line to the point: the slope of
        # the journal's deviation times the gradient, by the normal, of the angle about the
        # journal's axis. This gradient is (axis x normal)/(1 - tilt^2).
        axis = journal.direction(unit(self.journal_axis))
        tilt = axis.dot(normal)
        beside = axis.cross(normal) * (near.journal.slope / (1.0 - tilt * tilt))
        outward = self.journal_radius + near.journal.value - 0.5 * near.depth
        to_surface = normal * outward + beside
        on_bearing = base.on_bearing + bearing.components(to_surface)
        on_journal = base.local + journal.components(to_surface)
        sliding = journal.velocity_at(on_journal) - bearing.velocity_at(on_bearing)
        gap = self._gap(near.depth, sliding.dot(normal))
        return self._contact_at(motions, gap, normal, on_bearing, on_journal)

    def planar_axes(self, bearing: Motion, journal: Motion) -> PlanarAxes:
        """Return the components of the journal's x and y axes along those of the bearing. The x and
        y axes of each are the `transverse_axes` of its own axis of rotation."""
        of_bearing = map(bearing.direction, transverse_axes(unit(self.bearing_axis)))
        of_journal = map(journal.direction, transverse_axes(unit(self.journal_axis)))
        pairs = itertools.product(of_journal, of_bearing)
        return PlanarAxes(*(journal_axis.dot(axis) for journal_axis, axis in pairs))

    def _depth(self, base: JournalBase, eccentricity: Scalar) -> Scalar:
        """Return the penetration e - c, m, of a base with the eccentricity e, for the clearance c,
        as (e^2 - c^2)/(e + c). A direct difference would round differently at the two bases, which
        repeated impacts amplify to a misalignment. In e^2 - c^2, the term with the largest rounding
        error is that of the journal's centre, which is the same for both bases."""
        common = base.centre.dot(base.centre) - self.clearance * self.clearance
        difference = base.arm.dot(base.centre * 2.0 + base.arm)
        return (common + difference) / (eccentricity + self.clearance)

    def _shoulder_contact(self, motions: Motions, side: float, base: JournalBase) -> Contact:
        outward = base.axis * side
        # In a centred journal, the base is half the length from the bearing's centre.
        offset = side * base.height - 0.5 * self.journal_length
        gap = self.axial.shoulder_gap(side, offset, base.velocity.dot(outward))
        slip = radius = None
        if (face := self.axial.shoulder_friction()) is not None:
            _, radius = face
            # The slip's component along the axis stands for the rotation of the faces on each
            # other, as `Contact.face_radius` requires.
            bearing, journal = motions[self.bearing_body], motions[self.journal_body]
            spin = journal.direction(journal.spin) - bearing.direction(bearing.spin)
            slip = slip_velocity(base.velocity, outward, gap.rate)
            slip = slip + outward * (spin.dot(outward) * radius)
        return Contact(gap, outward, base.on_bearing, base.local, slip, face_radius=radius)

    @override
    def friction_force(self, name: str, contact: Contact, normal_force: Scalar) -> Vector | None:
        # The faces of shoulders have a friction law of their own.
        face = self.axial.shoulder_friction() if name in SHOULDERS else None
        if face is None or contact.slip is None:
            return super().friction_force(name, contact, normal_force)
        friction, _ = face
        return friction.force(normal_force, contact.slip)

    def journal_bases(self, motions: Motions) -> Callable[[Scalar], JournalBase]:
        """Return the function that computes the `JournalBase` at a position on the journal's axis,
        -1 for base V and 1 for base W."""
        bearing, journal = motions[self.bearing_body], motions[self.journal_body]
        axis, half = bearing.direction(unit(self.bearing_axis)), self._half()
        # The vector from the journal's centre to base W is `half` in body axes and `half_arm` in
        # global axes; `half_velocity` is the velocity of base W relative to this centre. At another
        # position on the journal's axis, the three are multiplied by this position.
        centre, half_arm = self._offset(motions), journal.direction(half)
        half_velocity = journal.direction(journal.spin.cross(half))
        centre_velocity = journal.velocity_at(self.journal_point)

        # The component perpendicular to the bearing's axis.
        def across(vector: Vector) -> Vector:
            return vector - axis * vector.dot(axis)

        def base_at(position: Scalar) -> JournalBase:
            local, arm = self.journal_point + half * position, half_arm * position
            offset = centre + arm
            on_bearing = self.bearing_point + bearing.components(offset)
            base_velocity = centre_velocity + half_velocity * position
            velocity = base_velocity - bearing.velocity_at(on_bearing)
            return JournalBase(
                axis, offset.dot(axis), across(centre), across(arm), local, on_bearing, velocity
            )

        return base_at

    def journal_offset(self, motions: Motions, base: str | None = None) -> Vector:
        """Return the vector from the bearing's centre to the journal's centre or to a base, m.

        Components are in the bearing's frame (see `clearjoint.quantities.JournalOffset`), whose z
        axis is the bearing's; for a `bearing_axis` of (0, 0, 1) it has the bearing body's axes.

        **Arguments:** `base`: "V", "W", or the label of a point between them; ``None``, the
        default, for the journal's centre. A `ValueError` for another label.
        """
        bearing, journal = motions[self.bearing_body], motions[self.journal_body]
        offset = self._offset(motions)
        if base is not None:
            points = self._axial_points()
            expected, remedy = f"one of {list(points)}", "or pass None for the journal's centre"
            require(base in points, "base", base, expected, remedy)
            offset = offset + journal.direction(self._half()) * points[base].position
        offset = bearing.components(offset)
        axis = unit(self.bearing_axis)
        x_axis, y_axis = transverse_axes(axis)
        return Vector(offset.dot(x_axis), offset.dot(y_axis), offset.dot(axis))

    def relative_angle(self, motions: Motions) -> Row:
        """Return the journal's angle about the bearing's axis, rad in [-pi, pi], as a `Row`. The
        angle is zero after this rotation of the journal's body from the orientation of the
        bearing's body: the shortest one that makes the axes parallel, or antiparallel if
        `bearing_axis` and `journal_axis` enclose more than 170 degrees."""
        bearing, journal = motions[self.bearing_body], motions[self.journal_body]
        axes = self.bearing_axis, self.journal_axis
        return relative_angle_row(self.pair(), bearing, journal, *axes)

    @override
    def slid_out(self, motions: Motions) -> Scalar | None:
        if not self._is_free():
            return None
        bearing = motions[self.bearing_body]
        height = self._offset(motions).dot(bearing.direction(unit(self.bearing_axis)))
        return abs(height) - self.journal_length

    def _is_free(self) -> bool:
        return not self.axial.holds_centre and self.axial.shoulder_law() is None

    @override
    def centred_joint(self) -> AbstractConstraint:
        return self._ideal(self.bearing_point)

    @override
    def resting_joint(self, load: np.ndarray) -> AbstractConstraint | None:
        along = np.asarray(self.bearing_axis) / np.linalg.norm(self.bearing_axis)
        across = load - (load @ along) * along
        size = float(np.linalg.norm(across))
        # A load along the axis alone presses the journal against no side of the wall.
        if not size > LEAST_TRANSVERSE_LOAD * np.linalg.norm(load):
            return None
        # The contacts share the load: the axes are parallel, so that all are equally deep.
        laws = self.laws()
        sharing = [laws[label] for label in self.contact_labels()]
        distance = self.clearance + self._resting_depth(size, sharing)
        if self.bearing_profile is None:
            return self._ideal(self.bearing_point + distance / size * across)
        # The journal rests where the wall's normal is along the load. A profile is a deviation of
        # the support function: for each direction of the wall's normal, the amount by which the
        # wall is farther from the centre along this normal than the circle. Its derivative by the
        # angle of the normal, `slope` in m/rad, is the distance of the contact point from the line
        # through the bearing's centre along the normal. The journal's centre has the same distance.
        frame = transverse_axes(unit(Vector(*along)))
        x_axis, y_axis = (np.array([*direction], float) for direction in frame)
        wall = self.bearing_profile.at(math.atan2(across @ y_axis, across @ x_axis))
        beside = np.cross(along, across / size)
        offset = (distance + wall.value) / size * across + wall.slope * beside
        return self._ideal(self.bearing_point + np.asarray(offset))

    def _ideal(self, centre: Triple) -> AbstractConstraint:
        """Return the ideal joint that holds the journal's centre at the point `centre` of the
        bearing's body, (3,) m from its centre of mass in its axes."""
        joint_class = CylindricalJoint if self._is_free() else RevoluteJoint
        axes = self.bearing_axis, self.journal_axis
        return joint_class(*self.pair(), centre, self.journal_point, *axes)

    def _half(self) -> Vector:
        """Return the vector from the journal's centre to base W, m, in the journal's body axes."""
        return unit(self.journal_axis) * (0.5 * self.journal_length)

    @override
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        if not self.axial.holds_centre:
            return {}
        bearing, journal = motions[self.bearing_body], motions[self.journal_body]
        points = self.bearing_point, unit(self.bearing_axis), self.journal_point
        return {"axial": point_in_plane(self.pair(), bearing, journal, *points)}

    @override
    def draw(self, pen: AbstractPen) -> None:
        pen.bearing(
            Marker(self.bearing_body, self.bearing_point, self.bearing_axis),
            Marker(self.journal_body, self.journal_point, self.journal_axis),
            radius=self.bearing_radius,
            clearance=self.clearance,
            length=self.journal_length,
            profiles=(self.bearing_profile, self.journal_profile),
        )
