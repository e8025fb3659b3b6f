"""Quantities along a motion with their derivatives, looked at while both are integrated.

The compiled part of `.sensitivities`, of fits and of horizons: a run with tangents that stops at
each time to look, and whose records are those of any run (`.advance`).
"""

from collections.abc import Callable, Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ...compilation import traced_once
from ...dynamics.contact_forces import EntrySpeeds
from ...dynamics.system import System
from ...math.vectors import Condition, Scalar
from ...model.bodies import State
from ...native import Native
from ...parametrisation.parametrised_scene import AbstractFamily
from ...quantities.base import Quantity
from ...quantities.instant import Instant
from ...result_codes import RESULTS
from ..step.dense_output import correct, look_inside
from ..step.method import Scheme
from ..step.step_state import Attempt, Method, Step, Variables
from ..step.stepping import attempt, blank_attempt, running
from ..step.systems import SystemFamily
from ..step.types import Gradients, Numbers
from ..step.variational import look_at_tangents, start_with_tangents
from .advance import Recorder, advance, latest_attempt
from .impact_recorder import ImpactRecord, ImpactRecorder, ImpactRow, most
from .row_buffer import RowBuffer
from .run_ends import final_result, named, state_of
from .sections import SectionRecord, SectionRecorder, after_sections

LATEST, IMPACTS, SECTIONS = "latest", "impacts", "sections"
"""Names of what is recorded on the way."""
RECORDERS: dict[str, Recorder] = {
    LATEST: latest_attempt,
    IMPACTS: ImpactRecorder().after,
    SECTIONS: after_sections,
}
Run = tuple[Step, dict[str, PyTree]]
"""The latest step, and what is recorded, by name."""
FEW_TIMES, GROWTH = 64, 8
"""Numbers of times are rounded up to one of 64, 512, 4096, ..., so that hardly another compiles
anything. A time that is repeated is looked at once, so that those added cost next to nothing."""


class Kept(eqx.Module):
    """What is kept of a run beside quantities.

    `states`: whether the states at the times are; `impacts`: room for so many of each contact, or
    ``None`` to table none; `sections`: whose crossings are tabled.
    """

    states: bool = eqx.field(default=False, static=True)
    impacts: int | None = eqx.field(default=None, static=True)
    sections: dict[str, SectionRecorder] = eqx.field(default_factory=dict)


NOTHING_ELSE = Kept()
IMPACTS_AT_FIRST = 512
"""Of each contact; a run that has more is repeated with room for `GROWTH` times as many."""


class Sampled(eqx.Module):
    """What was measured at N instants, and its derivatives along p parameters.

    - `values[name]`: (N,), `derivatives[name]`: (N, p), with respect to the scales' coordinates.
    - `reached`: (N,) whether the run came so far.
    - `time`, `result`, `attempts`, `accepted`: where and how it ended, and its steps.
    - `states`, in scalar form with N in front, `impacts` and `sections`, if they are kept. Times of
      impacts are since the start of the run.
    """

    values: dict[str, Numbers]
    derivatives: dict[str, Gradients]
    reached: jax.Array
    time: Scalar
    result: RESULTS
    attempts: Scalar
    accepted: Scalar
    states: State | None = None
    impacts: ImpactRecord | None = None
    sections: dict[str, SectionRecord] = eqx.field(default_factory=dict)


def followed(
    scheme: Scheme,
    family: AbstractFamily,
    outputs: Mapping[str, Quantity],
    times: jax.Array,
    t0: Scalar,
    t_end: Scalar,
    first_step: Scalar,
    max_steps: Scalar,
    kept: Kept = NOTHING_ELSE,
) -> Sampled:
    """Integrate state and derivatives, and look at quantities at rising times. Traceable.

    Steps go by a clock that starts with the run, at zero: the times of steps that land on impacts
    are rounded too coarsely long after time zero.
    """
    method, systems = scheme.method, SystemFamily(family, scheme.formulation, t0)
    system = systems.system()
    own_end, own_times = t_end - t0, times - t0
    first = start_with_tangents(method, systems, jnp.zeros_like(t0), own_end, first_step)
    records = _first_records(method, system, first, kept)
    tried = traced_once(attempt)
    records[LATEST] = blank_attempt(method, system, first, own_end, systems, tried)

    def go(now: Run) -> Run:
        step, records = now
        recorders = {name: RECORDERS[name] for name in records}
        return advance(
            method, system, step, own_end, records, recorders, family=systems, attempt=tried
        )

    def sample(now: Run, row: tuple[Scalar, Condition]) -> tuple[Run, PyTree]:
        time, is_new = row
        step, records = now = jax.lax.while_loop(
            lambda now: (now[0].t < time) & running(now[0], own_end, max_steps), go, now
        )
        looks = _sample(method, systems, outputs, records[LATEST], time, is_new, kept)
        return now, (*looks, time <= step.t)

    is_new = jnp.diff(own_times, prepend=-jnp.inf) > 0.0
    (step, records), (*looks, states, reached) = _scanned(
        sample, (first, records), (own_times, is_new)
    )
    latest = jax.lax.cummax(jnp.where(is_new, jnp.arange(len(times)), 0))
    values, derivatives = jax.tree.map(lambda leaf: leaf[latest], looks)
    return Sampled(
        values=values,
        derivatives=derivatives,
        reached=reached,
        time=jnp.where(step.t < own_end, t0 + step.t, t_end),
        result=final_result(step, own_end),
        attempts=step.attempts,
        accepted=step.accepted,
        states=states,
        impacts=records.get(IMPACTS),
        sections=records[SECTIONS],
    )


