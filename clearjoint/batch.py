"""Continuous batching: many lanes, each on its own time and step size.

A pool holds the lanes that have begun and not ended. A slice is a native loop of some hundred turns
for a smaller number of them, the places; before each slice the places go to the lanes with the most
work left, judged by their progress so far. So no lane waits for the slowest, and all lanes of a pool
end at about the same time. When the lanes that are left no longer fill the places, the host takes the
results of those that have ended, and waiting ones come into the pool.

Each device has a pool and places of its own and the same program; devices never speak to each other,
and a turn is elementwise in the lanes. So a lane's numbers depend neither on how many devices there
are nor on who runs beside it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from .lanes import WINDOW, Lane, Orders, Outcome, Plan, begin_lane, emptied, outcome, turn
from .records import SLOTS, Ring, Row
from .reductions import Quantity
from .runtime import SlowRunNotice
from .vectors import Scalar, Structured, pack, unpack

ACROSS = PartitionSpec("lanes")
UNKNOWN_WORK = 500.0
"""Attempts, and share of the run, from which on a lane's progress tells what it has left."""
UNKNOWN_SHARE = 0.02


class Extent(eqx.Module):
    """How the lanes share a device.

    - `pool`: lanes that have begun; `places`: lanes that advance in a slice.
    - `turns`: of a slice; `slices`: before the host looks again.
    """

    pool: int = eqx.field(static=True)
    places: int = eqx.field(static=True)
    turns: int = 256
    slices: int = 8


class Task(eqx.Module):
    """A lane to run: what of its scene varies, its initial state (packed), and its end.

    `end_time` and `first_step` s; `save_at` (K,) s rising, or ``None``.
    """

    varied: Any
    state: Any
    end_time: Any
    first_step: Any
    save_at: Any | None


class Log(eqx.Module):
    """Rows recorded so far, and their number."""

    rows: Any
    count: Any

    @staticmethod
    def like(row: Any, length: int) -> "Log":
        """An empty log with room for `length` rows, and for a ring behind them."""
        rows = jax.tree.map(lambda leaf: jnp.zeros((length + SLOTS, *jnp.shape(leaf))), row)
        return Log(rows, jnp.zeros((), int))

    def with_ring(self, ring: Ring) -> "Log":
        """The ring's rows added."""
        stacked = jax.tree.map(lambda *slots: jnp.stack(slots), *ring.slots)
        rows = jax.tree.map(
            lambda log, new: jax.lax.dynamic_update_slice_in_dim(log, new, self.count, 0),
            self.rows,
            stacked,
        )
        return Log(rows, self.count + ring.count)


class Seat(eqx.Module):
    """A lane in the pool, its task, and what it has recorded."""

    task: Task
    lane: Lane
    saved: Log | None
    crossings: dict[str, Log]


class Common(eqx.Module):
    """What all lanes of a batch share.

    - `form`: the scene, what varies in it left as in the base; `start_time`: s.
    - `capacity`: crossings to record, by section. `channels[log][name]`: quantities to report of
      each recorded row; `saved` is the name of the log of saved states.
    """

    plan: Plan
    form: Structured
    start_time: Any
    capacity: dict[str, int] = eqx.field(default_factory=dict, static=True)
    channels: dict[str, dict[str, Quantity]] = eqx.field(default_factory=dict)
    saved: str = eqx.field(default="", static=True)

    def scene(self, task: Task) -> Any:
        """The scene of a lane, in scalar form."""
        tree = eqx.combine(task.varied, self.form.tree)
        return unpack(Structured(tree, self.form.patterns))


class Status(eqx.Module):
    """What the host looks at between segments: for each lane, and turns given on each device."""

    finished: Any
    time: Any
    attempts: Any
    turns: Any


@eqx.filter_jit
def begin(common: Common, mesh: Mesh, tasks: Task) -> Seat:
    """Lanes before their first steps."""

    def one(task: Task) -> Seat:
        orders = Orders(task.end_time, task.first_step, (jnp.inf,) * WINDOW, common.capacity)
        lane = begin_lane(common.plan, common.scene(task), task.state, common.start_time, orders)
        saved = None
        if lane.saved is not None:
            saved = Log.like(lane.saved.slots[0], task.save_at.shape[0])
        crossings = {
            name: Log.like(ring.slots[0], common.capacity[name])
            for name, ring in lane.crossings.items()
        }
        return Seat(task, lane, saved, crossings)

    return _on_devices(mesh, jax.vmap(one), tasks)


@eqx.filter_jit
def replaced(mesh: Mesh, fresh: Any, begun: Seat, seats: Seat) -> Seat:
    """The pool with fresh lanes in the places where `fresh` says so."""

    def choose(fresh: Any, begun: Seat, seats: Seat) -> Seat:
        return jax.tree.map(
            lambda a, b: jnp.where(fresh.reshape(-1, *(1,) * (a.ndim - 1)), a, b), begun, seats
        )

    return _on_devices(mesh, choose, fresh, begun, seats)


