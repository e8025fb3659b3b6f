"""Poincaré sections: values of quantities (channels) at the instants at which another quantity
rises through zero (crossings).

Single runs and runs with derivatives compute the channels at each crossing. Lanes cannot branch one
by one, so they record the state at each crossing, and the channels are computed after the run.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import equinox as eqx
import jax
import jax.numpy as jnp
from typing_extensions import override

from ..._fields.checks import require, require_array_names, require_count, require_shape
from ..._fields.objects import on_device
from ..._math.interpolation import Parabola, Point, secant_root
from ..._math.vectors import Scalar
from ..._model.scene import Scene
from ...quantities.base import Instant, Quantity, check_quantity, number_at, require_quantity
from ..results.solution import TIME
from ..step.dense_output import Snapshot
from ..step.landing import LATEST
from ..step.step_state import choose
from .recorders import ROWS, RowBuffer
from .run_loop import AbstractRecorder, RunStart, StepOutcome

Channels = Mapping[str, Quantity | tuple[Quantity, str]]
"""Channels by name: quantities, or pairs of a quantity and its unit, such as "m/s"."""
PASS_CHANNELS = 'pass for example {"x": cj.quantities.Position("slider", "x")}'


class SectionRecord(eqx.Module):
    """Record of a section: its `level`, the value of the section's quantity after the latest
    accepted step, and `rows`, one for each crossing so far."""

    level: Scalar
    rows: RowBuffer


class SectionRecorder(AbstractRecorder[SectionRecord]):
    """Recorder of the crossings of a section.

    - `quantity`: function of an `Instant`, whose value is called the level. A step contains a
      crossing if the level is negative at the step's start, and positive or zero at the step's end;
      also if the level has the same sign at both ends, but the opposite sign at a turning point in
      between. At most one crossing is found in a step.
    - `earliest`: s, time of the scene before which crossings are ignored.
    - `channels`: pairs of a name and a quantity. A row of the record has the time of a crossing and
      the values of the quantities; with ``None``, as in lanes, a row is a `Snapshot`.
    - `wanted`: number of crossings to record until the buffer of rows is emptied; further ones are
      not counted. ``None`` for `capacity`, the size of the buffer.
    """

    quantity: Quantity = eqx.field(static=True)
    earliest: Scalar
    channels: tuple[tuple[str, Quantity], ...] | None = eqx.field(static=True)
    capacity: int = eqx.field(static=True)
    wanted: Scalar | None = None

    @override
    def start(self, start: RunStart) -> SectionRecord:
        row = Snapshot.of(start.step) if self.channels is None else self._none()
        return SectionRecord(self._level(start.now), RowBuffer.like(row, self.capacity))

    @override
    def after(self, record: SectionRecord, step_outcome: StepOutcome) -> SectionRecord:
        accepted, now, before = step_outcome.accepted, step_outcome.now, record.level
        # The level may jump at the end of the step. These are its values before and after the jump.
        last, after = now.before_and_after(self._level)
        start, end = self._bracket(now, before, last)
        # In scenes without jumps both are the same object. A level that jumps through zero crosses
        # it at the end of the step, between `last` and `after`.
        if last is not after:
            leaps = (last < 0.0) & (after >= 0.0)
            at_end = Point(1.0, last), Point(1.0, after)
            start, end = choose(leaps, at_end, (start, end))
        rises = accepted & (start.value < 0.0) & (end.value >= 0.0)
        period = getattr(self.quantity, "period", None)
        if period is not None:
            # An angle that falls below -pi jumps to pi, by 2 pi, which is no crossing.
            rises &= end.value - start.value < 0.5 * period
        if self.channels is None:
            # In lanes, which cannot branch one by one, the root is searched for in every step.
            row = self._crossing(step_outcome, start, end)
            time = step_outcome.system.scene_time(row.t)
        else:
            # Most steps have no crossing: other runs search for the root only in steps with one.
            system, channels = step_outcome.system, dict(self.channels)

            def columns() -> dict[str, Scalar]:
                return self._crossing(step_outcome, start, end).columns(system, channels)

            row = jax.lax.cond(rises, columns, lambda: self._none())
            time = row[TIME]
        limit = self.capacity if self.wanted is None else self.wanted
        is_recorded = rises & (time >= self.earliest) & (limit > record.rows.count)
        level = jnp.where(accepted, after, before)
        return SectionRecord(level, record.rows.with_row(row, is_recorded))

    @override
    def searched(self, now: Instant) -> Scalar:
        return self._level(now)

    def _level(self, now: Instant) -> Scalar:
        return number_at(now, self.quantity)

    def _bracket(self, now: Instant, before: Scalar, after: Scalar) -> tuple[Point, Point]:
        # The positions of points are parts of the step's time, from 0 at its start to 1 at its end.
        # If there is a crossing, the level is negative at the first point of the result, and
        # positive or zero at the second.
        parabola = Parabola.through(before, self._level(now.middle), after)
        below, at_start, at_end = before < 0.0, Point(0.0, before), Point(1.0, after)
        # A level with the same sign at both ends may rise through zero before or after a turning
        # point inside the step. A ball that is thrown up, for example, flies without integration
        # errors: in a single step it passes a height twice. x is the turning point of the parabola.
        x = parabola.vertex()
        turns = (below == (after < 0.0)) & (x > 0.0) & (x < 1.0)
        turns = turns & ((parabola.at(x) < 0.0) != below)

        def level() -> Scalar:
            return self._level(now.inside(x))

        # In lanes, both branches of a condition would be computed.
        value = level() if self.channels is None else jax.lax.cond(turns, level, lambda: before)
        turning_point = Point(x, value)
        # From below, the level rises before the turning point; from above, after it.
        start = choose(turns & jnp.logical_not(below), turning_point, at_start)
        return start, choose(turns & below, turning_point, at_end)

    def _crossing(self, step_outcome: StepOutcome, start: Point, end: Point) -> Snapshot:
        system, method, dense = step_outcome.system, step_outcome.method, step_outcome.dense_step

        # x is the elapsed part of the step's time, 0 to 1.
        x = secant_root(lambda x: self._level(step_outcome.now.inside(x)), start, end)
        # A step that ends at an event ends just after it. A crossing there is the event itself, at
        # which forces may jump, and gets the state after it. Computed inside the step, rounding
        # errors would decide on which side of the jump it is.
        length = dense.end.t - dense.start.t
        ends = (1.0 - x) * length <= LATEST
        t = jnp.where(ends, dense.end.t, dense.start.t + x * length)
        row = dense.at(method, system, t)
        # The entry speed of a contact that ends is known only before the event.
        start_and_row = dense.start.entry_speeds, row.entry_speeds
        speeds = jax.tree.map(
            lambda old, now: jnp.where(ends & (old > 0.0), old, now), *start_and_row
        )
        return Snapshot(row.t, row.y, speeds)

    def _none(self) -> dict[str, Scalar]:
        return {name: jnp.zeros(()) for name in (TIME, *dict(self.channels or ()))}


@dataclass(frozen=True)
class Section:
    """A Poincaré section: values of quantities where another quantity rises through zero.

    **Arguments:**

    - `crossing`: the quantity whose rise through zero is a crossing, a function of an `Instant`.
      At most one crossing is found in a step; `Peak` tells how to limit the steps in free flight.
      For an angle other than zero, take a sine, which has no jump at half a revolution:
      ``lambda now: jnp.sin(angle(now) - 0.5)``.
    - `channels`: the quantities to evaluate at each crossing, by name; for a function without an
      attribute `unit`, a pair (function, unit). The names become those of arrays in results. At the
      onset or end of a contact, forces are those just after it; the entry speed is the contact's.
    - `count`: largest number of crossings; later ones are not recorded.
    - `after`: s, time of the scene (not since the start of the run) before which crossings are
      ignored, to leave out a transient; by default none are.

    **Raises:** `ValueError` if `crossing` is not a function; if `channels` is not a mapping, is
    empty, or has a value that is neither a function nor such a pair; for a name that is not a
    non-empty string, contains a slash or backslash, begins with "." or "__", or is "time" or
    "count"; for a `count` that is not a positive integer, and an `after` that is not finite.

    >>> touch = cj.Section(
    ...     cj.quantities.Penetration("shoulder", "V"),
    ...     {"speed": cj.quantities.EntrySpeed("shoulder", "V")},
    ...     count=10,
    ... )
    >>> list(touch.channels)
    ['speed']
    """

    crossing: Quantity
    channels: Channels
    count: int = 1000
    after: Annotated[float | None, "s"] = None

    def __post_init__(self) -> None:
        require_quantity("crossing", self.crossing)
        require_array_names("channels", self.channels, PASS_CHANNELS)
        expected = "quantities, or (quantity, unit) pairs, by name"
        require(bool(self.channels), "channels", {}, expected, PASS_CHANNELS)
        for name, channel in self.channels.items():
            pair = channel if isinstance(channel, tuple) else (channel, "1")
            is_pair = len(pair) == 2 and callable(pair[0]) and isinstance(pair[1], str)
            # A class, such as `Position` without arguments, is callable too, but no quantity.
            is_pair = is_pair and not isinstance(pair[0], type)
            require(is_pair, f"channels[{name!r}]", channel, expected, PASS_CHANNELS)
        # The results have arrays with the times of the crossings and the number of crossings.
        taken, unused = sorted({"time", "count"} & set(self.channels)), "of names that are not used"
        require(not taken, "channels", taken, unused, "rename them")
        require_count("count", self.count, "pass a number of crossings")
        if self.after is not None:
            require_shape("after", self.after, (), "pass one time in s")

    @property
    def _earliest(self) -> jax.Array:
        return on_device(-math.inf if self.after is None else self.after)

    @property
    def pairs(self) -> dict[str, tuple[Quantity, str]]:
        return {
            name: channel
            if isinstance(channel, tuple)
            else (channel, getattr(channel, "unit", None) or "1")
            for name, channel in self.channels.items()
        }

    @property
    def recorder(self) -> SectionRecorder:
        channels = tuple((name, quantity) for name, (quantity, _) in self.pairs.items())
        return SectionRecorder(self.crossing, self._earliest, channels, self.count)

    @property
    def state_recorder(self) -> SectionRecorder:
        """The recorder of states at crossings, for lanes. Its rows are read out during the run."""
        return SectionRecorder(self.crossing, self._earliest, None, ROWS)

    def check(self, scene: Scene) -> None:
        """Raise a `ValueError` if a scene lacks an element that `crossing` or a channel names."""
        check_quantity("crossing", self.crossing, scene)
        for name, (quantity, _) in self.pairs.items():
            check_quantity(f"channel {name!r}", quantity, scene)
