"""Simulation, block by block of periods, until a motion is periodic, steady or stationary."""

import enum
from dataclasses import dataclass, replace

import jax
import numpy as np
from jaxtyping import Float

from ...fields.checks import as_number, require, require_count, require_positive
from ...model.bodies import State
from ...model.scene import Scene
from ...result_codes import RESULTS
from ..results.solution import Solution
from ..step import presets
from ..step.settings import Settings, settings_or
from .progress_bars import ProgressBar
from .recurrence import CONFIRMING, Strobe, section_strobe, stillness, strobe_of
from .saving import Saving
from .sections import Section
from .simulate import simulate

BLOCK = 10
"""Number of periods of one run. After each run the motion so far is assessed."""
PHASES = 16
"""Number of states in each period that are compared with those of another period."""
SECTION = "settle"


class Settling(enum.Enum):
    """How a motion settled; the value of each member is a description in words.

    - `PERIODIC`: it repeats after a number of periods.
    - `STEADY`: it is at rest.
    - `STATIONARY`: it does not repeat, but means and standard deviations are constant.
    - `UNSETTLED`: none of these after the largest number of periods.
    - `FAILED`: a run ended with a failure.

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

    - `kind`: a `Settling`. A `STATIONARY` motion is chaotic, quasi-periodic, or periodic with a
      larger multiple than was tried. No finite run can exclude that it is a long transient whose
      statistics are constant.
    - `time`, `state`: the time in s at which the last run ended, and the `State` then. Continue
      with ``simulate(scene, settled.state, end_time, start_time=settled.time)``. If drivers and
      loads repeat with the period, the motion may be continued from `start_time` instead, which is
      a whole number of periods before `time`.
    - `start_time`: s, the start of the first run.
    - `periods`: number of periods, or of times between crossings of the section, that were
      simulated.
    - `multiple`: number of these periods in one period of the motion; ``None`` unless periodic.
    - `period`: s, the given period, or the mean time between the last crossings of the section;
      ``None`` with fewer than two crossings.
    - `changes`: (n,), for each period the largest change of the motion since `multiple` periods
      earlier (one period if not periodic), relative to the range of the motion.
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
        """``True`` if the motion is periodic, steady or stationary."""
        return self.kind not in (Settling.UNSETTLED, Settling.FAILED)

    def __str__(self) -> str:
        """Return a sentence that says how the motion settled and after how many periods."""
        after = f"after {self.periods} periods, at t = {self.time:.9g} s"
        if self.kind is Settling.FAILED:
            return f"A run failed {after}: {RESULTS[self.result]}"
        repeats = f" with {self.multiple} times the period" if (self.multiple or 1) > 1 else ""
        last = (
            f"; the last change is {self.changes[-1]:.2g} of its range" if len(self.changes) else ""
        )
        return f"The motion is {self.kind.value}{repeats} {after}{last}."


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
    `section`, the values of its channels at each crossing, and the time since the last crossing,
    are compared with those one crossing before, two crossings before, and so on.

    ```python
    import math

    import clearjoint as cj

    scene, state = cj.mechanisms.slider_crank(0.1e-3, speed=500.0)
    settled = cj.settle(scene, state, period=2 * math.pi / 500.0, periods=20)
    print(settled)
    solution = cj.simulate(scene, settled.state, settled.time + 0.01, start_time=settled.time)
    ```

    **Arguments:**

    - `scene`, `state`: the mechanism and its initial state, as in `simulate`.
    - `start_time`: s.
    - `settings`: tolerances, solver and coordinates; `clearjoint.presets.accurate` unless given.
    - `period`: s, the period of all drivers and loads: 2 pi over a drive's speed in rad/s.
    - `section`: a `Section`, used instead of `period` for motions without a drive. The fields
      `count` and `after` of the section are ignored.
    - `span`: s, only with a section: a time in which the section is crossed about once.
    - `periods`: largest number of periods to simulate; with a section, largest number of spans. It
      is rounded up to a multiple of 10.
    - `largest_multiple`: largest number of periods after which the motion may repeat.
    - `tolerance`: relative. A motion repeats if its change is not above `tolerance` for at least
      three periods. Changes are relative to the ranges of positions, velocities and spins: for a
      motion over 0.1 m, 1e-5 is a micrometre. `settings.rtol` must be well below `tolerance`.
    - `progress`: show a progress bar.

    **Returns:** a `Settled`. A motion that does not settle, or a run that fails, raises no error;
    `kind` of the result tells.

    **Raises:** `ValueError` for invalid arguments.
    """
    _check(periods, largest_multiple, tolerance)
    rhythm = _rhythm(period, section, span)
    settings = settings_or(settings, presets.accurate)
    now = _Runs(state, start_time, RESULTS.successful, ())
    text = "{l_bar}{bar}| {n_fmt} of {total_fmt} periods [{elapsed}]"
    bar = ProgressBar(
        total=periods, desc="settle", bar_format=text, leave=False, disable=not progress
    )
    with bar:
        while True:
            now = now.after(scene, settings, rhythm)
            bar.update(BLOCK)
            # Statistics need all periods, so they are compared only after the last block.
            last = BLOCK * len(now.parts) >= periods
            assessment = _assessment(now, rhythm, largest_multiple, tolerance, last)
            if assessment is not None:
                return _settled(now, rhythm, start_time, *assessment)


