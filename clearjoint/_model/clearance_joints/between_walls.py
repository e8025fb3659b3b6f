"""Clearance joints between flat walls: a pin in a slot, and a slider in a guide."""

from dataclasses import KW_ONLY

import equinox as eqx
import numpy as np
from typing_extensions import override

from ..._fields.checks import require_axis, require_point
from ..._fields.objects import optional_quantity, quantity
from ..._fields.types import Single, Triple
from ..._math.rotations import unit
from ..._math.vectors import Scalar, add
from ..contact.friction import FrictionLaw
from ..contact.laws import AbstractContactLaw, require_flat_law
from ..joints.base import AbstractConstraint, Contact, Motions
from ..joints.ideal import LineInPlaneJoint, PointInPlaneJoint
from ..pen import AbstractPen, Marker
from .common import (
    AbstractFrictionJoint,
    require_right_angle,
    require_smaller_clearance,
)
from .journal_bases import SIDES

WALLS, ENDS = ("lower wall", "upper wall"), ("lower end", "upper end")
"""Labels of the contacts with the walls and the ends of the slot. The upper wall is on the side to
which the slot's normal points, the upper end on the side to which the slot's axis points."""


class PinInSlot(AbstractFrictionJoint):
    """A cylindrical pin in a straight slot, in which the pin slides and rotates, with play across.

    The pin touches one of two parallel walls when its centre is half the play from the middle, and
    one of two flat ends when it is half the travel from there. The contacts are called "lower wall"
    and "upper wall", along the normal, and "lower end" and "upper end", along the axis.

    Each contact is a line along the pin, perpendicular to axis and normal, and its force acts at
    the middle of the line. On a flat wall a line of length L has the stiffness (pi/4) E* L N/m with
    the exponent 1, where 1/E* is the sum of (1 - nu^2)/E of both materials (V. L. Popov, Contact
    Mechanics and Friction, chapter 5): pass this number as the stiffness of a law, such as
    `Hertz(stiffness, exponent=1.0)`. The other joints of a planar mechanism have to hold both
    bodies in the plane.

    **Arguments:**

    - `slot_body`, `pin_body`: names of the bodies; one may be the ground.
    - `slot_point`, `pin_point`: middle of the slot, and centre of the pin, (3,) m from each body's
      centre of mass in its axes; on the ground from the origin.
    - `slot_axis`, `slot_normal`: direction of the slot and normal of its walls, perpendicular to
      each other, (3,) in the axes of the slot's body, any length.
    - `pin_radius`: m.
    - `play`: m, the slot's width minus the pin's diameter.
    - `travel`: m, total distance that the pin can move between the ends; ``None``, the default, for
      a slot without ends.
    - `law`: normal law of the flat walls and ends; its stiffness must be given as a number.
    - `friction`: an `AbstractFriction` or `AbstractBristleFriction`; by default ``None``, for none.

    >>> law = cj.laws.HuntCrossley(0.8, 1e9, exponent=1.0)
    >>> slot = cj.PinInSlot("lever", "crank", play=0.1e-3, pin_radius=5e-3, travel=0.15, law=law)
    >>> list(slot.laws())
    ['lower wall', 'upper wall', 'lower end', 'upper end']
    """

    slot_body: str = eqx.field(static=True)
    pin_body: str = eqx.field(static=True)
    _: KW_ONLY
    play: Single = quantity(
        "m", positive=True, remedy="give the slot's width less the pin's diameter"
    )
    pin_radius: Single = quantity("m", positive=True)
    law: AbstractContactLaw  # pyright: ignore[reportGeneralTypeIssues]
    slot_point: Triple = quantity("m", check=require_point, default=(0.0, 0.0, 0.0))
    slot_axis: Triple = quantity("1", check=require_axis, default=(1.0, 0.0, 0.0))
    slot_normal: Triple = quantity("1", check=require_axis, default=(0.0, 1.0, 0.0))
    pin_point: Triple = quantity("m", check=require_point, default=(0.0, 0.0, 0.0))
    travel: Single | None = optional_quantity("m", positive=True)
    friction: FrictionLaw | None = None  # pyright: ignore[reportGeneralTypeIssues]
    point_fields = {"slot_point": "slot_body", "pin_point": "pin_body"}

    @override
    def _check_together(self) -> None:
        require_flat_law(self.law, "the slot's walls")
        require_right_angle("slot_axis", self.slot_axis, "slot_normal", self.slot_normal)

    @override
    def pair(self) -> tuple[str, str]:
        return self.slot_body, self.pin_body

    @override
    def contact_labels(self) -> tuple[str, ...]:
        return WALLS if self.travel is None else WALLS + ENDS

    @override
    def contacts(self, motions: Motions) -> dict[str, Contact]:
        # For each pair of walls: labels, direction to the upper one, and the distance that the
        # pin's centre can move between them.
        directions = [(WALLS, unit(self.slot_normal), self.play)]
        if self.travel is not None:
            directions.append((ENDS, unit(self.slot_axis), self.travel))
        contacts = {}
        for labels, outward, total_play in directions:
            for side, label in zip(SIDES, labels, strict=True):
                normal, half = outward * side, 0.5 * total_play
                contacts[label] = self._contact_with_wall(
                    motions, self.slot_point, normal, half, self.pin_point, self.pin_radius
                )
        return contacts

    @override
    def deepest_penetration(self) -> Scalar:
        return self.pin_radius

    @override
    def centred_joint(self) -> AbstractConstraint:
        """Return a joint that keeps the pin midway between the walls, but free along the slot."""
        return self._ideal(self.slot_point)

    @override
    def resting_joint(self, load: np.ndarray) -> AbstractConstraint | None:
        offset = self._offset_at_flat_wall(self.slot_normal, 0.5 * self.play, load)
        return None if offset is None else self._ideal(self.slot_point + offset)

    def _ideal(self, point: Triple) -> AbstractConstraint:
        return PointInPlaneJoint(*self.pair(), point, self.pin_point, self.slot_normal)

    @override
    def draw(self, pen: AbstractPen) -> None:
        slot = Marker(self.slot_body, self.slot_point, self.slot_axis)
        pin = Marker(self.pin_body, self.pin_point)
        pen.walls(slot, pin, self.slot_normal, distance=2.0 * self.pin_radius + self.play)
        pen.roller(pin, radius=self.pin_radius)


