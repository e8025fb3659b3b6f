"""Look up contacts, reactions and bodies of an observation by name."""

from collections.abc import Collection, Mapping

import numpy as np

from ..fields.checks import require
from ..fields.drawn_text import shown
from ..simulation.results.observe import ContactObservation, Load, Observation
from ..simulation.results.solution import Trajectory

ALIKE, ALIKE_OF_LARGEST = 1e-3, 1e-5
"""Two curves count as equal if they differ at each point by at most the first number times the
value there plus the second number times the largest value of all curves."""


def contacts(observation: Observation, joint: str) -> dict[str, ContactObservation]:
    """Return the observations of all contacts of a joint, by the contacts' labels.

    **Raises:** `ValueError` that lists the known names.
    """
    _require_known("joint", joint, observation.contacts)
    return observation.contacts[joint]


def require_contacts(observation: Observation) -> None:
    """Raise `ValueError` if an observation has no contacts."""
    names, remedy = list(observation.contacts), "give a joint some clearance"
    require(len(names) > 0, "observation", names, "of a scene with contacts", remedy)


def contact(observation: Observation, joint: str, label: str) -> ContactObservation:
    """Return the observation of one contact of a joint.

    **Raises:** `ValueError` that lists the known names.
    """
    by_name = contacts(observation, joint)
    _require_known("contact", label, by_name)
    return by_name[label]


def reaction(observation: Observation, joint: str, body: str) -> Load:
    """Return the force (N, 3), N, global, and the moment (N, 3), N m, about the centre of mass in
    body axes, of an ideal joint on a body.

    **Raises:** `ValueError` that lists the known names.
    """
    _require_known("joint", joint, observation.reactions)
    _require_known("body", body, observation.reactions[joint])
    return observation.reactions[joint][body]


def acceleration_of(observation: Observation, body: str) -> np.ndarray:
    """Return the acceleration of a body's centre of mass, (N, 3) in global axes, m/s^2.

    **Raises:** `ValueError` that lists the known names.
    """
    _require_known("body", body, observation.accelerations)
    return np.asarray(observation.accelerations[body].linear)


def centre_of(trajectory: Trajectory, body: str) -> np.ndarray:
    """Return the position of a body's centre of mass, (N, 3) in global axes, m.

    **Raises:** `ValueError` that lists the known names.
    """
    _require_known("body", body, trajectory.states.bodies)
    return np.asarray(trajectory.states.bodies[body].position)


def without_twins(curves: Mapping[str, np.ndarray]) -> list[tuple[str, np.ndarray]]:
    """Merge equal curves: both bases of a journal, for example, move alike in planar motion.

    **Arguments:** `curves`: arrays of one shape, by label.

    **Returns:** label and values of each remaining curve, in the given order. The label of merged
    curves has all their labels, such as "bases V and W".
    """
    scale = max((np.abs(values).max(initial=0.0) for values in curves.values()), default=0.0)
    distinct: list[tuple[list[str], np.ndarray]] = []
    for label, values in curves.items():
        for names, first in distinct:
            if np.allclose(values, first, rtol=ALIKE, atol=ALIKE_OF_LARGEST * scale):
                names.append(label)
                break
        else:
            distinct.append(([label], values))
    return [(_joined(names), values) for names, values in distinct]


def _joined(names: list[str]) -> str:
    if len(names) > 1 and all(name.startswith("base ") for name in names):
        return "bases " + " and ".join(name.removeprefix("base ") for name in names)
    return " and ".join(map(shown, names))


def _require_known(argument: str, name: str, known: Collection[str]) -> None:
    """Raise `ValueError` with the known names unless `name` is among them."""
    expected = f"one of those observed, {sorted(known)}"
    require(name in known, argument, name, expected, "correct the name")
