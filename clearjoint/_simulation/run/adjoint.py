"""Derivatives of a run in reverse mode, by any number of parameters.

A run with one tangent, the derivative along a single direction of all parameters, chooses the
steps; this tangent is called the guard. Steps that are controlled by the errors of the state alone
are too long for derivatives, but steps that suit the derivative along a direction that moves the
contacts suit the derivatives along all other directions too. The accepted steps are recorded. A
step maps the tangents at its start, and the direction of the parameters, linearly to the tangents
at its end, with the corrections at contact events of `..step.saltation`. The transposes of these
maps, applied from the last step to the first, give the derivatives by all parameters.

In all functions here, `values` are the values of the parameters, and `example` is a `Step` of the
run of which only structure, shapes and dtypes are used.
"""

from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree
from typing_extensions import override

from ..._compilation.xla import traced_once
from ..._math.vectors import Condition, Scalar
from ..._native import Native
from ..._parametrisation.parametrised_scene import DirectedScene
from ..reductions.base import AbstractReduction
from ..step.dense_output import Quantities, look_inside
from ..step.method import Scheme, SystemFamily
from ..step.solvers import DenseInformation, UnrolledExplicit
from ..step.step_state import Attempt, Step, Tangents, TangentsInside
from ..step.stepping import accepted_state, attempt
from ..step.time_map import AbstractTimeMap
from ..step.trial_step import solved_step, term_of, time_map_of, with_gaps
from ..step.types import Integers, Numbers
from .host_run import Outcome, end_of
from .outputs import REDUCTIONS
from .recorders import ReductionRecorder, RowBuffer
from .run_loop import AbstractRecorder, Progress, RunLoop, RunStart, StepOutcome
from .sampling import first_step_of, first_tangents, initial_with_tangents, values_and_derivatives

ROWS = 1024
"""Number of accepted steps in a segment of the run, and in a call of the backward loop."""
Values = dict[str, Numbers]


def step_row(step: Step, t1: Scalar) -> tuple[Step, Scalar]:
    """Return what is recorded of an accepted step that begins with `step` and ends at `t1`, s since
    the run's start: `step` without the fields that no derivative of the run needs, and `t1`."""
    proposal = replace(
        step.proposal, t_next=None, full_length=None, entry_length=None, controller_state=None
    )
    needed = replace(
        step, proposal=proposal, result=None, attempts=None, accepted=None, tangents=None
    )
    return needed, t1


def in_one_array(tree: PyTree) -> jax.Array:
    leaves = jax.tree.leaves(tree)
    return jnp.concatenate([jnp.ravel(jnp.asarray(leaf, float)) for leaf in leaves])


def like(example: PyTree, numbers: Numbers) -> PyTree:
    """Invert `in_one_array`: give `numbers`, (n,), structure, shapes and dtypes of `example`."""
    leaves, structure = jax.tree.flatten(example)
    converted, start = [], 0
    for leaf in leaves:
        end = start + np.size(leaf)
        part = numbers[start:end].reshape(np.shape(leaf))
        # For thirty joints, asking JAX for the dtypes of all leaves takes several milliseconds.
        dtype = leaf.dtype if hasattr(leaf, "dtype") else jnp.result_type(leaf)
        # `in_one_array` has made 0.0 and 1.0 of ``False`` and ``True``.
        converted.append(part != 0.0 if dtype is np.dtype(bool) else part.astype(dtype))
        start = end
    return jax.tree.unflatten(structure, converted)


class AcceptedSteps(AbstractRecorder[RowBuffer[jax.Array]]):
    """Recorder of accepted steps, a `step_row` each. The caller must empty the buffer when full."""

    capacity: int = eqx.field(static=True)

    @override
    def start(self, start: RunStart) -> RowBuffer[jax.Array]:
        return RowBuffer.like(in_one_array(step_row(start.step, start.step.t)), self.capacity)

    @override
    def after(
        self, record: RowBuffer[jax.Array], step_outcome: StepOutcome
    ) -> RowBuffer[jax.Array]:
        row = step_row(step_outcome.before, step_outcome.after.t)
        return record.with_row(in_one_array(row), step_outcome.accepted)


STEPS = "steps"


