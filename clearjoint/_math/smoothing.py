"""Functions of scalars: branches, angles, derivatives; powers and norms with finite derivatives.

For numbers of Python and NumPy, NumPy computes these functions, so that nothing is compiled, except
for `value_and_slope`, `positive_power` and `ramp`, which always use JAX.
"""

import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree

from .vectors import Condition, Scalar, Vector, are_traced_alike, library, square_root

TURN = 2.0 * math.pi
"""One revolution, rad."""


def where(condition: Condition, first: Scalar, second: Scalar) -> Scalar:
    if isinstance(condition, bool | np.bool_):
        return first if condition else second
    # JAX traces the primitive, here with a condition of shape (), in less time than
    # `jax.numpy.where`.
    if isinstance(condition, Tracer) and are_traced_alike(first, second) and not condition.shape:
        return jax.lax.select(condition, first, second)
    return library((condition, first, second)).where(condition, first, second)


def sine(angle: Scalar) -> Scalar:
    return library((angle,)).sin(angle)


def cosine(angle: Scalar) -> Scalar:
    return library((angle,)).cos(angle)


def polar_angle(sine: Scalar, cosine: Scalar) -> Scalar:
    """Return the polar angle, rad in [-pi, pi], of the point (cosine, sine), of any norm."""
    return library((sine, cosine)).arctan2(sine, cosine)


def wrapped(value: Scalar, period: Scalar) -> Scalar:
    """Return a value minus the nearest multiple of a period: within half a period of zero."""
    return value - period * library((value, period)).round(value / period)


def value_and_slope(function: Callable[[Scalar], PyTree], x: Scalar) -> tuple[PyTree, PyTree]:
    x = jnp.asarray(x, dtype=float)
    return jax.jvp(function, (x,), (jnp.ones_like(x),))


_TINY = 1e-200
"""Square of a vector's norm up to which the vector counts as zero."""


def positive_power(x: Scalar, exponent: Scalar) -> Scalar:
    """Return max(x, 0)^exponent, for an exponent of at least one.

    The slow general power is not computed if the exponent is the Python number 1.5 or 1.

    >>> print(f"{extend.positive_power(4.0, 1.5):.1f}, {extend.positive_power(-4.0, 1.5):.1f}")
    8.0, 0.0
    """
    positive, number = x > 0.0, exponent if isinstance(exponent, int | float) else None
    if number == 1.0:
        return jnp.where(positive, x, 0.0)
    # The power of a negative number would be NaN, and its derivative NaN even where it is not used.
    safe = jnp.where(positive, x, 1.0)
    power = safe * jnp.sqrt(safe) if number == 1.5 else safe**exponent
    return jnp.where(positive, power, 0.0)


def norm_and_direction(vector: Vector) -> tuple[Scalar, Vector]:
    """Return the norm of a vector, and the unit vector in its direction.

    For a vector shorter than 1e-100, both are zero, with zero derivatives.

    >>> norm, direction = extend.norm_and_direction(extend.Vector(3.0, 4.0, 0.0))
    >>> print(f"{norm:.1f}, {direction.x:.1f}, {direction.y:.1f}")
    5.0, 0.6, 0.8
    """
    square = vector.dot(vector)
    vanishes = square <= _TINY
    norm = square_root(where(vanishes, 1.0, square))
    inverse = where(vanishes, 0.0, 1.0 / norm)
    return where(vanishes, 0.0, norm), vector * inverse


def ramp(x: Scalar, width: Scalar | None) -> Scalar:
    r"""Return max(x, 0), or a smooth approximation to it if a width w > 0 is given.

    The approximation differs from max(x, 0) only for -w < x < w, where it is

    $$\frac{(x + w)^2}{4 w}$$

    >>> print(f"{extend.ramp(0.0, 1e-6):.2e}, {extend.ramp(2e-6, 1e-6):.2e}")  # w/4, x
    2.50e-07, 2.00e-06
    """
    if width is None:
        return jnp.maximum(x, 0.0)
    inside = jnp.clip(x, -width, width)
    return (inside + width) ** 2 / (4.0 * width) + jnp.maximum(x - width, 0.0)
