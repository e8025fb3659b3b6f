"""The conformance check for joints with play of one's own."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
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
Contacts: TypeAlias = dict[str, tuple[LoadedContact, Scalar]]
"""Each contact with its forces, and the energy that it stores, J."""


class _Look(NamedTuple):
    """What is seen at several places: what may be wrong, and whether it is; the contacts' numbers,
    and their derivatives along a change."""

    wrong: ByLabel[Condition]
    rows: Rows
    slopes: Rows


def check_contact_joint(
    joint: AbstractContactJoint, motions: Mapping[str, Motion], together: bool = True
) -> None:
    """Check a joint with play at given motions, at the first touch of each contact and a micrometre
    deeper, with its points on both bodies together, and at all of them without velocity:

    - normals are unit vectors, and penetrations grow at their rates;
    - the forces on both bodies are equal and opposite on one line, or the couples are, and do the
      work that the rate of the penetration tells, which of the elastic force is that of the stored
      energy;
    - slip is tangential, and friction acts across the normal and against sliding;
    - derivatives by motion and numbers are finite, and those of the penetration by each number are
      what differences give;
    - `jax.vmap` gives what one lane does.

    **Arguments:** `motions` of the joint's bodies (`moving` makes them); that of the ground may be
    left out. Moving and turning ones, in flight by less than a centimetre, test most. `together`:
    whether the joint's points can meet, as the centres of two gears cannot.

    **Raises:** `AssertionError` that says what is wrong with which contact.

    >>> law = cj.laws.LankaraniNikravesh(0.9, cj.mechanisms.STEEL)
    >>> ball = cj.BallInSocket("ground", "arm", socket_radius=10e-3, clearance=1e-3, law=law)
    >>> still = testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> arm = testing.moving((1e-4, 0, 2e-4), (1, 0.1, 0.2, 0.3), (0.1, 0.2, 0.3), (3, 2, 1))
    >>> testing.check_contact_joint(ball, {"ground": still, "arm": arm})
    """
    joint = jax.tree.map(jnp.asarray, joint)
    motions = {GROUND: GROUND_MOTION, **motions}
    motions = {name: motions[name] for name in joint.body_names()}
    motions = jax.tree.map(lambda leaf: jnp.asarray(leaf, float), motions)
    _require_alike_names(joint, motions)
    numbers, rest = eqx.partition(joint, eqx.is_inexact_array)
    here, restored = ravel_pytree((numbers, motions))

    def joint_and_motions(point: jax.Array) -> tuple[AbstractContactJoint, Motions]:
        numbers, motions = restored(point)
        return eqx.combine(numbers, rest), motions

    @jax.jit
    @jax.vmap
    def look(point: jax.Array, change: jax.Array) -> _Look:
        found, rates = jax.jvp(
            lambda point: _contacts(*joint_and_motions(point)), (point,), (change,)
        )
        return _Look(_wrong(*joint_and_motions(point), found, rates), _rows(found), _rows(rates))

    places = _places(joint, motions, together)
    points = jnp.stack([ravel_pytree((numbers, place))[0] for place in places])
    still = jax.tree.map(jnp.zeros_like, numbers)
    along = jnp.stack([ravel_pytree((still, _velocities(place)))[0] for place in places])
    by_number = _changes_of_numbers(numbers, here)
    ahead, behind = (here + sign * STEP * by_number for sign in (1.0, -1.0))
    asked = (
        (points, along),
        (points, jnp.ones_like(points)),
        (jnp.broadcast_to(here, by_number.shape), by_number),
        (ahead, by_number),
        (behind, by_number),
    )
    seen = look(*(jnp.concatenate(parts) for parts in zip(*asked, strict=True)))
    ends = np.cumsum([len(part) for part, _ in asked])[:-1]
    for label, alone in _rows(_contacts(joint, motions)).items():
        for complaint, doubt in seen.wrong[label].items():
            _require(not doubt[: len(places)].any(), label, complaint)
        same = jnp.allclose(alone, seen.rows[label][0], rtol=TOLERANCE, atol=1e-12)
        _require(same, label, "its forces under vmap differ from those of one lane")
        rows, slopes = (jnp.split(of[label], ends) for of in (seen.rows, seen.slopes))
        _require_right_slopes(label, numbers, rows, slopes)


def _require_right_slopes(
    label: str, numbers: AbstractContactJoint, rows: list[jax.Array], slopes: list[jax.Array]
) -> None:
    """Check that derivatives along everything are finite, and those of the penetration by each of
    the joint's numbers what a step ahead and one behind give; in the order in which was asked."""
    _, everything, exact, _, _ = slopes
    finite = jnp.isfinite(everything).all()
    _require(finite, label, "a derivative of its forces is not finite everywhere")
    _, _, _, larger, smaller = rows
    numeric = (larger - smaller)[:, 0] / (2.0 * STEP)
    _require_slopes_by_numbers(label, numbers, exact[:, 0], numeric)


def _require(condition: Condition, label: str, complaint: str) -> None:
    if not bool(condition):
        raise AssertionError(f"Contact {label!r}: {complaint}.")


def _require_alike_names(joint: AbstractContactJoint, motions: Motions) -> None:
    laws, contacts = set(joint.laws()), set(unpack(joint).contacts(motions))
    if laws != contacts:
        raise AssertionError(f"laws() names {sorted(laws)}, contacts() {sorted(contacts)}.")


