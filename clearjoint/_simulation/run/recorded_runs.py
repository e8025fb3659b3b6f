"""Runs whose accepted steps are recorded, and the derivatives of their outputs in reverse mode.

Runs at several values of the parameters are computed side by side, in lanes of native code, and so
are the transposes of their steps.
"""

from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..._dynamics.system import System
from ..._export.datasets import Notes
from ..._fields.checks import require
from ..._math.vectors import Condition, Scalar
from ..._native import Native, UnsupportedPrimitiveError, is_native
from ..._native.cells import Cells
from ..._native.compiled import report_fallback
from ..._native.functions import keep_flattened
from ..._native.lanes import LaneLoop, made_lane_loop
from ..._result_codes import result_number
from ...quantities.base import Instant, Quantity
from ..reductions.base import AbstractReduction, result_name
from ..results.solution import SUCCESSFUL, Solution
from ..step.step_state import Step
from ..step.stepping import running
from ..step.types import Numbers
from . import adjoint
from .adjoint import STEPS, Adjoint, Pulled, PulledSteps, example_of, like
from .outputs import REDUCTIONS, Requested
from .run_loop import Progress

KEPT_BYTES = 30_000_000
"""Bytes of recorded steps kept of a run. The backward loop computes those of other segments
again."""
LANE_ROWS = 256
"""Largest number of steps of a lane between two visits of Python. Eight lanes then occupy some
megabytes, which is near to the size of the processor's second cache."""
T = TypeVar("T")


class _Segment(NamedTuple):
    """A part of a run: the numbers of the `Step` before it, the `ends` of its M steps, s, and their
    `rows`, (M, n). Rows that are not kept are ``None``, to be computed again; `picked` has some of
    them, by number in the segment."""

    start: np.ndarray
    ends: np.ndarray
    rows: np.ndarray | None
    picked: Mapping[int, np.ndarray] = MappingProxyType({})


class _Recording(NamedTuple):
    """The segments of a run, the last step, and the tallies of its reductions."""

    segments: list[_Segment]
    last: Step
    tallies: PyTree


class _Samples(NamedTuple):
    """Times, (N,) s since the start of a run, at which quantities are evaluated; `places` are the
    numbers of the steps in which they lie, and `rows`, (N, n), the rows of these. First come the
    times of the requested quantities, then the `instants[name]`, s, of reductions."""

    times: np.ndarray
    places: np.ndarray
    rows: np.ndarray
    instants: dict[str, tuple[float, ...]]


class Recorder:
    """Records runs at values of parameters, and computes outputs and their derivatives.

    **Arguments:** `outputs`: quantities and reductions; `times`: (N,) s, not decreasing, between
    the start and the end of the runs, of the quantities.
    """

    def __init__(self, run: Adjoint, outputs: Requested, times: np.ndarray):
        # Flattening these arguments for each call took as long as a short run.
        self.run, self.outputs = keep_flattened(run), outputs
        self.times = np.asarray(times - run.origin)
        quantities = dict(outputs.quantities)
        for name, reduction in outputs.reductions.items():
            quantities |= _parts_of(name, reduction)
        self.quantities = keep_flattened(quantities)
        self._example: Step | None = None
        # Whether runs can be computed side by side, until native code for them turns out not to be.
        self.has_lanes = is_native()

    def example_like(self, step: Step) -> Step:
        """Return the step of the first call, an example of the structure of all steps."""
        if self._example is None:
            self._example = keep_flattened(step)
        return self._example

    def recorded(self, values: Sequence[PyTree]) -> "list[RecordedRun]":
        recordings: dict[int, _Recording] = {}
        if len(values) > 1 and self.has_lanes:
            recordings = self._or_refused(lambda: _in_lanes(self, values)) or {}
        return [
            RecordedRun(self, at, recordings[k] if k in recordings else _recorded(self, at))
            for k, at in enumerate(values)
        ]

    def gradients(
        self, runs: "Sequence[RecordedRun]", cotangents: Sequence[dict[str, np.ndarray]]
    ) -> list[PyTree]:
        """Return for each run the derivatives, by all parameters, of the sum of its outputs times
        its cotangents. A run may occur several times, with different cotangents."""

        def seeds_of(number: int) -> Seeds:
            return runs[number].pulled_outputs(cotangents[number])

        slopes = None
        if len(runs) > 1 and self.has_lanes and all(run.is_kept() for run in runs):
            slopes = self._or_refused(lambda: _gradients_in_lanes(self, runs, seeds_of))
        return slopes or [run.gradient(seeds_of(number)) for number, run in enumerate(runs)]

    def _or_refused(self, function: Callable[[], T]) -> T | None:
        try:
            return function()
        except UnsupportedPrimitiveError as error:
            self.has_lanes = False
            report_fallback(error)
            return None


