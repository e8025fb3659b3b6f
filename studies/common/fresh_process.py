"""Measurements in a fresh Python process."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
"""Folder from which `studies` can be imported."""
SETTINGS = {"JAX_ENABLE_X64", "XLA_FLAGS", "JAX_COMPILATION_CACHE_DIR", "CLEARJOINT_CACHE"}
"""Environment variables that are not passed on to the process."""


def in_process(code: str, *arguments: str, **variables: str) -> tuple[float, Any]:
    """Run code in a fresh Python without clearjoint's environment variables except the given ones.

    Return the wall time of the process, s, and its last line of output, as JSON.
    """
    start = time.perf_counter()
    done = _run(code, arguments, variables)
    seconds = time.perf_counter() - start
    if done.returncode:
        raise RuntimeError(f"A measuring process failed:\n{done.stderr}")
    return seconds, json.loads(done.stdout.splitlines()[-1])


def lines_of_process(code: str, *arguments: str, **variables: str) -> tuple[list[str], bool]:
    """Run code as `in_process` does, and return its lines of output and whether the system ended
    it, as at a limit of its processor time.
    """
    done = _run(code, arguments, variables)
    if done.returncode > 0:
        raise RuntimeError(f"A measuring process failed:\n{done.stderr}")
    # A line that the process was writing when it was ended is left out.
    lines = [line for line in done.stdout.splitlines(keepends=True) if line.endswith("\n")]
    return lines, done.returncode < 0


def _run(
    code: str, arguments: tuple[str, ...], variables: dict[str, str]
) -> subprocess.CompletedProcess[str]:
    kept = {name: value for name, value in os.environ.items() if name not in SETTINGS}
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(
        command, env=kept | variables, cwd=ROOT, capture_output=True, text=True, check=False
    )
