"""Reads the reference trajectories: an independent event-exact solver in extended precision."""

import csv
import gzip
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Case:
    """One file: clearance m, restitution, and the time up to which doubles can follow it, s."""

    clearance: float
    restitution: float
    safe: float

    def _stem(self) -> str:
        return f"double_pendulum_c{self.clearance:g}_e{self.restitution:.1f}".replace(
            "5e-05", "0.00005"
        )

    def trajectory(self, folder: Path) -> dict[str, np.ndarray]:
        """Columns by name up to the safe time."""
        with gzip.open(folder / f"{self._stem()}.csv.gz", "rt") as file:
            columns = _columns(file)
        keep = columns["t"] <= self.safe
        return {name: column[keep] for name, column in columns.items()}

    def impacts(self, folder: Path, base: str) -> dict[str, np.ndarray]:
        """Columns of the impact table of one base, for contacts that end within the safe time."""
        with open(folder / f"{self._stem()}_impacts.csv") as file:
            rows = [row for row in csv.DictReader(file) if row.pop("base") == base]
        columns = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
        keep = columns["t_off"] <= self.safe
        return {name: column[keep] for name, column in columns.items()}


def _columns(file) -> dict[str, np.ndarray]:
    names = file.readline().strip().split(",")
    data = np.loadtxt(file, delimiter=",")
    return dict(zip(names, data.T, strict=True))


CASES = (
    Case(5e-4, 0.9, 0.15),
    Case(5e-5, 0.9, 0.055),
    Case(1e-3, 0.9, 0.23),
    Case(5e-4, 0.5, 0.30),
    Case(5e-4, 1.0, 0.22),
)
