"""Scheduler of lanes: it puts the lanes of a batch into the columns of compiled loops.

Each thread advances one group of lanes side by side, each lane in its column of the group's memory,
an array (cells, columns) of 8 bytes a cell. When a lane has ended, its column gets the next one. By
default there is a thread for each core, or for each accelerator.
"""

import time
from collections import defaultdict, deque
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..._compilation.xla import program_is_made_inside
from ..._math.vectors import Scalar
from ..._native import Native, UnsupportedPrimitiveError, is_native
from ..._native.cells import Cells
from ..._native.compiled import report_fallback
from ..._native.functions import BoundFunction
from ..._native.lanes import made_lane_loop
from ..._runtime import threads_of_sweeps
from ..run.host_run import Outcome
from ..run.impact_recorder import ImpactRow
from ..run.terminal import interruptions_deferred
from ..step.dense_output import Snapshot
from ..step.types import Numbers
from .lane import SAVED, WINDOW, Common, Task
from .xla_lanes import XlaFunction, XlaLaneLoop, zeros_like

PERIOD = 0.2
"""Longest time, s, between two reports of progress and of ended lanes: bars then move evenly."""
LONGEST_WAIT = 0.25
"""Time, s, for which lanes that have ended may wait to be handed over while other lanes begin. It
limits what is lost if the process is killed while its caller stores results slowly."""
KNOWN_SHARE = 0.01
"""Share of all work that must be done before the time left is estimated; less is unreliable."""
BLOCK_ROWS = 256
"""Largest number of recorded rows of a lane that a compiled function converts at once. With fewer,
long logs would take more calls; with more, the last block would have more rows to fill up."""
OnCells = BoundFunction | XlaFunction
"""A compiled function from the cells of n lanes, (n, cells), to the cells of n results."""


class Ended(NamedTuple):
    """Results of n lanes that have ended, in NumPy arrays with a first axis of length n.

    - `lanes`: (n,) indices of the lanes in the batch.
    - `logs[log]`: recorded columns by name, (n, rows, ...), with NaN after the last row that a lane
      has recorded; and (n,) how many rows each lane has recorded.
    """

    lanes: np.ndarray
    outcome: Outcome
    logs: dict[str, tuple[dict[str, np.ndarray], np.ndarray]]


class Running(NamedTuple):
    """Progress of the lanes that have begun and not ended: how many they are; the smallest and the
    largest simulated time, s, that one of them has reached; and the estimated computing time, s,
    until all lanes of the batch have ended, or ``None`` if there is no estimate yet."""

    lanes: int
    earliest: float
    latest: float
    seconds_left: float | None


