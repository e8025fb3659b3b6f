"""The spatial four-bar with a ball in a socket."""

import numpy as np

from ...math.vectors import Scalar
from ..bodies import GROUND, Body, State, body_state
from ..clearance_joints.ball_in_socket import BallInSocket
from ..contact.bristles import AbstractBristleFriction
from ..contact.friction import AbstractFriction
from ..contact.laws import AbstractContactLaw
from ..joints.ideal import RevoluteJoint, SphericalJoint
from ..scene import Scene
from .common import ORIGIN, X_AXIS, Y_AXIS, Z_AXIS, steel_law

CRANK, COUPLER, ROCKER = 0.02, 0.122, 0.074
"""Lengths, m."""
BAR_RADIUS = 10e-3
"""Of the round bars that give the moments of inertia, m."""


def spatial_four_bar(
    clearance: Scalar | None = 0.2e-3,
    restitution: Scalar = 0.9,
    *,
    speed: Scalar = 0.0,
    law: AbstractContactLaw | None = None,
    friction: AbstractFriction | AbstractBristleFriction | None = None,
) -> tuple[Scene, State]:
    """The spatial four-bar (RSSR) with play in the ball joint between coupler and rocker, and its
    state at the start.

    A crank of 20 mm and 0.1960 kg turns about X in the origin, a rocker of 74 mm and 0.3157 kg
    about Z in (122, -54, 0) mm; a coupler of 122 mm and 1.4158 kg joins their ends by ball joints:
    an ideal one at the crank, a ball of 9.8 mm radius in a socket of 10 mm at the rocker. Lengths,
    masses and radii are those of the literature (P. Flores et al., Dynamics of multibody systems
    with spherical clearance joints, 2006) as far as they are remembered; where the axes are is
    chosen here, so that crank and rocker start upright, the coupler along X, and the crank turns
    all round. Moments of inertia are those of round bars of 10 mm radius. Gravity is 9.81 along -Z.
    The coupler turns about itself freely.

    **Arguments:**

    - `clearance`: radial, m; ``None`` for an ideal ball joint. The ball starts centred.
    - `speed`: of the crank at the start, rad/s, in the ideal joint's motion; at rest unless given.
    - `law` replaces Lankarani-Nikravesh with the given restitution.

    >>> scene, state = cj.mechanisms.spatial_four_bar()
    >>> list(scene.joints)
    ['crank bearing', 'rocker bearing', 'crank ball', 'tip']
    """
    end = (0.5 * COUPLER, 0.0, 0.0)
    top = (0.0, 0.5 * ROCKER, 0.0)
    if clearance is None:
        tip = SphericalJoint("rocker", "coupler", top, end)
    else:
        tip = BallInSocket(
            "rocker",
            "coupler",
            socket_point=top,
            ball_point=end,
            socket_radius=10e-3,
            clearance=clearance,
            law=steel_law(restitution) if law is None else law,
            friction=friction,
        )
    foot = (COUPLER, CRANK - ROCKER, 0.0)
    joints = {
        "crank bearing": RevoluteJoint(
            GROUND, "crank", ORIGIN, (0.0, -0.5 * CRANK, 0.0), X_AXIS, X_AXIS
        ),
        "rocker bearing": RevoluteJoint(
            GROUND, "rocker", foot, (0.0, -0.5 * ROCKER, 0.0), Z_AXIS, Z_AXIS
        ),
        "crank ball": SphericalJoint(
            "crank", "coupler", (0.0, 0.5 * CRANK, 0.0), (-0.5 * COUPLER, 0.0, 0.0)
        ),
        "tip": tip,
    }
    bodies = {
        "crank": _bar(0.1960, CRANK, Y_AXIS),
        "coupler": _bar(1.4158, COUPLER, X_AXIS),
        "rocker": _bar(0.3157, ROCKER, Y_AXIS),
    }
    return Scene(bodies, joints, gravity=(0.0, 0.0, -9.81)), _start(speed)


def _bar(mass: float, length: float, axis: tuple[float, float, float]) -> Body:
    """A round bar along an axis."""
    along = 0.5 * mass * BAR_RADIUS**2
    across = mass * (length**2 / 12.0 + 0.25 * BAR_RADIUS**2)
    return Body(mass, np.where(np.array(axis) == 1.0, along, across))


def _start(speed: Scalar) -> State:
    """The crank's end moves along Z and the coupler, which does not lie in its way, turns about the
    rocker's end, which stays."""
    upward = np.array([0.0, 0.0, CRANK])
    return State(
        {
            "crank": body_state(
                (0.0, 0.5 * CRANK, 0.0),
                velocity=0.5 * upward * speed,
                spin=np.array([1.0, 0.0, 0.0]) * speed,
            ),
            "coupler": body_state(
                (0.5 * COUPLER, CRANK, 0.0),
                velocity=0.5 * upward * speed,
                spin=np.array([0.0, CRANK / COUPLER, 0.0]) * speed,
            ),
            "rocker": body_state((COUPLER, CRANK - 0.5 * ROCKER, 0.0)),
        }
    )
