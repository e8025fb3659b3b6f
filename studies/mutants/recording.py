"""Record which lines each test executes and how long it takes, and select tests for a mutant.

This module must not import clearjoint: the lines of an import are recorded too.
"""

import json
import time
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

import pytest

from studies.mutants.mutations import Mutant

GENERAL = (
    "tests/test_conformance.py",
    "tests/internals/simulation/test_absence.py",
    "tests/simulation/test_symmetries",
)
"""Beginnings of the names of tests that concern all rooms."""


class Recorder:
    """Plugin of pytest that records the lines of some folders that each test executes.

    It needs the package `coverage`, and must be made before the folders' modules are imported.
    """

    def __init__(self, folders: list[Path], data_file: Path):
        import coverage

        self._seconds: dict[str, float] = {}
        self._failed: set[str] = set()
        self._coverage = coverage.Coverage(
            data_file=str(data_file), source=list(map(str, folders)), config_file=False
        )
        self._coverage.start()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        """Record one test with its fixtures."""
        self._coverage.switch_context(item.nodeid)
        start = time.process_time()
        try:
            return (yield)
        finally:
            self._seconds[item.nodeid] = time.process_time() - start
            self._coverage.switch_context("")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note tests that fail or are skipped, which cannot catch mutants."""
        if report.outcome != "passed":
            self._failed.add(report.nodeid)

    def recording(self, root: Path) -> "Recording":
        """Stop, and return the recording, with paths from `root`."""
        self._coverage.stop()
        data = self._coverage.get_data()
        lines = {
            str(Path(source).relative_to(root)): {
                str(line): sorted(set(tests) - self._failed - {""})
                for line, tests in data.contexts_by_lineno(source).items()
            }
            for source in data.measured_files()
        }
        seconds = {test: s for test, s in self._seconds.items() if test not in self._failed}
        return Recording(seconds, lines)


@dataclass(frozen=True)
class Recording:
    """Tests and the lines that they execute.

    - `seconds`: processor time of each test, s.
    - `lines`: names of the tests that execute a line, by source file and by number of the line.
    """

    seconds: dict[str, float]
    lines: dict[str, dict[str, list[str]]]

    @staticmethod
    def read(file: Path) -> "Recording":
        """Return the recording in a file, or an empty one without a file."""
        if not file.exists():
            return Recording({}, {})
        return Recording(**json.loads(file.read_text(encoding="utf-8")))

    def write(self, file: Path) -> None:
        """Write the recording to a file."""
        content = {"seconds": self.seconds, "lines": self.lines}
        file.write_text(json.dumps(content), encoding="utf-8")

    def joined(self, newer: "Recording") -> "Recording":
        """Return both recordings together."""
        lines = {source: dict(found) for source, found in self.lines.items()}
        for source, found in newer.lines.items():
            for line, tests in found.items():
                known = lines.setdefault(source, {}).get(line, [])
                lines[source][line] = sorted({*known, *tests})
        return Recording({**self.seconds, **newer.seconds}, lines)

    def tests_for(self, mutant: Mutant, seconds: float) -> list[str]:
        """Return the tests to be run against a mutant, within a processor time.

        First come the tests that execute the changed statement, then those that execute any line of
        its file, since a program that an earlier test compiled hides the lines of later tests; last
        the tests of the room and those that concern all rooms. The cheapest of each of these groups
        come first, and the last two have a quarter of the time. The tests of a file stay together
        because they share fixtures.
        """
        of_file = self.lines.get(mutant.file, {})
        first, last = mutant.lines
        of_statement = {
            test for line in range(first, last + 1) for test in of_file.get(str(line), [])
        }
        of_module = {test for tests in of_file.values() for test in tests}
        folders = f"tests/{mutant.room}/", f"tests/internals/{mutant.room}/"
        of_room = {test for test in self.seconds if test.startswith((*folders, *GENERAL))}
        groups = [of_statement, of_module - of_statement, of_room - of_module - of_statement]
        chosen: list[str] = []
        left = seconds
        for group in groups:
            if group is not of_statement:
                left = min(left, 0.25 * seconds)
            within: dict[str, list[str]] = {}
            for test in sorted(group, key=lambda name: (self.seconds[name], name)):
                if self.seconds[test] <= left:
                    left -= self.seconds[test]
                    within.setdefault(test.split("::")[0], []).append(test)
            for names in sorted(within.values(), key=self.total):
                chosen += names
        return chosen

    def cheapest(self) -> str:
        """Return the name of the test that takes least time."""
        return min(self.seconds, key=lambda test: self.seconds[test])

    def total(self, tests: list[str]) -> float:
        """Return the processor time of tests, s."""
        return sum(self.seconds[test] for test in tests)