@eqx.filter_jit(donate="all-except-first")
def advance(constants: tuple[Common, Extent, Mesh], seats: Seat) -> tuple[Seat, Status]:
    """Slice after slice, until all lanes of a device have ended or its slices are used up."""
    common, extent, mesh = constants

    def on_device(seats: Seat) -> tuple[Seat, Status]:
        def goes(now: tuple[Seat, Any]) -> Any:
            return (now[1] < extent.slices) & (_work_left(common, now[0]) > 0.0).any()

        def go(now: tuple[Seat, Any]) -> tuple[Seat, Any]:
            return _slice(common, extent, now[0]), now[1] + 1

        seats, slices = jax.lax.while_loop(goes, go, (seats, jnp.zeros((), int)))
        step = seats.lane.step
        finished = _work_left(common, seats) <= 0.0
        return seats, Status(finished, step.t, step.attempts, slices[None] * extent.turns)

    return _on_devices(mesh, on_device, seats)


@eqx.filter_jit
def harvest(common: Common, mesh: Mesh, seats: Seat) -> tuple[Outcome, dict[str, Any]]:
    """Outcome of every lane of the pool, and of each log the channels and the number of rows."""

    def one(seat: Seat) -> tuple[Outcome, dict[str, Any]]:
        scene = common.scene(seat.task)
        logs = dict(seat.crossings)
        if seat.saved is not None:
            logs[common.saved] = seat.saved
        read = {
            name: (_channels(common, scene, name, log.rows), log.count)
            for name, log in logs.items()
        }
        return pack(outcome(common.plan, scene, seat.lane, seat.task.end_time)), read

    return _on_devices(mesh, jax.vmap(one), seats)


def _channels(common: Common, scene: Any, name: str, rows: Any) -> dict[str, Any]:
    """Time and quantities of the rows of a log, without the room for a ring behind them."""

    def at(row: Row) -> dict[str, Any]:
        now = row.instant(scene, common.plan.method.formulation)
        values = {key: quantity(now) for key, quantity in common.channels[name].items()}
        return {"time": row.t, **values}

    return jax.vmap(at)(jax.tree.map(lambda leaf: leaf[:-SLOTS], rows))


def _on_devices(mesh: Mesh, function: Callable[..., Any], *trees: Any) -> Any:
    """The function applied on each device to its share of the lanes."""
    specs = tuple(ACROSS for _ in trees)
    mapped = jax.shard_map(function, mesh=mesh, in_specs=specs, out_specs=ACROSS, check_vma=False)
    return mapped(*trees)


def _slice(common: Common, extent: Extent, seats: Seat) -> Seat:
    """Give the lanes with the most work left their turns."""
    order = jnp.argsort(-_work_left(common, seats))
    rank = jnp.argsort(order)
    chosen = jax.tree.map(lambda leaf: leaf[order[: extent.places]], seats)
    orders = jax.vmap(partial(_orders, common))(chosen)

    def one(lane: Lane, task: Task, orders: Orders) -> Lane:
        return turn(common.plan, common.scene(task), lane, orders)

    def all_turn(_: Any, lanes: Lane) -> Lane:
        return jax.vmap(one)(lanes, chosen.task, orders)

    lanes = jax.lax.fori_loop(0, extent.turns, all_turn, chosen.lane)
    chosen = jax.vmap(_logged)(eqx.tree_at(lambda seat: seat.lane, chosen, lanes))
    moved = rank < extent.places
    back = jnp.minimum(rank, extent.places - 1)
    return jax.tree.map(
        lambda new, old: jnp.where(moved.reshape(-1, *(1,) * (old.ndim - 1)), new[back], old),
        chosen,
        seats,
    )


def _orders(common: Common, seat: Seat) -> Orders:
    """What is asked of a lane in the next slice."""
    window: tuple[Scalar, ...] = (jnp.inf,) * WINDOW
    if seat.saved is not None:
        times = jnp.concatenate([seat.task.save_at, jnp.full(WINDOW, jnp.inf)])
        following = jax.lax.dynamic_slice_in_dim(times, seat.saved.count, WINDOW)
        window = tuple(following[k] for k in range(WINDOW))
    wanted = {name: common.capacity[name] - log.count for name, log in seat.crossings.items()}
    return Orders(seat.task.end_time, seat.task.first_step, window, wanted)


def _logged(seat: Seat) -> Seat:
    """The seat with the lane's rings emptied into the logs."""
    lane = seat.lane
    saved = seat.saved
    if saved is not None and lane.saved is not None:
        saved = saved.with_ring(lane.saved)
    crossings = {name: log.with_ring(lane.crossings[name]) for name, log in seat.crossings.items()}
    return Seat(seat.task, emptied(lane), saved, crossings)


