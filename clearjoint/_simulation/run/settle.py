"""Simulate until a motion is periodic, steady or stationary.

A run covers a block of periods. After each block, the motion is reduced to a table, with one row of
numbers for each period, whose last rows are compared with those some periods earlier.
"""

import enum
from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np
from jaxtyping import Float
from typing_extensions import override

from ..._fields.checks import (
    as_number,
    require,
    require_count,
    require_positive,
    require_shape,
    require_type,
)
from ..._model.bodies import State
from ..._model.scene import Scene
from ..._result_codes import RESULTS
from ..results.solution import Solution
from ..step import presets
from ..step.settings import Settings, settings_or
from .saving import Saving
from .sections import Section
from .simulate import simulate
from .terminal import ProgressBar, RunInterrupted

BLOCK = 10
"""Number of periods of one run, after which the motion so far is assessed. A larger number would
simulate more periods than needed, a smaller one would assess the motion more often."""
PHASES = 16
"""Number of states in each period that are compared with those of another period. There are many,
because two different motions may agree at one phase by chance."""
SECTION = "settle"


class Settling(enum.Enum):
    """How a motion settled. Each member's value describes it in words; `STEADY` means at rest.

    >>> cj.Settling.UNSETTLED.value
    'not settled'
    """

    PERIODIC = "periodic"
    STEADY = "steady"
    STATIONARY = "neither periodic nor steady, but its statistics change no longer"
    UNSETTLED = "not settled"
    FAILED = "a run failed"


@dataclass(frozen=True)
class Settled:
    """Result of `settle`: how a motion settled, and the state and time at the end.

    - `kind`: a `Settling`. A `STATIONARY` motion, whose means and standard deviations are constant,
      is chaotic, quasi-periodic, or periodic with a larger multiple than was tried. No finite run
      can exclude that it is a long transient.
    - `time`, `state`: the time in s at which the last run ended, and the `State` then. Continue
      with ``simulate(scene, settled.state, end_time, start_time=settled.time)``. With a `period`,
      and if no run failed, the simulated time is a whole number of periods; if all drivers and
      loads have this period, a further run may start from `state` at `start_time` instead.
    - `start_time`: s, the argument of `settle`.
    - `periods`: number of periods, or of times between crossings of the section, that were
      simulated in runs without a failure.
    - `multiple`: number of these periods in one period of the motion; ``None`` unless periodic.
    - `period`: s, the given period, or the mean time between the last crossings of the section;
      ``None`` with fewer than two crossings.
    - `changes`: (n,), for each period after the first `multiple` ones, the largest difference from
      the period that was `multiple` periods earlier, or from the one before if the motion is not
      periodic. The argument `tolerance` of `settle` says what differences are relative to.
    - `result`: the `RESULTS` code of the last run.

    >>> settled = cj.settle(scene, state, period=0.2 * np.pi, periods=20, progress=False)
    >>> settled.kind.name, settled.multiple, settled.settled
    ('PERIODIC', 1, True)
    """

    kind: Settling
    state: State
    time: float
    start_time: float
    periods: int
    multiple: int | None
    period: float | None
    changes: Float[np.ndarray, " n"]
    result: RESULTS

    @property
    def settled(self) -> bool:
        """Whether the motion is periodic, steady or stationary."""
        return self.kind not in (Settling.UNSETTLED, Settling.FAILED)

    @override
    def __str__(self) -> str:
        after = f"after {self.periods} periods, at t = {self.time:.9g} s"
        if self.kind is Settling.FAILED:
            return f"A run failed {after}: {RESULTS[self.result]}"
        repeats = f" with {self.multiple} times the period" if (self.multiple or 1) > 1 else ""
        last = (
            f"; the last change is {self.changes[-1]:.2g} of its range" if len(self.changes) else ""
        )
        return f"The motion is {self.kind.value}{repeats} {after}{last}."


SETTLED_STATISTICS = 0.1
"""Largest difference between the means, and the standard deviations, in two spans of a motion that
count as the same, relative to its range. It leaves room for scatter in a chaotic motion."""
ROOM = PHASES * BLOCK
"""Number of crossings of a section for which there is room in a block of periods."""
CONFIRMING = 3
"""Number of successive periods that must equal an earlier one, since a single period may resemble
an earlier one by chance; also the number of periods for which a steady motion must be still."""
STILL = 1e-6
"""Lower bound of the ranges of a motion, in m, m/s and rad/s, by which its changes are divided, so
that rounding errors of a motion at rest are not taken for changes. With a section, also the lower
bound of the scales of the times between crossings, s, and of the channels, each in its unit."""


