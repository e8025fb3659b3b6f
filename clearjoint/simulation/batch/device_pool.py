"""The pool of lanes on the devices: slices of turns for those with the most work left.

A pool holds the lanes that have begun and not ended. A slice is a native loop of some hundred
turns for a smaller number of them, the places. Before each slice most places go to the lanes that
come first, so that lanes end, and can be stored, in about the order in which they are given; the
others go to the lanes with the most work left, judged by their progress so far, so that no long
lane is left alone at the end.

Each device has a pool and places of its own and the same program; devices never speak to each
other, and a turn is elementwise in the lanes. So a lane's numbers depend neither on how many
devices there are nor on who runs beside it, or whether anyone does. But a program for one device
alone is compiled by other passes and rounds otherwise, so that a lonely CPU device has an idle one
beside it (`clearjoint.runtime`).
"""

from collections.abc import Callable
from functools import partial
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import PyTree

from ...compilation import Compiled
from ...fields.types import Single
from ...math.vectors import Scalar, Structured, pack, unpack
from ...model.bodies import State
from ...model.scene import Scene
from ...quantities.base import Quantity
from ..aliases import Numbers
from ..dense_output import Snapshot
from ..impact_recorder import ImpactRow
from .lane import WINDOW, Lane, Orders, Outcome, Plan, begin_lane, emptied, moves, outcome, turn
from .recording import AbstractRing, SlotRing

T = TypeVar("T")
Columns = dict[str, Scalar]
"""What is reported of a row, or of each of many, by name."""
ACROSS = PartitionSpec("lanes")
UNKNOWN_WORK = 500.0
"""Attempts, and share of the run, from which on a lane's progress tells what it has left."""
UNKNOWN_SHARE = 0.02
IN_ORDER = 0.5
"""Share of the places that go to the lanes that come first. With more, long lanes are left alone at
the end; with none, a few hundred lanes end all at about the same time."""


class Extent(eqx.Module):
    """How the lanes share a device.

    - `pool`: lanes that have begun; `places`: lanes that advance in a slice.
    - `turns`: of a slice, unless all lanes have ended or wait before; `slices`: before the host
      looks again.
    """

    pool: int = eqx.field(static=True)
    places: int = eqx.field(static=True)
    turns: int = eqx.field(default=256, static=True)
    slices: int = eqx.field(default=8, static=True)


class Task(eqx.Module):
    """A lane to run: what of its scene varies, its initial state (packed), and its end.

    `end_time` and `first_step` s; `save_at` (K,) s rising, or ``None``.
    """

    varied: PyTree
    state: State
    end_time: Numbers
    first_step: Numbers
    save_at: jax.Array | np.ndarray | None


class Seat(eqx.Module):
    """A lane in the pool, its place in the order of all lanes, its task, and how many rows it has
    recorded in each log."""

    number: Numbers
    task: Task
    lane: Lane
    recorded: dict[str, jax.Array]


class Common(eqx.Module):
    """What all lanes of a batch share.

    - `form`: the scene, what varies in it left as in the base; `start_time`: s.
    - `capacity`: rows to record, by log of a section or of a contact's impacts.
      `channels[log][name]`: quantities to report of each recorded state; `saved` is the name of the
      log of saved states.
    - `tables`: logs of the contacts of each table of impacts, by the table's name.
    - `programs`: digests of what is computed, if they are known. Compiled programs are kept for
      equal ones only, so that none is run that was traced from code since changed.
    """

    plan: Plan
    form: Structured
    start_time: Single
    capacity: dict[str, int] = eqx.field(default_factory=dict, static=True)
    channels: dict[str, dict[str, Quantity]] = eqx.field(default_factory=dict)
    saved: str = eqx.field(default="", static=True)
    programs: tuple[tuple[str, str], ...] = eqx.field(default=(), static=True)
    tables: dict[str, tuple[str, ...]] = eqx.field(default_factory=dict, static=True)

    def logs(self, lane: Lane) -> dict[str, AbstractRing]:
        """The rings of a lane by the log that they fill."""
        saved = {} if lane.saved is None else {self.saved: lane.saved}
        return saved | lane.rings()

    def scene(self, task: Task) -> Scene:
        """The scene of a lane, in scalar form."""
        tree = eqx.combine(task.varied, self.form.tree)
        return unpack(Structured(tree, self.form.patterns))


class Status(eqx.Module):
    """What the host looks at between segments.

    For each lane the attempts it may still need, zero if it has ended, and the time reached, s;
    and on each device the turns given to each place.
    """

    left: jax.Array
    time: jax.Array
    turns: jax.Array


class Page(eqx.Module):
    """Rows recorded in one slice, as (places, slots, columns); how many; and by which seats."""

    rows: dict[str, jax.Array]
    counts: dict[str, jax.Array]
    seats: jax.Array


