"""What a lane of a sweep keeps of its run: reductions, updated at every accepted step.

A reduction of one's own subclasses `AbstractReduction`. Its tally is a PyTree of scalars, so that
memory does not grow with the steps.
"""

import abc
import math
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import PyTree

from ...compilation import traced_once
from ...fields.checks import require
from ...fields.conversion import AbstractConverting
from ...math.interpolation import Parabola, Point, highest_after
from ...math.vectors import Condition, Scalar, add
from ...model.scene import Scene
from ...quantities.base import Quantity, check_quantity, require_known, require_quantity
from ...quantities.instant import Instant

LOSSES = ("normal damping", "friction", "film")
"""Of the energy ledger, what joints take."""


class AbstractReduction(AbstractConverting):
    """Something that is gathered along a run. One that reads `Instant.work` sets `needs_ledger`.

    ```python
    import clearjoint as cj
    import jax.numpy as jnp

    class TimeAbove(cj.AbstractReduction):
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
        """Check that a scene has what the reduction names: what its quantities do, unless a
        subclass tells more.

        **Raises:** `ValueError` that lists what there is.
        """
        for name, value in vars(self).items():
            check_quantity(name, value, scene)

    @abc.abstractmethod
    def start(self, now: Instant) -> PyTree:
        """What is remembered from step to step, at the start of the run."""

    @abc.abstractmethod
    def update(self, tally: PyTree, now: Instant) -> PyTree:
        """The tally after an accepted step that ends now."""

    @abc.abstractmethod
    def results(self, tally: PyTree, now: Instant) -> dict[str, Scalar]:
        """What is reported at the end, by name; the name "" stands for the reduction's own."""

    @abc.abstractmethod
    def units(self) -> dict[str, str]:
        """Unit of each result, by the names that `results` has."""


class PeakTally(NamedTuple):
    """The highest value so far and its time, s; the value at the latest instant and that, s; both
    at the instant before."""

    highest: Scalar
    time: Scalar
    last: Scalar
    now: Scalar
    last_before: Scalar
    before: Scalar


class Peak(AbstractReduction):
    """Largest value of a quantity, and when: "" and "time".

    Within a step it is the largest value along the solver's dense output. Of a contact force at
    usual tolerances it is then that of the table of impacts to 1e-6.

    **Arguments:** `quantity`: a scalar function of an `Instant`; `unit`: its unit.
    """

    quantity: Quantity = eqx.field(static=True)
    unit: str = eqx.field(static=True)

    def __check_init__(self):
        require_quantity("quantity", self.quantity)

    def start(self, now: Instant) -> PeakTally:
        """The value at the start, the highest so far."""
        value = self._value(now)
        return PeakTally(value, now.time, value, now.time, value, now.time)

    def update(self, tally: PeakTally, now: Instant) -> PeakTally:
        """The highest value of the step, if it is higher than those before."""
        length = now.time - tally.now
        earlier = (tally.before - tally.now) / jnp.where(length > 0.0, length, 1.0)
        before, start = Point(earlier, tally.last_before), Point(0.0, tally.last)
        end = Point(1.0, self._value(now))
        value_of = traced_once(self._value)
        peak = highest_after(lambda x: value_of(now.inside(x)), before, start, end)
        time = tally.now + peak.place * length
        rises = peak.value > tally.highest
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
        """The largest value and its time, s."""
        del now
        return {"": tally.highest, "time": tally.time}

    def units(self) -> dict[str, str]:
        """The quantity's unit for the peak, and s for its time."""
        return {"": self.unit, "time": "s"}


_GAUSS_NODES = (-math.sqrt(0.6), 0.0, math.sqrt(0.6))
_GAUSS_WEIGHTS = (5 / 18, 8 / 18, 5 / 18)


Triplet = tuple[Scalar, Scalar, Scalar]
StatisticsTally = tuple[tuple[Scalar, Scalar], Triplet, tuple[Scalar, Scalar]]
"""The latest instant, s, and the value there; the duration inside the window, s, and the integrals
of the value and its square; the smallest and the largest value."""