class RecordedRun:
    """A run with its accepted steps, from which values and derivatives of outputs follow.

    - `last`: the step at its end. If the run has failed, the values and derivatives at times that
      it has not reached are meaningless.
    - `bytes_kept`: bytes of the recorded steps.
    """

    def __init__(self, recorder: Recorder, at: PyTree, recording: _Recording):
        self.recorder, self.at = recorder, at
        self.segments, self.last, self._tallies = recording
        self.example = recorder.example_like(self.last)
        self.bytes_kept = sum(s.rows.nbytes for s in self.segments if s.rows is not None)
        ended = adjoint.ended(recorder.run, at, self.last, self._tallies)
        self._final, self._result, self._results = ended

    def rows_of(self, segment: _Segment) -> np.ndarray:
        if segment.rows is not None:
            return segment.rows
        start = like(self.example, segment.start)
        buffer = adjoint.segment(self.recorder.run, self.at, start, self._tallies)[2]
        return np.asarray(buffer.filled())

    def solution(self, settings: Notes) -> Solution:
        run = self.recorder.run
        return Solution(
            time=float(run.origin) + float(self.last.t),
            final=self._final,
            result=self._result,
            attempts=self.last.attempts,
            accepted=self.last.accepted,
            saved=None,
            saved_count=None,
            steps=None,
            impacts=None,
            formulation=run.scheme.formulation,
            redundant_constraints=(),
            settings=settings,
        )

    @cached_property
    def _samples(self) -> _Samples:
        run, instants = self.recorder.run, {}
        origin, end = float(run.origin), float(run.end)
        for name, reduction in self.recorder.outputs.reductions.items():
            instants[name] = reduction.instants(self._results.get(name, {}), (origin, end))
            # Instants of a window that the run does not reach don't increase, or are not finite.
            row = np.asarray(instants[name])
            is_reached = bool((np.diff(row) > 0.0).all() and np.isfinite(row).all())
            argument, remedy = f"outputs[{name!r}]", "give a window that the run reaches"
            require(is_reached, argument, reduction, "a reduction over a part of the run", remedy)
        further = [t - origin for group in instants.values() for t in group]
        times = np.concatenate([self.recorder.times, further])
        # The step in which a time lies is the first that ends at or after it. If the run fails,
        # that of later times is its last one.
        ends = np.concatenate([segment.ends for segment in self.segments])
        places = np.minimum(np.searchsorted(ends, times), len(ends) - 1)
        return _Samples(times, places, self._rows_at(places), instants)

    def _rows_at(self, places: np.ndarray) -> np.ndarray:
        rows: dict[int, np.ndarray] = {}
        first = 0
        for segment in self.segments:
            last = first + len(segment.ends)
            numbers = np.unique(places[(first <= places) & (places < last)] - first).tolist()
            known = segment.picked if segment.rows is None else segment.rows
            if segment.rows is None and not segment.picked.keys() >= set(numbers):
                known = self.rows_of(segment)
            rows |= {first + k: known[k] for k in numbers}
            first = last
        return np.stack([rows[int(k)] for k in places])

    def values(self) -> dict[str, np.ndarray]:
        """Return the quantities, (N,) each, at N times, and the results of the reductions."""
        return self._combined(self._sampled)

    @cached_property
    def _sampled(self) -> dict[str, np.ndarray]:
        recorder, samples = self.recorder, self._samples
        shared = recorder.run, self.at, self.example, recorder.quantities
        pieces = [
            adjoint.values_at(*shared, self._repeated(rows), times)
            for rows, times in _pieces(samples.rows, samples.times)
        ]
        return jax.tree.map(lambda *parts: np.concatenate(parts)[: len(samples.times)], *pieces)

    def _repeated(self, rows: np.ndarray) -> np.ndarray:
        # These numbers are several times as many as those of the rows, and are not kept.
        return np.asarray(adjoint.repeated(self.recorder.run, self.at, self.example, rows))

    def _combined(self, sampled: dict[str, Numbers]) -> dict[str, Numbers]:
        """Return the outputs from values of the quantities at the times of `_samples`."""
        outputs, first = self.recorder.outputs, len(self.recorder.times)
        combined = {name: sampled[name][:first] for name in outputs.quantities}
        for name, reduction in outputs.reductions.items():
            instants = self._samples.instants[name]
            last = first + len(instants)
            columns = [sampled[part][first:last] for part in _parts_of(name, reduction)]
            for part, value in reduction.combined(jnp.stack(columns, axis=1), instants).items():
                combined[result_name(name, part)] = value
            first = last
        return combined

    def pulled_outputs(self, cotangents: dict[str, np.ndarray]) -> "Seeds":
        """Pull cotangents of the outputs, (N,) for a quantity and numbers for a reduction, back to
        the steps in which the outputs are evaluated."""
        recorder, samples = self.recorder, self._samples
        if recorder.outputs.reductions:
            (cotangents,) = jax.device_get(jax.vjp(self._combined, self._sampled)[1](cotangents))
        shared, pulled = (recorder.run, self.at, self.example, recorder.quantities), []
        total = jax.tree.map(np.zeros_like, self.at)
        for rows, times, seeds in _pieces(samples.rows, samples.times, cotangents):
            steps = self._repeated(rows)
            of_piece, by_direction = adjoint.pulled_outputs(*shared, steps, times, seeds)
            pulled.append(np.asarray(of_piece))
            total = jax.tree.map(np.add, total, by_direction)
        return Seeds(total, np.concatenate(pulled)[: len(samples.times)], samples.places)

    @property
    def places(self) -> np.ndarray:
        """Numbers of the steps in which quantities are evaluated."""
        return self._samples.places

    def is_kept(self) -> bool:
        return all(segment.rows is not None for segment in self.segments)

    def gradient(self, seeds: "Seeds") -> PyTree:
        """Return the derivatives by all parameters of the sum of tangents times `seeds`."""
        now = Pulled(np.asarray(0), np.zeros(_count_of_tangents(self.example)), seeds.total)
        first = sum(len(segment.ends) for segment in self.segments)
        last = seeds.steps_needed()
        for segment in reversed(self.segments):
            first -= len(segment.ends)
            count = min(len(segment.ends), last - first)
            if count <= 0:
                continue
            rows = self.rows_of(segment)
            rows = np.pad(rows, ((0, adjoint.ROWS - len(rows)), (0, 0)))
            steps = seeds.steps(rows, first, first + count, min(len(seeds.places), adjoint.ROWS))
            now = now._replace(count=np.asarray(count))
            now = adjoint.backward(self.recorder.run, self.at, self.example, steps, now)
        return self.gradient_from(now)

    def gradient_from(self, start: Pulled) -> PyTree:
        """Return the derivatives by all parameters from the cotangents before the first step."""
        before = jax.device_get(like(self.example.tangents, start.cotangents))
        first = self._rows_at(np.zeros(1, int))[0]
        along = adjoint.pulled_start(self.recorder.run, self.at, self.example, first, before)
        return jax.tree.map(np.add, start.total, along)


