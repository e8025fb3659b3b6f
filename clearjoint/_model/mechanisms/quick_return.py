"""The quick-return mechanism: a crank pin that slides in the slot of a lever."""

import math

import numpy as np

from ..._math.vectors import Scalar
from ..bodies import GROUND, Body, BodyState, State
from ..clearance_joints.between_walls import PinInSlot
from ..contact.friction import FrictionLaw
from ..contact.hunt_crossley import HuntCrossley
from ..contact.laws import AbstractContactLaw, GivenStiffness
from ..drives.drivers import PrescribedRotation
from ..joints.ideal import PointInPlaneJoint, RevoluteJoint
from ..scene import Scene
from .common import ORIGIN, Y_AXIS, Z_AXIS, planar_state

CRANK, BASE, LEVER = 0.05, 0.1, 0.25
"""Radius of the crank, height of its axis above the lever's axis, and length of the lever, m."""


def quick_return(
    play: Scalar | None = 0.1e-3,
    *,
    speed: Scalar = 10.0,
    angle: float = 0.0,
    law: AbstractContactLaw | None = None,
    friction: FrictionLaw | None = None,
) -> tuple[Scene, State]:
    """Return a quick-return mechanism, as used in a shaper, and its initial state.

    A crank rotates about the Z axis at constant speed. Its pin, of 5 mm radius, is 50 mm from this
    axis and slides in the slot of a lever of 250 mm, whose axis is 100 mm below the crank's, with Y
    as the vertical. The lever oscillates by 30 degrees to either side: its angle from the vertical
    is atan(r sin a/(d + r cos a)), with the crank's radius r, its angle a from the vertical, and
    the distance d of the axes. One stroke takes 240 degrees of the crank, and the return stroke
    half the time. There is no gravity. Sizes and masses are an example.

    **Arguments:**

    - `play`: m, the slot's width minus the pin's diameter; ``None`` for an ideal slot. The pin
      doesn't reach the ends of the slot.
    - `speed`, `angle`: of the crank, rad/s, and rad at the start, counter-clockwise from the
      vertical. The state is that of the ideal mechanism, with a centred pin.
    - `law`: of pin and walls; by default Hunt and Crossley's with the exponent 1, a restitution of
      0.8 and a stiffness of 1e9 N/m, about that of a line contact of 10 mm between steel parts.
    - `friction`: of pin and walls; none by default.

    >>> scene, state = cj.mechanisms.quick_return()
    >>> list(scene.joints)
    ['crank bearing', 'lever bearing', 'motor', 'slot']
    """
    # Points in the bodies' axes; both bodies lie along their x axes. The middle of the slot is on
    # the crank's axis while the lever is vertical, so that the pin moves as far to either side.
    crank_foot, lever_foot = (-0.5 * CRANK, 0.0, 0.0), (-0.5 * LEVER, 0.0, 0.0)
    pin, middle = (0.5 * CRANK, 0.0, 0.0), (BASE - 0.5 * LEVER, 0.0, 0.0)
    lever_pivot = (0.0, -BASE, 0.0)
    if play is None:
        slot = PointInPlaneJoint("lever", "crank", middle, pin, Y_AXIS)
    else:
        if law is None:
            law = HuntCrossley(restitution=0.8, stiffness=GivenStiffness(1e9), exponent=1.0)
        slot = PinInSlot(
            "lever",
            "crank",
            slot_point=middle,
            pin_point=pin,
            pin_radius=5e-3,
            play=play,
            travel=0.13,  # the pin needs twice the radius of the crank
            law=law,
            friction=friction,
        )
    # The driver's angle is that of the crank's x axis from X, while `angle` is from the vertical.
    joints = {
        "crank bearing": RevoluteJoint(GROUND, "crank", ORIGIN, crank_foot, Z_AXIS, Z_AXIS),
        "lever bearing": RevoluteJoint(GROUND, "lever", lever_pivot, lever_foot, Z_AXIS, Z_AXIS),
        "motor": PrescribedRotation(GROUND, "crank", Z_AXIS, speed, 0.5 * math.pi + angle),
        "slot": slot,
    }
    # Slender bars. The moments about their own axes have no effect on the planar motion.
    bodies = {
        "crank": Body(0.1, (2e-6, *(0.1 * CRANK**2 / 12.0,) * 2)),
        "lever": Body(0.5, (2e-5, *(0.5 * LEVER**2 / 12.0,) * 2)),
    }
    return Scene(bodies, joints), _start(speed, angle)


def _start(speed: Scalar, angle: float) -> State:
    """Return the ideal mechanism's state at the `speed`, rad/s, and `angle`, rad, of the crank. All
    angles are counter-clockwise from the vertical."""
    # The lever points from its axis to the pin, so that its angle is atan(across/height). The ratio
    # of the lever's speed to the crank's is the derivative of this angle by the crank's angle.
    across, height = CRANK * math.sin(angle), BASE + CRANK * math.cos(angle)
    lever_angle = math.atan2(across, height)
    ratio = CRANK * (CRANK + BASE * math.cos(angle)) / (across**2 + height**2)

    # State of a rod with one end at rest at `foot`. Its angular velocity is `rate` times the
    # crank's.
    def rod(foot: np.ndarray, length: float, angle: float, rate: float) -> BodyState:
        sine, cosine = math.sin(angle), math.cos(angle)
        centre = foot + 0.5 * length * np.array([-sine, cosine])
        velocity = 0.5 * length * rate * np.array([-cosine, -sine]) * speed
        return planar_state(centre, 0.5 * math.pi + angle, velocity, rate * speed)

    lever = rod(np.array([0.0, -BASE]), LEVER, lever_angle, ratio)
    return State({"crank": rod(np.zeros(2), CRANK, angle, 1.0), "lever": lever})
