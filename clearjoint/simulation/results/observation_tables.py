"""Conversion of an `Observation` to a dataset with dimensions, labels and units."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...export.labelled import COMPONENT, COMPONENTS, Labelled, labelled_dataset, texts
from .motion_modes import MotionMode
from .state_tables import CONTACTS, contact_label

if TYPE_CHECKING:
    import xarray as xr

CONTACT_PARTS = {
    "penetration": ("m", "penetration, negative in flight"),
    "penetration_rate": ("m/s", "rate of the penetration"),
    "eccentricity": ("m", "distance of the base's centre from the bearing's axis"),
    "offset": ("m", "the base's centre in the bearing's frame"),
    "normal_force": ("N", "normal force"),
    "friction_force": ("N", "friction force on the journal, global"),
    "normal": ("1", "direction from bearing axis to contact, global"),
    "point_on_bearing": ("m", "contact point on the bearing, global"),
    "point_on_journal": ("m", "contact point on the journal, global"),
}
"""Unit and meaning of each field of a `ContactObservation`."""
BODY_PARTS = {
    "acceleration": ("linear", "m/s^2", "of the centre of mass, global"),
    "angular_acceleration": ("angular", "rad/s^2", "of the body, body axes"),
}
REACTION_PARTS = {
    "reaction_force": ("force", "N", "force of an ideal joint on a body, global"),
    "reaction_moment": ("moment", "N m", "its moment about the centre of mass, body axes"),
}
ROWS = ("time",)


@dataclass(frozen=True)
class Observed:
    """The fields of an `Observation`, which this module cannot import."""

    times: np.ndarray
    contacts: Mapping[str, Mapping[str, object]]
    modes: Mapping[str, np.ndarray]
    reactions: Mapping[str, Mapping[str, object]]
    accelerations: Mapping[str, object]
    drift: Mapping[str, np.ndarray]
    drift_rate: Mapping[str, np.ndarray]
    energies: Mapping[str, np.ndarray]
    reactions_unique: bool


def observation_dataset(observed: Observed) -> "xr.Dataset":
    """Return an observation as the dataset that `Observation.to_xarray` describes."""
    contacts = _flat(observed.contacts, contact_label)
    reactions = _flat(observed.reactions, lambda joint, body: f"{joint} on {body}")
    unique = "unique" if observed.reactions_unique else "of least norm, since joints are redundant"
    variables = {
        **_contacts(contacts),
        **_modes(observed.modes),
        **_vectors(reactions, "reaction", REACTION_PARTS, {"comment": unique}),
        **_vectors(observed.accelerations, "body", BODY_PARTS, {}),
        **_numbers("drift", "joint", observed.drift, "1", "largest |Phi| of the joint, m or 1"),
        **_numbers(
            "drift_rate", "joint", observed.drift_rate, "1/s", "largest |rate of Phi| of the joint"
        ),
        **_numbers("energy", "energy_term", observed.energies, "J", "energies and their ledger"),
    }
    labels = {
        CONTACTS: contacts,
        "journal": observed.modes,
        "reaction": reactions,
        "body": observed.accelerations,
        "joint": observed.drift,
        "energy_term": observed.energies,
        COMPONENT: COMPONENTS,
    }
    # Without contacts or reactions, say, their dimensions have no variable and get no labels.
    used = {dim for variable in variables.values() for dim in variable.dims}
    coordinates = {d: Labelled((d,), texts([*own])) for d, own in labels.items() if d in used}
    times = {"time": Labelled(ROWS, observed.times, "s", "time")}
    return labelled_dataset("observation of a motion", variables, {**times, **coordinates})


def _flat(
    tables: Mapping[str, Mapping[str, object]], label: Callable[[str, str], str]
) -> dict[str, object]:
    return {label(a, b): one for a, family in tables.items() for b, one in family.items()}


def _contacts(contacts: Mapping[str, object]) -> dict[str, Labelled]:
    """Return an array for each field that any contact has, NaN for contacts that lack the field.

    **Arguments:** `contacts`: a `ContactObservation` by contact label, such as "pin V".

    **Returns:** arrays (time, contact), or (time, contact, component) for vectors, by field.
    """
    found = {}
    for part, (unit, text) in CONTACT_PARTS.items():
        values = [getattr(contact, part) for contact in contacts.values()]
        known = [np.asarray(value) for value in values if value is not None]
        if known:
            lacking = np.full_like(known[0], np.nan)
            filled = [lacking if value is None else np.asarray(value) for value in values]
            dims = (*ROWS, CONTACTS, COMPONENT)[: 1 + known[0].ndim]
            found[part] = Labelled(dims, np.stack(filled, 1), unit, text)
    return found


def _modes(modes: Mapping[str, np.ndarray]) -> dict[str, Labelled]:
    if not modes:
        return {}
    codes = np.stack([np.asarray(row) for row in modes.values()], 1).astype(np.int8)
    flags = {
        "flag_values": np.array([mode.value for mode in MotionMode], np.int8),
        "flag_meanings": " ".join(mode.name.lower() for mode in MotionMode),
    }
    return {"mode": Labelled((*ROWS, "journal"), codes, None, "mode of the journal", flags)}


def _vectors(
    elements: Mapping[str, object],
    dim: str,
    parts: Mapping[str, tuple[str, str, str]],
    attributes: Mapping[str, object],
) -> dict[str, Labelled]:
    if not elements:
        return {}
    dims = (*ROWS, dim, COMPONENT)
    return {
        name: Labelled(
            dims,
            np.stack([np.asarray(getattr(one, field)) for one in elements.values()], 1),
            unit,
            text,
            attributes,
        )
        for name, (field, unit, text) in parts.items()
    }


def _numbers(
    name: str, dim: str, rows: Mapping[str, np.ndarray], unit: str, text: str
) -> dict[str, Labelled]:
    if not rows:
        return {}
    values = np.stack([np.asarray(row) for row in rows.values()], 1)
    return {name: Labelled((*ROWS, dim), values, unit, text)}
