"""Interpolation over a time step: Hermite polynomials, parabolas, roots, maxima and integrals.

A position x in a step is a number from 0 at its start to 1 at its end. The length of the step is h,
s. A rate is the derivative by x divided by h. Functions work element by element for arrays, and
have no loops at run time, except for `secant_root`.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .vectors import Scalar

NEWTON_STEPS = 4
"""Number of Newton steps in `hermite_root`. Near the root, each one doubles the correct digits."""
TINY = 1e-200
"""Smallest magnitude of the divisor in `Parabola.part_below`, the coefficient of x^2."""
SECANT_STEPS = 12
"""Number of evaluations in `secant_root`, fixed so that all lanes of a batch do the same."""
REFINEMENTS = 3
"""Number of evaluations in `highest`."""
MARGIN = 0.05
"""Smallest distance of a new evaluation in `highest` from the outer two of the three points, over
the distance between these two. The next parabola divides by distances of points, and a smaller
distance would enlarge rounding errors. The last evaluation, without a next parabola, has no limit.
"""
GUESS_MARGIN = 0.1
"""Smallest distance of the first evaluation in `highest_after` from the ends of the interval, over
its length: larger than `MARGIN`, because the position of this evaluation is extrapolated."""
LARGEST_SHIFT = 0.25
"""Largest distance between the maxima of the parabola and of the cubic in `highest_after`, relative
to the length of the interval. A single Newton step does not find a maximum that is farther away."""


def gauss_rule(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes and weights, (count,) each, of Gauss quadrature over [0, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * (nodes + 1.0), 0.5 * weights


class Slope(NamedTuple):
    """A value and its rate, per s, such as `Gap.factor`.

    >>> extend.Gap(depth=1e-5, rate=0.1, factor=extend.Slope(value=1.2, rate=0.0)).factor.value
    1.2
    """

    value: Scalar
    rate: Scalar


def hermite_value(x: Scalar, start: Slope, end: Slope, h: Scalar) -> Scalar:
    """Return the value at x, 0 to 1, of the cubic with given values and rates at a step's ends."""
    y = 1.0 - x
    left = y * y * ((1.0 + 2.0 * x) * start.value + x * h * start.rate)
    right = x * x * ((1.0 + 2.0 * y) * end.value - y * h * end.rate)
    return left + right


def hermite_rate(x: Scalar, start: Slope, end: Slope, h: Scalar) -> Scalar:
    """Return the rate at x, 0 to 1, of the cubic with given values and rates at a step's ends."""
    y = 1.0 - x
    slope = 6.0 * x * y * (end.value - start.value) / h
    return slope + y * (1.0 - 3.0 * x) * start.rate + x * (3.0 * x - 2.0) * end.rate


def hermite_root(start: Slope, end: Slope, h: Scalar) -> Scalar:
    """Return the approximate root x of the cubic of `hermite_value`, if its values at the ends of
    the step have opposite signs, by `NEWTON_STEPS` Newton steps within a shrinking bracket."""
    lower, upper = jnp.zeros_like(end.value), jnp.ones_like(end.value)
    # Start from the root of the straight line through both ends.
    x = start.value / (start.value - end.value)
    sign = jnp.where(end.value > 0.0, 1.0, -1.0)
    for _ in range(NEWTON_STEPS):
        value = hermite_value(x, start, end, h)
        # Where the value has the sign of the end, x is past the root.
        past = sign * value > 0.0
        lower, upper = jnp.where(past, lower, x), jnp.where(past, x, upper)
        slope = h * hermite_rate(x, start, end, h)
        # With 1 in place of a zero slope, the step is arbitrary but finite; the root remains in
        # the bracket.
        newton = x - value / jnp.where(slope == 0.0, 1.0, slope)
        # Bisection where Newton's step leaves the bracket.
        inside = (newton >= lower) & (newton <= upper)
        x = jnp.where(inside, newton, 0.5 * (lower + upper))
    return x