def _pieces(rows: np.ndarray, times: np.ndarray, *cotangents: PyTree) -> Iterator[tuple]:
    """Yield N rows, their times and cotangents, in pieces of `ROWS`. The last of several pieces is
    filled up by copies of the last row, with zero cotangents; a single piece may be shorter."""
    missing = -len(rows) % adjoint.ROWS if len(rows) > adjoint.ROWS else 0

    def filled(column: np.ndarray, mode: str) -> np.ndarray:
        return np.pad(column, [(0, missing)] + [(0, 0)] * (np.ndim(column) - 1), mode)  # pyright: ignore

    columns = filled(rows, "edge"), filled(times, "edge")
    columns += jax.tree.map(lambda column: filled(column, "constant"), cotangents)
    for k in range(0, len(rows), adjoint.ROWS):
        yield jax.tree.map(lambda column, k=k: column[k : k + adjoint.ROWS], columns)


def _count_of_tangents(example: Step) -> int:
    return sum(map(np.size, jax.tree.leaves(example.tangents)))


class Seeds(NamedTuple):
    """Cotangents with which a backward loop begins.

    - `total`: of the direction of the parameters at fixed tangents.
    - `pulled`: (K, m), of the `StepTangents` of the steps with the numbers `places`, (K,).
    """

    total: PyTree
    pulled: np.ndarray
    places: np.ndarray

    def steps_needed(self) -> int:
        """Return the number of the run's steps up to the last one that has cotangents."""
        places = self.places[self.pulled.any(axis=1)]
        return int(places.max(initial=-1)) + 1

    def steps(self, rows: np.ndarray, first: int, last: int, room: int) -> PulledSteps:
        """Return the steps with the numbers `first` to `last` - 1 of the run. Their rows are the
        first ones of `rows`, and `room` of them may have cotangents."""
        # Row 0 of `added` stays zero, for steps without cotangents. Steps in which outputs are
        # evaluated at several times get the sum of their cotangents.
        added = np.zeros((room + 1, self.pulled.shape[1]))
        places = np.zeros(len(rows), int)
        here = np.flatnonzero((first <= self.places) & (self.places < last))
        numbers, order = np.unique(self.places[here] - first, return_inverse=True)
        np.add.at(added, order + 1, self.pulled[here])
        places[numbers] = np.arange(1, len(numbers) + 1)
        return PulledSteps(rows, added, places)


