"""The spatial four-bar (RSSR) with clearance in a ball joint."""

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
"""Lengths of crank, coupler and rocker, m."""
BAR_RADIUS = 10e-3
"""Radius of the round bars that define the moments of inertia, m."""


def spatial_four_bar(
    clearance: Scalar | None = 0.2e-3,
    restitution: Scalar = 0.9,
    *,
    speed: Scalar = 0.0,
    law: AbstractContactLaw | None = None,
    friction: AbstractFriction | AbstractBristleFriction | None = None,
) -> tuple[Scene, State]:
    """Return a spatial four-bar (RSSR) with clearance between coupler and rocker, and its state.

    A crank of 20 mm and 0.1960 kg rotates about X in the origin, a rocker of 74 mm and 0.3157 kg
    about Z in (122, -54, 0) mm. A coupler of 122 mm and 1.4158 kg connects their ends by ball
    joints: an ideal one at the crank, and a ball of 9.8 mm radius in a socket of 10 mm at the
    rocker. The coupler rotates freely about its own axis. Moments of inertia are those of round
    bars of 10 mm radius. Gravity is 9.81 m/s^2 along -Z.

    Lengths, masses and radii follow P. Flores et al., Dynamics of multibody systems with spherical
    clearance joints, 2006, but were not checked against the publication. The positions of the axes
    are our choice: crank and rocker start upright and the coupler along X, and the crank can make
    full revolutions.

    **Arguments:**

    - `clearance`: radial, m; ``None`` for an ideal ball joint. The ball starts centred.
    - `restitution`: requested of the default law, Lankarani-Nikravesh.
    - `speed`: of the crank at the start, rad/s, in the ideal mechanism's motion.
    - `law`: replaces the default law.
    - `friction`: of the ball.

    **Returns:** the scene and the initial state.

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
    """Return a round bar from its mass, kg, and length, m, along one of the body's axes."""
    along = 0.5 * mass * BAR_RADIUS**2
    across = mass * (length**2 / 12.0 + 0.25 * BAR_RADIUS**2)
    return Body(mass, np.where(np.array(axis) == 1.0, along, across))


def _start(speed: Scalar) -> State:
    """Return the initial state.

    The crank's end moves along Z. The coupler rotates about the rocker's end, which is at rest.
    """
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
