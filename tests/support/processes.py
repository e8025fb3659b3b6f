"""Programs in processes of their own."""

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).parents[2]


def started(program: str | Path, *words: object) -> subprocess.Popen[str]:
    """A process in the repository's root that runs a text or a file, and whose output is piped."""
    return subprocess.Popen(_command(program, words), cwd=ROOT, stdout=subprocess.PIPE, text=True)


def printed(
    program: str | Path, *words: object, cwd: Path = ROOT, env: Mapping[str, str] | None = None
) -> str:
    """What a program that succeeds has printed at its end."""
    done = subprocess.run(
        _command(program, words), cwd=cwd, env=env, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def _command(program: str | Path, words: tuple[object, ...]) -> list[str]:
    begin = ["-c", program] if isinstance(program, str) else [str(program)]
    return [sys.executable, *begin, *map(str, words)]
