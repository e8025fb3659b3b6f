"""Files of swings in three formats.

- MATLAB files of dynamicslab/MultiArm-Pendulum: `Time_id`, `Y_id`, `Time_vad`, `Y_vad` (consecutive
  pieces of one swing, the first for fits and the last for validation; angle and speed in rad and
  rad/s, from the upright), or `Theta1` (one swing).
- Text of jensen-benard/rotary-inverted-pendulum: a line of names, a line of values with the
  sampling rate, then one angle in degrees a line.
- Text of Schmidt and Lipson 2009, in erwincoumans/tiny-differentiable-simulator: a header such as
  `% o v`, then trial, t, angle in rad and further columns.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

HELD_BY_HAND = "trigger_start_deg"


@dataclass(frozen=True)
class Swing:
    """Increasing times (N,), s, and angles from rest (N,), rad."""

    name: str
    times: np.ndarray
    angles: np.ndarray

    def free(self) -> "Swing":
        """Return the swing from the first passage through the vertical on: before, a hand may have
        held it.
        """
        middle = 0.5 * (self.angles.max() + self.angles.min())
        below = self.angles < middle
        first = int(np.flatnonzero(below[1:] != below[:-1])[0])
        return Swing(self.name, self.times[first:], self.angles[first:])

    def thinned(self, interval: float) -> "Swing":
        """Return samples about an interval in s apart."""
        step = max(1, round(interval / float(np.median(np.diff(self.times)))))
        return Swing(self.name, self.times[::step], self.angles[::step])


def read_swings(path: Path) -> list[Swing]:
    """Read the swings in a file.

    **Raises:** `ValueError` for a file of another kind, or with invalid values.
    """
    if not path.is_file():
        raise ValueError(f"{path} is not there: give a file.")
    swings = _matlab(path) if path.suffix == ".mat" else _text(path)
    for swing in swings:
        _check(path, swing)
    return swings


def _check(path: Path, swing: Swing) -> None:
    where = f"{path} ({swing.name})"
    if len(swing.times) < 10 or swing.times.shape != swing.angles.shape:
        raise ValueError(
            f"{where} has {swing.times.shape} times and {swing.angles.shape} angles: as many of "
            "both are needed, and ten at least."
        )
    fine = np.isfinite(swing.times) & np.isfinite(swing.angles)
    if not fine.all():
        raise ValueError(f"Sample {np.argmin(fine) + 1} of {where} is not finite: leave it out.")
    rising = np.diff(swing.times) > 0.0
    if not rising.all():
        k = int(np.argmin(rising)) + 1
        raise ValueError(
            f"Time {swing.times[k]} s of sample {k + 1} of {where} is not later than the one "
            "before: sort the samples."
        )
    if np.ptp(np.sign(swing.angles - swing.angles.mean())) == 0.0:
        raise ValueError(f"The angle in {where} never changes: it is no swing.")


def _matlab(path: Path) -> list[Swing]:
    try:
        content = loadmat(path)
    except (ValueError, NotImplementedError, MatReadError) as error:
        raise ValueError(f"{path} is not a MATLAB file of version 5: {error}.") from error
    if {"Time_id", "Y_id", "Time_vad", "Y_vad"} <= set(content):
        return [_pieces(path, content, name) for name in ("id", "vad")]
    if "Theta1" in content:
        recorded = content["Theta1"][0, 0]
        times = recorded["time"].ravel()
        angles = recorded["signals"][0, 0]["values"].ravel() - np.pi
        return [Swing(path.stem, times - times[0], angles)]
    names = sorted(name for name in content if not name.startswith("__"))
    raise ValueError(
        f"{path} holds {names}, neither Time_id, Y_id, Time_vad and Y_vad nor Theta1: give "
        "SinglePendulumDataForParameterEstimation.mat or SingleDataFreeSwing_1_Dt_0_0001.mat."
    )


def _pieces(path: Path, content: dict[str, Any], name: str) -> Swing:
    """Return consecutive pieces joined."""
    times = np.concatenate([piece.ravel() for piece in content[f"Time_{name}"][:, 0]])
    angles = np.concatenate([piece[0] for piece in content[f"Y_{name}"][:, 0]]) - np.pi
    return Swing(f"{path.stem}, {name}", times, angles)


def _text(path: Path) -> list[Swing]:
    lines = path.read_text(encoding="utf-8").splitlines()
    header = lines[0] if lines else ""
    if header.startswith(HELD_BY_HAND):
        return [_one_column(path, lines)]
    names = header.lstrip("%").split()
    if header.startswith("%") and names and names[0] == "o":
        return _columns(path, lines, len(names))
    raise ValueError(
        f"{path} begins with {header[:60]!r}, which is neither '{HELD_BY_HAND}, ...' nor a "
        "'% o ...' of one angle: give a file of one of the repositories that this module names."
    )


def _one_column(path: Path, lines: list[str]) -> Swing:
    names = [name.strip() for name in lines[0].split(",")]
    rate = _numbers(path, 2, lines[1].replace(",", " "))[names.index("sample_rate")]
    rows = [_numbers(path, k, line)[0] for k, line in enumerate(lines[2:], 3) if line.strip()]
    angles = np.radians(rows)
    return Swing(path.stem, np.arange(len(angles)) / rate, angles)


def _columns(path: Path, lines: list[str], values: int) -> list[Swing]:
    rows = [_numbers(path, k, line) for k, line in enumerate(lines[1:], 2) if line.strip()]
    for k, row in enumerate(rows, 2):
        if len(row) != values + 2:
            raise ValueError(
                f"Row {k} of {path} has {len(row)} numbers: trial, time and {values} more are "
                "expected by its header."
            )
    table = np.array(rows)
    trials = [(trial, table[table[:, 0] == trial].T) for trial in np.unique(table[:, 0])]
    return [Swing(f"{path.stem}, trial {trial:g}", t, angle) for trial, (_, t, angle, *_) in trials]


def _numbers(path: Path, row: int, line: str) -> list[float]:
    try:
        return [float(word) for word in line.split()]
    except ValueError as error:
        raise ValueError(f"Row {row} of {path} must be numbers, but is {line!r}.") from error
