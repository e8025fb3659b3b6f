"""Derivatives of a run in reverse mode, by any number of parameters.

A run with one tangent, the guard, chooses the steps: a run whose steps are controlled by the states
alone has steps that are too long for derivatives, but steps that suit the derivative in a direction
that moves the contacts suit those in all others. Its accepted steps are recorded. A step maps the
tangents at its start, and the direction of the parameters, linearly to the tangents at its end,
with the corrections at contact events that are derived in `..step.saltation`. The transposes of
these maps, applied from the last step to the first, give the derivatives by all parameters.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree
from typing_extensions import override

from ..._compilation import traced_once
from ..._dynamics.system import System
from ..._export.datasets import Notes
from ..._fields.checks import require
from ..._math.vectors import Condition, Scalar
from ..._model.bodies import State
from ..._native import Native
from ..._parametrisation.parametrised_scene import DirectedScene
from ..._result_codes import RESULTS, result_number
from ...quantities.base import Instant, Quantity
from ..reductions.base import AbstractReduction, result_name
from ..results.solution import SUCCESSFUL, Solution
from ..step.dense_output import look_inside, stabilised
from ..step.method import Scheme, SystemFamily
from ..step.solvers import UnrolledExplicit
from ..step.step_state import Attempt, Method, Step, Tangents, TangentsInside
from ..step.stepping import accepted_state, attempt
from ..step.trial_step import solved_step
from ..step.types import Numbers
from .host_run import end_of
from .outputs import REDUCTIONS, Kept
from .recorders import ReductionRecorder, RowBuffer
from .run_loop import AbstractRecorder, Progress, RunLoop, RunStart, StepOutcome
from .sampling import first_step_of, look_at_tangents

ROWS = 1024
"""Number of accepted steps in a segment of the run, and in a call of the backward loop."""
Values = dict[str, Numbers]


class StepRow(NamedTuple):
    """What is recorded of an accepted step: all of the `Step` before it that its derivative needs,
    and the time of its end, s since the start of the run."""

    t: Scalar
    y: PyTree
    entry_speeds: PyTree
    contact_gaps: PyTree
    second_rates: PyTree
    solver_state: PyTree
    begins_contact: Condition
    time_since_onset: Scalar
    made_jump: Condition
    t1: Scalar

    @staticmethod
    def of(step: Step, t1: Scalar) -> "StepRow":
        p = step.proposal
        assert p.time_since_onset is not None
        return StepRow(
            *(step.t, step.y, step.entry_speeds, step.contact_gaps, step.second_rates),
            *(step.solver_state, p.begins_contact, p.time_since_onset, p.made_jump, t1),
        )

    def step(self, example: Step) -> Step:
        """Return the `Step` before the recorded one, without tangents; what the derivative does not
        need is that of an `example`."""
        proposal = replace(
            example.proposal,
            begins_contact=self.begins_contact,
            time_since_onset=self.time_since_onset,
            made_jump=self.made_jump,
        )
        return replace(
            example,
            t=self.t,
            y=self.y,
            entry_speeds=self.entry_speeds,
            contact_gaps=self.contact_gaps,
            second_rates=self.second_rates,
            solver_state=self.solver_state,
            proposal=proposal,
            tangents=None,
        )


def in_one_array(tree: PyTree) -> jax.Array:
    """Return the numbers of a PyTree, one leaf after the other, as an array (n,) of floats."""
    leaves = jax.tree.leaves(tree)
    return jnp.concatenate([jnp.ravel(jnp.asarray(leaf, float)) for leaf in leaves])


def like(example: PyTree, numbers: Numbers) -> PyTree:
    """Return the PyTree like an example of which `in_one_array` is `numbers`."""
    leaves, structure = jax.tree.flatten(example)
    made, start = [], 0
    for leaf in leaves:
        end = start + np.size(leaf)
        part = numbers[start:end].reshape(np.shape(leaf))
        dtype = jnp.result_type(leaf)
        made.append(part != 0.0 if dtype is np.dtype(bool) else part.astype(dtype))
        start = end
    return jax.tree.unflatten(structure, made)


class AcceptedSteps(AbstractRecorder[RowBuffer[jax.Array]]):
    """Recorder of the accepted steps of a run with tangents, as rows `in_one_array`. The caller
    must empty the buffer when it is full."""

    capacity: int = eqx.field(static=True)

    @override
    def start(self, start: RunStart) -> RowBuffer[jax.Array]:
        return RowBuffer.like(in_one_array(StepRow.of(start.step, start.step.t)), self.capacity)

    @override
    def after(
        self, record: RowBuffer[jax.Array], step_outcome: StepOutcome
    ) -> RowBuffer[jax.Array]:
        row = StepRow.of(step_outcome.before, step_outcome.after.t)
        return record.with_row(in_one_array(row), step_outcome.kept)


class Adjoint(eqx.Module):
    """A run whose derivatives are computed: its method, its scene along a direction of the
    parameters, and the scene's time at its start, s."""

    scheme: Scheme
    family: DirectedScene
    origin: Numbers

    def systems(self, direction: PyTree | None = None) -> SystemFamily:
        """Return the equations of motion with derivatives along the guard's direction, or along
        another one, of which they are then linear functions."""
        family = self.family
        if direction is not None:
            family = replace(family, direction=direction, transposable=True)
        return SystemFamily(family, self.scheme.formulation, self.origin)


