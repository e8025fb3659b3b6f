"""What several mechanisms have: axes, and the steel of the paper."""

from ...math.vectors import Scalar
from ..contact.damping_factors import LankaraniNikravesh
from ..contact.stiffness import RavnStiffness

ORIGIN = (0.0, 0.0, 0.0)
X_AXIS, Y_AXIS, Z_AXIS = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
STEEL = RavnStiffness(207e9, 0.3)
"""Ravn's stiffness for the paper's steel (Table 2)."""


def steel_law(restitution: Scalar) -> LankaraniNikravesh:
    """The paper's law for its steel, with a requested restitution."""
    return LankaraniNikravesh(restitution=restitution, stiffness=STEEL)
