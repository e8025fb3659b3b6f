"""Interpolation in a step: Hermite polynomials, parabolas, and maxima of functions.

A position x in a step runs from 0 at its start to 1 at its end. All functions are scalar arithmetic
without loops, elementwise for arrays.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp

from .vectors import Scalar

NEWTON_STEPS = 4
TINY = 1e-200
"""Coefficient of x^2 below which a parabola is a line."""
SECANT_STEPS = 4
REFINEMENTS = 3
MARGIN = 0.05
"""Smallest distance of a refinement from the outer two of three points, as a part of the distance
between these; later refinements would divide by a small number otherwise."""
GUESS_MARGIN = 0.1
"""Smallest distance of a guess from the ends of the interval between two points, as a part of its
length, if the guess is extrapolated with a third point outside the interval."""
LARGEST_SHIFT = 0.25
"""Largest correction of a parabola's vertex by a cubic, as a part of the distance between the outer
two of the parabola's three points."""


class Slope(NamedTuple):
    """A value and its rate of change."""

    value: Scalar
    rate: Scalar


def hermite_value(x: Scalar, start: Slope, end: Slope, h: Scalar) -> Scalar:
    """Return the value of the cubic Hermite interpolant at a position x in a step of length h."""
    y = 1.0 - x
    left = y * y * ((1.0 + 2.0 * x) * start.value + x * h * start.rate)
    right = x * x * ((1.0 + 2.0 * y) * end.value - y * h * end.rate)
    return left + right


def hermite_rate(x: Scalar, start: Slope, end: Slope, h: Scalar) -> Scalar:
    """Return the rate, per unit of h, of the cubic Hermite interpolant at a position x."""
    y = 1.0 - x
    slope = 6.0 * x * y * (end.value - start.value) / h
    return slope + y * (1.0 - 3.0 * x) * start.rate + x * (3.0 * x - 2.0) * end.rate


def hermite_root(start: Slope, end: Slope, h: Scalar) -> Scalar:
    """Return the approximate position of the root of the cubic Hermite interpolant.

    The interpolant must have opposite signs at the ends of the step, whose length is h. A few
    Newton steps in a shrinking bracket are taken, so the root is inexact for large curvature.
    """
    lower, upper = jnp.zeros_like(end.value), jnp.ones_like(end.value)
    x = start.value / (start.value - end.value)
    sign = jnp.where(end.value > 0.0, 1.0, -1.0)
    for _ in range(NEWTON_STEPS):
        value = hermite_value(x, start, end, h)
        past = sign * value > 0.0
        lower, upper = jnp.where(past, lower, x), jnp.where(past, x, upper)
        slope = h * hermite_rate(x, start, end, h)
        newton = x - value / jnp.where(slope == 0.0, 1.0, slope)
        # Bisection where Newton's step leaves the bracket.
        inside = (newton >= lower) & (newton <= upper)
        x = jnp.where(inside, newton, 0.5 * (lower + upper))
    return x


def secant_root(value_at: Callable[[Scalar], Scalar], start: Scalar, end: Scalar) -> Scalar:
    """Return the approximate position, from 0 to 1, of the root of a function by secant steps.

    **Arguments:** `start`, `end`: values of the function at 0 and 1, of opposite signs.
    """
    x_old, x, value_old, value = jnp.zeros_like(start), jnp.ones_like(end), start, end
    for _ in range(SECANT_STEPS):
        change = value - value_old
        slope = jnp.where(change == 0.0, 1.0, change)
        x_old, x = x, jnp.clip(x - value * (x - x_old) / slope, 0.0, 1.0)
        value_old, value = value, value_at(x)
    return x


class Bend(NamedTuple):
    """A value, its rate and its rate of second order."""

    value: Scalar
    rate: Scalar
    second_rate: Scalar