@Compiled
def begin(common: Common, mesh: Mesh, numbers: jax.Array, tasks: Task) -> Seat:
    """The lanes of some tasks before their first steps, in the seats of a pool; `numbers` are their
    places in the order of all lanes."""

    def one(common: Common, number: Scalar, task: Task) -> Seat:
        orders = Orders(task.end_time, task.first_step, (jnp.inf,) * WINDOW, common.capacity)
        lane = begin_lane(common.plan, common.scene(task), task.state, common.start_time, orders)
        recorded = {name: jnp.zeros((), int) for name in common.logs(lane)}
        return Seat(number, task, lane, recorded)

    return _on_devices(mesh, jax.vmap(one, (None, 0, 0)), common, numbers, tasks)


@Compiled
def replaced(fresh: jax.Array, begun: Seat, seats: Seat) -> Seat:
    """The pool with lanes that have just begun in the seats that `fresh` names."""
    return _choose(fresh, begun, seats)


@partial(Compiled, donate="all-except-first")
def advance(constants: tuple[Common, Extent, Mesh], seats: Seat) -> tuple[Seat, Status, Page]:
    """Slice after slice, until all lanes of a device have ended or its slices are used up."""
    common, extent, mesh = constants

    def on_device(common: Common, seats: Seat) -> tuple[Seat, Status, Page]:
        def goes(now: tuple[Seat, Page, jax.Array]) -> jax.Array:
            return (now[2] < extent.slices) & (_work_left(common, now[0]) > 0.0).any()

        def go(now: tuple[Seat, Page, jax.Array]) -> tuple[Seat, Page, jax.Array]:
            seats, pages, number = now
            seats, page = _slice(common, extent, seats)
            pages = jax.tree.map(
                lambda all_of, new: jax.lax.dynamic_update_index_in_dim(all_of, new, number, 0),
                pages,
                page,
            )
            return seats, pages, number + 1

        first = jnp.arange(extent.places)
        blank = jax.eval_shape(lambda: _page(common, _of(seats.lane, first), first))
        pages = jax.tree.map(lambda p: jnp.zeros((extent.slices, *p.shape), p.dtype), blank)
        seats, pages, slices = jax.lax.while_loop(goes, go, (seats, pages, jnp.zeros((), int)))
        left = _work_left(common, seats)
        time = jnp.asarray(seats.lane.step.t)
        return seats, Status(left, time, slices[None] * extent.turns), pages

    return _on_devices(mesh, on_device, common, seats)


@Compiled
def harvest(
    common: Common, mesh: Mesh, seats: Seat, logs: dict[str, jax.Array]
) -> tuple[Outcome, dict[str, Columns]]:
    """Outcome of every lane of the pool, and the channels of its logs' rows."""

    def one(
        common: Common, seat: Seat, logs: dict[str, jax.Array]
    ) -> tuple[Outcome, dict[str, Columns]]:
        scene = common.scene(seat.task)
        read = {
            name: channels_of(common, scene, name, seat.lane, rows) for name, rows in logs.items()
        }
        return pack(outcome(common.plan, scene, seat.lane, seat.task.end_time)), read

    return _on_devices(mesh, jax.vmap(one, (None, 0, 0)), common, seats, logs)


def _all_at_once(function: Callable[[jax.Array], Columns], rows: jax.Array) -> Columns:
    return jax.vmap(function)(rows)


def channels_of(
    common: Common,
    scene: Scene,
    name: str,
    lane: Lane,
    rows: jax.Array,
    over: Callable[[Callable[[jax.Array], Columns], jax.Array], Columns] = _all_at_once,
) -> Columns:
    """The columns that are reported of rows of a log, by name; `over` applies a function to each of
    them."""
    example, structure = jax.tree.flatten(common.logs(lane)[name].example())
    system = common.plan.scheme.system(scene)
    ends = np.cumsum([leaf.size for leaf in example])[:-1]

    def at(row: jax.Array) -> Columns:
        parts = zip(jnp.split(row, ends), example, strict=True)
        columns = [part.reshape(leaf.shape) for part, leaf in parts]
        here: Snapshot | ImpactRow = jax.tree.unflatten(structure, columns)
        return here.columns(system, common.channels.get(name, {}))

    return over(at, rows)


def _on_devices(mesh: Mesh, function: Callable[..., T], shared: PyTree, *trees: PyTree) -> T:
    """The function of what is shared and of the lanes, applied on each device to its lanes."""
    arrays, rest = eqx.partition(shared, eqx.is_array)

    def on_device(arrays: PyTree, *trees: PyTree) -> T:
        return function(eqx.combine(arrays, rest), *trees)

    specs = (PartitionSpec(), *(ACROSS for _ in trees))
    mapped = jax.shard_map(on_device, mesh=mesh, in_specs=specs, out_specs=ACROSS, check_vma=False)
    return mapped(arrays, *trees)