def _recorded(recorder: Recorder, at: PyTree) -> _Recording:
    run, kept = recorder.run, 0
    own_end, limit = float(run.end - run.origin), int(run.max_steps)
    step, tallies = adjoint.begun(run, at)
    segments: list[_Segment] = []
    while (
        float(step.t) < own_end
        and int(step.attempts) < limit
        and result_number(step.result) == SUCCESSFUL
    ):
        after, tallies, buffer = adjoint.segment(run, at, step, tallies)
        rows = np.asarray(buffer.filled())
        kept += rows.nbytes
        segments.append(_Segment(_numbers_of(step), rows[:, -1].copy(), rows))
        if kept > KEPT_BYTES:
            segments[-1] = _without_rows(segments[-1], recorder.times)
        # The leaves are views of the memory of a whole call.
        step = jax.tree.map(np.array, after)
    return _Recording(segments, step, tallies)


def _without_rows(segment: _Segment, times: np.ndarray) -> _Segment:
    """Return a segment with the rows of its first step and of the steps in which `times` lie."""
    assert segment.rows is not None
    numbers = np.unique([0, *np.searchsorted(segment.ends, times)])
    last = len(segment.ends) - 1
    numbers = np.minimum(numbers, last)
    return segment._replace(rows=None, picked={int(k): segment.rows[k].copy() for k in numbers})


def _numbers_of(step: Step) -> np.ndarray:
    leaves = jax.tree.leaves(step)
    return np.concatenate([np.ravel(np.asarray(leaf, float)) for leaf in leaves])


# Runs side by side.


@Native
def _begun_lane(run: Adjoint, values: PyTree) -> Progress:
    return run.start(values, LANE_ROWS)


def _stepped_lane(run: Adjoint, values: PyTree, now: Progress) -> Progress:
    goes = _status_of_lane(run, values, now)["moves"]
    return run.loop(values, LANE_ROWS).advance(now, goes)


def _status_of_lane(run: Adjoint, values: PyTree, now: Progress) -> dict[str, Condition]:
    runs = running(now.step, run.own_end, run.max_steps)
    return {"runs": runs, "moves": runs & jnp.logical_not(now.records[STEPS].is_full())}


def _pulled_lane(
    shared: tuple[Adjoint, Step], own: tuple[PyTree, PulledSteps], now: Pulled
) -> Pulled:
    (run, example), (values, steps) = shared, own
    return adjoint.pulled(run, values, example, steps, now)


def _status_of_pulled_lane(shared: PyTree, own: PyTree, now: Pulled) -> dict[str, Condition]:
    return {"moves": now.count > 0}


