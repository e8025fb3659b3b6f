"""The slider-crank of the clearance literature."""

import math

import numpy as np

from ...fields.types import TripleLike
from ...math.vectors import Scalar
from ..bodies import GROUND, Body, BodyState, State, body_state
from ..clearance_joints.clearance import ClearanceJoint
from ..contact.bristles import AbstractBristleFriction
from ..contact.friction import AbstractFriction
from ..contact.laws import AbstractContactLaw
from ..drives.rotation import PrescribedRotation
from ..joints.base import AbstractConstraint, AbstractForce
from ..joints.ideal import InlineJoint, PrismaticJoint, RevoluteJoint
from ..scene import Scene
from .common import ORIGIN, X_AXIS, Z_AXIS, Joints, steel_law, turned_about_z, with_motor

CRANK_LENGTH, ROD_LENGTH = 0.05, 0.12
"""Lengths of the slider-crank, m.

>>> _, state = cj.mechanisms.slider_crank(clearance=None, angle=0.0)
>>> slider = state.bodies["slider"].position[0]  # farthest out
>>> bool(np.isclose(slider, cj.mechanisms.CRANK_LENGTH + cj.mechanisms.ROD_LENGTH))
True
"""
SMALL_END = (0.5 * ROD_LENGTH, 0.0, 0.0)
"""Position of the slider pin on the rod, m in the rod's axes."""


def slider_crank(
    clearance: Scalar | None = 0.5e-3,
    restitution: Scalar = 0.9,
    *,
    speed: Scalar = 5000.0 * math.pi / 30.0,
    angle: float = 0.0,
    motor: AbstractConstraint | AbstractForce | None = None,
    bearing_radius: Scalar = 10e-3,
    journal_length: Scalar = 20e-3,
    law: AbstractContactLaw | None = None,
    friction: AbstractFriction | AbstractBristleFriction | None = None,
    gravity: TripleLike | None = None,
) -> tuple[Scene, State]:
    """Return the slider-crank of the clearance literature and its initial state.

    A crank of 50 mm, 0.30 kg and 1e-5 kg m^2 rotates about Z in the origin. A rod of 120 mm, 0.21
    kg and 2.5e-4 kg m^2 drives a slider of 0.14 kg along X. The slider's bearing holds the rod's
    journal, the "slider pin", with clearance. Centres of mass are at half length. The other moments
    of inertia are those of bars 10 mm wide and a cube of 30 mm; they don't affect the planar
    motion.

    The crank's and the rod's revolute joints and the slider's guide hold the bodies in the plane.
    The clearance joint is therefore axially free, and no constraint is redundant. The same holds
    for `clearance=None`, where the pin is an ideal `InlineJoint`.

    **Arguments:**

    - `clearance`: radial, m; or ``None``.
    - `restitution`: requested of the default law, Lankarani-Nikravesh.
    - `speed`, `angle`: of the crank at the start, rad/s and rad; at angle 0 the slider is farthest
      out. The state is that of the ideal mechanism, with a centred journal.
    - `motor`: an element that drives "crank" relative to "ground", such as a `DriveTorque` about
      (0, 0, 1). By default it is a `PrescribedRotation` at constant speed.
    - `bearing_radius`, `journal_length`: m.
    - `law`: replaces the default law.
    - `friction`: an `AbstractFriction`, an `AbstractBristleFriction`, or ``None``, the default.
    - `gravity`: (3,) m/s^2; none by default.

    **Returns:** the scene and the initial state.

    >>> scene, state = cj.mechanisms.slider_crank()
    >>> list(scene.joints)
    ['crank bearing', 'crank pin', 'slider pin', 'guide', 'motor']
    """
    if clearance is None:
        pin = InlineJoint("slider", "rod", ORIGIN, SMALL_END, Z_AXIS)
    else:
        pin = ClearanceJoint(
            "slider",
            "rod",
            journal_point=SMALL_END,
            bearing_radius=bearing_radius,
            clearance=clearance,
            journal_length=journal_length,
            law=steel_law(restitution) if law is None else law,
            friction=friction,
        )
    if motor is None:
        motor = PrescribedRotation(GROUND, "crank", Z_AXIS, speed, angle)
    joints, forces = with_motor(_slider_crank_joints(pin), motor)
    scene = Scene(_slider_crank_bodies(), joints, forces, gravity)
    return scene, _slider_crank_state(speed, angle)


def _slider_crank_bodies() -> dict[str, Body]:
    return {
        "crank": Body(0.30, (5e-6, 1e-5, 1e-5)),
        "rod": Body(0.21, (3.5e-6, 2.5e-4, 2.5e-4)),
        "slider": Body(0.14, (2.1e-5, 2.1e-5, 2.1e-5)),
    }


def _slider_crank_joints(pin: InlineJoint | ClearanceJoint) -> Joints:
    """Return all joints except the drive of the crank."""
    foot, tip = (-0.5 * CRANK_LENGTH, 0.0, 0.0), (0.5 * CRANK_LENGTH, 0.0, 0.0)
    big_end = (-0.5 * ROD_LENGTH, 0.0, 0.0)
    return {
        "crank bearing": RevoluteJoint(GROUND, "crank", ORIGIN, foot, Z_AXIS, Z_AXIS),
        "crank pin": RevoluteJoint("crank", "rod", tip, big_end, Z_AXIS, Z_AXIS),
        "slider pin": pin,
        "guide": PrismaticJoint(GROUND, "slider", ORIGIN, ORIGIN, X_AXIS),
    }


def _slider_crank_state(speed: Scalar, angle: float) -> State:
    """Return the ideal mechanism's state at a crank angle, rad, and speed, rad/s."""
    tip = CRANK_LENGTH * np.array([math.cos(angle), math.sin(angle), 0.0])
    rod_angle = -math.asin(tip[1] / ROD_LENGTH)
    rod = ROD_LENGTH * np.array([math.cos(rod_angle), math.sin(rod_angle), 0.0])
    # Rates are derivatives by the crank's angle, to be multiplied by its speed.
    rod_rate = -tip[0] / rod[0]
    tip_rate = np.array([-tip[1], tip[0], 0.0])
    rod_centre_rate = tip_rate + 0.5 * rod_rate * np.array([-rod[1], rod[0], 0.0])
    slider_rate = np.array([-tip[1] - rod_rate * rod[1], 0.0, 0.0])

    def body(position: TripleLike, angle: float, rate: np.ndarray, angle_rate: float) -> BodyState:
        spin = np.array([0.0, 0.0, angle_rate])
        return body_state(position, turned_about_z(angle), rate * speed, spin * speed)

    return State(
        {
            "crank": body(0.5 * tip, angle, 0.5 * tip_rate, 1.0),
            "rod": body(tip + 0.5 * rod, rod_angle, rod_centre_rate, rod_rate),
            "slider": body(np.array([tip[0] + rod[0], 0.0, 0.0]), 0.0, slider_rate, 0.0),
        }
    )