def _scanned(
    sample: Callable[[Run, PyTree], tuple[Run, PyTree]], run: Run, rows: PyTree
) -> tuple[Run, PyTree]:
    """`jax.lax.scan` over rows, block by block: a loop copies at every turn all that it has written
    so far, which took ten times as long as the run at 4096 times."""
    count = len(jax.tree.leaves(rows)[0])
    if count <= FEW_TIMES or count % FEW_TIMES != 0:
        return jax.lax.scan(sample, run, rows)
    blocks = jax.tree.map(lambda leaf: leaf.reshape(-1, FEW_TIMES), rows)
    run, found = jax.lax.scan(lambda run, block: jax.lax.scan(sample, run, block), run, blocks)
    return run, jax.tree.map(lambda leaf: leaf.reshape(count, *leaf.shape[2:]), found)


def _first_records(method: Method, system: System, first: Step, kept: Kept) -> dict[str, PyTree]:
    """What is recorded beside the latest attempt, before the first step."""
    records: dict[str, PyTree] = {
        SECTIONS: {name: of.start(system, first) for name, of in kept.sections.items()}
    }
    if kept.impacts is not None:
        empty = RowBuffer.like(ImpactRow.none(), kept.impacts)
        records[IMPACTS] = ImpactRecorder().start(method, system, first, empty)
    return records


def _sample(
    method: Method,
    systems: SystemFamily,
    outputs: Mapping[str, Quantity],
    last: Attempt,
    time: Scalar,
    is_new: Condition,
    kept: Kept,
) -> tuple[PyTree, PyTree, State | None]:
    """Quantities and their derivatives at an instant of the latest step, or nothing of one that has
    been looked at; and the state there, if it is kept."""
    values, derivatives = jax.lax.cond(
        is_new,
        lambda: _looked_at(method, systems, outputs, last, time),
        lambda: _nothing(systems, outputs),
    )
    if not kept.states:
        return values, derivatives, None
    system = systems.system()
    return values, derivatives, named(state_of(system, *look_inside(method, system, last, time)))


def _nothing(
    family: SystemFamily, outputs: Mapping[str, Quantity]
) -> tuple[dict[str, Scalar], dict[str, Scalar]]:
    """What stands in the place of quantities at a time that has been looked at."""
    along = jnp.zeros(len(family.values))
    return dict.fromkeys(outputs, jnp.zeros(())), dict.fromkeys(outputs, along)


def _looked_at(
    method: Method,
    family: SystemFamily,
    outputs: Mapping[str, Quantity],
    tried: Attempt,
    time: Scalar,
) -> tuple[dict[str, Scalar], dict[str, Scalar]]:
    """Quantities at an instant of an accepted step, and their derivatives."""
    dense = look_inside(method, family.system(), tried, time)

    def observed(
        system: System, y: Variables, entry_speeds: EntrySpeeds
    ) -> tuple[dict[str, Scalar], None]:
        y = correct(system, y, time)
        now = Instant(system, time, y.motion, entry_speeds, y.work, y.bristles)
        return {name: jnp.asarray(of(now), float) for name, of in outputs.items()}, None

    values, _, derivatives = family.pushed(observed, dense, look_at_tangents(method, tried, time))
    return values, derivatives


sampled_compiled: Native[..., Sampled] = Native(followed)


def recorded_run(
    arguments: tuple[PyTree, ...],
    states: bool,
    impacts: bool,
    sections: dict[str, SectionRecorder],
) -> Sampled:
    """What was seen of a run (host arrays), with as much room for impacts as it has of them."""
    room = IMPACTS_AT_FIRST if impacts else None
    while True:
        kept = Kept(states, room, sections)
        sampled: Sampled = jax.device_get(sampled_compiled(*arguments, kept))
        if sampled.impacts is None or room is None or most(sampled.impacts) <= room:
            return sampled
        room *= GROWTH


def padded(times: np.ndarray, end_time: float) -> np.ndarray:
    """The times, and the end time, at least once, as often as makes their number one of few."""
    return np.append(times, np.full(few(len(times) + 1) - len(times), float(end_time)))


def few(count: int) -> int:
    """The least of few numbers that is not below a number of times."""
    size = FEW_TIMES
    while size < count:
        size *= GROWTH
    return size