STEPS = "steps"
Reductions = dict[str, ReductionRecorder]


@Native
def _begun(run: Adjoint, reductions: Reductions, end: Numbers, first_step: Numbers) -> Progress:
    start = first_step_of(run.scheme, run.family, run.origin, end, first_step)
    return _loop(run, reductions, end).start(start)


@Native
def _segment(
    run: Adjoint, reductions: Reductions, now: Progress, end: Numbers, attempts: Numbers
) -> Progress:
    """Continue a run to its end, a failure, the limit of `attempts` since its start, or a full
    buffer of accepted steps."""
    own_end = end - run.origin
    return _loop(run, reductions, end).until(
        own_end, now, attempts, lambda now: jnp.logical_not(now.records[STEPS].is_full())
    )


def _loop(run: Adjoint, reductions: Reductions, end: Numbers) -> RunLoop:
    systems = run.systems()
    recorders = {STEPS: AcceptedSteps(ROWS), REDUCTIONS: reductions}
    tried = traced_once(attempt)
    own_end = end - run.origin
    return RunLoop(
        run.scheme.method, systems.system(), own_end, recorders, family=systems, attempt=tried
    )


@Native
def _ended(
    run: Adjoint, reductions: Reductions, step: Step, tallies: dict[str, PyTree], end: Numbers
) -> tuple[State, RESULTS, dict[str, dict[str, Scalar]]]:
    """Return the final state, packed, the result code, and the results of the reductions."""
    return end_of(run.systems().system(), reductions, tallies, step, end - run.origin)


def _linear_step(
    run: Adjoint, step: Step, t1: Scalar, tangents: Tangents, direction: PyTree
) -> tuple[Tangents, TangentsInside]:
    """Return the tangents at the end of the accepted step from `step` to `t1`, s, and inside of it,
    as a linear function of those at its start and of the direction of the parameters."""
    method, systems = run.scheme.method, run.systems(direction)
    system, step = systems.system(), replace(step, tangents=tangents)
    trial = solved_step(method, system, step, t1, systems)
    end = accepted_state(method, system, systems, step, trial, jnp.asarray(True)).tangents
    assert end is not None and trial.tangents is not None
    return end, TangentsInside(tangents.entry_speeds, trial.tangents.information)


def _repeated(method: Method, system: System, step: Step, t1: Scalar) -> Attempt:
    trial = solved_step(method, system, step, t1, None)
    return Attempt(
        step=accepted_state(method, system, None, step, trial, jnp.asarray(True)),
        kept=jnp.asarray(True),
        t_start=step.t,
        entry_speeds_start=step.entry_speeds,
        information=trial.outcome.information,
        time_map=trial.time_map,
    )