class Quintic(NamedTuple):
    """Polynomial of fifth degree in x: coefficients, lowest power first, and length of the step."""

    coefficients: tuple[Scalar, ...]
    h: Scalar

    @staticmethod
    def through(start: Bend, end: Bend, h: Scalar) -> "Quintic":
        """Return the polynomial with value, rate and second rate at both ends of a step."""
        a, da, dda = start.value, h * start.rate, h * h * start.second_rate
        b, db, ddb = end.value, h * end.rate, h * h * end.second_rate
        rise = b - a - da - 0.5 * dda
        slope, bend = db - da - dda, ddb - dda
        c3 = 10 * rise - 4 * slope + 0.5 * bend
        c4 = -15 * rise + 7 * slope - bend
        c5 = 6 * rise - 3 * slope + 0.5 * bend
        return Quintic((a, da, 0.5 * dda, c3, c4, c5), h)

    def value(self, x: Scalar) -> Scalar:
        """Return the value at x."""
        a, da, half, c3, c4, c5 = self.coefficients
        return a + x * (da + x * (half + x * (c3 + x * (c4 + x * c5))))

    def rate(self, x: Scalar) -> Scalar:
        """Return the rate at x; zero in a step of zero length."""
        _, da, half, c3, c4, c5 = self.coefficients
        slope = da + x * (2.0 * half + x * (3 * c3 + x * (4 * c4 + x * 5 * c5)))
        return slope / jnp.where(self.h > 0.0, self.h, 1.0)


class Parabola(NamedTuple):
    """start + slope x + bend x^2 in a step."""

    start: Scalar
    slope: Scalar
    bend: Scalar

    @staticmethod
    def through(start: Scalar, middle: Scalar, end: Scalar) -> "Parabola":
        """Return the parabola with the given values at 0, 1/2 and 1."""
        bend = 2.0 * (start - 2.0 * middle + end)
        return Parabola(start, end - start - bend, bend)

    def at(self, x: Scalar) -> Scalar:
        """Return the value at x."""
        return self.start + x * (self.slope + x * self.bend)

    def extremes(self, a: Scalar, b: Scalar) -> tuple[Scalar, Scalar]:
        """Return the smallest and the largest value between a and b."""
        vertex = -0.5 * self.slope / jnp.where(self.bend == 0.0, 1.0, self.bend)
        ends, inner = (self.at(a), self.at(b)), self.at(jnp.clip(vertex, a, b))
        return (
            jnp.minimum(jnp.minimum(*ends), inner),
            jnp.maximum(jnp.maximum(*ends), inner),
        )

    def part_below(self, level: Scalar, a: Scalar, b: Scalar) -> Scalar:
        """Return the length of the part of [a, b] in which the value is below a level."""
        bend = jnp.where(jnp.abs(self.bend) > TINY, self.bend, TINY)
        above = self.start - level
        squared = self.slope * self.slope - 4.0 * bend * above
        root = jnp.sqrt(jnp.maximum(squared, 0.0))
        # Both roots without cancellation: q has the larger magnitude of -slope +- root.
        q = -0.5 * (self.slope + jnp.where(self.slope < 0.0, -root, root))
        r, s = q / bend, above / jnp.where(q == 0.0, 1.0, q)
        between = jnp.clip(jnp.maximum(r, s), a, b) - jnp.clip(jnp.minimum(r, s), a, b)
        crossing = jnp.where(bend > 0.0, between, (b - a) - between)
        throughout = jnp.where(self.at(0.5 * (a + b)) < level, b - a, 0.0)
        return jnp.where(squared > 0.0, crossing, throughout)


class Point(NamedTuple):
    """A position in a step and the value of a function there."""

    x: Scalar
    value: Scalar


def vertex(first: Point, middle: Point, last: Point) -> Scalar:
    """Return the position of the maximum of the parabola through three points.

    The position is limited to the interval from the first to the last point. If the parabola has no
    maximum, it is the middle point's.

    **Arguments:** three points with rising positions.
    """
    left = _slope(first, middle)
    right = _slope(middle, last)
    bend = (right - left) / _positive(last.x - first.x)
    slope = left + bend * (middle.x - first.x)
    # A parabola without a maximum gives no shift, since the division is by infinity.
    shift = -0.5 * slope / jnp.where(bend < 0.0, bend, -jnp.inf)
    return jnp.clip(middle.x + shift, first.x, last.x)


