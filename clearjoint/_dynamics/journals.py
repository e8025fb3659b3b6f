"""Checks and corrections of journals in their bearings, at the start and end of a run."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from functools import partial, reduce
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from .._compilation.xla import HostFirst
from .._fields.cautions import LeftBearingWarning, UnusualValueWarning, caution, quiet
from .._fields.checks import caution_unless, require
from .._fields.objects import on_device
from .._math.smoothing import value_and_slope
from .._math.vectors import Condition, Scalar, pack, subtract, unpack
from .._model.bodies import GROUND, GROUND_MOTION, NO_WRENCH, BodyState, State
from .._model.contact.laws import whole_law
from .._model.joints.base import (
    AbstractConstraint,
    AbstractContactJoint,
    ByLabel,
    Contact,
    Motions,
    each_label,
)
from .._model.joints.joint_friction import JointFriction
from .._model.scene import Scene
from .._native import Native
from .absolute_coordinates import AbsoluteCoordinates
from .contact_events import approaches_unknown, contact_gaps
from .contact_forces import EntrySpeeds, LoadedContact
from .coordinates import at_rest, free_motion
from .equations_of_motion import constraint_wrenches
from .formulation import Formulation, Unstabilised
from .system import System

OUTSIDE = 1e-6
"""Penetration of the wall, m, above which `assemble` moves a journal to the centre of its bearing.
A journal that penetrates less is not moved, since its contact may carry a load."""
FAR_OUTSIDE = 1e-2
"""Penetration, as a fraction of the largest one that the joint allows, above which a warning is
issued at the start of a run, and an error raised for a journal that `assemble` has centred.
Contacts in motion are usually far less deep."""
SLOW_ONSET = 1e-2
"""Entry speed below which a contact counts as overdamped, as a fraction of the speed of an impact
whose energy is the elastic energy of the contact."""
FAST_APPROACH = 1e-6
"""Penetration rate, m/s, above which a closed contact without a known entry speed causes a warning
at the start of a run: the default of `entry_speed_floor`, the smallest entry speed of laws."""
HOLD_IT = "Give the joint axial=EndPlay(...) or FixedAxially(), or hold the bodies by other joints."
UNIQUE_REACTIONS = Formulation(AbsoluteCoordinates(), Unstabilised(), redundant=True)
"""Formulation in which each ideal joint has a reaction, unique in spite of redundant constraints,
and without the forces by which a stabilisation corrects positions."""


IdealJoints: TypeAlias = Mapping[str, AbstractConstraint]
"""Ideal joints that replace joints of a scene, by their names."""


def depths(scene: Scene, state: State) -> ByLabel[float]:
    """Return the penetration of each contact of a state, m; negative without contact."""
    if not scene.contact_joints():
        return {}
    by_joint = contact_depths(scene, state.bodies)
    return {name: _numbers(family) for name, family in by_joint.items()}


def outside(scene: Scene, state: State) -> set[str]:
    """Return the names of the joints with a contact that penetrates by more than `OUTSIDE`."""
    by_joint = depths(scene, state).items()
    return {name for name, family in by_joint if any(d > OUTSIDE for d in family.values())}


def centring_joints(scene: Scene, names: Iterable[str]) -> dict[str, AbstractConstraint]:
    """Return the ideal joints that hold the journals of named clearance joints centred, by name.
    Joints whose `AbstractContactJoint.centred_joint` is ``None`` are left out."""
    joints = scene.contact_joints()
    ideal = {name: joints[name].centred_joint() for name in names}
    return {name: joint for name, joint in ideal.items() if joint is not None}


def resting_joints(
    scene: Scene, ideal: IdealJoints, names: Collection[str], state: State, t: Scalar
) -> dict[str, AbstractConstraint]:
    """Return ideal joints that hold the journals of named clearance joints where they rest: on the
    side of the wall to which the load presses the journal, at the penetration that carries the
    load. The load is the reaction of the ideal joint that replaces the clearance joint in `ideal`,
    with all bodies at rest. `state` satisfies the joints in `ideal`."""
    joints, resting = scene.contact_joints(), {}
    loads = _loads(with_ideal(scene, ideal), state.bodies, on_device(t))
    for name in names:
        first, second = joints[name].pair()
        # The force that presses the second body against the first, N.
        load = np.asarray(loads[name])
        joint = joints[name].resting_joint(load)
        expected = f"a joint in which {second!r} is pressed against {first!r} across the axis"
        load_there = f"the load there is {load.tolist()} N"
        remedy = f"{load_there}; give the scene its gravity, or leave it out"
        require(joint is not None, "resting", name, expected, remedy)
        assert joint is not None
        resting[name] = joint
    return resting


def resting_entry_speeds(
    scene: Scene, names: Collection[str], state: State, t: Scalar
) -> dict[str, dict[str, float]]:
    """Return entry speeds for the closed contacts of the named joints, m/s, with which a journal
    that rests on the wall is damped moderately: the speed of an impact of the contact's effective
    mass whose energy is the elastic energy of the contact. The law's smallest entry speed would
    make the equations of motion stiff; an unknown entry speed would leave no damping."""
    laws = scene.laws()
    names = tuple(n for n in names if any(law.uses_entry_speed for law in laws[n].values()))
    if not names:
        return {}
    speeds = _speeds_of_rest(names, scene, state.bodies, on_device(t))
    return {
        name: {label: float(speed) for label, speed in family.items() if speed > 0.0}
        for name, family in speeds.items()
    }


def overdamped_contacts(scene: Scene, state: State, t: Scalar) -> list[str]:
    """Return a sentence, with a remedy, for each joint with a contact that began so slowly that its
    damping makes the equations of motion stiff: with an entry speed below `SLOW_ONSET` times the
    one that `resting_entry_speeds` returns for the contact's present depth."""
    sentences, usual = [], resting_entry_speeds(scene, scene.contact_joints(), state, t)
    for name, family in usual.items():
        for label, speed in family.items():
            # The user's own law, around which the joint may have put another one.
            law = whole_law(scene.laws()[name][label])
            # Laws with a floor use it in place of lower entry speeds.
            floor = float(getattr(law, "entry_speed_floor", 0.0))
            present = max(float(state.entry_speeds[name][label]), floor)
            if present < SLOW_ONSET * speed:
                raising = f"give the law `entry_speed_floor={speed:.0e}`" if floor else ""
                other = "take a law without an entry speed, such as `MemorylessHuntCrossley`"
                sentences.append(
                    f"Contact {label!r} of joint {name!r} began at {present:.1e} m/s, at which the "
                    f"damping of its law {type(law).__name__} is so large that steps must be very "
                    f"short: {' or '.join(filter(None, [raising, other]))}."
                )
                # One sentence for each joint is enough.
                break
    return sentences


