"""Numbers that count modulo a period: angles, and displacements of meshes and threads."""

from .vectors import Scalar, library


def wrapped(value: Scalar, period: Scalar) -> Scalar:
    """The value less whole periods, within half a period of zero."""
    return value - period * library((value, period)).round(value / period)