def _observed(
    systems: SystemFamily, method: Method, tried: Attempt, time: Scalar, outputs: Mapping
) -> Values:
    """Return the derivatives of quantities at a time, s since the start, in an accepted step."""
    dense = look_inside(method, systems.system(), tried, time)
    along = look_at_tangents(method, tried, time, dense[1])

    def observed(system: System, y: PyTree, entry_speeds: PyTree) -> tuple[Values, None]:
        y = stabilised(system, y, time)
        instant = Instant(system, time, y.motion, entry_speeds, y.work, y.bristles)
        return {name: jnp.asarray(of(instant), float) for name, of in outputs.items()}, None

    return systems.with_derivatives(observed, dense, along)[2]


def _row_of(example: Step, row: jax.Array) -> tuple[Step, Scalar]:
    parts = like(StepRow.of(replace(example, tangents=None), example.t), row)
    return parts.step(example), parts.t1


@Native
def _values_at(
    run: Adjoint,
    example: Step,
    outputs: Mapping[str, Quantity],
    rows: Numbers,
    times: Numbers,
) -> Values:
    """Return quantities, (N,) each, at N times, s since the start of the run, of which each lies in
    the step of its row."""
    method, systems = run.scheme.method, run.systems()
    system = systems.system()

    def at(_: None, pair: tuple[jax.Array, Scalar]) -> tuple[None, Values]:
        tried = _repeated(method, system, *_row_of(example, pair[0]))
        y, entry_speeds = look_inside(method, system, tried, pair[1])
        instant = Instant(system, pair[1], y.motion, entry_speeds, y.work, y.bristles)
        return None, {name: jnp.asarray(of(instant), float) for name, of in outputs.items()}

    return jax.lax.scan(at, None, (rows, times))[1]


class StepTangents(NamedTuple):
    end: Tangents
    inside: TangentsInside


def _example_of(run: Adjoint, example: Step) -> StepTangents:
    tangents, solver = example.tangents, run.scheme.method.solver
    assert tangents is not None and isinstance(solver, UnrolledExplicit)
    information = solver.information_like(tangents.y)
    return StepTangents(tangents, TangentsInside(tangents.entry_speeds, information))


@Native
def _pulled_outputs(
    run: Adjoint,
    example: Step,
    outputs: Mapping[str, Quantity],
    rows: Numbers,
    times: Numbers,
    cotangents: dict[str, Numbers],
) -> tuple[jax.Array, PyTree]:
    """Return the transpose of the map from the tangents of steps, and the direction, to the
    derivatives of quantities at N times as in `_values_at`: the cotangents of the tangents of each
    step, (N, n), and the sum of those of the direction."""
    method, system = run.scheme.method, run.systems().system()
    none = jax.tree.map(jnp.zeros_like, run.family.values)

    def pull(total: PyTree, parts: PyTree) -> tuple[PyTree, jax.Array]:
        row, time, seeds = parts
        tried = _repeated(method, system, *_row_of(example, row))

        def along(tangents: StepTangents, direction: PyTree) -> Values:
            step = replace(tried.step, tangents=tangents.end)
            attempt = replace(tried, step=step, tangents=tangents.inside)
            return _observed(run.systems(direction), method, attempt, time, outputs)

        pulled, by_direction = jax.linear_transpose(along, _example_of(run, example), none)(
            {name: seed[None] for name, seed in seeds.items()}
        )
        return jax.tree.map(jnp.add, total, by_direction), in_one_array(pulled)

    total, pulled = jax.lax.scan(pull, none, (rows, times, cotangents))
    return pulled, total


