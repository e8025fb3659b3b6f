"""The slider-crank with clearance in its guide."""

import numpy as np

from ...math.vectors import Scalar
from ..bodies import GROUND, Body, State, body_state
from ..clearance_joints.clearance import ClearanceJoint
from ..clearance_joints.slider_in_guide import SliderInGuide
from ..contact.bristles import AbstractBristleFriction
from ..contact.damping_factors import ExactRestitution
from ..contact.friction import AbstractFriction, RegularisedCoulomb
from ..contact.laws import AbstractContactLaw
from ..joints.base import AbstractConstraint, AbstractContactJoint
from ..joints.ideal import RevoluteJoint
from ..joints.planes import LineInPlaneJoint, PointInPlaneJoint
from ..scene import Scene
from .common import ORIGIN, X_AXIS, Y_AXIS, Z_AXIS, steel_law

CRANK, ROD = 0.153, 0.306
"""Lengths of crank and rod, m."""
HALF_LENGTH, HALF_HEIGHT = 0.05, 0.025
"""Half the size of the slider, m."""
GUIDE_STIFFNESS = 1e9
"""Stiffness of a corner on a wall, N/m^1.5; the contacts of the publication are rigid."""
FRICTION = RegularisedCoulomb(0.01)
"""Friction with the coefficient of the publication."""


def guided_slider_crank(
    clearance: Scalar | None = 1e-3,
    pin_clearance: Scalar | None = None,
    *,
    law: AbstractContactLaw | None = None,
    friction: AbstractFriction | AbstractBristleFriction | None = FRICTION,
    pin_law: AbstractContactLaw | None = None,
    speed: Scalar = 150.0,
) -> tuple[Scene, State]:
    """Return a slider-crank whose slider has clearance in its guide, and its initial state.

    A crank of 153 mm, 0.038 kg and 7.4e-5 kg m^2 rotates freely about Z in the origin. A rod of 306
    mm, 0.038 kg and 5.9e-4 kg m^2 drives a slider of 100 by 50 mm, 0.076 kg and 2.7e-6 kg m^2 along
    X, between walls with 1 mm clearance above and below. Centres of mass are at half length, the
    pin is in the slider's middle, and gravity is 9.81 m/s^2 along -Y. The other moments of inertia
    don't affect the planar motion. The mechanism starts in a straight line with the slider farthest
    out, in the motion of an ideal guide.

    Source: P. Flores, R. Leine, C. Glocker, Multibody System Dynamics 23, 2010.

    **Arguments:**

    - `clearance`: m, on either side of the slider; ``None`` for an ideal guide.
    - `pin_clearance`: radial clearance of the pin between rod and slider, m, in a bearing of 10 mm
      radius and 20 mm length; ``None``, the default, for an ideal pin.
    - `law`: of the slider's corners; exact restitution 0.4 by default.
    - `friction`: of the guide; coefficient 0.01 by default, or ``None``.
    - `pin_law`: of the pin; the paper's steel by default.
    - `speed`: of the crank at the start, rad/s.

    **Returns:** the scene and the initial state.

    >>> scene, state = cj.mechanisms.guided_slider_crank()
    >>> list(scene.joints)
    ['crank bearing', 'crank pin', 'slider pin', 'guide']
    """
    near, far = 0.5, -0.5
    joints: dict[str, AbstractConstraint | AbstractContactJoint] = {
        "crank bearing": RevoluteJoint(
            GROUND, "crank", ORIGIN, (far * CRANK, 0.0, 0.0), Z_AXIS, Z_AXIS
        ),
        "crank pin": RevoluteJoint(
            "crank", "rod", (near * CRANK, 0.0, 0.0), (far * ROD, 0.0, 0.0), Z_AXIS, Z_AXIS
        ),
        "slider pin": _pin(pin_clearance, pin_law),
    }
    if pin_clearance is not None:
        joints |= _in_plane()
    if clearance is None:
        joints["guide"] = LineInPlaneJoint(GROUND, "slider", ORIGIN, ORIGIN, Y_AXIS, X_AXIS)
    else:
        joints["guide"] = SliderInGuide(
            GROUND,
            "slider",
            half_length=HALF_LENGTH,
            half_height=HALF_HEIGHT,
            clearance=clearance,
            law=ExactRestitution(0.4, GUIDE_STIFFNESS) if law is None else law,
            friction=friction,
        )
    bodies = {
        "crank": Body(0.038, (2e-6, 7.4e-5, 7.4e-5)),
        "rod": Body(0.038, (2e-6, 5.9e-4, 5.9e-4)),
        "slider": Body(0.076, (2.7e-6, 2.7e-6, 2.7e-6)),
    }
    return Scene(bodies, joints, gravity=(0.0, -9.81, 0.0)), _start(speed)


def _pin(
    clearance: Scalar | None, law: AbstractContactLaw | None
) -> RevoluteJoint | ClearanceJoint:
    """Return the joint between rod and slider; an ideal one if the clearance, m, is ``None``."""
    end = (0.5 * ROD, 0.0, 0.0)
    if clearance is None:
        return RevoluteJoint("rod", "slider", end, ORIGIN, Z_AXIS, Z_AXIS)
    return ClearanceJoint(
        "slider",
        "rod",
        journal_point=end,
        bearing_radius=10e-3,
        clearance=clearance,
        journal_length=20e-3,
        law=steel_law(0.9) if law is None else law,
    )


def _in_plane() -> dict[str, AbstractConstraint]:
    """Return the joints that keep the slider in the plane if its pin has clearance."""
    edge = (0.0, HALF_HEIGHT, 0.0)
    return {
        "plane along": LineInPlaneJoint(GROUND, "slider", ORIGIN, ORIGIN, Z_AXIS, X_AXIS),
        "plane across": PointInPlaneJoint(GROUND, "slider", ORIGIN, edge, Z_AXIS),
    }


def _start(speed: Scalar) -> State:
    tip = np.array([0.0, CRANK * speed, 0.0])
    axis = np.array([0.0, 0.0, 1.0])
    return State(
        {
            "crank": body_state((0.5 * CRANK, 0.0, 0.0), velocity=0.5 * tip, spin=axis * speed),
            "rod": body_state(
                (CRANK + 0.5 * ROD, 0.0, 0.0),
                velocity=0.5 * tip,
                spin=axis * (-speed * CRANK / ROD),
            ),
            "slider": body_state((CRANK + ROD, 0.0, 0.0)),
        }
    )
