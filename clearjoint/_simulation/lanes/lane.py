"""One lane of a batch, in scalar arithmetic and without loops. The loop over lanes exists twice: as
machine code in `clearjoint._native.lanes`, and for XLA in `.xla_lanes`."""

from collections.abc import Mapping
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..._dynamics.system import System
from ..._fields.types import Single
from ..._math.vectors import Condition, ConstantFolded, Scalar, unpack
from ..._model.bodies import State
from ..._model.scene import Scene
from ..._result_codes import RESULTS
from ...quantities.base import Quantity
from ..reductions.base import AbstractReduction
from ..results.solution import contact_label
from ..run.host_run import LATEST, Outcome, end_of
from ..run.impact_recorder import ImpactRecorder
from ..run.outputs import REDUCTIONS, SECTIONS, TABLES
from ..run.recorders import ROWS, LatestDenseStep, ReductionRecorder, RowBuffer
from ..run.run_checks import assembled
from ..run.run_loop import Progress, Recorders, RunLoop, begin_run
from ..run.sections import SectionRecorder
from ..step.dense_output import Snapshot
from ..step.method import Scheme
from ..step.step_state import without_weak_types
from ..step.stepping import running
from ..step.types import Integers, Numbers

SAVED = "saved"
"""Name of the log of the states at the times to save at."""
WINDOW = ROWS + 1
"""Number of times to save at that a running lane has: one more than a buffer has rows, so that a
lane with a full buffer still knows whether more states are to be saved."""


class Lane(eqx.Module):
    """State of a lane between two turns of the loop over lanes: its `run`, and the `saved` states
    that Python has not read yet; ``None`` if the batch saves no states."""

    run: Progress
    saved: RowBuffer[Snapshot] | None

    def buffers(self) -> dict[str, RowBuffer]:
        # Buffers of crossings and impacts, by log. The states have the buffer `saved`.
        records = self.run.records
        buffers: dict[str, RowBuffer] = {n: record.rows for n, record in records[SECTIONS].items()}
        for name, record_by_joint in records[TABLES].items():
            for joint, record_by_contact in record_by_joint.items():
                for contact, record in record_by_contact.items():
                    buffers[impact_log(name, joint, contact)] = record.rows
        return buffers


def _under(prefix: str, wanted: Mapping[str, PyTree]) -> dict[str, PyTree]:
    """Return the entries whose keys start with `prefix`, with the prefix removed from the keys."""
    return {
        log.removeprefix(prefix): rows for log, rows in wanted.items() if log.startswith(prefix)
    }


def impact_log(name: str, joint: str, contact: str) -> str:
    """Return the name of the log of one contact's impacts in the output `name`, such as
    "hits/pin V" for "hits" and the contact V of "pin". Names of outputs contain no slash."""
    return f"{name}/{contact_label(joint, contact)}"


class Task(eqx.Module):
    """Data of one lane; in a batch of L lanes, each array has an additional first axis of length L.
    Python renews the last two whenever it has emptied the lane's buffers.

    - `varied`: a PyTree with the structure of the scene, with those leaves that differ between
      lanes, and ``None`` in place of the others.
    - `state`: the initial state, packed.
    - `end_time`, `first_step`: s, end of the run and length of its first step.
    - `save_at`: (K,) s, rising, times to save at; ``None`` if no states are saved. A running lane
      has only the next `WINDOW` times, which are infinite where none is left.
    - `wanted[log]`: number of rows that a log of crossings or impacts may still record.
    """

    varied: PyTree
    state: State
    end_time: Numbers
    first_step: Numbers
    save_at: jax.Array | np.ndarray | None
    wanted: Mapping[str, Scalar | Numbers] = eqx.field(default_factory=dict)