@dataclass(frozen=True)
class _Rhythm:
    """Instants at which a motion is compared.

    `period`: s; `section`: ``None``, or a section that is crossed about once in a `period`.
    """

    period: float
    section: Section | None

    def saving(self, start: float) -> Saving:
        """Return the results that the run of a block from `start`, s, must keep.

        They are states at all phases of `BLOCK` periods, and the crossings of the section.
        """
        times = start + self.period * np.arange(1, PHASES * BLOCK + 1) / PHASES
        if self.section is None:
            return Saving(times)
        # More crossings than `BLOCK` may occur, as the span is only a rough guess.
        most = replace(self.section, count=PHASES * BLOCK, after=start)
        return Saving(times, sections={SECTION: most})


@dataclass(frozen=True)
class _Runs:
    """State, time (s) and result code after the latest run, and the solutions of all runs."""

    state: State
    time: float
    result: RESULTS
    parts: tuple[Solution, ...]

    def after(self, scene: Scene, settings: Settings, rhythm: _Rhythm) -> "_Runs":
        """Simulate `BLOCK` more periods and return the runs with the new solution."""
        save = rhythm.saving(self.time)
        end = float(np.asarray(save.times)[-1])
        solution = simulate(
            scene,
            self.state,
            end,
            settings,
            save,
            start_time=self.time,
            throw=False,
            progress=False,
        )
        parts = (*self.parts, solution)
        return _Runs(solution.final, float(solution.time), solution.result, parts)

    def states(self) -> State:
        """Return the states at all phases of all periods, with their number in front."""
        return jax.tree.map(lambda *rows: np.concatenate(rows), *(p.states for p in self.parts))

    def crossings(self) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return the times of all n crossings of the section, (n,) s, and a list of channels.

        Each item of the list is the values of one channel at the crossings, (n,).
        """
        parts = [part.sections[SECTION] for part in self.parts]
        times = np.concatenate([np.asarray(part.times) for part in parts])
        names = parts[0].values
        channels = ([np.asarray(part.values[name]) for part in parts] for name in names)
        return times, [np.concatenate(channel) for channel in channels]

    def strobe(self, rhythm: _Rhythm) -> Strobe:
        """Return the motion as one row of numbers for each period."""
        if rhythm.section is None:
            return strobe_of(self.states(), PHASES)
        return section_strobe(*self.crossings())


def _assessment(
    now: _Runs, rhythm: _Rhythm, largest_multiple: int, tolerance: float, last: bool
) -> tuple[Settling, int | None] | None:
    """Return how the motion has settled, and the number of periods after which it repeats.

    The number is ``None`` unless the motion is periodic. The result is ``None`` as a whole if the
    motion may still settle.

    **Arguments:** `last`: whether no further run follows.
    """
    if now.result != RESULTS.successful:
        return Settling.FAILED, None
    # A motion at rest repeats itself too, so ask for that first.
    if stillness(now.states(), PHASES * CONFIRMING) <= tolerance:
        return Settling.STEADY, None
    strobe = now.strobe(rhythm)
    multiple = strobe.multiple(largest_multiple, tolerance)
    if multiple is not None:
        return Settling.PERIODIC, multiple
    if not last:
        return None
    return (Settling.STATIONARY if strobe.statistics_settled() else Settling.UNSETTLED), None


def _settled(
    now: _Runs, rhythm: _Rhythm, start_time: float, kind: Settling, multiple: int | None
) -> Settled:
    """Return the result of `settle`; a run that failed does not count in `periods` and `changes`.

    **Arguments:** `kind`, `multiple`: as in `Settled`.
    """
    finished = replace(now, parts=tuple(p for p in now.parts if p.result == RESULTS.successful))
    strobe = finished.strobe(rhythm) if finished.parts else Strobe(np.zeros((0, 1)), np.ones(1))
    period: float | None = rhythm.period
    if rhythm.section is not None:
        times = finished.crossings()[0] if finished.parts else np.zeros(0)
        # The transient has other times between crossings than the last periods.
        period = float(np.mean(np.diff(times[-CONFIRMING * BLOCK :]))) if len(times) > 1 else None
    changes = strobe.change(multiple or 1) if len(strobe.rows) else np.zeros(0)
    return Settled(
        kind=kind,
        state=now.state,
        time=now.time,
        start_time=start_time,
        periods=len(strobe.rows),
        multiple=multiple,
        period=period,
        changes=changes,
        result=now.result,
    )


def _rhythm(period: float | None, section: Section | None, span: float | None) -> _Rhythm:
    """Return the instants at which the motion is compared, from the arguments of `settle`.

    **Raises:** `ValueError` unless either `period`, or `section` with `span`, is given.
    """
    one = (period is None) != (section is None)
    remedy = "pass the drive's period in s; or a section, with its span in s"
    require(one, "period", period, "given if and only if `section` is not", remedy)
    if period is not None:
        number = as_number(period, "period", "s")
        require_positive("period", number, "give it in s: 2 pi over the drive's speed")
        require(span is None, "span", span, "None beside a period", "leave it out")
        return _Rhythm(float(period), None)
    kind = type(section).__name__
    require(isinstance(section, Section), "section", kind, "a Section", remedy)
    remedy = "give a time in s in which the section is crossed about once"
    require(span is not None, "span", span, "given with a section", remedy)
    assert span is not None
    require_positive("span", span, remedy)
    return _Rhythm(float(span), section)


def _check(periods: int, largest_multiple: int, tolerance: float) -> None:
    require_count("periods", periods, "allow some hundred")
    require_count("largest_multiple", largest_multiple, "1 looks for the drive's period alone")
    require_positive("tolerance", tolerance, "1e-5 of the motion's range is usual")
