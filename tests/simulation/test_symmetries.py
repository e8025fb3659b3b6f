"""The same motion, looked at otherwise: turned, mirrored, reordered, renamed, in other units,
backwards, split in time, in other coordinates. Each symmetry is also seen to fail where something
is forgotten.

All but names and coordinates, which are slow for that, share one program."""

import jax
import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import clearjoint as cj
from tests.support.hinged import NAMES, Hinged, Outcome, drawn, outcome, scene, state

CLOSE = 1e-7
"""Largest difference of a part of two outcomes, over its size. Right runs are within 1e-9."""
FAR = 1e4 * CLOSE
few = settings(
    max_examples=4,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=list(HealthCheck),
)
seeds = st.integers(0, 10_000)
coordinate = st.floats(-1.0, 1.0).map(lambda x: round(x, 3))
vectors = st.tuples(coordinate, coordinate, coordinate).map(np.array)
directions = vectors.filter(lambda vector: np.linalg.norm(vector) > 0.1)
JOINT = cj.JointCoordinates()
factors = st.floats(0.2, 5.0).map(lambda x: round(x, 3))


def solved(
    numbers: Hinged, names=NAMES, here=None, begin=0.0, end=None, coordinates=JOINT
) -> cj.results.Solution:
    """A run; all of one mechanism's names and coordinates share a program."""
    return simulated(
        scene(numbers, names),
        state(numbers, names) if here is None else here,
        numbers,
        numbers.end_time if end is None else end,
        begin,
        coordinates,
    )


def simulated(
    built, here, numbers: Hinged, end, begin=0.0, coordinates=JOINT, atol=None
) -> cj.results.Solution:
    return cj.simulate(
        built,
        here,
        end,
        cj.Settings(
            rtol=1e-10,
            atol=atol,
            first_step=1e-4 * numbers.end_time,
            landing_tolerance=numbers.landing,
            coordinates=coordinates,
        ),
        save=cj.Saving(impacts=True),
        start_time=begin,
        progress=False,
    )


def run(numbers: Hinged, names=NAMES, **options) -> cj.State:
    return solved(numbers, names, **options).final


def ended(numbers: Hinged, **options) -> Outcome:
    return outcome(run(numbers, **options))


def apart(one: Outcome, other: Outcome) -> float:
    """The largest difference of a part, over the size of this part."""
    return max(np.abs(a - b).max() / np.abs(b).max() for a, b in zip(one, other, strict=True))


def test_the_journal_meets_the_wall():
    """Or there would be little to compare."""
    assert len(solved(drawn(0)).impacts) >= 2


def mapped(numbers: Hinged, global_map, own_map, moved, flipped: float) -> Hinged:
    """Global vectors mapped by one matrix, bodies' own by another, and all moved; spins, which are
    axial, change their sign as told."""
    n = numbers
    return n._replace(
        inertia=own_map @ n.inertia @ own_map.T,
        hinge=global_map @ n.hinge + moved,
        hinge_axis=global_map @ n.hinge_axis,
        gravity=global_map @ n.gravity,
        start=mapped_outcome(n.start, global_map, own_map, moved, flipped),
        **{name: own_map @ getattr(n, name) for name in OWN},
    )


OWN = ("hinge_own", "hinge_axis_own", "bearing", "bearing_axis", "journal", "journal_axis")


def mapped_outcome(found: Outcome, global_map, own_map, moved, flipped: float) -> Outcome:
    return Outcome(
        found.position @ global_map.T + moved,
        global_map @ found.rotation @ own_map.T,
        found.velocity @ global_map.T,
        flipped * found.spin @ own_map.T,
    )


def placed(turn, moved):
    """Where a scene is turned and moved to."""
    return Rotation.from_rotvec(2.0 * turn).as_matrix(), np.eye(3), moved, 1.0


def mirror(normal):
    across = normal / np.linalg.norm(normal)
    return np.eye(3) - 2.0 * np.outer(across, across)


@pytest.mark.slow
@few
@given(seed=seeds, turn=directions, moved=vectors)
def test_turned_and_moved(seed, turn, moved):
    numbers, how = drawn(seed), placed(turn, moved)
    assert apart(ended(mapped(numbers, *how)), mapped_outcome(ended(numbers), *how)) < CLOSE


