"""Constraint rows made of other rows: sums, distances, and what follows a function of time."""

from collections.abc import Callable, Iterable
from functools import reduce

import jax
import jax.numpy as jnp

from ...math.vectors import Scalar, add, multiply
from ..bodies import NO_WRENCH, Wrench
from .base import Motions, Row


def scaled_row(row: Row, factor: Scalar) -> Row:
    """The row times a constant."""
    jacobian = {name: _scaled(wrench, factor) for name, wrench in row.jacobian.items()}
    bias, time_rate = multiply(row.bias, factor), multiply(row.time_rate, factor)
    return Row(multiply(row.value, factor), jacobian, bias, time_rate)


def sum_of_rows(rows: Iterable[Row]) -> Row:
    """The row whose value is the sum of the values."""
    return reduce(_sum, rows)


def distance_row(components: Iterable[Row], length: Scalar, motions: Motions) -> Row:
    """The row (x^2 + y^2 + ... - length^2)/(2 length), m, of components of a vector, m."""
    components = list(components)
    names = {name: None for row in components for name in row.jacobian}
    value, bias = -0.5 * length, 0.0
    jacobian = dict.fromkeys(names, NO_WRENCH)
    for row in components:
        share = row.value / length
        rate: Scalar = 0.0
        for name, wrench in row.jacobian.items():
            rate = rate + motions[name].power(wrench)
            jacobian[name] = jacobian[name] + _scaled(wrench, share)
        value = value + 0.5 * share * row.value
        bias = bias + rate * rate / length + share * row.bias
    return Row(value, jacobian, bias)


def row_following(row: Row, function: Callable[[Scalar], Scalar], t: Scalar) -> Row:
    """The row less a function of time, in s, that JAX can differentiate twice."""

    def rate(t: Scalar) -> Scalar:
        return jax.jvp(function, (t,), (jnp.ones_like(t),))[1]

    t = jnp.asarray(t, dtype=float)
    prescribed, acceleration = jax.jvp(rate, (t,), (jnp.ones_like(t),))
    return Row(row.value - function(t), row.jacobian, row.bias - acceleration, -prescribed)


def _scaled(wrench: Wrench, factor: Scalar) -> Wrench:
    return Wrench(wrench.force * factor, wrench.moment * factor)


def _sum(one: Row, other: Row) -> Row:
    jacobian = dict(one.jacobian)
    for name, wrench in other.jacobian.items():
        jacobian[name] = jacobian.get(name, NO_WRENCH) + wrench
    bias, time_rate = add(one.bias, other.bias), add(one.time_rate, other.time_rate)
    return Row(add(one.value, other.value), jacobian, bias, time_rate)
