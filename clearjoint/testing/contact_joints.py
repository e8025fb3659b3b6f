"""Check user-defined joints with contacts."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree

from .._dynamics.contact_forces import LoadedContact, contact_force
from .._math.rotations import rotation_matrix, turned
from .._math.vectors import ZERO, Condition, EulerParameters, Matrix, Scalar, Vector, unpack
from .._model.bodies import GROUND, GROUND_MOTION, Motion
from .._model.contact.laws import require_instance
from .._model.joints.base import AbstractContactJoint, ByLabel, Motions, SideForce
from .conformance import ensure, motions_of
from .continuity import at_rest

TOLERANCE = 1e-9
"""Largest accepted error of an exact relation, relative to one plus the size of its terms."""
STEP = 1e-7
"""Step of finite differences, relative to the largest number in the field of the changed parameter,
or to `SCALE` if all are zero: far below the offset of a journal in its bearing, as of 1e-5 m."""
SCALE = 0.01
TOLERANCE_OF_DIFFERENCES = 1e-5
"""Largest accepted relative error of derivatives, far above the errors of finite differences."""
PENETRATION, ENTRY_SPEED = 1e-6, 0.1
"""Depth beyond the onset, m, and entry speed, m/s, of a tested contact."""
ROTATIONS = 4
"""Newton steps that rotate a body to a given penetration, with an error far below `PENETRATION`."""

Rows: TypeAlias = dict[str, jax.Array]
"""Numbers of each contact, as an array in the order of `_rows`, by the contact's label."""
Contacts: TypeAlias = dict[str, tuple[LoadedContact, Scalar]]
"""Contact with its forces, and its stored energy, by the contact's label."""


