"""The programs of a sweep: what a lane's run computes, and what each output reads from it.

They are traced as those of the lanes are, with the numbers of scene and state as arguments. Those
of solver, controller and outputs are constants in them.
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
from ...simulation.step.dense_output import Snapshot
from ..work import variable_name
from .fingerprint import digest, fingerprints

RUN = ""
"""Name of the program of the run itself."""


def programs(
    plan: Plan,
    folded_scene: ConstantFolded,
    state: State,
    start_time: float,
    channels: dict[str, dict[str, Quantity]],
) -> dict[str, str]:
    """Digests of the run's program (`RUN`), and of that of each variable of the outputs.

    **Arguments:** `plan` and `channels` as in `clearjoint.simulation.lanes.tasks.Common`;
    `folded_scene` and `state`: scene and initial state of a lane; `start_time`: s.

    **Raises:** `ValueError` for a scene or an output that calls back into Python.
    """
    numbers, rest = eqx.partition(folded_scene, eqx.is_array_like)
    traced = _Traced(plan, rest, channels)
    time = jnp.asarray(start_time, dtype=float)
    start = fingerprints(traced.begun, numbers, state, time, 1.0)
    lane: Lane = start.shapes[RUN]
    step = fingerprints(traced.taken, numbers, lane, 1.0)
    row = Snapshot(lane.step.t, lane.step.y, lane.step.entry_speeds)
    tallies = jax.eval_shape(traced.tallies, numbers, row)
    outputs = fingerprints(traced.read, numbers, row, row, tallies)
    contacts = jax.eval_shape(traced.begun_contacts, numbers, state, time, 1.0)
    tables = fingerprints(traced.tabled, numbers, contacts, 1.0)
    whole = {RUN: digest(start.digests[RUN], step.digests[RUN])}
    return whole | outputs.digests | tables.digests


@dataclass(frozen=True)
class _Traced:
    """What is traced: functions of the numbers of a scene, of which `rest` is what else it is."""

    plan: Plan
    rest: PyTree
    channels: dict[str, dict[str, Quantity]]

    @property
    def _bare(self) -> Plan:
        """The plan without outputs."""
        return Plan(self.plan.scheme, {}, {}, False, self.plan.max_steps)

    def _scene(self, numbers: PyTree) -> Scene:
        return unpack(eqx.combine(numbers, self.rest))

    def begun(self, numbers: PyTree, state: State, time: Scalar, length: Scalar) -> dict[str, Lane]:
        """The lane before its first step."""
        request = _request(time + length, length)
        return {RUN: begin_lane(self._bare, self._scene(numbers), state, time, request)}

    def taken(self, numbers: PyTree, lane: Lane, end_time: Scalar) -> dict[str, PyTree]:
        """A step of the lane, and what would be reported of it."""
        scene = self._scene(numbers)
        after = step_lane(self._bare, scene, lane, _request(end_time, end_time))
        return {RUN: (after, outcome(self._bare, scene, lane, end_time))}

    @property
    def _tabling(self) -> Plan:
        """The plan without outputs but tables of impacts."""
        return Plan(self.plan.scheme, {}, {}, False, self.plan.max_steps, self.plan.impacts)

    def begun_contacts(self, numbers: PyTree, state: State, time: Scalar, length: Scalar) -> Lane:
        """The lane before its first step, with its contacts."""
        request = _request(time + length, length)
        return begin_lane(self._tabling, self._scene(numbers), state, time, request)

    def tabled(self, numbers: PyTree, lane: Lane, end_time: Scalar) -> dict[str, PyTree]:
        """By variable of the tables of impacts, what is recorded at a step."""
        if not lane.impacts:
            return {}
        request = replace(_request(end_time, end_time), wanted=dict.fromkeys(lane.buffers(), 1))
        after = step_lane(self._tabling, self._scene(numbers), lane, request)
        return {
            variable_name(name, key): record
            for name, record in after.impacts.items()
            for key in (*IMPACT_UNITS, "count")
        }

    def tallies(self, numbers: PyTree, row: Snapshot) -> dict[str, PyTree]:
        """The reductions' tallies at the start."""
        now = self._instant(numbers, row, row)
        return {
            name: jax.tree.map(jnp.asarray, reduction.start(now))
            for name, reduction in self.plan.reductions.items()
        }

    def read(
        self, numbers: PyTree, row: Snapshot, inside: Snapshot, tallies: dict[str, PyTree]
    ) -> dict[str, PyTree]:
        """By variable, all that an output computes for it at the end of a step."""
        now, programs = self._instant(numbers, row, inside), {}
        for name, reduction in self.plan.reductions.items():
            tally = tallies[name]
            whole = (
                reduction.start(now),
                reduction.update(tally, now),
                reduction.results(tally, now),
            )
            programs |= {variable_name(name, key): whole for key in reduction.units()}
        for name, quantities in self.channels.items():
            section = self.plan.sections.get(name)
            where = () if section is None else (section.quantity(now), section.after)
            programs |= {variable_name(name, key): where for key in ("time", "count")}
            programs |= {
                variable_name(name, key): (*where, quantity(now))
                for key, quantity in quantities.items()
            }
        return programs

    def _instant(self, numbers: PyTree, row: Snapshot, inside: Snapshot) -> Instant:
        """The instant of a row. What is asked of places in its step has the numbers of another row
        times the place, so that the program tells the places."""
        system = self.plan.scheme.system(self._scene(numbers))

        def at(place: Scalar) -> Instant:
            return jax.tree.map(lambda leaf: place * leaf, inside).instant(system)

        return row.instant(system, at)


def _request(end_time: Scalar, first_step: Scalar) -> SegmentRequest:
    return SegmentRequest(end_time, first_step, jnp.full(WINDOW, jnp.inf), {})
