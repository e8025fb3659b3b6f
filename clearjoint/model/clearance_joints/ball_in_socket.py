"""The spherical joint with clearance: a ball in a slightly larger socket."""

import equinox as eqx
import numpy as np

from ...fields.checks import require_point
from ...fields.declarations import quantity
from ...fields.types import Single, Triple
from ...math.smoothing import norm_and_direction
from ...math.vectors import Scalar, Vector, subtract
from ..contact.bristles import AbstractBristleFriction
from ..contact.friction import AbstractFriction
from ..contact.gap import Gap, slip_velocity
from ..contact.laws import AbstractContactLaw
from ..contact.limits import Limit, caution_beyond
from ..joints.base import AbstractConstraint, Attachment, Contact, Motions
from ..joints.ideal import SphericalJoint
from ..pen import AbstractPen, Marker
from .clearance import LARGEST_BEARING
from .common import AbstractPlay, anchor_of, offset_between, require_smaller_clearance

CONTACT = "ball"


class BallInSocket(AbstractPlay):
    """A ball in a slightly larger socket: a spherical joint with clearance.

    One contact, "ball", along the line of the centres: penetration e - c of an eccentricity e in a
    clearance c (P. Flores et al., Dynamics of multibody systems with spherical clearance joints,
    2006). Its law knows both radii, so that `RavnStiffness`, Hertz's stiffness of a sphere in a
    sphere, follows them. A ball is stopped in all directions and turns in all.

    **Arguments:**

    - `socket_body`, `ball_body`: names; one may be the ground.
    - `socket_point`, `ball_point`: centres, (3,) m in body axes.
    - `socket_radius` and radial `clearance`: m; the ball's radius is their difference.
    - `law`: the normal law.
    - `friction`: an `AbstractFriction`, an `AbstractBristleFriction`, or ``None``.

    **Raises:** `ValueError` for a clearance that leaves no ball, or values that no joint can have.

    ```python
    import clearjoint as cj

    law = cj.laws.LankaraniNikravesh(0.9, cj.laws.RavnStiffness(207e9, 0.3))
    tip = cj.BallInSocket("rocker", "coupler", socket_radius=10e-3, clearance=0.2e-3, law=law)
    ```
    """

    socket_body: str = eqx.field(static=True)
    ball_body: str = eqx.field(static=True)
    clearance: Single = quantity(
        "m", positive=True, remedy="give the radial clearance in m", kw_only=True
    )
    socket_radius: Single = quantity(
        "m",
        positive=True,
        usual=(0.0, LARGEST_BEARING),
        remedy="give lengths in m; 1 mm is 1e-3 m",
        kw_only=True,
    )
    law: AbstractContactLaw = eqx.field(kw_only=True)  # pyright: ignore[reportGeneralTypeIssues]
    socket_point: Triple = quantity("m", check=require_point, default=(0.0, 0.0, 0.0), kw_only=True)
    ball_point: Triple = quantity("m", check=require_point, default=(0.0, 0.0, 0.0), kw_only=True)
    friction: AbstractFriction | AbstractBristleFriction | None = eqx.field(  # pyright: ignore[reportGeneralTypeIssues]
        default=None, kw_only=True
    )

    def _check_together(self) -> None:
        require_smaller_clearance(self.clearance, self.socket_radius, "the socket's radius")

    def _caution_together(self) -> None:
        caution_beyond(self.law_limits(CONTACT, 0.0), "clearance")

    def pair(self) -> tuple[str, str]:
        """The socket's body and the ball's."""
        return self.socket_body, self.ball_body

    def places(self) -> tuple[str, ...]:
        """The one contact."""
        return (CONTACT,)

    def attachments(self) -> tuple[Attachment, ...]:
        """Both centres."""
        return (
            ("socket_point", self.socket_body, self.socket_point),
            ("ball_point", self.ball_body, self.ball_point),
        )

    def contacts(self, motions: Motions) -> dict[str, Contact]:
        """The contact along the line of the centres."""
        socket, ball = motions[self.socket_body], motions[self.ball_body]
        apart = offset_between(self.pair(), (socket, ball), (self.socket_point, self.ball_point))
        eccentricity, normal = norm_and_direction(apart)
        at_centre = ball.velocity_at(self.ball_point) - socket.velocity_at(self.socket_point)
        radii = self.socket_radius, self.clearance
        gap = Gap(eccentricity - self.clearance, at_centre.dot(normal), *radii)
        # Friction acts on both bodies at one point, midway between the surfaces.
        shift = 0.5 * gap.depth
        on_socket = self.socket_point + socket.components(normal * (self.socket_radius + shift))
        reach = normal * subtract(gap.journal_radius, shift)
        on_ball = self.ball_point + ball.components(reach)
        slip = None
        if self.friction is not None:
            sliding = ball.velocity_at(on_ball) - socket.velocity_at(on_socket)
            slip = slip_velocity(sliding, normal, sliding.dot(normal))
        centres = self.socket_point, self.ball_point
        return {CONTACT: Contact(gap, normal, on_socket, on_ball, slip, *centres)}

    def deepest(self) -> dict[str, Scalar]:
        """The ball's radius."""
        return {CONTACT: subtract(self.socket_radius, self.clearance)}

    def law_limits(self, name: str, depth: Scalar) -> tuple[Limit, ...]:
        """Those of the law."""
        del name
        return self.law.limits(Gap(depth, 0.0, self.socket_radius, self.clearance))

    def centred_joint(self) -> AbstractConstraint:
        """A spherical joint."""
        return SphericalJoint(*self.pair(), self.socket_point, self.ball_point)

    def resting_joint(self, load: np.ndarray) -> AbstractConstraint | None:
        """The same with the ball along the wall, in the direction of the load; ``None`` if there is
        no load."""
        size = np.linalg.norm(load)
        if not size > 0.0:
            return None
        centre = self.socket_point + self.clearance / size * load
        return SphericalJoint(*self.pair(), centre, self.ball_point)

    def anchor(self) -> tuple[str, Vector, Vector] | None:
        """The ball's centre at the socket's, or the other way round, if one is the ground's."""
        return anchor_of(self.pair(), (self.socket_point, self.ball_point))

    def draw(self, pen: AbstractPen) -> None:
        """A ball in a socket."""
        socket = Marker(self.socket_body, self.socket_point)
        ball = Marker(self.ball_body, self.ball_point)
        pen.socket(socket, ball, radius=self.socket_radius, clearance=self.clearance)
