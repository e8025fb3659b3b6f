"""The table of the impacts of a run."""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from ...export.labelled import Labelled, labelled_dataset, texts
from ...export.tabular import AbstractTabular

if TYPE_CHECKING:
    import xarray as xr

NAMED = "joint", "contact"
"""Columns that are names."""
IMPACT_UNITS = {
    "onset": "s",
    "separation": "s",
    "duration": "s",
    "entry_speed": "m/s",
    "exit_speed": "m/s",
    "peak_force": "N",
    "peak_time": "s",
    "largest_penetration": "m",
}
"""Units of the other columns."""


@dataclass(frozen=True)
class Impacts(AbstractTabular):
    """Table of finished contacts in the order of their onsets; each field is a column.

    - `joint`, `contact`: names.
    - `onset`, `separation`, `duration`, `peak_time`: s.
    - `entry_speed`, `exit_speed`: m/s, both positive.
    - `peak_force`: N, of the normal force; `largest_penetration`: m.

    It is the result `simulate(..., save=Saving(impacts=True)).impacts`. By hand:

    >>> columns = [np.array([name]) for name in ("pin", "V")]
    >>> numbers = 0.01, 0.0102, 0.0002, 0.1, 0.08, 900.0, 0.0101, 2e-6  # in the order above
    >>> columns += [np.array([number]) for number in numbers]
    >>> impacts = cj.results.Impacts(*columns)
    >>> print(f"{impacts.exit_speed[0] / impacts.entry_speed[0]:.2f}")  # the restitution
    0.80
    """

    joint: np.ndarray
    contact: np.ndarray
    onset: np.ndarray
    separation: np.ndarray
    duration: np.ndarray
    entry_speed: np.ndarray
    exit_speed: np.ndarray
    peak_force: np.ndarray
    peak_time: np.ndarray
    largest_penetration: np.ndarray

    def __len__(self) -> int:
        return len(self.onset)

    def to_xarray(self) -> "xr.Dataset":
        """Return an `xarray.Dataset` along "impact", with units; see `AbstractTabular`."""
        names = {name: Labelled(("impact",), texts(getattr(self, name))) for name in NAMED}
        numbers = {
            name: Labelled(("impact",), getattr(self, name), unit, name.replace("_", " "))
            for name, unit in IMPACT_UNITS.items()
        }
        order = Labelled(("impact",), np.arange(len(self), dtype=np.int32))
        return labelled_dataset("impacts", {**names, **numbers}, {"impact": order})

    @staticmethod
    def of_rows(rows: Iterable[tuple[str | float, ...]]) -> "Impacts":
        """Return a table from rows with all fields, in any order."""
        ordered = sorted(rows, key=lambda row: (row[2], row[0], row[1]))
        columns = list(zip(*ordered, strict=True)) or [()] * len(fields(Impacts))
        text, numbers = columns[:2], columns[2:]
        return Impacts(
            *(np.array(column, dtype=object) for column in text),
            *(np.array(column, dtype=float) for column in numbers),
        )

    def of(self, joint: str, contact: str) -> "Impacts":
        """Return the impacts of one contact of a joint, both by name."""
        chosen = (self.joint == joint) & (self.contact == contact)
        return Impacts(**{f.name: getattr(self, f.name)[chosen] for f in fields(self)})

    def within(self, after: float = -np.inf, until: float = np.inf) -> "Impacts":
        """Return the impacts that began from `after` on and before `until`, s.

        For example, ``np.quantile(solution.impacts.within(after=0.5).peak_force, 0.95)``.
        """
        chosen = (self.onset >= after) & (self.onset < until)
        return Impacts(**{f.name: getattr(self, f.name)[chosen] for f in fields(self)})
