"""Run with tangents that evaluates quantities and their derivatives at given times.

This is the compiled part of `sensitivities`, `identify` and `fit_horizon`. The steps are those
of a `RunLoop`, as in runs without derivatives.
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
from ...parametrisation.parametrised_scene import ParametrisedScene
from ...quantities.base import Quantity
from ...quantities.instant import Instant
from ...result_codes import RESULTS
from ..step.dense_output import correct, look_inside
from ..step.method import Scheme
from ..step.step_state import Attempt, Method, Variables
from ..step.stepping import attempt
from ..step.systems import SystemFamily
from ..step.types import Gradients, Numbers
from ..step.variational import look_at_tangents, start_with_tangents
from .impact_recorder import ImpactRecord, ImpactRecorder, most
from .recorders import LatestAttempt
from .run_ends import final_result, named, state_of
from .run_loop import Progress, Recorders, RunLoop
from .sections import SectionRecord, SectionRecorder
from .segments import IMPACTS, LATEST, SECTIONS

FEW_TIMES, GROWTH = 64, 8
"""The number of times in a program is rounded up to 64, 512, 4096 ..., so that few programs are
compiled. The additional times repeat the end time. Repeated times are evaluated only once, so that
they cost almost nothing."""


class Kept(eqx.Module):
    """Results that a run with tangents keeps besides the values of quantities.

    - `states`: whether to keep the state at each of the times.
    - `impacts`: largest number of impacts of each contact, or ``None`` to record no impacts.
    - `sections`: recorders of crossings, by name of the section.
    """

    states: bool = eqx.field(default=False, static=True)
    impacts: int | None = eqx.field(default=None, static=True)
    sections: dict[str, SectionRecorder] = eqx.field(default_factory=dict)


NOTHING_ELSE = Kept()
IMPACTS_AT_FIRST = 512
"""Number of impacts of each contact for which there is room in the first run. If a contact has more
impacts, the run is repeated with room for `GROWTH` times as many."""


class Sampled(eqx.Module):
    """Values of quantities at N times, and their derivatives with respect to p parameters.

    - `values[name]`: (N,), in the quantity's unit.
    - `derivatives[name]`: (N, p), with respect to the coordinates of the parameters' scales.
    - `reached`: (N,), whether the run reached each time. Values at other times have no meaning.
    - `time`: s, the time at which the run ended; `result`: its result code.
    - `attempts`, `accepted`: numbers of steps that were tried, and that were accepted.
    - `states`: the state at each time, in scalar form with N in front; ``None`` unless kept.
    - `impacts`: record of impacts, whose times count from the start of the run; ``None`` unless
      kept.
    - `sections`: records of crossings, by name of the section.
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
    family: ParametrisedScene,
    outputs: Mapping[str, Quantity],
    times: jax.Array,
    t0: Scalar,
    t_end: Scalar,
    first_step: Scalar,
    max_steps: Scalar,
    kept: Kept = NOTHING_ELSE,
) -> Sampled:
    """Integrate the state and its derivatives, and evaluate quantities and their derivatives with
    respect to the parameters' coordinates at given times.

    The function can be traced by JAX.

    **Arguments:**

    - `scheme`: method and formulation of the equations of motion.
    - `family`: scene and initial state as functions of the p parameters.
    - `outputs`: the quantities to evaluate, by name.
    - `times`: (N,) s, rising or repeated.
    - `t0`, `t_end`: s, start and end of the run.
    - `first_step`: s, length of the first step that is tried.
    - `max_steps`: largest number of attempts.
    - `kept`: results to keep besides the values of the quantities.
    """
    method, systems = scheme.method, SystemFamily(family, scheme.formulation, t0)
    system = systems.system()
    # Steps go by a clock that is zero at the start of the run: steps that land on impacts need
    # times that are finer than the rounding of large times.
    own_end, own_times = t_end - t0, times - t0
    first = start_with_tangents(method, systems, jnp.zeros_like(t0), own_end, first_step)
    recorders: dict[str, Recorders] = {LATEST: LatestAttempt(), SECTIONS: kept.sections}
    if kept.impacts is not None:
        recorders[IMPACTS] = ImpactRecorder(capacity=kept.impacts)
    # JAX would otherwise trace an attempt again wherever `loop` calls it.
    tried = traced_once(attempt)
    loop = RunLoop(method, system, own_end, recorders, family=systems, attempt=tried)

    def sample(now: Progress, row: tuple[Scalar, Condition]) -> tuple[Progress, PyTree]:
        time, is_new = row
        # Steps go past the time, since evaluation must not change them.
        now = loop.until(time, now, max_steps)
        sampled = _sample(method, systems, outputs, now.records[LATEST], time, is_new, kept)
        return now, (*sampled, time <= now.step.t)

    is_new = jnp.diff(own_times, prepend=-jnp.inf) > 0.0
    now, (*sampled, states, reached) = _scanned(sample, loop.start(first), (own_times, is_new))
    step, records = now.step, now.records
    # At repeated times quantities were computed at the first only: copy its numbers. States were
    # computed at every time.
    latest = jax.lax.cummax(jnp.where(is_new, jnp.arange(len(times)), 0))
    values, derivatives = jax.tree.map(lambda leaf: leaf[latest], sampled)
    return Sampled(
        values=values,
        derivatives=derivatives,
        reached=reached,
        # At the end `t_end` itself, from which t0 + (t_end - t0) may differ by rounding.
        time=jnp.where(step.t < own_end, t0 + step.t, t_end),
        result=final_result(step, own_end),
        attempts=step.attempts,
        accepted=step.accepted,
        states=states,
        impacts=records.get(IMPACTS),
        sections=records[SECTIONS],
    )