@Native
def _backward(
    run: Adjoint,
    example: Step,
    rows: Numbers,
    added: Numbers,
    count: Numbers,
    cotangents: Numbers,
    total: PyTree,
) -> tuple[jax.Array, PyTree]:
    """Return the cotangents of the tangents before the first of `count` steps, and those of the
    direction, from the ones after the last step. The cotangents `added`, (rows, n), belong to the
    `StepTangents` of each step."""
    tangents, of_steps = example.tangents, _example_of(run, example)
    none = jax.tree.map(jnp.zeros_like, run.family.values)

    def pull(k: Scalar, now: tuple[jax.Array, PyTree]) -> tuple[jax.Array, PyTree]:
        cotangents, total = now
        index = count - 1 - k
        row, here = (
            jax.lax.dynamic_index_in_dim(array, index, keepdims=False) for array in (rows, added)
        )
        step, t1 = _row_of(example, row)

        def along(tangents: Tangents, direction: PyTree) -> tuple[Tangents, TangentsInside]:
            return _linear_step(run, step, t1, tangents, direction)

        seeds = like(of_steps, here)
        end = jax.tree.map(jnp.add, seeds.end, like(tangents, cotangents))
        pulled, by_direction = jax.linear_transpose(along, tangents, none)((end, seeds.inside))
        return in_one_array(pulled), jax.tree.map(jnp.add, total, by_direction)

    return jax.lax.fori_loop(0, count, pull, (cotangents, total))


@Native
def _pulled_start(run: Adjoint, end: Numbers, first_step: Numbers, cotangents: Tangents) -> PyTree:
    """Return the transpose of the map from the direction to the tangents before the first step."""

    def along(direction: PyTree) -> Tangents | None:
        family = run.systems(direction).family
        assert isinstance(family, DirectedScene)
        return first_step_of(run.scheme, family, run.origin, end, first_step).tangents

    none = jax.tree.map(jnp.zeros_like, run.family.values)
    return jax.linear_transpose(along, none)(cotangents)[0]


KEPT_BYTES = 30_000_000
"""Bytes of recorded steps that are kept. Those of the other segments are computed again when the
backward loop needs them."""


class _Segment(NamedTuple):
    """A part of a run: the numbers of the `Step` before it, the ends of its steps, s, (M,), and
    their rows, (M, n), unless these are to be computed again."""

    start: np.ndarray
    ends: np.ndarray
    rows: np.ndarray | None


class _Samples(NamedTuple):
    """Values of `quantities` at times, (N,) s since the start of a run, in steps of the numbers
    `places`, whose rows are `rows`, (N, n). The first of the times are those of the quantities that
    were asked for; the others are instants of reductions, `instants[name]`, s."""

    quantities: dict[str, Quantity]
    times: np.ndarray
    places: np.ndarray
    rows: np.ndarray
    instants: dict[str, tuple[float, ...]]