def highest_after(
    value_at: Callable[[Scalar], Scalar], before: Point, first: Point, last: Point
) -> Point:
    """Return the estimated maximum of a function between the points `first` and `last`.

    The function is evaluated twice: at the maximum of the parabola through the three given points,
    which gives a fourth point, and at the maximum of the cubic through all four points. The value
    of the result is the largest known value of the function in the interval, as in `highest`. If an
    inner point is the highest, the position of the result is the maximum of the parabola through it
    and its neighbours, which is more accurate than the positions of the evaluations.

    **Arguments:** three points with rising positions; `before` is outside the searched interval.
    """
    margin = GUESS_MARGIN * (last.x - first.x)
    # Without a maximum of the extrapolated parabola the search begins in the middle.
    bends = _bend(before, first, last) < 0.0
    guess = jnp.where(bends, vertex(before, first, last), 0.5 * (first.x + last.x))
    guess = jnp.clip(guess, first.x + margin, last.x - margin)
    middle = Point(guess, value_at(guess))
    refined = _cubic_vertex(before, first, middle, last)
    a, b, c = _nearest_three(first, middle, last, Point(refined, value_at(refined)))
    is_peak = (b.value >= a.value) & (b.value >= c.value)
    top = higher(higher(first, last), b)
    return Point(jnp.where(is_peak, vertex(a, b, c), top.x), top.value)


def _cubic_vertex(before: Point, first: Point, middle: Point, last: Point) -> Scalar:
    """Return the approximate position of the maximum of the cubic through four points.

    It is one Newton step, of at most `LARGEST_SHIFT`, from the maximum of the parabola through the
    last three points, and is limited to the interval from `first` to `last`.

    **Arguments:** four points with rising positions.
    """
    x = vertex(first, middle, last)
    bend = _bend(first, middle, last)
    # Newton's form of the cubic: the parabola plus twist (x - first)(x - middle)(x - last), whose
    # derivatives at x are below.
    twist = (bend - _bend(before, first, middle)) / _positive(last.x - before.x)
    a, b, c = x - first.x, x - middle.x, x - last.x
    slope = twist * (a * b + b * c + c * a)
    slope_rate = 2.0 * (bend + twist * (a + b + c))
    limit = LARGEST_SHIFT * (last.x - first.x)
    shift = -slope / jnp.where(slope_rate < 0.0, slope_rate, -jnp.inf)
    return jnp.clip(x + jnp.clip(shift, -limit, limit), first.x, last.x)


def _bend(first: Point, middle: Point, last: Point) -> Scalar:
    """Return the coefficient of x^2 of the parabola through three points."""
    return (_slope(middle, last) - _slope(first, middle)) / _positive(last.x - first.x)


def highest(
    value_at: Callable[[Scalar], Scalar], first: Point, middle: Point, last: Point
) -> Point:
    """Return the estimated maximum of a function between the first and the last of three points.

    Successive parabolic interpolation (R. Brent, Algorithms for Minimization without Derivatives,
    1973, ch. 5) evaluates the function three times. The result is the highest evaluated point, and
    not the vertex of a parabola, which would be too high at a kink.
    """
    for count in reversed(range(REFINEMENTS)):
        # No refinement follows the last one, which needs no distance from the others.
        margin = MARGIN * (last.x - first.x) if count else 0.0
        x = jnp.clip(vertex(first, middle, last), first.x + margin, last.x - margin)
        first, middle, last = _nearest_three(first, middle, last, Point(x, value_at(x)))
    return higher(higher(first, last), middle)


def _nearest_three(
    first: Point, middle: Point, last: Point, new: Point
) -> tuple[Point, Point, Point]:
    """Return the higher of two inner points between its two neighbours.

    **Arguments:** `first`, `middle`, `last`: points with rising positions; `new`: a further point
    between `first` and `last`. The inner points are `middle` and `new`.
    """
    is_right = new.x > middle.x
    low, high = _either(is_right, middle, new), _either(is_right, new, middle)
    falls = low.value >= high.value
    return (
        _either(falls, first, low),
        _either(falls, low, high),
        _either(falls, high, last),
    )


def higher(one: Point, other: Point) -> Point:
    """Return the point with the larger value."""
    return _either(other.value > one.value, other, one)


def _either(condition: Scalar, one: Point, other: Point) -> Point:
    return Point(
        jnp.where(condition, one.x, other.x),
        jnp.where(condition, one.value, other.value),
    )


def _slope(first: Point, second: Point) -> Scalar:
    return (second.value - first.value) / _positive(second.x - first.x)


def _positive(length: Scalar) -> Scalar:
    return jnp.where(length > 0.0, length, 1.0)
