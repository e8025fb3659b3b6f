"""The conformance check for joints with play of one's own."""

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree

from ..dynamics.contact_forces import LoadedContact, contact_force
from ..math.vectors import ZERO, Condition, Matrix, Scalar, Vector, unpack
from ..model.bodies import GROUND, GROUND_MOTION, Motion
from ..model.joints.base import AbstractContactJoint, ByLabel, Contact, Motions

TOLERANCE = 1e-9
"""Of what holds exactly, as a part of what it is made of; lengths in m count as at least one."""
STEP, TOLERANCE_OF_DIFFERENCES = 1e-6, 1e-5
"""Of a difference, as a part of the number; and of the derivative."""
PRESSED, ENTRY_SPEED = 1e-6, 0.1
"""Penetration, m, and entry speed, m/s, of a contact that is looked at."""

Rows: TypeAlias = dict[str, jax.Array]
"""Numbers of each contact in a row."""


def check_contact_joint(joint: AbstractContactJoint, motions: Mapping[str, Motion]) -> None:
    """Check a joint with play at given motions, at the first touch of each contact and a micrometre
    deeper, with its points on both bodies together, and at all of them without velocity:

    - normals are unit vectors, and penetrations grow at their rates;
    - the forces on both bodies are equal and opposite on one line, and do the work that the rate of
      the penetration tells, which of the elastic force is that of the stored energy;
    - slip is tangential, and friction acts across the normal and against sliding;
    - derivatives by motion and numbers are finite, and those of the penetration by each number are
      what differences give;
    - `jax.vmap` gives what one lane does.

    **Arguments:** `motions` of the joint's bodies (`moving` makes them); that of the ground may be
    left out. Moving and turning ones, in flight by less than a centimetre, test most.

    **Raises:** `AssertionError` that says what is wrong with which contact.
    """
    joint = jax.tree.map(jnp.asarray, joint)
    motions = {GROUND: GROUND_MOTION, **motions}
    motions = {name: motions[name] for name in joint.body_names()}
    motions = jax.tree.map(lambda leaf: jnp.asarray(leaf, float), motions)
    _require_alike_names(joint, motions)
    places = jax.tree.map(lambda *leaves: jnp.stack(leaves), *_places(joint, motions))
    numbers, rest = eqx.partition(joint, eqx.is_inexact_array)

    @jax.jit
    def look(places: Motions) -> tuple[ByLabel[Condition], Rows, Rows]:
        def at(motions: Motions) -> tuple[ByLabel[Condition], Rows, Rows]:
            return _wrong(joint, motions), *_rows_and_slopes(numbers, rest, motions)

        return jax.vmap(at)(places)

    doubts, together, slopes = look(places)
    for label, alone in _rows(joint, motions).items():
        for complaint, doubt in doubts[label].items():
            _require(not doubt.any(), label, complaint)
        finite = jnp.isfinite(slopes[label]).all()
        _require(finite, label, "a derivative of its forces is not finite everywhere")
        same = jnp.allclose(alone, together[label][0], rtol=TOLERANCE, atol=1e-12)
        _require(same, label, "its forces under vmap differ from those of one lane")
    _require_slopes_by_numbers(joint, motions)


def _require(condition: Condition, label: str, complaint: str) -> None:
    if not bool(condition):
        raise AssertionError(f"Contact {label!r}: {complaint}.")


def _require_alike_names(joint: AbstractContactJoint, motions: Motions) -> None:
    laws, contacts = set(joint.laws()), set(unpack(joint).contacts(motions))
    if laws != contacts:
        raise AssertionError(f"laws() names {sorted(laws)}, contacts() {sorted(contacts)}.")


def _places(joint: AbstractContactJoint, motions: Motions) -> list[Motions]:
    """The motions given, and those that are looked at beside."""
    moving, scalar = [motions], unpack(joint)
    for contact in scalar.contacts(motions).values():
        for depth in (0.0, PRESSED):
            moving.append(_shifted(joint, motions, contact.normal * (depth - contact.gap.depth)))
    points = {body: point for _, body, point in scalar.attachments()}
    first, second = joint.pair()
    if first in points and second in points:
        apart = motions[second].point(points[second]) - motions[first].point(points[first])
        moving.append(_shifted(joint, motions, -apart))
    resting = [
        {name: replace(motion, velocity=ZERO, spin=ZERO) for name, motion in place.items()}
        for place in moving
    ]
    return [jax.tree.map(lambda leaf: jnp.asarray(leaf, float), p) for p in moving + resting]


