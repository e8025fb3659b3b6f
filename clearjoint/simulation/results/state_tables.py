"""Conversion of states to labelled arrays, the variables of an `xarray.Dataset`."""

from collections.abc import Mapping
from typing import TypeVar

import numpy as np

from ...export.labelled import COMPONENT, COMPONENTS, Labelled, texts
from ...model.bodies import State

T = TypeVar("T")
STATE_PARTS = {
    "position": ("component", "m"),
    "orientation": ("parameter", "1"),
    "velocity": ("component", "m/s"),
    "spin": ("component", "rad/s"),
}
"""Last dimension and unit of the array for each field of a `BodyState`."""
LABELS = {COMPONENT: [*COMPONENTS], "parameter": ["e0", "e1", "e2", "e3"]}
"""Labels along the last dimension of a body's vectors and of its Euler parameters."""
MEANINGS = {
    "position": "position of the centre of mass, global",
    "orientation": "Euler parameters, scalar first, body to global",
    "velocity": "velocity of the centre of mass, global",
    "spin": "angular velocity in body axes",
}
CONTACTS = "contact"
BRISTLES = "bristle_contact"
"""Names of the dimensions along which contacts, and contacts with bristles, are listed."""


def contact_label(joint: str, contact: str) -> str:
    """Return the label of a contact in tables: "joint contact", such as "pin V"."""
    return f"{joint} {contact}"


def by_contact(tables: Mapping[str, Mapping[str, T]]) -> dict[str, T]:
    """Return the entries tables[joint][contact] in one dictionary by `contact_label`."""
    return {
        contact_label(joint, contact): entry
        for joint, entries in tables.items()
        for contact, entry in entries.items()
    }


def state_arrays(states: State, rows: tuple[str, ...], prefix: str = "") -> dict[str, Labelled]:
    """Return states as arrays with dimensions and units, by name of variable.

    The variables are "position" in m, "orientation" (Euler parameters), "velocity" in m/s and
    "spin" in rad/s of the bodies. If the states have them, there are also "entry_speed" in m/s and
    "bristle_deflection" in m of the contacts, and "ledger" in J, the integrals of the energy
    ledger.

    **Arguments:** `states`: one state, or a state whose arrays have additional first dimensions;
    `rows`: names of these dimensions, such as ("time",), empty for one state; `prefix`: text in
    front of each variable's name.

    **Returns:** arrays with the dimensions `rows` and then, for example, "body" and "component".
    """
    # Arrays of single bodies or contacts are stacked along a new dimension, before that of the
    # components of vectors.
    arrays = {}
    for part, (dim, unit) in STATE_PARTS.items():
        values = [np.asarray(getattr(body, part)) for body in states.bodies.values()]
        dims = (*rows, "body", dim)
        arrays[prefix + part] = Labelled(dims, np.stack(values, -2), unit, MEANINGS[part])
    if entry_speeds := by_contact(states.entry_speeds):
        values = np.stack([*entry_speeds.values()], -1)
        text = "speed at which the contact closed; zero in flight"
        arrays[f"{prefix}entry_speed"] = Labelled((*rows, CONTACTS), values, "m/s", text)
    if bristles := by_contact(states.bristles):
        text = "deflection of the bristles, in the axes of the joint's first body"
        dims = (*rows, BRISTLES, COMPONENT)
        values = np.stack([*bristles.values()], -2)
        arrays[f"{prefix}bristle_deflection"] = Labelled(dims, values, "m", text)
    if states.work:
        text = "integrals of the energy ledger; friction includes the elastic energy of bristles"
        values = np.stack([np.asarray(one) for one in states.work.values()], -1)
        arrays[f"{prefix}ledger"] = Labelled((*rows, "integral"), values, "J", text)
    return arrays


def state_labels(states: State) -> dict[str, Labelled]:
    """Return the labels along each dimension of the arrays of `state_arrays`, by name of the
    dimension: names of bodies, labels of contacts, "x", "y", "z" and so on. A dimension without
    labels, such as that of contacts in a scene without contacts, is left out."""
    labels = {"body": [*states.bodies], **LABELS}
    labels[CONTACTS] = [*by_contact(states.entry_speeds)]
    labels[BRISTLES] = [*by_contact(states.bristles)]
    labels["integral"] = [*states.work]
    return {name: Labelled((name,), texts(own)) for name, own in labels.items() if own}
