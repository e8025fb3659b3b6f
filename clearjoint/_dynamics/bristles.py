"""Bristle deflections in the course of a run: initial values, rates, and corrections after each
step.

Bristles are a model of friction that can stick: the surfaces of a contact deflect against each
other like bristles, and the friction depends on this deflection, a vector in m in the axes of the
joint's first body, which is integrated with the motion. The deflection is zero while the contact is
open, that is, without a force.

If steps end at the onsets of contacts, no force and no deflection is computed between an onset and
the end of the step, a time tau later. The bristles have been dragged for this time, and get the
deflection slip velocity times tau. Here tau is zero except for rounding, but its derivative is not,
and derivatives of the motion need it. If steps do not end at onsets, force and deflection are
computed from the onset on, and no such correction is made.

Values by joint and contact label are nested dictionaries, ``values[joint][contact]``; in the code,
`family` is the inner dictionary of one joint.
"""

import jax
import jax.numpy as jnp

from .._math.vectors import Vector
from .._model.contact.friction import AbstractBristleFriction
from .._model.joints.base import Motions
from .._model.scene import Scene
from .contact_events import ContactGaps
from .contact_forces import Bristles
from .equations_of_motion import Dynamics


def initial_bristles(scene: Scene, given: Bristles) -> Bristles:
    """Return a deflection, m, for each contact with a bristle law, by joint and contact label: the
    one in `given` if there is one, otherwise zero."""
    bristles = jax.tree.map(jnp.zeros_like, full_deflections(scene))
    return {name: {**family, **given.get(name, {})} for name, family in bristles.items()}


def bristle_rates(dynamics: Dynamics) -> Bristles:
    """Return the rates of all bristle deflections, m/s, by joint and contact label, from the solved
    equations of motion."""
    rates: Bristles = {}
    for name, family in dynamics.contact_forces.items():
        for label, force in family.items():
            if force.bristle_rate is not None:
                rates.setdefault(name, {})[label] = force.bristle_rate
    return rates


def full_deflections(scene: Scene) -> Bristles:
    """Return the approximate deflection in steady sliding, m, of each contact with bristles, by
    joint and contact label.

    Error control of steps uses it as the scale of the deflections. Each result is a vector with
    this value in x, y and z.
    """

    def sizes(law: AbstractBristleFriction) -> Vector:
        return Vector(*(jnp.asarray(law.full_deflection(), float),) * 3)

    laws = scene.bristle_laws()
    return {name: {k: sizes(law) for k, law in family.items()} for name, family in laws.items()}


def updated_bristles(
    scene: Scene,
    bristles: Bristles,
    motions: Motions,
    before: ContactGaps,
    after: ContactGaps,
    lands: bool,
) -> Bristles:
    """Return the bristle deflections after an accepted step, m, in the axes of the joint's first
    body, by joint and contact label.

    An open contact gets zero. If steps end at onsets, a contact that began in the step and whose
    penetration still grows gets its displacement since the onset added: slip velocity times the
    time since the onset, which is depth over rate. Any other contact keeps its deflection.

    **Arguments:**

    - `bristles`: deflections as integrated over the step, m.
    - `motions`: pose and velocities of each body at the end of the step.
    - `before`, `after`: contact gaps at the start and at the end of the step.
    - `lands`: whether steps end at onsets.
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
                # The inner `where` keeps the derivative of the unused alternative finite.
                since = jnp.where(began, end.depth / jnp.where(began, end.rate, 1.0), 0.0)
                slip = contacts[label].slip
                assert slip is not None, "a contact with bristles has a slip"
                # Slip is in global axes, deflections are in those of the joint's first body.
                deflection = deflection + first.components(slip) * since
            # Bristles of an open contact spring back; the next contact starts with relaxed ones.
            updated[name][label] = Vector(
                *(jnp.where(end.depth > 0.0, part, 0.0) for part in deflection)
            )
    return updated
