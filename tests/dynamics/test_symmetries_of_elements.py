"""Accelerations and reactions of every joint, force and drive, in states at random, turn with the
scene, scale with it, and so on.

NumPy evaluates the equations of motion, so that nothing is compiled. Laws of contact and friction
are in `tests/model/test_symmetries_of_laws.py`, and runs in `tests/simulation/test_symmetries.py`.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import clearjoint as cj
from tests.simulation.test_symmetries import directions, few, mirror, vectors
from tests.support import symmetry_transformations as symmetries
from tests.support.elements import AXIS, FIRST, ON_FIRST, SECOND, Case, elements
from tests.support.many_states import COUNT, FEEDBACK, TIME, columns, in_scalars, states, system_of
from tests.support.public_names import concrete_classes

CLOSE = 1e-8
"""Largest difference of two vectors, over the largest vector of the same kind."""
ABSOLUTE, JOINT = cj.AbsoluteCoordinates(), cj.JointCoordinates()
pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")
Vectors = dict[str, np.ndarray]
"""A vector for each state, (COUNT, 3), by name."""


class Conditions(NamedTuple):
    """Numbers on which accelerations depend beside the scene and the state.

    `time`: s. `entry_speed`: of all contacts, m/s. `bristles`: deflection of all bristles, m,
    global. `feedback`: both coefficients of Baumgarte's stabilisation, 1/s.
    """

    time: float = TIME
    entry_speed: float = 0.25
    bristles: np.ndarray = np.array([6e-7, -8e-7, 3e-7])
    feedback: float = FEEDBACK


USUAL = Conditions()


class Seen(NamedTuple):
    """Accelerations of the bodies, m/s^2, global, and rad/s^2, in body axes, by the body's name;
    and the reaction of each joint on one of its bodies, N, global, by the joint's name."""

    linear: Vectors
    angular: Vectors
    reactions: Vectors


def seen(
    scene: cj.Scene,
    state: cj.State,
    given: Conditions = USUAL,
    coordinates: Any = JOINT,
    names: dict[str, str] | None = None,
    redundant: bool = False,
) -> Seen:
    """What happens in a state. `names`: new names of bodies and joints by their old names; results
    have the old names, without bodies that have become the ground."""
    now = instant(scene, state, given, coordinates, redundant)
    names = {name: name for name in (*scene.bodies, *scene.joints)} if names is None else names
    accelerations = now.dynamics.accelerations
    old = {new: name for name, new in names.items()}
    # Of one of its bodies, always the same.
    sides = {
        name: min(scene.joints[new].body_names(), key=lambda body: old.get(body, body))
        for name, new in names.items()
        if new in scene.joints
    }
    bodies = {name: accelerations[new] for name, new in names.items() if new in scene.bodies}
    return Seen(
        {name: columns(acceleration.linear) for name, acceleration in bodies.items()},
        {name: columns(acceleration.angular) for name, acceleration in bodies.items()},
        {name: reaction(now, names[name], body) for name, body in sides.items()},
    )


def instant(
    scene: cj.Scene,
    state: cj.State,
    given: Conditions,
    coordinates: Any,
    redundant: bool = False,
) -> cj.extend.Instant:
    system = system_of(scene, coordinates, given.feedback, redundant)
    variables = system.encode(in_scalars(state))
    motions, bristles = system.motions(variables), cj.extend.Vector(*given.bristles)
    entry_speeds = {
        name: {label: given.entry_speed for label, law in family.items() if law.uses_entry_speed}
        for name, family in system.scene.laws().items()
    }
    deflections = {
        name: {label: motions[joint.pair()[0]].components(bristles) for label in laws}
        for name, joint in system.scene.contact_joints().items()
        if (laws := joint.bristle_laws())
    }
    return cj.extend.Instant(system, given.time, variables, entry_speeds, {}, deflections)


def reaction(now: cj.extend.Instant, joint: str, body: str) -> np.ndarray:
    parts = [cj.quantities.Reaction(joint, body, axis)(now) for axis in "xyz"]
    return columns(cj.extend.Vector(*parts))


def apart(found: Seen, expected: Seen, least: float = 0.0) -> float:
    """The largest difference of two vectors over the largest vector of the same kind, or over
    `least` if that is larger."""
    worst = 0.0
    for ours, theirs in zip(found, expected, strict=True):
        assert set(ours) == set(theirs)
        size = max([np.abs(vectors).max() for vectors in theirs.values()], default=0.0)
        differences = [np.abs(ours[name] - theirs[name]).max() for name in theirs]
        worst = max(worst, max(differences, default=0.0) / (max(size, least) or 1.0))
    return worst


