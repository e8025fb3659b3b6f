"""Forces of all contacts at one instant (normal force, its elastic part, friction), and the rates
of bristles' deflections, which follow from the same slip velocity as the friction."""

import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import reduce
from typing import TypeAlias

import jax.numpy as jnp

from .._fields.checks import EPSILON, require
from .._math.vectors import ZERO, Condition, Scalar, Vector, add
from .._model.bodies import GROUND, Wrench
from .._model.contact.friction import AbstractBristleFriction
from .._model.contact.laws import UNKNOWN_ENTRY_SPEED, AbstractContactLaw, Gap, contact_normal_force
from .._model.forces import TorsionalSpring
from .._model.joints.base import AbstractContactJoint, ByLabel, Contact, Motions
from .._model.joints.joint_friction import JointFriction
from .._model.scene import Scene
from .._model.tree_dataclass import tree_dataclass
from .kinds import Kinds

EntrySpeeds: TypeAlias = ByLabel[Scalar]
"""Penetration rate at the onset, m/s, of contacts whose laws use it; zero for open contacts."""
Closed: TypeAlias = ByLabel[Condition]
"""Whether each contact is closed: has a force."""
Bristles: TypeAlias = ByLabel[Vector]
"""Deflection of the bristles of each contact that has some, m, in the axes of the joint's first
body; zero while the contact is open. Rates of deflections, m/s, have the same form."""
NO_BRISTLES: Bristles = {}
INSIDE = 1e-300
"""Depth, m, that `depth_at_wall` returns for a law whose force begins where the surfaces touch: too
small to change the force, but positive, since such a law may have no force yet at zero."""


@tree_dataclass
class LoadedContact:
    """A contact with its forces.

    - `normal_force`: N, including damping, positive if it pushes the bodies apart.
    - `elastic_force`: N, the part of the normal force without damping.
    - `friction`: tangential force on the second body, N, in global axes; ``None`` without friction.
    - `bristle_rate`: rate of the bristles' deflection, m/s in the first body's axes, or ``None``.
    - `friction_moment`: on the second body about the normal, N m; ``None`` except for friction
      between two flat faces, whose contact has a `face_radius`, the mean radius of the faces, m.
    """

    contact: Contact
    normal_force: Scalar
    elastic_force: Scalar
    friction: Vector | None
    bristle_rate: Vector | None = None
    friction_moment: Scalar | None = None


LoadedContacts: TypeAlias = ByLabel[LoadedContact]


def contact_forces(
    scene: Scene,
    motions: Motions,
    entry_speeds: EntrySpeeds,
    closed: Closed | None = None,
    bristles: Bristles = NO_BRISTLES,
) -> LoadedContacts:
    """Return the forces of all contacts.

    `closed` says whether each contact has a force, whatever its depth (see `contact_force`); if
    ``None``, the contacts that penetrate have a force. For an entry speed of zero, a law takes the
    present penetration rate if `closed` is ``None``; if `closed` is given, the contact is elastic,
    like one that exists at the start of a run.
    """
    kinds, joints = Kinds(scene), scene.contact_joints()

    def forces_of(name: str, joint: AbstractContactJoint) -> dict[str, LoadedContact]:
        are_closed = None if closed is None else closed[name]
        state_of_contacts = entry_speeds.get(name, {}), are_closed, bristles.get(name, {})
        # If there are many joints of a kind, they share one trace of the function.
        return dict(kinds.evaluate(_forces_of_joint, joint, motions, *state_of_contacts))

    # Joints whose surfaces another element presses come last, since the force of this element is
    # the load on the surfaces.
    pressed = {n: j for n, j in joints.items() if isinstance(j, JointFriction) and j.pressed_by}
    forces = {n: forces_of(n, joint) for n, joint in joints.items() if n not in pressed}
    for name, joint in pressed.items():
        force = _pressing_force(scene, motions, forces, joint.pressed_by or "")
        forces[name] = forces_of(name, joint.pressed_with(force))
    return {name: forces[name] for name in joints}  # in the scene's order


def _pressing_force(scene: Scene, motions: Motions, forces: LoadedContacts, name: str) -> Scalar:
    """Return the force, N, or torque, N m, with which the joint or spring `name` presses the
    surfaces of a `JointFriction`: without damping, which may jump where flanks touch."""
    if name in forces:
        return reduce(add, (contact.elastic_force for contact in forces[name].values()))
    spring = scene.forces[name]
    assert isinstance(spring, TorsionalSpring)
    return jnp.abs(spring.torque_at(spring.relative_angle(motions).value, 0.0, 0.0))