def with_ideal(scene: Scene, ideal: IdealJoints) -> Scene:
    """Return the scene with the joints whose names are in `ideal` replaced. Reactions of the new
    joints press no friction surfaces: a `JointFriction` that is `pressed_by` a replaced joint
    keeps only its constant load."""
    joints = {**scene.joints, **ideal}
    for name, joint in joints.items():
        if isinstance(joint, JointFriction) and joint.pressed_by in ideal:
            joints[name] = replace(joint, pressed_by=None, load_ratio=None)
    # The user has had the warnings of the scene's constructor already.
    with quiet():
        return replace(scene, joints=joints)


def require_in_bearings(scene: Scene, by_joint: ByLabel[Scalar], rates: ByLabel[Scalar]) -> None:
    """Check the two results of `starting_contacts` for an initial state: `by_joint`, penetrations
    of all contacts, m, and `rates`, m/s, those of closed contacts without a known entry speed.

    **Raises:** `ValueError` if a contact is deeper than its limit in the joint's `deepest`.

    **Warns:** `UnusualValueWarning` for a penetration within this limit, but above `FAR_OUTSIDE`
    times it, and for a contact that began before the start, approaches faster than
    `FAST_APPROACH`, and has no entry speed.
    """
    for name, family in rates.items():
        # One message for each joint is enough, on the contact that approaches fastest.
        label = max(family, key=lambda label: float(family[label]))
        rate, argument = float(family[label]), f"state.entry_speeds[{name!r}][{label!r}]"
        if rate > FAST_APPROACH:
            caution(
                f"Contact {label!r} of joint {name!r} is closed at the start and approaches at "
                f"{rate:.3g} m/s, but its entry speed is unknown, so that it has no damping until "
                f"it ends: give {argument}, in m/s, or start outside of the wall.",
                UnusualValueWarning,
            )
    for name, family in by_joint.items():
        joint_depths = _numbers(family)
        limits = _numbers(scene.contact_joints()[name].deepest())
        # A joint may have no limits, and then any penetration is allowed.
        if not limits:
            continue
        # One message for each joint is enough: on the contact that is deepest relative to its own
        # limit, since contacts of one joint may have different limits.
        label = max(limits, key=lambda label: joint_depths[label] / limits[label])
        depth, limit = joint_depths[label], limits[label]
        where = f"contact {label!r} of joint {name!r}"
        expected = f"one with its journals in their bearings ({where} at most {limit:g} m deep)"
        require(depth <= limit, "state", depth, expected, "call assemble(scene, state) first")
        usual = FAR_OUTSIDE * limit
        remedy = "call assemble(scene, state), which puts the journal into its bearing"
        # In the message, the place follows the unit.
        meaning, expected = f"m deep in the wall at {where}", f"at most {usual:g} m"
        caution_unless(depth <= usual, "state", depth, meaning, expected, remedy)