def check_contact_joint(
    joint: AbstractContactJoint, motions: Mapping[str, Motion], together: bool = True
) -> None:
    """Check that a joint with contacts is consistent.

    A contact has a penetration, and transmits either a force along its normal or a couple. The
    check demands that

    - the joint's methods `laws` and `contacts` name the same contacts;
    - normals are unit vectors, or zero without contact; the `rate` of each contact's gap is the
      time derivative of the penetration, and the rate of the gap's `factor`, if there is one, the
      time derivative of this factor;
    - the forces on the two bodies are equal and opposite, with a common line of action, or the
      couples on them are equal and opposite;
    - the power of the normal force, or of the couples, agrees with the penetration rate, and the
      power of the elastic force with the rate of the stored energy;
    - contacts with friction have a slip, which is the tangential velocity of the surfaces;
    - friction is perpendicular to the normal and, without bristles, opposes sliding;
    - derivatives by motions and parameters are finite, and the derivative of the penetration by
      each parameter of the joint agrees with finite differences.

    The joint is tested at the given motions; at the onset of each contact's force, and a micrometre
    deeper; with its attachment points on both bodies (of its method `attachments`) coincident; and
    at all these positions at rest. The second body is shifted to these positions, or rotated to
    those of a contact that transmits a couple; if it is the ground, the first is moved instead.

    **Arguments:** `motions`: with bodies less than a centimetre from contact; the ground may be
    omitted. `together`: whether the attachment points on both bodies can coincide, so that the
    joint is tested there too; ``False`` for the centres of gears.

    >>> law = cj.laws.LankaraniNikravesh(0.9, cj.mechanisms.STEEL)
    >>> ball = cj.BallInSocket("ground", "arm", socket_radius=10e-3, clearance=1e-3, law=law)
    >>> arm = testing.moving((1e-4, 0, 2e-4), (1, 0.1, 0.2, 0.3), (0.1, 0.2, 0.3), (3, 2, 1))
    >>> testing.check_contact_joint(ball, {"arm": arm})
    """
    require_instance("joint", joint, AbstractContactJoint)
    joint = jax.tree.map(jnp.asarray, joint)
    motions = motions_of(joint, {GROUND: GROUND_MOTION, **motions})
    motions = jax.tree.map(lambda leaf: jnp.asarray(leaf, float), motions)
    laws, contacts = set(joint.laws()), set(unpack(joint).contacts(motions))
    ensure(laws == contacts, f"laws() names {sorted(laws)}, contacts() {sorted(contacts)}.")
    # `given_point` is the vector of all parameters of the joint and all numbers of the motions.
    parameters, structure = eqx.partition(joint, eqx.is_inexact_array)
    given_point, restored = ravel_pytree((parameters, motions))

    def joint_and_motions(point: jax.Array) -> tuple[AbstractContactJoint, Motions]:
        # The inverse: the joint and the motions with the numbers of a vector.
        parameters, motions = restored(point)
        return eqx.combine(parameters, structure), motions

    @jax.jit
    @jax.vmap
    def evaluate(point: jax.Array, change: jax.Array) -> tuple[ByLabel[Condition], Rows, Rows]:
        # Failures of the contacts at a point, the numbers of the contacts, and the derivatives of
        # these numbers if the point changes at the rate `change`.
        contacts, rates = jax.jvp(
            lambda point: _contacts(*joint_and_motions(point)), (point,), (change,)
        )
        return _failures(*joint_and_motions(point), contacts, rates), _rows(contacts), _rows(rates)

    positions = _positions(joint, motions, together)
    points = jnp.stack([ravel_pytree((parameters, position))[0] for position in positions])
    zero = jax.tree.map(jnp.zeros_like, parameters)
    velocities = jnp.stack([ravel_pytree((zero, _velocities(p)))[0] for p in positions])
    failures, rows, _ = evaluate(points, velocities)  # the conditions are about rates in time
    # The derivative if all numbers change at once is not finite if one derivative is not.
    *_, slopes = evaluate(points, jnp.ones_like(points))
    for label, single in _rows(_contacts(joint, motions)).items():
        for message, failed in failures[label].items():
            _require(not failed.any(), label, message)
        # The first of the tested positions is the given one, as in the single evaluation.
        same = jnp.allclose(single, rows[label][0], rtol=TOLERANCE, atol=1e-12)
        _require(same, label, "its forces under vmap differ from a single evaluation")
        finite = jnp.isfinite(slopes[label]).all()
        _require(finite, label, "a derivative of its forces is not finite everywhere")
    _check_slopes(parameters, given_point, joint_and_motions)


def _check_slopes(
    parameters: AbstractContactJoint,
    point: jax.Array,
    joint_and_motions: Callable[[jax.Array], tuple[AbstractContactJoint, Motions]],
) -> None:
    """Check that the derivatives of the contacts' penetrations by each parameter of a joint agree
    with finite differences. `parameters`: the joint with only its arrays of floats, and ``None``
    for other leaves. `point`: vector of these parameters and all numbers of the motions, from which
    `joint_and_motions` makes joint and motions again."""
    leaves = jax.tree.leaves(parameters)
    sizes = jnp.concatenate([jnp.full(leaf.size, jnp.max(jnp.abs(leaf))) for leaf in leaves])
    # A row for each parameter: the change of the point in which it alone changes, by the largest
    # magnitude in its field, or by `SCALE` if all are zero there. All derivatives are thus in m.
    changes = jnp.eye(len(sizes), len(point)) * jnp.where(sizes > 0.0, sizes, SCALE)[:, None]

    def depths(point: jax.Array) -> Rows:  # the penetrations, m
        joint, motions = joint_and_motions(point)
        contacts = unpack(joint).contacts(motions)
        return {label: jnp.asarray(c.gap.depth, float) for label, c in contacts.items()}

    @jax.jit
    @jax.vmap
    def slopes(change: jax.Array) -> tuple[Rows, Rows]:
        # Derivatives of the penetrations along a change, by JAX and by central differences.
        _, exact = jax.jvp(depths, (point,), (change,))
        ahead, behind = (depths(point + sign * STEP * change) for sign in (1.0, -1.0))
        return exact, jax.tree.map(lambda a, b: (a - b) / (2.0 * STEP), ahead, behind)

    exact, numeric = slopes(changes)
    paths = jax.tree_util.tree_leaves_with_path(parameters)
    names = [jax.tree_util.keystr(path).lstrip(".") for path, leaf in paths for _ in leaf.ravel()]
    for label in exact:
        # The term of 1e-3 m allows for the rounding errors of lengths where a derivative is zero.
        allowed = TOLERANCE_OF_DIFFERENCES * (1e-3 + jnp.abs(exact[label]))
        for name, wrong in zip(names, _differ(exact[label], numeric[label], allowed), strict=True):
            text = f"the derivative of its penetration by `{name}` does not agree with differences"
            _require(~wrong, label, text)