def _forces_of_joint(
    joint: AbstractContactJoint,
    motions: Motions,
    entry_speeds: Mapping[str, Scalar],
    closed: Mapping[str, Condition] | None,
    bristles: Mapping[str, Vector],
) -> list[tuple[str, LoadedContact]]:
    laws, forces = joint.laws(), []
    for label, contact in joint.contacts(motions).items():
        entry_speed = entry_speeds[label] if laws[label].uses_entry_speed else None
        is_closed = None if closed is None else closed[label]
        if is_closed is not None and entry_speed is not None:
            # A zero entry speed means that the contact existed before the start. The law would take
            # the present penetration rate instead, which differs between the stages of a step, and
            # so would the force. Inside of a step the contact is therefore made elastic.
            entry_speed = jnp.where(entry_speed > 0.0, entry_speed, UNKNOWN_ENTRY_SPEED)
        loaded = contact_force(
            joint, label, laws[label], contact, entry_speed, is_closed, motions, bristles
        )
        forces.append((label, loaded))
    return forces


def contact_wrenches(
    joint: AbstractContactJoint, force: LoadedContact, motions: Motions
) -> Iterator[tuple[str, Wrench]]:
    """Yield name and wrench of each body, except the ground, on which a contact of a joint acts;
    two wrenches for each body if there is a friction moment. A contact that acts as a couple (see
    `Contact.turning`) has no friction; for the friction of an ideal hinge or ball (see
    `Contact.lever`), the normal force is not applied: it only determines the friction."""
    first, second = joint.pair()
    contact, friction = force.contact, force.friction
    if contact.turning is not None:
        # A backlash about an axis is a contact that transmits a moment only. `turning` consists of
        # the derivatives of the penetration by the rotations of both bodies, m/rad in body axes;
        # the moment on a body is minus its vector times the normal force.
        for name, turning in zip((first, second), contact.turning, strict=True):
            if name != GROUND:
                yield name, Wrench(ZERO, turning * -force.normal_force)
        return
    if contact.lever is not None:
        # In an ideal hinge or ball, friction is a couple: the lever is the radius of the surfaces.
        assert friction is not None
        couple = friction * contact.lever
        for name, moment in ((second, couple), (first, -couple)):
            if name != GROUND:
                yield name, motions[name].torque(moment)
        return
    # `push` acts on the second body. The normal is the direction in which the second body
    # penetrates the first, so that the normal force on the second body is against it.
    push = -(contact.normal * force.normal_force)
    if friction is not None:
        push = push + friction
    # Without friction, the force may act at any point of its line of action, and points are chosen
    # that take less arithmetic.
    on_first, on_second = contact.points_of_force(friction is not None)
    # The forces on each body, each with the point at which it acts.
    forces = {second: [(push, on_second)], first: [(-push, on_first)]}
    side = contact.side
    if side is not None:
        # If the penetration also varies with an angle, such as that of meshing teeth, the contact
        # has a further force, which acts at a point of its own.
        side_force = side.on_second(force.normal_force)
        forces[second].append((side_force, side.arm_second))
        forces[first].append((side_force * -1.0, side.arm_first))
    for name, of_body in forces.items():
        if name == GROUND:
            continue
        wrenches = [motions[name].wrench(part, arm) for part, arm in of_body]
        yield name, reduce(operator.add, wrenches)
        if force.friction_moment is not None:
            moment = contact.normal * force.friction_moment
            yield name, motions[name].torque(moment if name == second else -moment)


