"""Ideal joints in a clearance joint's place, with the journal in the middle or along the wall."""

import numpy as np
from jaxtyping import Float

from ...fields.types import Single, Triple
from ..joints.base import AbstractConstraint
from ..joints.ideal import CylindricalJoint, RevoluteJoint

LEAST_SHARE = 1e-6
"""Of a load, across the axis: less is rounding's and seats no journal."""


def ideal_in_place(
    bodies: tuple[str, str],
    points: tuple[Triple, Triple],
    axes: tuple[Triple, Triple],
    slides: bool,
) -> AbstractConstraint:
    """A joint without clearance between two bodies at a point of each, m, about an axis of each: a
    revolute one, or a cylindrical one if it slides along the axis."""
    kind = CylindricalJoint if slides else RevoluteJoint
    return kind(*bodies, *points, *axes)


def seat(
    axis: Triple, clearance: Single, load: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3"] | None:
    """From the bearing's centre to that of a journal which a load presses to the wall, m; ``None``
    if the load has no part across the axis. All in the bearing's body axes."""
    along = np.asarray(axis) / np.linalg.norm(axis)
    across = load - (load @ along) * along
    size = np.linalg.norm(across)
    if not size > LEAST_SHARE * np.linalg.norm(load):
        return None
    return clearance / size * across


def seat_on_plane(
    normal: Triple, clearance: Single, load: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3"] | None:
    """From midway between two walls to where a load presses what is between them, m; ``None`` if
    the load has no part along the walls' normal. All in the axes of the walls' body."""
    upward = np.asarray(normal) / np.linalg.norm(normal)
    share = load @ upward
    if not abs(share) > LEAST_SHARE * np.linalg.norm(load):
        return None
    return clearance * np.sign(share) * upward
