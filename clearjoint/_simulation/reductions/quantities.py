"""Reductions of a quantity, such as a contact force: peak, mean, other statistics and quantiles."""

import math
from collections.abc import Mapping
from functools import partial
from typing import NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree
from typing_extensions import override

from ..._compilation.xla import traced_once
from ..._fields.checks import as_number, require, require_finite
from ..._math.interpolation import Parabola, Point, highest_after
from ..._math.smoothing import where
from ..._math.vectors import Scalar
from ...quantities.base import Instant, Quantity, number_at, numbers, require_quantity
from .base import AbstractWindowedReduction, Times

GAUSS_NODES = (-math.sqrt(0.6), 0.0, math.sqrt(0.6))
GAUSS_WEIGHTS = (5 / 18, 8 / 18, 5 / 18)
"""Gauss quadrature with three points: nodes on the interval -1 to 1, and weights of sum 1."""


class AbstractQuantityReduction(AbstractWindowedReduction):
    """Base class of reductions of one quantity over a window of time."""

    quantity: Quantity = eqx.field(static=True)
    unit: str = eqx.field(static=True)

    @override
    def __check_init__(self):
        require_quantity("quantity", self.quantity)
        require(isinstance(self.unit, str), "unit", self.unit, "text", 'pass for example "m/s"')

    def _value(self, now: Instant) -> Scalar:
        return number_at(now, self.quantity)


class PeakTally(NamedTuple):
    """Tally of `Peak`: points with a time, s, as x, and the value there. `highest`: the peak in the
    window so far, with the value minus infinity before the window; `end`, `start`: the points at
    the end and at the start of the latest step."""

    highest: Point
    end: Point
    start: Point


class Peak(AbstractQuantityReduction):
    """Largest value of a quantity in a run, with the time at which it occurs.

    The results are named "" (the value) and "time" (s). The peak may lie between the ends of a
    step: it is searched for in the solver's dense output. At usual tolerances the peak of a contact
    force agrees with that of an `ImpactTable` to 1e-6 of its value.

    Reductions evaluate their quantities at a few instants of each step. In free flight, which is
    integrated without error, a step may be as long as the flight. Where a quantity is not nearly
    quadratic in time there, such as an eccentricity or a distance, limit the length of steps:
    ``Settings(controller=diffrax.PIDController(rtol=1e-6, atol=1e-9, dtmax=1e-4))``.

    **Arguments:**

    - `quantity`: function of an `Instant` that returns a scalar; `unit`: its unit.
    - `after`, `until`: s, start, inclusive, and end, exclusive, of the window of time; by default
      those of the run. Each may also be a function of `Instant.scene` that JAX can trace, such as
      ``lambda scene: 2 * pi / scene.joints["drive"].speed``, for a window of its own in each run of
      a sweep. Of a step that crosses an edge of the window, only the part inside counts. Results
      are NaN if the run covers no part of the window.

    **Raises:** `ValueError` if `quantity` is not a function, if `after` or `until` is NaN or not a
    single number, or if `until` is not later than `after`.

    >>> peak = cj.Peak(cj.quantities.ContactForce("shoulder"), "N", after=0.5)
    >>> peak.units()
    {'': 'N', 'time': 's'}
    """

    differentiated, finds_instants = ("",), True

    @override
    def observed(self) -> tuple[Quantity, ...]:
        return (self.quantity,)

    @override
    def instants(self, results: Mapping[str, Scalar], span: tuple[float, float]) -> Times:
        # A shift of the instant of the peak does not change its value to first order.
        super().instants(results, span)
        return (float(results["time"]),)

    @override
    def combined(self, values: jax.Array, instants: tuple[float, ...]) -> dict[str, Scalar]:
        return {"": values[0, 0]}

    @override
    def start(self, now: Instant) -> PeakTally:
        value, window = self._value(now), self._window(now)
        begin = highest = Point(now.time, value)
        if not window.is_whole:
            highest = Point(now.time, jnp.where(window.holds(now.time), value, -jnp.inf))
        return PeakTally(highest, begin, begin)

    @override
    def update(self, tally: PeakTally, now: Instant) -> PeakTally:
        # Here the positions of points are fractions of this step, which begins where the previous
        # one ended, and not times as in the tally. The search also uses the value at the start of
        # the previous step: a parabola through it and both ends of this step gives the first guess
        # of the peak. A rejected attempt has the length zero; its tally is computed too, and
        # discarded.
        length = now.time - tally.end.x
        position = (tally.start.x - tally.end.x) / jnp.where(length > 0.0, length, 1.0)
        before = Point(position, tally.start.value)
        # The value may jump at the end of this step: the next step begins with the one after it.
        value_before, value = now.before_and_after(self._value)
        start, end = Point(0.0, tally.end.value), Point(1.0, value_before)
        # The quantity is evaluated at several instants, but traced only once.
        value_of = traced_once(self._value)
        # The part of the step that is in the window.
        first, last, window = start, end, self._window(now)
        if not window.is_whole:
            a, b = window.fractions(tally.end.x, now.time)
            first = Point(a, jnp.where(a > 0.0, value_of(now.inside(a)), start.value))
            last = Point(b, jnp.where(b < 1.0, value_of(now.inside(b)), end.value))
        # The search is made even if no part of the step is in the window, because runs that
        # compiled code computes side by side cannot branch. The peak is then not used.
        peak = highest_after(lambda x: value_of(now.inside(x)), before, first, last)
        rises = peak.value > tally.highest.value
        if not window.is_whole:
            rises = rises & (last.x > first.x)
        # From here on, positions are times.
        peak = Point(tally.end.x + peak.x * length, peak.value)
        highest = jax.tree.map(partial(where, rises), peak, tally.highest)
        return PeakTally(highest, Point(now.time, value), tally.end)

    @override
    def results(self, tally: PeakTally, now: Instant) -> dict[str, Scalar]:
        results = {"": tally.highest.value, "time": tally.highest.x}
        if self._window(now).is_whole:
            return results
        # The value is minus infinity as long as no part of the window has been reached.
        reached = tally.highest.value > -jnp.inf
        return {name: jnp.where(reached, value, jnp.nan) for name, value in results.items()}

    @override
    def units(self) -> dict[str, str]:
        return {"": self.unit, "time": "s"}