@dataclass(frozen=True)
class Strobe:
    """A motion as D numbers for each of n periods, `rows`, (n, D), in which `settle` looks for
    repetition. Changes in each column are divided by `scales`, (D,), and are known up to multiples
    of `periods`, (D,): 2 pi for an angle, otherwise infinity; ``None`` if there is no angle."""

    rows: Float[np.ndarray, "n D"]
    scales: Float[np.ndarray, " D"]
    periods: Float[np.ndarray, " D"] | None = None

    def change(self, multiple: int) -> Float[np.ndarray, " changes"]:
        """Return for each row but the first `multiple` ones, (n - `multiple`,), the largest change
        in any column since the row `multiple` rows earlier, over the column's scale."""
        difference = self.rows[multiple:] - self.rows[:-multiple]
        if self.periods is not None:
            turns = np.round(difference / self.periods)
            # Zero turns of an infinite period would be NaN.
            difference = difference - turns * np.where(turns == 0.0, 0.0, self.periods)
        return np.max(np.abs(difference) / self.scales, axis=1, initial=0.0)

    def multiple(self, largest: int, tolerance: float) -> int | None:
        """Return the smallest number m of periods, up to `largest`, after which the motion repeats:
        in each of the last max(m, `CONFIRMING`) periods, the `change` since m periods earlier is at
        most `tolerance`. Return ``None`` if there is no such m, or if the `change` for a smaller
        number of periods than m decays: the motion is then a vibration that dies away."""
        for multiple in range(1, largest + 1):
            needed = max(multiple, CONFIRMING)
            changes = self.change(multiple) if len(self.rows) > multiple else np.zeros(0)
            if len(changes) >= needed and bool(np.all(changes[-needed:] <= tolerance)):
                # A decaying vibration may repeat best after m periods, but has no such period.
                decay = any(self._decays(fewer, needed) for fewer in range(1, multiple))
                return None if decay else multiple
        return None

    def _decays(self, multiple: int, count: int) -> bool:
        """Return whether the `change` since `multiple` periods earlier decays: its largest value in
        the last `count` periods is less than half of that in an earlier span of `count` periods,
        which ends after three quarters of the motion."""
        changes = self.change(multiple)
        earlier = changes[: 3 * len(changes) // 4][-count:]
        return bool(changes[-count:].max() < 0.5 * earlier.max(initial=0.0))

    def statistics_settled(self) -> bool:
        """Return whether means and standard deviations of all columns agree between the third and
        the last quarter of the periods (`SETTLED_STATISTICS`); ``False`` below eight periods."""
        quarter = len(self.rows) // 4
        # The standard deviation of a single period would be zero.
        if quarter < 2:
            return False
        spans = self.rows[-2 * quarter : -quarter], self.rows[-quarter:]
        means, deviations = ([f(span, axis=0) for span in spans] for f in (np.mean, np.std))
        apart = [np.abs(a - b) / self.scales for a, b in (means, deviations)]
        return bool(np.max(apart) <= SETTLED_STATISTICS)


def columns(states: State) -> dict[str, Float[np.ndarray, "N bodies components"]]:
    """Return positions (m), velocities (m/s), spins (rad/s) and orientations of all bodies in N
    states, by name. Orientations are products p_i p_j of Euler parameters (of arbitrary sign)."""
    parts = {
        name: np.stack([np.asarray(getattr(body, name)) for body in states.bodies.values()], axis=1)
        for name in ("position", "velocity", "spin", "orientation")
    }
    p = parts["orientation"]
    products = p[..., :, None] * p[..., None, :]
    return {**parts, "orientation": products.reshape(*p.shape[:2], 16)}


def ranges(parts: dict[str, Float[np.ndarray, "N bodies components"]]) -> dict[str, float]:
    """Return, for each array from `columns`, the largest range of a component over the N states, at
    least `STILL`; for orientations 1, since they are pure numbers of about this size."""
    sizes = {name: np.max(np.ptp(part, axis=0), initial=STILL) for name, part in parts.items()}
    return {**sizes, "orientation": 1.0}


def strobe_of(states: State, phases: int) -> Strobe:
    """Return a motion of n periods as a table, from states at `phases` instants of each period."""
    parts = columns(states)
    # Scaled by the last periods only, since a transient may have larger ranges.
    sizes = ranges({name: part[-phases * CONFIRMING :] for name, part in parts.items()})
    # A row has the numbers of all `phases` states of a period, one state after the other.
    tables = [part.reshape(len(part) // phases, -1) for part in parts.values()]
    scales = [np.full(t.shape[1], sizes[name]) for name, t in zip(parts, tables, strict=True)]
    return Strobe(np.concatenate(tables, axis=1), np.concatenate(scales))


def stillness(states: State, last: int) -> float:
    """Return how much a motion still varies: the largest range of a component in the `last` states,
    relative to the largest range of its array, such as velocities, in all states (`ranges`)."""
    parts = columns(states)
    sizes = ranges(parts)
    return max(
        float(np.max(np.ptp(part[-last:], axis=0))) / sizes[name] for name, part in parts.items()
    )


def section_strobe(
    times: Float[np.ndarray, " n"], values: list[np.ndarray], periods: Sequence[float | None]
) -> Strobe:
    """Return a motion as a table with a row for each crossing of a section except the first: the
    time since the previous crossing, s, and the value of each channel. `periods`: for each channel,
    such as 2 pi for an angle, otherwise ``None``. The scales are the mean time (1 s with fewer than
    two crossings), and the largest magnitude of each channel."""
    waits = np.diff(times)
    rows = np.stack([waits, *(value[1:] for value in values)], axis=1)
    wait = np.mean(waits) if len(waits) else 1.0
    sizes = [wait, *(np.max(np.abs(channel), initial=0.0) for channel in values)]
    known_up_to = np.array([np.inf, *(np.inf if p is None else p for p in periods)])
    return Strobe(rows, np.maximum(sizes, STILL), known_up_to)


def settle(
    scene: Scene,
    state: State,
    settings: Settings | None = None,
    *,
    period: float | None = None,
    section: Section | None = None,
    span: float | None = None,
    start_time: float = 0.0,
    periods: int = 300,
    largest_multiple: int = 8,
    tolerance: float = 1e-5,
    progress: bool = True,
) -> Settled:
    """Simulate until the motion is periodic or steady, or the largest number of periods is reached.

    With the `period` of a drive, the states at 16 phases of each period are compared with the
    states one period before, two periods before, and so on up to `largest_multiple`. With a
    `section`, the same is done with the values of its channels at each crossing, and the time since
    the last crossing. A motion that does not repeat within all `periods` is stationary if the means
    and standard deviations in the third quarter of the periods (or crossings) differ from those in
    the last quarter by at most a tenth of the sizes to which changes are relative (see
    `tolerance`). At least eight periods, or nine crossings, are needed for this.

    **Arguments:**

    - `scene`, `state`, `start_time`, `progress`: as in `simulate`.
    - `settings`: `clearjoint.presets.accurate` unless given.
    - `period`: s, the period of all drivers and loads: 2 pi over a drive's speed in rad/s.
    - `section`: a `Section`, used instead of `period` for motions without a drive. Its fields
      `count` and `after` are ignored.
    - `span`: s, only with a section: a time in which the section is crossed about once.
    - `periods`: largest number of periods to simulate; with a section, largest number of spans. It
      is rounded up to a multiple of 10.
    - `largest_multiple`: largest number of periods after which the motion may repeat.
    - `tolerance`: relative. A motion repeats after m periods if each of the last max(m, 3) periods
      differs from the one m periods earlier by at most this. Changes are relative to the ranges of
      positions, velocities and spins in the last three periods: for a motion over 0.1 m, 1e-5 is a
      micrometre. With a section, they are relative to the mean time between crossings and to the
      largest magnitude of each channel. A motion is at rest if its ranges in the last three periods
      are at most `tolerance` times those of the whole motion. If the distance to the final motion
      shrinks by a factor f in each period, then a distance of ``tolerance / (1 - f)`` may remain.
      `settings.rtol` must be well below `tolerance`.

    **Returns:** a `Settled`. A motion that does not settle, or a run that fails, raises no error;
    `kind` of the result tells.

    **Raises:** `ValueError` unless either `period` alone, or `section` with `span`, is given; for a
    section that is crossed 160 times or more in ten spans; and for other invalid arguments, such as
    an initial state that violates the constraints. `RunInterrupted` after Ctrl-C.

    ```python
    import math

    import clearjoint as cj

    scene, state = cj.mechanisms.slider_crank(0.1e-3, speed=500.0)
    settled = cj.settle(scene, state, period=2 * math.pi / 500.0, periods=20)
    print(settled)
    solution = cj.simulate(scene, settled.state, settled.time + 0.01, start_time=settled.time)
    ```
    """
    require_count("periods", periods, "allow some hundred")
    require_count("largest_multiple", largest_multiple, "1 looks for the drive's period alone")
    require_positive("tolerance", tolerance, "1e-5 of the motion's range is usual")
    length = _period(period, section, span)
    require_shape("start_time", start_time, (), "pass one time in s")
    settings = settings_or(settings, presets.accurate)
    blocks: list[Solution] = []
    time, kind, multiple = start_time, None, None
    # If the first run fails, the result has no periods.
    strobe = Strobe(np.zeros((0, 1)), np.ones(1))
    text = "{l_bar}{bar}| {n_fmt} of {total_fmt} periods [{elapsed}]"
    with ProgressBar(progress, total=periods, desc="settle", bar_format=text) as bar:
        while kind is None:
            # `PHASES` states in each of the `BLOCK` periods, the last one at the end.
            times = time + length * np.arange(1, PHASES * BLOCK + 1) / PHASES
            # A run may have more than `BLOCK` crossings, because the span is a rough guess.
            outputs = {} if section is None else {SECTION: replace(section, count=ROOM, after=time)}
            options = {"outputs": outputs, "start_time": time, "throw": False, "progress": False}
            try:
                block = simulate(scene, state, float(times[-1]), settings, Saving(times), **options)
            except RunInterrupted as stopped:
                raise RunInterrupted(_joined([*blocks, stopped.solution])) from stopped
            state, time, result = block.final, float(block.time), block.result
            bar.update(min(BLOCK, periods - bar.n))
            if result != RESULTS.successful:
                # A block that failed lacks states, so its periods cannot be compared with others.
                kind = Settling.FAILED
                break
            blocks.append(block)
            motion = _joined(blocks)
            if section is None:
                strobe = strobe_of(motion.states, PHASES)
            else:
                _require_few_crossings(block, span)
                crossings = motion.outputs[SECTION]
                # Of the channels' values, such as 2 pi of an angle; not periods of the motion.
                periods_of = [getattr(q, "period", None) for q, _ in section.pairs.values()]
                values = [*crossings.values.values()]
                strobe = section_strobe(crossings.times, values, periods_of)
                # The transient has other times between crossings than the last periods.
                waits = np.diff(crossings.times[-CONFIRMING * BLOCK :])
                period = np.mean(waits) if len(waits) else None
            # A motion at rest repeats itself too, so this is checked before periods.
            is_still = stillness(motion.states, PHASES * CONFIRMING) <= tolerance
            multiple = None if is_still else strobe.multiple(largest_multiple, tolerance)
            is_last = BLOCK * len(blocks) >= periods
            kind = Settling.STEADY if is_still else _kind(strobe, multiple, is_last)
    changes = strobe.change(multiple or 1) if len(strobe.rows) else np.zeros(0)
    return Settled(
        kind=kind,
        state=state,
        time=time,
        start_time=start_time,
        periods=len(strobe.rows),
        multiple=multiple,
        period=None if period is None else float(period),
        changes=changes,
        result=result,
    )


def _kind(strobe: Strobe, multiple: int | None, is_last: bool) -> Settling | None:
    """Return the kind of a motion that is not at rest; ``None`` if more periods have to be run.
    `multiple`: periods until it repeats, or ``None``; `is_last`: whether no more are allowed."""
    if multiple is not None:
        return Settling.PERIODIC
    if not is_last:
        return None
    # Statistics need all periods, so they are compared only after the last block.
    return Settling.STATIONARY if strobe.statistics_settled() else Settling.UNSETTLED


def _require_few_crossings(block: Solution, span: float | None) -> None:
    # Without the crossings that were lost, the motion would not be found to repeat.
    few = len(block.outputs[SECTION]) < ROOM
    expected = f"a time in which the section is crossed fewer than {PHASES} times"
    remedy = "give a time in s in which the section is crossed about once"
    require(few, "span", span, expected, remedy)


def _joined(blocks: list[Solution]) -> Solution:
    # Saved states and crossings are those of all blocks; the end is that of the last one.
    saved, outputs = jax.tree.map(
        lambda *rows: np.concatenate(rows), *((block.saved, block.outputs) for block in blocks)
    )
    return replace(
        blocks[-1],
        attempts=sum(block.attempts for block in blocks),
        accepted=sum(block.accepted for block in blocks),
        saved=saved,
        saved_count=len(saved),
        outputs=outputs,
    )


# Checks the three arguments of `settle`, and returns the length of a period or of a span, s.
def _period(period: float | None, section: Section | None, span: float | None) -> float:
    is_one_given = (period is None) != (section is None)
    remedy = "pass the drive's period in s; or a section, with its span in s"
    require(is_one_given, "period", period, "given if and only if `section` is not", remedy)
    if period is not None:
        number = as_number(period, "period", "s")
        require_positive("period", number, "give it in s: 2 pi over the drive's speed")
        require(span is None, "span", span, "None beside a period", "leave it out")
        return float(period)
    require_type("section", section, Section, "a Section", remedy)
    remedy = "give a time in s in which the section is crossed about once"
    require(span is not None, "span", span, "given with a section", remedy)
    assert span is not None
    require_positive("span", span, remedy)
    return float(span)
