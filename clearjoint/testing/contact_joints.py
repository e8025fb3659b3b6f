"""Check user-defined joints with contacts."""

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
from .conformance import ensure

TOLERANCE = 1e-9
"""Largest accepted error of exact relations, relative to one plus the size of their terms."""
STEP, TOLERANCE_OF_DIFFERENCES = 1e-6, 1e-5
"""Step of finite differences relative to the changed number, and largest accepted relative error of
derivatives."""
PENETRATION, ENTRY_SPEED = 1e-6, 0.1
"""Penetration, m, and entry speed, m/s, of a tested contact."""

Rows: TypeAlias = dict[str, jax.Array]
"""Array of numbers of each contact, by the contact's label."""
Contacts: TypeAlias = dict[str, tuple[LoadedContact, Scalar]]
"""Contact with its forces, and its stored energy in J, by the contact's label."""


class _Evaluation(NamedTuple):
    """Result at one point, a vector of the joint's parameters and the motions.

    - `failures`: for each contact, whether a condition fails, by message.
    - `rows`: numbers of each contact, see `_rows`.
    - `slopes`: derivatives of `rows` along a change of the point.
    """

    failures: ByLabel[Condition]
    rows: Rows
    slopes: Rows


def check_contact_joint(
    joint: AbstractContactJoint, motions: Mapping[str, Motion], together: bool = True
) -> None:
    """Check that a joint with contacts is consistent.

    The check demands that

    - normals are unit vectors, and the rate of each gap is the time derivative of its penetration;
    - the forces on both bodies are equal and opposite on one line, or equal and opposite couples;
    - the power of the normal force agrees with the penetration rate, and the power of the elastic
      force with the rate of the stored energy;
    - the slip is the tangential velocity of the surfaces, and friction is perpendicular to the
      normal and opposes sliding;
    - derivatives by motions and parameters are finite, and the derivative of the penetration by
      each parameter of the joint agrees with finite differences;
    - `jax.vmap` gives the same result as a single evaluation.

    The joint is tested at the given motions, at the onset of each contact, a micrometre deeper,
    with its attachment points coincident, and at all these positions at rest.

    **Arguments:**

    - `joint`: the joint.
    - `motions`: motion of each body of the joint, from `moving`, by the body's name; the ground may
      be omitted. Translating and rotating bodies, less than a centimetre from contact, make the
      strictest test.
    - `together`: whether the attachment points on both bodies can coincide, so that the joint is
      tested there too; ``False`` for the centres of gears.

    **Raises:** `AssertionError` that states the contact and the first problem.

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
    _check_names(joint, motions)
    numbers, rest = eqx.partition(joint, eqx.is_inexact_array)
    given, restored = ravel_pytree((numbers, motions))

    def joint_and_motions(point: jax.Array) -> tuple[AbstractContactJoint, Motions]:
        numbers, motions = restored(point)
        return eqx.combine(numbers, rest), motions

    @jax.jit
    @jax.vmap
    def evaluate(point: jax.Array, change: jax.Array) -> _Evaluation:
        contacts, rates = jax.jvp(
            lambda point: _contacts(*joint_and_motions(point)), (point,), (change,)
        )
        failures = _failures(*joint_and_motions(point), contacts, rates)
        return _Evaluation(failures, _rows(contacts), _rows(rates))

    # A point is a vector of all parameters and motions. All evaluations share one compiled call:
    # derivatives along the motion, along all numbers at once, and along each parameter with the
    # evaluations for its central difference.
    positions = _positions(joint, motions, together)
    points = jnp.stack([ravel_pytree((numbers, position))[0] for position in positions])
    zero = jax.tree.map(jnp.zeros_like, numbers)
    velocities = jnp.stack([ravel_pytree((zero, _velocities(p)))[0] for p in positions])
    by_number = _changes_of_numbers(numbers, given)
    ahead, behind = (given + sign * STEP * by_number for sign in (1.0, -1.0))
    requests = (
        (points, velocities),
        (points, jnp.ones_like(points)),
        (jnp.broadcast_to(given, by_number.shape), by_number),
        (ahead, by_number),
        (behind, by_number),
    )
    results = evaluate(*(jnp.concatenate(parts) for parts in zip(*requests, strict=True)))
    ends = np.cumsum([len(part) for part, _ in requests])[:-1]
    for label, single in _rows(_contacts(joint, motions)).items():
        for message, failed in results.failures[label].items():
            _require(not failed[: len(positions)].any(), label, message)
        same = jnp.allclose(single, results.rows[label][0], rtol=TOLERANCE, atol=1e-12)
        _require(same, label, "its forces under vmap differ from a single evaluation")
        rows, slopes = (jnp.split(of[label], ends) for of in (results.rows, results.slopes))
        _check_slopes(label, numbers, rows, slopes)


def _check_slopes(
    label: str, numbers: AbstractContactJoint, rows: list[jax.Array], slopes: list[jax.Array]
) -> None:
    """Check that derivatives are finite, and agree with differences for each parameter.

    `rows` and `slopes` are in the order of the requests.
    """
    _, everything, exact, _, _ = slopes
    finite = jnp.isfinite(everything).all()
    _require(finite, label, "a derivative of its forces is not finite everywhere")
    _, _, _, larger, smaller = rows
    exact, numeric = exact[:, 0], (larger - smaller)[:, 0] / (2.0 * STEP)
    paths = jax.tree_util.tree_leaves_with_path(numbers)
    names = [jax.tree_util.keystr(path).lstrip(".") for path, leaf in paths for _ in leaf.ravel()]
    allowed = TOLERANCE_OF_DIFFERENCES * (1e-3 + jnp.abs(exact))
    for name, wrong in zip(names, _differ(exact, numeric, allowed), strict=True):
        message = f"the derivative of its penetration by `{name}` does not agree with differences"
        _require(~wrong, label, message)


def _require(condition: Condition, label: str, message: str) -> None:
    ensure(condition, f"Contact {label!r}: {message}.")


def _check_names(joint: AbstractContactJoint, motions: Motions) -> None:
    laws, contacts = set(joint.laws()), set(unpack(joint).contacts(motions))
    ensure(laws == contacts, f"laws() names {sorted(laws)}, contacts() {sorted(contacts)}.")


def _positions(joint: AbstractContactJoint, motions: Motions, together: bool) -> list[Motions]:
    """Return the motions at which the joint is tested: the given ones, those with the second body
    shifted to the onset of each contact, 1 µm deeper, and to coincident attachment points if
    `together`, and all of these again at rest."""
    moving, scalar = [motions], unpack(joint)
    for contact in scalar.contacts(motions).values():
        for depth in (0.0, PENETRATION):
            moving.append(_shifted(joint, motions, contact.normal * (depth - contact.gap.depth)))
    points = {body: point for _, body, point in scalar.attachments()}
    first, second = joint.pair()
    if together and first in points and second in points:
        apart = motions[second].point(points[second]) - motions[first].point(points[first])
        moving.append(_shifted(joint, motions, -apart))
    resting = [
        {name: replace(motion, velocity=ZERO, spin=ZERO) for name, motion in position.items()}
        for position in moving
    ]
    return [jax.tree.map(lambda leaf: jnp.asarray(leaf, float), p) for p in moving + resting]


def _shifted(joint: AbstractContactJoint, motions: Motions, shift: Vector) -> Motions:
    """Return the motions with the second body shifted relative to the first by `shift`, m in
    global axes; if the second body is the ground, the first one is shifted back instead."""
    first, second = joint.pair()
    name, shift = (first, -shift) if second == GROUND else (second, shift)
    moved = replace(motions[name], position=motions[name].position + shift)
    return {**motions, name: moved}


def _contacts(joint: AbstractContactJoint, motions: Motions) -> Contacts:
    """Return the contacts with forces and energies of a joint whose numbers are arrays."""
    joint = unpack(joint)
    contacts, bristles = joint.contacts(motions), {}
    for label, bristle_law in joint.bristle_laws().items():
        bristles[label] = Vector(0.5 * bristle_law.full_deflection(), 0.0, 0.0)
    loaded_contacts = {}
    for label, law in joint.laws().items():
        contact, entry_speed = contacts[label], ENTRY_SPEED if law.uses_entry_speed else None
        loaded = contact_force(joint, label, law, contact, entry_speed, None, motions, bristles)
        loaded_contacts[label] = loaded, law.stored_energy(contact.gap)
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, float), loaded_contacts)


def _failures(
    joint: AbstractContactJoint, motions: Motions, contacts: Contacts, rates: Contacts
) -> ByLabel[Condition]:
    """Return for each contact whether each condition fails, by the condition's message.

    **Arguments:** `rates`: time derivatives of `contacts`.
    """
    first, second = (motions[name] for name in joint.pair())
    has_bristles, failures = joint.bristle_laws(), {}
    for label, (loaded, _) in contacts.items():
        rate, power = rates[label]
        failures[label] = _gap_failures(loaded, rate.contact.gap.depth, power)
        failures[label] |= _force_failures(loaded, first, second)
        if loaded.friction is not None and loaded.contact.slip is not None:
            failures[label] |= _slip_failures(loaded.contact, loaded.contact.slip, first, second)
            if label not in has_bristles:
                power = loaded.friction.dot(loaded.contact.slip)
                driven = power > TOLERANCE * loaded.normal_force
                failures[label]["friction drives the slip"] = driven
    return failures


def _gap_failures(loaded: LoadedContact, rate: Scalar, power: Scalar) -> Rows:
    """Return failures of the normal, of the penetration rate and of the stored energy of a contact.

    **Arguments:** `rate`: time derivative of the penetration, m/s; `power`: of the stored energy,
    W.
    """
    gap, normal = loaded.contact.gap, loaded.contact.normal
    size = normal.dot(normal)
    flies_centred = (size == 0.0) & (gap.depth < 0.0)
    return {
        "its normal is not a unit vector": ~flies_centred & _differ(size, 1.0),
        "its `rate` is not the time derivative of its penetration": _differ(rate, gap.rate),
        "the rate of its stored energy is not the power of the elastic force": _differ(
            power, loaded.elastic_force * gap.rate
        ),
    }


def _couple_failures(
    contact: Contact, turning: tuple[Vector, Vector], first: Motion, second: Motion
) -> Rows:
    on_first, on_second = turning
    power = on_first.dot(first.spin) + on_second.dot(second.spin)
    return {
        "the couples on both bodies are not equal and opposite": (
            _is_nonzero(first.direction(on_first) + second.direction(on_second))
        ),
        "the power of the couples does not agree with the rate of the penetration": (
            _differ(power, contact.gap.rate)
        ),
    }


def _force_failures(loaded: LoadedContact, first: Motion, second: Motion) -> Rows:
    contact, friction = loaded.contact, loaded.friction
    if contact.turning is not None:
        return _couple_failures(contact, contact.turning, first, second)
    on_first, on_second = contact.points_of_force(friction is not None)
    apart = second.point(on_second) - first.point(on_first)
    velocity = second.velocity_at(on_second) - first.velocity_at(on_first)
    force = loaded.normal_force
    failures = {
        "the forces on both bodies leave a moment: they do not act on one line": (
            _is_nonzero(apart.cross(contact.normal))
        ),
        "the power of the normal force does not agree with the rate of the penetration": (
            _differ(velocity.dot(contact.normal), contact.gap.rate)
        ),
    }
    if friction is None:
        return failures
    return failures | {
        "friction on both bodies leaves a moment: it does not act at one point": (
            _is_nonzero(apart.cross(friction), force)
        ),
        "friction has a component along the normal": (
            _differ(friction.dot(contact.normal), 0.0, TOLERANCE * (1.0 + force))
        ),
    }


def _slip_failures(contact: Contact, slip: Vector, first: Motion, second: Motion) -> Rows:
    velocity = second.velocity_at(contact.arm_second) - first.velocity_at(contact.arm_first)
    sliding = velocity - contact.normal * velocity.dot(contact.normal)
    return {"its slip is not the tangential velocity of the surfaces": _is_nonzero(slip - sliding)}


def _changes_of_numbers(numbers: AbstractContactJoint, point: jax.Array) -> jax.Array:
    """Return a change of each parameter of the joint, of its magnitude, as rows like `point`.

    The parameters are the first elements of a point.
    """
    leaves = jax.tree.leaves(numbers)
    sizes = jnp.concatenate([jnp.full(leaf.size, jnp.max(jnp.abs(leaf))) for leaf in leaves])
    sizes = jnp.where(sizes > 0.0, sizes, 1.0)
    return jnp.eye(len(sizes), len(point)) * sizes[:, None]


def _rows(contacts: Contacts) -> Rows:
    """Return an array (15,) for each contact: penetration, m; normal force and elastic force, N;
    friction, N; normal; and arms of the contact on the first and the second body, m."""
    rows = {}
    for label, (loaded, _) in contacts.items():
        friction = ZERO if loaded.friction is None else loaded.friction
        contact = loaded.contact
        parts = [contact.gap.depth, loaded.normal_force, loaded.elastic_force]
        for vector in (friction, contact.normal, contact.arm_first, contact.arm_second):
            parts.extend(vector)
        rows[label] = jnp.stack([jnp.asarray(part, float) for part in parts])
    return rows


def _velocities(motions: Motions) -> Motions:
    """Return the time derivatives of the motions at constant velocities and spins."""
    return {
        name: Motion(motion.velocity, _rates(motion), motion.velocity * 0.0, motion.spin * 0.0)
        for name, motion in motions.items()
    }


def _rates(motion: Motion) -> Matrix:
    """Return the time derivative of the rotation matrix A, 1/s: A times the cross-product matrix of
    the spin in body axes."""
    rotation, spin = motion.rotation, motion.spin
    return Matrix(*(row.cross(spin) for row in (rotation.row_x, rotation.row_y, rotation.row_z)))


def _differ(first: Scalar, second: Scalar, allowed: Scalar = TOLERANCE) -> jax.Array:
    """Return whether `first` and `second` differ by more than `allowed` times (1 + |second|), or
    are not finite."""
    return ~(jnp.abs(first - second) <= allowed * (1.0 + jnp.abs(second)))


def _is_nonzero(vector: Vector, size: Scalar = 0.0) -> jax.Array:
    """Return whether the length of a vector exceeds the tolerance times (1 + `size`), where `size`
    is that of the terms of which the vector is the sum."""
    allowed = TOLERANCE * (1.0 + size)
    return ~(jnp.asarray(vector.dot(vector)) <= allowed * allowed)
