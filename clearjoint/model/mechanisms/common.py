"""Shared parts of the mechanisms: axes, the steel of the paper, and motors."""

import math

from ...math.vectors import Scalar
from ..contact.damping_factors import LankaraniNikravesh
from ..contact.laws import RavnStiffness
from ..joints.base import AbstractConstraint, AbstractContactJoint, AbstractForce

ORIGIN = (0.0, 0.0, 0.0)
X_AXIS, Y_AXIS, Z_AXIS = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
STEEL = RavnStiffness(207e9, 0.3)
"""Ravn's stiffness for the paper's steel (Table 2).

>>> law = cj.laws.LankaraniNikravesh(restitution=0.9, stiffness=cj.mechanisms.STEEL)
"""
Joints = dict[str, AbstractConstraint | AbstractContactJoint]
Motor = AbstractConstraint | AbstractForce


def steel_law(restitution: Scalar) -> LankaraniNikravesh:
    """Return the law of Lankarani and Nikravesh for the paper's steel.

    `restitution` is the requested restitution, 0 to 1.
    """
    return LankaraniNikravesh(restitution=restitution, stiffness=STEEL)


def turned_about_z(angle: float) -> tuple[float, float, float, float]:
    """Return Euler parameters, (4,), scalar first, of a rotation about Z by an angle, rad."""
    return math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)


def with_motor(joints: Joints, motor: Motor) -> tuple[Joints, dict[str, AbstractForce]]:
    """Return the joints and the forces of a mechanism with the element "motor", each by name.

    A motor that is a force becomes the only force; a driver is added to the joints.
    """
    if isinstance(motor, AbstractForce):
        return joints, {"motor": motor}
    return {**joints, "motor": motor}, {}