class Sample(NamedTuple):
    """A scene in `COUNT` states, and what happens there."""

    scene: cj.Scene
    state: cj.State
    seen: Seen


@cache
def samples(lossless: bool = False) -> dict[str, Sample]:
    """Each case in states at random, by name. A new case does not change the others: the seed is
    the name."""
    known = samples() if lossless else {}
    found = {}
    for name, case in elements(lossless).items():
        if name in known and not case.scene.contact_joints():
            found[name] = known[name]
        else:
            state = states(case, np.random.default_rng(list(name.encode())))
            found[name] = Sample(case.scene, state, seen(case.scene, state))
    return found


def assert_none(difference: Callable[[Any], float], cases: Mapping[str, Any]) -> None:
    """Check that a difference is within the tolerance in all cases; the others are named."""
    sizes = {name: difference(case) for name, case in cases.items()}
    assert {name: size for name, size in sizes.items() if not size < CLOSE} == {}


def test_every_element_has_a_case():
    kinds = "Constraint", "ContactJoint", "Force", "Film", "AxialPolicy", "FunctionOfTime"
    bases = [getattr(cj.extend, f"Abstract{kind}") for kind in kinds]
    cases = [case.scene for case in elements().values()]
    parts = {type(part).__name__ for case in cases for part in modules_of(case)}
    # A coupling of joints is made of two joints, each with axes and points of its own, which the
    # symmetries do not transform. It is compared with Pinocchio in random orientations (see
    # `test_random_robots`).
    missing = concrete_classes(*bases) - parts - {"JointCoupling"}
    assert not missing, (
        f"no symmetry of {sorted(missing)} is tested: add a case to `tests/support/elements.py`, "
        "whose docstring says how"
    )


def modules_of(part: Any) -> Iterator[Any]:
    """The modules in a scene or an element: joints, their laws, functions of time."""
    if isinstance(part, dict | list | tuple):
        for inner in part.values() if isinstance(part, dict) else part:
            yield from modules_of(inner)
    elif isinstance(part, eqx.Module):
        yield part
        for inner in vars(part).values():
            yield from modules_of(inner)


def test_states_satisfy_constraints_and_touch_walls():
    """Or there would be little to compare."""
    for name, sample in samples().items():
        now = instant(sample.scene, sample.state, USUAL, ABSOLUTE)
        values = [row.value for rows in now.dynamics.rows.values() for row in rows.values()]
        assert all(np.abs(value).max() < 1e-12 for value in values), name
        # The load of an ideal joint's friction is one number for all states.
        of_walls = {k: v for k, v in now.contacts.items() if "friction of" not in name}
        forces = [c.normal_force for family in of_walls.values() for c in family.values()]
        assert not forces or sum(np.count_nonzero(force) for force in forces) > 1, name


def test_coordinates_agree():
    def difference(sample: Sample) -> float:
        return apart(seen(sample.scene, sample.state, coordinates=ABSOLUTE), sample.seen)

    assert_none(difference, samples())


@settings(few, max_examples=1)
@example(*np.array([[0.0, 0.0, 0.8], [0.3, 0.0, 0.2], [0.0] * 3, [0.0] * 3, [0.1, 0.0, 0.2]]))
@given(turn=directions, own=directions, moved=vectors, drift=vectors, normal=st.none() | directions)
def test_turned_moved_and_mirrored(turn, own, moved, drift, normal):
    """Also with a velocity added to that of all bodies, and the bodies' own axes turned."""

    def difference(sample: Sample) -> float:
        maps = maps_of(sample.scene, turn, own, normal)
        flipped, there = np.linalg.det(maps["ground"]), maps["ground"].T
        element = element_of(sample.scene)
        # Surfaces of a hinge or ball slip by a rotation, whose direction is an axial vector.
        rotates = isinstance(element, cj.JointFriction) and element.radius is not None
        found = seen(
            symmetries.turned(sample.scene, maps, moved),
            symmetries.turned_state(sample.state, maps, moved, drift),
            USUAL._replace(bristles=(flipped if rotates else 1.0) * USUAL.bristles @ there),
        )
        expected = Seen(
            {name: vector @ there for name, vector in sample.seen.linear.items()},
            {name: flipped * v @ maps[name].T for name, v in sample.seen.angular.items()},
            {name: vector @ there for name, vector in sample.seen.reactions.items()},
        )
        return apart(found, expected)

    assert_none(difference, samples())


def maps_of(scene: cj.Scene, turn: np.ndarray, own: np.ndarray, mirrored: np.ndarray | None):
    """A turn of the ground, and others of each body's frame, that all mirror or none does."""
    flip = np.eye(3) if mirrored is None else mirror(mirrored)
    maps = {
        name: Rotation.from_rotvec((k + 1.0) * own).as_matrix() @ flip
        for k, name in enumerate(scene.bodies)
    }
    return maps | {"ground": Rotation.from_rotvec(2.0 * turn).as_matrix() @ flip}