class Statistics(AbstractReduction):
    """ "mean", "rms", "smallest" and "largest" value of a quantity over a window of time.

    In each step the quantity is that of the parabola through both ends and the middle.

    **Arguments:** `quantity` and `unit` as for `Peak`; `start_time`, `end_time`: s, the window;
    from the start to the end of the run unless given.
    """

    quantity: Quantity = eqx.field(static=True)
    unit: str = eqx.field(static=True)
    start_time: float = eqx.field(default=-float("inf"), static=True)
    end_time: float = eqx.field(default=float("inf"), static=True)

    def __check_init__(self):
        require_quantity("quantity", self.quantity)
        require(
            self.end_time > self.start_time,
            "end_time",
            self.end_time,
            f"after start_time = {self.start_time}",
            "give the window in s",
        )

    def start(self, now: Instant) -> StatisticsTally:
        """The instant and the value there, zero duration and integrals, and the extremes so far."""
        value = jnp.asarray(self.quantity(now), dtype=float)
        zero = jnp.zeros_like(value)
        inside = (now.time >= self.start_time) & (now.time <= self.end_time)
        extremes = jnp.where(inside, value, jnp.inf), jnp.where(inside, value, -jnp.inf)
        return (now.time, value), (zero, zero, zero), extremes

    def update(self, tally: StatisticsTally, now: Instant) -> StatisticsTally:
        """The tally with the part of the step added that is inside the window."""
        (t0, u), (duration, first, second), (smallest, largest) = tally
        t1, v = now.time, jnp.asarray(self.quantity(now), dtype=float)
        arc = Parabola.through(u, jnp.asarray(self.quantity(now.middle), dtype=float), v)
        length = jnp.where(t1 > t0, t1 - t0, 1.0)
        a = jnp.clip((self.start_time - t0) / length, 0.0, 1.0)
        b = jnp.clip((self.end_time - t0) / length, 0.0, 1.0)
        inside = b > a
        h = jnp.where(inside, (b - a) * length, 0.0)
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
        """The four statistics; NaN if the run ended before the window."""
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
        """The quantity's unit for each of the four."""
        return dict.fromkeys(("mean", "rms", "smallest", "largest"), self.unit)


CountTally = tuple[Scalar, dict[str, Condition]]
"""How many contacts have begun, and which touch."""


class ImpactCount(AbstractReduction):
    """Number of contacts that began, of all contacts of a joint.

    **Arguments:** `joint`: its name.
    """

    joint: str = eqx.field(static=True)

    def check(self, scene: Scene) -> None:
        """Check that the scene has the joint, and that it has contacts."""
        require_known("joint", self.joint, scene.contact_joints())

    def _touching(self, now: Instant) -> dict[str, Condition]:
        return {label: reach.depth > 0.0 for label, reach in now.reaches[self.joint].items()}

    def start(self, now: Instant) -> CountTally:
        """No contact has begun; and which touch at the start."""
        return jnp.zeros(()), self._touching(now)

    def update(self, tally: CountTally, now: Instant) -> CountTally:
        """One more for each contact that did not touch before."""
        count, before = tally
        after = self._touching(now)
        for label, touches in after.items():
            count = count + jnp.where(touches & ~before[label], 1.0, 0.0)
        return count, after

    def results(self, tally: CountTally, now: Instant) -> dict[str, Scalar]:
        """The number of contacts that began, up to the end of the run."""
        del now
        return {"": tally[0]}

    def units(self) -> dict[str, str]:
        """The count is a number without unit."""
        return {"": "1"}


class DissipatedEnergy(AbstractReduction):
    """Energy that normal damping, friction and films took; for `Settings(ledger=True)`."""

    needs_ledger = True

    def start(self, now: Instant) -> tuple[()]:
        """Nothing is remembered, since the ledger is integrated with the state."""
        del now
        return ()

    def update(self, tally: tuple[()], now: Instant) -> tuple[()]:
        """Still nothing is remembered."""
        del now
        return tally

    def results(self, tally: tuple[()], now: Instant) -> dict[str, Scalar]:
        """What normal damping, friction and films took since the start, J; what bristles
        would give back is not among it."""
        del tally
        lost: Scalar = 0.0
        for name in LOSSES:
            lost = add(lost, now.work.get(name, 0.0))
        if (held := now.bristle_energy) is not None:
            lost = lost - held
        return {"": lost}

    def units(self) -> dict[str, str]:
        """The energy is in J."""
        return {"": "J"}
