"""Result at one value of a case's range."""

from dataclasses import dataclass

import numpy as np

RIGHT, REFUSED, WRONG = "right", "refused", "wrong"


@dataclass(frozen=True)
class Entry:
    """Result at a value.

    `verdict`: right, refused or wrong. `error`: relative, NaN if refused. `reason`: result code or
    refused argument.
    """

    value: float
    verdict: str
    error: float
    reason: str = ""


@dataclass(frozen=True)
class Row:
    """Results of a case: the varied number, its unit, the check and the largest allowed error."""

    name: str
    unit: str
    check: str
    bound: float
    entries: tuple[Entry, ...]

    def count(self, verdict: str) -> int:
        """Return the number of results with a verdict."""
        return sum(entry.verdict == verdict for entry in self.entries)

    @property
    def worst(self) -> float:
        """Largest error of the results that are not refused."""
        return max(
            (entry.error for entry in self.entries if entry.verdict != REFUSED), default=np.nan
        )

    @property
    def reasons(self) -> str:
        """Reasons of refusals with their ranges of values, as text."""
        found: dict[str, list[float]] = {}
        for entry in self.entries:
            if entry.verdict == REFUSED:
                found.setdefault(entry.reason, []).append(entry.value)
        return "; ".join(f"{reason}: {_span(values)}" for reason, values in found.items())


def _span(values: list[float]) -> str:
    ends = sorted({min(values), max(values)})
    return " to ".join(f"{value:g}" for value in ends)


def judged(value: float, result: str, error: float, bound: float) -> Entry:
    """Return the result of a run that ended with a result code."""
    if result != "successful":
        return Entry(value, REFUSED, np.nan, result)
    return Entry(value, RIGHT if error <= bound else WRONG, error)
