"""The work of a sweep: lanes ready to run, and their results as arrays."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..result_codes import RESULTS, result_number
from ..simulation.lanes.scheduler import Batch, Ended, Running
from ..simulation.lanes.tasks import Common, Task
from ..simulation.results.state_tables import STATE_PARTS
from .layout import RESULT, LaneArrays, Variable

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
        on_ended: Callable[[np.ndarray, LaneArrays], None],
        *,
        threads: int | None = None,
        on_progress: Callable[[Running], None] = lambda running: None,
    ) -> Batch:
        """Run lanes; `on_ended` gets the numbers (n,) and the results of some at a time."""
        refused = np.array([lane for lane in lanes if lane in self.bad], int)
        if refused.size:
            on_ended(refused, self._refused(len(refused)))
        batch = Batch(self.common, self.tasks, threads)
        batch.run(
            [lane for lane in lanes if lane not in self.bad],
            lambda ended: on_ended(ended.lanes, self._results(ended)),
            on_progress,
        )
        return batch

    def _refused(self, count: int) -> LaneArrays:
        results = {
            name: np.full((count, *v.shape), v.fill, v.dtype) for name, v in self.variables.items()
        }
        results[RESULT] = np.full(count, result_number(RESULTS.bad_parameters), np.int8)
        results["time_reached"] = np.full(count, float(self.common.start_time))
        return results

    def _results(self, ended: Ended) -> LaneArrays:
        """The results of lanes by variable; what was not recorded is NaN."""
        outcome = ended.outcome
        results: LaneArrays = {
            RESULT: result_number(outcome.result),
            "time_reached": np.asarray(outcome.time),
            "attempts": np.asarray(outcome.attempts),
            "accepted": np.asarray(outcome.accepted),
        }
        bodies = [outcome.final.bodies[name] for name in self.bodies]
        for part in STATE_PARTS:
            results[f"final_{part}"] = np.stack([getattr(body, part) for body in bodies], axis=1)
        for name, values in outcome.results.items():
            for key, value in values.items():
                results[variable_name(name, key)] = np.asarray(value)
        for name, logs in self._recorded(ended).items():
            results |= {variable_name(name, key): values for key, values in logs.items()}
        # A result that no number of a lane enters is one for all lanes.
        return {
            name: np.broadcast_to(
                np.asarray(results[name], variable.dtype), (len(ended.lanes), *variable.shape)
            )
            for name, variable in self.variables.items()
        }

    def _recorded(self, ended: Ended) -> dict[str, LaneArrays]:
        """What was recorded for each output, and "count": of how many rows."""
        logs = {
            name: {**columns, "count": counts} for name, (columns, counts) in ended.logs.items()
        }
        tabled = {log for contacts in self.common.tables.values() for log in contacts}
        alone = {name: log for name, log in logs.items() if name not in tabled}
        tables = {
            name: {
                key: np.stack([logs[contact][key] for contact in contacts], axis=1)
                for key in logs[contacts[0]]
            }
            for name, contacts in self.common.tables.items()
        }
        return alone | tables


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
        """The results of a chunk's lanes, computed in this process.

        **Raises:** `RuntimeError` in a process that runs other code.
        """
        self._require_same_code()
        parts: list[tuple[np.ndarray, LaneArrays]] = []
        self.work.run(self.lanes[chunk], lambda *part: parts.append(part))
        lanes, results = concatenated(parts)
        order = np.argsort(lanes)[np.searchsorted(np.sort(lanes), self.lanes[chunk])]
        return {name: values[order] for name, values in results.items()}

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


def variable_name(output: str, key: str) -> str:
    """Name in the data set of one result of an output."""
    return f"{output}_{key}" if key else output


def concatenated(
    parts: Sequence[tuple[np.ndarray, LaneArrays]],
) -> tuple[np.ndarray, LaneArrays]:
    """The lanes of several parts, and their results."""
    results = {
        name: np.concatenate([results[name] for _, results in parts]) for name in parts[0][1]
    }
    return np.concatenate([lanes for lanes, _ in parts]), results
