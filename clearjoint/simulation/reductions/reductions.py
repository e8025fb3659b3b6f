"""Reductions: results that are accumulated during a run, at every accepted step.

User-defined reductions subclass `AbstractReduction`. The tally of a reduction is a PyTree of
scalars, so memory does not grow with the number of steps.
"""

import abc
import math
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import PyTree

from ...compilation import traced_once
from ...fields.checks import require
from ...fields.conversion import AbstractConverting
from ...math.interpolation import Parabola, Point, highest_after
from ...math.vectors import Scalar
from ...model.scene import Scene
from ...quantities.base import Quantity, check_quantity, require_quantity
from ...quantities.instant import Instant
from .windows import Instants, Window, optional_time


class AbstractReduction(AbstractConverting):
    """Base class of results that are accumulated during a run.

    A subclass that reads `Instant.work` sets `needs_ledger = True`.

    ```python
    import clearjoint as cj
    import jax.numpy as jnp

    class TimeAbove(cj.extend.AbstractReduction):
        joint: str
        force: float  # N

        def start(self, now):
            return now.time, jnp.zeros(())

        def update(self, tally, now):
            before, above = tally
            largest = cj.quantities.ContactForce(self.joint)(now)
            step = now.time - before
            return now.time, above + jnp.where(largest > self.force, step, 0.0)

        def results(self, tally, now):
            return {"": tally[1]}

        def units(self):
            return {"": "s"}

    outputs = {"overload": TimeAbove("shoulder", force=500.0)}
    ```
    """

    needs_ledger: ClassVar[bool] = False

    def check(self, scene: Scene) -> None:
        """Check that a scene has the elements that the reduction names.

        By default the fields that are quantities are checked; a subclass may check more.

        **Raises:** `ValueError` that lists the known names.
        """
        for name, value in vars(self).items():
            check_quantity(name, value, scene)

    @abc.abstractmethod
    def start(self, now: Instant) -> PyTree:
        """Return the tally, the data carried from step to step, at the start of the run."""

    @abc.abstractmethod
    def update(self, tally: PyTree, now: Instant) -> PyTree:
        """Return the tally after an accepted step that ends now."""

    @abc.abstractmethod
    def results(self, tally: PyTree, now: Instant) -> dict[str, Scalar]:
        """Return the results at the end of the run by name; "" is the output's own name."""

    @abc.abstractmethod
    def units(self) -> dict[str, str]:
        """Return the unit of each result, by the names in `results`."""


def check_reductions(outputs: Mapping[str, object], scene: Scene, ledger: bool) -> None:
    """Check the reductions among some outputs: that the scene has the elements they name, and that
    the run integrates the energy `ledger` if one needs it.

    **Raises:** `ValueError` that names the output.
    """
    for name, output in outputs.items():
        if not isinstance(output, AbstractReduction):
            continue
        expected = f"True for outputs[{name!r}]"
        fine = ledger or not output.needs_ledger
        require(fine, "ledger", ledger, expected, "pass Settings(ledger=True)")
        try:
            output.check(scene)
        except ValueError as error:
            raise ValueError(f"Output {name!r}: {error}") from error


class AbstractWindowedReduction(AbstractReduction):
    """Base class of reductions over a window of time, from `after` to `until`, s."""

    after: Instants = eqx.field(default=None, static=True, converter=optional_time, kw_only=True)
    until: Instants = eqx.field(default=None, static=True, converter=optional_time, kw_only=True)

    def __check_init__(self):
        self._window()  # which checks the times

    def _window(self) -> Window:
        return Window(self.after, self.until)


class PeakTally(NamedTuple):
    """The highest value so far and its time, s; the value at the latest instant `now`, s; and the
    value at the instant `before` it, s."""

    highest: Scalar
    time: Scalar
    last: Scalar
    now: Scalar
    last_before: Scalar
    before: Scalar


class Peak(AbstractWindowedReduction):
    """Largest value of a quantity, "", and its time, "time".

    Values inside steps are included, by the solver's dense output. At usual tolerances the peak of
    a contact force agrees with that of the table of impacts to 1e-6.

    ```python
    import clearjoint as cj

    force = cj.quantities.ContactForce("shoulder")
    outputs = {"force": cj.Peak(force, "N", after=0.5)}  # "force", and "force_time" in s
    ```

    **Arguments:**

    - `quantity`: a scalar function of an `Instant`; `unit`: its unit.
    - `after`, `until`: s, the window of time, by default the whole run. Of a step across its edge
      the part inside counts. Both results are NaN for a run that ended before it.

    **Raises:** `ValueError` for a window that does not end after its start.

    >>> peak = cj.Peak(cj.quantities.ContactForce("shoulder"), "N")
    >>> peak.units()
    {'': 'N', 'time': 's'}
    """

    quantity: Quantity = eqx.field(static=True)
    unit: str = eqx.field(static=True)

    def __check_init__(self):
        require_quantity("quantity", self.quantity)

    def start(self, now: Instant) -> PeakTally:
        """Return the tally at the start of the run.

        The highest value is that at the start, or minus infinity if the start is outside the
        window.
        """
        value, window = self._value(now), self._window()
        highest = value
        if not window.is_whole:
            highest = jnp.where(window.holds(now.time), value, -jnp.inf)
        return PeakTally(highest, now.time, value, now.time, value, now.time)

    def update(self, tally: PeakTally, now: Instant) -> PeakTally:
        """Return the tally with the highest value in the part of the step inside the window."""
        # The search takes the value at the start of the previous step too: a parabola through it
        # and both ends of this step gives the first guess of the peak.
        length = now.time - tally.now
        earlier = (tally.before - tally.now) / jnp.where(length > 0.0, length, 1.0)
        before, start = Point(earlier, tally.last_before), Point(0.0, tally.last)
        end = Point(1.0, self._value(now))
        value_of = traced_once(self._value)
        first, last, window = start, end, self._window()
        if not window.is_whole:
            a, b = window.fractions(tally.now, now.time)
            first = Point(a, jnp.where(a > 0.0, value_of(now.inside(a)), start.value))
            last = Point(b, jnp.where(b < 1.0, value_of(now.inside(b)), end.value))
        peak = highest_after(lambda x: value_of(now.inside(x)), before, first, last)
        time = tally.now + peak.x * length
        rises = peak.value > tally.highest
        if not window.is_whole:
            rises = rises & (last.x > first.x)
        return PeakTally(
            jnp.where(rises, peak.value, tally.highest),
            jnp.where(rises, time, tally.time),
            end.value,
            now.time,
            start.value,
            tally.now,
        )

    def _value(self, now: Instant) -> Scalar:
        return jnp.asarray(self.quantity(now), dtype=float)

    def results(self, tally: PeakTally, now: Instant) -> dict[str, Scalar]:
        """Return the largest value, in the quantity's unit, and its time, s.

        Both are NaN if the run ended before the window.
        """
        del now
        if self._window().is_whole:
            return {"": tally.highest, "time": tally.time}
        reached = tally.highest > -jnp.inf
        results = {"": tally.highest, "time": tally.time}
        return {name: jnp.where(reached, value, jnp.nan) for name, value in results.items()}

    def units(self) -> dict[str, str]:
        """Return the quantity's unit for the largest value, and "s" for its time."""
        return {"": self.unit, "time": "s"}


