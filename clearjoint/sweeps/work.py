"""The work of a sweep: lanes ready to run, and their results as arrays."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..results import RESULTS, result_number
from ..runtime import Device, busy_devices
from ..simulation.batch.device_pool import Common, Extent, Task
from ..simulation.batch.native_batch import AnyBatch, batch_of
from ..simulation.batch.scheduler import Ended, Running
from ..simulation.state_tables import STATE_PARTS
from .layout import RESULT, LaneArrays, Variable

ON_CPU = Extent(pool=256, places=64)
ON_ACCELERATOR = Extent(pool=8192, places=8192)
CONTACT = "contact"
"""Of a table of impacts: what its dimension of contacts is called behind its name."""


@dataclass(frozen=True)
class Work:
    """All lanes of a sweep.

    - `common`: what the lanes share; `tasks`: what each has for itself, host arrays with lanes in
      front.
    - `bodies`: names in the order of the variables' dimension "body".
    - `bad`: numbers of the lanes whose parameters no scene can have; they are not run.
    - `variables`: the results of a lane, by name.
    """

    common: Common
    tasks: Task
    bodies: tuple[str, ...]
    bad: frozenset[int]
    variables: Mapping[str, Variable]

    def __len__(self) -> int:
        return len(self.tasks.end_time)

    def run(
        self,
        lanes: Sequence[int],
        on_ended: Callable[[int, LaneArrays], None],
        *,
        devices: Sequence[Device] | None = None,
        on_progress: Callable[[Running], None] = lambda running: None,
    ) -> AnyBatch:
        """Run lanes; `on_ended` gets the number and the results of each."""
        for lane in lanes:
            if lane in self.bad:
                on_ended(lane, self._refused(lane))
        devices = busy_devices() if devices is None else devices
        batch = batch_of(self.common, self.tasks, devices, extent(devices))
        batch.run(
            [lane for lane in lanes if lane not in self.bad],
            lambda ended: on_ended(ended.lane, self._results(ended)),
            on_progress,
        )
        return batch

    def _refused(self, lane: int) -> LaneArrays:
        results = {name: np.full(v.shape, v.fill, v.dtype) for name, v in self.variables.items()}
        results[RESULT] = np.asarray(result_number(RESULTS.bad_parameters), np.int8)
        results["time_reached"] = np.asarray(float(self.common.start_time))
        return results

    def _results(self, ended: Ended) -> LaneArrays:
        """The results of a lane by variable; what was not recorded is NaN."""
        outcome = ended.outcome
        results: LaneArrays = {
            RESULT: result_number(outcome.result),
            "time_reached": np.asarray(outcome.time),
            "attempts": np.asarray(outcome.attempts),
            "accepted": np.asarray(outcome.accepted),
        }
        bodies = [outcome.final.bodies[name] for name in self.bodies]
        for part in STATE_PARTS:
            results[f"final_{part}"] = np.stack([getattr(body, part) for body in bodies])
        for name, values in outcome.results.items():
            for key, value in values.items():
                results[variable_name(name, key)] = np.asarray(value)
        for name, logs in self._recorded(ended).items():
            results |= {variable_name(name, key): values for key, values in logs.items()}
        return {
            name: np.asarray(results[name], variable.dtype)
            for name, variable in self.variables.items()
        }

    def _recorded(self, ended: Ended) -> dict[str, LaneArrays]:
        """What was recorded for each output, and "count": of how many rows."""
        tabled = {log for logs in self.common.tables.values() for log in logs}
        alone = {name: _filled(*log) for name, log in ended.logs.items() if name not in tabled}
        tables = {
            name: joined([_filled(*ended.logs[log]) for log in logs])
            for name, logs in self.common.tables.items()
        }
        return alone | tables


def _filled(columns: LaneArrays, count: int) -> LaneArrays:
    """The columns of a log, what is not filled NaN, and their count."""
    filled = {key: np.array(values, dtype=float) for key, values in columns.items()}
    for values in filled.values():
        values[count:] = np.nan
    return {**filled, "count": np.asarray(count)}


@dataclass(frozen=True)
class Chunks:
    """The work in chunks.

    - `lanes`: numbers of the lanes to run, by chunk.
    - `trace`: returns digests of the programs that this process would run. If they differ from
      those of `work`, it has other code than the process that made the work.
    """

    work: Work
    lanes: Mapping[int, Sequence[int]]
    trace: Callable[[], Mapping[str, str]] | None = None

    def __call__(self, chunk: int) -> LaneArrays:
        """The results of a chunk's lanes, computed on this process's devices.

        **Raises:** `RuntimeError` in a process that runs other code.
        """
        self._require_same_code()
        by_lane: dict[int, LaneArrays] = {}
        self.work.run(self.lanes[chunk], lambda lane, results: by_lane.update({lane: results}))
        return joined([by_lane[lane] for lane in self.lanes[chunk]])

    def _require_same_code(self) -> None:
        expected = self.work.common.programs
        if self.trace is None or expected in _own_programs:
            return
        if tuple(self.trace().items()) != expected:
            raise RuntimeError(
                "This worker would run other code than the process that made the sweep, for "
                "example since a file was edited meanwhile: start both anew."
            )
        _own_programs.add(expected)


_own_programs: set[tuple[tuple[str, str], ...]] = set()
"""Digests of programs that this process has traced and found to be its own."""


def extent(devices: Sequence[Device] | None = None) -> Extent:
    """Lanes on a device: some dozens in flight on a processor core, thousands on a GPU."""
    return ON_CPU if (devices or busy_devices())[0].platform == "cpu" else ON_ACCELERATOR


def variable_name(output: str, key: str) -> str:
    """Name in the data set of one result of an output."""
    return f"{output}_{key}" if key else output


def joined(results: Sequence[LaneArrays]) -> LaneArrays:
    """LaneArrays of several lanes, lanes in front."""
    return {name: np.stack([lane[name] for lane in results]) for name in results[0]}