def _work_left(common: Common, seats: Seat) -> Any:
    """Attempts that each lane may still need; zero if it has ended."""
    step, end = seats.lane.step, seats.task.end_time
    whole = end - common.start_time
    done = step.t - common.start_time + UNKNOWN_SHARE * whole
    guess = (end - step.t) * (step.attempts + UNKNOWN_WORK) / done
    left = jnp.where(jax.vmap(partial(_runs, common))(seats), jnp.maximum(guess, 1.0), 0.0)
    if seats.saved is None:
        return left
    following = jax.vmap(lambda seat: _orders(common, seat).window[0])(seats)
    return jnp.maximum(left, jnp.where(following <= step.t, 1.0, 0.0))


def _runs(common: Common, seat: Seat) -> Scalar:
    return seat.lane.runs(common.plan, seat.task.end_time)


@dataclass(frozen=True)
class Ended:
    """A lane that has ended: its number and outcome, and by log the recorded channels and their
    number (host arrays)."""

    lane: int
    outcome: Any
    logs: dict[str, tuple[dict[str, np.ndarray], int]]


class Batch:
    """Runs lanes on devices.

    **Arguments:** `common`: what all lanes share; `tasks`: the lanes in front of every array (host
    arrays); `devices`; `extent`: how lanes share a device.
    """

    def __init__(self, common: Common, tasks: Task, devices: Sequence[Any], extent: Extent):
        self._tasks = tasks
        self._mesh = Mesh(np.array(devices), ("lanes",))
        self._across = NamedSharding(self._mesh, ACROSS)
        everywhere = NamedSharding(self._mesh, PartitionSpec())
        self._common, self._extent = jax.tree.map(
            lambda leaf: jax.device_put(leaf, everywhere) if eqx.is_array_like(leaf) else leaf,
            (common, extent),
        )
        self.turns = 0
        """Turns given so far, of lanes that advanced and of empty places."""

    def run(
        self,
        lanes: Sequence[int],
        on_ended: Callable[[Ended], None],
        on_progress: Callable[[float], None] = lambda share: None,
    ) -> None:
        """Run the lanes of the given numbers.

        `on_ended` gets each lane after it has ended; `on_progress` how many lanes those still in
        the pool come to, by the share of their time that is done.
        """
        waiting = list(lanes)
        pool = self._extent.pool * self._mesh.size
        sitting = np.full(pool, -1)
        seats = None
        while waiting or (sitting >= 0).any():
            fresh = np.zeros(pool, bool)
            for k in self._across_devices(np.arange(pool)):
                if waiting and sitting[k] < 0:
                    sitting[k], fresh[k] = waiting.pop(0), True
            seats = self._seated(sitting, fresh, seats)
            seats, finished = self._advance_until_few(seats, sitting, len(waiting), on_progress)
            self._take(seats, sitting, finished, on_ended)

    def _across_devices(self, seats: np.ndarray) -> np.ndarray:
        """Numbers of seats in turn from each device, so that lanes spread over all of them."""
        return seats.reshape(self._mesh.size, -1).T.ravel()

    def _advance_until_few(
        self, seats: Seat, sitting: np.ndarray, waiting: int, on_progress: Callable[[float], None]
    ) -> tuple[Seat, np.ndarray]:
        """Segments until the unfinished lanes no longer fill the places of a device."""
        taken, notice = sitting >= 0, SlowRunNotice()
        end, start = self._tasks.end_time[np.maximum(sitting, 0)], float(self._common.start_time)
        while True:
            seats, status = advance((self._common, self._extent, self._mesh), seats)
            finished = np.asarray(status.finished)
            self.turns += int(np.asarray(status.turns).sum()) * self._extent.places
            notice.check()
            share = (np.asarray(status.time) - start) / (end - start)
            on_progress(float(np.where(finished, 1.0, share)[taken].sum()))
            left = self._across_devices(taken & ~finished).reshape(-1, self._mesh.size).sum(axis=0)
            if left.max() == 0 or (waiting and left.min() < self._extent.places):
                return seats, taken & finished

    def _seated(self, sitting: np.ndarray, fresh: np.ndarray, seats: Seat | None) -> Seat:
        numbers = np.maximum(sitting, 0)
        tasks = jax.tree.map(lambda leaf: leaf[numbers], self._tasks)
        idle = np.where(sitting >= 0, tasks.end_time, -np.inf)
        tasks = eqx.tree_at(lambda t: t.end_time, tasks, idle)
        begun = begin(self._common, self._mesh, jax.device_put(tasks, self._across))
        if seats is None:
            return begun
        return replaced(self._mesh, jax.device_put(fresh, self._across), begun, seats)

    def _take(
        self,
        seats: Seat,
        sitting: np.ndarray,
        finished: np.ndarray,
        on_ended: Callable[[Ended], None],
    ) -> None:
        found = jax.device_get(harvest(self._common, self._mesh, seats))
        for k in np.flatnonzero(finished):
            lane, logs = jax.tree.map(lambda leaf, k=k: leaf[k], found)
            on_ended(Ended(int(sitting[k]), lane, logs))
            sitting[k] = -1
