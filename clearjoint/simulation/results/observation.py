"""Observation of a motion: contacts, reactions, accelerations, drift and energies at given times.

`observe` in `.observe` computes an `Observation` from the solution of a run.
"""

import enum
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np
from jax.core import Tracer

from ...export.labelled import COMPONENT, COMPONENTS, Labelled, labelled_dataset, texts
from ...export.tabular import AbstractTabular
from ...fields.checks import as_shown
from ..step.types import Integers, Numbers, Vectors
from .state_tables import CONTACTS, by_contact

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
"""Unit and description of each field of a `ContactObservation`."""
BODY_PARTS = {
    "acceleration": ("linear", "m/s^2", "of the centre of mass, global"),
    "angular_acceleration": ("angular", "rad/s^2", "of the body, body axes"),
}
"""Variables of the dataset for bodies: field of `AccelerationSeries`, unit and description."""
REACTION_PARTS = {
    "reaction_force": ("force", "N", "force of an ideal joint on a body, global"),
    "reaction_moment": ("moment", "N m", "its moment about the centre of mass, body axes"),
}
"""Variables of the dataset for reactions: field of `Load`, unit and description."""


class MotionMode(enum.IntEnum):
    """Mode of motion of a journal: which of its two end circles (bases) touch the bearing's wall.

    - `FREE_FLIGHT`: neither base touches the wall.
    - `ONE_BASE`: one base touches the wall.
    - `LINE_CONTACT`: both bases touch the wall on the same side of the bearing.
    - `OPPOSITE_SIDES`: both bases touch the wall, on opposite sides, so the journal is tilted.

    >>> cj.results.MotionMode(2).name
    'LINE_CONTACT'
    """

    FREE_FLIGHT = 0
    ONE_BASE = 1
    LINE_CONTACT = 2
    OPPOSITE_SIDES = 3


class ContactObservation(eqx.Module):
    """One contact of a clearance joint at N times.

    The joint connects a bearing on its first body and a journal on its second body. In other
    joints, such as a pin in a slot, these words stand for the surfaces of the first and the second
    body. The bases of a journal are its end circles, each of which is a contact. Equation numbers
    are those of Flores et al. 2006.

    - `penetration`: (N,) m, depth of overlap, negative where the surfaces are apart (eq. 13).
    - `penetration_rate`: (N,) m/s, positive while the surfaces approach (eq. 21).
    - `eccentricity`: (N,) m, distance of the base's centre from the bearing's axis (eq. 11);
      ``None`` for contacts that are not bases of a journal or points between them.
    - `offset`: (N, 3) m, the base's centre in the frame of the bearing: two components across the
      bearing's axis, then the one along it; ``None`` where `eccentricity` is.
    - `normal_force`: (N,) N, magnitude.
    - `friction_force`: (N, 3) N, on the journal, in global axes; ``None`` without a friction law.
    - `normal`: (N, 3), unit vector in global axes, the direction in which the second body
      penetrates the first; for a base of a journal, from the bearing's axis to the contact.
    - `point_on_bearing`, `point_on_journal`: (N, 3) m, the nearest points of the two surfaces, in
      global coordinates.
    """

    penetration: Numbers
    penetration_rate: Numbers
    eccentricity: Numbers | None
    offset: Vectors | None
    normal_force: Numbers
    friction_force: Vectors | None
    normal: Vectors
    point_on_bearing: Vectors
    point_on_journal: Vectors


class Load(eqx.Module):
    """Reaction of an ideal joint on one of its bodies at N times.

    - `force`: (N, 3) N, in global axes.
    - `moment`: (N, 3) N m, about the body's centre of mass, in body axes.
    """

    force: Vectors
    moment: Vectors


class AccelerationSeries(eqx.Module):
    """Acceleration of a body at N times.

    - `linear`: (N, 3) m/s^2, of the centre of mass, in global axes.
    - `angular`: (N, 3) rad/s^2, time derivative of the angular velocity, in body axes.
    """

    linear: Vectors
    angular: Vectors


