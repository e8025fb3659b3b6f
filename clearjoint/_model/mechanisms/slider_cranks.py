"""Two slider-cranks: one with clearance at the slider's pin, one with clearance in its guide."""

import math

import numpy as np

from ..._fields.checks import as_number, require_shape
from ..._fields.types import TripleLike
from ..._math.vectors import Scalar
from ..bodies import GROUND, Body, State, body_state
from ..clearance_joints.between_walls import SliderInGuide
from ..clearance_joints.clearance import ClearanceJoint
from ..contact.friction import FrictionLaw, RegularisedCoulomb
from ..contact.hunt_crossley import ExactRestitution
from ..contact.laws import AbstractContactLaw
from ..drives.drivers import PrescribedRotation
from ..joints.base import AbstractConstraint, AbstractForce
from ..joints.ideal import (
    InlineJoint,
    LineInPlaneJoint,
    PointInPlaneJoint,
    PrismaticJoint,
    RevoluteJoint,
)
from ..scene import Scene
from .common import ORIGIN, X_AXIS, Y_AXIS, Z_AXIS, Joints, planar_state, steel_law, with_motor

CRANK_LENGTH = 0.05
"""Length of the crank of `slider_crank`, m.

>>> cj.mechanisms.CRANK_LENGTH
0.05
"""
ROD_LENGTH = 0.12
"""Length of the rod of `slider_crank`, m.

>>> cj.mechanisms.CRANK_LENGTH, cj.mechanisms.ROD_LENGTH
(0.05, 0.12)
"""
SMALL_END = (0.5 * ROD_LENGTH, 0.0, 0.0)
"""Position of the slider pin on the rod of `slider_crank`, m in the rod's axes."""


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
    friction: FrictionLaw | None = None,
    gravity: TripleLike | None = None,
) -> tuple[Scene, State]:
    """Return a slider-crank with clearance at the slider's pin, and its initial state.

    A crank of 50 mm and 0.30 kg rotates about the Z axis, and a rod of 120 mm and 0.21 kg drives a
    slider of 0.14 kg along X. The slider's bearing holds the rod's journal, the "slider pin".
    Sizes, masses and the default speed of 5000 rpm are common in publications on joints with
    clearance, but not checked against one. Other joints hold the bodies in the plane: the clearance
    joint is axially free, and an ideal pin is an `InlineJoint`, so no constraint is redundant.

    **Arguments:**

    - `clearance`: radial, m; ``None`` for an ideal pin.
    - `law`: normal law of the contacts; by default that of Lankarani and Nikravesh for `STEEL` with
      the requested `restitution`.
    - `speed`, `angle`: of the crank at the start, rad/s and rad; at angle 0 the slider is farthest
      out. The state is that of the ideal mechanism, with a centred journal.
    - `motor`: an element that drives "crank" relative to "ground", such as a `DriveTorque` about
      (0, 0, 1). By default it is a `PrescribedRotation` at constant speed.
    - `bearing_radius`, `journal_length`, `friction`: of the pin, as in `ClearanceJoint`.
    - `gravity`: (3,) m/s^2; none by default.

    >>> scene, state = cj.mechanisms.slider_crank()
    >>> list(scene.joints)
    ['crank bearing', 'crank pin', 'slider pin', 'guide', 'motor']
    """
    if clearance is None:
        # A revolute joint would repeat constraints of the guide and the other joints.
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
    joints = _crank_joints(CRANK_LENGTH, ROD_LENGTH) | {
        "slider pin": pin,
        "guide": PrismaticJoint(GROUND, "slider", ORIGIN, ORIGIN, X_AXIS),
    }
    joints, forces = with_motor(joints, motor)
    bodies = {
        "crank": Body(0.30, (5e-6, 1e-5, 1e-5)),
        "rod": Body(0.21, (3.5e-6, 2.5e-4, 2.5e-4)),
        "slider": Body(0.14, (2.1e-5, 2.1e-5, 2.1e-5)),
    }
    return Scene(bodies, joints, forces, gravity), _slider_crank_state(speed, angle)


def _crank_joints(crank: float, rod: float) -> Joints:
    foot, tip, big_end = ((x, 0.0, 0.0) for x in (-0.5 * crank, 0.5 * crank, -0.5 * rod))
    return {
        "crank bearing": RevoluteJoint(GROUND, "crank", ORIGIN, foot, Z_AXIS, Z_AXIS),
        "crank pin": RevoluteJoint("crank", "rod", tip, big_end, Z_AXIS, Z_AXIS),
    }


def _slider_crank_state(speed: Scalar, angle: float) -> State:
    """Return the ideal mechanism's state at a crank angle, rad, and speed, rad/s."""
    # In the XY plane: the crank's end, and the vector along the rod to its far end, which is on the
    # X axis, at the height of the slider.
    tip = CRANK_LENGTH * np.array([math.cos(angle), math.sin(angle)])
    rod_angle = -math.asin(tip[1] / ROD_LENGTH)
    rod = ROD_LENGTH * np.array([math.cos(rod_angle), math.sin(rod_angle)])
    # Rates are derivatives by the crank's angle, to be multiplied by the crank's speed. The rate of
    # the rod's angle follows from the rod's far end, tip + rod, whose height stays zero.
    rod_rate = -tip[0] / rod[0]
    tip_rate = np.array([-tip[1], tip[0]])
    rod_centre_rate = tip_rate + 0.5 * rod_rate * np.array([-rod[1], rod[0]])
    slider, slider_rate = tip[0] + rod[0], np.array([-tip[1] - rod_rate * rod[1], 0.0])
    states = {
        "crank": planar_state(0.5 * tip, angle, 0.5 * tip_rate * speed, speed),
        "rod": planar_state(tip + 0.5 * rod, rod_angle, rod_centre_rate * speed, rod_rate * speed),
        "slider": planar_state(np.array([slider, 0.0]), 0.0, slider_rate * speed, 0.0),
    }
    return State(states)