class RecordedRun:
    """A run with its accepted steps, from which values and derivatives of outputs follow.

    - `last`: the state at its end. If the run has failed, the values and derivatives at times that
      it has not reached are meaningless.

    **Arguments:** `outputs`: quantities and reductions; `times`: (N,) s, not decreasing, between
    the start and the `end` of the run, of the quantities.
    """

    def __init__(
        self,
        run: Adjoint,
        outputs: Kept,
        times: np.ndarray,
        end: float,
        first_step: float,
        max_steps: int,
    ):
        self._run, self._outputs, self._reductions = run, outputs, outputs.reductions
        found = {name: of for name, of in self._reductions.items() if of.finds_instants}
        self._recorders = {name: ReductionRecorder(of) for name, of in found.items()}
        self._span = np.asarray(end, float), np.asarray(first_step, float)
        self._limit, self._own_end = np.asarray(max_steps), float(end - run.origin)
        self._times = np.asarray(times - run.origin)
        now = _begun(run, self._recorders, *self._span)
        # The buffer is shared by all segments, of which each begins with an empty one.
        self._example, self._buffer = now.step, now.records[STEPS]
        self._tallies = now.records[REDUCTIONS]
        self._segments: list[_Segment] = []
        self.last = now.step
        kept, chosen = 0, []
        while self._goes_on():
            rows, after, tallies = self._recorded(self.last, self._tallies)
            # The step in which a time lies is the first that ends at or after it. If the run fails,
            # that of later times is its last one.
            ends = rows[:, -1].copy()
            is_last = not self._goes_on(after)
            begin, stop = np.searchsorted(self._times, (self._reached(), ends[-1]), side="right")
            stop = len(self._times) if is_last else stop
            begin = 0 if not self._segments else begin
            here = np.searchsorted(ends, self._times[begin:stop])
            chosen.append(rows[np.minimum(here, len(rows) - 1)])
            kept += rows.nbytes
            start, stored = _numbers_of(self.last), rows if kept <= KEPT_BYTES else None
            self._segments.append(_Segment(start, ends, stored))
            self.last, self._tallies = after, tallies
        self._chosen = np.concatenate(chosen)
        ended = _ended(run, self._recorders, self.last, self._tallies, self._span[0])
        self._final, self._result, self._results = ended

    def _goes_on(self, step: Step | None = None) -> bool:
        step = self.last if step is None else step
        ended = float(step.t) >= self._own_end or int(step.attempts) >= int(self._limit)
        return not ended and result_number(step.result) == SUCCESSFUL

    def _reached(self) -> float:
        return float(self.last.t) if self._segments else -np.inf

    def _recorded(self, start: Step, tallies: PyTree) -> tuple[np.ndarray, Step, PyTree]:
        progress = Progress(start, {STEPS: self._buffer, REDUCTIONS: tallies})
        now = _segment(self._run, self._recorders, progress, self._span[0], self._limit)
        return now.records[STEPS].filled(), now.step, now.records[REDUCTIONS]

    def _rows_of(self, segment: _Segment) -> np.ndarray:
        if segment.rows is not None:
            return segment.rows
        return self._recorded(like(self._example, segment.start), self._tallies)[0]

    def solution(self, settings: Notes) -> Solution:
        """Return the run as a `Solution` without records, with notes on the settings."""
        return Solution(
            time=float(self._run.origin) + float(self.last.t),
            final=self._final,
            result=self._result,
            attempts=self.last.attempts,
            accepted=self.last.accepted,
            saved=None,
            saved_count=None,
            steps=None,
            impacts=None,
            formulation=self._run.scheme.formulation,
            redundant_constraints=(),
            settings=settings,
        )

    @cached_property
    def _samples(self) -> _Samples:
        origin, end = float(self._run.origin), float(self._span[0])
        quantities, instants = dict(self._outputs.quantities), {}
        for name, reduction in self._reductions.items():
            instants[name] = reduction.instants(self._results.get(name, {}), (origin, end))
            is_reached = bool(
                np.all(np.diff(instants[name]) > 0.0) & np.all(np.isfinite(instants[name]))
            )
            argument, remedy = f"outputs[{name!r}]", "give a window that the run reaches"
            require(is_reached, argument, reduction, "a reduction over a part of the run", remedy)
            quantities |= _parts_of(name, reduction)
        further = np.asarray([t - origin for group in instants.values() for t in group])
        times = np.concatenate([self._times, further])
        ends = np.concatenate([segment.ends for segment in self._segments])
        places = np.minimum(np.searchsorted(ends, times), len(ends) - 1)
        rows = self._chosen
        if len(further):
            rows = np.concatenate([rows, self._rows_at(places[len(rows) :])])
        return _Samples(quantities, times, places, rows, instants)

    def _rows_at(self, places: np.ndarray) -> np.ndarray:
        """Return the rows of steps, by their numbers in the run."""
        rows, first = np.empty((len(places), self._chosen.shape[1])), 0
        for segment in self._segments:
            here = (first <= places) & (places < first + len(segment.ends))
            if here.any():
                rows[here] = self._rows_of(segment)[places[here] - first]
            first += len(segment.ends)
        return rows

    def values(self) -> dict[str, np.ndarray]:
        """Return the quantities, (N,) each, at the N times, and the results of reductions."""
        return self._combined(self._sampled)

    @cached_property
    def _sampled(self) -> dict[str, np.ndarray]:
        samples = self._samples
        arguments = samples.quantities, samples.rows, samples.times
        return _values_at(self._run, self._example, *arguments)

    def _combined(self, sampled: dict[str, Numbers]) -> dict[str, Numbers]:
        """Return the outputs from values of the quantities of `_samples` at its times."""
        first = len(self._times)
        outputs = {name: sampled[name][:first] for name in self._outputs.quantities}
        for name, reduction in self._reductions.items():
            instants = self._samples.instants[name]
            last = first + len(instants)
            columns = [sampled[part][first:last] for part in _parts_of(name, reduction)]
            for part, value in reduction.combined(jnp.stack(columns, axis=1), instants).items():
                outputs[result_name(name, part)] = value
            first = last
        return outputs

    def gradient(self, cotangents: dict[str, np.ndarray]) -> PyTree:
        """Return the derivatives, by all parameters, of the sum over outputs and times of values
        times `cotangents`, (N,) each or, of reductions, numbers."""
        samples = self._samples
        (seeds,) = jax.device_get(jax.vjp(self._combined, self._sampled)[1](cotangents))
        at_times = samples.quantities, samples.rows, samples.times, seeds
        pulled, total = _pulled_outputs(self._run, self._example, *at_times)
        end = np.zeros(sum(map(np.size, jax.tree.leaves(self._example.tangents))))
        return self.pulled_back(end, total, np.asarray(pulled), samples.places)

    def pulled_back(
        self, end: np.ndarray, total: PyTree, pulled: np.ndarray, places: np.ndarray
    ) -> PyTree:
        """Return the derivatives by all parameters, from cotangents of the tangents at the `end` of
        the run, in one array; of the `StepTangents` of the steps of the numbers `places`, (n,), as
        rows of the array `pulled`; and `total`, those of the parameters at fixed tangents."""
        run, example, now = self._run, self._example, end
        cells = sum(map(np.size, jax.tree.leaves(_example_of(run, example))))
        last = sum(len(segment.ends) for segment in self._segments)
        for segment in reversed(self._segments):
            count = len(segment.ends)
            rows, first = self._rows_of(segment), last - count
            added = np.zeros((ROWS, cells))
            here = (first <= places) & (places < last)
            np.add.at(added, places[here] - first, pulled[here])
            filled = np.pad(rows, ((0, ROWS - count), (0, 0)))
            now, total = _backward(run, example, filled, added, np.asarray(count), now, total)
            last = first
        start = _pulled_start(run, *self._span, jax.device_get(like(example.tangents, now)))
        return jax.tree.map(np.add, total, start)