class Adjoint(eqx.Module):
    """What runs at different values of their parameters have in common.

    - `family`: the scene for given parameters, and the direction whose derivative controls steps.
    - `reductions`: by name, those such as `Peak` whose result is at an instant that the run finds.
    - `origin`, `end`: s, the scene's time at the start and at the end of the run.
    - `first_step`: s, length of the first step; `max_steps`: largest number of attempts.
    """

    scheme: Scheme
    family: DirectedScene
    reductions: dict[str, AbstractReduction]
    origin: Numbers
    end: Numbers
    first_step: Numbers
    max_steps: Numbers

    @property
    def own_end(self) -> Scalar:
        """The end of the run, s since the start of the run."""
        return self.end - self.origin

    def systems(self, values: PyTree, direction: PyTree | None = None) -> SystemFamily:
        """Return the equations of motion at `values` of the parameters, with derivatives along
        `direction`, for JAX to transpose; by default along the direction of `family`."""
        family, is_transposed = replace(self.family, values=values), direction is not None
        if is_transposed:
            family = replace(family, direction=direction)
        return SystemFamily(family, self.scheme.formulation, self.origin, is_transposed)

    def loop(self, values: PyTree, rows: int) -> RunLoop:
        """Return the loop of a run, with a buffer for `rows` accepted steps."""
        systems = self.systems(values)
        reductions = {
            name: ReductionRecorder(reduction) for name, reduction in self.reductions.items()
        }
        recorders = {STEPS: AcceptedSteps(rows), REDUCTIONS: reductions}
        method, system, tried = self.scheme.method, systems.system(), traced_once(attempt)
        return RunLoop(method, system, self.own_end, recorders, family=systems, attempt=tried)

    def start(self, values: PyTree, rows: int) -> Progress:
        family = replace(self.family, values=values)
        first = first_step_of(self.scheme, family, self.origin, self.end, self.first_step)
        return self.loop(values, rows).start(first)


@Native
def begun(run: Adjoint, values: PyTree) -> tuple[Step, PyTree]:
    """Return a run's initial `Step`, and the initial tallies of the reductions, by name."""
    start = run.start(values, 1)
    return start.step, start.records[REDUCTIONS]


@Native
def segment(
    run: Adjoint, values: PyTree, step: Step, tallies: PyTree
) -> tuple[Step, PyTree, RowBuffer[jax.Array]]:
    """Continue a run from `step`, with the `tallies` of its reductions, to its end, a failure, the
    limit of attempts, or a full buffer of `ROWS` steps. Return the new step and tallies, and a
    buffer of `step_row`s."""
    loop = run.loop(values, ROWS)
    rows = loop.recorders[STEPS].start(RunStart(loop, step))

    def has_room(now: Progress) -> Condition:
        return jnp.logical_not(now.records[STEPS].is_full())

    begin = Progress(step, {STEPS: rows, REDUCTIONS: tallies})
    now = loop.until(run.own_end, begin, run.max_steps, has_room)
    return now.step, now.records[REDUCTIONS], now.records[STEPS]


@Native
def ended(run: Adjoint, values: PyTree, step: Step, tallies: PyTree) -> Outcome:
    """Return the outcome of a run from the `step` and the `tallies` at its end."""
    return end_of(run.systems(values).system(), run.reductions, tallies, step, run.own_end)


def _linear_step(
    run: Adjoint, values: PyTree, step: Step, t1: Scalar, tangents: Tangents, direction: PyTree
) -> tuple[Tangents, TangentsInside]:
    """Return the tangents at the end of the accepted step from `step` to `t1`, s, and those of its
    dense output; linear in the `tangents` at its start and the parameters' `direction`."""
    method, systems = run.scheme.method, run.systems(values, direction)
    system, step = systems.system(), replace(step, tangents=tangents)
    trial = with_gaps(solved_step(method, system, step, t1, systems))
    end = accepted_state(trial, jnp.asarray(True)).tangents
    assert end is not None and trial.tangents is not None
    return end, TangentsInside(tangents.entry_speeds, trial.tangents.information)


def _row_of(example: Step, row: jax.Array) -> tuple[Step, Scalar]:
    """Return the start of a step and its end time, s, from `row`, the numbers of a `step_row`. The
    tangents are ``None``; other fields that a `step_row` leaves out are those of `example`."""
    recorded, t1 = like(step_row(example, example.t), row)
    return eqx.combine(recorded, replace(example, tangents=None)), t1


