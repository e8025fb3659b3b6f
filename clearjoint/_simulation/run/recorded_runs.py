"""Runs whose accepted steps are recorded, and the derivatives of their outputs in reverse mode.

Runs at several values of the parameters are computed side by side, in lanes of native code, and so
are the transposes of their steps.
"""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from types import MappingProxyType
from typing import NamedTuple, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..._dynamics.breakpoints import since_breakpoints
from ..._dynamics.contact_events import changes
from ..._dynamics.system import System
from ..._export.datasets import Notes
from ..._fields.checks import require
from ..._math.vectors import Condition, Scalar
from ..._native import NativeFunction, UnsupportedPrimitiveError, is_native
from ..._native.cells import Cells
from ..._native.compiled import report_fallback
from ..._native.functions import keep_flattened
from ..._native.lanes import made_lane_loop
from ..._result_codes import result_number
from ...quantities.base import Instant, Quantity, number_at
from ..reductions.base import AbstractReduction, result_name
from ..results.solution import SUCCESSFUL, Solution
from ..step.method import SystemFamily
from ..step.step_state import Step
from ..step.stepping import running
from ..step.types import Numbers
from . import adjoint
from .adjoint import STEPS, Adjoint, Pulled, PulledSteps, like
from .outputs import REDUCTIONS, Requested
from .run_loop import Progress

KEPT_BYTES = 30_000_000
"""Bytes of recorded steps up to which the segments of a run are kept. The backward loop computes
the steps of later segments again."""
LANE_ROWS = 256
"""Largest number of steps of a lane between two returns to Python. The steps of eight lanes then
occupy some megabytes, which is near to the size of the processor's second cache."""
T = TypeVar("T")


class _Segment(NamedTuple):
    """M successive steps of a run. `ends`: (M,) s since the start of the run; `rows`: (M, n), a
    `step_row` for each step, or ``None`` if rows are not kept. They are then computed again from
    `start`, the `Step` before the segment, except single rows that are kept nevertheless: `picked`,
    by the index of the step in the segment."""

    ends: np.ndarray
    rows: np.ndarray | None
    start: Step | None = None
    picked: Mapping[int, np.ndarray] = MappingProxyType({})


class _Recording(NamedTuple):
    """The segments of a run, the `last` `Step`, and the tallies of the reductions at the end."""

    segments: list[_Segment]
    last: Step
    tallies: PyTree


class _Samples(NamedTuple):
    """`times`, (N,) s since the start of a run, at which quantities are evaluated: first those of
    the requested quantities, then those of reductions. `places`: (N,), for each time the index in
    the run of the step in which the time lies; `rows`: (N, n), the `step_row` of this step;
    `instants[name]`: s, the times of a reduction again, but as times of the scene."""

    times: np.ndarray
    places: np.ndarray
    rows: np.ndarray
    instants: dict[str, tuple[float, ...]]


class Recorder:
    """Records runs at values of parameters, and computes outputs and their derivatives.

    **Arguments:** `run`: what all runs have in common; `outputs`: quantities and reductions;
    `times`: (N,) s of the scene's time, not decreasing, within the runs, to evaluate quantities at.
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
        # Whether runs are computed side by side; false once native code lacks an operation.
        self.has_lanes = is_native()

    def example_like(self, step: Step) -> Step:
        """Return the `step` passed in the first call, an example of the structure of all steps."""
        if self._example is None:
            self._example = keep_flattened(step)
        return self._example

    def recorded(self, values: Sequence[PyTree]) -> "list[RecordedRun]":
        # Runs that are too long for lanes, and all runs without lanes, are recorded one by one.
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
        their `cotangents`. A run may occur several times, with different cotangents."""

        # Called only when a run's turn comes, so that few runs have their cotangents in memory.
        def seeds_of(number: int) -> Seeds:
            return runs[number].pulled_outputs(cotangents[number])

        slopes = None
        # Lanes do not compute steps again, so they need runs of which all steps are kept.
        if len(runs) > 1 and self.has_lanes and all(run.is_kept() for run in runs):
            slopes = self._or_refused(lambda: _gradients_in_lanes(self, runs, seeds_of))
        return slopes or [run.gradient(seeds_of(number)) for number, run in enumerate(runs)]

    def _or_refused(self, function: Callable[[], T]) -> T | None:
        # Without a rule of native code for an operation, runs are computed one after the other, in
        # this call and in all later ones.
        try:
            return function()
        except UnsupportedPrimitiveError as error:
            self.has_lanes = False
            report_fallback(error)
            return None