class Common(eqx.Module):
    """Data that all lanes of a batch share: the integration method, the scene, and the outputs.

    - `folded_scene`: the scene, of which each lane replaces the leaves in `Task.varied`.
    - `reductions`: by name of the output; `sections`, `impacts`: the recorders of sections and of
      tables of impacts, by name of the output.
    - `saves`: whether states are saved at given times.
    - `capacity[log]`: largest number of rows of each log of crossings or impacts.
    - `channels[log][name]`: quantities at each crossing of a log or, for `SAVED`, each saved state.
    - `tables[name]`: for each table of impacts, the names of the logs of its contacts.
    - `programs`: name and digest of each traced program, or empty if unknown. A compiled program on
      disk is reused only if these agree.
    """

    scheme: Scheme
    folded_scene: ConstantFolded
    start_time: Single
    max_steps: Integers
    reductions: dict[str, AbstractReduction] = eqx.field(default_factory=dict)
    sections: dict[str, SectionRecorder] = eqx.field(default_factory=dict)
    impacts: dict[str, ImpactRecorder] = eqx.field(default_factory=dict)
    saves: bool = eqx.field(default=False, static=True)
    capacity: dict[str, int] = eqx.field(default_factory=dict, static=True)
    channels: dict[str, dict[str, Quantity]] = eqx.field(default_factory=dict)
    programs: tuple[tuple[str, str], ...] = eqx.field(default=(), static=True)
    tables: dict[str, tuple[str, ...]] = eqx.field(default_factory=dict, static=True)

    def logs(self, lane: Lane) -> dict[str, RowBuffer]:
        saved = {} if lane.saved is None else {SAVED: lane.saved}
        return saved | lane.buffers()

    def scene(self, task: Task) -> Scene:
        """Return the scene of a lane, in scalar form."""
        tree = eqx.combine(task.varied, self.folded_scene.tree)
        return unpack(ConstantFolded(tree, self.folded_scene.patterns))

    def system(self, task: Task) -> System:
        return self.scheme.system(self.scene(task))

    def _loop(self, system: System, task: Task) -> RunLoop:
        # A section has one log, which has the name of the output. A table of impacts has a log for
        # each contact (see `impact_log`); its recorder expects the labels of the contacts as keys.
        # `wanted`: number of rows that each log may still record.
        wanted = task.wanted
        recorders: dict[str, Recorders] = {
            REDUCTIONS: {
                name: ReductionRecorder(reduction) for name, reduction in self.reductions.items()
            },
            SECTIONS: {
                name: replace(recorder, wanted=wanted.get(name))
                for name, recorder in self.sections.items()
            },
            TABLES: {
                name: replace(recorder, wanted=_under(f"{name}/", wanted))
                for name, recorder in self.impacts.items()
            },
        }
        if self.saves:
            recorders[LATEST] = LatestDenseStep()
        return RunLoop(self.scheme.method, system, task.end_time, recorders)

    def begun(self, task: Task) -> Lane:
        """Return a lane before its first step. If its state violates the constraints, or the run's
        coordinates cannot represent it, its result code is `not_assembled` and it takes no step."""
        # A compiled lane cannot raise an error. The result code ends this lane, and the others run.
        method, scene, t0 = self.scheme.method, self.scene(task), self.start_time
        fits = assembled(scene, task.state, t0, self.scheme.formulation.coordinates)
        system = self.scheme.system(scene)
        step = begin_run(method, system, task.state, t0, task.end_time, task.first_step)
        step = replace(step, result=RESULTS.where(fits, step.result, RESULTS.not_assembled))
        saved = RowBuffer.like(Snapshot.of(step), ROWS) if self.saves else None
        return without_weak_types(Lane(self._loop(system, task).start(step), saved))

    def after_turn(self, task: Task, lane: Lane) -> Lane:
        """Return a lane after one turn. The lane tries one step, unless its run has ended, the lane
        waits for Python, or a state within its latest step is still to be saved. After that the
        lane saves one state, if it has reached a time to save at."""
        system = self.system(task)
        run = self._loop(system, task).advance(lane.run, goes=self._tries_step(task, lane))
        if lane.saved is None:  # a batch that saves no states
            return Lane(run, None)
        advanced = Lane(run, lane.saved)
        # The dense output is evaluated in every turn, because lanes side by side cannot branch. If
        # no state is due, the snapshot is not written.
        save_time = _next_save(task, advanced)
        snapshot = run.records[LATEST].at(self.scheme.method, system, save_time)
        return Lane(run, lane.saved.with_row(snapshot, _saves(task, advanced)))

    def status(self, task: Task, lane: Lane) -> dict[str, PyTree]:
        """Return by name: "time", s; "runs", whether the run goes on; and "moves", whether the next
        turn changes the lane. If not, the lane has ended or waits for Python."""
        moves = self._tries_step(task, lane)
        if lane.saved is not None:
            moves = moves | _saves(task, lane)
        return {"moves": moves, "runs": self._runs(task, lane), "time": lane.run.step.t}

    def outcome(self, task: Task, lane: Lane) -> Outcome:
        step, tallies = lane.run.step, lane.run.records[REDUCTIONS]
        return end_of(self.system(task), self.reductions, tallies, step, task.end_time)

    def _runs(self, task: Task, lane: Lane) -> Condition:
        return running(lane.run.step, task.end_time, self.max_steps)

    def _tries_step(self, task: Task, lane: Lane) -> Condition:
        goes = self._runs(task, lane)
        if lane.saved is not None:
            # A lane keeps the dense output of its latest step only. So it takes no step before the
            # states at all times within that step are saved. Nor does it while the buffer of states
            # is full, unless no more are to be saved: `save_at` has one time more than the buffer
            # has rows (see `WINDOW`), and this last one, `[ROWS]`, is infinite if none is left.
            more_to_save = jnp.asarray(task.save_at)[ROWS] < jnp.inf
            goes = goes & jnp.logical_not(_next_save(task, lane) <= lane.run.step.t)
            goes = goes & jnp.logical_not(lane.saved.is_full() & more_to_save)
        # If further rows are wanted, a full buffer of crossings or impacts must be emptied first,
        # or the next row would be lost.
        for log, rows in lane.buffers().items():
            waits = rows.is_full() & (task.wanted[log] > rows.count)
            goes = goes & jnp.logical_not(waits)
        return goes


def _next_save(task: Task, lane: Lane) -> Scalar:
    assert lane.saved is not None
    return jnp.asarray(task.save_at)[lane.saved.count]


def _saves(task: Task, lane: Lane) -> Condition:
    assert lane.saved is not None
    return (_next_save(task, lane) <= lane.run.step.t) & jnp.logical_not(lane.saved.is_full())