_GAUSS_NODES = (-math.sqrt(0.6), 0.0, math.sqrt(0.6))
_GAUSS_WEIGHTS = (5 / 18, 8 / 18, 5 / 18)


Triplet = tuple[Scalar, Scalar, Scalar]
StatisticsTally = tuple[tuple[Scalar, Scalar], Triplet, tuple[Scalar, Scalar]]
"""The latest instant, s, and the value there; the duration inside the window, s, and the integrals
of the value and its square; the smallest and the largest value."""


class Statistics(AbstractWindowedReduction):
    """ "mean", "rms", "smallest" and "largest" value of a quantity over a window of time.

    In each step the quantity is approximated by the parabola through both ends and the middle.

    **Arguments:** `quantity`, `unit`, `after` and `until` as for `Peak`.

    **Raises:** `ValueError` as `Peak`.

    >>> speed = cj.Statistics(cj.quantities.Velocity("arm 2"), "m/s", after=0.1)
    >>> list(speed.units())
    ['mean', 'rms', 'smallest', 'largest']
    """

    quantity: Quantity = eqx.field(static=True)
    unit: str = eqx.field(static=True)

    def __check_init__(self):
        require_quantity("quantity", self.quantity)

    def start(self, now: Instant) -> StatisticsTally:
        """Return the tally at the start of the run.

        The integrals are zero. Both extremes are the first value; if the start is outside the
        window, the smallest value is infinite and the largest is minus infinity.
        """
        value = jnp.asarray(self.quantity(now), dtype=float)
        zero = jnp.zeros_like(value)
        window = self._window()
        inside = (now.time >= window.start) & (now.time <= window.end)
        extremes = jnp.where(inside, value, jnp.inf), jnp.where(inside, value, -jnp.inf)
        return (now.time, value), (zero, zero, zero), extremes

    def update(self, tally: StatisticsTally, now: Instant) -> StatisticsTally:
        """Return the tally with the part of the step that is inside the window."""
        (t0, u), (duration, first, second), (smallest, largest) = tally
        t1, v = now.time, jnp.asarray(self.quantity(now), dtype=float)
        arc = Parabola.through(u, jnp.asarray(self.quantity(now.middle), dtype=float), v)
        length = jnp.where(t1 > t0, t1 - t0, 1.0)
        a, b = self._window().fractions(t0, t1)
        inside = b > a
        h = jnp.where(inside, (b - a) * length, 0.0)
        # Three Gauss nodes integrate the parabola and its square exactly.
        values = [arc.at(0.5 * (a + b) + 0.5 * node * (b - a)) for node in _GAUSS_NODES]
        pairs = list(zip(_GAUSS_WEIGHTS, values, strict=True))
        sums = (
            duration + h,
            first + h * sum(weight * value for weight, value in pairs),
            second + h * sum(weight * value * value for weight, value in pairs),
        )
        low, high = arc.extremes(a, b)
        smallest = jnp.where(inside, jnp.minimum(smallest, low), smallest)
        largest = jnp.where(inside, jnp.maximum(largest, high), largest)
        return (t1, v), sums, (smallest, largest)

    def results(self, tally: StatisticsTally, now: Instant) -> dict[str, Scalar]:
        """Return mean, rms, smallest and largest value by name, in the quantity's unit.

        They are NaN if the run ended before the window.
        """
        del now
        _, (duration, first, second), (smallest, largest) = tally
        reached = duration > 0.0
        length = jnp.where(reached, duration, jnp.nan)
        return {
            "mean": first / length,
            "rms": jnp.sqrt(second / length),
            "smallest": jnp.where(reached, smallest, jnp.nan),
            "largest": jnp.where(reached, largest, jnp.nan),
        }

    def units(self) -> dict[str, str]:
        """Return the quantity's unit for the mean, the rms, the smallest and the largest value."""
        return dict.fromkeys(("mean", "rms", "smallest", "largest"), self.unit)
