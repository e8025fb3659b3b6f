"""Reductions: outputs of a run that are updated at every accepted step.

Subclass `AbstractReduction` for reductions of your own. A reduction carries a tally, a PyTree of
arrays of fixed shape, from step to step; memory does not grow with the number of steps.
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
    """Base class of outputs that are updated at every accepted step of a run.

    A subclass defines `start`, `update`, `results` and `units`, which JAX traces. If it reads the
    integrals `Instant.work`, it sets `needs_ledger = True`. The example adds up the time in s
    during which a contact force exceeds a limit; its tally is the latest time and the sum:

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

        The default checks all fields that are quantities; a subclass may check more.

        **Raises:** `ValueError` that lists the known names.
        """
        for name, value in vars(self).items():
            check_quantity(name, value, scene)

    @abc.abstractmethod
    def start(self, now: Instant) -> PyTree:
        """Return the tally at the start of the run; `update` must return the same structure."""

    @abc.abstractmethod
    def update(self, tally: PyTree, now: Instant) -> PyTree:
        """Return the tally after an accepted step.

        **Arguments:** `tally`: that at the start of the step; `now`: the instant at the end of the
        step, with `now.inside(x)` at the fraction x, 0 to 1, of its time.
        """

    @abc.abstractmethod
    def results(self, tally: PyTree, now: Instant) -> dict[str, Scalar]:
        """Return the results at the end of the run, by name.

        The result "" has the output's own name. The other names are appended to the output's name
        after an underscore: "time" of the output "force" becomes "force_time".
        """

    @abc.abstractmethod
    def units(self) -> dict[str, str]:
        """Return the unit of each result, with the keys of the dict from `results`."""


def check_reductions(outputs: Mapping[str, object], scene: Scene, ledger: bool) -> None:
    """Check the reductions among `outputs`; other outputs are ignored.

    **Arguments:** `outputs`: outputs by name; `ledger`: whether the run integrates the energy
    ledger.

    **Raises:** `ValueError` that names the output, if the scene lacks an element that the reduction
    names, or if the reduction needs the ledger and the run has none.
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
    """Base class of reductions over a window of time.

    **Arguments:** `after`, `until`: s, start and end of the window; ``None`` for those of the run.

    **Raises:** `ValueError` for a window that does not end after its start.
    """

    after: Instants = eqx.field(default=None, static=True, converter=optional_time, kw_only=True)
    until: Instants = eqx.field(default=None, static=True, converter=optional_time, kw_only=True)

    def __check_init__(self):
        self._window()  # which checks the times

    def _window(self) -> Window:
        return Window(self.after, self.until)


class PeakTally(NamedTuple):
    """State of `Peak` after an accepted step.

    - `highest`, `time`: the highest value so far, and its time, s.
    - `last`, `now`: the value at the latest instant, and the time of that instant, s.
    - `last_before`, `before`: the same at the instant one step earlier.
    """

    highest: Scalar
    time: Scalar
    last: Scalar
    now: Scalar
    last_before: Scalar
    before: Scalar


class Peak(AbstractWindowedReduction):
    """Largest value of a quantity in a run, with the time at which it occurs.

    The results are named "" (the value) and "time" (s). The peak may lie between the ends of a
    step: it is searched in the solver's dense output. At usual tolerances the peak of a contact
    force agrees with that of the table of impacts to 1e-6 of its value.

    ```python
    import clearjoint as cj

    force = cj.quantities.ContactForce("shoulder")
    outputs = {"force": cj.Peak(force, "N", after=0.5)}  # "force", and "force_time" in s
    ```

    **Arguments:**

    - `quantity`: function of an `Instant` that returns a scalar; `unit`: its unit.
    - `after`, `until`: s, the window of time, by default the whole run. If a step crosses an edge
      of the window, only its part inside counts. Both results are NaN if the run ended before the
      window.

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
        """Return the tally at the start of the run. If the start is outside of the window, the
        highest value is minus infinity."""
        value, window = self._value(now), self._window()
        highest = value
        if not window.is_whole:
            highest = jnp.where(window.holds(now.time), value, -jnp.inf)
        return PeakTally(highest, now.time, value, now.time, value, now.time)

    def update(self, tally: PeakTally, now: Instant) -> PeakTally:
        """Return the tally with the largest value of the part of the step that is in the window."""
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
        """Return the largest value, "", and its time, "time", s; NaN if the run ended before the
        window."""
        del now
        if self._window().is_whole:
            return {"": tally.highest, "time": tally.time}
        reached = tally.highest > -jnp.inf
        results = {"": tally.highest, "time": tally.time}
        return {name: jnp.where(reached, value, jnp.nan) for name, value in results.items()}

    def units(self) -> dict[str, str]:
        """Return the unit of the quantity for "", and "s" for "time"."""
        return {"": self.unit, "time": "s"}


_GAUSS_NODES = (-math.sqrt(0.6), 0.0, math.sqrt(0.6))
_GAUSS_WEIGHTS = (5 / 18, 8 / 18, 5 / 18)


Triplet = tuple[Scalar, Scalar, Scalar]
StatisticsTally = tuple[tuple[Scalar, Scalar], Triplet, tuple[Scalar, Scalar]]
"""State of `Statistics`: (latest time, s, and the value there), (duration inside the window, s, and
the integrals over it of the value and of its square), (smallest and largest value)."""


class Statistics(AbstractWindowedReduction):
    """Mean, root mean square, smallest and largest value of a quantity over a window of time.

    The results are named "mean", "rms", "smallest" and "largest", all in the unit of the quantity.
    In each step the quantity is approximated by the parabola through both ends and the middle.

    **Arguments:**

    - `quantity`: function of an `Instant` that returns a scalar; `unit`: its unit.
    - `after`, `until`: s, the window of time, by default the whole run. All results are NaN if the
      run ended before the window.

    **Raises:** `ValueError` for a window that does not end after its start.

    >>> speed = cj.Statistics(cj.quantities.Velocity("arm 2"), "m/s", after=0.1)
    >>> list(speed.units())
    ['mean', 'rms', 'smallest', 'largest']
    """

    quantity: Quantity = eqx.field(static=True)
    unit: str = eqx.field(static=True)

    def __check_init__(self):
        require_quantity("quantity", self.quantity)

    def start(self, now: Instant) -> StatisticsTally:
        """Return the tally at the start of the run: integrals of zero and infinite extremes, since
        the first step includes its start."""
        value = jnp.asarray(self.quantity(now), dtype=float)
        zero, infinite = jnp.zeros_like(value), jnp.full_like(value, jnp.inf)
        return (now.time, value), (zero, zero, zero), (infinite, -infinite)

    def update(self, tally: StatisticsTally, now: Instant) -> StatisticsTally:
        """Return the tally with the part of the step that is in the window added."""
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
        """Return "mean", "rms", "smallest" and "largest"; NaN if the run ended before the
        window."""
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
        """Return the unit of the quantity for each of the four results."""
        return dict.fromkeys(("mean", "rms", "smallest", "largest"), self.unit)
