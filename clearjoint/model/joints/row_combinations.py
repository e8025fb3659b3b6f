"""Constraint rows composed of other rows: sums, distances, and functions of time."""

from collections.abc import Callable, Iterable
from functools import reduce

import jax
import jax.numpy as jnp

from ...math.vectors import Scalar, add, multiply
from ..bodies import NO_WRENCH, Wrench
from .base import Motions, Row


def scaled_row(row: Row, factor: Scalar) -> Row:
    """Return the row times a constant."""
    jacobian = {name: _scaled(wrench, factor) for name, wrench in row.jacobian.items()}
    bias, time_rate = multiply(row.bias, factor), multiply(row.time_rate, factor)
    return Row(multiply(row.value, factor), jacobian, bias, time_rate)


def sum_of_rows(rows: Iterable[Row]) -> Row:
    """Return the row whose value is the sum of the values."""
    return reduce(_sum, rows)


def distance_row(components: Iterable[Row], length: Scalar, motions: Motions) -> Row:
    """Return (x^2 + y^2 + ... - length^2)/(2 length), m, for the components of a vector, m, as a
    row."""
    components = list(components)
    names = {name: None for row in components for name in row.jacobian}
    # Dividing by the length gives a row in m, with a derivative of 1 along the vector.
    value, bias = -0.5 * length, 0.0
    jacobian = dict.fromkeys(names, NO_WRENCH)
    for row in components:
        slope = row.value / length
        rate: Scalar = 0.0
        for name, wrench in row.jacobian.items():
            rate = rate + motions[name].power(wrench)
            jacobian[name] = jacobian[name] + _scaled(wrench, slope)
        value = value + 0.5 * slope * row.value
        bias = bias + rate * rate / length + slope * row.bias
    return Row(value, jacobian, bias)


def row_following(row: Row, function: Callable[[Scalar], Scalar], t: Scalar) -> Row:
    """Return the row minus a function of time in s, which JAX must be able to differentiate twice.

    The prescribed rate becomes the row's `time_rate`, its acceleration part of the bias.
    """

    def rate(t: Scalar) -> Scalar:
        return jax.jvp(function, (t,), (jnp.ones_like(t),))[1]

    t = jnp.asarray(t, dtype=float)
    prescribed, acceleration = jax.jvp(rate, (t,), (jnp.ones_like(t),))
    return Row(row.value - function(t), row.jacobian, row.bias - acceleration, -prescribed)


def _scaled(wrench: Wrench, factor: Scalar) -> Wrench:
    return Wrench(wrench.force * factor, wrench.moment * factor)


def _sum(first: Row, second: Row) -> Row:
    jacobian = dict(first.jacobian)
    for name, wrench in second.jacobian.items():
        jacobian[name] = jacobian.get(name, NO_WRENCH) + wrench
    bias, time_rate = add(first.bias, second.bias), add(first.time_rate, second.time_rate)
    return Row(add(first.value, second.value), jacobian, bias, time_rate)
