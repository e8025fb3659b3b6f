"""Translational joint with clearance: a slider between the two walls of a guide."""

import equinox as eqx
import numpy as np

from ...fields.checks import require_axis, require_point
from ...fields.declarations import quantity
from ...fields.types import Single, Triple
from ...math.rotations import unit
from ...math.vectors import Scalar, add
from ..contact.bristles import AbstractBristleFriction
from ..contact.friction import AbstractFriction
from ..contact.laws import AbstractContactLaw, require_flat_law
from ..joints.base import AbstractConstraint, Attachment, Contact, Motions
from ..joints.planes import LineInPlaneJoint
from ..pen import AbstractPen, Marker
from .common import (
    AbstractSharedLawJoint,
    FlatWall,
    offset_at_flat_wall,
    require_right_angle,
    require_smaller_clearance,
)

CORNERS = {
    "rear upper": (-1.0, 1.0),
    "front upper": (1.0, 1.0),
    "rear lower": (-1.0, -1.0),
    "front lower": (1.0, -1.0),
}
"""Label of each corner's contact, and the signs of its position along the slider's axis and
normal."""


class SliderInGuide(AbstractSharedLawJoint):
    """A slider between two parallel walls of a guide: a translational joint with clearance.

    Each of the slider's four corners can touch the wall on its side and then applies the full
    normal law. The slider can fly freely, pivot about one corner, rest on a wall with two corners,
    or jam between the walls (P. Flores, R. Leine and C. Glocker, Multibody System Dynamics 23,
    2010; their corners 1 to 4 are the contacts in order). The walls have no ends.

    Only the walls hold the slider: the other joints of a planar mechanism, such as a
    `RevoluteJoint` at its pin, have to hold it perpendicular to the plane of its axis and normal.
    The angle between slider and guide has to stay below 90 degrees.

    **Arguments:**

    - `guide_body`, `slider_body`: names of the bodies; one may be the ground.
    - `guide_point`: a point midway between the walls, (3,) m in the axes of the guide's body.
    - `guide_normal`: normal of the walls, from the lower to the upper, (3,) in the same axes, any
      length.
    - `slider_point`: the slider's centre, (3,) m in its body's axes.
    - `slider_axis`, `slider_normal`: perpendicular directions in the same axes, (3,), any length.
    - `half_length`, `half_height`: half the slider's size along its axis and its normal, m.
    - `clearance`: m, on either side of a centred slider.
    - `law`: normal law of a corner; it needs an explicit stiffness, because the walls are flat.
    - `friction`: an `AbstractFriction`, an `AbstractBristleFriction`, or ``None``.

    **Raises:** `ValueError` if the axis is not perpendicular to the normal, the law takes its
    stiffness from radii, or another value is outside its range.

    ```python
    import clearjoint as cj

    guide = cj.SliderInGuide(
        "ground",
        "slider",
        half_length=0.05,
        half_height=0.025,
        clearance=1e-3,
        law=cj.laws.ExactRestitution(0.4, 1e9),
        friction=cj.frictions.RegularisedCoulomb(0.01),
    )
    ```
    """

    guide_body: str = eqx.field(static=True)
    slider_body: str = eqx.field(static=True)
    half_length: Single = quantity("m", positive=True, kw_only=True)
    clearance: Single = quantity(
        "m", positive=True, remedy="give the clearance on one side in m", kw_only=True
    )
    half_height: Single = quantity("m", positive=True, kw_only=True)
    law: AbstractContactLaw = eqx.field(kw_only=True)  # pyright: ignore[reportGeneralTypeIssues]
    guide_point: Triple = quantity("m", check=require_point, default=(0.0, 0.0, 0.0), kw_only=True)
    guide_normal: Triple = quantity("1", check=require_axis, default=(0.0, 1.0, 0.0), kw_only=True)
    slider_point: Triple = quantity("m", check=require_point, default=(0.0, 0.0, 0.0), kw_only=True)
    slider_axis: Triple = quantity("1", check=require_axis, default=(1.0, 0.0, 0.0), kw_only=True)
    slider_normal: Triple = quantity("1", check=require_axis, default=(0.0, 1.0, 0.0), kw_only=True)
    friction: AbstractFriction | AbstractBristleFriction | None = eqx.field(  # pyright: ignore[reportGeneralTypeIssues]
        default=None, kw_only=True
    )

    def _check_together(self) -> None:
        require_flat_law(self.law, "the guide's walls")
        require_smaller_clearance(self.clearance, self.half_height, "half the slider's height")
        require_right_angle("slider_axis", self.slider_axis, "slider_normal", self.slider_normal)

    def pair(self) -> tuple[str, str]:
        """Return the names of the guide's body and the slider's body."""
        return self.guide_body, self.slider_body

    def contact_labels(self) -> tuple[str, ...]:
        """Return the labels of the four corners' contacts."""
        return tuple(CORNERS)

    def attachments(self) -> tuple[Attachment, ...]:
        """Return the slider's centre, m in body axes."""
        return (("slider_point", self.slider_body, self.slider_point),)

    def contacts(self, motions: Motions) -> dict[str, Contact]:
        """Return the geometry of each corner's contact with the wall on its side, by label."""
        guide, slider = (motions[name] for name in self.pair())
        upward, room = unit(self.guide_normal), add(self.half_height, self.clearance)
        # A wall's distance from the middle is half the slider's height plus the clearance.
        walls = {side: FlatWall(self.guide_point, upward * side, room) for side in (1.0, -1.0)}
        along = unit(self.slider_axis) * self.half_length
        across = unit(self.slider_normal) * self.half_height
        contacts = {}
        for label, (forward, side) in CORNERS.items():
            corner = self.slider_point + along * forward + across * side
            has_friction = self.friction is not None
            contacts[label] = walls[side].contact(guide, slider, corner, 0.0, has_friction)
        return contacts

    def deepest(self) -> dict[str, Scalar]:
        """Return the largest meaningful penetration of each corner by label, m: `half_height`."""
        deepest: Scalar = self.half_height
        return dict.fromkeys(CORNERS, deepest)

    def centred_joint(self) -> AbstractConstraint:
        """Return the ideal joint that keeps the slider's axis in the middle plane of the guide."""
        return self._ideal(self.guide_point)

    def resting_joint(self, load: np.ndarray) -> AbstractConstraint | None:
        """Return the ideal joint that holds the slider where a load, (3,) N, presses it."""
        offset = offset_at_flat_wall(self.guide_normal, self.clearance, load)
        return None if offset is None else self._ideal(self.guide_point + offset)

    def _ideal(self, point: Triple) -> AbstractConstraint:
        axes = self.guide_normal, self.slider_axis
        return LineInPlaneJoint(*self.pair(), point, self.slider_point, *axes)

    def draw(self, pen: AbstractPen) -> None:
        """Draw two walls and a block between them."""
        guide = Marker(self.guide_body, self.guide_point)
        slider = Marker(self.slider_body, self.slider_point, self.slider_axis)
        sizes = 2.0 * self.half_length, 2.0 * self.half_height
        pen.walls(guide, slider, self.guide_normal, distance=sizes[1] + 2.0 * self.clearance)
        pen.block(slider, self.slider_normal, length=sizes[0], height=sizes[1])
