"""Compute the lanes of a sweep, and convert their results to arrays."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .._result_codes import RESULTS, result_number
from .._simulation.lanes.lane import Common, Task
from .._simulation.lanes.scheduler import Batch, Ended, Running
from .._simulation.results.solution import STATE_PARTS
from .outputs import RESULT, LaneArrays, Variable, variable_name

CONTACT = "contact"
"""Key of an impact table's dimension of contacts, as in "hits_contact"."""


@dataclass(frozen=True)
class Work:
    """All lanes of a sweep, in the form in which they can be run.

    - `common`, `tasks`: what all lanes share, and the data of each lane, such as its end time.
    - `bodies`: names along the dimension "body".
    - `bad`: numbers of the lanes in `Lanes.bad`, which are not run.
    - `variables`: units, shapes and types of the results of a lane, by name.
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
    ) -> None:
        """Run lanes, and pass the numbers (n,) and results (n, ...) of n lanes to `on_ended` as
        soon as they have ended.

        Lanes in `bad` are not run; their results, with the code of `bad_parameters`, come first.
        `on_progress` is called several times a second. Both functions are called in this thread.
        """
        # Apart from result code and time, lanes with invalid parameters keep the entries of lanes
        # that have not been computed.
        bad = np.array([lane for lane in lanes if lane in self.bad], int)
        if bad.size:
            results = {name: v.pending(len(bad)) for name, v in self.variables.items()}
            results[RESULT] = np.full(len(bad), result_number(RESULTS.bad_parameters), np.int8)
            results["time_reached"] = np.full(len(bad), float(self.common.start_time))
            on_ended(bad, results)
        batch = Batch(self.common, self.tasks, threads)
        valid = [lane for lane in lanes if lane not in self.bad]
        batch.run(valid, lambda ended: on_ended(ended.lanes, self._results(ended)), on_progress)

    def _results(self, ended: Ended) -> LaneArrays:
        # Names are those of `clearjoint._sweeps.sweep.variables_of`.
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
        arrays: LaneArrays = {}
        for name, variable in self.variables.items():
            values = np.asarray(results[name], variable.dtype)
            # A result that is the same in all lanes may have no dimension of lanes.
            arrays[name] = np.broadcast_to(values, (len(ended.lanes), *variable.shape))
        return arrays

    def _recorded(self, ended: Ended) -> dict[str, LaneArrays]:
        """Return the tables of all sections, all impact tables and the table of saved states, by
        name. Each one has its columns by their keys and, as "count", the number of rows of each
        lane. In impact tables, the second axis of the arrays is that of contacts."""
        logs = {name: {**rows, "count": counts} for name, (rows, counts) in ended.logs.items()}
        # A log has the rows of one section, of the saved states, or of one contact of an impact
        # table. The logs of a table's contacts are stacked to one table.
        for name, contacts in self.common.tables.items():
            parts = [logs.pop(contact) for contact in contacts]
            logs[name] = {key: np.stack([part[key] for part in parts], axis=1) for key in parts[0]}
        return logs


@dataclass(frozen=True)
class Chunks:
    """Function that computes a chunk of a sweep, in this process or in a worker process.

    - `lanes`: numbers of the lanes to run, by the index of their chunk.
    - `trace`: called in the worker, returns the digests of the programs that the worker would run,
      which must be those of `work`; ``None`` for no check.
    """

    work: Work
    lanes: Mapping[int, Sequence[int]]
    trace: Callable[[], Mapping[str, str]] | None = None

    def __call__(self, chunk: int) -> LaneArrays:
        """Return the results of the lanes of a chunk, in the order of `lanes[chunk]`.

        **Raises:** `RuntimeError` if the process that made the sweep runs other code than this one.
        """
        expected = self.work.common.programs
        if self.trace is not None and expected not in _confirmed_programs:
            if tuple(self.trace().items()) != expected:
                raise RuntimeError(
                    "This worker would run other code than the process that made the sweep, for "
                    "example because a file was edited in the meantime: restart both."
                )
            _confirmed_programs.add(expected)
        parts: list[tuple[np.ndarray, LaneArrays]] = []
        self.work.run(self.lanes[chunk], lambda *part: parts.append(part))
        # Lanes end in any order. Here their results are sorted into the order of `lanes[chunk]`, by
        # a search for each of its numbers among those of the ended lanes in rising order.
        lanes, results = concatenated(parts)
        rising = np.argsort(lanes)
        order = rising[np.searchsorted(lanes[rising], self.lanes[chunk])]
        return {name: values[order] for name, values in results.items()}


_confirmed_programs: set[tuple[tuple[str, str], ...]] = set()
"""Values of `Common.programs` that this process has compared with its own programs and found equal;
kept because tracing the programs takes long."""


def concatenated(parts: Sequence[tuple[np.ndarray, LaneArrays]]) -> tuple[np.ndarray, LaneArrays]:
    """Join pairs of the numbers, (n,), and results, (n, ...), of n lanes to one such pair."""
    lanes, results = zip(*parts, strict=True)
    joined = {name: np.concatenate([part[name] for part in results]) for name in results[0]}
    return np.concatenate(lanes), joined