powers = st.floats(-3.0, 3.0).map(lambda x: 10.0 ** round(x, 2))


@pytest.mark.slow
@settings(few, max_examples=1)
@given(scale=st.tuples(powers, powers, powers))
def test_in_other_units(scale):
    metre, kilogram, second = scale
    acceleration = metre / second**2
    given = Conditions(
        USUAL.time * second,
        USUAL.entry_speed * metre / second,
        USUAL.bristles * metre,
        USUAL.feedback / second,
    )

    def difference(sample: Sample) -> float:
        found = seen(
            symmetries.in_units(sample.scene, scale),
            symmetries.state_in_units(sample.state, scale),
            given,
        )
        factors = acceleration, 1.0 / second**2, kilogram * acceleration
        expected = Seen(
            *(
                {name: factor * vector for name, vector in vectors.items()}
                for factor, vectors in zip(factors, sample.seen, strict=True)
            )
        )
        return apart(found, expected)

    assert_none(difference, samples())


@pytest.mark.slow
def test_reordered_and_renamed():
    def difference(sample: Sample) -> float:
        # Names that sort the other way.
        old = sorted([*sample.scene.bodies, *sample.scene.joints])
        names = {name: f"{chr(ord('z') - k)} {k}" for k, name in enumerate(old)}
        scene = symmetries.renamed(sample.scene, names)
        scene = cj.Scene(
            dict(reversed(scene.bodies.items())),
            {names[name]: joint for name, joint in reversed(scene.joints.items())},
            scene.forces,
            scene.gravity,
        )
        state = {names[name]: body for name, body in sample.state.bodies.items()}
        return apart(seen(scene, cj.State(state), names=names), sample.seen)

    assert_none(difference, samples())


ONE_SIDED: dict[type, str] = {
    cj.InlineJoint: "the line belongs to the first body, the point to the second",
    cj.PointInPlaneJoint: "the plane belongs to the first body, the point to the second",
    cj.LineInPlaneJoint: "the plane belongs to the first body, the line to the second",
    cj.AppliedLoad: "it acts on one body",
    cj.Bushing: "its axes turn with the first body",
    cj.ClearanceJoint: "the journal has ends, the bearing has none",
    cj.LubricatedJoint: "the journal has ends, the bearing has none",
    cj.MasslessLink: "the journal has ends, the bearing has none",
    cj.PinInSlot: "the pin is round, the slot is flat",
    cj.Stop: "the plane belongs to the first body, the point to the second",
    cj.SliderInGuide: "the slider has corners, the guide has none",
}
"""Elements that are another element if their two bodies are exchanged, and the reason."""


@pytest.mark.slow
def test_sides_exchanged():
    """The first body of an element is its second body then."""

    def difference(sample: Sample) -> float:
        return apart(
            seen(symmetries.scene_with(sample.scene, symmetries.exchanged), sample.state),
            sample.seen,
        )

    two_sided = {
        name: sample
        for name, sample in samples(lossless=True).items()
        if type(element_of(sample.scene)) not in ONE_SIDED and name != "backlash in a ring gear"
    }
    assert_none(difference, two_sided)


def element_of(scene: cj.Scene) -> Any:
    return {**scene.joints, **scene.forces}["element"]


@pytest.mark.parametrize("choice", [1, 2, 3])
def test_axes_reversed(choice):
    """Exchanges the bases of a journal, the corners of a slider, the walls of a slot and the flanks
    of a backlash."""

    def difference(sample: Sample) -> float:
        changed = symmetries.scene_with(sample.scene, lambda e: symmetries.reversed_axes(e, choice))
        return apart(seen(changed, sample.state), sample.seen)

    reversible = {
        name: sample
        for name, sample in samples().items()
        if symmetries.is_reversible(element_of(sample.scene), choice)
    }
    assert_none(difference, reversible)