def test_turned_without_gravity_differs():
    numbers, how = drawn(1), placed(np.array([0.3, -0.5, 0.8]), np.zeros(3))
    wrong = mapped(numbers, *how)._replace(gravity=numbers.gravity)
    assert apart(ended(wrong), mapped_outcome(ended(numbers), *how)) > FAR


@few
@given(seed=seeds, turn=directions)
def test_bodies_with_frames_turned(seed, turn):
    numbers, how = drawn(seed), (np.eye(3), Rotation.from_rotvec(2.0 * turn).as_matrix(), 0.0, 1.0)
    assert apart(ended(mapped(numbers, *how)), mapped_outcome(ended(numbers), *how)) < CLOSE


def test_frames_turned_without_inertia_differ():
    own = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
    numbers, how = drawn(1), (np.eye(3), own, 0.0, 1.0)
    wrong = mapped(numbers, *how)._replace(inertia=numbers.inertia)
    assert apart(ended(wrong), mapped_outcome(ended(numbers), *how)) > FAR


@few
@given(seed=seeds, normal=directions)
def test_mirrored(seed, normal):
    numbers, how = drawn(seed), (mirror(normal), mirror(normal), 0.0, -1.0)
    assert apart(ended(mapped(numbers, *how)), mapped_outcome(ended(numbers), *how)) < CLOSE


def test_mirrored_with_the_arm_spinning_on_differs():
    plane = mirror(np.array([0.3, -0.5, 0.8]))
    numbers, how = drawn(1), (plane, plane, 0.0, -1.0)
    right = mapped(numbers, *how)
    spin = right.start.spin * [[1.0], [-1.0]]
    wrong = right._replace(start=right.start._replace(spin=spin))
    assert apart(ended(wrong), mapped_outcome(ended(numbers), *how)) > FAR


@few
@given(seed=seeds)
def test_reordered(seed):
    numbers = drawn(seed)
    assert bits(reordered(numbers)) == bits(run(numbers))


def reordered(numbers: Hinged) -> cj.State:
    """The end of a run of the scene with its elements in the other order."""
    straight, first = scene(numbers), state(numbers)
    turned = cj.Scene(
        dict(reversed(straight.bodies.items())),
        dict(reversed(straight.joints.items())),
        gravity=straight.gravity,
    )
    assert list(turned.bodies) != list(straight.bodies)
    start = cj.State(dict(reversed(first.bodies.items())), first.entry_speeds)
    return simulated(turned, start, numbers, numbers.end_time).final


def bits(found: cj.State) -> list[bytes]:
    return [np.asarray(leaf).tobytes() for leaf in jax.tree.leaves(found)]


def test_a_mass_off_by_a_rounding_has_other_bits():
    numbers = drawn(1)
    wrong = numbers._replace(mass=np.nextafter(numbers.mass, 9.0))
    assert bits(reordered(wrong)) != bits(run(numbers))


OTHERS = {"link": "zz", "arm": "b c", "hinge": "z", "pin": "a"}
"""Names that sort the other way."""


@pytest.mark.slow
@few
@given(seed=seeds)
def test_renamed(seed):
    numbers = drawn(seed)
    assert apart(outcome(run(numbers, OTHERS), OTHERS), ended(numbers)) < CLOSE


@pytest.mark.slow
def test_names_that_are_exchanged_differ():
    numbers = drawn(1)
    exchanged = OTHERS | {"link": OTHERS["arm"], "arm": OTHERS["link"]}
    assert apart(outcome(run(numbers, OTHERS), exchanged), ended(numbers)) > FAR


def scaled(numbers: Hinged, metre: float, kilogram: float, second: float) -> Hinged:
    """In units that are so many times smaller."""
    n, newton = numbers, kilogram * metre / second**2
    lengths = (
        "hinge",
        "hinge_own",
        "bearing",
        "journal",
        "radius",
        "clearance",
        "length",
        "landing",
    )
    return n._replace(
        mass=kilogram * n.mass,
        inertia=kilogram * metre**2 * n.inertia,
        stiffness=newton / metre**1.5 * n.stiffness,
        floor=metre / second * n.floor,
        regularisation=metre / second * n.regularisation,
        gravity=metre / second**2 * n.gravity,
        start=scaled_outcome(n.start, metre, second),
        end_time=second * n.end_time,
        **{name: metre * getattr(n, name) for name in lengths},
    )


