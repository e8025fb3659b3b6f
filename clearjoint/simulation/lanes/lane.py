"""One lane of a batch: a run that tries one step in each turn of a loop over many lanes.

The functions of this module compute one lane in scalar arithmetic, without loops. The loop over
turns, with many lanes side by side, is in `clearjoint.native.lanes` and `.xla_lanes`.

A log is a table that a lane writes: the crossings of a section, the impacts of a contact, or the
saved states. The host is the Python code that reads the logs.
"""

from collections.abc import Mapping
from functools import reduce

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ...dynamics.absolute_coordinates import AbsoluteCoordinates
from ...dynamics.assembly import ACCEPTED_VIOLATION, REPRESENTED
from ...dynamics.equations_of_motion import flattened
from ...dynamics.formulation import Formulation
from ...dynamics.multipliers import row_rate
from ...dynamics.system import System
from ...math.vectors import Condition, EulerParameters, Scalar, unpack
from ...model.bodies import State
from ...model.scene import Scene
from ...result_codes import RESULTS
from ..reductions.reductions import AbstractReduction
from ..results.state_tables import contact_label
from ..run.advance import Recorder, StepOutcome, advance, latest_dense_step
from ..run.impact_recorder import ImpactRecord, ImpactRecorder, ImpactRow
from ..run.row_buffer import RowBuffer
from ..run.run_ends import begin_run, final_result, final_state
from ..run.sections import Crossing
from ..step.dense_output import DenseStep, Snapshot, on_constraints
from ..step.method import Scheme
from ..step.step_state import Attempt, Method, Step, choose
from ..step.stepping import attempt, running
from ..step.time_map import FromOnset
from ..step.types import Integers, Numbers

ROWS = 64
"""Number of rows of each buffer of a lane. When a buffer is full, the lane waits until the host has
emptied its buffers."""
WINDOW = ROWS + 1
"""Number of times to save at in a `SegmentRequest`: one more than a buffer has rows, so that a lane
with a full buffer still knows whether more states are to be saved."""
LATEST = ""
"""Name of the record of the latest accepted step. Outputs have names that aren't empty."""


class CrossingRecord(eqx.Module):
    """Crossings of a section that a lane has recorded.

    - `level`: the section's quantity after the latest accepted step, in its unit; a crossing is
      where it rises through zero.
    - `rows`: time and state at the crossings that the host has not read yet.
    """

    level: Scalar
    rows: RowBuffer[Snapshot]


class CrossingRecorder(eqx.Module):
    """Records the crossings of a section.

    `wanted`: number of crossings to record, besides those that the host has already read.
    """

    section: Crossing
    wanted: Scalar

    def __call__(self, record: CrossingRecord, step_outcome: StepOutcome) -> CrossingRecord:
        """Return the record after a step was tried.

        A crossing in the step is added to the record, if the step was accepted and more crossings
        are wanted.
        """
        kept, before, after = step_outcome.kept, record.level, self.section.level(step_outcome.now)
        row = self.section.row(step_outcome, before, after)
        rises = kept & (before < 0.0) & (after >= 0.0)
        wanted = rises & (row.t >= self.section.after) & (self.wanted > record.rows.count)
        return CrossingRecord(jnp.where(kept, after, before), record.rows.with_row(row, wanted))


class Plan(eqx.Module):
    """Method and outputs that all lanes of a batch share.

    - `scheme`: integration method and formulation of the equations of motion.
    - `reductions`, `sections`, `impacts`: reductions, conditions of crossings and recorders of
      impacts, each by the name of its output.
    - `saves`: whether states are saved at given times.
    - `max_steps`: largest number of attempts in a lane.
    """

    scheme: Scheme
    reductions: dict[str, AbstractReduction]
    sections: dict[str, Crossing]
    saves: bool = eqx.field(static=True)
    max_steps: Integers
    impacts: dict[str, ImpactRecorder] = eqx.field(default_factory=dict)

    @property
    def method(self) -> Method:
        """Solver, step-size controller and landing of all lanes."""
        return self.scheme.method


class SegmentRequest(eqx.Module):
    """Data for a lane, which the host updates whenever it has emptied the lane's buffers.

    - `end_time`: s, end of the run; `first_step`: s, length of its first step.
    - `window`: (`WINDOW`,) s, the next times to save at, filled up with infinity.
    - `wanted[log]`: number of rows that are still to be recorded.
    """

    end_time: Scalar
    first_step: Scalar
    window: Numbers
    wanted: Mapping[str, Scalar | Numbers]


