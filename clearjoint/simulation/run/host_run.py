"""Carrying out a run: segment after segment, or in one piece under a transformation."""

from collections.abc import Mapping
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from ...dynamics.journals import any_slid_out
from ...export.provenance import Notes
from ...math.vectors import Condition, ConstantFolded, Scalar, pack, unpack
from ...model.bodies import State
from ...native import Native
from ...result_codes import RESULTS, result_number
from ..results.impact_table import Impacts
from ..results.solution import SUCCESSFUL, Solution, Trajectory
from ..step.dense_output import Snapshot
from ..step.loops import AbstractLoops
from ..step.method import Scheme
from ..step.step_state import Step
from .impact_recorder import impact_rows_of
from .interruptions import interruptions_deferred
from .progress_bars import ProgressBar, telling_of_compiling
from .run_ends import final_result, final_state, named
from .sections import Section, crossings_of, with_units
from .segments import Progress, SavedStates, TimedState, emptied, segment

T = TypeVar("T")
ATTEMPTS_A_SEGMENT = 50_000
SAVES_A_SEGMENT = 512
segment_compiled = Native(segment)


def _end_of(
    scheme: Scheme, folded_scene: ConstantFolded, step: Step, end: Scalar
) -> tuple[State, RESULTS, Condition]:
    """The packed state at the end of a run, how it ended, and whether a journal has slid out."""
    final = final_state(scheme.unpacked(folded_scene), step)
    left = any_slid_out(unpack(folded_scene), final.bodies)
    return pack(final), final_result(step, end), left


_end_compiled = Native(_end_of)


def _results_of(
    scheme: Scheme, folded_scene: ConstantFolded, now: Progress
) -> dict[str, dict[str, Scalar]]:
    """What the reductions of a run report where it is, by their names."""
    system, step = scheme.unpacked(folded_scene), now.step
    here = Snapshot(step.t, step.y, step.entry_speeds).instant(system)
    return {name: one.reduction.results(one.tally, here) for name, one in now.reductions.items()}


_results_compiled = Native(_results_of)


class AbstractRun:
    """A run whose parts are put together as a `Solution`, however it is looped."""

    def __init__(
        self, folded_scene: ConstantFolded, scheme: Scheme, end: Scalar, redundant: tuple[str, ...]
    ):
        self._folded_scene, self._scheme, self._end = folded_scene, scheme, end
        self._redundant = redundant

    def _solution(
        self,
        reached: tuple[Scalar, Scalar, Scalar],
        ending: tuple[State, RESULTS],
        saved: Trajectory | None,
        count: Scalar | None,
        steps: Trajectory | None = None,
        impacts: Impacts | None = None,
        **further: Any,
    ) -> Solution:
        """`reached`: time, s, attempts and accepted steps; `ending`: final state and result."""
        time, attempts, accepted = reached
        return Solution(
            time,
            *ending,
            attempts,
            accepted,
            saved,
            count,
            steps,
            impacts,
            self._scheme.formulation,
            self._redundant,
            **further,
        )


def _reached(step: Step) -> tuple[Scalar, Scalar, Scalar]:
    return step.t, step.attempts, step.accepted


class OnePiece(AbstractRun):
    """The whole run inside one traced computation."""

    def solution(
        self, now: Progress, save_at: jax.Array | None, max_steps: int, loops: AbstractLoops
    ) -> Solution:
        """Run to the end. Rows that were not reached repeat the last state."""
        times = None if save_at is None else jnp.append(save_at, self._end)
        limit = jnp.asarray(max_steps)
        arguments = (self._scheme, self._folded_scene, now, times, self._end, limit)
        now, saved = loops.closed(segment(*arguments, loops))
        final, result, _ = _end_of(self._scheme, self._folded_scene, now.step, self._end)
        ending = final, result
        if saved is None:
            return self._solution(_reached(now.step), ending, None, None)
        states = jax.tree.map(lambda leaf: leaf[:-1], saved.states)
        kept = Trajectory(save_at, pack(states))
        return self._solution(_reached(now.step), ending, kept, saved.reached[:-1].sum())


