"""Simulation until a motion is periodic or steady."""

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
"""Periods of one run; the motion is assessed after each run."""
PHASES = 16
"""States that are compared in each period."""
SECTION = "settle"


class Settling(enum.Enum):
    """How a motion settled; the value is a description in words.

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
    """State and time at which a motion settled, and how.

    - `kind`: a `Settling`. A `STATIONARY` motion is chaotic, quasi-periodic, or periodic with a
      larger multiple than was tried. No finite run can exclude a long transient with constant
      statistics.
    - `state`, `time`: at the end, s. Continue with ``simulate(..., start_time=settled.time)``. If
      everything that depends on time has the period, `start_time` works as well: it is a whole
      number of periods earlier.
    - `periods`: number of periods, or crossings of a section, that were simulated.
    - `multiple`: number of drive periods in one period of the motion; ``None`` unless periodic.
    - `period`: s, the drive's, or the mean time between crossings; ``None`` without crossings.
    - `changes`: (n,), largest change of the motion over `multiple` periods (one if not periodic),
      for each period, relative to the range of the motion.
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
        """Whether the motion is periodic, steady, or stationary."""
        return self.kind not in (Settling.UNSETTLED, Settling.FAILED)

    def __str__(self) -> str:
        """Describe in a sentence how the motion settled and after how many periods."""
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

    With the `period` of a drive, the motion is compared at 16 phases of each period with that one
    period before, two periods before, and so on up to `largest_multiple`. With a `section`, its
    channels at the crossings and the times between crossings are compared.

    ```python
    import math

    import clearjoint as cj

    scene, state = cj.mechanisms.slider_crank(0.1e-3, speed=500.0)
    settled = cj.settle(scene, state, period=2 * math.pi / 500.0, periods=20)
    print(settled)
    solution = cj.simulate(scene, settled.state, settled.time + 0.01, start_time=settled.time)
    ```

    **Arguments:**

    - `scene`, `state`, `start_time` in s: as in `simulate`.
    - `settings`: how to integrate; `clearjoint.presets.accurate` unless given.
    - `period`: s, the period of everything that depends on time: 2 pi over the drive's speed.
    - `section`: used instead of a period for motions without a drive; its `count` and `after` are
      ignored. `span`: s, a time in which it is crossed once or a few times.
    - `periods`: largest number of periods to simulate; of `span`s with a section.
    - `largest_multiple`: largest number of periods after which the motion may repeat.
    - `tolerance`: the motion repeats if its change is below this for at least three periods,
      relative to the ranges of positions, velocities and spins. For a motion over 0.1 m, 1e-5 is a
      micrometre. `rtol` must be well below it.
    - `progress`: show a progress bar.

    **Returns:** a `Settled`. A motion that does not settle, or a run that fails, raises no error:
    see `kind`.

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
    """When a motion is compared: each `period`, s, or where it crosses a `section`, about once in
    a period."""

    period: float
    section: Section | None

    def saving(self, start: float) -> Saving:
        """Return what the run of a block keeps."""
        times = start + self.period * np.arange(1, PHASES * BLOCK + 1) / PHASES
        if self.section is None:
            return Saving(times)
        most = replace(self.section, count=PHASES * BLOCK, after=start)
        return Saving(times, sections={SECTION: most})


@dataclass(frozen=True)
class _Runs:
    """State, time and result after the latest run, and the solutions of all runs."""

    state: State
    time: float
    result: RESULTS
    parts: tuple[Solution, ...]

    def after(self, scene: Scene, settings: Settings, rhythm: _Rhythm) -> "_Runs":
        """Simulate one more block."""
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
        """The states at all phases of all periods."""
        return jax.tree.map(lambda *rows: np.concatenate(rows), *(p.states for p in self.parts))

    def crossings(self) -> tuple[np.ndarray, list[np.ndarray]]:
        """Times (n,) s of all crossings of the section, and each channel there, (n,)."""
        parts = [part.sections[SECTION] for part in self.parts]
        times = np.concatenate([np.asarray(part.times) for part in parts])
        names = parts[0].values
        channels = ([np.asarray(part.values[name]) for part in parts] for name in names)
        return times, [np.concatenate(channel) for channel in channels]

    def strobe(self, rhythm: _Rhythm) -> Strobe:
        """Return the motion once a period."""
        if rhythm.section is None:
            return strobe_of(self.states(), PHASES)
        return section_strobe(*self.crossings())


def _assessment(
    now: _Runs, rhythm: _Rhythm, largest_multiple: int, tolerance: float, last: bool
) -> tuple[Settling, int | None] | None:
    """Return how the motion has settled, and its multiple; ``None`` if it may still settle."""
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
    """Return the result; of a run that failed only the blocks before it count."""
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
    """Return when the motion is compared, from a period or from a section with its span."""
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
