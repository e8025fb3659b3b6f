"""Digests of a sweep's programs: the run of a lane, and the computation of each output.

The programs are traced as they are for the lanes: the numbers of scene and state are arguments of a
program, the numbers of solver, controller and outputs are constants.
"""

from dataclasses import dataclass, replace

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ...math.vectors import ConstantFolded, Scalar, unpack
from ...model.bodies import State
from ...model.scene import Scene
from ...quantities.base import Quantity
from ...quantities.instant import Instant
from ...simulation.lanes.lane import (
    WINDOW,
    Lane,
    Plan,
    SegmentRequest,
    begin_lane,
    outcome,
    step_lane,
)
from ...simulation.results.impact_table import IMPACT_UNITS
from ...simulation.run.segments import IMPACTS
from ...simulation.step.dense_output import Snapshot
from ..work import variable_name
from .fingerprint import digest, fingerprints

RUN = ""
"""Key of the digest of the run itself, beside the names of variables."""


def programs(
    plan: Plan,
    folded_scene: ConstantFolded,
    state: State,
    start_time: float,
    channels: dict[str, dict[str, Quantity]],
) -> dict[str, str]:
    """Return digests of the program of the run, under `RUN`, and of each output's variable, by
    name.

    The outputs have digests of their own, so that outputs can be added to a store whose lanes stay
    valid.

    **Arguments:**

    - `plan`, `channels`: as in `clearjoint.simulation.lanes.tasks.Common`.
    - `folded_scene`, `state`: scene and initial state of a lane.
    - `start_time`: s.

    **Raises:** `ValueError` for a scene or an output that calls back into Python.
    """
    numbers, rest = eqx.partition(folded_scene, eqx.is_array_like)
    traced = _Traced(plan, rest, channels)
    time = jnp.asarray(start_time, dtype=float)
    # A run begins a lane and then repeats one step: these two programs determine it.
    start = fingerprints(traced.begin, numbers, state, time, 1.0)
    lane: Lane = start.shapes[RUN]
    step = fingerprints(traced.step, numbers, lane, 1.0)
    # Outputs depend on a lane only through this snapshot, so that their digests don't change if
    # another part of the step does.
    now = lane.run.step
    row = Snapshot(now.t, now.y, now.entry_speeds)
    tallies = jax.eval_shape(traced.tallies, numbers, row)
    outputs = fingerprints(traced.read, numbers, row, row, tallies)
    run = {RUN: digest(start.digests[RUN], step.digests[RUN])}
    if not plan.impacts:
        return run | outputs.digests
    # Records of impacts change the lane, so that they are traced in a lane of their own: a table
    # that is added must not change the digest of the run.
    with_contacts = jax.eval_shape(traced.begin_with_impacts, numbers, state, time, 1.0)
    tables = fingerprints(traced.impact_tables, numbers, with_contacts, 1.0)
    return run | outputs.digests | tables.digests


@dataclass(frozen=True)
class _Traced:
    """Functions to trace, whose arguments are the numbers of a scene.

    - `plan`, `channels`: as in `programs`.
    - `rest`: the scene with ``None`` for its numbers.
    """

    plan: Plan
    rest: PyTree
    channels: dict[str, dict[str, Quantity]]

    @property
    def _without_outputs(self) -> Plan:
        return Plan(self.plan.scheme, {}, {}, False, self.plan.max_steps)

    @property
    def _with_impacts(self) -> Plan:
        return Plan(self.plan.scheme, {}, {}, False, self.plan.max_steps, self.plan.impacts)

    def _scene(self, numbers: PyTree) -> Scene:
        return unpack(eqx.combine(numbers, self.rest))

    def begin(self, numbers: PyTree, state: State, time: Scalar, length: Scalar) -> dict[str, Lane]:
        """Return the lane before its first step, of length `length`, s, from the start `time`,
        s."""
        plan, request = self._without_outputs, _request(time + length, length)
        return {RUN: begin_lane(plan, self._scene(numbers), state, time, request)}

    def step(self, numbers: PyTree, lane: Lane, end_time: Scalar) -> dict[str, PyTree]:
        """Return the lane after one step, and the outcome of a run that ends there."""
        plan, scene = self._without_outputs, self._scene(numbers)
        after = step_lane(plan, scene, lane, _request(end_time, end_time))
        return {RUN: (after, outcome(plan, scene, lane, end_time))}

    def begin_with_impacts(
        self, numbers: PyTree, state: State, time: Scalar, length: Scalar
    ) -> Lane:
        """Return the lane before its first step, with a recorder of impacts."""
        request = _request(time + length, length)
        return begin_lane(self._with_impacts, self._scene(numbers), state, time, request)

    def impact_tables(self, numbers: PyTree, lane: Lane, end_time: Scalar) -> dict[str, PyTree]:
        """Return the impacts recorded after one step, by variable of the impact tables."""
        if not lane.run.records[IMPACTS]:
            return {}
        request = replace(_request(end_time, end_time), wanted=dict.fromkeys(lane.buffers(), 1))
        after = step_lane(self._with_impacts, self._scene(numbers), lane, request)
        return {
            variable_name(name, key): record
            for name, record in after.run.records[IMPACTS].items()
            for key in (*IMPACT_UNITS, "count")
        }

    def tallies(self, numbers: PyTree, row: Snapshot) -> dict[str, PyTree]:
        """Return by name the values that the reductions accumulate, at the start of the run.

        **Arguments:** `row`: the state at the start.
        """
        now = self._instant(numbers, row, row)
        return {
            name: jax.tree.map(jnp.asarray, reduction.start(now))
            for name, reduction in self.plan.reductions.items()
        }

    def read(
        self, numbers: PyTree, row: Snapshot, inside: Snapshot, tallies: dict[str, PyTree]
    ) -> dict[str, PyTree]:
        """Return for each variable all values that its output computes at the end of a step.

        **Arguments:** `row`: state at the end of the step; `inside`: state from which values inside
        the step are made; `tallies`: accumulated values of the reductions by name.
        """
        now, programs = self._instant(numbers, row, inside), {}
        for name, reduction in self.plan.reductions.items():
            tally = tallies[name]
            computed = (
                reduction.start(now),
                reduction.update(tally, now),
                reduction.results(tally, now),
            )
            programs |= {variable_name(name, key): computed for key in reduction.units()}
        for name, quantities in self.channels.items():
            section = self.plan.sections.get(name)
            # The times of a section's crossings depend on the crossing condition, so that every
            # variable of the section includes it.
            crossing = () if section is None else (section.quantity(now), section.after)
            programs |= {variable_name(name, key): crossing for key in ("time", "count")}
            programs |= {
                variable_name(name, key): (*crossing, quantity(now))
                for key, quantity in quantities.items()
            }
        return programs

    def _instant(self, numbers: PyTree, row: Snapshot, inside: Snapshot) -> Instant:
        """Return the instant of a row.

        A quantity may evaluate the dense output at a fraction of the step. Its values there are the
        fraction times another row, so that the fraction appears in the traced program.
        """
        system = self.plan.scheme.system(self._scene(numbers))

        def at(fraction: Scalar) -> Instant:
            return jax.tree.map(lambda leaf: fraction * leaf, inside).instant(system)

        return row.instant(system, at)


def _request(end_time: Scalar, first_step: Scalar) -> SegmentRequest:
    return SegmentRequest(end_time, first_step, jnp.full(WINDOW, jnp.inf), {})