CORNERS = {
    "rear upper": (-1.0, 1.0),
    "front upper": (1.0, 1.0),
    "rear lower": (-1.0, -1.0),
    "front lower": (1.0, -1.0),
}
"""Label of each corner's contact, and signs of its position along the slider's axis and normal."""


class SliderInGuide(AbstractFrictionJoint):
    """A slider between two parallel walls of a guide: a translational joint with clearance.

    Each of the slider's four corners can touch the wall on its side and then applies the full
    normal law. The contacts are called "rear upper", "front upper", "rear lower" and "front lower",
    where front is along the slider's axis and upper along its normal. The slider can fly freely,
    pivot about one corner, rest on a wall with two corners, or jam between the walls (P. Flores, R.
    Leine and C. Glocker, Multibody System Dynamics 23, 2010; their corners 1 to 4 are the contacts
    in this order). The walls have no ends.

    The walls' forces act only in the plane of the slider's axis and normal. Other joints, such as a
    `RevoluteJoint` at the slider's pin, have to keep the slider in this plane. The angle of the
    slider to the guide has to stay below 90 degrees.

    **Arguments:**

    - `guide_body`, `slider_body`: names of the bodies; one may be the ground.
    - `guide_point`, `slider_point`: a point midway between the walls, and the slider's centre, (3,)
      m from each body's centre of mass in its axes; on the ground from the origin.
    - `guide_normal`: normal of the walls, from the lower to the upper, (3,) in the axes of the
      guide's body, any length.
    - `slider_axis`, `slider_normal`: perpendicular directions in the axes of the slider's body,
      (3,), any length.
    - `half_length`, `half_height`: half the slider's size along its axis and its normal, m.
    - `clearance`: m, on either side of a centred slider, smaller than `half_height`.
    - `law`: normal law of a corner at a flat wall; its stiffness must be given as a number.
    - `friction`: an `AbstractFriction` or `AbstractBristleFriction`; by default ``None``, for none.

    >>> law, sizes = cj.laws.ExactRestitution(0.4, 1e9), {"half_length": 0.05, "half_height": 0.025}
    >>> guide = cj.SliderInGuide("ground", "slider", **sizes, clearance=1e-3, law=law)
    >>> list(guide.laws())
    ['rear upper', 'front upper', 'rear lower', 'front lower']
    """

    guide_body: str = eqx.field(static=True)
    slider_body: str = eqx.field(static=True)
    _: KW_ONLY
    half_length: Single = quantity("m", positive=True)
    clearance: Single = quantity("m", positive=True, remedy="give the clearance on one side in m")
    half_height: Single = quantity("m", positive=True)
    law: AbstractContactLaw  # pyright: ignore[reportGeneralTypeIssues]
    guide_point: Triple = quantity("m", check=require_point, default=(0.0, 0.0, 0.0))
    guide_normal: Triple = quantity("1", check=require_axis, default=(0.0, 1.0, 0.0))
    slider_point: Triple = quantity("m", check=require_point, default=(0.0, 0.0, 0.0))
    slider_axis: Triple = quantity("1", check=require_axis, default=(1.0, 0.0, 0.0))
    slider_normal: Triple = quantity("1", check=require_axis, default=(0.0, 1.0, 0.0))
    friction: FrictionLaw | None = None  # pyright: ignore[reportGeneralTypeIssues]
    # The guide's point is left out, since it may be far away along the walls.
    point_fields = {"slider_point": "slider_body"}

    @override
    def _check_together(self) -> None:
        require_flat_law(self.law, "the guide's walls")
        require_smaller_clearance(self.clearance, self.half_height, "half the slider's height")
        require_right_angle("slider_axis", self.slider_axis, "slider_normal", self.slider_normal)

    @override
    def pair(self) -> tuple[str, str]:
        return self.guide_body, self.slider_body

    @override
    def contact_labels(self) -> tuple[str, ...]:
        return tuple(CORNERS)

    @override
    def contacts(self, motions: Motions) -> dict[str, Contact]:
        # A wall's distance from the middle is half the slider's height plus the clearance.
        upward, room = unit(self.guide_normal), add(self.half_height, self.clearance)
        along = unit(self.slider_axis) * self.half_length
        across = unit(self.slider_normal) * self.half_height
        contacts = {}
        for label, (forward, side) in CORNERS.items():
            corner = self.slider_point + along * forward + across * side
            contacts[label] = self._contact_with_wall(
                motions, self.guide_point, upward * side, room, corner, 0.0
            )
        return contacts

    @override
    def deepest_penetration(self) -> Scalar:
        return self.half_height

    @override
    def centred_joint(self) -> AbstractConstraint:
        return self._ideal(self.guide_point)

    @override
    def resting_joint(self, load: np.ndarray) -> AbstractConstraint | None:
        offset = self._offset_at_flat_wall(self.guide_normal, self.clearance, load, contacts=2)
        return None if offset is None else self._ideal(self.guide_point + offset)

    def _ideal(self, point: Triple) -> AbstractConstraint:
        points = point, self.slider_point
        return LineInPlaneJoint(*self.pair(), *points, self.guide_normal, self.slider_axis)

    @override
    def draw(self, pen: AbstractPen) -> None:
        guide = Marker(self.guide_body, self.guide_point)
        slider = Marker(self.slider_body, self.slider_point, self.slider_axis)
        sizes = 2.0 * self.half_length, 2.0 * self.half_height
        pen.walls(guide, slider, self.guide_normal, distance=sizes[1] + 2.0 * self.clearance)
        pen.block(slider, self.slider_normal, length=sizes[0], height=sizes[1])
