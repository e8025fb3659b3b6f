"""The translational joint with clearance: a slider between the two walls of a guide."""

import equinox as eqx
import numpy as np

from ...fields.checks import require_axis, require_point
from ...fields.declarations import quantity
from ...fields.types import Single, Triple
from ...math.rotations import unit
from ...math.vectors import Scalar, add
from ..contact.bristles import AbstractBristleFriction
from ..contact.flat_surfaces import require_flat_law
from ..contact.friction import AbstractFriction
from ..contact.laws import AbstractContactLaw
from ..joints.base import AbstractConstraint, Attachment, Contact, Motions
from ..joints.planes import LineInPlaneJoint
from ..pen import AbstractPen, Marker
from .common import AbstractPlay, require_right_angle, require_smaller_clearance
from .flat_walls import FlatWall
from .seating import seat_on_plane

CORNERS = {
    "rear upper": (-1.0, 1.0),
    "front upper": (1.0, 1.0),
    "rear lower": (-1.0, -1.0),
    "front lower": (1.0, -1.0),
}
"""Signs of each corner along the slider's axis, and along its normal."""


class SliderInGuide(AbstractPlay):
    """A slider between two parallel walls of a guide: a translational joint with clearance.

    Each of the slider's four corners may touch the wall on its side, with the whole law, so that it
    flies, turns about one corner, lies on a wall with two, or jams between the walls (P. Flores, R.
    Leine and C. Glocker, Multibody System Dynamics 23, 2010; the corners 1 to 4 there are those of
    `contacts` in order). The walls have no ends.

    Only the walls hold the slider: the joints of a planar mechanism, such as a `RevoluteJoint` at
    its pin, have to hold it across the plane of its axis and normal. It has to stay turned by less
    than a right angle against the guide.

    **Arguments:**

    - `guide_body`, `slider_body`: names; one may be the ground.
    - `guide_point`: a point midway between the walls, (3,) m in the guide's body axes, and the
      walls' `guide_normal`, (3,) there, any length: from the lower to the upper.
    - `slider_point`: the slider's centre, (3,) m in its body axes; its `slider_axis` and, at a
      right angle, `slider_normal`, (3,) there, any length.
    - `half_length`, `half_height`: of the slider along its axis and its normal, m.
    - `clearance`: m, on either side where the slider is centred.
    - `law`: the normal law of a corner, with a given stiffness (walls are flat).
    - `friction`: an `AbstractFriction`, an `AbstractBristleFriction`, or ``None``.

    **Raises:** `ValueError` for an axis that is not at a right angle to the normal, a law that
    needs radii, or values that no joint can have.

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
        """The guide's body and the slider's."""
        return self.guide_body, self.slider_body

    def places(self) -> tuple[str, ...]:
        """The four corners."""
        return tuple(CORNERS)

    def attachments(self) -> tuple[Attachment, ...]:
        """The slider's centre."""
        return (("slider_point", self.slider_body, self.slider_point),)

    def contacts(self, motions: Motions) -> dict[str, Contact]:
        """Each corner with the wall on its side."""
        guide, slider = (motions[name] for name in self.pair())
        upward, room = unit(self.guide_normal), add(self.half_height, self.clearance)
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
        """Half of the slider's height."""
        deepest: Scalar = self.half_height
        return dict.fromkeys(CORNERS, deepest)

    def centred_joint(self) -> AbstractConstraint:
        """The slider's axis in the middle plane of the guide."""
        return self._ideal(self.guide_point)

    def resting_joint(self, load: np.ndarray) -> AbstractConstraint | None:
        """The slider along the wall that the load presses it to; ``None`` if the load has no part
        across the walls."""
        offset = seat_on_plane(self.guide_normal, self.clearance, load)
        return None if offset is None else self._ideal(self.guide_point + offset)

    def _ideal(self, point: Triple) -> AbstractConstraint:
        axes = self.guide_normal, self.slider_axis
        return LineInPlaneJoint(*self.pair(), point, self.slider_point, *axes)

    def draw(self, pen: AbstractPen) -> None:
        """Two walls, and a block between them."""
        guide = Marker(self.guide_body, self.guide_point)
        slider = Marker(self.slider_body, self.slider_point, self.slider_axis)
        sizes = 2.0 * self.half_length, 2.0 * self.half_height
        pen.walls(guide, slider, self.guide_normal, distance=sizes[1] + 2.0 * self.clearance)
        pen.block(slider, self.slider_normal, length=sizes[0], height=sizes[1])
