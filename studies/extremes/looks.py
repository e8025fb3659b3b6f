"""Result at one value of a case's range."""

from dataclasses import dataclass

import numpy as np

RIGHT, REFUSED, WRONG = "right", "refused", "wrong"


@dataclass(frozen=True)
class Look:
    """Result at a value.

    `verdict`: right, refused or wrong. `error`: relative, NaN if refused. `reason`: result code or
    refused argument.
    """

    place: float
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
    looks: tuple[Look, ...]

    def count(self, verdict: str) -> int:
        """Return the number of results with a verdict."""
        return sum(look.verdict == verdict for look in self.looks)

    @property
    def worst(self) -> float:
        """Largest error of the results that are not refused."""
        return max((look.error for look in self.looks if look.verdict != REFUSED), default=np.nan)

    @property
    def reasons(self) -> str:
        """Reasons of refusals with their ranges of values, as text."""
        found: dict[str, list[float]] = {}
        for look in self.looks:
            if look.verdict == REFUSED:
                found.setdefault(look.reason, []).append(look.place)
        return "; ".join(f"{reason}: {_span(places)}" for reason, places in found.items())


def _span(places: list[float]) -> str:
    ends = sorted({min(places), max(places)})
    return " to ".join(f"{place:g}" for place in ends)


def judged(place: float, result: str, error: float, bound: float) -> Look:
    """Return the result of a run that ended with a result code."""
    if result != "successful":
        return Look(place, REFUSED, np.nan, result)
    return Look(place, RIGHT if error <= bound else WRONG, error)