def _require(condition: Condition, label: str, message: str) -> None:
    ensure(condition, f"Contact {label!r}: {message}.")


def _positions(joint: AbstractContactJoint, motions: Motions, together: bool) -> list[Motions]:
    """Return motions for the tests: the given ones; two for each contact, at its onset and
    `PENETRATION` deeper; if `together`, one with coincident attachment points; all also at rest."""
    moving, scalar = [motions], unpack(joint)
    # A shift of the second body along the normal increases the penetration by its length. A contact
    # with `turning` acts as a couple: its penetration depends on a rotation instead.
    for label, contact in scalar.contacts(motions).items():
        onset = -scalar.laws()[label].onset_offset()
        for depth in (onset, onset + PENETRATION):
            if contact.turning is None:
                shift = contact.normal * (depth - contact.gap.depth)
                moving.append(_shifted(joint, motions, shift))
            else:
                moving.append(_rotated(joint, motions, label, depth))
    points = {body: point for _, body, point in scalar.attachments()}
    first, second = joint.pair()
    if together and first in points and second in points:
        apart = motions[second].point(points[second]) - motions[first].point(points[first])
        moving.append(_shifted(joint, motions, -apart))
    positions = moving + list(map(at_rest, moving))
    return [jax.tree.map(lambda leaf: jnp.asarray(leaf, float), position) for position in positions]


def _shifted(joint: AbstractContactJoint, motions: Motions, shift: Vector) -> Motions:
    """Motions with the second body shifted by `shift`, m in global axes, relative to the first; if
    the second is the ground, the first is shifted by the opposite vector."""
    first, second = joint.pair()
    name, shift = (first, -shift) if second == GROUND else (second, shift)
    return {**motions, name: replace(motions[name], position=motions[name].position + shift)}


def _rotated(joint: AbstractContactJoint, motions: Motions, label: str, depth: Scalar) -> Motions:
    """Motions with the second body, or with the first if the second is the ground, rotated until
    the contact `label`, which transmits a couple, has the penetration `depth`, m."""
    first, second = joint.pair()
    name, k = (first, 0) if second == GROUND else (second, 1)
    for _ in range(ROTATIONS):
        contact = unpack(joint).contacts(motions)[label]
        assert contact.turning is not None
        # A rotation by a small vector, in body axes, increases the penetration by the scalar
        # product of this vector and `turning`.
        turning, motion = contact.turning[k], motions[name]
        angle = turning * ((depth - contact.gap.depth) / turning.dot(turning))
        further = rotation_matrix(turned(EulerParameters(1.0, 0.0, 0.0, 0.0), angle))
        motions = {**motions, name: replace(motion, rotation=motion.rotation @ further)}
    return motions


