"""Motions of bodies."""

from clearjoint.extend import IDENTITY, ZERO, Motion
from clearjoint.testing import moving

AT_REST = Motion(ZERO, IDENTITY, ZERO, ZERO)
NEAR_EACH_OTHER = {
    "a": moving((0.1, 0.2, 0.3), (0.9, 0.1, -0.3, 0.2), (0.5, -0.4, 0.3), (1.0, 2.0, -0.5)),
    "b": moving((0.11, 0.19, 0.32), (0.9, 0.15, -0.25, 0.2), (-0.2, 0.7, 0.1), (-0.8, 0.3, 1.1)),
}
"""Two bodies whose positions and orientations differ a little."""
