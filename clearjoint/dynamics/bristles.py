"""Bristle deflections in the course of a run: initial values, rates, and resets.

A deflection is zero while the contact is open. If a contact began a time tau before the end of a
step, its bristles have been dragged for that time. Steps land on onsets, so tau is zero to
rounding, but its derivative is not: the deflection is set to slip times tau.
"""

import jax
import jax.numpy as jnp

from ..math.vectors import Scalar, Vector
from ..model.joints.base import Motions
from ..model.scene import Scene
from .contact_events import ContactGaps
from .contact_forces import Bristles
from .equations_of_motion import Dynamics


def initial_bristles(scene: Scene, given: Bristles) -> Bristles:
    """Return the given deflections, m, and zeros for the other contacts with bristle laws."""
    bristles = jax.tree.map(jnp.zeros_like, full_deflections(scene))
    return {name: {**family, **given.get(name, {})} for name, family in bristles.items()}


def bristle_rates(dynamics: Dynamics) -> Bristles:
    """Return the rates of the deflections, m/s, of the contacts with bristle laws."""
    rates = {
        name: {
            label: force.bristle_rate
            for label, force in family.items()
            if force.bristle_rate is not None
        }
        for name, family in dynamics.contact_forces.items()
    }
    return {name: family for name, family in rates.items() if family}


def full_deflections(scene: Scene) -> Bristles:
    """Return the deflection of each contact at full friction, m: the error scale of deflections,
    with the same PyTree structure as these."""
    return {
        name: {
            label: _constant(jnp.asarray(law.full_deflection(), float))
            for label, law in family.items()
        }
        for name, family in scene.bristle_laws().items()
    }


def updated_bristles(
    scene: Scene,
    bristles: Bristles,
    motions: Motions,
    before: ContactGaps,
    after: ContactGaps,
    lands: bool,
) -> Bristles:
    """Return the deflections after an accepted step, m.

    **Arguments:** `motions`: at the end of the step; `before`, `after`: contact gaps at its start
    and end; `lands`: whether steps land on onsets. If so, a contact that began in the step gets
    slip times the time since its onset.
    """
    joints = scene.contact_joints()
    updated: Bristles = {}
    for name, family in bristles.items():
        contacts, first = joints[name].contacts(motions), motions[joints[name].pair()[0]]
        updated[name] = {}
        for label, deflection in family.items():
            end = after[name][label]
            if lands:
                began = (before[name][label].depth <= 0.0) & (end.depth > 0.0) & (end.rate > 0.0)
                since = jnp.where(began, end.depth / jnp.where(began, end.rate, 1.0), 0.0)
                slip = contacts[label].slip
                assert slip is not None, "a contact with bristles has a slip"
                deflection = deflection + first.components(slip) * since
            updated[name][label] = Vector(
                *(jnp.where(end.depth > 0.0, part, 0.0) for part in deflection)
            )
    return updated


def _constant(value: Scalar) -> Vector:
    return Vector(value, value, value)