def _shifted(joint: AbstractContactJoint, motions: Motions, shift: Vector) -> Motions:
    """The motions with the second body shifted against the first, m, global."""
    first, second = joint.pair()
    name, shift = (first, -shift) if second == GROUND else (second, shift)
    moved = replace(motions[name], position=motions[name].position + shift)
    return {**motions, name: moved}


def _loaded(joint: AbstractContactJoint, motions: Motions) -> dict[str, LoadedContact]:
    """The contacts with their forces, of a joint whose numbers are arrays."""
    joint = unpack(joint)
    contacts, bristles = joint.contacts(motions), {}
    for label, bristle_law in joint.bristle_laws().items():
        bristles[label] = Vector(0.5 * bristle_law.full_deflection(), 0.0, 0.0)
    loaded = {}
    for label, law in joint.laws().items():
        entry_speed = ENTRY_SPEED if law.has_memory else None
        given = joint, label, law, contacts[label], entry_speed, None, motions, bristles
        loaded[label] = contact_force(*given)
    return loaded


def _wrong(joint: AbstractContactJoint, motions: Motions) -> ByLabel[Condition]:
    """What may be wrong with each contact, and whether it is."""
    first, second = (motions[name] for name in joint.pair())
    has_bristles = joint.bristle_laws()
    wrong = _wrong_gaps(joint, motions)
    for label, loaded in _loaded(joint, motions).items():
        wrong[label] |= _wrong_forces(loaded, first, second)
        if loaded.friction is not None and loaded.contact.slip is not None:
            wrong[label] |= _wrong_slip(loaded.contact, loaded.contact.slip, first, second)
            if label not in has_bristles:
                power = loaded.friction.dot(loaded.contact.slip)
                wrong[label]["friction drives the slip"] = power > TOLERANCE * loaded.normal_force
    return wrong


def _wrong_gaps(joint: AbstractContactJoint, motions: Motions) -> ByLabel[Condition]:
    def gaps(motions: Motions) -> dict[str, tuple[Scalar, Scalar]]:
        scalar = unpack(joint)
        laws = scalar.laws()
        return {
            label: (contact.gap.depth, laws[label].stored_energy(contact.gap))
            for label, contact in scalar.contacts(motions).items()
        }

    wrong, loaded = {}, _loaded(joint, motions)
    depths, rates = jax.jvp(gaps, (motions,), (_velocities(motions),))
    for label, (rate, power) in rates.items():
        told, normal = loaded[label].contact.gap.rate, loaded[label].contact.normal
        size = normal.dot(normal)
        flies_centred = (size == 0.0) & (depths[label][0] < 0.0)
        wrong[label] = {
            "its normal is no unit vector": ~flies_centred & _differ(size, 1.0),
            "its penetration does not grow at the rate it tells": _differ(rate, told),
            "its stored energy does not grow by the work of the elastic force": _differ(
                power, loaded[label].elastic_force * told
            ),
        }
    return wrong


def _wrong_forces(loaded: LoadedContact, first: Motion, second: Motion) -> Rows:
    contact, friction = loaded.contact, loaded.friction
    here, there = contact.points_of_force(friction is not None)
    apart = second.point(there) - first.point(here)
    moving = second.velocity_at(there) - first.velocity_at(here)
    force = loaded.normal_force
    wrong = {
        "the forces on both bodies leave a moment: they do not act on one line": (
            _vanishes_not(apart.cross(contact.normal))
        ),
        "the normal force does another work than the rate of the penetration tells": (
            _differ(moving.dot(contact.normal), contact.gap.rate)
        ),
    }
    if friction is None:
        return wrong
    return wrong | {
        "friction on both bodies leaves a moment: it does not act at one point": (
            _vanishes_not(apart.cross(friction), force)
        ),
        "friction has a part along the normal": (
            _differ(friction.dot(contact.normal), 0.0, TOLERANCE * (1.0 + force))
        ),
    }