class Lane(eqx.Module):
    """A run between two turns.

    - `step`: the complete state of the run after its latest attempt.
    - `tallies`, `crossings`, `impacts`: records of reductions, sections and tables of impacts, by
      the name of the output.
    - `dense_step`: the latest accepted step; `saved`: saved states that the host has not read yet.
      Both are ``None`` unless states are saved.
    """

    step: Step
    tallies: dict[str, PyTree]
    crossings: dict[str, CrossingRecord]
    impacts: dict[str, ImpactRecord]
    dense_step: DenseStep | None
    saved: RowBuffer[Snapshot] | None

    def runs(self, plan: Plan, end_time: Scalar) -> Condition:
        """Return whether the run goes on: before `end_time`, s, and without failure."""
        return running(self.step, end_time, plan.max_steps)

    def buffers(self) -> dict[str, RowBuffer]:
        """Return the buffers of crossings and of impacts, by the name of the log."""
        buffers: dict[str, RowBuffer] = {n: record.rows for n, record in self.crossings.items()}
        for name, record in self.impacts.items():
            for joint, family in record.items():
                for contact, one in family.items():
                    buffers[impact_log(name, joint, contact)] = one.rows
        return buffers


def impact_log(name: str, joint: str, contact: str) -> str:
    """Return the name of the log of a contact's impacts, such as "hits/pin V".

    It differs from the names of all outputs. `name`: name of the output, a table of impacts.
    """
    return f"{name}/{contact_label(joint, contact)}"


class Outcome(eqx.Module):
    """Results of a lane.

    - `time`: s, the time at which the run ended; `result`: its result code.
    - `attempts`, `accepted`: numbers of steps that were tried, and that were accepted.
    - `final`: the state at the end.
    - `results[name][part]`: results of the reductions.
    """

    time: Scalar
    result: RESULTS
    attempts: Scalar
    accepted: Scalar
    final: State
    results: dict[str, dict[str, Scalar]]


def begin_lane(
    plan: Plan, scene: Scene, state: State, start_time: Scalar, request: SegmentRequest
) -> Lane:
    """Return the lane before its first step, at `start_time`, s, from a state in packed form."""
    # A compiled lane cannot raise an error. If its state violates the constraints, it gets a result
    # code with which it takes no step, and the other lanes run.
    fits = _is_assembled(plan, scene, state, start_time)
    system = plan.scheme.system(scene)
    step = begin_run(plan.method, system, state, start_time, request.end_time, request.first_step)
    step = eqx.tree_at(
        lambda s: s.result, step, RESULTS.where(fits, step.result, RESULTS.not_assembled)
    )
    row = Snapshot(step.t, step.y, step.entry_speeds)
    now = row.instant(system)
    no_impacts = RowBuffer.like(ImpactRow.none(), ROWS)
    lane = Lane(
        step,
        {name: reduction.start(now) for name, reduction in plan.reductions.items()},
        {
            name: CrossingRecord(section.level(now), RowBuffer.like(row, ROWS))
            for name, section in plan.sections.items()
        },
        {
            name: recorder.start(plan.method, system, step, no_impacts)
            for name, recorder in plan.impacts.items()
        },
        _empty_dense_step(plan, system, step, request) if plan.saves else None,
        RowBuffer.like(row, ROWS) if plan.saves else None,
    )
    # Without weak types, as the loop returns the lane: its program needs equal types on both sides.
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=jnp.result_type(leaf)), lane)


def step_lane(plan: Plan, scene: Scene, lane: Lane, request: SegmentRequest) -> Lane:
    """Return the lane after one turn.

    In a turn, the lane tries one step, unless its run has ended, the lane waits for the host, or a
    state within its latest step is still to be saved. After that, the lane saves at most one state.
    """
    system = plan.scheme.system(scene)
    step, records = advance(
        plan.method,
        system,
        lane.step,
        request.end_time,
        _records(lane),
        _recorders(plan, request),
        goes=_goes(plan, lane, request),
    )
    lane = Lane(
        step,
        {name: records[name] for name in lane.tallies},
        {name: records[name] for name in lane.crossings},
        {name: records[name] for name in lane.impacts},
        records.get(LATEST),
        lane.saved,
    )
    return _with_save(plan, system, lane, request)


def _records(lane: Lane) -> dict[str, PyTree]:
    latest = {} if lane.dense_step is None else {LATEST: lane.dense_step}
    return {**lane.tallies, **lane.crossings, **lane.impacts, **latest}


def _recorders(plan: Plan, request: SegmentRequest) -> dict[str, Recorder]:
    return {
        **{name: _updating(reduction) for name, reduction in plan.reductions.items()},
        **{
            name: CrossingRecorder(section, request.wanted[name])
            for name, section in plan.sections.items()
        },
        **{name: _tabling(recorder, name, request) for name, recorder in plan.impacts.items()},
        LATEST: latest_dense_step,
    }


def _updating(reduction: AbstractReduction) -> Recorder:
    """Return the function that updates a reduction's tally after an accepted step."""

    def after(tally: PyTree, step_outcome: StepOutcome) -> PyTree:
        return choose(step_outcome.kept, reduction.update(tally, step_outcome.now), tally)

    return after


def _tabling(recorder: ImpactRecorder, name: str, request: SegmentRequest) -> Recorder:
    """Return the function that updates the impacts of the output `name` after a step.

    It records at most the requested number of rows of each contact.
    """

    def after(record: ImpactRecord, step_outcome: StepOutcome) -> PyTree:
        wanted = {
            joint: {contact: request.wanted[impact_log(name, joint, contact)] for contact in family}
            for joint, family in record.items()
        }
        return recorder.after(record, step_outcome, wanted)

    return after


