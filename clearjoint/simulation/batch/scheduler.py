"""Continuous batching, the host's part: which lanes are in the pool, and what was recorded.

Now and then, and when the lanes that are left no longer fill the places of a device, the host takes
the results of those that have ended, and waiting ones come into the pool. However few lanes are
left, they go on in the same program: one with fewer places, which is compiled anew, rounds
otherwise.
"""

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from ...runtime import Device, SlowRunNotice, mesh_devices
from ..interruptions import interruptions_deferred
from .device_pool import (
    ACROSS,
    UNKNOWN_SHARE,
    Common,
    Extent,
    Page,
    Seat,
    Status,
    Task,
    advance,
    begin,
    harvest,
    replaced,
)
from .lane import Outcome

BLOCK_ROWS = 256
"""Recorded rows of each lane that are read at once."""
HARVEST_PERIOD = 1.0
"""Seconds between two harvests of lanes that have ended, if nobody waits for their seats."""
HARVEST_SHARE = 0.05
"""Largest share of the time that such harvests may take."""
Rows = np.ndarray
"""What a lane has recorded in a log: (rows, columns)."""


@dataclass(frozen=True)
class Ended:
    """A lane that has ended: its number and outcome, and by log the recorded channels and their
    number (host arrays)."""

    lane: int
    outcome: Outcome
    logs: dict[str, tuple[dict[str, np.ndarray], int]]


@dataclass(frozen=True)
class Running:
    """How far the lanes are that have begun and not ended.

    `lanes`: their number; `earliest` and `latest`: the times, s, that they have reached;
    `seconds_left`: estimated time until all lanes have ended, also those that wait; ``None`` as
    long as nothing is known of any.
    """

    lanes: int
    earliest: float
    latest: float
    seconds_left: float | None


