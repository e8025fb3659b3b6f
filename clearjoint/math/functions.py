"""Functions of scalars, by NumPy for numbers of NumPy and Python, so that nothing is compiled for
them, and otherwise by JAX."""

import jax
from jax.core import Tracer

from .vectors import Condition, Scalar, are_traced_alike, library


def where(condition: Condition, first: Scalar, second: Scalar) -> Scalar:
    """Return the first number if the condition holds, else the second."""
    if isinstance(condition, Tracer) and are_traced_alike(first, second) and not condition.shape:
        return jax.lax.select(condition, first, second)
    return library((condition, first, second)).where(condition, first, second)


def sine(angle: Scalar) -> Scalar:
    """Return the sine of an angle in rad."""
    return library((angle,)).sin(angle)


def cosine(angle: Scalar) -> Scalar:
    """Return the cosine of an angle in rad."""
    return library((angle,)).cos(angle)


def polar_angle(sine: Scalar, cosine: Scalar) -> Scalar:
    """Return the angle in rad, in (-pi, pi], whose sine and cosine are proportional to these."""
    return library((sine, cosine)).arctan2(sine, cosine)


def wrapped(value: Scalar, period: Scalar) -> Scalar:
    """Return the value less the nearest multiple of the period: at most half a period from zero."""
    return value - period * library((value, period)).round(value / period)
