"""The pendulum in C++: build, runs, and a check that its motion agrees."""

import json
import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import clearjoint as cj

SOURCE = Path(__file__).with_name("yardstick.cpp")
FLAGS = ("-std=gnu++17", "-O3", "-march=native", "-ffast-math")
SCALAR, EIGHT = "scalar C++", "C++ of eight lanes"
WIDTHS = {SCALAR: 1, EIGHT: 8}
CLEARANCE, RESTITUTION = 0.5e-3, 0.9
"""Clearance, m, and restitution of single runs; the restitution is also that of the C++."""
CHECKED_RTOL, CHECKED_SPAN = 1e-9, 0.1
"""Tolerance and span, s, of the comparison with clearjoint: five impacts, before chaos."""


@dataclass(frozen=True)
class Timed:
    """Processor time, s, and for each run: attempted steps, onset, s, and entry speed, m/s, of the
    first impact (NaN if there is none), and the final centre of arm 2, (runs, 3) m.
    """

    seconds: float
    attempts: np.ndarray
    onsets: np.ndarray
    speeds: np.ndarray
    positions: np.ndarray


@dataclass(frozen=True)
class Agreement:
    """Differences of a run in C++ from clearjoint: relative ones of onset and entry speed of the
    first impact, and of arm 2's centre before chaos, m.
    """

    onset: float
    speed: float
    position: float

    def check(self) -> None:
        """**Raises:** `RuntimeError` if the motions are not the same."""
        if not (self.onset < 1e-9 and self.speed < 1e-8 and self.position < 1e-8):
            raise RuntimeError(f"The yardstick does not move as clearjoint's pendulum: {self}.")


class Yardstick:
    """The built program."""

    def __init__(self, program: Path):
        self._program = program

    def run(
        self,
        kind: str,
        span: float,
        rtol: float,
        clearances: tuple[float, float, int] = (CLEARANCE, CLEARANCE, 1),
    ) -> Timed:
        """Run a number of radial clearances over `span`, s, log-spaced from the least to the
        largest, m.
        """
        least, most, count = clearances
        numbers = (WIDTHS[kind], span, rtol, count, least, most, 1)
        words = [str(self._program), *(repr(float(n)) if n != int(n) else str(n) for n in numbers)]
        done = subprocess.run(words, capture_output=True, text=True, check=True)
        # C++ writes what is not a number as `nan` or `-nan`.
        found = json.loads(re.sub("-?nan", "NaN", done.stdout))
        runs = found["runs"]
        return Timed(
            found["seconds"],
            np.array([run["accepted"] + run["rejected"] for run in runs]),
            np.array([run["first_onset"] for run in runs], float),
            np.array([run["first_speed"] for run in runs], float),
            np.array([run["arm_2"] for run in runs]),
        )

    def agreement(self, kind: str) -> Agreement:
        """Return the difference from clearjoint at the tolerance and span of the comparison."""
        found = self.run(kind, CHECKED_SPAN, CHECKED_RTOL)
        expected = cj.simulate(
            *cj.mechanisms.double_pendulum(CLEARANCE, RESTITUTION),
            CHECKED_SPAN,
            cj.Settings(rtol=CHECKED_RTOL),
            save=cj.Saving(impacts=True),
            progress=False,
        )
        impacts = expected.impacts
        assert impacts is not None
        first = int(np.argmin(impacts.onset))
        position = np.asarray(expected.final.bodies["arm 2"].position)
        return Agreement(
            float(abs(found.onsets[0] / impacts.onset[first] - 1.0)),
            float(abs(found.speeds[0] / impacts.entry_speed[first] - 1.0)),
            float(np.linalg.norm(found.positions[0] - position)),
        )


def build(folder: Path) -> Yardstick | None:
    """Compile the program in a folder; print the reason and return ``None`` if that fails."""
    compiler = os.environ.get("CXX") or shutil.which("g++") or shutil.which("c++")
    if compiler is None:
        print("No C++ compiler (g++ or c++) was found: rows with C++ have no ratio.")
        return None
    folder.mkdir(parents=True, exist_ok=True)
    program = folder / "yardstick"
    command = [compiler, *FLAGS, "-o", str(program), str(SOURCE)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        print(f"{compiler} can't be run ({error}): rows with C++ have no ratio.")
        return None
    if done.returncode:
        print(f"{' '.join(command)} failed: rows with C++ have no ratio.\n{done.stderr[:2000]}")
        return None
    return Yardstick(program.resolve())
