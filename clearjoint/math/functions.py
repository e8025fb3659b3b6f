"""Functions of scalars that NumPy evaluates for numbers of Python and NumPy, so that nothing is
compiled for them, and JAX otherwise."""

import jax
from jax.core import Tracer

from .vectors import Condition, Scalar, are_traced_alike, library


def where(condition: Condition, first: Scalar, second: Scalar) -> Scalar:
    """Return `first` if the condition holds, else `second`."""
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
    """Return the angle in rad, in (-pi, pi], of the point with abscissa `cosine` and ordinate
    `sine`.

    The two numbers need not be normalised.
    """
    return library((sine, cosine)).arctan2(sine, cosine)


def wrapped(value: Scalar, period: Scalar) -> Scalar:
    """Return the value minus the multiple of the period that is nearest to it.

    The result is at most half a period from zero.
    """
    return value - period * library((value, period)).round(value / period)
