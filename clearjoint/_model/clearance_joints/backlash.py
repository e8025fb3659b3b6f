"""Backlash: angular play of two bodies about an axis that an ideal joint holds."""

from dataclasses import replace
from typing import Annotated

from typing_extensions import override

from ..._fields.cautions import quiet
from ..._fields.checks import as_number, require, require_axis, require_numbers, require_positive
from ..._fields.objects import quantity
from ..._fields.types import Single, Triple, TripleLike
from ..._math.rotations import unit
from ..._math.smoothing import TURN, wrapped
from ..._math.vectors import ZERO, Scalar
from ..contact.hunt_crossley import ExactRestitution
from ..contact.laws import AbstractContactLaw, Gap
from ..joints.base import AbstractNamedPair, Contact, Motions, Row
from ..joints.constraint_rows import relative_angle_row, row_rate
from .common import FLANKS, AbstractFlankJoint

DEFAULT_RADIUS = 0.01
"""Radius of the flanks, m, if it is not given: it does not influence the motion if stiffness and
play are given as a torsional stiffness and an angle."""


class Backlash(AbstractNamedPair, AbstractFlankJoint):
    """Angular play about an axis: the second body rotates freely between two flanks.

    With the second body's angle theta about the axis, from the middle of the play, and the radius r
    of the flanks, the penetrations are r (theta - play/2) at the upper and r (-theta - play/2) at
    the lower flank. The normal force F of a flank acts on the bodies as a couple F r without a net
    force, so that every normal law can be used (M. Nordin, P.-O. Gutman, Controlling mechanical
    systems with backlash: a survey, Automatica 38, 2002). A torsional stiffness of k N m/rad
    corresponds to k/r^2 N/m. Angles are taken modulo 2 pi: revolutions are unlimited.

    Backlash doesn't hold the axis. Add a `RevoluteJoint`, or another joint that allows the relative
    rotation. For two gears with separate axes use `GearBacklash`.

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `axis_first`, `axis_second`: direction of the axis of rotation in each body's axes, (3,), any
      length; z by default.
    - `play`: rad, total angle from flank to flank. Alternatively `play_length`: m, the arc length
      at `radius`, as specified for gears. The joint stores the angle.
    - `radius`: m, of the flanks. Optional, and without influence on the motion, with a
      `torsional_stiffness` and an angle `play`; 0.01 m by default.
    - `middle`: rad, the joint's angle (`quantities.JointAngle`) in the middle of the play, zero by
      default. If `axis_first` and `axis_second` have the same components, the joint's angle is zero
      when the body axes of both bodies are parallel.
    - `law`: normal law of each flank; its stiffness must be given as a number. Alternatively
      `torsional_stiffness`: N m/rad, of a pressed flank as in gearbox catalogues, with
      `restitution`, 0.5 by default; the law is then a linear `ExactRestitution`.

    **Raises:** `ValueError` unless exactly one of `play` and `play_length`, and exactly one of
    `law` and `torsional_stiffness`, is given; if a `law` is given with a `restitution`; if a `law`
    or a `play_length` is given without a `radius`; or if a value is invalid. **Warns:**
    `UnusualValueWarning` for a play of more than 0.5 rad or a radius of more than 10 m.

    >>> gearbox = cj.Backlash("motor", "link", play=1e-3, torsional_stiffness=2e4)
    >>> list(gearbox.laws())
    ['lower flank', 'upper flank']
    """

    axis_first: Triple = quantity("1", check=require_axis)
    axis_second: Triple = quantity("1", check=require_axis)
    play: Single = quantity(
        "rad",
        positive=True,
        usual=(0.0, 0.5),
        remedy="give the whole angle from flank to flank in rad, or a `play_length` in m",
    )
    radius: Single = quantity(
        "m", positive=True, usual=(0.0, 10.0), remedy="give the flanks' radius in m"
    )
    middle: Single = quantity("rad", shape=())
    law: AbstractContactLaw  # pyright: ignore[reportGeneralTypeIssues]

    def __init__(
        self,
        first: str,
        second: str,
        *,
        axis_first: TripleLike = (0.0, 0.0, 1.0),
        axis_second: TripleLike = (0.0, 0.0, 1.0),
        play: Scalar | None = None,
        play_length: Annotated[Scalar | None, "m"] = None,
        radius: Scalar | None = None,
        middle: Scalar = 0.0,
        law: AbstractContactLaw | None = None,
        torsional_stiffness: Annotated[Scalar | None, "N m/rad"] = None,
        restitution: Annotated[Scalar | None, "1"] = None,
    ):
        exactly_one = (play is None) != (play_length is None)
        expected = "given if and only if `play_length` is not"
        remedy = "pass one of the two: an angle in rad, or a length at the radius in m"
        require(exactly_one, "play", play, expected, remedy)
        # A torsional stiffness takes the place of a law. It makes the radius arbitrary, since the
        # law's stiffness is then the torsional stiffness over the square of the radius.
        if law is None and radius is None:
            expected, remedy = "given with a `play_length`", "pass the flanks' radius in m"
            require(play_length is None, "radius", None, expected, remedy)
            radius = DEFAULT_RADIUS
        # The radius is checked before other values are divided by it: with a wrong radius, later
        # checks would blame those values.
        self.radius, self.middle = as_number(radius, "radius", "m"), middle
        require_positive("radius", self.radius, "give the flanks' radius in m")
        if law is None:
            expected = "given, or else a `torsional_stiffness`"
            remedy = "pass the stiffness of a pressed flank in N m/rad, or a normal law"
            require(torsional_stiffness is not None, "law", None, expected, remedy)
            torsional = as_number(torsional_stiffness, "torsional_stiffness", "N m/rad")
            require_positive("torsional_stiffness", torsional, "give it in N m/rad")
            # An angle beyond the flank gives the penetration angle * radius, and a force gives the
            # couple force * radius.
            stiffness = torsional / self.radius**2
            restitution = 0.5 if restitution is None else restitution
            # The user has not given this stiffness, of which a usual drive would warn.
            with quiet():
                law = ExactRestitution(restitution=restitution, stiffness=stiffness, exponent=1.0)
        else:
            excluded = {"torsional_stiffness": torsional_stiffness, "restitution": restitution}
            for name, value in excluded.items():
                require(value is None, name, value, "omitted with a `law`", "leave one out")
        self.first, self.second = first, second
        self.axis_first, self.axis_second, self.law = axis_first, axis_second, law
        if play is None:
            self.play = as_number(play_length, "play_length", "m") / self.radius
        else:
            self.play = as_number(play, "play", "rad")

    @override
    def _check_together(self) -> None:
        expected = "smaller than a full revolution"
        remedy = "give the angle from flank to flank in rad"
        require_numbers(lambda play: play < TURN, "play", (self.play,), expected, remedy)

    @override
    def deepest_penetration(self) -> Scalar:
        # Half of the penetration opposite the middle of the play, where the angle jumps by 2 pi,
        # and the contact would change to the other flank.
        return 0.25 * self.radius * (TURN - self.play)

    def relative_angle(self, motions: Motions) -> Row:
        """Return the second body's angle about the axis, rad in [-pi, pi], as a `Row`. This angle
        is equal to the field `middle` in the middle of the play."""
        return relative_angle_row(*self._between(motions), self.axis_first, self.axis_second)

    @override
    def contacts(self, motions: Motions) -> dict[str, Contact]:
        row = self.relative_angle(motions)
        # The angle modulo 2 pi allows any number of revolutions, with unchanged derivatives.
        angle = wrapped(row.value - self.middle, TURN)
        speed = row_rate(row, motions)
        axis = motions[self.first].direction(unit(self.axis_first))
        contacts = {}
        for label, side in FLANKS.items():
            arm = side * self.radius
            gap = Gap(arm * angle - 0.5 * self.radius * self.play, arm * speed)
            # The contact transmits a moment only. `turning` consists of the derivatives of the
            # penetration by the rotations of both bodies, m/rad in body axes, one vector for each
            # body; the moment on a body is -F times its vector, with the normal force F. The
            # penetration is `arm` times the angle plus a constant, so that its derivatives are
            # `arm` times those of the angle. A couple has no point of action: the contact's points
            # are arbitrary.
            by_first, by_second = (row.jacobian[name].moment * arm for name in self.pair())
            turning = by_first, by_second
            contacts[label] = Contact(gap, axis * side, ZERO, ZERO, slip=None, turning=turning)
        return contacts

    @override
    def centred_rows(self, motions: Motions) -> dict[str, Row]:
        row = self.relative_angle(motions)
        return {"angle": replace(row, value=wrapped(row.value - self.middle, TURN))}