def _through(
    loop: LaneLoop,
    shared: PyTree,
    count: int,
    begin: Callable[[int], tuple[np.ndarray, np.ndarray]],
    serve: Callable[[int, np.ndarray, bool], bool],
) -> None:
    """Run the lanes 0 to `count` - 1 in the columns of a loop. `begin` returns the cells of a
    lane's own data and of its state. Whenever the loop returns, `serve` gets the cells of each
    lane's column and whether it moves, and returns whether it goes on."""
    columns, waiting = loop.columns(shared), deque(range(count))
    # The lane in each column; ``None`` for an empty one.
    slots: list[int | None] = [None] * loop.width
    while True:
        for column, lane in enumerate(slots):
            if lane is None and waiting:
                lane = slots[column] = waiting.popleft()
                loop.write_lane(columns, column, *begin(lane))
        if all(lane is None for lane in slots):
            return
        loop.run(columns)
        moves = loop.status_of(columns)["moves"].tolist()
        for column, lane in enumerate(slots):
            if lane is not None and not serve(lane, columns.floats[:, column], moves[column]):
                loop.leave(columns, column)
                slots[column] = None


def _in_lanes(recorder: Recorder, values: Sequence[PyTree]) -> dict[int, _Recording]:
    """Record runs side by side, and return by number those that are short enough to be kept."""
    run, own = recorder.run, Cells(values[0])
    recordings: dict[int, _Recording] = {}
    # Rows that the host has read so far, by the number of the run.
    rows_of_runs: dict[int, list[np.ndarray]] = defaultdict(list)
    begin_rows = _begun_lane.native.bound(run, values[0])
    stacked = jax.tree.map(lambda *leaves: np.stack(leaves), *values)
    # Cells of the parameters of all runs, (runs, cells), and layout of a lane's state.
    parameters, cells = own.rows(stacked), begin_rows.results
    first = cells.tree(begin_rows(parameters[:1])[0])
    loop = made_lane_loop(_stepped_lane, _status_of_lane, (run, values[0], first))
    # Cells, in a lane's column, of the buffer of accepted steps: its rows and their count.
    places = cells.columns().records[STEPS]
    start, width = loop.state_cells.start, places.rows.shape[1]
    rows_from, count_at = start + int(places.rows[0, 0]), start + int(places.count)
    runs_at = loop.status["runs"].start

    def begin(number: int) -> tuple[np.ndarray, np.ndarray]:
        return parameters[number], begin_rows(parameters[number][None])[0]

    def serve(number: int, column: np.ndarray, moves: bool) -> bool:
        integers = column.view(np.int64)
        count = int(integers[count_at])
        # Lanes that will soon be full are emptied with those that are, since they would stop all.
        if moves and count < LANE_ROWS // 2:
            return True
        rows = column[rows_from : rows_from + count * width].reshape(count, width)
        read = rows_of_runs[number]
        read.append(np.array(rows))
        integers[count_at] = 0
        # The run goes on with an empty buffer, unless it has too many steps to be kept.
        if integers[runs_at]:
            if sum(rows.nbytes for rows in read) <= KEPT_BYTES:
                return True
            del rows_of_runs[number]
            return False
        last = cells.tree(column[loop.state_cells])
        rows = np.concatenate(rows_of_runs.pop(number))
        # All rows are kept, so that no segment is computed again from a `start`.
        pieces = (rows[k : k + adjoint.ROWS] for k in range(0, len(rows), adjoint.ROWS))
        segments = [_Segment(np.zeros(0), piece[:, -1].copy(), piece) for piece in pieces]
        recordings[number] = _Recording(segments, last.step, last.records[REDUCTIONS])
        return False

    _through(loop, run, len(values), begin, serve)
    return recordings


@dataclass
class _PulledLane:
    """A run whose cotangents are pulled back from its end. Its steps from the number `first` on
    have been given to the lane."""

    run: RecordedRun
    rows: np.ndarray
    seeds: Seeds
    first: int

    def next_steps(self, left: int, room: int) -> tuple[PulledSteps, int]:
        """Return the next steps to pull back through, and their number: first the `left` ones that
        were given before and are not done."""
        last = self.first + left
        self.first = max(0, last - LANE_ROWS)
        rows = np.zeros((LANE_ROWS, self.rows.shape[1]))
        rows[: last - self.first] = self.rows[self.first : last]
        return self.seeds.steps(rows, self.first, last, room), last - self.first


