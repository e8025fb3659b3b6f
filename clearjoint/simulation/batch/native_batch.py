"""Lanes side by side in native code, one thread a core, each refilled as soon as its lane ends."""

import math
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Hashable, Sequence
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ...compilation.clock import begins_a_program, program_is_made_inside
from ...math.vectors import pack
from ...native import Native, UnsupportedPrimitiveError, is_native
from ...native.compiled import report_fallback
from ...native.functions import BoundProgram, arrays_of, cells_of
from ...native.kept import kept
from ...native.lanes import WIDTH, LaneLoop
from ...runtime import Device
from ..aliases import Numbers
from ..interruptions import interruptions_deferred
from .device_pool import Columns, Common, Extent, Task, channels_of
from .lane import Lane, Orders, Outcome, begin_lane, moves, outcome, turn
from .recording import ROWS, AbstractRing, TableRing
from .scheduler import BLOCK_ROWS, Batch, Ended, Running, lengthened

SLICE = 4096
"""Turns after which a thread looks whether it is to stop, and reports."""
PERIOD = 0.2
"""Seconds between two reports of progress."""
KNOWN_SHARE = 0.01
"""Of all work, from which on the time left is estimated."""


class NativeBatch:
    """Runs lanes in native code; see `clearjoint.simulation.batch.scheduler.Batch`.

    **Arguments:** `common`: what all lanes share; `tasks`: the lanes in front of every array (host
    arrays), at least one; `threads`: how many compute at the same time.

    **Raises:** `UnsupportedPrimitiveError` if the lanes can't be run in native code.
    """

    def __init__(self, common: Common, tasks: Task, threads: int):
        common = replace(common, plan=replace(common.plan, ring_rows=ROWS))
        self.common = jax.tree.map(
            lambda leaf: np.asarray(leaf) if eqx.is_array(leaf) else leaf, common
        )
        self._tasks, self._threads = tasks, threads
        self.lengths = dict(common.capacity)
        if tasks.save_at is not None:
            self.lengths[common.saved] = tasks.save_at.shape[1]
        self.turns = 0
        """Turns given so far, of lanes that advanced and of empty columns."""
        task = self.task(0)
        self.example = _begun(self.common, task)
        """A lane like all others."""
        self._orders = _Seated(0, task, list(self.common.logs(self.example))).orders(self.common)
        with program_is_made_inside():
            self._loop = _LOOPS.loop(self.common, (task, self._orders), self.example)

    def run(
        self,
        lanes: Sequence[int],
        on_ended: Callable[[Ended], None],
        on_progress: Callable[[Running], None] = lambda running: None,
    ) -> None:
        """Run the lanes of the given numbers, which begin in this order; see `Batch.run`."""
        if not lanes:
            return
        shared = _Shared(self, deque(lanes))
        count = min(self._threads, -(-len(lanes) // WIDTH))
        groups = [
            _Group(shared, self._loop, _Programs(self, self.task(0), self.example))
            for _ in range(count)
        ]
        threads = [threading.Thread(target=group.run, daemon=True) for group in groups]
        with interruptions_deferred() as stopped:
            try:
                for thread in threads:
                    thread.start()
                _deliver(shared, len(threads), on_ended, on_progress, stopped)
            finally:
                shared.stops = True
                for thread in threads:
                    thread.join()
                self.turns += sum(group.turns for group in groups)
            if stopped():
                raise KeyboardInterrupt

    @property
    def end_times(self) -> np.ndarray:
        """Where the lanes end, s."""
        return np.asarray(self._tasks.end_time)

    def task(self, number: int) -> Task:
        """The task of a lane."""
        return jax.tree.map(lambda leaf: np.asarray(leaf[number]), self._tasks)


AnyBatch = Batch | NativeBatch


def batch_of(common: Common, tasks: Task, devices: Sequence[Device], extent: Extent) -> AnyBatch:
    """What runs lanes on devices: native code on CPUs, unless it can't, and XLA elsewhere."""
    if is_native() and devices[0].platform == "cpu" and len(tasks.end_time):
        try:
            return NativeBatch(common, tasks, len(devices))
        except UnsupportedPrimitiveError as error:
            report_fallback(error)
    return Batch(common, tasks, devices, extent)


class _Shared:
    """What the groups of a batch share.

    - `waiting`: numbers of the lanes that have not begun; `reports`: what groups hand over: lanes
      that have ended, an error, or ``None`` at the end of a group.
    - `times`: where the lanes are that run, s, by number; `stops`: whether groups are to end.
    - `lanes`: number of all lanes.
    """

    def __init__(self, batch: NativeBatch, waiting: deque[int]):
        self.batch, self.waiting = batch, waiting
        self.reports: queue.Queue[Ended | BaseException | None] = queue.Queue()
        self.times: dict[int, float] = {}
        self.stops = False
        self.lanes, self._begun = len(waiting), time.monotonic()

    def next_lane(self) -> int | None:
        """The number of a lane to begin, or ``None`` if none waits."""
        try:
            return self.waiting.popleft()
        except IndexError:
            return None

    def running(self) -> Running:
        """How far the lanes are."""
        times, start = dict(self.times), float(self.batch.common.start_time)
        ends = self.batch.end_times
        begun = sum((now - start) / (ends[lane] - start) for lane, now in times.items())
        ended = self.lanes - len(self.waiting) - len(times)
        share, seconds = (ended + begun) / self.lanes, time.monotonic() - self._begun
        left = seconds * (1.0 - share) / share if share > KNOWN_SHARE else None
        earliest, latest = (f(times.values(), default=start) for f in (min, max))
        return Running(len(times), earliest, latest, left)


def _deliver(
    shared: _Shared,
    groups: int,
    on_ended: Callable[[Ended], None],
    on_progress: Callable[[Running], None],
    stopped: Callable[[], bool],
) -> None:
    """Hand over what groups report, until all have ended."""
    reported = -math.inf
    while groups:
        try:
            report = shared.reports.get(timeout=PERIOD)
            if report is None:
                groups -= 1
            elif isinstance(report, Ended):
                on_ended(report)
            else:
                raise report
        except queue.Empty:
            pass
        shared.stops = shared.stops or stopped()
        if time.monotonic() - reported > PERIOD:
            reported = time.monotonic()
            on_progress(shared.running())


class _Programs:
    """Native programs of a batch, with memory for one thread.

    - `begin`: the cells of a lane's state before its first step, for those of its task; `outcome`:
      of what came of it, for those of task and state.
    - `rings`: by log, the cells of a ring's rows within a lane's state, (rows, columns), and that
      of their count.
    """

    def __init__(self, batch: "NativeBatch", task: Task, lane: Lane):
        common, fixed = batch.common, jax.tree.leaves(eqx.filter(batch.common, eqx.is_array))
        sizes = [np.size(leaf) for leaf in jax.tree.leaves((task, lane)) if eqx.is_array(leaf)]
        count = len(jax.tree.leaves(eqx.filter(task, eqx.is_array)))
        program, self._begun = _begun.native.program((common, task))
        self.begin = BoundProgram(program, fixed, sizes[:count])
        program, self._result = _outcome.native.program((common, task, lane))
        self._outputs = program.outputs
        self.outcome = BoundProgram(program, fixed, sizes)
        starts = iter(np.cumsum([0, *sizes[count:]]))
        places = jax.tree.map(
            lambda leaf: next(starts) + np.arange(np.size(leaf)) if eqx.is_array(leaf) else leaf,
            lane,
        )
        self.rings = {
            name: (_columns_of(ring), int(ring.count[0]))
            for name, ring in common.logs(places).items()
        }

    def outcome_of(self, task: np.ndarray, state: np.ndarray) -> Outcome:
        """What came of a lane, by the cells of its task and state."""
        cells = self.outcome(np.concatenate([task, state]))
        return self._result(arrays_of(cells, self._outputs))


class _Seated:
    """A lane in a column: the cells of its task, and the rows that its host has taken, by log."""

    def __init__(self, number: int, task: Task, logs: Sequence[str]):
        self.number, self.task = number, task
        self.cells = cells_of(jax.tree.leaves(eqx.filter(task, eqx.is_array)))
        self.rows: dict[str, list[np.ndarray]] = {name: [] for name in logs}

    def recorded(self, log: str) -> int:
        """The number of rows taken of a log."""
        return sum(map(len, self.rows[log]))

    def next_saves(self, common: Common) -> np.ndarray:
        """The next times to save at, s, and infinity behind the last."""
        window = np.full(ROWS + 1, np.inf)
        if common.saved:
            assert self.task.save_at is not None
            following = np.asarray(self.task.save_at)[self.recorded(common.saved) :][: ROWS + 1]
            window[: len(following)] = following
        return window

    def orders(self, common: Common) -> Orders:
        """What is asked of the lane until its host looks at it again."""
        wanted = {
            name: np.asarray(count - self.recorded(name)) for name, count in common.capacity.items()
        }
        window = self.next_saves(common)
        return Orders(self.task.end_time, self.task.first_step, window, wanted)

    def own_cells(self, common: Common) -> np.ndarray:
        """The cells of the task and of what is asked of the lane."""
        return np.concatenate([self.cells, cells_of(jax.tree.leaves(self.orders(common)))])

    def take_rows(self, programs: _Programs, state: np.ndarray) -> None:
        """Take the rows out of the rings in the cells of a state."""
        counts = state.view(np.int64)
        for name, (places, counter) in programs.rings.items():
            if count := counts[counter]:
                self.rows[name].append(state[places[:count]])
                counts[counter] = 0

    def ended(self, batch: "NativeBatch", programs: _Programs, state: np.ndarray) -> Ended:
        """What came of the lane, which has ended in the cells of a state."""
        logs = {}
        for name, length in batch.lengths.items():
            count, (places, _) = self.recorded(name), programs.rings[name]
            own = np.concatenate([np.zeros((0, places.shape[1])), *self.rows[name]])
            block = min(length, BLOCK_ROWS)
            parts = []
            for first in range(0, max(count, 1), block):
                table = np.zeros((block, own.shape[1]))
                rows = own[first : first + block]
                table[: len(rows)] = rows
                parts.append(_channels(batch.common, name, self.task, batch.example, table))
            columns = {key: np.concatenate([p[key] for p in parts])[None] for key in parts[0]}
            logs[name] = {key: lengthened(c, length)[0] for key, c in columns.items()}, count
        return Ended(self.number, programs.outcome_of(self.cells, state), logs)


def _columns_of(places: AbstractRing) -> np.ndarray:
    """The cells of a ring's rows, (rows, columns), from those of its leaves."""
    assert isinstance(places, TableRing)
    tables = [table.reshape(ROWS + 1, -1) for table in jax.tree.leaves(places.rows)]
    return np.concatenate(tables, axis=1)


class _Group:
    """Lanes side by side, and the thread that runs them."""

    def __init__(self, shared: _Shared, loop: LaneLoop, programs: _Programs):
        self._shared, self._loop, self._programs = shared, loop, programs
        self._batch, self._common = shared.batch, shared.batch.common
        self._columns = loop.columns(self._common)
        self._seated: list[_Seated | None] = [None] * WIDTH
        self.turns = 0

    def run(self) -> None:
        """Run lanes until none is left or the groups are to stop."""
        try:
            while not self._shared.stops and self._filled():
                self.turns += WIDTH * self._loop.run(self._columns, SLICE)
                self._look()
            self._shared.reports.put(None)
        except BaseException as error:
            self._shared.reports.put(error)

    def _filled(self) -> bool:
        """Begin waiting lanes in empty columns; whether any column has a lane."""
        for place in range(WIDTH):
            if self._seated[place] is None:
                number = self._shared.next_lane()
                if number is None:
                    break
                seated = _Seated(number, self._batch.task(number), list(self._programs.rings))
                self._seated[place] = seated
                self._put(place, seated, self._programs.begin(seated.cells))
        return any(self._seated)

    def _put(self, place: int, seated: _Seated, state: np.ndarray) -> None:
        self._loop.put(self._columns, place, seated.own_cells(self._common), state)

    def _look(self) -> None:
        """Take the rows of lanes that wait for it, and the results of those that have ended."""
        status = self._loop.status_of(self._columns)
        for place, seated in enumerate(self._seated):
            if seated is None:
                continue
            now = float(status["time"][place])
            self._shared.times[seated.number] = now
            if status["goes"][place]:
                continue
            runs = bool(status["runs"][place])
            state = self._loop.state_of(self._columns, place)
            seated.take_rows(self._programs, state)
            if runs or seated.next_saves(self._common)[0] <= now:
                self._put(place, seated, state)
                continue
            self._shared.reports.put(seated.ended(self._batch, self._programs, state))
            del self._shared.times[seated.number]
            self._loop.leave(self._columns, place)
            self._seated[place] = None


@Native
def _begun(common: Common, task: Task) -> Lane:
    """A lane before its first step."""
    orders = Orders(task.end_time, task.first_step, jnp.full(ROWS + 1, jnp.inf), common.capacity)
    scene = common.scene(task)
    return begin_lane(common.plan, scene, task.state, common.start_time, orders)


@Native
def _outcome(common: Common, task: Task, lane: Lane) -> Outcome:
    """What came of a lane, its state in packed form."""
    return pack(outcome(common.plan, common.scene(task), lane, task.end_time))


@Native
def _channels(common: Common, name: str, task: Task, lane: Lane, rows: Numbers) -> Columns:
    """What is reported of rows of a log."""
    return channels_of(common, common.scene(task), name, lane, rows, jax.lax.map)


class _Loops:
    """The native loops of a process, each compiled once."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._loops: dict[Hashable, LaneLoop] = {}

    def loop(self, common: Common, own: tuple[Task, Orders], lane: Lane) -> LaneLoop:
        """The loop for lanes of a structure."""
        trees = common, own, lane
        leaves, structure = jax.tree.flatten(trees)
        key = (
            structure,
            tuple((leaf.shape, leaf.dtype) if eqx.is_array(leaf) else leaf for leaf in leaves),
        )
        with self._lock:
            if key not in self._loops:
                traced = begins_a_program(_turned)
                self._loops[key] = kept(
                    _turned, trees, lambda: LaneLoop(traced, _looked_at, *trees)
                )
            return self._loops[key]


_LOOPS = _Loops()


def _turned(common: Common, own: tuple[Task, Orders], lane: Lane) -> Lane:
    task, orders = own
    return turn(common.plan, common.scene(task), lane, orders)


def _looked_at(common: Common, own: tuple[Task, Orders], lane: Lane) -> dict[str, PyTree]:
    _, orders = own
    return {
        "goes": moves(common.plan, lane, orders),
        "runs": lane.runs(common.plan, orders.end_time),
        "time": lane.step.t,
    }