def _numbers_of(step: Step) -> np.ndarray:
    # A copy: the leaves are views of the memory of a whole call.
    leaves = jax.tree.leaves(step)
    return np.concatenate([np.ravel(np.asarray(leaf, float)) for leaf in leaves])


def _parts_of(name: str, reduction: AbstractReduction) -> dict[str, Quantity]:
    """Return the quantities by whose values the reduction of a name is differentiated, by names
    that no output can have."""
    observed = {f"{name}/{k}": of for k, of in enumerate(reduction.observed())}
    integrals = {key: _Work(key) for key in integrands_of({name: reduction})}
    return {**observed, **integrals}


class _Work(eqx.Module):
    """An integral over the run, as a quantity."""

    key: str = eqx.field(static=True)

    def __call__(self, now: Instant) -> Scalar:
        return now.work[self.key]


class Integrand(eqx.Module):
    """A quantity that is integrated with the state, as a `Formulation` takes it."""

    quantity: Quantity = eqx.field(static=True)

    def __call__(
        self, system: System, t: Scalar, motion: PyTree, entry_speeds: PyTree, bristles: PyTree
    ) -> Scalar:
        return self.quantity(Instant(system, t, motion, entry_speeds, {}, bristles))


def integrands_of(reductions: Mapping[str, AbstractReduction]) -> dict[str, Integrand]:
    """Return the integrands of reductions, by names that no output can have."""
    return {
        f"{name}/integral {k}": Integrand(quantity)
        for name, reduction in reductions.items()
        for k, quantity in enumerate(reduction.integrands())
    }
