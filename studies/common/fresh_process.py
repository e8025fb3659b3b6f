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
    kept = {name: value for name, value in os.environ.items() if name not in SETTINGS}
    command = [sys.executable, "-c", code, *arguments]
    start = time.perf_counter()
    done = subprocess.run(
        command, env=kept | variables, cwd=ROOT, capture_output=True, text=True, check=False
    )
    seconds = time.perf_counter() - start
    if done.returncode:
        raise RuntimeError(f"A measuring process failed:\n{done.stderr}")
    return seconds, json.loads(done.stdout.splitlines()[-1])
