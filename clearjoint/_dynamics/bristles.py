"""Bristle deflections during a run: initial values, rates, and corrections after steps."""

import jax
import jax.numpy as jnp

from .._fields.checks import require
from .._math.vectors import Vector
from .._model.contact.friction import AbstractBristleFriction
from .._model.joints.base import Motions
from .._model.scene import Scene
from .contact_events import ContactGaps
from .contact_forces import Bristles
from .equations_of_motion import Dynamics


def initial_bristles(scene: Scene, given: Bristles) -> Bristles:
    """Return the deflection of each contact with a bristle law, m: from `given`, or else zero."""
    bristles = jax.tree.map(jnp.zeros_like, full_deflections(scene))
    for name, family in bristles.items():
        for label in given.get(name, {}):
            expected, remedy = f"one of {[*family]}", "correct the label of the contact"
            require(label in family, f"state.bristles[{name!r}]", label, expected, remedy)
    return {name: {**family, **given.get(name, {})} for name, family in bristles.items()}


def bristle_rates(dynamics: Dynamics) -> Bristles:
    """Return the rates of all bristle deflections, m/s, from the solved equations of motion."""
    rates: Bristles = {}
    for name, family in dynamics.contact_forces.items():
        for label, force in family.items():
            if force.bristle_rate is not None:
                rates.setdefault(name, {})[label] = force.bristle_rate
    return rates


def full_deflections(scene: Scene) -> Bristles:
    """Return the scale of each contact's deflection: a vector whose three components all are the
    magnitude of the deflection in steady sliding, m."""

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
    """Return the bristle deflections, m, after an accepted step, from the integrated `bristles` and
    the `motions` at the step's end, and the gaps `before` and `after` the step.

    The deflection becomes zero in an open contact. If steps end at onsets (`lands`), a contact that
    began in the step has had no force yet: the slip velocity times the time since the onset is
    added, which is zero except for rounding, but has derivatives that enter those of the motion.
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
            kept = (jnp.where(end.depth > 0.0, part, 0.0) for part in deflection)
            updated[name][label] = Vector(*kept)
    return updated