def _gradients_in_lanes(
    recorder: Recorder, runs: Sequence[RecordedRun], seeds_of: Callable[[int], Seeds]
) -> list[PyTree]:
    # A lane pulls the cotangents of one run back. Its own data are the parameters and up to
    # `LANE_ROWS` steps; when it has passed most of these, they are replaced by the steps before.
    example = runs[0].example
    slopes: list[PyTree] = [None] * len(runs)
    room = min(len(runs[0].places), LANE_ROWS)
    # How many numbers the tangents have, the `StepTangents` of a step, and the row of a step.
    tangents = _count_of_tangents(example)
    inside = sum(map(np.size, jax.tree.leaves(example_of(recorder.run, example))))
    width = runs[0].rows_of(runs[0].segments[0]).shape[1]
    # Examples of a lane's data and state, for the loop's layout.
    steps = PulledSteps(
        np.zeros((LANE_ROWS, width)), np.zeros((room + 1, inside)), np.zeros(LANE_ROWS, int)
    )
    none = jax.tree.map(np.zeros_like, runs[0].at)
    own = runs[0].at, steps
    state = Pulled(np.asarray(0), np.zeros(tangents), none)
    shared = recorder.run, example
    loop = made_lane_loop(_pulled_lane, _status_of_pulled_lane, (shared, own, state))
    own_cells, steps_cells, state_cells = Cells(own), Cells(steps), Cells(state)
    # In a lane's column: the cells of its steps, the last ones of its own data, and that of the
    # number of steps through which to pull back.
    steps_at = slice(loop.own_cells.stop - steps_cells.size, loop.own_cells.stop)
    count_at = loop.state_cells.start + int(state_cells.columns().count)

    def begin(number: int) -> tuple[np.ndarray, np.ndarray]:
        run, seeds = runs[number], seeds_of(number)
        rows = np.concatenate([run.rows_of(segment) for segment in run.segments])
        lane = lanes[number] = _PulledLane(run, rows, seeds, seeds.steps_needed())
        steps, count = lane.next_steps(0, room)
        after = Pulled(np.asarray(count), np.zeros(tangents), seeds.total)
        return own_cells.row((run.at, steps)), state_cells.row(after)

    def serve(number: int, column: np.ndarray, moves: bool) -> bool:
        lane, left = lanes[number], int(column[count_at : count_at + 1].view(np.int64)[0])
        # Lanes that will soon be through are served with those that are, since they would stop all.
        if moves and left > LANE_ROWS // 2:
            return True
        if left == 0 and lane.first == 0:
            slopes[number] = lane.run.gradient_from(state_cells.tree(column[loop.state_cells]))
            del lanes[number]
            return False
        steps, count = lane.next_steps(left, room)
        column[steps_at] = steps_cells.row(steps)
        column[count_at : count_at + 1].view(np.int64)[0] = count
        return True

    lanes: dict[int, _PulledLane] = {}
    _through(loop, shared, len(runs), begin, serve)
    return slopes


def _parts_of(name: str, reduction: AbstractReduction) -> dict[str, Quantity]:
    """Return the quantities by which a reduction is differentiated, by names that no output has."""
    observed = {f"{name}/{k}": of for k, of in enumerate(reduction.observed())}
    integrals = {key: _Work(key) for key in integrands_of({name: reduction})}
    return {**observed, **integrals}


class _Work(eqx.Module):
    """Quantity: the integral of an integrand from the start of the run."""

    key: str = eqx.field(static=True)

    def __call__(self, now: Instant) -> Scalar:
        return now.work[self.key]


class Integrand(eqx.Module):
    """A quantity that is integrated with the state, as a `Formulation` takes it."""

    quantity: Quantity = eqx.field(static=True)

    def __call__(self, system: System, t: Scalar, motion: PyTree, *parts: PyTree) -> Scalar:
        entry_speeds, bristles, memory = parts  # in the order of `Formulation.integrands`
        return self.quantity(Instant(system, t, motion, entry_speeds, {}, bristles, memory))


def integrands_of(reductions: Mapping[str, AbstractReduction]) -> dict[str, Integrand]:
    """Return the integrands of reductions, by names that no output can have."""
    return {
        f"{name}/integral {k}": Integrand(quantity)
        for name, reduction in reductions.items()
        for k, quantity in enumerate(reduction.integrands())
    }
