"""Shared parts of the mechanisms: axes, a steel, planar motions, and motors."""

import math

import numpy as np

from ..._math.vectors import Scalar
from ..bodies import BodyState, body_state
from ..contact.hunt_crossley import LankaraniNikravesh
from ..contact.laws import RavnStiffness
from ..joints.base import AbstractConstraint, AbstractContactJoint, AbstractForce

ORIGIN = (0.0, 0.0, 0.0)
X_AXIS, Y_AXIS, Z_AXIS = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
STEEL = RavnStiffness(207e9, 0.3)
"""Ravn's stiffness for the steel of Flores et al. 2006, Table 2: 207 GPa, Poisson's ratio 0.3.

>>> law = cj.laws.LankaraniNikravesh(restitution=0.9, stiffness=cj.mechanisms.STEEL)
"""
Joints = dict[str, AbstractConstraint | AbstractContactJoint]
"""Joints of a scene by name."""
Motor = AbstractConstraint | AbstractForce
"""Element that drives a mechanism: a driver that prescribes the motion, or a torque."""


def steel_law(restitution: Scalar) -> LankaraniNikravesh:
    return LankaraniNikravesh(restitution=restitution, stiffness=STEEL)


def turned_about_z(angle: float) -> tuple[float, float, float, float]:
    """Return Euler parameters, (4,), scalar first, of a rotation about Z by an angle, rad."""
    return math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)


def planar_state(centre: np.ndarray, angle: float, velocity: np.ndarray, spin: Scalar) -> BodyState:
    """Return the state of a body that moves in the XY plane and rotates about Z. `centre`, m, and
    `velocity`, m/s, are (2,); `angle`, rad, and `spin`, rad/s, are about Z."""
    about_z = np.array(Z_AXIS) * spin
    return body_state((*centre, 0.0), turned_about_z(angle), (*velocity, 0.0), about_z)


def with_motor(joints: Joints, motor: Motor | None) -> tuple[Joints, dict[str, AbstractForce]]:
    """Return the joints and the forces of a mechanism by name, with its "motor" if there is one."""
    if isinstance(motor, AbstractForce):
        return joints, {"motor": motor}
    return joints if motor is None else {**joints, "motor": motor}, {}