class Bend(NamedTuple):
    """A value and its first and second derivative by time at one end of a step."""

    value: Scalar
    rate: Scalar
    second_rate: Scalar


class Quintic(NamedTuple):
    """Polynomial of fifth degree over a step of `h`, s; `coefficients` are those of x^0 to x^5."""

    coefficients: tuple[Scalar, ...]
    h: Scalar

    @staticmethod
    def through(start: Bend, end: Bend, h: Scalar) -> "Quintic":
        # Derivatives by x. The coefficients up to x^2 follow from the start, and the other three
        # from the remainders of value, first and second derivative at the end.
        a, da, dda = start.value, h * start.rate, h * h * start.second_rate
        b, db, ddb = end.value, h * end.rate, h * h * end.second_rate
        rise = b - a - da - 0.5 * dda
        slope, bend = db - da - dda, ddb - dda
        c3 = 10 * rise - 4 * slope + 0.5 * bend
        c4 = -15 * rise + 7 * slope - bend
        c5 = 6 * rise - 3 * slope + 0.5 * bend
        return Quintic((a, da, 0.5 * dda, c3, c4, c5), h)

    def value(self, x: Scalar) -> Scalar:
        a, da, half, c3, c4, c5 = self.coefficients
        return a + x * (da + x * (half + x * (c3 + x * (c4 + x * c5))))

    def rate(self, x: Scalar) -> Scalar:
        """Return the rate at position x; zero in a step of zero length, whose ends are equal."""
        _, da, half, c3, c4, c5 = self.coefficients
        slope = da + x * (2.0 * half + x * (3 * c3 + x * (4 * c4 + x * 5 * c5)))
        return slope / jnp.where(self.h > 0.0, self.h, 1.0)


class Parabola(NamedTuple):
    """Parabola start + slope x + bend x^2 over a step."""

    start: Scalar
    slope: Scalar
    bend: Scalar

    @staticmethod
    def through(start: Scalar, middle: Scalar, end: Scalar) -> "Parabola":
        """Return the parabola with the given values at x = 0, 1/2 and 1."""
        bend = 2.0 * (start - 2.0 * middle + end)
        return Parabola(start, end - start - bend, bend)

    def at(self, x: Scalar) -> Scalar:
        return self.start + x * (self.slope + x * self.bend)

    def vertex(self) -> Scalar:
        """Return the x of the extreme value; any number for a straight line."""
        return -0.5 * self.slope / jnp.where(self.bend == 0.0, 1.0, self.bend)

    def extremes(self, a: Scalar, b: Scalar) -> tuple[Scalar, Scalar]:
        """Return the smallest and the largest value for x in [a, b]."""
        # Without curvature the vertex is arbitrary, which does no harm: clipped to [a, b], it is
        # one more point of the straight line.
        ends, inner = (self.at(a), self.at(b)), self.at(jnp.clip(self.vertex(), a, b))
        return (jnp.minimum(jnp.minimum(*ends), inner), jnp.maximum(jnp.maximum(*ends), inner))

    def part_below(self, level: Scalar, a: Scalar, b: Scalar) -> Scalar:
        """Return the total length of the parts of [a, b] in which the value is below `level`."""
        # A straight line is treated as a parabola of negligible curvature, which has one root far
        # away.
        bend = jnp.where(jnp.abs(self.bend) > TINY, self.bend, TINY)
        above = self.start - level
        squared = self.slope * self.slope - 4.0 * bend * above
        root = jnp.sqrt(jnp.maximum(squared, 0.0))
        # To avoid cancellation, q is the sum of two numbers of equal sign, and the roots are q/bend
        # and above/q.
        q = -0.5 * (self.slope + jnp.where(self.slope < 0.0, -root, root))
        r, s = q / bend, above / jnp.where(q == 0.0, 1.0, q)
        # The length of the part of [a, b] between the roots.
        between = jnp.clip(jnp.maximum(r, s), a, b) - jnp.clip(jnp.minimum(r, s), a, b)
        # A parabola that opens upwards is below the level between its roots, another one outside.
        crossing = jnp.where(bend > 0.0, between, (b - a) - between)
        # Without roots, the parabola is on one side of the level throughout.
        throughout = jnp.where(self.at(0.5 * (a + b)) < level, b - a, 0.0)
        return jnp.where(squared > 0.0, crossing, throughout)