class IntegralTally(NamedTuple):
    """Tally of integrals: the latest time, s, and the value there; the duration inside the window,
    s, and, over this duration, the integrals `first` of the value and `second` of its square."""

    time: Scalar
    value: Scalar
    duration: Scalar
    first: Scalar
    second: Scalar


class AbstractIntegralReduction(AbstractQuantityReduction):
    """Base class of reductions of integrals of a quantity, which in each step is approximated by
    the parabola through its values at both ends and in the middle of the step."""

    @override
    def start(self, now: Instant) -> PyTree:
        value = self._value(now)
        zero = jnp.zeros_like(value)
        return IntegralTally(now.time, value, zero, zero, zero)

    def _updated(
        self, tally: IntegralTally, now: Instant
    ) -> tuple[IntegralTally, Parabola, Scalar, Scalar]:
        """Return the tally after the step that ends at `now`; the parabola of the quantity in this
        step, with x from 0 to 1; and the two x between which the step is in the window."""
        t0, t1, (end, value) = tally.time, now.time, now.before_and_after(self._value)
        # The parabola's variable is 0 at t0 and 1 at t1. A rejected attempt has t1 = t0; its tally
        # is computed too, and discarded.
        arc = Parabola.through(tally.value, self._value(now.middle), end)
        length = jnp.where(t1 > t0, t1 - t0, 1.0)
        a, b = self._window(now).fractions(t0, t1)
        h = jnp.where(b > a, (b - a) * length, 0.0)
        # Three Gauss nodes integrate the parabola and its square, of degree 4, exactly. They are
        # moved from the interval -1 to 1 to the interval a to b.
        values = [arc.at(0.5 * (a + b) + 0.5 * node * (b - a)) for node in GAUSS_NODES]
        pairs = list(zip(GAUSS_WEIGHTS, values, strict=True))
        first = tally.first + h * sum(weight * v for weight, v in pairs)
        second = tally.second + h * sum(weight * v * v for weight, v in pairs)
        return IntegralTally(t1, value, tally.duration + h, first, second), arc, a, b


