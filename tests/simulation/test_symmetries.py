"""The same motion, looked at otherwise: turned, mirrored, reordered, in other units, backwards, at
another time, split in time, in other coordinates; `tests/test_renaming.py` has other names.

All but coordinates, which are slow for that, share one program."""

import jax
import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import clearjoint as cj
from tests.support import symmetry_transformations as symmetries
from tests.support.hinged import Hinged, hinged

CLOSE = 1e-7
"""Largest difference of a part of two states, over its size. Right runs are within 1e-9."""
few = settings(
    max_examples=5,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=list(HealthCheck),
)
seeds = st.integers(0, 10_000)
coordinate = st.floats(-1.0, 1.0).map(lambda x: round(x, 3))
vectors = st.tuples(coordinate, coordinate, coordinate).map(np.array)
directions = vectors.filter(lambda vector: np.linalg.norm(vector) > 0.1)


def mirror(normal: np.ndarray) -> np.ndarray:
    across = normal / np.linalg.norm(normal)
    return np.eye(3) - 2.0 * np.outer(across, across)


factors = st.floats(0.2, 5.0).map(lambda x: round(x, 3))
ABSOLUTE, JOINT = cj.AbsoluteCoordinates(), cj.JointCoordinates()


def run(made: Hinged, begin=0.0, end=None, coordinates=JOINT, atol=None) -> cj.results.Solution:
    """A run; all in the same coordinates share a program."""
    options = cj.Settings(
        rtol=1e-10,
        atol=atol,
        first_step=1e-4 * made.end_time,
        landing_tolerance=made.landing,
        coordinates=coordinates,
    )
    end, save = made.end_time if end is None else end, cj.Saving(impacts=True)
    return cj.simulate(made.scene, made.state, end, options, save, start_time=begin, progress=False)


def ended(made: Hinged, **options) -> cj.State:
    return run(made, **options).final


def parts(state: cj.State, names) -> dict[str, np.ndarray]:
    """Positions, rotation matrices, velocities and spins of bodies."""
    bodies = [state.bodies[name] for name in names]
    fields = ("position", "orientation", "velocity", "spin")
    found = {field: np.array([getattr(body, field) for body in bodies]) for field in fields}
    return found | {"orientation": symmetries.matrix(found["orientation"])}


def apart(found: cj.State, expected: cj.State) -> float:
    """The largest difference of a part, over the size of this part."""
    ours, theirs = (parts(state, expected.bodies) for state in (found, expected))
    return max(np.abs(ours[k] - theirs[k]).max() / np.abs(theirs[k]).max() for k in theirs)


def test_the_journal_meets_the_wall():
    """Or there would be little to compare."""
    assert len(run(hinged(0)).impacts) >= 2


Maps = tuple[np.ndarray, np.ndarray]
"""Matrices by which global vectors and the bodies' own are mapped."""


def mapped(made: Hinged, maps: Maps, moved) -> Hinged:
    scene = symmetries.turned(made.scene, by_name(maps), moved)
    return made._replace(scene=scene, state=mapped_state(made.state, maps, moved))


def mapped_state(state: cj.State, maps: Maps, moved) -> cj.State:
    turned = symmetries.turned_state(state, by_name(maps), moved)
    return cj.State(turned.bodies, state.entry_speeds)


def by_name(maps: Maps) -> dict[str, np.ndarray]:
    return dict(zip(("ground", "link", "arm"), (*maps, maps[1]), strict=True))


def mapping_error(seed: int, maps: Maps, moved) -> float:
    """How far a mapped scene ends from where the scene does."""
    made = hinged(seed)
    return apart(ended(mapped(made, maps, moved)), mapped_state(ended(made), maps, moved))


@few
@given(seed=seeds, turn=directions, frame=directions, sign=st.sampled_from((1, -1)), moved=vectors)
def test_turned_or_mirrored_and_moved_with_other_frames_of_bodies(seed, turn, frame, sign, moved):
    """Mirrored in a point, if the sign is negative."""
    maps = [sign * Rotation.from_rotvec(2.0 * by).as_matrix() for by in (turn, frame)]
    assert mapping_error(seed, (maps[0], maps[1]), moved) < CLOSE


@few
@given(seed=seeds)
def test_reordered(seed):
    made = hinged(seed)
    assert bits(ended(reordered(made))) == bits(ended(made))


