"""Pareto front: settings that no other setting beats in both cost and error."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

Item = TypeVar("Item")
Measure = Callable[[Item], tuple[float, float]]
"""Cost and error of an item."""
NEAR = 1.25
"""Factor of the front's cost within which a family is not called dominated: costs vary as much."""


def finite(items: Sequence[Item], measure: Measure) -> list[Item]:
    """Return the items with a finite and positive cost and error."""
    return [item for item in items if all(0.0 < value < np.inf for value in measure(item))]


def front(items: Sequence[Item], measure: Measure) -> list[Item]:
    """Return the items of the front, from cheap to exact."""
    kept: list[Item] = []
    for item in sorted(finite(items, measure), key=measure):
        if not kept or measure(item)[1] < measure(kept[-1])[1]:
            kept.append(item)
    return kept


def excess(item: Item, items: Sequence[Item], measure: Measure) -> float:
    """Return the cost relative to that of the cheapest item with at most this error."""
    cost, error = measure(item)
    return cost / min(c for c, e in map(measure, finite(items, measure)) if e <= error)


@dataclass(frozen=True)
class Standing:
    """Least and median excess of a family over the front, and its nearest item."""

    family: str
    least: float
    middle: float
    nearest: str

    @property
    def dominated(self) -> bool:
        """Whether for each item of the family a cheaper one is at least as exact."""
        return self.least > NEAR


def standings(
    items: Sequence[Item], measure: Measure, family: Callable[[Item], str]
) -> list[Standing]:
    """Return each family, the best first, without families that have no finite item."""
    shown = finite(items, measure)
    found = []
    for name in dict.fromkeys(map(family, shown)):
        ratios = {str(item): excess(item, shown, measure) for item in shown if family(item) == name}
        nearest = min(ratios, key=lambda label: ratios[label])
        middle = float(np.median(list(ratios.values())))
        found.append(Standing(name, ratios[nearest], middle, nearest))
    return sorted(found, key=lambda standing: (standing.least, standing.middle))