class Integral(AbstractIntegralReduction):
    """Integral of a quantity over a window of time.

    In each step the quantity is approximated by the parabola through both ends and the middle. A
    `clearjoint.predictor` instead integrates the quantity together with the motion.

    **Arguments:** `quantity`: function of an `Instant` that returns a scalar; `unit`: the unit of
    the integral; `after`, `until`: s, the window of time, by default the whole run; see `Peak`.

    >>> sway = cj.quantities.Position("arm", "y")
    >>> cost = cj.Integral(lambda now: sway(now) ** 2, "m^2 s", after=0.1)
    >>> cost.units()
    {'': 'm^2 s'}
    """

    differentiated = ("",)

    @override
    def integrands(self) -> tuple[Quantity, ...]:
        return (self.quantity,)

    @override
    def combined(self, values: jax.Array, instants: tuple[float, ...]) -> dict[str, Scalar]:
        return {"": values[1, 0] - values[0, 0]}

    @override
    def update(self, tally: IntegralTally, now: Instant) -> IntegralTally:
        return self._updated(tally, now)[0]

    @override
    def results(self, tally: IntegralTally, now: Instant) -> dict[str, Scalar]:
        del now
        return {"": jnp.where(tally.duration > 0.0, tally.first, jnp.nan)}

    @override
    def units(self) -> dict[str, str]:
        return {"": self.unit}


class _Square(eqx.Module):
    # The square of a quantity. Programs are kept by their quantities, so two squares of the same
    # quantity must be equal, as two functions made by `lambda` are not.
    quantity: Quantity = eqx.field(static=True)

    def __call__(self, now: Instant) -> Scalar:
        return jnp.square(number_at(now, self.quantity))


StatisticsTally: TypeAlias = tuple[IntegralTally, tuple[Scalar, Scalar]]
"""Tally of `Statistics`: integrals, and the smallest and the largest value."""


class Statistics(AbstractIntegralReduction):
    """Mean, root mean square, smallest and largest value of a quantity over a window of time.

    The results are named "mean", "rms", "smallest" and "largest", all in the unit of the quantity.
    In each step the quantity is approximated by the parabola through both ends and the middle. A
    `clearjoint.predictor`, which has only "mean" and "rms", integrates them with the motion. Both
    ways are inexact for an angle that jumps at half a revolution: take the sine of the angle.

    **Arguments:** `quantity`: function of an `Instant` that returns a scalar; `unit`: its unit;
    `after`, `until`: s, the window of time, by default the whole run; see `Peak`.

    >>> speed = cj.Statistics(cj.quantities.Velocity("arm 2"), "m/s", after=0.1)
    >>> list(speed.units())
    ['mean', 'rms', 'smallest', 'largest']
    """

    differentiated = ("mean", "rms")

    @override
    def integrands(self) -> tuple[Quantity, ...]:
        return self.quantity, _Square(self.quantity)

    @override
    def combined(self, values: jax.Array, instants: tuple[float, ...]) -> dict[str, Scalar]:
        mean, square = (values[1] - values[0]) / (instants[1] - instants[0])
        # The root mean square of a quantity that vanishes has no derivative: zero is taken.
        positive = jnp.where(square > 0.0, square, 1.0)
        return {"mean": mean, "rms": jnp.where(square > 0.0, jnp.sqrt(positive), 0.0)}

    @override
    def start(self, now: Instant) -> StatisticsTally:
        integrals: IntegralTally = super().start(now)
        infinite = jnp.full_like(integrals.value, jnp.inf)
        return integrals, (infinite, -infinite)

    @override
    def update(self, tally: StatisticsTally, now: Instant) -> StatisticsTally:
        integrals, (smallest, largest) = tally
        integrals, arc, a, b = self._updated(integrals, now)
        inside, (low, high) = b > a, arc.extremes(a, b)
        period = getattr(self.quantity, "period", None)
        # In a step in which an angle jumps, the parabola goes beyond both ends of the jump.
        if period is not None:
            low, high = (jnp.clip(value, -0.5 * period, 0.5 * period) for value in (low, high))
        smallest = jnp.where(inside, jnp.minimum(smallest, low), smallest)
        largest = jnp.where(inside, jnp.maximum(largest, high), largest)
        return integrals, (smallest, largest)

    @override
    def results(self, tally: StatisticsTally, now: Instant) -> dict[str, Scalar]:
        del now
        integrals, (smallest, largest) = tally
        reached = integrals.duration > 0.0
        length = jnp.where(reached, integrals.duration, jnp.nan)
        return {
            "mean": integrals.first / length,
            "rms": jnp.sqrt(integrals.second / length),
            "smallest": jnp.where(reached, smallest, jnp.nan),
            "largest": jnp.where(reached, largest, jnp.nan),
        }

    @override
    def units(self) -> dict[str, str]:
        return dict.fromkeys(("mean", "rms", "smallest", "largest"), self.unit)