def _contacts(joint: AbstractContactJoint, motions: Motions) -> Contacts:
    """The contacts of a joint, with forces at the entry speed `ENTRY_SPEED`, and the stored energy
    of each; all numbers are arrays. Bristles have half of their full deflection."""
    joint = unpack(joint)
    contacts, bristles = joint.contacts(motions), {}
    for label, bristle_law in joint.bristle_laws().items():
        bristles[label] = Vector(0.5 * bristle_law.full_deflection(), 0.0, 0.0)
    loaded_contacts = {}
    # No contact is declared closed or open (``None``): its penetration decides.
    for label, law in joint.laws().items():
        contact, entry_speed = contacts[label], ENTRY_SPEED if law.uses_entry_speed else None
        loaded = contact_force(joint, label, law, contact, entry_speed, None, motions, bristles)
        loaded_contacts[label] = loaded, law.stored_energy(contact.gap)
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, float), loaded_contacts)


def _failures(
    joint: AbstractContactJoint, motions: Motions, contacts: Contacts, rates: Contacts
) -> ByLabel[Condition]:
    """Whether each condition on normals, rates, slips, forces, couples and power fails. `contacts`:
    each contact with its stored energy, from `_contacts`; `rates`: their time derivatives."""
    first, second = pair = [motions[name] for name in joint.pair()]
    failures = {}
    for label, (loaded, _) in contacts.items():
        contact, gap, normal = loaded.contact, loaded.contact.gap, loaded.contact.normal
        rate, energy_rate = rates[label][0].contact.gap.depth, rates[label][1]
        size = normal.dot(normal)
        # In the middle of a bearing, the eccentricity has no direction: the normal may be zero.
        flies_centred = (size == 0.0) & (gap.depth < 0.0)
        elastic_power = loaded.elastic_force * gap.rate
        if contact.side is not None:
            # At constant penetration, the stored energy changes by the work of the elastic force
            # beside the normal force.
            elastic_power = elastic_power - contact.side.elastic.dot(_beside(contact.side, *pair))
        failed = {
            "its normal is not a unit vector": ~flies_centred & _differ(size, 1.0),
            "its `rate` is not the time derivative of its penetration": _differ(rate, gap.rate),
        }
        message = "the rate of its stored energy is not the power of the elastic force"
        failed[message] = _differ(energy_rate, elastic_power)
        factor_rate = rates[label][0].contact.gap.factor
        if gap.factor is not None and factor_rate is not None:
            message = "the rate of its factor is not the time derivative of the factor"
            failed[message] = _differ(factor_rate.value, gap.factor.rate)
        if contact.turning is None:
            failed |= _force_failures(loaded, first, second)
        else:
            # The vectors in `turning`, m in body axes, are the derivatives of the penetration rate
            # by the spins, and the couples are minus the normal force times these vectors.
            on_first, on_second = contact.turning
            remainder = first.direction(on_first) + second.direction(on_second)
            power = on_first.dot(first.spin) + on_second.dot(second.spin)
            failed["the couples on both bodies are not equal and opposite"] = _is_nonzero(remainder)
            message = "the power of the couples does not agree with the rate of the penetration"
            failed[message] = _differ(power, gap.rate)
        if loaded.friction is not None and contact.slip is not None:
            across = second.velocity_at(contact.arm_second) - first.velocity_at(contact.arm_first)
            sliding = across - normal * across.dot(normal)
            message = "its slip is not the tangential velocity of the surfaces"
            if contact.face_radius is not None:
                # The slip of flat faces also has their relative spin about the normal, times their
                # mean radius, as a component along the normal.
                spin = second.direction(second.spin) - first.direction(first.spin)
                sliding = sliding + normal * (spin.dot(normal) * contact.face_radius)
            failed[message] = _is_nonzero(contact.slip - sliding)
            # Bristles store energy, so that their friction may drive the slip for a while.
            if label not in joint.bristle_laws():
                driven = loaded.friction.dot(contact.slip) > TOLERANCE * loaded.normal_force
                failed["friction drives the slip"] = jnp.asarray(driven)
        failures[label] = failed
    return failures


def _beside(side: SideForce, first: Motion, second: Motion) -> Vector:
    """Global velocity of the second body relative to the first, m/s, where a `SideForce` acts."""
    return second.velocity_at(side.arm_second) - first.velocity_at(side.arm_first)