class Point(NamedTuple):
    """A position x in a step and a function's value there."""

    x: Scalar
    value: Scalar


def secant_root(value_at: Callable[[Scalar], Scalar], start: Point, end: Point) -> Scalar:
    """Return the approximate root x of a function between two points with values of opposite signs,
    by `SECANT_STEPS` secant steps within a shrinking bracket (N. Anderson, A. Bjorck 1973)."""

    # Secants without a bracket missed the root of a contact that begins soon after another one has
    # ended: both ends of the step are then at the wall, and the greatest distance lies between.
    def refine(_: int, state: tuple[Point, Point]) -> tuple[Point, Point]:
        # The root lies between the latest point and `other`.
        last, other = state
        change = last.value - other.value
        # Between equal values, such as zeros, there is no secant with a root: the position stays.
        divisor = jnp.where(change == 0.0, 1.0, change)
        x = jnp.where(change == 0.0, last.x, last.x - last.value * (last.x - other.x) / divisor)
        new = Point(x, value_at(x))
        # If the sign changes, the root is between the latest and the new point, and otherwise still
        # on the side of `other`.
        crosses = (new.value > 0.0) != (last.value > 0.0)
        # If `other` stays the far end of the bracket, its value is reduced, so that the next secant
        # meets zero on the other side of the root. Otherwise one end would never move.
        ratio = 1.0 - new.value / jnp.where(last.value == 0.0, 1.0, last.value)
        reduced = other.value * jnp.where(ratio > 0.0, ratio, 0.5)
        # At a root, neither the position nor the value must change any more.
        reduced = jnp.where(last.value == 0.0, other.value, reduced)
        return new, _either(crosses, last, Point(other.x, reduced))

    # Loops need arrays of equal types.
    ends = jax.tree.map(partial(jnp.asarray, dtype=float), (end, start))
    return jax.lax.fori_loop(0, SECANT_STEPS, refine, ends)[0].x


def vertex(first: Point, middle: Point, last: Point) -> Scalar:
    """Return the position x of the maximum of the parabola through three points, clipped to the
    interval between the outer ones; the middle point's x if the parabola has no maximum."""
    left_slope = _slope(first, middle)
    right_slope = _slope(middle, last)
    # Half of the parabola's second derivative.
    bend = (right_slope - left_slope) / _positive(last.x - first.x)
    # The slope of the parabola at the middle point, from which its maximum is a Newton step away.
    slope = left_slope + bend * (middle.x - first.x)
    # Without a maximum, the divisor is infinite, and the shift is zero.
    shift = -0.5 * slope / jnp.where(bend < 0.0, bend, -jnp.inf)
    return jnp.clip(middle.x + shift, first.x, last.x)


def highest_after(
    value_at: Callable[[Scalar], Scalar], before: Point, first: Point, last: Point
) -> Point:
    """Estimate the maximum of a function between the points `first` and `last`, using a further
    point before them.

    The function is evaluated twice: at the maximum of the parabola through the three points, and at
    the maximum of the cubic through these points and the first evaluation. The result has the
    largest value of `first`, `last` and the two evaluations. Its position is the position of
    `first` or `last` if that point is higher than both evaluations, and otherwise the maximum of
    the parabola through the higher evaluation and its neighbours, which is nearer to the function's
    maximum than these points.
    """
    margin = GUESS_MARGIN * (last.x - first.x)
    # If the extrapolated parabola has no maximum, the search begins in the middle.
    bends = _bend(before, first, last) < 0.0
    guess = jnp.where(bends, vertex(before, first, last), 0.5 * (first.x + last.x))
    guess = jnp.clip(guess, first.x + margin, last.x - margin)
    middle = Point(guess, value_at(guess))
    refined = _cubic_vertex(before, first, middle, last)
    a, b, c = _nearest_three(first, middle, last, Point(refined, value_at(refined)))
    # The higher inner point is b. If an end is above it, also one that is not its neighbour, the
    # maximum is at that end.
    higher_end = higher(first, last)
    x = jnp.where(b.value >= higher_end.value, vertex(a, b, c), higher_end.x)
    return Point(x, higher(higher_end, b).value)


