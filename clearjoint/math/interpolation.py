"""Interpolation along a step: Hermite's polynomials, parabolas, and the peaks of functions.

Places run from 0 at the start of a step to 1 at its end. Everything is scalar arithmetic without
loops, elementwise in arrays.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp

from .vectors import Scalar

NEWTON_STEPS = 4
TINY = 1e-200
"""Bend below which a parabola is a line."""
SECANT_STEPS = 4
REFINEMENTS = 3
MARGIN = 0.05
"""Of the distance between the outer two of three places: how near to them, at least, a refinement
stays, so that what follows it divides by no small number."""
GUESS_MARGIN = 0.1
"""The same of a place that is guessed from points outside."""
LARGEST_SHIFT = 0.25
"""By which the cubic through four points may move the vertex of a parabola, on that distance."""


class Slope(NamedTuple):
    """A value and its rate of change."""

    value: Scalar
    rate: Scalar


def hermite_value(x: Scalar, start: Slope, end: Slope, h: Scalar) -> Scalar:
    """Cubic Hermite interpolant at the place x of a step of length h."""
    y = 1.0 - x
    left = y * y * ((1.0 + 2.0 * x) * start.value + x * h * start.rate)
    right = x * x * ((1.0 + 2.0 * y) * end.value - y * h * end.rate)
    return left + right


def hermite_rate(x: Scalar, start: Slope, end: Slope, h: Scalar) -> Scalar:
    """Rate of the cubic interpolant there."""
    y = 1.0 - x
    slope = 6.0 * x * y * (end.value - start.value) / h
    return slope + y * (1.0 - 3.0 * x) * start.rate + x * (3.0 * x - 2.0) * end.rate


def hermite_root(start: Slope, end: Slope, h: Scalar) -> Scalar:
    """Place at which the cubic interpolant, of opposite signs at its ends, is zero.

    A few Newton steps kept inside a shrinking bracket: not exact where it bends much.
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
        inside = (newton >= lower) & (newton <= upper)
        x = jnp.where(inside, newton, 0.5 * (lower + upper))
    return x


def secant_root(value_at: Callable[[Scalar], Scalar], start: Scalar, end: Scalar) -> Scalar:
    """Place at which a function, of given values of opposite signs at 0 and 1, is zero, by secant
    steps kept between them."""
    x_old, x, value_old, value = jnp.zeros_like(start), jnp.ones_like(end), start, end
    for _ in range(SECANT_STEPS):
        change = value - value_old
        slope = jnp.where(change == 0.0, 1.0, change)
        x_old, x = x, jnp.clip(x - value * (x - x_old) / slope, 0.0, 1.0)
        value_old, value = value, value_at(x)
    return x


class Bend(NamedTuple):
    """A value, its rate and its second rate."""

    value: Scalar
    rate: Scalar
    second_rate: Scalar


class Quintic(NamedTuple):
    """The polynomial of a step through value, rate and second rate at both ends; coefficients of
    the powers of the place, lowest first, and the length of the step."""

    coefficients: tuple[Scalar, ...]
    h: Scalar

    @staticmethod
    def through(start: Bend, end: Bend, h: Scalar) -> "Quintic":
        """The one of a step of length h."""
        a, da, dda = start.value, h * start.rate, h * h * start.second_rate
        b, db, ddb = end.value, h * end.rate, h * h * end.second_rate
        rise = b - a - da - 0.5 * dda
        slope, bend = db - da - dda, ddb - dda
        c3 = 10 * rise - 4 * slope + 0.5 * bend
        c4 = -15 * rise + 7 * slope - bend
        c5 = 6 * rise - 3 * slope + 0.5 * bend
        return Quintic((a, da, 0.5 * dda, c3, c4, c5), h)

    def value(self, x: Scalar) -> Scalar:
        """The value at a place."""
        a, da, half, c3, c4, c5 = self.coefficients
        return a + x * (da + x * (half + x * (c3 + x * (c4 + x * c5))))

    def rate(self, x: Scalar) -> Scalar:
        """The rate there; zero in a step without length."""
        _, da, half, c3, c4, c5 = self.coefficients
        slope = da + x * (2.0 * half + x * (3 * c3 + x * (4 * c4 + x * 5 * c5)))
        return slope / jnp.where(self.h > 0.0, self.h, 1.0)


class Parabola(NamedTuple):
    """start + slope x + bend x^2 over a step."""

    start: Scalar
    slope: Scalar
    bend: Scalar

    @staticmethod
    def through(start: Scalar, middle: Scalar, end: Scalar) -> "Parabola":
        """The one through the values at 0, 1/2 and 1."""
        bend = 2.0 * (start - 2.0 * middle + end)
        return Parabola(start, end - start - bend, bend)

    def at(self, x: Scalar) -> Scalar:
        """The value at a place."""
        return self.start + x * (self.slope + x * self.bend)

    def extremes(self, a: Scalar, b: Scalar) -> tuple[Scalar, Scalar]:
        """Smallest and largest value between a and b."""
        vertex = -0.5 * self.slope / jnp.where(self.bend == 0.0, 1.0, self.bend)
        ends, turn = (self.at(a), self.at(b)), self.at(jnp.clip(vertex, a, b))
        return (
            jnp.minimum(jnp.minimum(*ends), turn),
            jnp.maximum(jnp.maximum(*ends), turn),
        )

    def part_below(self, level: Scalar, a: Scalar, b: Scalar) -> Scalar:
        """How long, on the places between a and b, the value is below a level."""
        bend = jnp.where(jnp.abs(self.bend) > TINY, self.bend, TINY)
        above = self.start - level
        squared = self.slope * self.slope - 4.0 * bend * above
        root = jnp.sqrt(jnp.maximum(squared, 0.0))
        q = -0.5 * (self.slope + jnp.where(self.slope < 0.0, -root, root))
        one, other = q / bend, above / jnp.where(q == 0.0, 1.0, q)
        between = jnp.clip(jnp.maximum(one, other), a, b) - jnp.clip(jnp.minimum(one, other), a, b)
        crossing = jnp.where(bend > 0.0, between, (b - a) - between)
        throughout = jnp.where(self.at(0.5 * (a + b)) < level, b - a, 0.0)
        return jnp.where(squared > 0.0, crossing, throughout)