class Batch:
    """Runs lanes on devices.

    **Arguments:** `common`: what all lanes share; `tasks`: the lanes in front of every array (host
    arrays); `devices`; `extent`: how lanes share a device.
    """

    def __init__(self, common: Common, tasks: Task, devices: Sequence[Device], extent: Extent):
        self._tasks, self._extent = tasks, extent
        self._busy = len(devices)
        self._mesh = Mesh(np.array(mesh_devices(devices)), ("lanes",))
        self._across = NamedSharding(self._mesh, ACROSS)
        everywhere = NamedSharding(self._mesh, PartitionSpec())
        self._common = jax.tree.map(
            lambda leaf: jax.device_put(leaf, everywhere) if eqx.is_array_like(leaf) else leaf,
            common,
        )
        self._lengths = dict(common.capacity)
        if tasks.save_at is not None:
            self._lengths[common.saved] = tasks.save_at.shape[1]
        self._logs: dict[tuple[str, int], list[np.ndarray]] = {}
        self._running: object = None
        self._harvested = time.monotonic()
        self._first_report: tuple[float, float] | None = None
        self._harvest_seconds = 0.0
        self.turns = 0
        """Turns given so far, of lanes that advanced and of empty places."""

    def run(
        self,
        lanes: Sequence[int],
        on_ended: Callable[[Ended], None],
        on_progress: Callable[[Running], None] = lambda running: None,
    ) -> None:
        """Run the lanes of the given numbers, which begin in this order.

        `on_ended` gets each lane soon after it has ended, while others run; `on_progress` is called
        every some seconds.

        **Raises:** `KeyboardInterrupt` after Ctrl-C, when the devices rest and `on_ended` has got
        all lanes that had ended.
        """
        waiting, sitting, seats = deque(lanes), self.empty_pool(), None
        with interruptions_deferred() as stopped:
            try:
                while waiting or (sitting >= 0).any():
                    fresh = self._filled(sitting, waiting)
                    if seats is None or fresh.any():
                        seats = self._seated(sitting, fresh, seats)
                    seats, finished = self._advance(seats, sitting, waiting, on_progress, stopped)
                    self._take(seats, sitting, finished, on_ended)
                    if stopped():
                        raise KeyboardInterrupt
            finally:
                # A process that ends while a device computes is killed by a segmentation fault.
                jax.block_until_ready(self._running)

    def empty_pool(self) -> np.ndarray:
        """The number of the lane in each seat of all devices: none."""
        return np.full(self._extent.pool * self._mesh.size, -1)

    def _filled(self, sitting: np.ndarray, waiting: deque[int]) -> np.ndarray:
        """Put waiting lanes into empty seats, in turn on each busy device; which seats they are."""
        fresh = np.zeros(sitting.size, bool)
        for k in np.arange(sitting.size).reshape(self._mesh.size, -1)[: self._busy].T.ravel():
            if waiting and sitting[k] < 0:
                sitting[k], fresh[k] = waiting.popleft(), True
        return fresh

    def _seated(self, sitting: np.ndarray, fresh: np.ndarray, seats: Seat | None) -> Seat:
        """The pool with the lanes that begin now; empty seats hold a lane that has no time."""
        tasks = jax.tree.map(lambda leaf: leaf[np.maximum(sitting, 0)], self._tasks)
        ends = np.where(sitting >= 0, tasks.end_time, -np.inf)
        tasks = eqx.tree_at(lambda task: task.end_time, tasks, ends)
        numbers, tasks = jax.device_put((sitting.astype(float), tasks), self._across)
        begun = begin(self._common, self._mesh, numbers, tasks)
        if seats is None:
            return begun
        return replaced(jax.device_put(fresh, self._across), begun, seats)

    def _advance(
        self,
        seats: Seat,
        sitting: np.ndarray,
        waiting: Sequence[int],
        on_progress: Callable[[Running], None],
        stopped: Callable[[], bool],
    ) -> tuple[Seat, np.ndarray]:
        """Segments until lanes that have ended are to be taken; and which seats have such lanes.

        The next segment runs while the host reads the last one's report, so that there is one more
        than it takes; in that, lanes that have ended stay as they are.
        """
        taken, notice = sitting >= 0, SlowRunNotice()
        constants = self._common, self._extent, self._mesh
        seats, status, page = advance(constants, seats)
        ready = False
        while not ready:
            seats, next_status, next_page = advance(constants, seats)
            self._running = next_status
            left = self._read(status, page, sitting)
            on_progress(self._reached(status, sitting, len(waiting)))
            notice.check()
            status, page = next_status, next_page
            ready = stopped() or self._harvest_is_due(left, taken, bool(waiting))
        return seats, taken & (self._read(status, page, sitting) <= 0.0)

    def _harvest_is_due(self, left: np.ndarray, taken: np.ndarray, waiting: bool) -> bool:
        """Whether the lanes left no longer fill the places of a device, or lanes have ended and the
        last harvest is some time ago."""
        busy = (left.reshape(self._mesh.size, -1)[: self._busy] > 0.0).sum(axis=1)
        if busy.max() == 0 or (waiting and busy.min() < self._extent.places):
            return True
        pause = max(HARVEST_PERIOD, self._harvest_seconds / HARVEST_SHARE)
        return bool((taken & (left <= 0.0)).any()) and time.monotonic() - self._harvested > pause

    def _reached(self, status: Status, sitting: np.ndarray, waiting: int) -> Running:
        """How far the lanes in the pool are."""
        left, now = np.asarray(status.left), np.asarray(status.time)
        start, runs = float(self._common.start_time), (sitting >= 0) & (left > 0.0)
        begun = runs & (now > start)
        times = now[begun] if begun.any() else np.array([start])
        lanes = int(runs.sum())
        span = self._tasks.end_time[np.maximum(sitting, 0)] - start
        share = np.where(runs, (now - start) / span, 0.0)
        known = runs & (share > UNKNOWN_SHARE) & (share < 1.0)
        seconds = None
        if known.any():
            length = float((left[known] / (1.0 - share[known])).mean())
            left = np.where(known, left, np.where(runs, length, 0.0))
            together = (left.sum() + waiting * length) / (self._extent.places * self._busy)
            seconds = self._seconds_of_turns(float(max(left.max(), together)))
        return Running(lanes, float(times.min()), float(times.max()), seconds)

    def _seconds_of_turns(self, turns: float) -> float | None:
        """How long so many turns take, s, by those since the first report."""
        now = time.monotonic(), self.turns / (self._extent.places * self._busy)
        self._first_report = self._first_report or now
        seconds, given = now[0] - self._first_report[0], now[1] - self._first_report[1]
        return turns * seconds / given if given else None

    def _read(self, status: Status, pages: Page, sitting: np.ndarray) -> np.ndarray:
        """Add what was recorded to the logs, and count the turns; the attempts each lane may still
        need."""
        self.turns += int(np.asarray(status.turns).sum()) * self._extent.places
        for name, counts in pages.counts.items():
            counts = np.asarray(counts)
            if not counts.any():
                continue
            rows, seats = np.asarray(pages.rows[name]), np.asarray(pages.seats)
            slices = counts.shape[0] // self._mesh.size
            for number, place in np.argwhere(counts):
                seat = seats[number, place] + number // slices * self._extent.pool
                log = self._logs.setdefault((name, int(sitting[seat])), [])
                log.append(rows[number, place, : counts[number, place]])
        return np.asarray(status.left)

    def _take(
        self,
        seats: Seat,
        sitting: np.ndarray,
        finished: np.ndarray,
        on_ended: Callable[[Ended], None],
    ) -> None:
        begun = time.monotonic()
        rows = self._rows(np.where(finished, sitting, -1))
        outcomes, channels = self._harvest(seats, rows)
        self._harvested = time.monotonic()
        self._harvest_seconds = self._harvested - begun
        for k in np.flatnonzero(finished):
            lane, read = jax.tree.map(lambda leaf, k=k: leaf[k], (outcomes, channels))
            logs = {name: (values, len(rows[name][k])) for name, values in read.items()}
            on_ended(Ended(int(sitting[k]), lane, logs))
            for name in self._lengths:
                self._logs.pop((name, int(sitting[k])), None)
            sitting[k] = -1

    def _rows(self, sitting: np.ndarray) -> dict[str, list[Rows]]:
        """By log, what the lane in each seat of the pool has recorded; nothing where none is."""
        none: list[Rows] = [np.zeros((0, 0))]
        return {
            name: [np.concatenate(self._logs.get((name, int(lane)), none)) for lane in sitting]
            for name in self._lengths
        }

    def _harvest(
        self, seats: Seat, rows: Mapping[str, Sequence[Rows]]
    ) -> tuple[Outcome, dict[str, dict[str, np.ndarray]]]:
        """Outcomes (seats,) and channels (seats, rows), by log and name, of the lanes of the pool.

        Rows are read block by block: a table of all rows that 512 seats may have can be hundreds of
        megabytes. Blocks have one length, so that the bits of a row depend on nobody's others.
        """
        lengths = {name: min(length, BLOCK_ROWS) for name, length in self._lengths.items()}
        filled = [-(-max(map(len, rows[name])) // lengths[name]) for name in rows]
        blocks = []
        for number in range(max([1, *filled])):
            tables = {
                name: self._table(seats, name, rows[name], number * length, length)
                for name, length in lengths.items()
            }
            tables = jax.device_put(tables, self._across)
            blocks.append(jax.device_get(harvest(self._common, self._mesh, seats, tables)))
        outcomes, first = blocks[0]
        return outcomes, {
            name: {
                key: lengthened(np.concatenate([b[name][key] for _, b in blocks], axis=1), length)
                for key in first[name]
            }
            for name, length in self._lengths.items()
        }

    def _table(
        self, seats: Seat, name: str, rows: Sequence[Rows], first: int, length: int
    ) -> np.ndarray:
        """A log's rows from the `first` on, (seats, length, columns), and zeros behind them."""
        slot = self._common.logs(seats.lane)[name].example()
        columns = sum(leaf[0].size for leaf in jax.tree.leaves(slot))
        table = np.zeros((len(rows), length, columns))
        for k, own in enumerate(rows):
            if len(block := own[first : first + length]):
                table[k, : len(block)] = block
        return table


def lengthened(columns: np.ndarray, length: int) -> np.ndarray:
    """Columns (seats, rows, ...) of so many rows: cut, or with zeros behind."""
    missing = max(length - columns.shape[1], 0)
    return np.pad(columns[:, :length], [(0, 0), (0, missing), *[(0, 0)] * (columns.ndim - 2)])
