"""Execution of a run: in compiled segments called from Python, or traced as part of a computation.

A segment is a number of steps that compiled code takes before it returns to Python. It ends at the
end time, after the last time to save at, after a number of attempts, at a failure, or when a buffer
of steps or impacts is full. Python then empties these buffers and shows progress.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import reduce
from operator import and_
from typing import NamedTuple, TypeAlias, TypeVar

import equinox as eqx
import equinox.internal as eqxi
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..._dynamics.journals import any_slid_out
from ..._dynamics.system import System
from ..._export.datasets import Notes
from ..._math.vectors import Condition, ConstantFolded, Scalar, pack, unpack
from ..._model.bodies import State
from ..._native import Native
from ..._native.functions import FlatArguments
from ..._result_codes import RESULTS, result_number
from ...quantities.base import Quantity
from ..reductions.base import AbstractReduction, result_name
from ..results.impact_table import Impacts
from ..results.solution import SUCCESSFUL, Solution, Trajectory
from ..step.dense_output import Snapshot, look_inside
from ..step.method import Scheme
from ..step.step_state import Step, without_weak_types
from ..step.types import Numbers
from .impact_recorder import ImpactRecorder, impact_rows_of
from .outputs import REDUCTIONS, Requested
from .recorders import ROWS, LatestAttempt, RowBuffer, StepRecorder, TimedState
from .run_loop import Progress, Recorders, Records, RunLoop, begin_run, final_result
from .terminal import ProgressBar, interruptions_deferred

STEP_ROWS, IMPACT_ROWS = 4096, ROWS
"""Numbers of rows of the buffers of accepted steps, and of each contact's impacts. When one is
full, compiled code returns to Python. Every accepted step writes a row, but few end an impact."""
LATEST, STEPS, IMPACTS = "latest", "steps", "impacts"
"""Keys of recorders and of records beside those of the outputs: the latest accepted attempt, the
states at the start and after accepted steps, and the impacts of all contacts."""


def recorders_of(requested: Requested) -> dict[str, Recorders]:
    save, recorders = requested.save, requested.recorders()
    if save.times is not None:
        recorders[LATEST] = LatestAttempt()
    if save.steps:
        recorders[STEPS] = StepRecorder(STEP_ROWS)
    if save.impacts:
        recorders[IMPACTS] = ImpactRecorder(capacity=IMPACT_ROWS)
    return recorders


class Status(NamedTuple):
    """What Python needs of a run after a segment: time `t`, s, number of attempts, result code."""

    t: Scalar
    attempts: Scalar
    result: RESULTS


SavedRows: TypeAlias = tuple[State, dict[str, Numbers]]
"""States, with vectors as separate scalars, and values of quantities by name, at some times."""


def begin(
    scheme: Scheme,
    folded_scene: ConstantFolded,
    state: State,
    t0: Scalar,
    t_end: Scalar,
    first_step: Scalar,
    recorders: Recorders,
) -> tuple[Step, Records, Status]:
    """Return a run before its first step. `state` has vectors as arrays, `first_step` is in s."""
    method, system = scheme.method, scheme.system(unpack(folded_scene))
    step = begin_run(method, system, state, t0, t_end, first_step)
    now = without_weak_types(RunLoop(method, system, t_end, recorders).start(step))
    return now.step, now.records, _status(now.step)


def segment(
    scheme: Scheme,
    folded_scene: ConstantFolded,
    recorders: Recorders,
    step: Step,
    records: Records,
    save_times: Numbers | None,
    t_end: Scalar,
    attempts: Scalar,
    quantities: Mapping[str, Quantity],
) -> tuple[Step, Records, Status, tuple[SavedRows, jax.Array] | None]:
    """Continue a run until its end, a failure, the limit of `attempts` since the start of the run,
    a full buffer, or the last of the `save_times`, (N,) s, whichever comes first. With
    `save_times`, `recorders` must contain a `LatestAttempt` at the key `LATEST`.

    **Returns:** the run after the segment: its step, records and status; and, unless `save_times`
    is ``None``, a pair of the `SavedRows` of `quantities` at the N times, and whether the run has
    reached each time, (N,). Rows at a time that it has not reached are meaningless.
    """
    method, system = scheme.method, scheme.system(unpack(folded_scene))
    loop = RunLoop(method, system, t_end, recorders)

    def save_next(now: Progress, time: Scalar) -> tuple[Progress, tuple[SavedRows, jax.Array]]:
        # Steps are not shortened to end at the save time, because saving must not change the
        # motion. The state there is interpolated.
        now = loop.until(time, now, attempts, _has_room)
        inside = look_inside(method, system, now.records[LATEST], time)
        samples = inside.state(system), inside.values(system, quantities)
        return now, (samples, jnp.asarray(time <= now.step.t))

    now, saved = Progress(step, records), None
    if save_times is None:
        now = loop.until(t_end, now, attempts, _has_room)
    else:
        now, saved = jax.lax.scan(save_next, now, save_times)
    return now.step, now.records, _status(now.step), saved


def _status(step: Step) -> Status:
    return Status(step.t, step.attempts, step.result)


def emptied(records: Records) -> Records:
    """Return the records with empty buffers of steps and impacts. Buffers of sections are not
    emptied: they have room for all crossings that a section keeps."""
    read = {key: records[key] for key in (STEPS, IMPACTS) if key in records}
    empty = jax.tree.map(lambda p: p.emptied() if _is_buffer(p) else p, read, is_leaf=_is_buffer)
    return records | empty


def _has_room(now: Progress) -> Condition:
    parts = jax.tree.leaves([now.records.get(k) for k in (STEPS, IMPACTS)], is_leaf=_is_buffer)
    room = [jnp.logical_not(part.is_full()) for part in parts if isinstance(part, RowBuffer)]
    return reduce(and_, room, jnp.asarray(True))


def _is_buffer(tree: object) -> bool:
    return isinstance(tree, RowBuffer)


T = TypeVar("T")
REVERSE_MODE = (
    "`simulate` can't be differentiated in reverse mode. Call clearjoint.predictor, whose "
    "derivatives are those of the exact motion, or for few parameters clearjoint.sensitivities."
)
ATTEMPTS_A_SEGMENT = 50_000
"""Largest number of attempts in a segment, after which progress is shown and Ctrl-C obeyed."""
SAVES_A_SEGMENT = 512
"""Number of times to save at that a segment receives; compiled into the program."""
segment_compiled = Native(segment)


@dataclass(frozen=True)
class Run:
    """A run that is ready to start, to the time `end`, s. `save_at`: (N,) s, times to save at, or
    ``None`` if nothing is saved at times; `redundant`: names of the redundant constraints."""

    folded_scene: ConstantFolded
    scheme: Scheme
    requested: Requested
    recorders: Recorders
    end: Scalar
    save_at: Numbers | None
    max_steps: int
    redundant: tuple[str, ...]

    def in_one_piece(self, step: Step, records: Records, admissible: Condition | None) -> Solution:
        """Run to the end inside a computation that JAX traces, such as under `jax.vmap`, and return
        a `Solution` of traced arrays, without steps and impacts. Saved states and values of
        quantities at times that the run did not reach are meaningless. If `admissible` is false
        (``None``: no condition), the run ends at once, with the result `domain`."""
        if admissible is not None:
            # With another result than `successful`, the loop of steps takes no step.
            step = replace(step, result=RESULTS.where(admissible, step.result, RESULTS.domain))
        # The end is a further time to save at, so that the run continues after the last of the
        # requested times.
        times = None if self.save_at is None else jnp.append(self.save_at, self.end)
        program, quantities = (self.scheme, self.folded_scene), self.requested.quantities
        rest = step, records, times, self.end, jnp.asarray(self.max_steps), quantities
        run = segment(*program, self.recorders, *rest)
        # JAX's own error about the loops of steps does not say what to call instead.
        step, _, _, saved = eqxi.nondifferentiable_backward(run, msg=REVERSE_MODE)
        # There are no reductions to end, since traced runs refuse them.
        ended, _ = _end_of(*program, reductions={}, tallies={}, step=step, end=self.end)
        trajectory, count, values = None, None, {}
        if saved is not None:
            # Leave out the last row, the state at the end of the run, which was added above.
            (states, values), reached = jax.tree.map(lambda leaf: leaf[:-1], saved)
            if self.requested.save.states:
                trajectory, count = Trajectory(self.save_at, pack(states)), reached.sum()
        return Solution(
            time=ended.time,
            final=ended.final,
            result=ended.result,
            attempts=ended.attempts,
            accepted=ended.accepted,
            saved=trajectory,
            saved_count=count,
            steps=None,
            impacts=None,
            formulation=self.scheme.formulation,
            redundant_constraints=self.redundant,
            outputs=values,
        )

    def on_host(
        self, step: FlatArguments, records: Records, status: Status, progress: bool, notes: Notes
    ) -> tuple[Solution, bool, bool]:
        """Run in segments to the end, or to a failure, the limit of attempts or an interruption.
        `step`, `records` and `status` are the results of `begin`.

        **Returns:** the solution, whose `settings` are the `notes`; whether Ctrl-C was pressed,
        after which the present segment is the last; and whether a journal has slid out.
        """
        start = float(status.t)
        # The end time in the precision of the run. Rounded to float32, an end time such as 0.02 s
        # may become smaller, and a run in float32 would never reach the unrounded number.
        end = float(np.asarray(self.end, status.t.dtype))  # pyright: ignore
        saved = _SavedBySegments(self.save_at)
        # No bar is shown in the first two seconds of computing (`delay`).
        text = "{l_bar}{bar}| {n:.4g} s of {total:.4g} s [{elapsed}<{remaining}]"
        bar = ProgressBar(progress, total=end - start, desc="simulated", bar_format=text, delay=2.0)
        with bar, interruptions_deferred() as stopped:
            ended = interrupted = False
            while not (ended or interrupted):
                # Segments are short, because the bar is updated and Ctrl-C is obeyed only between
                # them.
                limit = np.asarray(min(int(status.attempts) + ATTEMPTS_A_SEGMENT, self.max_steps))
                program = self.scheme, self.folded_scene, self.recorders
                rest = saved.next_times(end), self.end, limit, self.requested.quantities
                # The step stays flattened for the next call. The other results are read here.
                step, *others = segment_compiled.in_parts(*program, step, records, *rest)
                records, status, sampled = (part.tree for part in others)
                records = saved.add(records, sampled)
                bar.update(float(status.t) - start - bar.n)
                failed = result_number(status.result) != SUCCESSFUL
                ended = failed or int(status.attempts) >= self.max_steps
                # A segment also ends after `SAVES_A_SEGMENT` saves. So the run may have reached its
                # end time while states are still to be saved.
                ended = ended or (float(status.t) >= end and saved.complete)
                # Also in the last segment: otherwise a loop of short runs could not be interrupted.
                interrupted = stopped()
        solution, slid_out = self._solution(step, records, saved, notes)
        return solution, interrupted, slid_out

    def _solution(
        self, step: FlatArguments, records: Records, saved: "_SavedBySegments", notes: Notes
    ) -> tuple[Solution, bool]:
        """Return the solution of a run that has ended, and whether a journal has slid out. `step`:
        the last one; `notes`: the `settings` of the solution."""
        reductions, tallies = self.requested.reductions, records[REDUCTIONS]
        arguments = self.scheme, self.folded_scene, reductions, tallies, step, self.end
        # `in_parts` takes the flattened step, and flattens both results: `tree` is the PyTree.
        ended, slid_out = (part.tree for part in _end_compiled.in_parts(*arguments))
        time, attempts, accepted = jax.device_get((ended.time, ended.attempts, ended.accepted))
        # States are sampled along with quantities, even if only these are wanted.
        states, values = saved.samples()
        trajectory = states if self.requested.save.states else None
        reduced = {
            result_name(name, part): float(value)
            for name, parts in jax.device_get(ended.results).items()
            for part, value in parts.items()
        }
        solution = Solution(
            time=time,
            final=ended.final,
            result=ended.result,
            attempts=attempts,
            accepted=accepted,
            saved=trajectory,
            saved_count=None if trajectory is None else saved.count,
            steps=saved.steps() if STEPS in records else None,
            impacts=Impacts.of_rows(saved.impact_rows) if IMPACTS in records else None,
            formulation=self.scheme.formulation,
            redundant_constraints=self.redundant,
            outputs={**values, **self.requested.recorded(records), **reduced},
            settings=notes,
        )
        return solution, bool(slid_out)


class _SavedBySegments:
    """What the segments of a run have saved: rows at times, states after steps, and impacts.
    `save_at`: the times to save at, (N,) s, or ``None``. `count`: how many of these times have
    been reached, and have their `SavedRows`."""

    def __init__(self, save_at: Numbers | None) -> None:
        self.save_at = save_at
        self.count = 0
        self.impact_rows: list[tuple[str | float, ...]] = []
        self._samples: list[SavedRows] = []
        self._steps: list[TimedState] = []

    @property
    def complete(self) -> bool:
        return self.save_at is None or self.count == len(self.save_at)

    def next_times(self, end: float) -> np.ndarray | None:
        """Return the next times to save at, s, filled up with copies of the `end` of the run to
        `SAVES_A_SEGMENT` numbers; ``None`` if nothing is saved at times."""
        if self.save_at is None:
            return None
        following = self.save_at[self.count :][:SAVES_A_SEGMENT]
        return np.pad(following, (0, SAVES_A_SEGMENT - len(following)), constant_values=end)

    def add(self, records: Records, sampled: tuple[SavedRows, jax.Array] | None) -> Records:
        """Keep the results `records` and `sampled` of a `segment`; return the records, emptied."""
        if sampled is not None and self.save_at is not None:
            # Only the first samples are kept. The others are at times that the run has not reached
            # yet, or belong to the filling.
            rows, reached = sampled
            count = int(np.sum(reached[: len(self.save_at) - self.count]))
            self._samples.append(_first_rows(rows, count))
            self.count += count
        if STEPS in records:
            self._steps.append(records[STEPS].filled())
        if IMPACTS in records:
            self.impact_rows += impact_rows_of(records[IMPACTS])
        return emptied(records)

    def samples(self) -> tuple[Trajectory | None, dict[str, Numbers]]:
        if self.save_at is None:
            return None, {}
        states, values = _joined(self._samples)
        return Trajectory(self.save_at[: self.count], pack(states)), values

    def steps(self) -> Trajectory:
        rows = _joined(self._steps)
        return Trajectory(rows.t, pack(rows.state))


class Outcome(eqx.Module):
    """How a run has ended: the time reached, s, the result code, the numbers of steps tried and
    accepted, the final state, with vectors as arrays, and results[name][part] of reductions."""

    time: Scalar
    result: RESULTS
    attempts: Scalar
    accepted: Scalar
    final: State
    results: dict[str, dict[str, Scalar]]


def end_of(
    system: System,
    reductions: dict[str, AbstractReduction],
    tallies: dict[str, PyTree],
    step: Step,
    end: Scalar,
) -> Outcome:
    """Return the outcome of a run whose last step is `step`. `tallies`: what the reductions have
    accumulated by then; `end`: time at which the run should end, s."""
    last = Snapshot.of(step)
    now, final = last.instant(system), pack(last.state(system))
    results = {
        name: reduction.results(tallies[name], now) for name, reduction in reductions.items()
    }
    result = final_result(step, end)
    return Outcome(step.t, result, step.attempts, step.accepted, final, results)


def _end_of(
    scheme: Scheme,
    folded_scene: ConstantFolded,
    reductions: dict[str, AbstractReduction],
    tallies: dict[str, PyTree],
    step: Step,
    end: Scalar,
) -> tuple[Outcome, Condition]:
    """Return the outcome (see `end_of`), and whether a journal has slid out of its bearing."""
    system = scheme.system(unpack(folded_scene))
    outcome = end_of(system, reductions, tallies, step, end)
    return outcome, any_slid_out(unpack(folded_scene), unpack(outcome.final.bodies))


_end_compiled = Native(_end_of)


def _first_rows(tree: T, count: int) -> T:
    return jax.tree.map(lambda leaf: np.array(leaf[:count]), tree)


def _joined(pieces: list[T]) -> T:
    return jax.tree.map(lambda *parts: np.concatenate(parts), *pieces)
