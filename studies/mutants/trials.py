"""Run tests against mutants, each in a process of its own, in a copy of the checkout.

This module must not import clearjoint, which each process imports from its copy.
"""

import json
import multiprocessing
import os
import resource
import shutil
import signal
import sys
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

import pytest

from studies.mutants.mutations import Mutant
from studies.mutants.recording import Recorder, Recording

LIBRARIES = [
    "beartype",
    "diffrax",
    "equinox",
    "hypothesis",
    "jax",
    "llvmlite.binding",
    "matplotlib.pyplot",
    "optax",
    "optimistix",
    "pandas",
    "pytest",
    "scipy.stats",
    "xarray",
    "zarr",
]
"""Packages that are imported once, by the process from which those of the mutants are forked."""
COPIED = ["clearjoint", "studies", "tests", "pyproject.toml"]
"""What the tests of kernels need of the checkout."""
PROCESSOR_LIMIT = 60
"""Processor time, s, after which a test counts as failed. No fast test needs as much."""
WALL_LIMIT = 1800.0
"""Wall time, s, after which a process is killed in any case."""
NOT_THE_COPY = 77
"""Exit code of a process that has imported clearjoint from another folder than the copy."""
KILLED = (255, -signal.SIGTERM, -signal.SIGINT)
"""Exit codes of a process that was ended from outside, or (255) whose parent was."""
MEMORY_LIMIT = 8 * 2**30
"""Bytes of memory that a process may take."""


@dataclass(frozen=True)
class Outcome:
    """Result of the tests of a mutant.

    - `caught`: whether a test failed, or the process ended before it had run all tests.
    - `by`: the first test that failed, or how the process ended.
    - `tests`: number of tests that were run.
    """

    caught: bool
    by: str
    tests: int


class Copy:
    """Copy of a checkout, in which one mutant at a time is tested.

    The copies of a study may share a cache of compiled programs: machine code is found there by the
    text from which it was compiled, and the tests save no other programs.

    **Arguments:** `root`: the checkout. `folder`: where to make the copy. `cache`: folder of the
    cache. `libraries`: packages that are imported once for all mutants.
    """

    def __init__(self, root: Path, folder: Path, cache: Path, libraries: list[str]):
        for name in COPIED:
            copy = shutil.copy2 if (root / name).is_file() else shutil.copytree
            folder.mkdir(parents=True, exist_ok=True)
            copy(root / name, folder / name)
        self._root, self._folder, self._cache = root, folder, cache
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(libraries)

    def check(self, tests: list[str]) -> None:
        """Run tests on unchanged code.

        **Raises:** `RuntimeError` if one fails, since a mutant would count as caught by it.
        """
        outcome = self._outcome(tests, PROCESSOR_LIMIT, 0)
        if outcome.caught:
            raise RuntimeError(f"{outcome.by} on unchanged code; all tests must pass there.")

    def run(self, mutant: Mutant, tests: list[str], seconds: float, seed: int) -> Outcome:
        """Run tests against a mutant, in the given order and up to the first failure.

        **Arguments:** `tests`: their names in pytest. `seconds`: processor time after which no
        further test begins. `seed`: that of tests with random examples.
        """
        changed, original = self._folder / mutant.file, self._root / mutant.file
        self._forget_compiled(changed)
        changed.write_text(mutant.applied(original.read_text(encoding="utf-8")), encoding="utf-8")
        try:
            return self._outcome(tests, seconds, seed)
        finally:
            self._forget_compiled(changed)
            shutil.copy2(original, changed)

    def record(self, rooms: list[str], tests: list[str]) -> Recording:
        """Run tests, given by files or folders, on unchanged code, and record them."""
        file = self._folder / "recording.json"
        file.unlink(missing_ok=True)
        ending = self._in_process(_record, rooms, tests)
        if not file.exists():
            raise RuntimeError(f"The tests were not recorded, because the process {ending}.")
        return Recording.read(file)

    def _outcome(self, tests: list[str], seconds: float, seed: int) -> Outcome:
        file = self._folder / "outcome.json"
        file.unlink(missing_ok=True)
        ending = self._in_process(_test, tests, seconds, seed)
        with suppress(OSError, ValueError):
            found = json.loads(file.read_text(encoding="utf-8"))
            return Outcome(**found)
        return Outcome(True, f"a process that {ending}", len(tests))

    def _in_process(self, function, *arguments: object) -> str:
        """Call a function in a process, and return how the process ended."""
        process = self._context.Process(
            target=function, args=(self._folder, self._cache, *arguments)
        )
        process.start()
        process.join(WALL_LIMIT if function is _test else None)
        if process.exitcode is None and process.pid is not None:
            os.killpg(process.pid, signal.SIGKILL)
            process.join()
            return "took too long"
        assert process.exitcode is not None
        if process.exitcode == NOT_THE_COPY:
            raise RuntimeError(
                "The process has imported clearjoint before it used the copy, probably from the "
                "script that runs the study: run `python -m studies.mutants`."
            )
        if process.exitcode in KILLED:
            raise RuntimeError("A process was ended from outside: run the command again.")
        if process.exitcode >= 0:
            return f"ended with code {process.exitcode}"
        return f"ended by {signal.Signals(-process.exitcode).name}"

    def _forget_compiled(self, file: Path) -> None:
        """Remove Python's compiled files of a source file.

        Python would take one as current if its source has the same size and time, in seconds.
        """
        for compiled in (file.parent / "__pycache__").glob(f"{file.stem}.*"):
            compiled.unlink()