def require_centred(scene: Scene, state: State, names: Iterable[str]) -> None:
    """Check that no contact of the named joints, which `assemble` has centred, is deep in a wall,
    as it is for a pin beyond the end of its slot."""
    by_joint, joints = depths(scene, state), scene.contact_joints()
    for name in names:
        for label, limit in joints[name].deepest().items():
            depth, usual = by_joint[name][label], FAR_OUTSIDE * float(limit)
            where = f"contact {label!r} of joint {name!r}"
            expected = f"one that can be assembled with {where} at most {usual:g} m deep"
            remedy = "move the body in the guess, until it is out of this wall"
            require(depth <= usual, "state", depth, expected, remedy)


def warn_of_journals_outside(
    scene: Scene, time: Scalar, final: State, saved: Iterable[tuple[np.ndarray, State]]
) -> None:
    """Issue a `LeftBearingWarning`, with the earliest time, for each joint whose journal is out of
    its bearing at the end of a run (at `time`, in the state `final`) or in `saved`: pairs of N
    times, s, and N states with arrays of first axis N."""
    # As in `saved`, with N = 1.
    at_end = np.asarray([time]), jax.tree.map(lambda leaf: np.asarray(leaf)[None], final)
    joints = unpack(jax.tree.map(np.asarray, scene.contact_joints()))
    departures: dict[str, tuple[float, float]] = {}
    for times, states in (*saved, at_end):
        for name, excess in slid_out(joints, states.bodies).items():
            if (excess > 0.0).any():
                k = int(np.argmax(excess > 0.0))  # the first state out of the bearing
                # Of several departures the earliest is reported; pairs compare by time first.
                departure = float(times[k]), float(excess[k])
                departures[name] = min(departure, departures.get(name, departure))
    for name, (when, excess) in departures.items():
        caution(
            f"The journal of joint {name!r} has slid out of its bearing: nothing holds it axially. "
            f"At t = {when:.6g} s it is {excess:.3g} m beyond the end of a bearing of its own "
            f"length. {HOLD_IT}",
            LeftBearingWarning,
        )


def slid_out(
    joints: Mapping[str, AbstractContactJoint], bodies: Mapping[str, BodyState]
) -> dict[str, np.ndarray]:
    """Return the axial distance, (N,) m, from the end of each bearing to the journal beyond it, by
    name of joint, in N states; negative while the journal is partly inside. Bearings are assumed to
    be as long as their journals. Joints whose journal cannot slide out are left out."""
    # NumPy is used so that nothing is compiled.
    in_scalars = unpack(jax.tree.map(np.asarray, dict(bodies)), leading=1)
    return {name: np.asarray(excess) for name, excess in _excesses(joints, in_scalars).items()}


def _excesses(
    joints: Mapping[str, AbstractContactJoint], bodies: Mapping[str, BodyState]
) -> dict[str, Scalar]:
    # By the method of the base class, no journal slides out. Motions are computed only for bodies
    # of joints whose class overrides this method.
    inherited = AbstractContactJoint.slid_out
    joints = {n: joint for n, joint in joints.items() if type(joint).slid_out is not inherited}
    names = {name for joint in joints.values() for name in joint.body_names()}
    free = {name: free_motion(body, None) for name, body in bodies.items() if name in names}
    motions = {GROUND: GROUND_MOTION, **free}
    excesses = {name: joint.slid_out(motions) for name, joint in joints.items()}
    return {name: excess for name, excess in excesses.items() if excess is not None}