def contact_force(
    joint: AbstractContactJoint,
    label: str,
    law: AbstractContactLaw,
    contact: Contact,
    entry_speed: Scalar | None,
    closed: Condition | None,
    motions: Motions,
    bristles: Mapping[str, Vector],
) -> LoadedContact:
    """Return the forces of one contact of a joint. `entry_speed`: m/s, or ``None`` if the law does
    not use it. `closed`: whether the contact has a force; ``None`` if it has one where it
    penetrates. `bristles`: deflections of the joint's bristles, by label of the contact.

    Here the wall is where the law's force begins, its onset. If `closed` is given and the slope of
    the force jumps at the wall, the force of a closed contact continues past the wall as an odd
    function: at a distance d outside, it pulls by as much as it pushes at the depth d. If the force
    jumps at the wall from zero to F, the forces at these two places have the sum 2 F. The reason is
    that a step ends where the contact ends, so that its stages lie on both sides of the wall:
    because of a kink there, the error estimate of the derivatives would reject every step.
    """

    def normal_force(gap: Gap) -> Scalar:
        # `_forces_of_joint` has replaced an entry speed of zero.
        if closed is not None:
            return law.force(gap, entry_speed)
        # The present penetration rate replaces an entry speed of zero.
        return contact_normal_force(law, gap, entry_speed)

    normal = _continued(normal_force, law, contact.gap, closed)
    elastic = _continued(law.elastic_force, law, contact.gap, closed)
    if bristle_law := joint.bristle_laws().get(label):
        has_force = contact.gap.depth + law.onset_offset() > 0.0 if closed is None else closed
        expected = f"those of all contacts with bristles, also {label!r}"
        remedy = "give it a deflection, bristles[joint][contact]; zero if the contact is open"
        require(label in bristles, "bristles", list(bristles), expected, remedy)
        # The friction of bristles acts in the tangent plane, so the moment of faces would be lost.
        remedy = "leave out its bristle law, and compute its friction in `friction_force`"
        expected = "without contacts that have a `face_radius`"
        require(contact.face_radius is None, "bristle_laws", [label], expected, remedy)
        to_first = motions[joint.pair()[0]]
        deflection = to_first.direction(bristles[label])
        friction, rate = _bristle_friction(bristle_law, contact, deflection, normal)
        # The deflection of an open contact stays zero.
        rate = Vector(*(jnp.where(has_force, part, 0.0) for part in to_first.components(rate)))
        return LoadedContact(contact, normal, elastic, friction, rate)
    if closed is None or not law.slope_jumps():
        friction = joint.friction_force(label, contact, normal)
        return _with_friction(contact, normal, elastic, friction)
    # Friction laws expect a positive normal force. Where the continued force pulls, friction is
    # computed with its magnitude and reversed, so that it is an odd function as well.
    sense = jnp.where(normal < 0.0, -1.0, 1.0)
    friction = joint.friction_force(label, contact, normal * sense)
    friction = None if friction is None else friction * sense
    return _with_friction(contact, normal, elastic, friction)


def _with_friction(
    contact: Contact, normal: Scalar, elastic: Scalar, friction: Vector | None
) -> LoadedContact:
    """Return a contact with its forces. For two flat faces, slip and `friction` have components
    along the normal: the relative spin about the normal times the faces' mean radius, and the
    moment of friction over this radius. This component of the friction is kept as a moment."""
    if friction is None or contact.face_radius is None:
        return LoadedContact(contact, normal, elastic, friction)
    along = friction.dot(contact.normal)
    moment = along * contact.face_radius
    across = friction - contact.normal * along
    return LoadedContact(contact, normal, elastic, across, friction_moment=moment)


def _continued(
    force: Callable[[Gap], Scalar], law: AbstractContactLaw, gap: Gap, closed: Condition | None
) -> Scalar:
    """Return ``force(gap)``, N, a force of the `law`, unchanged if `closed` is ``None``. Otherwise
    `closed` tells whether the contact has a force. If not, return zero. If so, and if the slope of
    the force jumps at the wall, continue it outside as an odd function (see `contact_force`)."""
    if closed is None:
        return force(gap)
    if not law.slope_jumps():
        return jnp.where(closed, force(gap), 0.0)
    past = closed & (gap.depth + law.onset_offset() < 0.0)
    # The wall is at depth = -offset. The mirror image of a depth d about it is -d - 2 offset, and
    # the reflected force is 2 F(wall) - F(mirror image).
    depth = jnp.where(past, -gap.depth - 2.0 * law.onset_offset(), gap.depth)
    pushing = force(replace(gap, depth=depth))
    at_wall = force(replace(gap, depth=depth_at_wall(law))) if law.force_jumps else 0.0
    return jnp.where(closed, jnp.where(past, 2.0 * at_wall - pushing, pushing), 0.0)


def depth_at_wall(law: AbstractContactLaw) -> Scalar:
    """Return the depth, m, at which a law has its force right after the onset. The onset is at
    minus the law's `onset_offset`; the result is deeper by `INSIDE` or, for an offset other than
    zero, by `EPSILON` times the offset."""
    # The sum of a nonzero offset and `INSIDE` would be rounded to the offset.
    return INSIDE - law.onset_offset() * (1.0 - EPSILON)


def _bristle_friction(
    law: AbstractBristleFriction, contact: Contact, deflection: Vector, normal_force: Scalar
) -> tuple[Vector, Vector]:
    """Return the friction on the second body, N, and the deflection's rate, m/s, in global axes."""
    assert contact.slip is not None, "a contact with bristles has a slip"
    rate = law.rate(deflection, contact.slip)
    # The ratio is the friction, with opposite sign, divided by the normal force.
    ratio = law.ratio(deflection, rate, contact.slip)
    # The normal turns as the contact moves along the wall, so that an earlier deflection has a
    # component along the present normal. Friction acts in the tangent plane only.
    across = ratio - contact.normal * ratio.dot(contact.normal)
    return across * -normal_force, rate