def _places(joint: AbstractContactJoint, motions: Motions, together: bool) -> list[Motions]:
    """The motions given, and those that are looked at beside."""
    moving, scalar = [motions], unpack(joint)
    for contact in scalar.contacts(motions).values():
        for depth in (0.0, PRESSED):
            moving.append(_shifted(joint, motions, contact.normal * (depth - contact.gap.depth)))
    points = {body: point for _, body, point in scalar.attachments()}
    first, second = joint.pair()
    if together and first in points and second in points:
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


def _contacts(joint: AbstractContactJoint, motions: Motions) -> Contacts:
    """The contacts with their forces and energies, J, of a joint whose numbers are arrays."""
    joint = unpack(joint)
    contacts, bristles = joint.contacts(motions), {}
    for label, bristle_law in joint.bristle_laws().items():
        bristles[label] = Vector(0.5 * bristle_law.full_deflection(), 0.0, 0.0)
    found = {}
    for label, law in joint.laws().items():
        contact, entry_speed = contacts[label], ENTRY_SPEED if law.uses_entry_speed else None
        loaded = contact_force(joint, label, law, contact, entry_speed, None, motions, bristles)
        found[label] = loaded, law.stored_energy(contact.gap)
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, float), found)


def _wrong(
    joint: AbstractContactJoint, motions: Motions, found: Contacts, rates: Contacts
) -> ByLabel[Condition]:
    """What may be wrong with each contact, and whether it is; `rates` are the contacts' along the
    motions."""
    first, second = (motions[name] for name in joint.pair())
    has_bristles, wrong = joint.bristle_laws(), {}
    for label, (loaded, _) in found.items():
        growing, power = rates[label]
        wrong[label] = _wrong_gap(loaded, growing.contact.gap.depth, power)
        wrong[label] |= _wrong_forces(loaded, first, second)
        if loaded.friction is not None and loaded.contact.slip is not None:
            wrong[label] |= _wrong_slip(loaded.contact, loaded.contact.slip, first, second)
            if label not in has_bristles:
                power = loaded.friction.dot(loaded.contact.slip)
                wrong[label]["friction drives the slip"] = power > TOLERANCE * loaded.normal_force
    return wrong


def _wrong_gap(loaded: LoadedContact, rate: Scalar, power: Scalar) -> Rows:
    """Of a contact whose penetration grows at a rate, m/s, and its energy at a power, W."""
    gap, normal = loaded.contact.gap, loaded.contact.normal
    size = normal.dot(normal)
    flies_centred = (size == 0.0) & (gap.depth < 0.0)
    return {
        "its normal is no unit vector": ~flies_centred & _differ(size, 1.0),
        "its penetration does not grow at the rate it tells": _differ(rate, gap.rate),
        "its stored energy does not grow by the work of the elastic force": _differ(
            power, loaded.elastic_force * gap.rate
        ),
    }


def _wrong_couples(
    contact: Contact, turning: tuple[Vector, Vector], first: Motion, second: Motion
) -> Rows:
    on_first, on_second = turning
    power = on_first.dot(first.spin) + on_second.dot(second.spin)
    return {
        "the couples on both bodies are not equal and opposite": (
            _vanishes_not(first.direction(on_first) + second.direction(on_second))
        ),
        "the couples do another work than the rate of the penetration tells": (
            _differ(power, contact.gap.rate)
        ),
    }


def _wrong_forces(loaded: LoadedContact, first: Motion, second: Motion) -> Rows:
    contact, friction = loaded.contact, loaded.friction
    if contact.turning is not None:
        return _wrong_couples(contact, contact.turning, first, second)
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


def _changes_of_numbers(numbers: AbstractContactJoint, here: jax.Array) -> jax.Array:
    """A change of each of the joint's numbers, of its size, in rows as long as what is looked at,
    of which they come first."""
    leaves = jax.tree.leaves(numbers)
    sizes = jnp.concatenate([jnp.full(leaf.size, jnp.max(jnp.abs(leaf))) for leaf in leaves])
    sizes = jnp.where(sizes > 0.0, sizes, 1.0)
    return jnp.eye(len(sizes), len(here)) * sizes[:, None]


def _require_slopes_by_numbers(
    label: str, numbers: AbstractContactJoint, exact: jax.Array, numeric: jax.Array
) -> None:
    """Check the derivatives of the penetration by each of the joint's numbers."""
    paths = jax.tree_util.tree_leaves_with_path(numbers)
    names = [jax.tree_util.keystr(path).lstrip(".") for path, leaf in paths for _ in leaf.ravel()]
    allowed = TOLERANCE_OF_DIFFERENCES * (1e-3 + jnp.abs(exact))
    for name, wrong in zip(names, _differ(exact, numeric, allowed), strict=True):
        told = f"the derivative of its penetration by `{name}` is not what differences give"
        _require(~wrong, label, told)


def _rows(found: Contacts) -> Rows:
    """Of each contact: its penetration, m; forces, N; its normal, and its points, m."""
    rows = {}
    for label, (loaded, _) in found.items():
        friction = ZERO if loaded.friction is None else loaded.friction
        contact = loaded.contact
        parts = [contact.gap.depth, loaded.normal_force, loaded.elastic_force]
        for vector in (friction, contact.normal, contact.arm_first, contact.arm_second):
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
