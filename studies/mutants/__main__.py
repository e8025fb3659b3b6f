"""Mutation test of the kernels: how many small changes of the code the fast tests catch.

    python -m studies.mutants [test | record [FILES] | again | table] [--count 200] [--seed 1]

`test`, the default, records which lines the tests execute, if that has not been done, and runs the
tests of each mutant. Outcomes are appended to a file as they come, so that an interrupted command
continues. `record` adds new tests to the recording, `again` repeats the mutants that survived, and
`table` prints the outcomes so far.
"""

import argparse
import json
import tempfile
import time
import tomllib
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from functools import cache
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from studies.common.fresh_process import ROOT
from studies.common.output import Output, add_options
from studies.common.report import markdown
from studies.mutants.mutations import Mutant, in_random_order
from studies.mutants.recording import Recording
from studies.mutants.trials import LIBRARIES, Copy

ROOMS = ["dynamics", "model", "simulation"]
TESTS = [
    "tests/model",
    "tests/dynamics",
    "tests/simulation",
    "tests/quantities",
    "tests/fields",
    "tests/views",
    "tests/durability",
    "tests/internals/fields",
    "tests/internals/model",
    "tests/internals/dynamics",
    "tests/internals/simulation",
    "tests/internals/export",
    "tests/sweeps/test_sweep.py",
    "tests/sweeps/test_sweep_failures.py",
    "tests/sweeps/test_sweep_lanes.py",
    "tests/sweeps/test_sweep_saving.py",
    "tests/internals/sweeps/test_sweep_axes.py",
    "tests/internals/sweeps/test_sweep_lanes.py",
    "tests/test_conformance.py",
    "tests/test_first_contact.py",
]
"""The fast tests that run the kernels; those of fits, figures and the command line are left out."""
SEED = 1
QUICK_FUNCTION, QUICK_TESTS = "RegularisedCoulomb.ratio", "tests/model/test_friction.py"
EQUIVALENT = Path(__file__).with_name("equivalent.toml")
Outcomes = dict[str, dict[str, Any]]
"""Outcome of each mutant by its identity."""


@cache
def equivalents() -> dict[tuple[str, ...], str]:
    """Return why mutants are equivalent, by file, function, code, old and new text."""
    entries = tomllib.loads(EQUIVALENT.read_text(encoding="utf-8")).get("mutant", [])
    names = ("file", "function", "code", "old", "new")
    return {tuple(entry[name] for name in names): entry["reason"] for entry in entries}


def is_equivalent(mutant: Mutant) -> bool:
    """Return whether a reason is given why no test can catch the mutant."""
    key = (mutant.file, mutant.function, mutant.code, mutant.old, mutant.new)
    return key in equivalents()


def read(file: Path) -> Outcomes:
    """Return the outcomes in a file; a later outcome of a mutant replaces the earlier one."""
    if not file.exists():
        return {}
    rows = map(json.loads, file.read_text(encoding="utf-8").splitlines())
    return {row["identity"]: row for row in rows}


def table(mutants: list[Mutant], outcomes: Outcomes) -> list[list[str]]:
    """Return a row of text for each room and for all rooms."""
    rows = [["room", "mutants", "caught", "equivalent", "survived", "caught of not equivalent"]]
    for room in [*ROOMS, "all"]:
        here = [m for m in mutants if m.identity in outcomes and room in (m.room, "all")]
        caught = sum(outcomes[m.identity]["caught"] for m in here)
        others = [m for m in here if not outcomes[m.identity]["caught"]]
        equivalent = sum(is_equivalent(m) for m in others)
        possible = len(here) - equivalent
        share = f"{100 * caught / possible:.0f} %" if possible else ""
        numbers = [len(here), caught, equivalent, len(others) - equivalent]
        rows.append([room, *map(str, numbers), share])
    return rows


def survivors(mutants: list[Mutant], outcomes: Outcomes) -> list[Mutant]:
    """Return the mutants that no test has caught, and that are not equivalent."""
    left = {name for name, outcome in outcomes.items() if not outcome["caught"]}
    return [m for m in mutants if m.identity in left and not is_equivalent(m)]