@Native
def repeated(run: Adjoint, values: PyTree, example: Step, rows: Numbers) -> jax.Array:
    """Compute N steps again from the numbers of their `step_row`s, (N, n). Return the numbers of
    their `Attempt`s, (N, k), which dense output needs. `example`: any `Step` of the run."""
    method, system = run.scheme.method, run.systems(values).system()

    def again(_: None, row: jax.Array) -> tuple[None, jax.Array]:
        step, t1 = _row_of(example, row)
        trial = with_gaps(solved_step(method, system, step, t1, None))
        after = accepted_state(trial, jnp.asarray(True))
        return None, in_one_array(_attempt(step, after, trial.outcome.information, trial.time_map))

    return jax.lax.scan(again, None, rows)[1]


def _attempt(
    step: Step, after: Step, information: DenseInformation, time_map: AbstractTimeMap | None
) -> Attempt:
    return Attempt(
        # Dense output needs neither of these.
        step=replace(after, second_rates={}, solver_state=None),
        accepted=jnp.asarray(True),
        t_start=step.t,
        entry_speeds_start=step.entry_speeds,
        information=information,
        time_map=time_map,
    )


def _attempt_of(run: Adjoint, example: Step, numbers: Numbers) -> Attempt:
    """Return the `Attempt` whose `numbers`, (k,), are a row of the result of `repeated`."""
    method, step = run.scheme.method, replace(example, tangents=None)
    assert isinstance(method.solver, UnrolledExplicit)
    information = method.solver.information_like(step.y)
    return like(_attempt(step, step, information, time_map_of(method, step, step.t)), numbers)


@Native
def values_at(
    run: Adjoint, values: PyTree, example: Step, outputs: Quantities, steps: Numbers, times: Numbers
) -> Values:
    """Return the quantities `outputs`, (N,) each, at N `times`, s since the run's start. Row k of
    `steps`, (N, n), is the row of the result of `repeated` for the step in which time k lies."""
    method, system = run.scheme.method, run.systems(values).system()

    def at(_: None, pair: tuple[jax.Array, Scalar]) -> tuple[None, Values]:
        tried, time = _attempt_of(run, example, pair[0]), pair[1]
        return None, look_inside(method, system, tried, time).values(system, outputs)

    return jax.lax.scan(at, None, (steps, times))[1]


class StepTangents(NamedTuple):
    """Tangents at the end of a step, and those that dense output needs inside the step."""

    end: Tangents
    inside: TangentsInside


def example_of(run: Adjoint, example: Step) -> StepTangents:
    """Return an example of the structure, shapes and dtypes of `StepTangents`, from any `Step`."""
    tangents, solver = example.tangents, run.scheme.method.solver
    assert tangents is not None and isinstance(solver, UnrolledExplicit)
    information = solver.information_like(tangents.y)
    return StepTangents(tangents, TangentsInside(tangents.entry_speeds, information))


@Native
def pulled_outputs(
    run: Adjoint,
    values: PyTree,
    example: Step,
    outputs: Quantities,
    steps: Numbers,
    times: Numbers,
    cotangents: dict[str, Numbers],
) -> tuple[jax.Array, PyTree]:
    """Pull back cotangents of the derivatives of quantities at N times. These derivatives depend
    linearly on the tangents of the steps in which the times lie, and on the direction of the
    parameters. Return for each time the cotangents of the `StepTangents` of its step, (N, m), and
    those of the direction, summed over all times. `cotangents`: (N,) for each quantity; other
    arguments as in `values_at`."""
    method, zeros = run.scheme.method, jax.tree.map(jnp.zeros_like, values)

    # Pulls the cotangents at one time back. `total`: those of the direction at earlier times.
    def pull(total: PyTree, row: PyTree) -> tuple[PyTree, jax.Array]:
        numbers, time, seeds = row
        tried = _attempt_of(run, example, numbers)

        # Returns the derivatives of the quantities at this time.
        def along(tangents: StepTangents, direction: PyTree) -> Values:
            step = replace(tried.step, tangents=tangents.end)
            with_tangents = replace(tried, step=step, tangents=tangents.inside)
            systems = run.systems(values, direction)
            _, derivatives = values_and_derivatives(method, systems, with_tangents, time, outputs)
            return derivatives

        # `along` is linear in both arguments. JAX transposes it for arguments like these examples.
        transposed = jax.linear_transpose(along, example_of(run, example), zeros)
        # A derivative has a first axis of length 1, since there is one tangent.
        pulled, by_direction = transposed({name: seed[None] for name, seed in seeds.items()})
        return jax.tree.map(jnp.add, total, by_direction), in_one_array(pulled)

    total, pulled = jax.lax.scan(pull, zeros, (steps, times, cotangents))
    return pulled, total


