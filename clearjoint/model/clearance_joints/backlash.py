"""Backlash: the play of two bodies about an axis that an ideal joint holds."""

import math
from dataclasses import replace
from typing import Annotated

import equinox as eqx

from ...fields.checks import as_number, checkable, require, require_axis, require_positive
from ...fields.declarations import quantity
from ...fields.types import Single, Triple, TripleLike
from ...math.functions import wrapped
from ...math.rotations import unit
from ...math.vectors import ZERO, Scalar, Vector, add
from ..contact.damping_factors import ExactRestitution
from ..contact.flat_surfaces import require_flat_law
from ..contact.gap import Gap
from ..contact.laws import AbstractContactLaw
from ..contact.limits import Limit
from ..joints.base import AbstractConstraint, AbstractContactJoint, Contact, Motions, Row
from ..joints.constraint_rows import turning_about_axes
from ..joints.pairs import require_distinct
from .flanks import FLANKS, SIDE_OF

TURN = 2.0 * math.pi
WIDEST_PLAY = 0.5
"""rad, beyond which one is warned."""
LARGEST_RADIUS = 10.0
"""Likewise of the flanks, m."""


GIVEN_NO_RADIUS = 0.01
"""m; where stiffness is torsional, the flanks' radius has no part in the motion."""


def _flank_law(
    radius: Scalar, torsional_stiffness: Scalar | None, restitution: Scalar | None
) -> AbstractContactLaw:
    """The linear law of flanks of a stiffness in N m/rad."""
    require(
        torsional_stiffness is not None,
        "law",
        None,
        "given, or else a `torsional_stiffness`",
        "pass the stiffness of a pressed flank in N m/rad, or a normal law",
    )
    turning = as_number(torsional_stiffness, "torsional_stiffness", "N m/rad")
    require_positive("torsional_stiffness", turning, "give it in N m/rad")
    stiffness = turning / as_number(radius, "radius", "m") ** 2
    restitution = 0.5 if restitution is None else restitution
    return ExactRestitution(restitution=restitution, stiffness=stiffness, exponent=1.0)