def scaled_outcome(found: Outcome, metre: float, second: float) -> Outcome:
    speed = metre / second
    return Outcome(
        metre * found.position, found.rotation, speed * found.velocity, found.spin / second
    )


@few
@given(seed=seeds, metre=factors, kilogram=factors, second=factors)
def test_in_other_units(seed, metre, kilogram, second):
    numbers = drawn(seed)
    found = ended(scaled(numbers, metre, kilogram, second))
    assert apart(found, scaled_outcome(ended(numbers), metre, second)) < CLOSE


def test_a_stiffness_left_in_old_units_differs():
    numbers = drawn(1)
    wrong = scaled(numbers, 2.0, 3.0, 0.7)._replace(stiffness=numbers.stiffness)
    assert apart(ended(wrong), scaled_outcome(ended(numbers), 2.0, 0.7)) > FAR


@pytest.mark.parametrize("powers", [(20, 0, 0), (-20, 8, 0), (0, -8, -20), (-12, 0, -12)])
def test_in_units_of_powers_of_two(powers):
    """Rounding errors are the same then, to the last bit. So nothing depends on a number of metres,
    kilograms or seconds in the program, if `atol`, which is one number for metres, radians and
    speeds, is zero. Seconds don't become smaller here: slow contacts are landed on to 1e-11 s."""
    numbers, scale = drawn(1), [2.0**power for power in powers]
    smaller = scaled(numbers, *scale)
    found, expected = (
        outcome(simulated(scene(n), state(n), n, n.end_time, atol=1e-300).final)
        for n in (smaller, numbers)
    )
    metre, _, second = scale
    for ours, theirs in zip(found, scaled_outcome(expected, metre, second), strict=True):
        assert np.array_equal(ours, theirs)


def backwards(found: cj.State) -> cj.State:
    """The state with all velocities reversed."""
    bodies = {
        name: cj.body_state(body.position, body.orientation, -body.velocity, -body.spin)
        for name, body in found.bodies.items()
    }
    return cj.State(bodies, found.entry_speeds)


def returned(seed: int, restitution: float) -> float:
    """How far from its start a motion without friction ends that is reversed at its end."""
    numbers = drawn(seed)._replace(friction=0.0, restitution=restitution)
    there = solved(numbers)
    assert len(there.impacts) > 1
    back = run(numbers, here=backwards(there.final))
    return apart(outcome(backwards(back)), numbers.start)


@few
@given(seed=seeds)
def test_backwards_at_restitution_one(seed):
    """Impacts amplify errors a hundred times, there and back."""
    assert returned(seed, 1.0) < 10.0 * CLOSE


def test_backwards_with_losses_differs():
    assert returned(1, 0.99) > FAR


@few
@given(seed=seeds, share=st.floats(0.05, 0.95))
@example(seed=1, share=None)
def test_split_in_time(seed, share):
    numbers = drawn(seed)
    middle = in_contact(numbers) if share is None else share * numbers.end_time
    half = run(numbers, end=middle)
    assert apart(outcome(run(numbers, here=half, begin=middle)), ended(numbers)) < CLOSE


def in_contact(numbers: Hinged) -> float:
    """A time in the middle of the first contact, s."""
    impacts = solved(numbers).impacts
    return 0.5 * float(impacts.onset[0] + impacts.separation[0])


def test_split_in_contact_without_its_memory_differs():
    numbers = drawn(1)
    middle = in_contact(numbers)
    half = cj.State(run(numbers, end=middle).bodies, state(numbers).entry_speeds)
    assert apart(outcome(run(numbers, here=half, begin=middle)), ended(numbers)) > FAR


@pytest.mark.slow
@few
@given(seed=seeds)
def test_in_other_coordinates(seed):
    numbers = drawn(seed)
    assert apart(ended(numbers, coordinates=cj.AbsoluteCoordinates()), ended(numbers)) < CLOSE


@pytest.mark.slow
def test_other_coordinates_of_another_mass_differ():
    numbers = drawn(1)
    wrong = numbers._replace(mass=1.01 * numbers.mass)
    assert apart(ended(wrong, coordinates=cj.AbsoluteCoordinates()), ended(numbers)) > FAR


@pytest.mark.parametrize("part", Outcome._fields)
def test_every_part_is_compared(part):
    numbers = drawn(1)
    there = numbers.start
    wrong = there._replace(**{part: 1.01 * getattr(there, part)})
    assert apart(wrong, there) > FAR and apart(there, there) == 0.0