class HostLoop(AbstractRun):
    """Segment after segment, with what was saved and recorded taken in between.

    `interrupted`: whether a user stopped the run, which then ended behind a segment;
    `left_bearing`: whether a journal had slid out of its bearing at its end.
    """

    interrupted = False
    left_bearing = False

    def solution(
        self,
        now: Progress,
        save_at: np.ndarray | None,
        max_steps: int,
        progress: bool,
        sections: Mapping[str, Section],
        notes: Notes,
    ) -> Solution:
        """Run to the end, a failure, the step limit or an interruption."""
        waiting = _Waiting(save_at, float(self._end))
        steps: list[TimedState] = []
        impacts: list[tuple[str | float, ...]] = []
        start = float(now.step.t)
        bar = ProgressBar(
            total=float(self._end) - start,
            desc="simulated",
            bar_format="{l_bar}{bar}| {n:.4g} s of {total:.4g} s [{elapsed}<{remaining}]",
            delay=2.0,
            leave=False,
            disable=not progress,
        )
        with telling_of_compiling(bar), interruptions_deferred() as stopped:
            while True:
                limit = min(int(now.step.attempts) + ATTEMPTS_A_SEGMENT, max_steps)
                now, saved = segment_compiled(
                    self._scheme,
                    self._folded_scene,
                    now,
                    waiting.chunk(),
                    self._end,
                    np.asarray(limit),
                )
                waiting.take(saved)
                if now.record is not None:
                    steps.append(now.record.filled())
                if now.impacts is not None:
                    impacts += impact_rows_of(jax.device_get(now.impacts))
                now = emptied(now)
                bar.update(float(now.step.t) - start - bar.n)
                ended = self._ended(now, waiting, max_steps)
                self.interrupted = not ended and stopped()
                if ended or self.interrupted:
                    break
        final, result, left = _end_compiled(self._scheme, self._folded_scene, now.step, self._end)
        self.left_bearing = bool(left)
        return self._solution(
            jax.device_get(_reached(now.step)),
            (final, result),
            waiting.trajectory(),
            waiting.count,
            None if now.record is None else _trajectory(steps),
            None if now.impacts is None else Impacts.of_rows(impacts),
            sections=with_units(crossings_of(now.sections), sections),
            outputs=self._outputs(now),
            settings=notes,
        )

    def _outputs(self, now: Progress) -> dict[str, float]:
        """What the reductions report, each number by its own name."""
        if not now.reductions:
            return {}
        found = jax.device_get(_results_compiled(self._scheme, self._folded_scene, now))
        return {
            f"{name}_{part}" if part else name: float(value)
            for name, parts in found.items()
            for part, value in parts.items()
        }

    def _ended(self, now: Progress, waiting: "_Waiting", max_steps: int) -> bool:
        step = now.step
        if result_number(step.result) != SUCCESSFUL or int(step.attempts) >= max_steps:
            return True
        return float(step.t) >= float(self._end) and waiting.done()


class _Waiting:
    """The times still to be saved at, handed out in chunks of fixed size so that their number
    compiles nothing anew; and the states that came back."""

    def __init__(self, times: np.ndarray | None, end: float):
        self._times, self._end = times, end
        self.count = 0
        self._pieces: list[State] = []

    def chunk(self) -> np.ndarray | None:
        """The next times, filled up with the end time."""
        if self._times is None:
            return None
        chunk = np.full(SAVES_A_SEGMENT, self._end)
        following = self._times[self.count :][:SAVES_A_SEGMENT]
        chunk[: len(following)] = following
        return chunk

    def take(self, saved: SavedStates | None) -> None:
        """Keep the states at the requested times that were reached."""
        if saved is None or self._times is None:
            return
        left = len(self._times) - self.count
        reached = int(np.asarray(saved.reached)[:left].sum())
        if reached or not self._pieces:
            # Copies: a slice would keep all rows of its segment, reached or not.
            self._pieces.append(
                jax.tree.map(lambda leaf: np.asarray(leaf)[:reached].copy(), saved.states)
            )
        self.count += reached

    def done(self) -> bool:
        """Whether all times have been saved at."""
        return self._times is None or self.count == len(self._times)

    def trajectory(self) -> Trajectory | None:
        """The states at the times reached."""
        if self._times is None:
            return None
        return Trajectory(self._times[: self.count], pack(_joined(self._pieces)))


def _joined(pieces: list[T]) -> T:
    return jax.tree.map(lambda *parts: np.concatenate(parts), *pieces)


def _trajectory(rows: list[TimedState]) -> Trajectory:
    whole = _joined(rows)
    return Trajectory(whole.t, pack(named(whole.state)))
