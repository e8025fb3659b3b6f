"""Energies of a scene, J, and powers of its energy ledger, W, which a run integrates.

Terms that a scene cannot have are absent from dictionaries and from the compiled program.
"""

from functools import reduce

from .._math.vectors import Scalar, add, is_zero
from .._model.joints.constraint_rows import row_rate
from .._model.joints.ideal import AbstractDriveableJoint
from .._model.scene import Scene
from .contact_forces import Bristles, LoadedContacts
from .coordinates import Motions
from .equations_of_motion import Dynamics


def ledger_powers(scene: Scene, dynamics: Dynamics, t: Scalar) -> dict[str, Scalar]:
    """Return the powers of the energy ledger, W, by name, as far as the scene has them.

    "normal damping", "friction", "film" and "stabilisation" (of constraints) are positive if they
    take energy from the motion. "supplied" is the power by which drivers and force elements change
    the total energy, which includes the energy stored in force elements: positive for a load that
    does work on the bodies, zero for a spring, negative for a damper.
    """
    powers: dict[str, Scalar] = {}

    def add_power(name: str, power: Scalar) -> None:
        powers[name] = add(powers.get(name, 0.0), power)

    for family in dynamics.contact_forces.values():
        for force in family.values():
            rate = force.contact.gap.rate
            # The elastic part of the normal force is conservative, so only the rest dissipates.
            add_power("normal damping", (force.normal_force - force.elastic_force) * rate)
            if force.friction is not None and force.contact.slip is not None:
                # Friction is tangential. The slip of flat faces also has a component along the
                # normal, which this product leaves out; its power is that of the moment below.
                add_power("friction", -force.friction.dot(force.contact.slip))
                if force.friction_moment is not None and force.contact.face_radius is not None:
                    # The component of the slip along the normal is the relative spin of the faces
                    # about the normal, times the face radius.
                    along = force.contact.slip.dot(force.contact.normal)
                    lost = -force.friction_moment * along / force.contact.face_radius
                    add_power("friction", lost)
    for joint in scene.contact_joints().values():
        for name, wrench in joint.film_wrenches(dynamics.motions).items():
            # A film takes the power from the motion that its wrench supplies, with a minus sign.
            add_power("film", -dynamics.motions[name].power(wrench))
    for element in scene.forces.values():
        add_power("supplied", element.supplied_power(dynamics.motions, t))
    for name, family in dynamics.rows.items():
        for label, row in family.items():
            multiplier = dynamics.multipliers[name][label]
            # The rate of a row's value, `row_rate`, is the row's Jacobian times the velocities and
            # spins, plus `time_rate`, its rate with all bodies at rest. The power of the reactions
            # on the bodies is therefore multiplier (row_rate - time_rate). The term with `row_rate`
            # is zero unless the constraint drifts or the stabilisation corrects it. The driver
            # supplies the term with `time_rate`.
            add_power("stabilisation", -multiplier * row_rate(row, dynamics.motions))
            if not is_zero(row.time_rate):
                add_power("supplied", -multiplier * row.time_rate)
    return powers


def bristle_energy(
    scene: Scene, motions: Motions, forces: LoadedContacts, bristles: Bristles
) -> Scalar | None:
    """Return the energy in the bristles of all contacts, J; ``None`` without bristle laws. The
    entry "friction" of the ledger counts this energy as dissipated. Bristles are stiffer under a
    greater normal force: their energy also changes with this force, without work of the bodies."""
    stored: list[Scalar] = []
    for name, family in scene.bristle_laws().items():
        to_first = motions[scene.contact_joints()[name].pair()[0]]
        for label, law in family.items():
            force, deflection = forces[name][label], to_first.direction(bristles[name][label])
            # Only the part of the deflection in the tangent plane causes friction.
            normal = force.contact.normal
            across = deflection - normal * deflection.dot(normal)
            stored.append(force.normal_force * law.stored_energy(across))
    return reduce(add, stored) if stored else None


def mechanical_energy(scene: Scene, motions: Motions, t: Scalar) -> dict[str, Scalar]:
    """Return the energies by name: "kinetic", with the rotors of joints with an `armature`;
    "gravity", zero if all centres of mass are at the global origin; "springs", of all force
    elements; and "contacts", the elastic energy of contacts."""
    energies: dict[str, Scalar] = {"kinetic": 0.0}
    for name, body in scene.bodies.items():
        motion = motions[name]
        linear = body.mass * motion.velocity.dot(motion.velocity)
        angular = motion.spin.dot(body.angular_momentum(motion.spin))
        energies["kinetic"] = energies["kinetic"] + 0.5 * (linear + angular)
    # The inertia of a rotor that drives a joint is given as the `armature`, for the joint's speed.
    for joint in scene.joints.values():
        if isinstance(joint, AbstractDriveableJoint) and joint.armature is not None:
            speed = row_rate(joint.position(motions), motions)
            energies["kinetic"] = energies["kinetic"] + 0.5 * joint.armature * speed**2
    if scene.gravity is not None:
        energies["gravity"] = 0.0
        for name, body in scene.bodies.items():
            # The product is -g times the height above the global origin, so it is subtracted.
            along_gravity = scene.gravity.dot(motions[name].position)
            energies["gravity"] = energies["gravity"] - body.mass * along_gravity
    if scene.forces:
        stored = [element.stored_energy(motions, t) for element in scene.forces.values()]
        energies["springs"] = reduce(add, stored)
    for joint in scene.contact_joints().values():
        laws = joint.laws()
        for label, contact in joint.contacts(motions).items():
            stored_energy = laws[label].stored_energy(contact.gap)
            energies["contacts"] = add(energies.get("contacts", 0.0), stored_energy)
    return energies
