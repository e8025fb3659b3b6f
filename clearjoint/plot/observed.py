"""Look up contacts, reactions and bodies of an observation by name, and merge equal curves."""

from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from .._fields.checks import nearest, require
from .._fields.drawn_text import shown
from .._simulation.results.observe import ContactObservation, Observation

T = TypeVar("T")


def contacts(observation: Observation, joint: str) -> dict[str, ContactObservation]:
    """Return the observations of all contacts of a joint, by their labels."""
    return named("joint", joint, observation.contacts)


def require_contacts(observation: Observation) -> None:
    """Raise a `ValueError` for an observation without contacts."""
    names, remedy = list(observation.contacts), "give a joint some clearance"
    require(len(names) > 0, "observation", names, "of a scene with contacts", remedy)


def contact(observation: Observation, joint: str, label: str) -> ContactObservation:
    """Return the observation of one contact of a joint."""
    return named("contact", label, contacts(observation, joint))


def spans(mask: np.ndarray) -> np.ndarray:
    """Return (start, stop), (M, 2), of the M intervals where a mask is true; `stop` is excluded."""
    # The padded mask changes at both ends of each interval, also of one at an end of the mask:
    # starts and stops alternate.
    return np.flatnonzero(np.diff(np.pad(mask, 1).astype(int))).reshape(-1, 2)


def without_twins(curves: Mapping[str, np.ndarray]) -> list[tuple[str, np.ndarray]]:
    """Return the labels and values of `curves`, with equal ones merged, so that none hides another.
    Curves are equal if they differ by less than a line's width; the merged label has all their
    names, such as "bases V and W"."""
    scale = max((np.abs(values).max(initial=0.0) for values in curves.values()), default=0.0)
    distinct: list[tuple[list[str], np.ndarray]] = []
    for label, values in curves.items():
        for names, drawn_values in distinct:
            if np.allclose(values, drawn_values, rtol=1e-3, atol=1e-5 * scale):
                names.append(label)
                break
        else:  # no curve in `distinct` equals this one
            distinct.append(([label], values))
    return [(_joined(names), values) for names, values in distinct]


def _joined(names: list[str]) -> str:
    if len(names) > 1 and all(name.startswith("base ") for name in names):
        return "bases " + " and ".join(name.removeprefix("base ") for name in names)
    return " and ".join(map(shown, names))


def named(argument: str, name: str, family: Mapping[str, T]) -> T:
    """Return the entry `name` of the dictionary `family`; an error calls the name `argument`."""
    expected = f"one of those observed, {sorted(family)}"
    require(name in family, argument, name, expected, nearest(name, family, "correct the name"))
    return family[name]