def outcome(plan: Plan, scene: Scene, lane: Lane, end_time: Scalar) -> Outcome:
    """Return the outcome of a lane so far. `end_time`: s, end of its run.

    The outcome is final if the lane has ended.
    """
    system = plan.scheme.system(scene)
    step = lane.step
    now = Snapshot(step.t, step.y, step.entry_speeds).instant(system)
    return Outcome(
        step.t,
        final_result(step, end_time),
        step.attempts,
        step.accepted,
        final_state(system, step),
        {
            name: reduction.results(lane.tallies[name], now)
            for name, reduction in plan.reductions.items()
        },
    )


def moves(plan: Plan, lane: Lane, request: SegmentRequest) -> Condition:
    """Return whether the next turn changes the lane, by a step or by a saved state.

    If not, the lane has ended or waits for the host.
    """
    goes = _goes(plan, lane, request)
    if lane.saved is None:
        return goes
    return goes | (_save_is_due(lane, request) & jnp.logical_not(lane.saved.is_full()))


def _goes(plan: Plan, lane: Lane, request: SegmentRequest) -> Condition:
    """Return whether a lane tries a step in this turn."""
    goes = lane.runs(plan, request.end_time)
    if lane.saved is not None:
        # A lane keeps the dense output of its latest step only. So it takes no step before the
        # states at all times within that step are saved, or while the buffer of states is full.
        more = request.window[ROWS] < jnp.inf
        goes = goes & jnp.logical_not(_save_is_due(lane, request))
        goes = goes & jnp.logical_not(lane.saved.is_full() & more)
    for log, rows in lane.buffers().items():
        waits = rows.is_full() & (request.wanted[log] > rows.count)
        goes = goes & jnp.logical_not(waits)
    return goes


def _next_save(lane: Lane, request: SegmentRequest) -> Scalar:
    """Return the next time to save at, s, infinite if states are saved at all times."""
    assert lane.saved is not None
    return jnp.asarray(request.window)[lane.saved.count]


def _save_is_due(lane: Lane, request: SegmentRequest) -> Condition:
    """Return whether the run has reached the next time to save at."""
    if lane.saved is None:
        return jnp.asarray(False)
    return _next_save(lane, request) <= lane.step.t


def _with_save(plan: Plan, system: System, lane: Lane, request: SegmentRequest) -> Lane:
    """Return the lane with the state at the next time to save at, if the run has reached that time
    and the buffer has room."""
    if lane.saved is None:
        return lane
    assert lane.dense_step is not None
    due = _save_is_due(lane, request) & jnp.logical_not(lane.saved.is_full())
    row = lane.dense_step.at(plan.method, _next_save(lane, request))
    row = Snapshot(row.t, on_constraints(system, row.y, row.t), row.entry_speeds)
    return eqx.tree_at(lambda a: a.saved, lane, lane.saved.with_row(row, due))


def _empty_dense_step(plan: Plan, system: System, step: Step, request: SegmentRequest) -> DenseStep:
    """Return a dense step of length zero at the start, with arrays of the shapes of later steps."""
    # The stages' shapes depend on the solver; `eval_shape` finds them without computing a step.
    shapes: Attempt = jax.eval_shape(lambda: attempt(plan.method, system, step, request.end_time))
    row = Snapshot(step.t, step.y, step.entry_speeds)
    stages = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes.information["stages"])
    time_map = None if shapes.time_map is None else FromOnset(step.proposal.begins_contact)
    return DenseStep(row, row, stages, time_map)


def _is_assembled(plan: Plan, scene: Scene, state: State, t: Scalar) -> Condition:
    """Return whether a packed state satisfies all ideal joints at time t, s, and whether the
    coordinates of the run can represent this state."""
    bodies, absolute = unpack(state.bodies), System(scene, Formulation(AbsoluteCoordinates()))
    motions = absolute.motions(absolute.encode(bodies))
    fits: Condition = jnp.asarray(True)
    for row in flattened(absolute.rows(motions, t)):
        violation = jnp.maximum(jnp.abs(row.value), jnp.abs(row_rate(row, motions)))
        fits = fits & (violation <= ACCEPTED_VIOLATION)
    # Joint coordinates hold only motions that their joints allow: compare after a round trip.
    chosen = System(scene, plan.scheme.formulation)
    for name, body in chosen.decode(chosen.encode(bodies)).items():
        fits = fits & (_apart(body.orientation, bodies[name].orientation) < REPRESENTED)
    return fits


def _apart(p: EulerParameters, q: EulerParameters) -> Scalar:
    """Return the largest difference between the Euler parameters of two orientations.

    The signs are chosen for the smallest difference, since p and -p are the same orientation.
    """
    pairs = ((p.e0, q.e0), (p.e1, q.e1), (p.e2, q.e2), (p.e3, q.e3))
    alike = [jnp.abs(one - other) for one, other in pairs]
    opposite = [jnp.abs(one + other) for one, other in pairs]
    return jnp.minimum(reduce(jnp.maximum, alike), reduce(jnp.maximum, opposite))
