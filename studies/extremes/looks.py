"""What is found at one place of a case's range."""

from dataclasses import dataclass

import numpy as np

RIGHT, REFUSED, WRONG = "right", "refused", "wrong"


@dataclass(frozen=True)
class Look:
    """`place`: the value looked at; `verdict`; `error` relative, NaN where refused; and `reason`,
    a result code or the argument that is refused."""

    place: float
    verdict: str
    error: float
    reason: str = ""


@dataclass(frozen=True)
class Row:
    """All looks of a case: what is varied, in which unit, and what the check and its bound are."""

    name: str
    unit: str
    check: str
    bound: float
    looks: tuple[Look, ...]

    def count(self, verdict: str) -> int:
        """How many looks have a verdict."""
        return sum(look.verdict == verdict for look in self.looks)

    @property
    def worst(self) -> float:
        """Largest error of the looks that are not refused."""
        return max((look.error for look in self.looks if look.verdict != REFUSED), default=np.nan)

    @property
    def reasons(self) -> str:
        """Why looks were refused, and from where to where."""
        found: dict[str, list[float]] = {}
        for look in self.looks:
            if look.verdict == REFUSED:
                found.setdefault(look.reason, []).append(look.place)
        return "; ".join(f"{reason}: {_span(places)}" for reason, places in found.items())


def _span(places: list[float]) -> str:
    ends = sorted({min(places), max(places)})
    return " to ".join(f"{place:g}" for place in ends)


def judged(place: float, result: str, error: float, bound: float) -> Look:
    """The look at a run that ended with a result code."""
    if result != "successful":
        return Look(place, REFUSED, np.nan, result)
    return Look(place, RIGHT if error <= bound else WRONG, error)