class _Selection:
    """Plugin of pytest that runs given tests, or files of tests, in their order.

    - `failed`: name of the first test or file that failed.
    - `begun`: number of tests that were begun.
    - `seconds`: processor time of the process, s, after which no further test begins.
    """

    def __init__(self, tests: list[str], seconds: float):
        self._ranks = {test: rank for rank, test in enumerate(tests)}
        self.seconds = seconds
        self.failed, self.begun = "", 0

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Select and sort the tests."""
        ranks = {item: self._rank(item) for item in items}
        selected = [item for item in items if ranks[item] is not None]
        items[:] = sorted(selected, key=lambda item: ranks[item] or 0)

    def _rank(self, item: pytest.Item) -> int | None:
        names = item.nodeid, item.nodeid.split("[")[0], item.nodeid.split("::")[0]
        return next((self._ranks[name] for name in names if name in self._ranks), None)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> bool | None:
        """Limit the processor time of the test, or leave it out if the time is used up."""
        used = time.process_time()
        if used > self.seconds:
            return True
        self.begun += 1
        resource.setrlimit(
            resource.RLIMIT_CPU, (int(used) + PROCESSOR_LIMIT, resource.RLIM_INFINITY)
        )
        return None

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Note a file of tests that cannot be imported."""
        if report.failed:
            self.failed = self.failed or report.nodeid

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note a test that failed."""
        if report.failed:
            self.failed = self.failed or report.nodeid


def _enter(folder: Path, cache: Path) -> None:
    """Let this process use the copy in a folder, and write its output there.

    It ends with the code `NOT_THE_COPY` if clearjoint has been imported from elsewhere.
    """
    if "clearjoint" in sys.modules:
        sys.exit(NOT_THE_COPY)
    os.setpgrp()
    os.chdir(folder)
    sys.path.insert(0, str(folder))
    # Bytecode is written beside the sources of this copy, also if environment variables switch that
    # off or name another folder. Python then compiles only the changed module for each mutant.
    sys.dont_write_bytecode, sys.pycache_prefix = False, None
    os.environ["PYTHONPATH"] = str(folder)
    os.environ["CLEARJOINT_CACHE"] = str(cache)
    log = os.open("log.txt", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(log, sys.stdout.fileno())
    os.dup2(log, sys.stderr.fileno())


def _test(folder: Path, cache: Path, tests: list[str], seconds: float, seed: int) -> None:
    _enter(folder, cache)
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY_LIMIT, MEMORY_LIMIT))
    # Tests that are gone since the recording must not count as having caught the mutant: a missing
    # file ends pytest with an error.
    files = filter(os.path.exists, dict.fromkeys(test.split("::")[0] for test in tests))
    selection = _Selection(tests, time.process_time() + seconds)
    options = f"-x -q -n 0 -p no:cacheprovider --tb=line --hypothesis-seed={seed}".split()
    code = pytest.main([*options, *files], plugins=[selection])
    by = selection.failed or f"an ending of pytest, {pytest.ExitCode(code).name}"
    passed = code in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED)
    outcome = Outcome(not passed, by, selection.begun)
    Path("outcome.json").write_text(json.dumps(asdict(outcome)), encoding="utf-8")
    # Threads and processes of a failed test must not keep this process alive.
    os._exit(0)


def _record(folder: Path, cache: Path, rooms: list[str], tests: list[str]) -> None:
    _enter(folder, cache)
    recorder = Recorder(
        [folder / "clearjoint" / f"_{room}" for room in rooms], folder / ".coverage"
    )
    pytest.main(["-q", "-n", "0", "-p", "no:cacheprovider", *tests], plugins=[recorder])
    recorder.recording(folder).write(Path("recording.json"))