@pytest.mark.slow
@pytest.mark.parametrize("held", [FIRST, SECOND])
def test_ground_is_like_a_heavy_body_at_rest(held):
    def difference(case: Case) -> float:
        # The held body is where the ground is: at the origin, with parallel axes.
        body = case.state.bodies[held]
        turn = symmetries.matrix(body.orientation).T
        maps = {name: np.eye(3) for name in case.scene.bodies} | {"ground": turn}
        moved = -turn @ np.asarray(body.position)
        heavy = cj.Body(1e15, 1e15 * np.ones(3))
        scene = symmetries.scene_with(
            case.scene, lambda e: e, bodies=case.scene.bodies | {held: heavy}, gravity=None
        )
        for name in set(scene.bodies) - {held}:
            scene.forces[f"push on {name}"] = cj.AppliedLoad(
                name, (3.0, -2.0, 4.0), (0.2, 0.3, 0.1)
            )
        there = symmetries.turned_state(case.state, maps, moved)
        state = states(case._replace(scene=scene, state=there), np.random.default_rng(1), held)
        free = seen(scene, state, coordinates=ABSOLUTE)
        names = {name: name for name in (*scene.bodies, *scene.joints)} | {held: "ground"}
        on_ground = cj.State({name: b for name, b in state.bodies.items() if name != held})
        found = seen(symmetries.renamed(scene, names), on_ground, names=names)
        others = Seen(*({k: v for k, v in part.items() if k != held} for part in free))
        # Bodies that are fixed to the ground have accelerations of zero.
        return apart(found, others, least=1.0)

    # A joint without contacts that two sides may exchange doesn't tell which is the ground.
    cases = {
        name: case
        for name, case in elements().items()
        if held == FIRST or case.scene.contact_joints() or type(element_of(case.scene)) in ONE_SIDED
    }
    assert_none(difference, cases)


@pytest.mark.slow
def test_backwards():
    """If nothing is lost, accelerations are the same with all velocities reversed."""

    def difference(sample: Sample) -> float:
        state = cj.State(
            {
                name: cj.BodyState(b.position, b.orientation, -b.velocity, -b.spin)
                for name, b in sample.state.bodies.items()
            }
        )
        scene = symmetries.scene_with(sample.scene, symmetries.backwards)
        return apart(seen(scene, state, USUAL._replace(time=-USUAL.time)), sample.seen)

    assert_none(difference, samples(lossless=True))


def test_bodies_push_each_other_equally():
    """The reactions on the two bodies of a joint are opposite, to the last bit; and no element but
    an applied load changes momentum and angular momentum of all bodies together."""

    def difference(sample: Sample) -> float:
        now = instant(sample.scene, sample.state, USUAL, ABSOLUTE)
        for joint, element in sample.scene.joints.items():
            forces = [reaction(now, joint, body) for body in element.body_names()]
            assert np.array_equal(sum(forces), np.zeros((COUNT, 3))), (joint, element)
        loaded = isinstance(element_of(sample.scene), cj.AppliedLoad)
        return 0.0 if loaded else max(unbalanced(sample))

    assert_none(difference, samples())


def unbalanced(sample: Sample) -> tuple[float, float]:
    """The rates of momentum and of angular momentum without gravity, over the largest part."""
    pushes, twists = [], []
    for name, body in sample.scene.bodies.items():
        there = sample.state.bodies[name]
        push = body.mass * (sample.seen.linear[name] - np.asarray(sample.scene.gravity))
        spin, inertia = there.spin, symmetries.inertia_matrix(body)
        own = sample.seen.angular[name] @ inertia + np.cross(spin, spin @ inertia)
        turned = np.einsum("kij,kj->ki", symmetries.matrix(there.orientation), own)
        pushes.append(push)
        twists.append(turned + np.cross(there.position, push))
    return tuple(
        np.abs(sum(parts)).max() / max(np.abs(part).max() for part in parts)
        for parts in (pushes, twists)
    )


@pytest.mark.parametrize("metre", [1e-6, 1e-3, 1e3])
def test_redundant_reactions_in_other_units(metre):
    """A door on two hinges of one axis, whose reactions have the least norm."""
    joints = {
        name: cj.RevoluteJoint("ground", "door", point, point + ON_FIRST, AXIS, AXIS)
        for name, point in (("low", 0.3 * AXIS), ("high", -0.5 * AXIS))
    }
    bodies = {"door": cj.Body(2.0, (0.3, 0.1, 0.25))}
    scene = cj.Scene(bodies, joints, gravity=(1.0, -9.0, 3.0))
    parts = -ON_FIRST, [1.0, 0.0, 0.0, 0.0], np.zeros(3), 2.0 * AXIS
    state = cj.State({"door": cj.BodyState(*(np.tile(part, (COUNT, 1)) for part in parts))})
    scale = metre, 1.0, 1.0
    smaller = symmetries.in_units(scene, scale), symmetries.state_in_units(state, scale)
    found, expected = (
        seen(*given, coordinates=ABSOLUTE, redundant=True) for given in (smaller, (scene, state))
    )
    scaled = Seen(
        {name: metre * vector for name, vector in expected.linear.items()},
        expected.angular,
        {name: metre * vector for name, vector in expected.reactions.items()},
    )
    assert apart(found, scaled) < LEAST_NORM


LEAST_NORM = 1e-6
"""Largest relative difference of reactions of least norm, which are found by iteration."""