class Pulled(NamedTuple):
    """Cotangents that have been pulled back through all but the first `count` steps: `cotangents`,
    (q,), are those of the tangents after these steps; `total` are those of the direction of the
    parameters, summed over the outputs and all later steps."""

    count: Integers
    cotangents: Numbers
    total: PyTree


class PulledSteps(NamedTuple):
    """Steps through which cotangents are pulled back.

    - `rows`: (M, n), a `step_row` for each step.
    - `added`: (A, m), a row of zeros, then cotangents of the `StepTangents` of steps with outputs.
    - `places`: (M,), for each step the index of its row in `added`; 0 for a step without outputs.
    """

    rows: Numbers
    added: Numbers
    places: Numbers


def pulled(
    run: Adjoint, values: PyTree, example: Step, steps: PulledSteps, after: Pulled
) -> Pulled:
    """Pull cotangents back through one of the `steps`, the one with the index `after.count` - 1.
    `after` are the cotangents after this step; return those before it."""
    example_tangents, example_step_tangents = example.tangents, example_of(run, example)
    index = after.count - 1
    # `row` has the step. `place` is the row of `added` with the cotangents of the step's outputs.
    place = jax.lax.dynamic_index_in_dim(jnp.asarray(steps.places), index, keepdims=False)
    row = jax.lax.dynamic_index_in_dim(jnp.asarray(steps.rows), index, keepdims=False)
    of_outputs = jax.lax.dynamic_index_in_dim(jnp.asarray(steps.added), place, keepdims=False)
    step, t1 = _row_of(example, row)

    # The linear map of this step, which is transposed.
    def along(tangents: Tangents, direction: PyTree) -> tuple[Tangents, TangentsInside]:
        return _linear_step(run, values, step, t1, tangents, direction)

    # Cotangents from the outputs that are evaluated in this step; zero if there are none.
    from_outputs = like(example_step_tangents, of_outputs)
    zeros = jax.tree.map(jnp.zeros_like, values)
    # The tangents at the end of the step act on the step's outputs and on the later steps.
    end = jax.tree.map(jnp.add, from_outputs.end, like(example_tangents, after.cotangents))
    transposed = jax.linear_transpose(along, example_tangents, zeros)
    before, by_direction = transposed((end, from_outputs.inside))
    return Pulled(index, in_one_array(before), jax.tree.map(jnp.add, after.total, by_direction))


@Native
def backward(
    run: Adjoint, values: PyTree, example: Step, steps: PulledSteps, after: Pulled
) -> Pulled:
    """Pull cotangents back through the first `after.count` of the `steps`, from the last of these
    to the first. `after` are the cotangents after them; return those before them."""

    def body(_: Scalar, now: Pulled) -> Pulled:
        return pulled(run, values, example, steps, now)

    return jax.lax.fori_loop(0, after.count, body, after)


@Native
def pulled_start(
    run: Adjoint, values: PyTree, example: Step, row: Numbers, cotangents: Tangents
) -> PyTree:
    """Return the cotangents of the parameters' direction that follow from `cotangents` of the
    tangents before the run's first step. `row`: numbers of the `step_row` of the first step."""
    method, (step, _) = run.scheme.method, _row_of(example, jnp.asarray(row))

    def along(direction: PyTree) -> Tangents:
        systems = run.systems(values, direction)
        initial = initial_with_tangents(systems, step.t)
        return first_tangents(method, term_of(method), systems, step, run.own_end, initial)

    zeros = jax.tree.map(jnp.zeros_like, values)
    return jax.linear_transpose(along, zeros)(cotangents)[0]