class RecordedRun:
    """A run with its accepted steps, from which values and derivatives of outputs follow.

    - `last`: the `Step` at the end of the run. If the run has failed, values and derivatives at
      times that the run has not reached are meaningless.
    - `at`: values of the parameters; `bytes_kept`: bytes of the recorded steps.
    """

    def __init__(self, recorder: Recorder, at: PyTree, recording: _Recording):
        self.recorder, self.at = recorder, at
        self.segments, self.last, self._tallies = recording
        self.example = recorder.example_like(self.last)
        self.bytes_kept = sum(s.rows.nbytes for s in self.segments if s.rows is not None)
        self._ended = adjoint.ended(recorder.run, at, self.last, self._tallies)

    def rows_of(self, segment: _Segment) -> np.ndarray:
        if segment.rows is not None:
            return segment.rows
        assert segment.start is not None
        # Tallies do not influence the steps, so those of the end of the run serve here.
        _, _, buffer = adjoint.segment(self.recorder.run, self.at, segment.start, self._tallies)
        return np.asarray(buffer.filled())

    def solution(self, settings: Notes) -> Solution:
        """Return a `Solution` of only the run's end, with `settings`, for `raise_failure`."""
        run, ended = self.recorder.run, self._ended
        return Solution(
            time=float(run.origin) + float(ended.time),
            final=ended.final,
            result=ended.result,
            attempts=ended.attempts,
            accepted=ended.accepted,
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
            # The instants on which the results depend, such as that of a peak or the ends of a
            # window. They don't increase, or are not finite, if the run does not reach the window.
            instants[name] = reduction.instants(self._ended.results.get(name, {}), (origin, end))
            row = np.asarray(instants[name])
            is_reached = bool((np.diff(row) > 0.0).all() and np.isfinite(row).all())
            argument, remedy = f"outputs[{name!r}]", "give a window that the run reaches"
            require(is_reached, argument, reduction, "a reduction over a part of the run", remedy)
        further = [t - origin for group in instants.values() for t in group]
        times = np.concatenate([self.recorder.times, further])
        # The step in which a time lies is the first that ends at or after it. Times that a failed
        # run has not reached get its last step.
        ends = np.concatenate([segment.ends for segment in self.segments])
        places = np.minimum(np.searchsorted(ends, times), len(ends) - 1)
        return _Samples(times, places, self._rows_at(places), instants)

    def _rows_at(self, places: np.ndarray) -> np.ndarray:
        # The row of each of the steps with the indices `places` in the run.
        rows_by_place: dict[int, np.ndarray] = {}
        first = 0
        for segment in self.segments:
            # The segment has the steps `first` to `stop` - 1 of the run.
            stop = first + len(segment.ends)
            in_segment = np.unique(places[(first <= places) & (places < stop)] - first).tolist()
            known = segment.picked if segment.rows is None else segment.rows
            # The picked rows are those for the times of quantities. Instants of reductions may need
            # others, since they are found only at the end of the run.
            if segment.rows is None and not segment.picked.keys() >= set(in_segment):
                known = self.rows_of(segment)
            rows_by_place |= {first + k: known[k] for k in in_segment}
            first = stop
        return np.stack([rows_by_place[int(k)] for k in places])

    def values(self) -> dict[str, np.ndarray]:
        """Return by name the quantities, (N,) each, at N times, and the results of reductions."""
        return self._combined(self._sampled)

    @cached_property
    def _sampled(self) -> dict[str, np.ndarray]:
        recorder, samples = self.recorder, self._samples
        shared = recorder.run, self.at, self.example, recorder.quantities
        pieces = [
            adjoint.values_at(*shared, self._repeated(rows), times)
            for rows, times in _pieces(samples.rows, samples.times)
        ]
        # The last piece is filled up, so values after the last time are left out.
        return jax.tree.map(lambda *parts: np.concatenate(parts)[: len(samples.times)], *pieces)

    def _repeated(self, rows: np.ndarray) -> np.ndarray:
        # These numbers are several times as many as those of the rows, and are not kept.
        return np.asarray(adjoint.repeated(self.recorder.run, self.at, self.example, rows))

    def _combined(self, sampled: dict[str, Numbers]) -> dict[str, Numbers]:
        """Return the outputs by name, from the values of quantities at all times of `_samples`."""
        outputs, start = self.recorder.outputs, len(self.recorder.times)
        combined = {name: sampled[name][:start] for name in outputs.quantities}
        # After the times of the quantities come the instants of one reduction after the other.
        for name, reduction in outputs.reductions.items():
            instants = self._samples.instants[name]
            stop = start + len(instants)
            columns = [sampled[part][start:stop] for part in _parts_of(name, reduction)]
            for part, value in reduction.combined(jnp.stack(columns, axis=1), instants).items():
                combined[result_name(name, part)] = value
            start = stop
        return combined

    def pulled_outputs(self, cotangents: dict[str, np.ndarray]) -> "Seeds":
        """Pull cotangents of the outputs, (N,) for a quantity and numbers for a reduction, back to
        the steps in which the outputs are evaluated."""
        recorder, samples = self.recorder, self._samples
        self._require_still_instants(cotangents)
        # First from the outputs to the values of quantities at all times of `_samples`.
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

    def _require_still_instants(self, cotangents: dict[str, np.ndarray]) -> None:
        """Raise a `ValueError` if an instant that the run has found, such as the time of a peak, is
        at a contact event or at a breakpoint that depends on the parameters. There, unlike at a
        smooth peak, a shift of the instant changes the value to first order. Reductions without
        nonzero `cotangents`, which are by name of the result, are not checked."""
        expected = "a peak that is smooth, or at a fixed time"
        remedy = "take the difference of two runs"
        for name, reduction in self.recorder.run.reductions.items():
            parts = [cotangents[result_name(name, part)] for part in reduction.differentiated]
            # Without cotangents, no derivative of this reduction is asked for.
            for time in self._samples.instants[name] if np.any(parts) else ():
                argument, found_at = f"outputs[{name!r}]", f"at an event at {time:.6g} s"
                require(not self._moves(time), argument, found_at, expected, remedy)

    def _moves(self, time: Scalar) -> bool:
        """Return whether `time`, s of the scene, is that of a contact event, or of a breakpoint
        that depends on the parameters."""
        run, ends = self.recorder.run, np.concatenate([s.ends for s in self.segments])
        origin = float(run.origin)
        since_start = time - origin
        k = int(np.abs(ends - since_start).argmin())
        # Steps end at events, so an instant inside a step is not at an event. Times are compared up
        # to rounding errors.
        tolerance = 8.0 * np.finfo(float).eps * max(abs(origin), abs(since_start))
        is_end = abs(ends[k] - since_start) <= tolerance
        # The end of the last step is the end of the run, which does not move.
        if not is_end or k + 1 == len(ends):
            return False
        # Row k has the state before step k, and the time at its end. A contact event shows as a
        # difference of the gaps before and after the step.
        rows = self._rows_at(np.array([k, k + 1]))
        (before, t1), (after, _) = (
            like(adjoint.step_row(self.example, self.example.t), row) for row in rows
        )
        moves = bool(changes(before.contact_gaps, after.contact_gaps))
        return moves or _breakpoint_moves(run.systems(self.at), before.t, t1)

    @property
    def places(self) -> np.ndarray:
        """Indices in the run of the steps in which quantities are evaluated, (N,): one for each of
        the N times of evaluation, so that indices may repeat."""
        return self._samples.places

    def is_kept(self) -> bool:
        return all(segment.rows is not None for segment in self.segments)

    def gradient(self, seeds: "Seeds") -> PyTree:
        """Return the derivatives by all parameters of the sum of outputs, weighted by `seeds`."""
        # After the last step, cotangents of the tangents are zero: those in `seeds` are added in
        # the steps below. `total`, of the parameters, begins with the outputs' direct dependence.
        zeros = np.zeros(_count_of_tangents(self.example))
        now = Pulled(count=np.asarray(0), cotangents=zeros, total=seeds.total)
        # Index in the run of the first step of the segment.
        first = sum(len(segment.ends) for segment in self.segments)
        needed = seeds.steps_needed()
        for segment in reversed(self.segments):
            first -= len(segment.ends)
            count = min(len(segment.ends), needed - first)
            if count <= 0:  # no step of this segment or of later ones has cotangents
                continue
            # One program serves all segments, so their arrays are filled up to the same lengths:
            # those of a full buffer of steps, and of the most steps in which outputs can lie.
            rows = self.rows_of(segment)
            rows = np.pad(rows, ((0, adjoint.ROWS - len(rows)), (0, 0)))
            room = min(len(seeds.places), adjoint.ROWS)
            steps = seeds.steps(rows, first, first + count, room)
            now = now._replace(count=np.asarray(count))
            now = adjoint.backward(self.recorder.run, self.at, self.example, steps, now)
        return self.gradient_from(now)

    def gradient_from(self, start: Pulled) -> PyTree:
        """Return the derivatives by all parameters from the cotangents before the first step."""
        before = jax.device_get(like(self.example.tangents, start.cotangents))
        (first_row,) = self._rows_at(np.zeros(1, int))
        of_start = adjoint.pulled_start(self.recorder.run, self.at, self.example, first_row, before)
        return jax.tree.map(np.add, start.total, of_start)


def _breakpoint_moves(systems: SystemFamily, start: Scalar, t: Scalar) -> bool:
    """Return whether a step from `start` to `t`, s, ends at a breakpoint that parameters move."""
    landings = since_breakpoints(systems.system(), start, t)
    if not any(bool(lands) for lands, _ in landings.values()):
        return False

    # The time from each breakpoint to the end of the step, which is differentiated.
    def since(system: System) -> dict[str, Scalar]:
        return {name: time for name, (_, time) in since_breakpoints(system, start, t).items()}

    _, along = systems.with_derivatives(since, (), ())
    return any(bool((np.asarray(slope) != 0.0).any()) for slope in jax.tree.leaves(along))


def _pieces(rows: np.ndarray, times: np.ndarray, *cotangents: PyTree) -> Iterator[tuple]:
    """Yield N rows, their times and cotangents, in pieces of `adjoint.ROWS`. The last of several is
    filled up by copies of the last row, with zero cotangents; a single piece may be shorter."""
    # Pieces of the same length share a compiled program.
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
    """Cotangents with which a backward loop begins, pulled back from the derivatives of outputs.

    - `total`: those of the direction in which the parameters change, as far as the derivatives
      depend on it directly, and not through the tangents.
    - `pulled`: (K, m), those of the m numbers of the `StepTangents` of a step, for each of K times
      at which outputs are evaluated; `places`, (K,), has the indices of these steps.
    """

    total: PyTree
    pulled: np.ndarray
    places: np.ndarray

    def steps_needed(self) -> int:
        """Return the number of steps up to the last one that has cotangents; 0 if none has."""
        places = self.places[self.pulled.any(axis=1)]
        return int(places.max(initial=-1)) + 1

    def steps(self, rows: np.ndarray, first: int, last: int, room: int) -> PulledSteps:
        """Return the steps `first` to `last` - 1 of the run with their cotangents. `rows`: the
        `step_row` of each of them, then padding. `room`: number of rows that the result has for
        cotangents, at least the number of these steps in which outputs are evaluated."""
        # Row 0 of `added` stays zero, for steps without cotangents; hence `order + 1`. A step in
        # which outputs are evaluated at several times gets the sum of these cotangents.
        added = np.zeros((room + 1, self.pulled.shape[1]))
        places = np.zeros(len(rows), int)
        here = np.flatnonzero((first <= self.places) & (self.places < last))
        with_outputs, order = np.unique(self.places[here] - first, return_inverse=True)
        np.add.at(added, order + 1, self.pulled[here])
        places[with_outputs] = np.arange(1, len(with_outputs) + 1)
        return PulledSteps(rows, added, places)


def _recorded(recorder: Recorder, at: PyTree) -> _Recording:
    run, kept = recorder.run, 0
    step, tallies = adjoint.begun(run, at)
    segments: list[_Segment] = []
    while _goes_on(run, step):
        after, tallies, buffer = adjoint.segment(run, at, step, tallies)
        rows = np.asarray(buffer.filled())
        kept += rows.nbytes
        # The last number of a row is the end time of the step.
        segments.append(_Segment(rows[:, -1].copy(), rows))
        if kept > KEPT_BYTES:
            segments[-1] = _without_rows(segments[-1], step, recorder.times)
        # The leaves are views of the memory of a whole call, which copies allow to be freed.
        step = jax.tree.map(np.array, after)
    return _Recording(segments, step, tallies)


def _goes_on(run: Adjoint, step: Step) -> bool:
    # As `running`, which is for compiled code: in Python this takes a few microseconds.
    is_before_end = bool(step.t < run.own_end and step.attempts < run.max_steps)
    return is_before_end and result_number(step.result) == SUCCESSFUL


def _without_rows(segment: _Segment, start: Step, times: np.ndarray) -> _Segment:
    """Return the segment with rows only of steps that contain `times`, s, and of its first step,
    for derivatives of the initial state. The others can be computed again from `start`."""
    assert segment.rows is not None
    picked = np.unique([0, *np.searchsorted(segment.ends, times)])
    # Times after the segment lie in steps of later segments, and pick its last step here.
    picked = np.minimum(picked, len(segment.ends) - 1)
    kept = {int(k): segment.rows[k].copy() for k in picked}
    return _Segment(segment.ends, None, start, kept)


# Runs side by side. The status "soon" of a lane tells whether it will need the host within
# `LANE_ROWS` // 2 steps: such lanes are served with the one that needs it now, since each of them
# would stop all lanes.


@NativeFunction
def _begun_lane(run: Adjoint, values: PyTree) -> Progress:
    return run.start(values, LANE_ROWS)


def _stepped_lane(run: Adjoint, values: PyTree, now: Progress) -> Progress:
    goes = _status_of_lane(run, values, now)["moves"]
    return run.loop(values, LANE_ROWS).advance(now, goes)


def _status_of_lane(run: Adjoint, values: PyTree, now: Progress) -> dict[str, Condition]:
    runs, buffer = running(now.step, run.own_end, run.max_steps), now.records[STEPS]
    ends_soon = jnp.logical_not(runs) | (buffer.count >= LANE_ROWS // 2)
    return {"moves": runs & jnp.logical_not(buffer.is_full()), "soon": ends_soon}


def _pulled_lane(
    shared: tuple[Adjoint, Step], own: tuple[PyTree, PulledSteps], now: Pulled
) -> Pulled:
    (run, example), (values, steps) = shared, own
    return adjoint.pulled(run, values, example, steps, now)


def _status_of_pulled_lane(shared: PyTree, own: PyTree, now: Pulled) -> dict[str, Condition]:
    return {"moves": now.count > 0, "soon": now.count <= LANE_ROWS // 2}


_LaneData: TypeAlias = tuple[PyTree, PyTree]
"""A lane's own data and its state."""


def _through(
    step: Callable[[PyTree, PyTree, PyTree], PyTree],
    status: Callable[[PyTree, PyTree, PyTree], dict[str, Condition]],
    shared: PyTree,
    starts: Iterator[_LaneData],
    serve: Callable[[int, PyTree], _LaneData | None],
) -> None:
    """Run a lane for each of the `starts`, in the columns of a `LaneLoop`, which explains `step`,
    `status` and `shared`. Whenever the loop stops, `serve` is called with the number and state of
    each lane that needs the host now or soon (status "soon"). `serve` returns the data with which
    the lane goes on, or ``None`` to end the lane; the next lane then gets the column."""
    first = next(starts)
    loop = made_lane_loop(step, status, (shared, *first))
    own_cells, state_cells = map(Cells, first)
    columns, waiting = loop.columns(shared), enumerate(chain([first], starts))
    # The number of the lane in each column; ``None`` for an empty one.
    slots: list[int | None] = [None] * loop.width

    def write(column: int, data: _LaneData) -> None:
        own, state = data
        loop.write_lane(columns, column, own_cells.row(own), state_cells.row(state))

    while True:
        for column, lane in enumerate(slots):
            if lane is None and (start := next(waiting, None)) is not None:
                slots[column], data = start
                write(column, data)
        if all(lane is None for lane in slots):
            return
        loop.run(columns)
        soon = loop.status_of(columns)["soon"].tolist()
        for column, lane in enumerate(slots):
            if lane is None or not soon[column]:
                continue
            state = state_cells.tree(columns.floats[loop.state_cells, column])
            if (data := serve(lane, state)) is not None:
                write(column, data)
            else:
                # An empty column takes no steps.
                loop.leave(columns, column)
                slots[column] = None


def _in_lanes(recorder: Recorder, values: Sequence[PyTree]) -> dict[int, _Recording]:
    """Record a run for each of the `values` of the parameters, side by side. Return the recordings
    by index in `values`. Runs whose steps exceed `KEPT_BYTES` are stopped and left out."""
    run = recorder.run
    recordings: dict[int, _Recording] = {}
    # Rows that the host has read so far, by the number of the run.
    rows_of_runs: dict[int, list[np.ndarray]] = defaultdict(list)

    # Read new rows of run `number`. Return the data with which it goes on; ``None`` ends its lane.
    def serve(number: int, now: Progress) -> _LaneData | None:
        buffer, read = now.records[STEPS], rows_of_runs[number]
        read.append(buffer.filled())
        # The run goes on with an empty buffer, unless it has too many steps to be kept.
        if _goes_on(run, now.step):
            if sum(rows.nbytes for rows in read) <= KEPT_BYTES:
                return values[number], Progress(now.step, now.records | {STEPS: buffer.emptied()})
            del rows_of_runs[number]
            return None
        rows = np.concatenate(rows_of_runs.pop(number))
        # All rows are kept, so that no segment is computed again. The last number of a row is the
        # end time of the step.
        pieces = (rows[k : k + adjoint.ROWS] for k in range(0, len(rows), adjoint.ROWS))
        segments = [_Segment(piece[:, -1].copy(), piece) for piece in pieces]
        recordings[number] = _Recording(segments, now.step, now.records[REDUCTIONS])
        return None

    starts = ((at, _begun_lane(run, at)) for at in values)
    _through(_stepped_lane, _status_of_lane, run, starts, serve)
    return recordings


@dataclass
class _PulledLane:
    """A run whose cotangents are pulled back from its end. `rows`: (M, n), a `step_row` for each of
    its steps; `seeds`: the cotangents that come from its outputs; `first`: index of the earliest
    step that `next_steps` has returned so far."""

    run: RecordedRun
    rows: np.ndarray
    seeds: Seeds
    first: int

    def next_steps(self, left: int, room: int) -> tuple[PulledSteps, int]:
        """Return the steps to pull back through next, and their number. They are the `left` steps
        that remain of the previous call, and steps before them, together at most `LANE_ROWS`.
        `room`: number of rows that the result has for cotangents. Each of these steps in which
        outputs are evaluated needs one."""
        last = self.first + left
        self.first = max(0, last - LANE_ROWS)
        rows = np.zeros((LANE_ROWS, self.rows.shape[1]))
        rows[: last - self.first] = self.rows[self.first : last]
        return self.seeds.steps(rows, self.first, last, room), last - self.first


def _gradients_in_lanes(
    recorder: Recorder, runs: Sequence[RecordedRun], seeds_of: Callable[[int], Seeds]
) -> list[PyTree]:
    # A lane pulls the cotangents of one run back, beginning with those of the run's outputs, which
    # `seeds_of` returns for the index of the run. Its own data are the parameters and up to
    # `LANE_ROWS` steps; when it has passed most of these, they are replaced by the steps before.
    # To `seeds.total`, the part by the parameters' direction, it adds that of each step it passes.
    example = runs[0].example  # a `Step`, which has the structure of all steps
    slopes: list[PyTree] = [None] * len(runs)
    room = min(len(runs[0].places), LANE_ROWS)
    lanes: dict[int, _PulledLane] = {}

    def start(number: int) -> _LaneData:
        run, seeds = runs[number], seeds_of(number)
        rows = np.concatenate([run.rows_of(segment) for segment in run.segments])
        lane = lanes[number] = _PulledLane(run, rows, seeds, seeds.steps_needed())
        steps, count = lane.next_steps(0, room)
        cotangents = np.zeros(_count_of_tangents(example))
        return (run.at, steps), Pulled(np.asarray(count), cotangents, seeds.total)

    def serve(number: int, now: Pulled) -> _LaneData | None:
        lane, left = lanes[number], int(now.count)  # number of its steps that are left to pass
        if left == 0 and lane.first == 0:
            slopes[number] = lane.run.gradient_from(now)
            del lanes[number]
            return None
        steps, count = lane.next_steps(left, room)
        return (lane.run.at, steps), now._replace(count=np.asarray(count))

    starts = map(start, range(len(runs)))
    _through(_pulled_lane, _status_of_pulled_lane, (recorder.run, example), starts, serve)
    return slopes


def _parts_of(name: str, reduction: AbstractReduction) -> dict[str, Quantity]:
    """Return the quantities on which the differentiated results of a reduction depend: those
    `observed`, and the integrals of the `integrands`. Their names begin with the `name` of the
    reduction's output and a slash, which no output's name contains."""
    observed = {f"{name}/{k}": quantity for k, quantity in enumerate(reduction.observed())}
    integrals = {key: _Work(key) for key in integrands_of({name: reduction})}
    return {**observed, **integrals}


class _Work(eqx.Module):
    """Quantity: the integral, from the start of the run, of the integrand with the name `key`."""

    key: str = eqx.field(static=True)

    def __call__(self, now: Instant) -> Scalar:
        return now.work[self.key]


class Integrand(eqx.Module):
    """A quantity with the arguments of `Formulation.integrands`, to be integrated over time."""

    quantity: Quantity = eqx.field(static=True)

    def __call__(self, system: System, t: Scalar, motion: PyTree, *parts: PyTree) -> Scalar:
        entry_speeds, bristles, memory = parts  # in the order of `Formulation.integrands`
        now = Instant(system, t, motion, entry_speeds, {}, bristles, memory)
        return number_at(now, self.quantity)


def integrands_of(reductions: Mapping[str, AbstractReduction]) -> dict[str, Integrand]:
    """Return the integrands of reductions, by names with a slash, which no output's name has."""
    return {
        f"{name}/integral {k}": Integrand(quantity)
        for name, reduction in reductions.items()
        for k, quantity in enumerate(reduction.integrands())
    }