QuantilesTally: TypeAlias = tuple[tuple[Scalar, Scalar], Scalar, jax.Array]
"""Tally of `Quantiles`: (latest time, s, and the value there); the duration inside the window, s;
and, for each of the K edges, for how long in this duration the quantity was below it, (K,) s."""


class Quantiles(AbstractQuantityReduction):
    """Quantiles of a quantity over time: values below which it stays for given parts of the time.

    Each result is named after its level in six significant digits, such as "0.5" for the median.
    The time for which the quantity is below each of the `edges` is added up. A quantile is
    interpolated between the two edges that enclose it, with an error less than their distance;
    below the first edge or above the last one it is NaN. In each step the quantity is approximated
    by the parabola through both ends and the middle.

    For quantiles over impacts instead of over time, use `ImpactTable`: they are exact.

    ```python
    import clearjoint as cj
    import numpy as np

    edges = [0.0, *np.geomspace(1.0, 1e5, 200)]  # N: error of 6 % at most above 1 N
    force = cj.quantities.ContactForce("shoulder")
    outputs = {"force": cj.Quantiles(force, "N", edges, levels=(0.5, 0.99), after=0.5)}
    ```

    **Arguments:**

    - `quantity`: function of an `Instant` that returns a scalar; `unit`: its unit.
    - `edges`: (K,) increasing values in `unit`, K at least 2. A step's cost grows with K.
    - `levels`: parts of the time, above 0 and below 1, for which the quantity is below a quantile.
    - `after`, `until`: s, the window of time, by default the whole run; see `Peak`.

    **Raises:** `ValueError` for edges that are not finite, do not increase, or are fewer than two;
    and if there is no level, one outside of this range, or two equal in six digits.
    """

    edges: tuple[float, ...] = eqx.field(static=True, converter=numbers)
    levels: tuple[float, ...] = eqx.field(static=True, converter=numbers, default=(0.5, 0.95))

    @override
    def __check_init__(self):
        edges, remedy = np.asarray(self.edges), "sort them, two at least, none of them twice"
        require_finite("edges", edges)
        rising = len(edges) > 1 and bool((np.diff(edges) > 0).all())
        require(rising, "edges", self.edges, "rising", remedy)
        levels = np.asarray(as_number(self.levels))
        parts = len(levels) > 0 and bool(((levels > 0) & (levels < 1)).all())
        require(parts, "levels", self.levels, "above 0 and below 1", "give 0.95 for 95 %")
        # The results are named after the levels, so that equal ones would hide each other.
        distinct = len(self.units()) == len(levels)
        require(distinct, "levels", self.levels, "different in six digits", "remove repeated ones")

    @override
    def start(self, now: Instant) -> QuantilesTally:
        return (now.time, self._value(now)), jnp.zeros(()), jnp.zeros(len(self.edges))

    @override
    def update(self, tally: QuantilesTally, now: Instant) -> QuantilesTally:
        (before, value), duration, below = tally
        (end, latest), length = now.before_and_after(self._value), now.time - before
        arc = Parabola.through(value, self._value(now.middle), end)
        a, b = self._window(now).fractions(before, now.time)
        inside = jnp.where(b > a, length, 0.0)
        # `inside` is the length of the whole step, or zero if no part of it is in the window. For
        # each edge, `part_below` returns the fraction of the step that is between a and b and in
        # which the quantity is below the edge.
        added = inside * arc.part_below(jnp.asarray(self.edges), a, b)
        return (now.time, latest), duration + inside * (b - a), below + added

    @override
    def results(self, tally: QuantilesTally, now: Instant) -> dict[str, Scalar]:
        del now
        _, duration, below = tally
        edges, last = jnp.asarray(self.edges), len(self.edges) - 1
        quantiles = {}
        for level in self.levels:
            target = level * duration
            # k edges are below the quantile. It is interpolated between edge k - 1 and edge k; k is
            # clipped so that both exist, and the result is replaced by NaN if the clip was needed.
            k = jnp.sum(below < target)
            above = jnp.clip(k, 1, last)
            low, high = below[above - 1], below[above]
            # The quantile's position between the two edges, 0 to 1, by linear interpolation.
            part = (target - low) / jnp.where(high > low, high - low, 1.0)
            value = edges[above - 1] + part * (edges[above] - edges[above - 1])
            enclosed = (k >= 1) & (k <= last)
            quantiles[f"{level:g}"] = jnp.where(enclosed, value, jnp.nan)
        return quantiles

    @override
    def units(self) -> dict[str, str]:
        return {f"{level:g}": self.unit for level in self.levels}