def _cubic_vertex(before: Point, first: Point, middle: Point, last: Point) -> Scalar:
    """Return the approximate position x of the maximum of the cubic through four points, by a
    Newton step from the maximum of the parabola through the last three."""
    x = vertex(first, middle, last)
    bend = _bend(first, middle, last)
    # In Newton's form, the cubic is the parabola plus twist (x - first)(x - middle)(x - last). The
    # first and second derivative of the cubic at x follow. The parabola's slope at x is taken as
    # zero, which is exact if its maximum is between `first` and `last`.
    twist = (bend - _bend(before, first, middle)) / _positive(last.x - before.x)
    a, b, c = x - first.x, x - middle.x, x - last.x
    slope = twist * (a * b + b * c + c * a)
    slope_rate = 2.0 * (bend + twist * (a + b + c))
    limit = LARGEST_SHIFT * (last.x - first.x)
    # Without a maximum near x, the divisor is infinite, and the shift is zero.
    shift = -slope / jnp.where(slope_rate < 0.0, slope_rate, -jnp.inf)
    return jnp.clip(x + jnp.clip(shift, -limit, limit), first.x, last.x)


def _bend(first: Point, middle: Point, last: Point) -> Scalar:
    """Return half the second derivative by x of the parabola through three points."""
    return (_slope(middle, last) - _slope(first, middle)) / _positive(last.x - first.x)


def highest(
    value_at: Callable[[Scalar], Scalar], first: Point, middle: Point, last: Point
) -> Point:
    """Estimate the maximum of a function between the first and last of three points in order of x.

    The function is evaluated `REFINEMENTS` times, by successive parabolic interpolation (R. Brent,
    Algorithms for Minimization without Derivatives, 1973, ch. 5). Each time, the higher one of the
    two inner points (`middle` and the new point) and its neighbours are kept. The result is the
    highest of the last three points; the maximum of a parabola would be too large at a kink.
    """
    for count in reversed(range(REFINEMENTS)):
        # The last evaluation is not used for a further parabola, and may be near the other points.
        margin = MARGIN * (last.x - first.x) if count else 0.0
        x = jnp.clip(vertex(first, middle, last), first.x + margin, last.x - margin)
        first, middle, last = _nearest_three(first, middle, last, Point(x, value_at(x)))
    return higher(higher(first, last), middle)


def _nearest_three(
    first: Point, middle: Point, last: Point, new: Point
) -> tuple[Point, Point, Point]:
    """Return the higher of the points `middle` and `new`, and its two neighbours, in order of x."""
    is_right = new.x > middle.x
    left, right = _either(is_right, middle, new), _either(is_right, new, middle)
    # If the left inner point is the higher one, the last point is dropped, and otherwise the first.
    falls = left.value >= right.value
    return (_either(falls, first, left), _either(falls, left, right), _either(falls, right, last))


def higher(first: Point, second: Point) -> Point:
    """Return the point with the larger value, or the first if the values are equal."""
    return _either(second.value > first.value, second, first)


def _either(condition: Scalar, first: Point, second: Point) -> Point:
    return Point(*map(partial(jnp.where, condition), first, second))


def _slope(first: Point, second: Point) -> Scalar:
    return (second.value - first.value) / _positive(second.x - first.x)


def _positive(length: Scalar) -> Scalar:
    """Return a length as a divisor: 1 in place of zero."""
    return jnp.where(length > 0.0, length, 1.0)
