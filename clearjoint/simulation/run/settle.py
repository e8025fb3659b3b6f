"""Runs until a motion is periodic or steady."""

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
"""Periods of one run; between two runs the motion is looked at."""
PHASES = 16
"""States that are looked at in each period."""
SECTION = "settle"


class Settling(enum.Enum):
    """How a motion settled; the value says it in words.

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
    """Where a motion settled, and how.

    - `kind`: a `Settling`. A motion that is `STATIONARY` is chaotic, quasi-periodic, or periodic
      with more periods than were tried; the statistics that a transient may have, no finite run
      can exclude.
    - `state`, `time`: at the end, s. Go on by ``simulate(..., start_time=settled.time)``, or, where
      all that depends on time has the period, from `start_time`, which is whole periods earlier.
    - `periods`: how many were run; crossings, of a section.
    - `multiple`: of how many of these one period of the motion consists; ``None`` unless periodic.
    - `period`: s, that of the drive or the mean time between crossings; ``None`` without crossings.
    - `changes`: (n,) largest change of the motion over `multiple` periods, or over one, period by
      period, in ranges of the motion.
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
        """How the motion settled and after how many periods, in a sentence."""
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
    """Simulate until the motion is periodic or steady, or so many periods have passed.

    With a `period`, the drive's, the motion is compared at 16 phases of each period with that of
    the period before, of the one before that, and so on up to `largest_multiple`. With a `section`
    the channels at its crossings are, and the times between these.

    ```python
    import math

    import clearjoint as cj

    scene, state = cj.mechanisms.slider_crank(0.1e-3, speed=500.0)
    settled = cj.settle(scene, state, period=2 * math.pi / 500.0, periods=20)
    print(settled)
    solution = cj.simulate(scene, settled.state, settled.time + 0.01, start_time=settled.time)
    ```

    **Arguments:**

    - `scene`, `state`, `start_time` s: as in `simulate`; memory and ledger are continued.
    - `settings`: how to integrate; `clearjoint.presets.accurate` unless given.
    - `period`: s, that of all that depends on time: 2 pi over the drive's speed.
    - `section`: instead of a period, where the motion decides; its `count` and `after` have no
      meaning here. `span`: s, a time in which it is crossed once or a few times.
    - `periods`: how many to run at most; `span`s, with a section.
    - `largest_multiple`: of periods after which the motion may repeat itself.
    - `tolerance`: change after a period, in ranges of the motion (of positions, velocities and
      spins), below which it repeats itself, for three periods at least. Of a motion over 0.1 m,
      1e-5 is a micrometre. Integration errors are below it only if `rtol` is well below.
    - `progress`: show a bar.

    **Returns:** a `Settled`, never an error for a motion that does not settle, or for a run that
    fails: its `kind` says so.

    **Raises:** `ValueError` for arguments that no run can use.
    """
    _check(periods, largest_multiple, tolerance)
    rhythm = _rhythm(period, section, span)
    settings = settings_or(settings, presets.accurate)
    now = _Seen(state, start_time, RESULTS.successful, ())
    text = "{l_bar}{bar}| {n_fmt} of {total_fmt} periods [{elapsed}]"
    bar = ProgressBar(
        total=periods, desc="settle", bar_format=text, leave=False, disable=not progress
    )
    with bar:
        while True:
            now = now.after(scene, settings, rhythm)
            bar.update(BLOCK)
            last = BLOCK * len(now.parts) >= periods
            found = _judged(now, rhythm, largest_multiple, tolerance, last)
            if found is not None:
                kind, multiple = found
                return _settled(now, rhythm, start_time, kind, multiple)


@dataclass(frozen=True)
class _Rhythm:
    """When a motion is looked at: each `period`, s, or where it crosses a `section`, about once in
    a period."""

    period: float
    section: Section | None

    def saving(self, start: float) -> Saving:
        """What a run of a block keeps."""
        times = start + self.period * np.arange(1, PHASES * BLOCK + 1) / PHASES
        if self.section is None:
            return Saving(times)
        most = replace(self.section, count=PHASES * BLOCK, after=start)
        return Saving(times, sections={SECTION: most})


@dataclass(frozen=True)
class _Seen:
    """How far the runs have come, and what each kept."""

    state: State
    time: float
    result: RESULTS
    parts: tuple[Solution, ...]

    def after(self, scene: Scene, settings: Settings, rhythm: _Rhythm) -> "_Seen":
        """After one more block."""
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
        return _Seen(solution.final, float(solution.time), solution.result, parts)

    def states(self) -> State:
        """The states at all phases of all periods."""
        return jax.tree.map(lambda *rows: np.concatenate(rows), *(p.states for p in self.parts))

    def crossings(self) -> tuple[np.ndarray, list[np.ndarray]]:
        """Times (n,) s of all crossings of the section, and each channel there, (n,)."""
        found = [part.sections[SECTION] for part in self.parts]
        times = np.concatenate([np.asarray(one.times) for one in found])
        names = found[0].values
        return times, [np.concatenate([np.asarray(one.values[n]) for one in found]) for n in names]

    def strobe(self, rhythm: _Rhythm) -> Strobe:
        """The motion, period by period."""
        if rhythm.section is None:
            return strobe_of(self.states(), PHASES)
        return section_strobe(*self.crossings())


def _judged(
    now: _Seen, rhythm: _Rhythm, largest_multiple: int, tolerance: float, last: bool
) -> tuple[Settling, int | None] | None:
    """How the motion has settled, and with how many periods; ``None`` if it may still do."""
    if now.result != RESULTS.successful:
        return Settling.FAILED, None
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
    now: _Seen, rhythm: _Rhythm, start_time: float, kind: Settling, multiple: int | None
) -> Settled:
    """What is told of the motion."""
    finished = replace(now, parts=tuple(p for p in now.parts if p.result == RESULTS.successful))
    strobe = finished.strobe(rhythm) if finished.parts else Strobe(np.zeros((0, 1)), np.ones(1))
    period: float | None = rhythm.period
    if rhythm.section is not None:
        times = finished.crossings()[0] if finished.parts else np.zeros(0)
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
    """When the motion is looked at, of the two ways to say it."""
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