class Batch:
    """A batch of L lanes to run, in native code on CPUs where possible, otherwise by XLA. Arrays in
    `tasks` have a first axis of length L. `threads`: by default one for each core or accelerator.
    `lengths`: largest number of rows of each log, a table that every lane writes, by its name."""

    def __init__(self, common: Common, tasks: Task, threads: int | None = None):
        self.common = jax.tree.map(lambda x: np.asarray(x) if eqx.is_array(x) else x, common)
        self.tasks, self._threads = tasks, threads or threads_of_sweeps()
        self.lengths, count = dict(common.capacity), len(tasks.end_time)
        self._save_at = np.zeros((count, 0)) if tasks.save_at is None else tasks.save_at
        if tasks.save_at is not None:
            self.lengths[SAVED] = tasks.save_at.shape[1]
        # The data with which the lanes begin.
        save_at = None if tasks.save_at is None else self.next_saves(slice(None), 0)
        wanted = {name: np.full(count, rows) for name, rows in common.capacity.items()}
        self.own = replace(tasks, save_at=save_at, wanted=wanted)
        self._made: _Programs | None = None

    def with_tasks(self, tasks: Task) -> "Batch":
        """Return a batch of other lanes, which uses the compiled programs of this one if this one
        has run. Apart from the first axis, arrays must have the shapes of this batch's arrays."""
        other = Batch(self.common, tasks, self._threads)
        other._made = self._made
        return other

    def next_saves(self, lanes: int | slice, first: int) -> np.ndarray:
        """Return the next `WINDOW` times to save at, s, of one lane, given by its index, or of each
        lane in a slice, from the time with the index `first` on; infinite where none is left."""
        times = self._save_at[lanes, first : first + WINDOW]
        window = np.full((*times.shape[:-1], WINDOW), np.inf)
        window[..., : times.shape[-1]] = times
        return window

    def run(
        self,
        lanes: Sequence[int],
        on_ended: Callable[[Ended], None],
        on_progress: Callable[[Running], None] = lambda running: None,
    ) -> None:
        """Run some lanes of the batch, in the given order.

        **Arguments:** `lanes`: their indices in the batch; `on_ended`: receives lanes that have
        ended; `on_progress`: receives the progress several times a second; both are called in the
        thread of the caller.

        **Raises:** `KeyboardInterrupt` after Ctrl-C, when `on_ended` has received all lanes that
        had ended. After a second Ctrl-C, some of them may be missing. An error in a thread or a
        callback stops all threads and is raised.
        """
        if not lanes:
            return
        programs = self._programs()
        shared = _Shared(self, programs, deque(lanes))
        # Each thread has one group of columns. Only as many groups are made as the lanes can fill.
        count = min(self._threads, -(-len(lanes) // programs.loop.width))
        groups = [_Group(shared, number) for number in range(count)]
        with interruptions_deferred() as stopped:
            with ThreadPoolExecutor(count) as pool:
                try:
                    futures = {pool.submit(group.run) for group in groups}
                    # The threads compute without Python's lock. Meanwhile this thread passes
                    # results and progress to the callbacks, every `PERIOD` seconds and as soon as a
                    # group has ended.
                    while futures:
                        ended, futures = wait(futures, PERIOD, FIRST_COMPLETED)
                        shared.stops = shared.stops or stopped()
                        # The groups that still run are known before the records are taken: in the
                        # other order, records that a group adds in between would be lost, because
                        # there might be no further iteration.
                        shared.hand_over(on_ended)
                        for future in ended:
                            future.result()  # raises the error of its group
                        on_progress(shared.running())
                finally:
                    # Also after an error of a signal handler, such as a time limit.
                    shared.stops = True
            if stopped():
                raise KeyboardInterrupt

    def _programs(self) -> "_Programs":
        if self._made is None:
            with program_is_made_inside():
                if is_native():
                    try:
                        self._made = _Programs(self, native=True)
                    except UnsupportedPrimitiveError as error:
                        report_fallback(error)
                self._made = self._made or _Programs(self, native=False)
        return self._made


class _Programs:
    """Compiled programs of a batch, and the places of a lane's numbers in the cells of its column.

    A log is a table that a lane records, such as the impacts of a contact; `log` is its name.

    - `own_cells`: layout of a lane's `Task`; `own`: a `Task` with the indices of its cells.
    - `begin`: makes a compiled function that computes the first states of lanes. Likewise `outcome`
      for their outcomes, and `columns[log]` for the columns of a log's table from blocks of its
      rows. Each thread makes its own, since two threads must not call one function at a time.
    - `buffers[log]`: indices of the cells of a buffer's rows, (rows, numbers), and of the cell that
      counts them.
    - `blocks[log]`: number of rows that are converted at once, and of numbers in each row.
    """

    def __init__(self, batch: Batch, native: bool):
        # The first lane is an example of the structure, shapes and dtypes of all lanes.
        common = batch.common
        task = jax.tree.map(lambda leaf: np.asarray(leaf[0]), batch.own)
        functions = Common.after_turn, Common.status
        if native:
            lane = _begun(common, task)
            self.loop = made_lane_loop(*functions, (common, task, lane))
        else:
            # XLA needs only the shapes of a lane's state, so no lane is computed for them.
            lane = zeros_like(eqx.filter_eval_shape(_begun.__wrapped__, common, task))
            self.loop = XlaLaneLoop(*functions, common, task, lane)

        # Cells of the data and the state of a lane.
        self.own_cells = Cells(task)
        # Indices of cells within these data become indices of cells in the whole column of a lane.
        offset = self.loop.own_cells.start
        self.own: Task = _shifted(self.own_cells.columns(), offset)
        state = _shifted(Cells(lane).columns(), self.loop.state_cells.start)
        self.buffers: dict[str, tuple[np.ndarray, int]] = {}
        for name, buffer in common.logs(state).items():
            rows = [leaf.reshape(len(leaf), -1) for leaf in jax.tree.leaves(buffer.rows)]
            # The last row of a buffer takes rows for which there is no room, and is never read.
            self.buffers[name] = np.concatenate(rows, axis=1)[:-1], int(buffer.count)

        # Functions from the cells of lanes to those of results.
        def bound(function: Native, shared: PyTree, *examples: PyTree) -> Callable[[], OnCells]:
            make = function.native.bound if native else partial(XlaFunction, function.__wrapped__)
            return partial(make, shared, *examples)

        self.begin = bound(_begun, common, task)
        self.outcome = bound(_outcome, common, task, lane)
        self.columns: dict[str, Callable[[], OnCells]] = {}
        self.blocks: dict[str, tuple[int, int]] = {}
        for name, length in batch.lengths.items():
            # A block need not be longer than the log. It has at least one row, because `_log`
            # divides by the number of its rows.
            self.blocks[name] = max(min(length, BLOCK_ROWS), 1), self.buffers[name][0].shape[1]
            # An example of a record, whose numbers do not matter.
            record = jax.tree.map(lambda leaf: leaf[0], common.logs(lane)[name].rows)
            block = np.zeros(self.blocks[name])
            self.columns[name] = bound(_columns, (common, name, record), task, block)
        self.outcome_cells = self.outcome().results
        self.column_cells = {name: make().results for name, make in self.columns.items()}


def _shifted(cells: PyTree, by: int) -> PyTree:
    return jax.tree.map(lambda cell: cell + by if eqx.is_array(cell) else cell, cells)


@dataclass
class _LaneSlot:
    """A lane in a column. `number`: its index in the batch. `rows`: by the name of a log, a table
    that the lane records, the arrays of rows, (n, numbers), that were read so far."""

    number: int
    rows: dict[str, list[np.ndarray]] = field(default_factory=lambda: defaultdict(list))

    def recorded(self, log: str) -> int:
        return sum(map(len, self.rows[log]))


_Record: TypeAlias = tuple[int, np.ndarray, dict[str, tuple[np.ndarray, int]]]
"""A lane that has ended: its index in the batch, the cells of its outcome, (cells,), and for each
log the cells of its result columns, (blocks, cells), and the number of recorded rows."""


@dataclass
class _Shared:
    """State that the groups of a batch share.

    - `waiting`: indices, in the batch, of the lanes that have not begun.
    - `records`: lanes that have ended and that were not handed over to the caller yet.
    - `own`: (L, cells), the data with which each lane begins; made from those in `batch`.
    - `times[number]`: s, simulated time that each running lane, by index, has reached.
    - `handed_over`: value of `time.monotonic`, s, when records were handed over last.
    - `stops`: whether all groups are to end.
    """

    batch: Batch
    programs: _Programs
    waiting: deque[int]
    records: deque[_Record] = field(default_factory=deque)
    times: dict[int, float] = field(default_factory=dict)
    handed_over: float = field(default_factory=time.monotonic)
    stops: bool = False

    def __post_init__(self) -> None:
        self.own = self.programs.own_cells.rows(self.batch.own)
        self._lanes, self._begun = len(self.waiting), time.monotonic()

    def next_lanes(self, count: int) -> list[int]:
        """Remove the first indices, at most `count`, from `waiting`, and return them."""
        lanes: list[int] = []
        # Several threads take lanes at a time: to test for emptiness first would be a race.
        with suppress(IndexError):
            while len(lanes) < count:
                lanes.append(self.waiting.popleft())
        return lanes

    def wait_for_caller(self) -> None:
        """Wait while the caller has not received lanes that ended more than `LONGEST_WAIT` ago."""
        while (
            self.records and time.monotonic() - self.handed_over > LONGEST_WAIT and not self.stops
        ):
            time.sleep(0.01)

    def hand_over(self, on_ended: Callable[[Ended], None]) -> None:
        # The length is read once, since the groups may append while records are taken.
        records = [self.records.popleft() for _ in range(len(self.records))]
        if records:
            on_ended(_ended(self, records))
        self.handed_over = time.monotonic()

    def running(self) -> Running:
        # Work is measured in runs: a running lane counts by the part of its time span that it has
        # covered, and an ended lane counts as 1. The time left is extrapolated from that: the share
        # of all work that is done has taken `seconds`. The dictionary is copied, because other
        # threads change it.
        times, start = dict(self.times), float(self.batch.common.start_time)
        ends = self.batch.tasks.end_time
        begun = sum((now - start) / (ends[lane] - start) for lane, now in times.items())
        ended = self._lanes - len(self.waiting) - len(times)
        share, seconds = (ended + begun) / self._lanes, time.monotonic() - self._begun
        left = seconds * (1.0 - share) / share if share > KNOWN_SHARE else None
        earliest, latest = (f(times.values(), default=start) for f in (min, max))
        return Running(len(times), earliest, latest, left)


class _Group:
    """Columns whose lanes one thread runs. The group's index, `number`, selects its accelerator."""

    def __init__(self, shared: _Shared, number: int):
        self._shared, self._number = shared, number
        self._programs, self._loop = shared.programs, shared.programs.loop
        self._slots: list[_LaneSlot | None] = [None] * self._loop.width

    def run(self) -> None:
        """Run lanes until none is left or the groups are to stop."""
        if self._shared.stops:
            return
        with _on_device(self._number):
            programs = self._programs
            # The functions are made here, because two threads must not call the same one.
            self._columns = self._loop.columns(self._shared.batch.common)
            self._begin, self._outcome = programs.begin(), programs.outcome()
            self._read = {name: make() for name, make in programs.columns.items()}
            while not self._shared.stops and self._filled():
                self._loop.run(self._columns)
                self._serve()
                self._shared.wait_for_caller()

    def _filled(self) -> bool:
        """Begin waiting lanes in the empty columns, and return whether any column has a lane."""
        empty = [column for column, slot in enumerate(self._slots) if slot is None]
        numbers = self._shared.next_lanes(len(empty))
        if numbers:
            # The lanes count as running while their first states are computed, which may compile.
            start = float(self._shared.batch.common.start_time)
            self._shared.times.update(dict.fromkeys(numbers, start))
            own = self._shared.own[numbers]
            states = self._begin(own)
            # There may be more empty columns than lanes left; the other columns stay empty.
            for column, number, cells, state in zip(empty, numbers, own, states, strict=False):
                self._slots[column] = _LaneSlot(number)
                self._loop.write_lane(self._columns, column, cells, state)
        return len(numbers) > 0 or len(empty) < len(self._slots)

    def _serve(self) -> None:
        """Read and empty the buffers of lanes that can't step, and record those that have ended."""
        status = self._loop.status_of(self._columns)
        # A lane runs until the end of its run or a failure. A lane that does not move has ended, or
        # has a full buffer.
        times, moving, running = (status[name].tolist() for name in ("time", "moves", "runs"))
        ended: list[int] = []
        for column, slot in enumerate(self._slots):
            if slot is None:
                continue
            self._shared.times[slot.number] = times[column]
            if moving[column]:
                continue
            self._take_rows(column, slot)
            # A lane at the end of its run may still have times to save at within its last step. It
            # saves these states in further turns, and has not ended yet.
            if not running[column] and self._next_saves(slot)[0] > times[column]:
                ended.append(column)
        if ended:
            self._end(ended)

    def _take_rows(self, column: int, slot: _LaneSlot) -> None:
        floats, integers = self._columns.floats, self._columns.integers
        taken = False
        for name, (cells, counter) in self._programs.buffers.items():
            if count := integers[counter, column]:
                # Indices in an array copy the rows, so that the lane may write over them.
                slot.rows[name].append(floats[cells[:count], column])
                integers[counter, column], taken = 0, True
        # The lane counts rows from zero again. So in its `Task`, `save_at` must begin with the time
        # to save at next, and `wanted` must be the number of rows that may still be recorded.
        if taken:
            task_cells, capacity = self._programs.own, self._shared.batch.common.capacity
            if task_cells.save_at is not None:
                floats[task_cells.save_at, column] = self._next_saves(slot)
            for name, cell in task_cells.wanted.items():
                integers[int(cell), column] = capacity[name] - slot.recorded(name)

    def _next_saves(self, slot: _LaneSlot) -> np.ndarray:
        batch = self._shared.batch
        return batch.next_saves(slot.number, slot.recorded(SAVED))

    def _end(self, columns: list[int]) -> None:
        # The compiled function takes the cells of a task, followed by those of a lane's state.
        slots = [slot for column in columns if (slot := self._slots[column])]
        tasks = self._shared.own[[slot.number for slot in slots]]
        states = self._columns.floats[self._loop.state_cells, columns].T
        outcomes = self._outcome(np.concatenate([tasks, states], axis=1))
        for column, slot, task, cells in zip(columns, slots, tasks, outcomes, strict=True):
            logs = {name: self._log(name, slot.rows[name], task) for name in self._read}
            self._shared.records.append((slot.number, cells, logs))
            del self._shared.times[slot.number]
            self._loop.leave(self._columns, column)
            self._slots[column] = None

    def _log(self, name: str, rows: list[np.ndarray], task: np.ndarray) -> tuple[np.ndarray, int]:
        """Convert the recorded `rows` of the log `name`, arrays (n, numbers), to its result table.
        Return the table as cells, (blocks, cells), in blocks of a fixed number of rows, and the
        number of rows recorded. `task`: cells of the lane's `Task`, which the conversion uses."""
        rows_a_block, numbers = self._programs.blocks[name]
        count = sum(map(len, rows))
        # The compiled function takes blocks of a fixed size, so the last one is filled with zeros.
        block_count = -(-count // rows_a_block)  # rounded up
        blocks = np.zeros((block_count, rows_a_block * numbers))
        if rows:
            np.concatenate(rows, out=blocks.reshape(-1, numbers)[:count])
        # The function takes the lane's task too, in front of each block.
        arguments = np.concatenate([np.tile(task, (len(blocks), 1)), blocks], axis=1)
        return self._read[name](arguments), count


def _ended(shared: _Shared, records: Sequence[_Record]) -> Ended:
    """Return the results of the lanes in `records`, from cells converted for all lanes at once."""
    programs, logs = shared.programs, {}
    numbers, outcomes, logs_of_lanes = zip(*records, strict=True)
    for name, length in shared.batch.lengths.items():
        # For each lane, the cells of this log's blocks of rows, and how many rows are recorded.
        recorded = [logs_of_lane[name] for logs_of_lane in logs_of_lanes]
        cells_of_all = np.concatenate([cells for cells, _ in recorded])
        # For each column of the log, the blocks of all lanes, (blocks, rows a block, ...).
        blocks_by_column = programs.column_cells[name].trees(cells_of_all)
        # For each lane but the last, the index of the block after the lane's last block.
        ends = np.cumsum([len(cells) for cells, _ in recorded])[:-1]
        columns = {}
        for key, blocks in blocks_by_column.items():
            columns[key] = np.full((len(records), length, *blocks.shape[2:]), np.nan)
            blocks_by_lane = np.split(blocks, ends)
            lanes = zip(columns[key], blocks_by_lane, recorded, strict=True)
            for lane_rows, lane_blocks, (_, count) in lanes:
                # The last block of a lane is filled up with rows of zeros, which are cut off.
                lane_rows[:count] = lane_blocks.reshape(-1, *blocks.shape[2:])[:count]
        logs[name] = columns, np.array([count for _, count in recorded])
    return Ended(np.array(numbers), programs.outcome_cells.trees(np.stack(outcomes)), logs)


def _on_device(number: int) -> AbstractContextManager[object]:
    if jax.default_backend() == "cpu":
        return nullcontext()
    return jax.default_device(jax.local_devices()[number % jax.local_device_count()])


_begun, _outcome = Native(Common.begun), Native(Common.outcome)


@Native
def _columns(
    shared: tuple[Common, str, Snapshot | ImpactRow], task: Task, rows: Numbers
) -> dict[str, Numbers]:
    """Convert R `rows` of a log, (R, n), each with the n numbers of a record, to the log's columns,
    (R, ...) by name. `shared` has the common data, the name of the log, and an example of a record,
    of which only structure and shapes are used. `task`: the task of the lane."""
    common, name, example = shared
    leaves, structure = jax.tree.flatten(example)
    # Some columns are quantities such as a contact force, which depend on the lane's scene too.
    system = common.system(task)
    # Each row has the numbers of the first leaf, then those of the second, and so on.
    boundaries = np.cumsum([leaf.size for leaf in leaves])[:-1]

    def columns_of_row(row: jax.Array) -> dict[str, Scalar]:
        parts = zip(jnp.split(row, boundaries), leaves, strict=True)
        shaped = [part.reshape(leaf.shape) for part, leaf in parts]
        record: Snapshot | ImpactRow = jax.tree.unflatten(structure, shaped)
        return record.columns(system, common.channels.get(name, {}))

    return jax.lax.map(columns_of_row, rows)
