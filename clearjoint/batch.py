"""Continuous batching: many lanes in flight, each on its own time and step size.

A segment is a native loop of some hundred turns for all lanes in flight; between segments the host
takes out the lanes that have ended and puts waiting ones in their places, so that no lane waits for
the slowest. Lanes in flight are spread over the devices, which never speak to each other. Two groups
of lanes take turns, so that the devices work on one while the host looks at the other.

Every device runs the same program on the same number of lanes, and a turn is elementwise in the
lanes. So a lane's numbers do not depend on how many devices there are or on who runs beside it.
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
from .records import SLOTS, Row
from .runtime import SlowRunNotice
from .vectors import Structured, pack, unpack

TURNS = 1000
LANES_ON_CPU, LANES_ON_ACCELERATOR = 32, 4096
GROUPS = 2


@dataclass(frozen=True)
class Work:
    """The lanes to run, lanes in front of every array (host arrays).

    - `varied`: the scene with its varied leaves, ``None`` for the others.
    - `state`: initial states; `end_time`, `first_step`: (M,) s.
    - `save_at`: (M, K) s, rising, or ``None``.
    - `crossings`: how many are wanted of each section.
    """

    varied: Any
    state: Any
    end_time: np.ndarray
    first_step: np.ndarray
    save_at: np.ndarray | None
    crossings: dict[str, int]

    def __len__(self) -> int:
        return len(self.end_time)


@dataclass
class Finished:
    """A lane that has ended: its outcome, the rows it saved, and those of its sections."""

    lane: int
    outcome: Any
    saved: list[Any]
    crossings: dict[str, list[Any]]


class Incoming(eqx.Module):
    """Lanes for the places of a group; `fresh` says which of them begin now."""

    fresh: Any
    varied: Any
    state: Any
    orders: Orders


@eqx.filter_jit
def begin_lanes(plan: Plan, form: Structured, start_time: Any, incoming: Incoming) -> Lane:
    """All lanes of a group before their first steps."""
    return _begin(plan, form, start_time, incoming)


@eqx.filter_jit(donate="all-except-first")
def advance(
    constants: tuple[Plan, Structured, Any, Any, Mesh], lanes: Lane, incoming: Incoming
) -> tuple[Lane, Outcome]:
    """Begin the fresh lanes, and give every lane its turns."""
    plan, form, start_time, turns, mesh = constants
    across = PartitionSpec("lanes")

    @partial(
        jax.shard_map, mesh=mesh, in_specs=(across, across), out_specs=across, check_vma=False
    )
    def on_device(lanes: Lane, incoming: Incoming) -> tuple[Lane, Outcome]:
        begun = _begin(plan, form, start_time, incoming)
        lanes = jax.tree.map(
            lambda a, b: jnp.where(incoming.fresh, a, b), begun, emptied(lanes)
        )

        def one(lane: Lane, varied: Any, orders: Orders) -> Lane:
            return turn(plan, _scene(form, varied), lane, orders)

        def all_turn(_: Any, lanes: Lane) -> Lane:
            return jax.vmap(one)(lanes, incoming.varied, incoming.orders)

        lanes = jax.lax.fori_loop(0, turns, all_turn, lanes)
        found = jax.vmap(
            lambda lane, varied, orders: pack(outcome(plan, _scene(form, varied), lane, orders))
        )(lanes, incoming.varied, incoming.orders)
        return lanes, found

    return on_device(lanes, incoming)


def _begin(plan: Plan, form: Structured, start_time: Any, incoming: Incoming) -> Lane:
    def one(varied: Any, state: Any, orders: Orders) -> Lane:
        return begin_lane(plan, _scene(form, varied), state, start_time, orders)

    return jax.vmap(one)(incoming.varied, incoming.state, incoming.orders)


def _scene(form: Structured, varied: Any) -> Any:
    return unpack(Structured(eqx.combine(varied, form.tree), form.patterns))


class Group:
    """Places for lanes that advance together, and what the host knows of who sits there."""

    def __init__(self, batch: "Batch"):
        self._batch = batch
        self._places: list[Finished | None] = [None] * batch.places
        self._saved_before = np.zeros(batch.places, int)
        self._lanes: Lane | None = None
        self._pending: tuple[Lane, Outcome] | None = None

    def busy(self) -> bool:
        """Whether any lane is in flight."""
        return any(place is not None for place in self._places)

    def dispatch(self, waiting: list[int]) -> None:
        """Fill free places from the waiting lanes and start a segment."""
        fresh = np.zeros(len(self._places), bool)
        for k, place in enumerate(self._places):
            if place is None and waiting:
                work = self._batch.work
                self._places[k] = Finished(
                    waiting.pop(0), None, [], {name: [] for name in work.crossings}
                )
                fresh[k] = True
        if not self.busy():
            return
        incoming = self._batch.incoming(self._places, fresh)
        if self._lanes is None:
            self._lanes = self._batch.begin(incoming)
        self._pending = self._batch.advance(self._lanes, incoming)

    def collect(self) -> list[Finished]:
        """Wait for the segment; the lanes that have ended leave their places."""
        if self._pending is None:
            return []
        self._lanes, found = self._pending
        self._pending = None
        finished = np.asarray(found.finished)
        self._take_rows()
        done = []
        if finished.any():
            found = jax.device_get(found)
            for k, place in enumerate(self._places):
                if place is not None and finished[k]:
                    place.outcome = jax.tree.map(lambda leaf, k=k: leaf[k], found)
                    done.append(place)
                    self._places[k] = None
        return done

    def _take_rows(self) -> None:
        assert self._lanes is not None
        rings = [(self._lanes.saved, lambda place: place.saved)] if self._lanes.saved else []
        for name, ring in self._lanes.crossings.items():
            rings.append((ring, lambda place, name=name: place.crossings[name]))
        for ring, rows_of in rings:
            counts = np.asarray(ring.count)
            if not counts.any():
                continue
            slots = jax.device_get(ring.slots)
            for k, place in enumerate(self._places):
                if place is not None:
                    rows_of(place).extend(
                        jax.tree.map(lambda leaf, k=k: leaf[k], slots[i])
                        for i in range(counts[k])
                    )


class Batch:
    """Runs lanes on devices.

    **Arguments:** `plan`, `form`: what all lanes share; `work`: the lanes; `start_time`: s;
    `devices`; `lanes_in_flight`: for each device and group.
    """

    def __init__(
        self,
        plan: Plan,
        form: Structured,
        work: Work,
        start_time: float,
        devices: Sequence[Any],
        lanes_in_flight: int,
    ):
        self.work = work
        self.places = lanes_in_flight * len(devices)
        self._mesh = Mesh(np.array(devices), ("lanes",))
        self._lane_axis = NamedSharding(self._mesh, PartitionSpec("lanes"))
        everywhere = NamedSharding(self._mesh, PartitionSpec())
        self._plan, self._form, self._start_time = jax.tree.map(
            lambda leaf: jax.device_put(leaf, everywhere) if eqx.is_array_like(leaf) else leaf,
            (plan, form, start_time),
        )
        self.turns_given = 0

    def run(
        self, lanes: Sequence[int], on_finished: Callable[[Finished], None], groups: int = GROUPS
    ) -> None:
        """Run the lanes of the given numbers; `on_finished` gets each as it ends."""
        waiting, notice = list(lanes), SlowRunNotice()
        flights = [Group(self) for _ in range(groups)]
        for group in flights:
            group.dispatch(waiting)
        while any(group.busy() for group in flights):
            for group in flights:
                done = group.collect()
                group.dispatch(waiting)
                for lane in done:
                    on_finished(lane)
                notice.check()

    def begin(self, incoming: Incoming) -> Lane:
        """Lanes for all places of a group."""
        return begin_lanes(self._plan, self._form, self._start_time, incoming)

    def advance(self, lanes: Lane, incoming: Incoming) -> tuple[Lane, Outcome]:
        """Start a segment."""
        self.turns_given += TURNS * self.places
        constants = (self._plan, self._form, self._start_time, jnp.asarray(TURNS), self._mesh)
        return advance(constants, lanes, incoming)

    def incoming(self, places: Sequence[Finished | None], fresh: np.ndarray) -> Incoming:
        """What the places of a group hold, as device arrays. Free places repeat a lane."""
        work = self.work
        numbers = np.array([0 if place is None else place.lane for place in places])
        taken = np.array([place is not None for place in places])
        window = np.full((len(places), WINDOW), np.inf)
        wanted = {name: np.zeros(len(places), int) for name in work.crossings}
        for k, place in enumerate(places):
            if place is None:
                continue
            if work.save_at is not None:
                left = work.save_at[place.lane][len(place.saved) :][:WINDOW]
                window[k, : len(left)] = left
            for name, count in work.crossings.items():
                wanted[name][k] = count - len(place.crossings[name])
        end_time = np.where(taken, work.end_time[numbers], -np.inf)
        orders = Orders(
            end_time,
            work.first_step[numbers],
            tuple(np.ascontiguousarray(window[:, k]) for k in range(WINDOW)),
            wanted,
        )
        varied, state = jax.tree.map(lambda leaf: leaf[numbers], (work.varied, work.state))
        return jax.device_put(Incoming(fresh, varied, state, orders), self._lane_axis)