class Observation(eqx.Module, AbstractTabular):
    """Contacts, reactions, accelerations, constraint drift and energies of a motion at N times.

    The keys of the dictionaries are names of joints, bodies and energies, and labels of contacts,
    such as "V".

    - `times`: (N,) s.
    - `contacts[joint][contact]`: a `ContactObservation`.
    - `modes[joint]`: (N,) values of `MotionMode`, for each joint that has a journal.
    - `reactions[joint][body]`: the `Load` of an ideal joint on a body (Flores et al. 2006, eq. 31).
    - `reactions_unique`: whether the reactions are unique. They are not if some constraints are
      redundant; those of least norm are then given.
    - `accelerations[body]`: an `AccelerationSeries`.
    - `drift[joint]`: (N,), the largest magnitude of the joint's constraint equations, which are
      zero for an exact solution; in m, or without unit for equations between directions.
    - `drift_rate[joint]`: (N,), the largest magnitude of the time derivatives of these equations,
      in the same unit per s.
    - `energies[name]`: (N,) J. "kinetic", "gravity", "springs", "contacts" and "bristles" exist
      where the scene has them, and "mechanical" is their sum. If the run integrated the energy
      ledger (`Settings(ledger=True)`), there are also its integrals since the start: the dissipated
      energies "normal damping", "friction", "film" and "stabilisation", and the energy "supplied"
      by drives and loads.
      "friction" does not contain the energy stored in bristles.

    `to_xarray`, `to_dataframe`, `to_csv` and `to_netcdf` export all fields with their units.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> solution = cj.simulate(scene, state, 0.02, save=cj.Saving(np.linspace(0, 0.02, 201)))
    >>> observed = cj.observe(scene, solution)
    >>> list(observed.energies)
    ['contacts', 'gravity', 'kinetic', 'mechanical']
    """

    times: Numbers
    contacts: dict[str, dict[str, ContactObservation]]
    modes: dict[str, Integers]
    reactions: dict[str, dict[str, Load]]
    accelerations: dict[str, AccelerationSeries]
    drift: dict[str, Numbers]
    drift_rate: dict[str, Numbers]
    energies: dict[str, Numbers]
    reactions_unique: bool = eqx.field(static=True)

    def __repr__(self) -> str:
        """Return text with the number of times, the first and the last time, and the names of
        joints, bodies and energies; the fields as equinox shows them if times are unknown, as while
        JAX traces, or if there are none."""
        if np.ndim(self.times) != 1 or isinstance(self.times, Tracer) or not len(self.times):
            return eqx.tree_pformat(self)
        first, last = as_shown(np.asarray(self.times)[[0, -1]])
        lines = [f"Observation at {len(self.times)} instants from {first} s to {last} s"]
        for name in ("contacts", "reactions", "accelerations", "drift", "energies"):
            if part := getattr(self, name):
                lines.append(f"{name}: {', '.join(map(repr, part))}")
        return "\n  ".join(lines)

    def to_xarray(self) -> "xr.Dataset":
        """Return the observation as an `xarray.Dataset` with units.

        All variables have the dimension "time", and vectors have "component" ("x", "y", "z") last.
        The second dimension is

        - "contact", with labels such as "pin V", for `penetration`, `normal_force` and the other
          fields of `ContactObservation`. A contact without such a field has NaN there;
        - "journal" for `mode` (values of `MotionMode`), and "joint" for `drift` and `drift_rate`;
        - "reaction", with labels such as "hinge on arm", for `reaction_force`, `reaction_moment`;
        - "body" for `acceleration` and `angular_acceleration`;
        - "energy_term" for `energy`.

        Variables of elements that the scene lacks are left out. The attribute "comment" of the
        reactions says whether they are unique.

        See `AbstractTabular` for the export to other formats.
        """
        # Dictionaries of joints and contacts, or joints and bodies, become one dimension of labels.
        contacts = by_contact(self.contacts)
        reactions = {
            f"{joint} on {body}": load
            for joint, by_body in self.reactions.items()
            for body, load in by_body.items()
        }
        unique = "unique" if self.reactions_unique else "of least norm, since joints are redundant"
        modes = [np.asarray(mode, np.int8) for mode in self.modes.values()]
        flags = {
            "flag_values": np.array([mode.value for mode in MotionMode], np.int8),
            "flag_meanings": " ".join(mode.name.lower() for mode in MotionMode),
        }
        # For each variable: its second dimension, the series along it, unit, description and
        # further attributes.
        rows: dict[str, tuple[Any, ...]] = {
            name: (CONTACTS, [getattr(one, name) for one in contacts.values()], *texts_of)
            for name, texts_of in CONTACT_PARTS.items()
        }
        rows["mode"] = "journal", modes, None, "mode of the journal", flags
        for name, (field, *of_load) in REACTION_PARTS.items():
            loads = [getattr(load, field) for load in reactions.values()]
            rows[name] = "reaction", loads, *of_load, {"comment": unique}
        for name, (field, *of_body) in BODY_PARTS.items():
            rows[name] = "body", [getattr(b, field) for b in self.accelerations.values()], *of_body
        for name, dim, values, unit, text in (
            ("drift", "joint", self.drift, "1", "largest |Phi| of the joint, m or 1"),
            ("drift_rate", "joint", self.drift_rate, "1/s", "largest |rate of Phi| of the joint"),
            ("energy", "energy_term", self.energies, "J", "energies and their ledger"),
        ):
            rows[name] = dim, [*values.values()], unit, text
        # A variable is left out if the scene has no element with such a series.
        variables = {
            name: _stacked(*row)
            for name, row in rows.items()
            if any(series is not None for series in row[1])
        }
        labels = {
            CONTACTS: contacts,
            "journal": self.modes,
            "reaction": reactions,
            "body": self.accelerations,
            "joint": self.drift,
            "energy_term": self.energies,
            COMPONENT: COMPONENTS,
        }
        # A scene without contacts, for example, has no variable along "contact", and needs no
        # labels for it.
        used = {dim for variable in variables.values() for dim in variable.dims}
        coordinates = {d: Labelled((d,), texts([*own])) for d, own in labels.items() if d in used}
        times = {"time": Labelled(("time",), self.times, "s", "time")}
        return labelled_dataset("observation of a motion", variables, {**times, **coordinates})

    def ledger_residual(self) -> Numbers:
        """Return the energy that the ledger does not explain, (N,) J, a measure of the run's error.

        It is the mechanical plus the dissipated less the supplied energy, less the value of this
        sum at the first time. It is zero for an exact solution of a run with the ledger. Without
        the ledger, it is the change of the mechanical energy.
        """
        losses = ("normal damping", "friction", "film", "stabilisation")
        dissipated = sum(self.energies.get(name, 0.0) for name in losses)
        balance = self.energies["mechanical"] + dissipated - self.energies.get("supplied", 0.0)
        return balance - balance[0]


def _stacked(
    dim: str,
    series: Sequence[Numbers | Vectors | None],
    unit: str | None,
    text: str,
    attributes: Mapping[str, object] = {},
) -> Labelled:
    """Return series at N times as a variable (N, series), or (N, series, 3) for vectors, with NaN
    in place of a series that is ``None``.

    **Arguments:** `dim`: name of the second dimension; `series`: one for each element along it, not
    all ``None``; `unit`, `text`, `attributes`: unit, description and further attributes.
    """
    known = next(np.asarray(one) for one in series if one is not None)
    lacking = np.full(known.shape, np.nan)
    values = np.stack([lacking if one is None else np.asarray(one) for one in series], 1)
    return Labelled(("time", dim, COMPONENT)[: values.ndim], values, unit, text, attributes)
