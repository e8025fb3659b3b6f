"""The spherical joint with clearance: a ball in a slightly larger socket."""

from dataclasses import KW_ONLY

import equinox as eqx
import numpy as np
from typing_extensions import override

from ..._fields.checks import require_point
from ..._fields.objects import quantity
from ..._fields.types import Single, Triple
from ..._math.smoothing import norm_and_direction
from ..._math.vectors import Scalar, subtract
from ..contact.friction import FrictionLaw
from ..contact.laws import AbstractContactLaw, Gap, caution_beyond
from ..joints.base import AbstractConstraint, Contact, Motions
from ..joints.ideal import SphericalJoint
from ..pen import AbstractPen, Marker
from .common import AbstractCentredJoint, require_smaller_clearance

CONTACT = "ball"


class BallInSocket(AbstractCentredJoint):
    """A ball in a slightly larger socket: a spherical joint with clearance.

    The joint has one contact, "ball", along the line of centres. Its penetration is e - c, where
    the eccentricity e is the distance between the two centres and c the clearance (P. Flores et
    al., Dynamics of multibody systems with spherical clearance joints, 2006). The law receives both
    radii, so that `RavnStiffness`, Hertz's stiffness of a sphere in a sphere, can depend on them.

    **Arguments:**

    - `socket_body`, `ball_body`: names of the bodies; one may be the ground.
    - `socket_point`, `ball_point`: centres, (3,) m from each body's centre of mass in its axes; on
      the ground from the origin.
    - `socket_radius` and radial `clearance`: m; the ball's radius is their difference.
    - `law`: normal law of the contact.
    - `friction`: an `AbstractFriction` or `AbstractBristleFriction`; by default ``None``, for none.

    **Warns:** `UnusualValueWarning` for a socket radius of more than 2 m; `LawRangeWarning` for a
    clearance outside the range of `law`.

    >>> law = cj.laws.LankaraniNikravesh(0.9, cj.mechanisms.STEEL)
    >>> tip = cj.BallInSocket("rocker", "coupler", socket_radius=10e-3, clearance=0.2e-3, law=law)
    >>> print(f"{tip.deepest_penetration():.4f} m")  # the ball's radius
    0.0098 m
    """

    socket_body: str = eqx.field(static=True)
    ball_body: str = eqx.field(static=True)
    _: KW_ONLY
    clearance: Single = quantity("m", positive=True, remedy="give the radial clearance in m")
    socket_radius: Single = quantity(
        "m", positive=True, usual=(0.0, 2.0), remedy="give lengths in m; 1 mm is 1e-3 m"
    )
    law: AbstractContactLaw  # pyright: ignore[reportGeneralTypeIssues]
    socket_point: Triple = quantity("m", check=require_point, default=(0.0, 0.0, 0.0))
    ball_point: Triple = quantity("m", check=require_point, default=(0.0, 0.0, 0.0))
    friction: FrictionLaw | None = None  # pyright: ignore[reportGeneralTypeIssues]
    point_fields = {"socket_point": "socket_body", "ball_point": "ball_body"}

    @override
    def _check_together(self) -> None:
        require_smaller_clearance(self.clearance, self.socket_radius, "the socket's radius")

    @override
    def _caution_together(self) -> None:
        caution_beyond(self.law_limits(CONTACT, 0.0), "clearance")

    @override
    def contact_labels(self) -> tuple[str, ...]:
        return (CONTACT,)

    @override
    def contacts(self, motions: Motions) -> dict[str, Contact]:
        socket, ball = motions[self.socket_body], motions[self.ball_body]
        eccentricity, normal = norm_and_direction(self._offset(motions))
        velocity = ball.velocity_at(self.ball_point) - socket.velocity_at(self.socket_point)
        gap = self._gap(eccentricity - self.clearance, velocity.dot(normal))
        # Friction acts on both bodies at one point, midway between the surfaces.
        shift = 0.5 * gap.depth
        on_socket = self.socket_point + socket.components(normal * (self.socket_radius + shift))
        on_ball = self.ball_point + ball.components(normal * subtract(gap.journal_radius, shift))
        # Without friction the force acts at the two centres, which are on its line of action.
        centres = self.socket_point, self.ball_point
        return {CONTACT: self._contact_at(motions, gap, normal, on_socket, on_ball, *centres)}

    @override
    def deepest_penetration(self) -> Scalar:
        return subtract(self.socket_radius, self.clearance)

    @override
    def _gap(self, depth: Scalar, rate: Scalar) -> Gap:
        return Gap(depth, rate, self.socket_radius, self.clearance)

    @override
    def centred_joint(self) -> AbstractConstraint:
        return SphericalJoint(*self.pair(), self.socket_point, self.ball_point)

    @override
    def resting_joint(self, load: np.ndarray) -> AbstractConstraint | None:
        size = float(np.linalg.norm(load))
        # Without a load, no place on the wall is preferred.
        if not size > 0.0:
            return None
        distance = self.clearance + self._resting_depth(size, [self.law])
        centre = self.socket_point + distance / size * load
        return SphericalJoint(self.socket_body, self.ball_body, centre, self.ball_point)

    @override
    def draw(self, pen: AbstractPen) -> None:
        socket = Marker(self.socket_body, self.socket_point)
        ball = Marker(self.ball_body, self.ball_point)
        pen.socket(socket, ball, radius=self.socket_radius, clearance=self.clearance)
