"""Contacts, reactions and bodies of an observation by name, with an error for a wrong one."""

from collections.abc import Collection

import numpy as np

from ..fields.checks import require
from ..simulation.observe import ContactObservation, Load, Observation
from ..simulation.solution import Trajectory


def contacts(observation: Observation, joint: str) -> dict[str, ContactObservation]:
    """Observations of all contacts of a joint, by the contact's name.

    **Raises:** `ValueError` that lists what there is.
    """
    _require_known("joint", joint, observation.contacts)
    return observation.contacts[joint]


def require_contacts(observation: Observation) -> None:
    """Check that a scene has contacts."""
    names, remedy = list(observation.contacts), "give a joint some clearance"
    require(len(names) > 0, "observation", names, "of a scene with contacts", remedy)


def contact(observation: Observation, joint: str, label: str) -> ContactObservation:
    """Observations of one contact of a joint.

    **Raises:** `ValueError` that lists what there is.
    """
    by_name = contacts(observation, joint)
    _require_known("contact", label, by_name)
    return by_name[label]


def reaction(observation: Observation, joint: str, body: str) -> Load:
    """Force and moment of an ideal joint on a body.

    **Raises:** `ValueError` that lists what there is.
    """
    _require_known("joint", joint, observation.reactions)
    _require_known("body", body, observation.reactions[joint])
    return observation.reactions[joint][body]


def acceleration_of(observation: Observation, body: str) -> np.ndarray:
    """Acceleration of a body's centre of mass, (N, 3) global, m/s^2.

    **Raises:** `ValueError` that lists what there is.
    """
    _require_known("body", body, observation.accelerations)
    return np.asarray(observation.accelerations[body].linear)


def centre_of(trajectory: Trajectory, body: str) -> np.ndarray:
    """A body's centre of mass, (N, 3) global, m.

    **Raises:** `ValueError` that lists what there is.
    """
    _require_known("body", body, trajectory.states.bodies)
    return np.asarray(trajectory.states.bodies[body].position)


def _require_known(argument: str, name: str, known: Collection[str]) -> None:
    expected = f"one of those observed, {sorted(known)}"
    require(name in known, argument, name, expected, "correct the name")