CRANK, ROD, HALF_HEIGHT = 0.153, 0.306, 0.025
"""Lengths of crank and rod of `guided_slider_crank`, and half the height of its slider, m."""
FRICTION = RegularisedCoulomb(0.01)
"""Friction in the guide of `guided_slider_crank`, with the coefficient of the publication."""


def guided_slider_crank(
    clearance: Scalar | None = 1e-3,
    pin_clearance: Scalar | None = None,
    *,
    law: AbstractContactLaw | None = None,
    friction: FrictionLaw | None = FRICTION,
    pin_law: AbstractContactLaw | None = None,
    speed: Scalar = 150.0,
) -> tuple[Scene, State]:
    """Return a slider-crank whose slider has clearance in its guide, and its initial state.

    A crank of 153 mm and 0.038 kg rotates freely about the Z axis, and a rod of 306 mm and 0.038 kg
    drives a slider of 100 by 50 mm and 0.076 kg along X, between walls above and below. Gravity is
    9.81 m/s^2 along -Y, and there is no motor. The mechanism starts in a straight line with the
    slider farthest out, with the velocities of the ideal mechanism.

    Source: P. Flores, R. Leine, C. Glocker, Multibody System Dynamics 23, 2010.

    **Arguments:**

    - `clearance`: m, on either side of the slider; ``None`` for an ideal guide.
    - `pin_clearance`: radial clearance of the pin between rod and slider, m, in a bearing of 10 mm
      radius and 20 mm length; ``None``, the default, for an ideal pin. With a clearance, the ideal
      joints "plane along" and "plane across" are added, which hold the slider in the plane.
    - `law`: of the slider's corners on the walls; by default `ExactRestitution` with the published
      restitution of 0.4 and a stiffness of 1e9 N/m^1.5, which is not published.
    - `friction`: of the guide; coefficient 0.01 by default, as published; ``None`` for none.
    - `pin_law`: of a pin with clearance; by default that of Lankarani and Nikravesh for steel with
      a restitution of 0.9.
    - `speed`: of the crank at the start, rad/s.

    >>> scene, state = cj.mechanisms.guided_slider_crank()
    >>> list(scene.joints)
    ['crank bearing', 'crank pin', 'slider pin', 'guide']
    """
    require_shape("speed", as_number(speed, "speed", "rad/s"), (), "give one number in rad/s")
    joints, end = _crank_joints(CRANK, ROD), (0.5 * ROD, 0.0, 0.0)
    if pin_clearance is None:
        joints["slider pin"] = RevoluteJoint("rod", "slider", end, ORIGIN, Z_AXIS, Z_AXIS)
    else:
        # The slider has the bearing and the rod the journal, as in `slider_crank`.
        joints["slider pin"] = ClearanceJoint(
            "slider",
            "rod",
            journal_point=end,
            bearing_radius=10e-3,
            clearance=pin_clearance,
            journal_length=20e-3,
            law=steel_law(0.9) if pin_law is None else pin_law,
        )
        # Unlike an ideal pin, a pin with clearance leaves the slider free to move along Z and to
        # tilt about X and Y. "plane along" keeps the line through the slider's centre along X in
        # the plane, and "plane across" a point above the centre, which prevents the tilt about X.
        edge = (0.0, HALF_HEIGHT, 0.0)
        joints["plane along"] = LineInPlaneJoint(GROUND, "slider", ORIGIN, ORIGIN, Z_AXIS, X_AXIS)
        joints["plane across"] = PointInPlaneJoint(GROUND, "slider", ORIGIN, edge, Z_AXIS)
    # The ideal guide has two rows, for the height along Y and the rotation about Z. A prismatic
    # joint has five, three of which would repeat the constraints that hold the slider in the plane.
    if clearance is None:
        joints["guide"] = LineInPlaneJoint(GROUND, "slider", ORIGIN, ORIGIN, Y_AXIS, X_AXIS)
    else:
        joints["guide"] = SliderInGuide(
            GROUND,
            "slider",
            half_length=0.05,
            half_height=HALF_HEIGHT,
            clearance=clearance,
            law=ExactRestitution(0.4, 1e9) if law is None else law,
            friction=friction,
        )
    bodies = {
        "crank": Body(0.038, (2e-6, 7.4e-5, 7.4e-5)),
        "rod": Body(0.038, (2e-6, 5.9e-4, 5.9e-4)),
        "slider": Body(0.076, (2.7e-6, 2.7e-6, 2.7e-6)),
    }
    # The crank's end moves along Y, and the rod rotates about the slider, which is at rest.
    velocity = np.array(Y_AXIS) * (0.5 * (CRANK * speed))
    spin, rod_spin = np.array(Z_AXIS) * speed, np.array(Z_AXIS) * (-speed * CRANK / ROD)
    states = {
        "crank": body_state((0.5 * CRANK, 0.0, 0.0), velocity=velocity, spin=spin),
        "rod": body_state((CRANK + 0.5 * ROD, 0.0, 0.0), velocity=velocity, spin=rod_spin),
        "slider": body_state((CRANK + ROD, 0.0, 0.0)),
    }
    return Scene(bodies, joints, gravity=(0.0, -9.81, 0.0)), State(states)