def _scanned(
    sample: Callable[[Progress, PyTree], tuple[Progress, PyTree]], run: Progress, rows: PyTree
) -> tuple[Progress, PyTree]:
    """Apply `jax.lax.scan` to `sample` over rows, in blocks of `FEW_TIMES` rows.

    The result is that of a single `jax.lax.scan`.
    """
    # XLA copies in each turn all that a loop has written so far: at 4096 times one loop took ten
    # times as long as the run.
    count = len(jax.tree.leaves(rows)[0])
    if count <= FEW_TIMES or count % FEW_TIMES != 0:
        return jax.lax.scan(sample, run, rows)
    blocks = jax.tree.map(lambda leaf: leaf.reshape(-1, FEW_TIMES), rows)
    run, rows = jax.lax.scan(lambda run, block: jax.lax.scan(sample, run, block), run, blocks)
    return run, jax.tree.map(lambda leaf: leaf.reshape(count, *leaf.shape[2:]), rows)


def _sample(
    method: Method,
    systems: SystemFamily,
    outputs: Mapping[str, Quantity],
    latest: Attempt,
    time: Scalar,
    is_new: Condition,
    kept: Kept,
) -> tuple[dict[str, Scalar], dict[str, Gradients], State | None]:
    """Return quantities, their derivatives and the state at a time in the latest accepted step.

    **Arguments:**

    - `latest`: the attempt of that step.
    - `time`: s since the start of the run.
    - `is_new`: whether the time differs from the one before it. At a repeated time, quantities and
      derivatives are not computed; they are zeros.

    **Returns:** the quantities by name; their derivatives with respect to the parameters'
    coordinates, (p,) by name; and the state, or ``None`` if `kept` requests none.
    """
    # `cond` skips repeated times, such as padding, at which `followed` copies the numbers of the
    # first of equal times. It doesn't copy states, which are therefore computed at every time.
    no_value, no_derivatives = jnp.zeros(()), jnp.zeros(len(systems.values))
    values, derivatives = jax.lax.cond(
        is_new,
        lambda: _quantities(method, systems, outputs, latest, time),
        lambda: (dict.fromkeys(outputs, no_value), dict.fromkeys(outputs, no_derivatives)),
    )
    if not kept.states:
        return values, derivatives, None
    system = systems.system()
    variables, entry_speeds = look_inside(method, system, latest, time)
    return values, derivatives, named(state_of(system, variables, entry_speeds))


def _quantities(
    method: Method,
    family: SystemFamily,
    outputs: Mapping[str, Quantity],
    tried: Attempt,
    time: Scalar,
) -> tuple[dict[str, Scalar], dict[str, Gradients]]:
    """Return quantities at a time in an accepted step, s, and their derivatives (p,), by name.

    Derivatives are with respect to the coordinates of the p parameters.
    """
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
    """Run `followed` with room for all impacts, and return its result as NumPy arrays.

    **Arguments:** `arguments`: the arguments of `followed` except the last; `states`, `impacts`:
    whether to keep states and impacts; `sections`: recorders of crossings, by name.
    """
    room = IMPACTS_AT_FIRST if impacts else None
    while True:
        kept = Kept(states, room, sections)
        sampled: Sampled = jax.device_get(sampled_compiled(*arguments, kept))
        if sampled.impacts is None or room is None or most(sampled.impacts) <= room:
            return sampled
        room *= GROWTH


def padded(times: np.ndarray, end_time: float) -> np.ndarray:
    """Append copies of the end time to times, until their number is 64, 512, 4096 ...

    **Arguments:** `times`: (N,) s; `end_time`: s.
    """
    size = FEW_TIMES
    while size <= len(times):
        size *= GROWTH
    return np.append(times, np.full(size - len(times), float(end_time)))
