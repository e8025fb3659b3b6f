"""Continuous batching, the host's part: who sits in the pool, and what was recorded.

When the lanes that are left no longer fill the places of a device, the host takes the results of
those that have ended, and waiting ones come into the pool. However few lanes are left, they go on
in the same program: one with fewer places, which is compiled anew, rounds otherwise.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from ...runtime import Device, SlowRunNotice, mesh_devices
from .device_pool import (
    ACROSS,
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
Rows = np.ndarray
"""What a lane has recorded in a log: (rows, columns)."""


@dataclass(frozen=True)
class Ended:
    """A lane that has ended: its number and outcome, and by log the recorded channels and their
    number (host arrays)."""

    lane: int
    outcome: Outcome
    logs: dict[str, tuple[dict[str, np.ndarray], int]]


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
        self.turns = 0
        """Turns given so far, of lanes that advanced and of empty places."""

    def run(
        self,
        lanes: Sequence[int],
        on_ended: Callable[[Ended], None],
        on_progress: Callable[[float], None] = lambda lanes: None,
    ) -> None:
        """Run the lanes of the given numbers.

        `on_ended` gets each lane after it has ended; `on_progress` how many lanes those still in
        the pool come to, by the share of their time that is done.
        """
        waiting = deque(lanes)
        sitting = self.empty_pool()
        seats = None
        while waiting or (sitting >= 0).any():
            fresh = self._filled(sitting, waiting)
            seats = self._seated(sitting, fresh, seats)
            seats, finished = self._advance_until_few(seats, sitting, bool(waiting), on_progress)
            self._take(seats, sitting, finished, on_ended)

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
        begun = begin(self._common, self._mesh, jax.device_put(tasks, self._across))
        if seats is None:
            return begun
        return replaced(jax.device_put(fresh, self._across), begun, seats)

    def _advance_until_few(
        self, seats: Seat, sitting: np.ndarray, waiting: bool, on_progress: Callable[[float], None]
    ) -> tuple[Seat, np.ndarray]:
        """Segments until the unfinished lanes no longer fill the places of a device.

        The next segment runs while the host reads the last one's report, so that there is one more
        than it takes; in that, lanes that have ended stay as they are.
        """
        taken, notice = sitting >= 0, SlowRunNotice()
        constants = self._common, self._extent, self._mesh
        seats, status, page = advance(constants, seats)
        few = False
        while not few:
            seats, next_status, next_page = advance(constants, seats)
            left = self._read(status, page, sitting).reshape(self._mesh.size, -1)[: self._busy]
            on_progress(self._progress(status, sitting))
            notice.check()
            status, page = next_status, next_page
            lanes = (left > 0.0).sum(axis=1)
            few = lanes.max() == 0 or (waiting and lanes.min() < self._extent.places)
        return seats, taken & (self._read(status, page, sitting) <= 0.0)

    def _progress(self, status: Status, sitting: np.ndarray) -> float:
        """How much of their spans the lanes in the pool have simulated, in whole lanes."""
        end, start = self._tasks.end_time[np.maximum(sitting, 0)], float(self._common.start_time)
        share = (np.asarray(status.time) - start) / (end - start)
        share = np.where(np.asarray(status.left) > 0.0, share, 1.0)
        return float(share[sitting >= 0].sum())

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
        rows = self._rows(sitting)
        outcomes, channels = self._harvested(seats, rows)
        for k in np.flatnonzero(finished):
            lane, read = jax.tree.map(lambda leaf, k=k: leaf[k], (outcomes, channels))
            logs = {name: (values, len(rows[name][k])) for name, values in read.items()}
            on_ended(Ended(int(sitting[k]), lane, logs))
            for name in self._lengths:
                self._logs.pop((name, int(sitting[k])), None)
            sitting[k] = -1

    def _rows(self, sitting: np.ndarray) -> dict[str, list[Rows]]:
        """By log, what each seat of the pool has recorded."""
        none: list[Rows] = [np.zeros((0, 0))]
        return {
            name: [np.concatenate(self._logs.get((name, int(lane)), none)) for lane in sitting]
            for name in self._lengths
        }

    def _harvested(
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
                key: _lengthened(np.concatenate([b[name][key] for _, b in blocks], axis=1), length)
                for key in first[name]
            }
            for name, length in self._lengths.items()
        }

    def _table(
        self, seats: Seat, name: str, rows: Sequence[Rows], first: int, length: int
    ) -> np.ndarray:
        """A log's rows from the `first` on, (seats, length, columns), and zeros behind them."""
        slot = self._common.logs(seats.lane)[name].slots[0]
        columns = sum(leaf[0].size for leaf in jax.tree.leaves(slot))
        table = np.zeros((len(rows), length, columns))
        for k, own in enumerate(rows):
            if len(block := own[first : first + length]):
                table[k, : len(block)] = block
        return table


def _lengthened(columns: np.ndarray, length: int) -> np.ndarray:
    """Columns (seats, rows, ...) of so many rows: cut, or with zeros behind."""
    missing = max(length - columns.shape[1], 0)
    return np.pad(columns[:, :length], [(0, 0), (0, missing), *[(0, 0)] * (columns.ndim - 2)])