def _force_failures(loaded: LoadedContact, first: Motion, second: Motion) -> dict[str, jax.Array]:
    """Return whether each condition on normal force and friction fails, by the text of the failure,
    for a contact that transmits no couple."""
    contact, friction, force = loaded.contact, loaded.friction, loaded.normal_force
    # Friction acts at the contact points. For a contact without friction, the joint may give other
    # points on the normal force's line of action.
    on_first, on_second = contact.points_of_force(friction is not None)
    # The line of action is common to both bodies if the points of the force are on a line along the
    # force. The relative velocity along the normal is the rate of the penetration. A contact with a
    # `SideForce` has another part of the rate, due to an angle of the joint.
    apart = second.point(on_second) - first.point(on_first)
    velocity = second.velocity_at(on_second) - first.velocity_at(on_first)
    rate, side = velocity.dot(contact.normal), contact.side
    if side is not None:
        rate = rate + side.slope.dot(_beside(side, first, second))
    message = "the forces on both bodies leave a moment: they do not act on one line"
    failures = {message: _is_nonzero(apart.cross(contact.normal))}
    message = "the power of the normal force does not agree with the rate of the penetration"
    failures[message] = _differ(rate, contact.gap.rate)
    if side is not None:
        between = second.point(side.arm_second) - first.point(side.arm_first)
        message = "the forces beside the normal force do not act at one point"
        failures[message] = _is_nonzero(between)
    if friction is not None:
        # The energy ledger would omit the power of the friction.
        failures["it has friction, but its slip is None"] = jnp.asarray(contact.slip is None)
        message = "friction on both bodies leaves a moment: it does not act at one point"
        failures[message] = _is_nonzero(apart.cross(friction), force)
        along = friction.dot(contact.normal)
        message = "friction has a component along the normal"
        failures[message] = _differ(along, 0.0, TOLERANCE * (1.0 + force))
    return failures


def _rows(contacts: Contacts) -> Rows:
    """Numbers (15,) of each contact: penetration, normal force and elastic force; then vectors:
    friction and normal in global axes, and the arms from the bodies' centres of mass to the contact
    point in body axes."""
    rows = {}
    for label, (loaded, _) in contacts.items():
        friction = ZERO if loaded.friction is None else loaded.friction
        contact = loaded.contact
        numbers = contact.gap.depth, loaded.normal_force, loaded.elastic_force
        vectors = *friction, *contact.normal, *contact.arm_first, *contact.arm_second
        rows[label] = jnp.stack([jnp.asarray(part, float) for part in (*numbers, *vectors)])
    return rows


def _velocities(motions: Motions) -> Motions:
    """Time derivatives of all numbers in motions, at constant velocities and spins, as motions."""
    rates = {}
    for name, motion in motions.items():
        rows = motion.rotation.row_x, motion.rotation.row_y, motion.rotation.row_z
        # The derivative of a rotation matrix is this matrix times the cross-product matrix of the
        # spin.
        turning = Matrix(*(row.cross(motion.spin) for row in rows))
        rates[name] = Motion(motion.velocity, turning, motion.velocity * 0.0, motion.spin * 0.0)
    return rates


def _differ(first: Scalar, second: Scalar, allowed: Scalar = TOLERANCE) -> jax.Array:
    """Whether two numbers differ by more than `allowed` times (1 + |second|), or are not finite."""
    return ~(jnp.abs(first - second) <= allowed * (1.0 + jnp.abs(second)))


def _is_nonzero(vector: Vector, size: Scalar = 0.0) -> jax.Array:
    """Whether a vector exceeds the rounding errors of terms as large as `size`, or isn't finite."""
    allowed = TOLERANCE * (1.0 + size)
    return ~(jnp.asarray(vector.dot(vector)) <= allowed * allowed)