def any_slid_out(scene: Scene, bodies: Mapping[str, BodyState]) -> Condition:
    """Return whether any journal has left its bearing completely, in a form that JAX can trace."""
    excesses = _excesses(scene.contact_joints(), bodies).values()
    beyond = [jnp.asarray(excess > 0.0) for excess in excesses]
    return reduce(jnp.logical_or, beyond, jnp.asarray(False))


def _numbers(by_name: Mapping[str, Scalar]) -> dict[str, float]:
    return {name: float(number) for name, number in by_name.items()}


# NumPy computes this function if it can, since a compilation takes longer than a single call.
@HostFirst
def contact_depths(scene: Scene, bodies: dict[str, BodyState]) -> ByLabel[Scalar]:
    """Return the penetration of each contact, m. Vectors in the arguments are arrays, (3,)."""
    system = System(unpack(scene), Formulation(AbsoluteCoordinates()))
    motions = system.motions(system.encode(unpack(bodies)))
    return {
        name: {label: contact.gap.depth for label, contact in joint.contacts(motions).items()}
        for name, joint in system.scene.contact_joints().items()
    }


def starting_contacts(
    scene: Scene, motions: Motions, entry_speeds: EntrySpeeds
) -> tuple[ByLabel[Scalar], ByLabel[Scalar]]:
    """Return the penetration of each contact, m, and the penetration rate, m/s, of each closed
    contact without a known entry speed (see `approaches_unknown`)."""
    gaps, laws = contact_gaps(scene, motions), scene.laws()

    def depth(name: str, label: str) -> Scalar:
        # Gaps are measured from the onset of the force.
        return subtract(gaps[name][label].depth, laws[name][label].onset_offset())

    return each_label(depth, gaps), approaches_unknown(scene, gaps, entry_speeds)


# This function is compiled to native code or, if that is not possible, by XLA without a warning.
@partial(Native, warns=False)
def _speeds_of_rest(
    names: tuple[str, ...], scene: Scene, bodies: dict[str, BodyState], t: Scalar
) -> ByLabel[Scalar]:
    """Return, for each contact of the named joints whose law uses the entry speed, the speed, m/s,
    of an impact whose energy is the elastic energy of the contact; zero if the contact is open."""
    system = System(unpack(scene), UNIQUE_REACTIONS)
    variables = system.encode(unpack(bodies))
    motions, speeds = system.motions(variables), {}

    def per_mass(name: str, label: str, contact: Contact) -> Scalar:
        """Return the inverse of the mass, 1/kg, that the normal force of a contact accelerates."""

        def second_rate(push: Scalar) -> Scalar:
            forces = {name: {label: LoadedContact(contact, push, push, None)}}
            rates = system.dynamics_under(system.mechanics(variables), forces, t).variable_rates
            return jnp.asarray(system.second_rates(variables, rates)[name][label], float)

        # The second rate of the depth is linear in the force, which reduces the depth.
        _, slope = value_and_slope(second_rate, 0.0)
        return -slope

    for name in names:
        joint = system.scene.contact_joints()[name]
        laws, contacts = joint.laws(), joint.contacts(motions)
        speeds[name] = {}
        for label, contact in contacts.items():
            if laws[label].uses_entry_speed:
                energy = laws[label].stored_energy(contact.gap)
                # Rounding errors may make the square of the speed negative.
                square = 2.0 * energy * per_mass(name, label, contact)
                speeds[name][label] = jnp.sqrt(jnp.maximum(square, 0.0))
    return speeds


# This function is compiled to native code or, if that is not possible, by XLA without a warning.
@partial(Native, warns=False)
def _loads(scene: Scene, bodies: dict[str, BodyState], t: Scalar) -> dict[str, jax.Array]:
    """Return, for each constraint by name, the force, (3,) N, that its last body exerts on its
    first, in axes of the first body, while all bodies are at rest and no contact has a force."""
    system = System(unpack(scene), UNIQUE_REACTIONS)
    mechanics = system.mechanics(system.encode(at_rest(unpack(bodies))))
    dynamics = system.dynamics_under(mechanics, {}, t)
    loads = {}
    for name in dynamics.rows:
        first, *_, last = system.scene.joints[name].body_names()
        on_last = constraint_wrenches(dynamics, name).get(last, NO_WRENCH)
        loads[name] = pack(dynamics.motions[first].components(-on_last.force))
    return loads