class Point(NamedTuple):
    """A value at a place."""

    place: Scalar
    value: Scalar


def vertex(first: Point, middle: Point, last: Point) -> Scalar:
    """Place between the first and the last of three points, in rising order, at which the parabola
    through them is largest; one in between where it has no largest value."""
    left = _slope(first, middle)
    right = _slope(middle, last)
    bend = (right - left) / _positive(last.place - first.place)
    slope = left + bend * (middle.place - first.place)
    shift = -0.5 * slope / jnp.where(bend < 0.0, bend, -jnp.inf)
    return jnp.clip(middle.place + shift, first.place, last.place)


def highest_after(
    value_at: Callable[[Scalar], Scalar], before: Point, first: Point, last: Point
) -> Point:
    """The largest value of a function between two of its points, with one more point before them
    and two more evaluations: at the vertex of the parabola through the three, and at that of the
    cubic through the four.

    As in `highest` the value is one of the function. The place is the last parabola's vertex, which
    is nearer to the peak than any place of an evaluation.
    """
    margin = GUESS_MARGIN * (last.place - first.place)
    bends = _bend(before, first, last) < 0.0
    guess = jnp.where(bends, vertex(before, first, last), 0.5 * (first.place + last.place))
    guess = jnp.clip(guess, first.place + margin, last.place - margin)
    middle = Point(guess, value_at(guess))
    place = _cubic_vertex(before, first, middle, last)
    one, two, three = _nearest_three(first, middle, last, Point(place, value_at(place)))
    peaks = (two.value >= one.value) & (two.value >= three.value)
    top = higher(higher(first, last), two)
    return Point(jnp.where(peaks, vertex(one, two, three), top.place), top.value)


def _cubic_vertex(before: Point, first: Point, middle: Point, last: Point) -> Scalar:
    """Place of the largest value of the cubic through four points, between the last three: by a
    Newton step from the vertex of their parabola."""
    x = vertex(first, middle, last)
    bend = _bend(first, middle, last)
    twist = (bend - _bend(before, first, middle)) / _positive(last.place - before.place)
    a, b, c = x - first.place, x - middle.place, x - last.place
    slope = twist * (a * b + b * c + c * a)
    slope_rate = 2.0 * (bend + twist * (a + b + c))
    limit = LARGEST_SHIFT * (last.place - first.place)
    shift = -slope / jnp.where(slope_rate < 0.0, slope_rate, -jnp.inf)
    return jnp.clip(x + jnp.clip(shift, -limit, limit), first.place, last.place)


def _bend(first: Point, middle: Point, last: Point) -> Scalar:
    """Half the second derivative of the parabola through three points."""
    return (_slope(middle, last) - _slope(first, middle)) / _positive(last.place - first.place)


def highest(
    value_at: Callable[[Scalar], Scalar], first: Point, middle: Point, last: Point
) -> Point:
    """The largest value of a function between the first and the last of three of its points.

    Successive parabolic interpolation (R. Brent, Algorithms for Minimization without Derivatives,
    1973, ch. 5) with three more evaluations. What comes out is a value of the function, so that a
    kink raises nothing above it.
    """
    for count in reversed(range(REFINEMENTS)):
        margin = MARGIN * (last.place - first.place) if count else 0.0
        place = vertex(first, middle, last)
        place = jnp.clip(place, first.place + margin, last.place - margin)
        first, middle, last = _nearest_three(first, middle, last, Point(place, value_at(place)))
    return higher(higher(first, last), middle)


def _nearest_three(
    first: Point, middle: Point, last: Point, new: Point
) -> tuple[Point, Point, Point]:
    """Of three points in rising order and a new one among them the three about the higher of the
    inner two."""
    behind = new.place > middle.place
    low, high = _either(behind, middle, new), _either(behind, new, middle)
    falls = low.value >= high.value
    return (
        _either(falls, first, low),
        _either(falls, low, high),
        _either(falls, high, last),
    )


def higher(one: Point, other: Point) -> Point:
    """The higher of two points."""
    return _either(other.value > one.value, other, one)


def _either(condition: Scalar, one: Point, other: Point) -> Point:
    return Point(
        jnp.where(condition, one.place, other.place),
        jnp.where(condition, one.value, other.value),
    )


def _slope(first: Point, second: Point) -> Scalar:
    return (second.value - first.value) / _positive(second.place - first.place)


def _positive(length: Scalar) -> Scalar:
    return jnp.where(length > 0.0, length, 1.0)
