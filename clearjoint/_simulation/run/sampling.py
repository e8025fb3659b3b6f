"""Runs with tangents, which evaluate quantities and their derivatives at given times, for
`sensitivities`, `identify` and `fit_horizon`.

Runge-Kutta methods commute with differentiation: the derivative of a step with respect to a
parameter is the same step of the variational equations, error estimate included. Hence an attempt
differentiates the step for all parameters at once, and controls all errors together.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..._compilation.xla import one_call, traced_once
from ..._dynamics.bristles import initial_bristles
from ..._dynamics.contact_events import initial_entry_speeds
from ..._dynamics.contact_forces import EntrySpeeds
from ..._dynamics.sampled_forces import initial_memories
from ..._dynamics.system import System
from ..._fields.objects import on_device
from ..._math.vectors import Condition, Scalar
from ..._model.bodies import State
from ..._model.joints.base import each_label
from ..._native import Native
from ..._native.lowering import LONGEST_PACKED
from ..._parametrisation.parametrised_scene import (
    AbstractSceneFamily,
    Coordinates,
    ParametrisedScene,
)
from ..._result_codes import RESULTS
from ..step.dense_output import Quantities, Snapshot, at_end, dense_time, look_inside, stabilised
from ..step.method import Scheme, SystemFamily
from ..step.settings import Settings
from ..step.step_state import Attempt, Method, SolverState, Step, Tangents, Variables, choose
from ..step.stepping import attempt, start
from ..step.trial_step import term_of
from ..step.types import Gradients, Integers, Numbers
from .host_run import IMPACTS, LATEST
from .impact_recorder import ImpactRecorder, most
from .recorders import LatestAttempt, TangentPeak, TangentPeakRecorder
from .run_loop import Progress, Recorders, Records, RunLoop, final_result

FEW_TIMES, GROWTH = 64, 8
"""The number of times in a compiled program is rounded up to 64, 512, 4096 ..., so that few
programs are compiled. The additional times repeat the end time, where nothing is computed again."""


PEAK = "peak"
"""Name of the recorder of the largest derivatives."""
IMPACTS_AT_FIRST = 512
"""Number of impacts of each contact for which the buffers of the first run have room. If a contact
has more, the run is repeated with `GROWTH` times as much room."""


class Sampled(eqx.Module):
    """Values of quantities at N times, and their derivatives with respect to p parameters.

    - `values[name]`: (N,), `derivatives[name]`: (N, p), in the quantity's unit, with respect to the
      coordinates of the parameters on their scales, such as logarithms.
    - `reached`: (N,), whether the run reached each time. Other rows are meaningless.
    - `time`: s, end of the run, a time of the scene.
    - `amplification`: (p,), v T/x for each parameter. v is the largest derivative of any speed, in
      magnitude. T is the time, s, from the instant of v to the end of the run. x is the largest
      derivative of any position from that instant on, in magnitude. The number bounds the relative
      error of x, divided by the relative error of v.
    - `states`: those at the N times, or ``None``; `records`: those of the run's recorders. Impacts
      have times since the start of the run, and crossings times of the scene.
    """

    values: dict[str, Numbers]
    derivatives: dict[str, Gradients]
    reached: jax.Array
    time: Scalar
    result: RESULTS
    attempts: Scalar
    accepted: Scalar
    amplification: jax.Array
    states: State | None = None
    records: Records = eqx.field(default_factory=dict)


Initial: TypeAlias = tuple[Variables, EntrySpeeds]
"""Variables and entry speeds as the initial state has them, or their derivatives."""


def initial_with_tangents(family: SystemFamily, t0: Scalar) -> tuple[Initial, Initial]:
    """Return variables and entry speeds at the start, `t0`, s; and their derivatives."""

    def initial(system: System, values: Coordinates) -> Initial:
        state = scenes.start(values)
        motion = system.encode(state.bodies)
        memory = initial_memories(system, motion, t0, state.memory)
        y = Variables(motion, {}, initial_bristles(system.scene, state.bristles), memory)
        return jax.tree.map(jnp.asarray, (y, state.entry_speeds))

    # `with_derivatives` evaluates a function of the system, and differentiates it along directions
    # of the parameters. For this it takes the derivatives of the function's other arguments, which
    # for the parameters themselves are these directions.
    scenes = family.family
    return family.with_derivatives(initial, (scenes.values,), (scenes.seeds,))


def first_tangents(
    method: Method,
    term: diffrax.ODETerm,
    family: SystemFamily,
    step: Step,
    t_end: Scalar,
    initial: tuple[Initial, Initial],
) -> Tangents:
    """Return the tangents before the first step, `step`. `initial`: the initial values and their
    derivatives, as `initial_with_tangents` returns them; `t_end`: any time after the start, s."""
    (_, entry_speeds), (y_along, entry_speeds_along) = initial

    # The solver of an explicit method has a state of its own: the rates at the start of the step,
    # which depend on the parameters too. The solver's `init` ignores the end of the first step, so
    # any later time may be passed.
    def solver_state(system: System, y: Variables, entry_speeds: EntrySpeeds) -> SolverState:
        return method.solver.init(term, step.t, t_end, y, (system, entry_speeds))

    # At the start, the energy ledger, `work`, does not depend on any of the parameters.
    zeros = jnp.zeros(family.family.tangents)
    y_along = replace(y_along, work=dict.fromkeys(step.y.work, zeros))

    # The entry speed of a contact that begins at the start is the penetration rate there, which
    # depends on the parameters as it does at a later onset: also through the time of the onset, by
    # the second time derivatives of the penetrations, `second_rates`.
    def completed(system: System, y: Variables, entry_speeds: EntrySpeeds) -> EntrySpeeds:
        gaps = system.contact_gaps(y.motion)
        return initial_entry_speeds(system.scene, gaps, entry_speeds, step.second_rates)

    _, entry_speeds_along = family.with_derivatives(
        completed, (step.y, entry_speeds), (y_along, entry_speeds_along)
    )
    _, state_along = family.with_derivatives(
        solver_state, (step.y, step.entry_speeds), (y_along, entry_speeds_along)
    )
    return Tangents(y=y_along, entry_speeds=entry_speeds_along, solver_state=state_along)


def look_at_tangents(
    method: Method, system: System, attempt: Attempt, t: Scalar, entry_speeds: EntrySpeeds
) -> tuple[Variables, EntrySpeeds]:
    """Return the derivatives of variables and entry speeds at a time t, s since the start of the
    run, in the accepted step of an `attempt`: at its end those of the stored state, and inside it
    those of the dense output, without the correction by which `look_inside` satisfies the
    constraints. `entry_speeds`: their values at t, from `look_inside`."""
    t1, inside, at_t1 = attempt.step.t, attempt.tangents, attempt.step.tangents
    assert inside is not None and at_t1 is not None
    dense = method.solver.interpolation_cls(t0=attempt.t_start, t1=t1, **inside.information)
    is_end = at_end(system, t1, t)
    y = choose(is_end, at_t1.y, dense.evaluate(dense_time(attempt, t)))

    def speed_along(name: str, label: str) -> Gradients:
        # A contact that began earlier in this step has the entry speed, and its derivatives, of the
        # step's end. All others have those of the start.
        before = attempt.entry_speeds_start[name][label]
        began = (before == 0.0) & (entry_speeds[name][label] > 0.0)
        kept = inside.entry_speeds_start[name][label]
        return jnp.where(is_end | began, at_t1.entry_speeds[name][label], kept)

    return y, each_label(speed_along, entry_speeds)


def values_and_derivatives(
    method: Method, systems: SystemFamily, tried: Attempt, time: Scalar, quantities: Quantities
) -> tuple[dict[str, Scalar], dict[str, Gradients]]:
    """Return quantities, and their derivatives along the tangents of the accepted step `tried`, at
    a time inside the step, s since the start of the run."""
    inside = look_inside(method, systems.system(), tried, time)
    dense = inside.y, inside.entry_speeds
    along = look_at_tangents(method, systems.system(), tried, time, inside.entry_speeds)

    def observed(system: System, y: Variables, entry_speeds: EntrySpeeds) -> dict[str, Scalar]:
        # The variables from `look_inside` are corrected already, but their derivatives from
        # `look_at_tangents` are not. The correction is repeated here, where it is differentiated.
        now = Snapshot(time, stabilised(system, y, time), entry_speeds)
        return now.values(system, quantities)

    return systems.with_derivatives(observed, dense, along)


def first_step_of(
    scheme: Scheme, family: AbstractSceneFamily, t0: Scalar, t_end: Scalar, first_step: Scalar
) -> Step:
    # Times count from the start: steps that end at impacts need a resolution finer than the
    # rounding errors of large times.
    systems, method = SystemFamily(family, scheme.formulation, t0), scheme.method
    own_start, own_end = jnp.zeros_like(t0), t_end - t0
    initial, term = initial_with_tangents(systems, own_start), term_of(method)
    # Entry speeds and energy ledger, which the initial state may lack, are added by `start`.
    span = own_start, own_end, first_step
    step = start(method, term, systems.system(), *span, *initial[0], derivatives=True)
    return replace(step, tangents=first_tangents(method, term, systems, step, own_end, initial))


class TangentRun(eqx.Module):
    """A run with tangents, which evaluates quantities and their derivatives at given times: the
    whole run of `sensitivities` and fits.

    - `outputs`: the quantities, by name.
    - `times`: (N,) s, not decreasing, not before `start_time`. The last must be `end_time` or later
      (see `padded`), or the run would stop early; those after `end_time` are not reached.
    - `recorders`: further recorders; `has_states`: whether to keep the state at each time.
    """

    scheme: Scheme
    family: ParametrisedScene
    outputs: Quantities
    times: Numbers
    start_time: Numbers
    end_time: Numbers
    first_step: Numbers
    max_steps: Integers
    recorders: dict[str, Recorders] = eqx.field(default_factory=dict)
    has_states: bool = eqx.field(static=True, default=False)

    @staticmethod
    def of(
        scheme: Scheme,
        family: ParametrisedScene,
        outputs: Quantities,
        times: np.ndarray,
        span: tuple[float, float],
        settings: Settings,
        recorders: dict[str, Recorders],
        has_states: bool = False,
    ) -> "TangentRun":
        """Return the run over a `span`, s, with the numbers of `settings`, and pad the `times`."""
        return TangentRun(
            scheme=scheme,
            family=family,
            outputs=outputs,
            times=on_device(padded(times, span[1])),
            start_time=on_device(span[0]),
            end_time=on_device(span[1]),
            first_step=on_device(settings.length_of_first_step(*span)),
            max_steps=on_device(settings.max_steps, int),
            recorders=recorders,
            has_states=has_states,
        )


def _sampled_from(first: Step, run: TangentRun) -> Sampled:
    """Return the results of a run that starts from `first`, the result of `first_step_of`."""
    method, outputs, t0 = run.scheme.method, run.outputs, run.start_time
    systems = SystemFamily(run.family, run.scheme.formulation, t0)
    # The loop counts times from the start of the run.
    system, own_end, own_times = systems.system(), run.end_time - t0, run.times - t0
    all_recorders = {LATEST: LatestAttempt(), PEAK: TangentPeakRecorder(), **run.recorders}
    # JAX would otherwise trace an attempt again wherever `loop` calls it.
    tried = traced_once(attempt)
    loop = RunLoop(method, system, own_end, all_recorders, family=systems, attempt=tried)

    no_values = dict.fromkeys(outputs, jnp.zeros(()))
    no_derivatives = dict.fromkeys(outputs, jnp.zeros(run.family.tangents))

    def sample(now: Progress, row: tuple[Scalar, Condition]) -> tuple[Progress, PyTree]:
        time, is_new = row
        # Steps are not shortened to end at the time, since evaluation must not change the motion.
        now = loop.until(time, now, run.max_steps)
        latest = now.records[LATEST]

        def quantities() -> tuple[dict[str, Scalar], dict[str, Gradients]]:
            return values_and_derivatives(method, systems, latest, time, outputs)

        # At a repeated time, quantities need not be computed: those at the first of equal times are
        # copied below. States are not copied, so they are computed at every time.
        values = jax.lax.cond(is_new, quantities, lambda: (no_values, no_derivatives))
        state = None
        if run.has_states:
            system = systems.system()
            state = look_inside(method, system, latest, time).state(system)
        is_reached = time <= now.step.t  # false if the run ended before
        return now, (*values, state, is_reached)

    is_new = jnp.diff(own_times, prepend=-jnp.inf) > 0.0
    now, (*sampled, states, reached) = _scanned(sample, loop.start(first), (own_times, is_new))
    step, records = now.step, now.records
    # Index of the first of equal times, of which the quantities are copied.
    firsts = jax.lax.cummax(jnp.where(is_new, jnp.arange(len(own_times)), 0))
    values, derivatives = jax.tree.map(lambda leaf: leaf[firsts], sampled)
    return Sampled(
        values=values,
        derivatives=derivatives,
        reached=reached,
        # At the end this is `end_time` itself, as t0 + (end_time - t0) may differ from it by
        # rounding.
        time=jnp.where(step.t < own_end, t0 + step.t, run.end_time),
        result=final_result(step, own_end),
        attempts=step.attempts,
        accepted=step.accepted,
        states=states,
        records={name: records[name] for name in run.recorders},
        amplification=_amplification(step, records[PEAK]),
    )


def _amplification(step: Step, peak: TangentPeak) -> jax.Array:
    # Nothing is amplified if no position depends on the parameter: the result is then zero.
    positions = jnp.where(peak.positions > 0.0, peak.positions, jnp.inf)
    return peak.size * (step.t - peak.time) / positions


def _scanned(
    sample: Callable[[Progress, PyTree], tuple[Progress, PyTree]], run: Progress, rows: PyTree
) -> tuple[Progress, PyTree]:
    # In each iteration, XLA copies all outputs that the loop has written so far. With 4096 rows,
    # one loop took ten times as long as the run. Numbers of rows from `padded` are multiples of
    # `FEW_TIMES`; for others, a single loop is used.
    count = len(jax.tree.leaves(rows)[0])
    if count <= FEW_TIMES or count % FEW_TIMES != 0:
        return jax.lax.scan(sample, run, rows)
    blocks = jax.tree.map(lambda leaf: leaf.reshape(-1, FEW_TIMES), rows)
    run, rows = jax.lax.scan(lambda run, block: jax.lax.scan(sample, run, block), run, blocks)
    return run, jax.tree.map(lambda leaf: leaf.reshape(count, *leaf.shape[2:]), rows)


# The start is a program of its own: it is a quarter of the code, and runs once.
first_compiled = Native(first_step_of)
sampled_compiled: Native[..., Sampled] = Native(_sampled_from)


def sampled(run: TangentRun) -> Sampled:
    """Return the results of a run. For more than `LONGEST_PACKED` parameters, there are several
    runs, each with the derivatives by some of them; values, states and records are those of the
    first run."""
    parts, span = [], (run.start_time, run.end_time, run.first_step)
    with one_call():
        for group in run.family.in_groups(LONGEST_PACKED):
            first = first_compiled(run.scheme, group, *span)
            parts.append(sampled_compiled(first, replace(run, family=group)))
    return parts[0] if len(parts) == 1 else _joined(parts, len(run.family.values))


def _joined(runs: list[Sampled], count: int) -> Sampled:
    """Join runs, each with the derivatives by some of `count` parameters, to one result."""

    # All runs have equally many parameters: if there are too few for the last run, it repeats the
    # last parameter. The columns of the repetitions are cut off.
    def together(*parts: jax.Array) -> jax.Array:
        return jnp.concatenate(parts, axis=-1)[..., :count]

    # The code of the first run that has failed.
    result = runs[0].result
    for run in runs[1:]:
        result = RESULTS.where(result == RESULTS.successful, run.result, result)
    return replace(
        runs[0],
        derivatives=jax.tree.map(together, *(run.derivatives for run in runs)),
        amplification=together(*(run.amplification for run in runs)),
        reached=jnp.stack([run.reached for run in runs]).all(axis=0),
        time=jnp.stack([run.time for run in runs]).min(),
        result=result,
        attempts=sum(run.attempts for run in runs),
        accepted=sum(run.accepted for run in runs),
    )


def recorded_run(run: TangentRun, impacts: bool) -> Sampled:
    """Return the result of `sampled` as NumPy arrays. With `impacts`, all impacts are recorded, in
    the record `IMPACTS`; the run is repeated with larger buffers until these have room for all
    impacts."""
    room = IMPACTS_AT_FIRST
    while True:
        every = {IMPACTS: ImpactRecorder(capacity=room)} if impacts else {}
        sampled_run = sampled(replace(run, recorders=run.recorders | every))
        result: Sampled = jax.device_get(sampled_run)
        if not impacts or most(result.records[IMPACTS]) <= room:
            return result
        room *= GROWTH


def padded(times: np.ndarray, end_time: float) -> np.ndarray:
    """Return `times`, (N,) s, with copies of the end time, s, appended until their number is 64,
    512, 4096 ...; at least one, so that the run reaches its end."""
    size = FEW_TIMES
    while size <= len(times):
        size *= GROWTH
    return np.append(times, np.full(size - len(times), float(end_time)))