def _wrong_slip(contact: Contact, slip: Vector, first: Motion, second: Motion) -> Rows:
    moving = second.velocity_at(contact.arm_second) - first.velocity_at(contact.arm_first)
    sliding = moving - contact.normal * moving.dot(contact.normal)
    return {
        "its slip is not the tangential velocity of the surfaces": _vanishes_not(slip - sliding)
    }


def _rows_and_slopes(
    numbers: AbstractContactJoint, rest: AbstractContactJoint, motions: Motions
) -> tuple[Rows, Rows]:
    """Forces and points of each contact, and their derivatives along a change of all numbers and
    motions: one that is not finite spoils their sum."""

    def rows(numbers: AbstractContactJoint, motions: Motions) -> Rows:
        return _rows(eqx.combine(numbers, rest), motions)

    changes = jax.tree.map(lambda leaf: leaf * 0.0 + 1.0, (numbers, motions))
    return jax.jvp(rows, (numbers, motions), changes)


def _require_slopes_by_numbers(joint: AbstractContactJoint, motions: Motions) -> None:
    numbers, rest = eqx.partition(joint, eqx.is_inexact_array)
    flat, restored = ravel_pytree(numbers)
    paths = jax.tree_util.tree_leaves_with_path(numbers)
    names = [jax.tree_util.keystr(path).lstrip(".") for path, leaf in paths for _ in leaf.ravel()]
    sizes = [jnp.full(leaf.size, jnp.max(jnp.abs(leaf))) for _, leaf in paths]
    sizes = jnp.where(jnp.concatenate(sizes) > 0.0, jnp.concatenate(sizes), 1.0)

    def depths(flat: jax.Array) -> dict[str, Scalar]:
        contacts = unpack(eqx.combine(restored(flat), rest)).contacts(motions)
        return {label: contact.gap.depth for label, contact in contacts.items()}

    @jax.jit
    def slopes(flat: jax.Array) -> tuple[Rows, Rows]:
        changes = jnp.diag(sizes)
        exact = jax.vmap(lambda change: jax.jvp(depths, (flat,), (change,))[1])(changes)
        ahead, behind = (jax.vmap(depths)(flat + sign * STEP * changes) for sign in (1.0, -1.0))
        return exact, jax.tree.map(lambda a, b: (a - b) / (2.0 * STEP), ahead, behind)

    exact, numeric = slopes(flat)
    for label, slope in exact.items():
        allowed = TOLERANCE_OF_DIFFERENCES * (1e-3 + jnp.abs(slope))
        for name, wrong in zip(names, _differ(slope, numeric[label], allowed), strict=True):
            complaint = (
                f"the derivative of its penetration by `{name}` is not what differences give"
            )
            _require(~wrong, label, complaint)


def _rows(joint: AbstractContactJoint, motions: Motions) -> Rows:
    """Forces of each contact, N, its normal and its points, m, in a row."""
    rows = {}
    for label, loaded in _loaded(joint, motions).items():
        friction = ZERO if loaded.friction is None else loaded.friction
        points = loaded.contact.points_of_force(loaded.friction is not None)
        parts = [loaded.normal_force, loaded.elastic_force]
        for vector in (friction, loaded.contact.normal, *points):
            parts.extend(vector)
        rows[label] = jnp.stack([jnp.asarray(part, float) for part in parts])
    return rows


def _velocities(motions: Motions) -> Motions:
    """The rates of positions and rotations at constant velocities and spins."""
    return {
        name: Motion(motion.velocity, _turning(motion), motion.velocity * 0.0, motion.spin * 0.0)
        for name, motion in motions.items()
    }


def _turning(motion: Motion) -> Matrix:
    """A' = A ~spin."""
    rotation, spin = motion.rotation, motion.spin
    return Matrix(*(row.cross(spin) for row in (rotation.row_x, rotation.row_y, rotation.row_z)))


def _differ(first: Scalar, second: Scalar, allowed: Scalar = TOLERANCE) -> jax.Array:
    """Whether two numbers differ by more than is allowed of them; no number differs from all."""
    return ~(jnp.abs(first - second) <= allowed * (1.0 + jnp.abs(second)))


def _vanishes_not(vector: Vector, size: Scalar = 0.0) -> jax.Array:
    """Whether a vector, made of some of a size, differs from zero."""
    allowed = TOLERANCE * (1.0 + size)
    return ~(jnp.asarray(vector.dot(vector)) <= allowed * allowed)
