"""Constraint rows composed of other rows: sums, distances, and functions of time."""

from collections.abc import Callable, Iterable
from functools import reduce

import jax
import jax.numpy as jnp

from ...math.vectors import Scalar, add, multiply
from ..bodies import NO_WRENCH, Wrench
from .base import Motions, Row


def scaled_row(row: Row, factor: Scalar) -> Row:
    """Return a row multiplied by a constant: its value, Jacobian, bias and time rate."""
    jacobian = {name: _scaled(wrench, factor) for name, wrench in row.jacobian.items()}
    bias, time_rate = multiply(row.bias, factor), multiply(row.time_rate, factor)
    return Row(multiply(row.value, factor), jacobian, bias, time_rate)


def sum_of_rows(rows: Iterable[Row]) -> Row:
    """Return the sum of rows: of their values, Jacobians, biases and time rates."""
    return reduce(_sum, rows)


def distance_row(components: Iterable[Row], length: Scalar, motions: Motions) -> Row:
    """Return the row that keeps a vector's length constant.

    The row's value is (x^2 + y^2 + ... - length^2)/(2 length), m.

    **Arguments:**

    - `components`: rows whose values x, y, ... are the vector's components, m.
    - `length`: required length of the vector, m.
    - `motions`: motion of each body by name.
    """
    components = list(components)
    names = {name: None for row in components for name in row.jacobian}
    # The squared length is differentiable everywhere. Dividing by 2 length gives a row in m, whose
    # derivative along the vector is 1, so that the multiplier is the force in N.
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
    """Return a row less a prescribed function of time, so that its value follows the function.

    **Arguments:**

    - `row`: the constraint row of the quantity to prescribe, such as an angle.
    - `function`: prescribed value in the row's unit, from the time in s; JAX must be able to
      differentiate it twice.
    - `t`: time, s.
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