def _slice(common: Common, extent: Extent, seats: Seat) -> tuple[Seat, Page]:
    """Give the lanes of the places their turns; what they recorded, beside."""
    left = _work_left(common, seats)
    first = jnp.argsort(jnp.argsort(jnp.where(left > 0.0, seats.number, jnp.inf)))
    in_order = (first < IN_ORDER * extent.places) & (left > 0.0)
    order = jnp.argsort(jnp.where(in_order, -jnp.inf, -left))
    rank = jnp.argsort(order)
    seated = order[: extent.places]
    chosen = _of(seats, seated)
    orders = jax.vmap(partial(_orders, common))(chosen)

    def one(lane: Lane, task: Task, orders: Orders) -> Lane:
        return turn(common.plan, common.scene(task), lane, orders)

    def goes(now: tuple[jax.Array, Lane]) -> jax.Array:
        more = now[0] < extent.turns
        return more & jnp.any(jax.vmap(partial(moves, common.plan))(now[1], orders))

    def all_turn(now: tuple[jax.Array, Lane]) -> tuple[jax.Array, Lane]:
        return now[0] + 1, jax.vmap(one)(now[1], chosen.task, orders)

    _, lanes = jax.lax.while_loop(goes, all_turn, (jnp.zeros((), int), chosen.lane))
    page = _page(common, lanes, seated)
    recorded = {name: chosen.recorded[name] + count for name, count in page.counts.items()}
    chosen = Seat(chosen.number, chosen.task, emptied(lanes), recorded)
    advanced = _of(chosen, jnp.minimum(rank, extent.places - 1))
    return _choose(rank < extent.places, advanced, seats), page


def _of(lanes: T, numbers: jax.Array) -> T:
    """Those lanes of a tree that have such numbers."""
    return jax.tree.map(lambda leaf: leaf[numbers], lanes)


def _page(common: Common, lanes: Lane, seated: jax.Array) -> Page:
    """What lanes have recorded, of the seats that `seated` names."""
    rings = common.logs(lanes)
    counts = {name: ring.count for name, ring in rings.items()}
    return Page(
        {name: _table(ring) for name, ring in rings.items() if isinstance(ring, SlotRing)},
        counts,
        seated,
    )


def _table(ring: SlotRing) -> jax.Array:
    """The slots of many lanes' rings: (lanes, slots, columns)."""
    lanes = len(ring.count)
    rows = [
        jnp.concatenate([leaf.reshape(lanes, -1) for leaf in jax.tree.leaves(slot)], axis=-1)
        for slot in ring.slots
    ]
    return jnp.stack(rows, axis=1)


def _choose(condition: jax.Array, first: T, second: T) -> T:
    """For each lane the leaves of the first tree where the condition (lanes,) holds, else of the
    second."""
    return jax.tree.map(
        lambda a, b: jnp.where(condition.reshape(-1, *(1,) * (a.ndim - 1)), a, b), first, second
    )


def _orders(common: Common, seat: Seat) -> Orders:
    """What is asked of a lane in the next slice."""
    window: tuple[Scalar, ...] = (jnp.inf,) * WINDOW
    if common.saved:
        assert seat.task.save_at is not None
        times = jnp.concatenate([seat.task.save_at, jnp.full(WINDOW, jnp.inf)])
        following = jax.lax.dynamic_slice_in_dim(times, seat.recorded[common.saved], WINDOW)
        window = tuple(following[k] for k in range(WINDOW))
    wanted = {name: count - seat.recorded[name] for name, count in common.capacity.items()}
    return Orders(seat.task.end_time, seat.task.first_step, window, wanted)


def _work_left(common: Common, seats: Seat) -> jax.Array:
    """Attempts that each lane may still need; zero if it has ended."""
    step, end = seats.lane.step, seats.task.end_time
    whole = end - common.start_time
    done = step.t - common.start_time + UNKNOWN_SHARE * whole
    guess = (end - step.t) * (step.attempts + UNKNOWN_WORK) / done
    left = jnp.where(jax.vmap(partial(_runs, common))(seats), jnp.maximum(guess, 1.0), 0.0)
    if not common.saved:
        return left
    following = jax.vmap(lambda seat: _orders(common, seat).window[0])(seats)
    return jnp.maximum(left, jnp.where(following <= step.t, 1.0, 0.0))


def _runs(common: Common, seat: Seat) -> Scalar:
    return seat.lane.runs(common.plan, seat.task.end_time)