class Backlash(AbstractContactJoint):
    """Play about an axis: within it the second body turns freely, and two flanks end it.

    With theta the second body's angle about the axis, less that of the middle of the play, and r
    the radius of the flanks, their penetrations are

        delta = r (theta - play/2) at the upper flank, r (-theta - play/2) at the lower one,

    and a flank's normal force F turns the bodies by the couple F r: no net force. So all normal
    laws act as they do elsewhere; a torsional stiffness of k N m/rad is k/r^2 N/m there, and the
    radius has no part in the motion. Angles
    count modulo 2 pi from the middle of the play: the number of revolutions is unlimited.

    It does not hold the axis: a `RevoluteJoint` beside it does, or another joint that leaves the
    bodies to turn against each other. For a pair of gears on axes of their own: `GearBacklash`.

    **Arguments:**

    - `first`, `second`: names of the bodies; one may be the ground.
    - `axis_first`, `axis_second`: the axis, (3,) in the axes of each body, as the revolute joint's.
    - `play`: rad, all of it, from flank to flank; or `play_length`, m, the same as a length at the
      `radius`, as it is given for gears. The angle is what is stored.
    - `radius`: m, at which the flanks touch; 0.01 m unless given, with a `torsional_stiffness`.
    - `middle`: rad, the joint's angle (`quantities.JointAngle`) in the middle of the play.
    - `law`: the normal law of each flank, with a given stiffness; or `torsional_stiffness`,
      N m/rad, of a flank that is pressed, as catalogues of gearboxes have it, with `restitution`,
      0.5 unless given: the law is then `ExactRestitution`, linear.

    **Raises:** `ValueError` for a play that is not positive or a whole turn, or given twice; for
    axes of no length; for a law whose stiffness needs a bearing; for both or neither of `law` and
    `torsional_stiffness`.

    Source: the dead zone of two flanks with a contact law (M. Nordin, P.-O. Gutman, Controlling
    mechanical systems with backlash: a survey, Automatica 38, 2002).

    ```python
    import clearjoint as cj

    axis = (0, 0, 1)
    bodies = {"motor": cj.Body(1.0, (1e-3, 1e-3, 1e-3)), "link": cj.Body(2.0, (0.1, 0.1, 0.1))}
    joints = {
        "shaft": cj.RevoluteJoint("ground", "motor", (0, 0, 0), (0, 0, 0), axis, axis),
        "hinge": cj.RevoluteJoint("motor", "link", (0, 0, 0), (0, 0, 0), axis, axis),
        "gearbox": cj.Backlash("motor", "link", play=1e-3, torsional_stiffness=2e4),
    }
    scene = cj.Scene(bodies, joints)
    ```
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    axis_first: Triple = quantity("1", check=require_axis)
    axis_second: Triple = quantity("1", check=require_axis)
    play: Single = quantity(
        "rad",
        positive=True,
        usual=(0.0, WIDEST_PLAY),
        remedy="give the whole angle from flank to flank in rad, or a `play_length` in m",
    )
    radius: Single = quantity(
        "m", positive=True, usual=(0.0, LARGEST_RADIUS), remedy="give the flanks' radius in m"
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
        require(
            (play is None) != (play_length is None),
            "play",
            play,
            "given if and only if `play_length` is not",
            "pass one of the two: an angle in rad, or a length at the radius in m",
        )
        if law is None:
            radius = GIVEN_NO_RADIUS if radius is None else radius
            law = _flank_law(radius, torsional_stiffness, restitution)
        else:
            given = {"torsional_stiffness": torsional_stiffness, "restitution": restitution}
            for name, value in given.items():
                require(value is None, name, value, "absent beside a `law`", "leave one out")
        self.first, self.second = first, second
        self.axis_first, self.axis_second, self.law = axis_first, axis_second, law
        self.radius, self.middle = as_number(radius, "radius", "m"), middle
        if play is None:
            self.play = as_number(play_length, "play_length", "m") / self.radius
        else:
            self.play = as_number(play, "play", "rad")

    def __check_init__(self):
        require_distinct(self.first, self.second)
        require_flat_law(self.law, "flanks")

    def _check_together(self) -> None:
        if (known := checkable(self.play)) is not None:
            (play,) = known
            require(
                play < TURN,
                "play",
                play,
                "smaller than a turn",
                "give the angle from flank to flank in rad",
            )

    def pair(self) -> tuple[str, str]:
        """The first and the second body."""
        return self.first, self.second

    def laws(self) -> dict[str, AbstractContactLaw]:
        """The law of each flank."""
        return dict.fromkeys(FLANKS, self.law)

    def law_limits(self, name: str, depth: Scalar) -> tuple[Limit, ...]:
        """Those of the law at a flat surface."""
        return self.laws()[name].limits(Gap(depth, 0.0))

    def deepest(self) -> dict[str, Scalar]:
        """Half of the way from a flank to the back of the other one."""
        return dict.fromkeys(FLANKS, 0.25 * self.radius * (TURN - self.play))

    def relative_angle(self, motions: Motions) -> Row:
        """The second body's angle about the axis, rad within (-pi, pi], as a row."""
        first, second = motions[self.first], motions[self.second]
        return turning_about_axes(self.pair(), first, second, self.axis_first, self.axis_second)

    def contacts(self, motions: Motions) -> dict[str, Contact]:
        """Contact geometry of both flanks."""
        row = self.relative_angle(motions)
        angle = wrapped(row.value - self.middle, TURN)
        speed = add(*(motions[name].power(row.jacobian[name]) for name in self.pair()))
        axis = motions[self.first].direction(unit(self.axis_first))
        return {label: self._flank(SIDE_OF[label], angle, speed, axis, row) for label in FLANKS}

    def _flank(self, side: float, angle: Scalar, speed: Scalar, axis: Vector, row: Row) -> Contact:
        arm = side * self.radius
        gap = Gap(arm * angle - 0.5 * self.radius * self.play, arm * speed)
        first, second = (row.jacobian[name].moment * arm for name in self.pair())
        return Contact(gap, axis * side, ZERO, ZERO, None, turning=(first, second))

    def friction_force(self, name: str, contact: Contact, normal_force: Scalar) -> Vector | None:
        """None: a couple has no place to slip."""
        del name, contact, normal_force

    def centred_joint(self) -> AbstractConstraint:
        """Holds the angle in the middle of the play."""
        return HeldInPlay(self)


class HeldInPlay(AbstractConstraint):
    """Holds two bodies in the middle of their play; one row."""

    backlash: Backlash

    def body_names(self) -> tuple[str, ...]:
        """Names of the first and the second body."""
        return self.backlash.pair()

    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        """The angle from the middle of the play, rad."""
        del t
        row = self.backlash.relative_angle(motions)
        angle = wrapped(row.value - self.backlash.middle, TURN)
        return {"angle": replace(row, value=angle)}