def reordered(made: Hinged) -> Hinged:
    """The scene with its elements in the other order."""
    bodies, joints, states = (
        dict(reversed(family.items()))
        for family in (made.scene.bodies, made.scene.joints, made.state.bodies)
    )
    assert list(bodies) != list(made.scene.bodies)
    scene = cj.Scene(bodies, joints, gravity=made.scene.gravity)
    return made._replace(scene=scene, state=cj.State(states, made.state.entry_speeds))


def bits(found: cj.State) -> list[bytes]:
    return [np.asarray(leaf).tobytes() for leaf in jax.tree.leaves(found)]


def changed(made: Hinged, place, value) -> Hinged:
    """The mechanism with another number of its scene."""
    return made._replace(scene=cj.set_value(made.scene, place, value))


def scaled(made: Hinged, scale: symmetries.Scale) -> Hinged:
    """In units that are so many times smaller."""
    metre, _, second = scale
    scene, state = symmetries.in_units(made.scene, scale), scaled_state(made.state, scale)
    return Hinged(scene, state, second * made.end_time, metre * made.landing)


def scaled_state(state: cj.State, scale: symmetries.Scale) -> cj.State:
    return cj.State(symmetries.state_in_units(state, scale).bodies, state.entry_speeds)


@few
@given(seed=seeds, scale=st.tuples(factors, factors, factors))
def test_in_other_units(seed, scale):
    made = hinged(seed)
    assert apart(ended(scaled(made, scale)), scaled_state(ended(made), scale)) < CLOSE


@pytest.mark.parametrize("powers", [(20, 0, 0), (-20, 8, 0), (0, -8, -20), (-12, 0, -12)])
def test_in_units_of_powers_of_two(powers):
    """Rounding errors are the same then, to the last bit. So nothing depends on a number of metres,
    kilograms or seconds in the program, if `atol`, which is one number for metres, radians and
    speeds, is zero. Seconds don't become smaller here: slow contacts are landed on to 1e-11 s."""
    made, (metre, kilogram, second) = hinged(1), (2.0**power for power in powers)
    scale = metre, kilogram, second
    found = ended(scaled(made, scale), atol=1e-300)
    expected = scaled_state(ended(made, atol=1e-300), scale)
    assert bits(cj.State(found.bodies)) == bits(cj.State(expected.bodies))


def backwards(found: cj.State) -> cj.State:
    """The state with all velocities reversed."""
    bodies = {
        name: cj.body_state(body.position, body.orientation, -body.velocity, -body.spin)
        for name, body in found.bodies.items()
    }
    return cj.State(bodies, found.entry_speeds)


def returned(seed: int, restitution: float) -> float:
    """How far from its start a motion without friction ends that is reversed at its end."""
    made = changed(hinged(seed), lambda s: s.joints["pin"].friction.coefficient, 0.0)
    made = changed(made, lambda s: s.joints["pin"].law.restitution, restitution)
    there = run(made)
    assert len(there.impacts) > 1
    back = ended(made._replace(state=backwards(there.final)))
    return apart(backwards(back), made.state)


@few
@given(seed=seeds)
def test_backwards_at_restitution_one(seed):
    """Impacts amplify errors a hundred times, there and back."""
    assert returned(seed, 1.0) < 10.0 * CLOSE


@few
@given(seed=seeds, share=st.floats(0.05, 0.95))
@example(seed=1, share=None)
def test_split_in_time(seed, share):
    made = hinged(seed)
    middle = in_contact(made) if share is None else share * made.end_time
    half = ended(made, end=middle)
    assert apart(ended(made._replace(state=half), begin=middle), ended(made)) < CLOSE


@pytest.mark.parametrize("begin", [-3.5, 2.0**20])
def test_later_or_earlier(begin):
    """At 2^20 s times are rounded to 1e-10 s, in which an impacting journal moves a hundred landing
    tolerances."""
    made = hinged(1)
    assert apart(ended(made, begin=begin, end=begin + made.end_time), ended(made)) < CLOSE


def in_contact(made: Hinged) -> float:
    """A time in the middle of the first contact, s."""
    impacts = run(made).impacts
    return 0.5 * float(impacts.onset[0] + impacts.separation[0])


@pytest.mark.slow
@few
@given(seed=seeds)
def test_in_other_coordinates(seed):
    made = hinged(seed)
    assert apart(ended(made, coordinates=ABSOLUTE), ended(made)) < CLOSE
