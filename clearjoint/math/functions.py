"""Functions of scalars that take what they are given: of numpy's numbers they are numpy's own, so
that nothing is compiled for what the host computes; of what JAX traces they are JAX's."""

import jax
from jax.core import Tracer

from .vectors import Condition, Scalar, alike, library


def where(condition: Condition, first: Scalar, second: Scalar) -> Scalar:
    """The first number where the condition holds, the second elsewhere."""
    if isinstance(condition, Tracer) and alike(first, second) and not condition.shape:
        return jax.lax.select(condition, first, second)
    return library((condition, first, second)).where(condition, first, second)


def sine(angle: Scalar) -> Scalar:
    """The sine of an angle in rad."""
    return library((angle,)).sin(angle)


def cosine(angle: Scalar) -> Scalar:
    """The cosine of an angle in rad."""
    return library((angle,)).cos(angle)


def polar_angle(sine: Scalar, cosine: Scalar) -> Scalar:
    """The angle in rad, within (-pi, pi], that has sine and cosine in proportion to these."""
    return library((sine, cosine)).arctan2(sine, cosine)


def within_a_period(value: Scalar, period: Scalar) -> Scalar:
    """The value less whole periods, at most half a period from zero."""
    return value - period * library((value, period)).round(value / period)
