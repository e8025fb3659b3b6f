"""Functions of scalars, which may be numbers of Python and NumPy or arrays of JAX.

For numbers of Python and NumPy, NumPy computes them, so that nothing is compiled.
"""

import jax
from jax.core import Tracer

from .vectors import Condition, Scalar, are_traced_alike, library


def where(condition: Condition, first: Scalar, second: Scalar) -> Scalar:
    """Return `first` if the condition holds, else `second`; for arrays element by element."""
    # JAX traces the primitive in less time than `jax.numpy.where`.
    if isinstance(condition, Tracer) and are_traced_alike(first, second) and not condition.shape:
        return jax.lax.select(condition, first, second)
    return library((condition, first, second)).where(condition, first, second)


def sine(angle: Scalar) -> Scalar:
    """Return the sine of an angle given in rad."""
    return library((angle,)).sin(angle)


def cosine(angle: Scalar) -> Scalar:
    """Return the cosine of an angle given in rad."""
    return library((angle,)).cos(angle)


def polar_angle(sine: Scalar, cosine: Scalar) -> Scalar:
    """Return the polar angle, rad in (-pi, pi], of the point with the coordinates (cosine, sine).

    The point may be at any distance from the origin.
    """
    return library((sine, cosine)).arctan2(sine, cosine)


def wrapped(value: Scalar, period: Scalar) -> Scalar:
    """Return a value minus the nearest multiple of a period, such as an angle within half a turn.

    The absolute value of the result is at most half a period.
    """
    return value - period * library((value, period)).round(value / period)