class Study:
    """The mutants that are drawn, and files in a folder for the recording and the outcomes."""

    def __init__(self, output: Output, count: int, workers: int, seconds: float, seed: int = SEED):
        self.all = in_random_order(ROOT, ROOMS, seed)
        self.mutants = self.all[:count]
        self.outcomes_file = output.file("outcomes.jsonl")
        self._recording_file = output.file("recording.json")
        self._cache = output.file("cache")
        self._workers, self._seconds = workers, seconds

    def record(self, tests: list[str]) -> Recording:
        """Run the tests on unchanged code, and add them to the recording."""
        with tempfile.TemporaryDirectory() as folder:
            newer = self._copy(Path(folder)).record(ROOMS, tests)
        recording = Recording.read(self._recording_file).joined(newer)
        recording.write(self._recording_file)
        return recording

    def recording(self) -> Recording:
        """Return the recording, after making it if there is none."""
        found = Recording.read(self._recording_file)
        return found if found.seconds else self.record(TESTS)

    def test(
        self, mutants: Iterable[Mutant], recording: Recording, libraries: list[str] = LIBRARIES
    ) -> None:
        """Run the tests of mutants, print each outcome, and append it to the file."""
        copies: SimpleQueue[Copy] = SimpleQueue()

        def tested(mutant: Mutant) -> None:
            tests, seed = recording.tests_for(mutant, self._seconds), self.all.index(mutant)
            copy, start = copies.get(), time.monotonic()
            try:
                outcome = copy.run(mutant, tests, self._seconds, seed)
            finally:
                copies.put(copy)
            row = {"identity": mutant.identity, **asdict(outcome), **asdict(mutant)}
            with self.outcomes_file.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
            how = f"caught by {outcome.by}" if outcome.caught else "survived"
            print(f"{seed + 1}. {mutant}: {how} ({time.monotonic() - start:.0f} s)", flush=True)

        with tempfile.TemporaryDirectory() as folder:
            for number in range(self._workers):
                copy = self._copy(Path(folder) / str(number), libraries)
                # A copy in which tests fail anyway would catch every mutant.
                copy.check([recording.cheapest()])
                copies.put(copy)
            pool = ThreadPoolExecutor(self._workers)
            try:
                list(pool.map(tested, mutants))
            finally:
                # After Ctrl-C or an error, only the mutants at hand are finished.
                pool.shutdown(cancel_futures=True)

    def _copy(self, folder: Path, libraries: list[str] = LIBRARIES) -> Copy:
        return Copy(ROOT, folder / "checkout", self._cache, libraries)


def main(arguments: list[str] | None = None) -> list[list[str]]:
    """Run a part of the study, print the table, and return it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parts = ["test", "record", "again", "table"]
    parser.add_argument("part", nargs="?", choices=parts, default="test")
    parser.add_argument("files", nargs="*", help="files of tests to record; default: all")
    parser.add_argument("--count", type=int, default=200, help="number of mutants; default: 200")
    parser.add_argument("--seed", type=int, default=SEED, help="another seed gives another draw")
    parser.add_argument("--workers", type=int, default=1, help="processes; default: 1")
    parser.add_argument(
        "--seconds",
        type=float,
        default=15.0,
        help="processor time of a mutant's tests; default: 15",
    )
    add_options(parser, "one mutant and one file of tests")
    options = parser.parse_args(arguments)
    output = Output.of(__file__, options)
    study = Study(output, options.count, options.workers, options.seconds, options.seed)
    outcomes = read(study.outcomes_file)
    if options.quick:
        quick = [mutant for mutant in study.all if mutant.function == QUICK_FUNCTION]
        study.test(quick[:1], Recording({QUICK_TESTS: 1.0}, {}), libraries=[])
    elif options.part == "test":
        left = [mutant for mutant in study.mutants if mutant.identity not in outcomes]
        study.test(left, study.recording())
    elif options.part == "again":
        study.test(survivors(study.mutants, outcomes), study.recording())
    elif options.part == "record":
        study.record(options.files or TESTS)
    mutants, outcomes = study.all if options.quick else study.mutants, read(study.outcomes_file)
    rows = table(mutants, outcomes)
    print(markdown(rows))
    for mutant in survivors(mutants, outcomes):
        print(f"Survived: {mutant}")
    return rows


if __name__ == "__main__":
    main()
