"""Joint coordinates against absolute ones, conservation laws and the reference."""

import equinox as eqx
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import clearjoint as cj
from clearjoint import GROUND
from tests.support.reference import CASES

RANDOM = np.random.default_rng(11)
ABSOLUTE, JOINT = cj.AbsoluteCoordinates(), cj.JointCoordinates()
TURN = RANDOM.normal(size=4)
TURN /= np.linalg.norm(TURN)


def _first_impacts(coordinates):
    """The pendulum through its first impacts, saved at the times of the reference."""
    scene, state = cj.mechanisms.double_pendulum()
    times = np.linspace(0.0, 0.1, 1001)
    settings = cj.Settings(rtol=1e-11, coordinates=coordinates)
    return scene, cj.simulate(scene, state, 0.1, settings, cj.Saving(times))


@pytest.fixture(scope="module")
def run():
    return _first_impacts(JOINT)


@pytest.mark.slow
def test_trajectories_agree_within_the_horizon(run):
    _, joint = run
    _, absolute = _first_impacts(ABSOLUTE)
    for name, expected in absolute.states.bodies.items():
        found = joint.states.bodies[name]
        np.testing.assert_allclose(found.position, expected.position, rtol=0, atol=1e-9)
        np.testing.assert_allclose(found.orientation, expected.orientation, rtol=0, atol=1e-8)


def test_reactions_of_the_eliminated_hinge_are_those_of_the_reference(run, reference_folder):
    scene, joint = run
    observed = cj.observe(scene, joint)
    reference = CASES[0].trajectory(reference_folder)
    force = np.stack([reference[f"R{axis}"][: len(joint.times)] for axis in "xyz"], axis=-1)
    scale = np.abs(force).max()
    np.testing.assert_allclose(
        observed.reactions["elbow"]["arm 3"].force, force, rtol=0, atol=1e-6 * scale
    )
    np.testing.assert_allclose(
        observed.reactions["elbow"]["arm 2"].force, -force, rtol=0, atol=1e-6 * scale
    )
    assert observed.drift["elbow"].max() < 1e-15 and observed.drift_rate["elbow"].max() < 1e-14


def test_state_that_violates_an_eliminated_joint_is_refused():
    scene, state = cj.mechanisms.double_pendulum()
    apart = eqx.tree_at(lambda s: s.bodies["arm 3"].position, state, np.array([1.0, 1e-3, 0.5]))
    with pytest.raises(ValueError, match="elbow: translation y"):
        cj.simulate(scene, apart, 0.1)


def test_antiparallel_axes_are_refused_and_run_in_absolute_coordinates():
    joint = cj.RevoluteJoint(GROUND, "rod", (0, 0, 0), (0, 0, 0), (0, 0, 1), (0, 0, -1))
    scene = cj.Scene({"rod": cj.Body(1.0, (1.0, 1.0, 1.0))}, {"pin": joint})
    state = cj.State({"rod": cj.body_state((0, 0, 0), spin=(0, 0, 1.0))})
    with pytest.raises(ValueError, match="AbsoluteCoordinates"):
        cj.simulate(scene, state, 0.1)
    solution = cj.simulate(scene, state, 0.1, cj.Settings(coordinates=ABSOLUTE))
    np.testing.assert_allclose(solution.final.bodies["rod"].orientation[3], np.sin(0.05))


def test_structure_without_motion_is_for_absolute_coordinates():
    joint = cj.FixedJoint(GROUND, "wall", (0, 0, 0), (0, 0, 0))
    wall = cj.Body(2.0, (1.0, 1.0, 1.0))
    scene = cj.Scene({"wall": wall}, {"foot": joint}, gravity=(0, 0, -9.81))
    state = cj.State({"wall": cj.body_state((0, 0, 0))})
    with pytest.raises(ValueError, match="a degree of freedom is left"):
        cj.simulate(scene, state, 0.1)
    solution = cj.simulate(
        scene, state, 0.1, cj.Settings(coordinates=ABSOLUTE), save=cj.Saving([0.1])
    )
    force = cj.observe(scene, solution).reactions["foot"]["wall"].force[0]
    np.testing.assert_allclose(force, (0, 0, 19.62), atol=1e-12)


def test_orientations_keep_their_sign_over_several_turns():
    """The Euler parameters of a wheel after 450 degrees are not those of 90 degrees."""
    joint = cj.RevoluteJoint(GROUND, "wheel", (0, 0, 0), (0, 0, 0), (0, 0, 1), (0, 0, 1))
    scene = cj.Scene({"wheel": cj.Body(1.0, (1.0, 1.0, 1.0))}, {"axle": joint})
    state = cj.State({"wheel": cj.body_state((0, 0, 0), spin=(0, 0, 1.0))})
    end = cj.simulate(scene, state, 2.5 * np.pi, cj.Settings(rtol=1e-9)).final
    half = 1.25 * np.pi
    expected = (np.cos(half), 0.0, 0.0, np.sin(half))
    np.testing.assert_allclose(end.bodies["wheel"].orientation, expected, atol=1e-9)


@pytest.mark.parametrize("apart", [1.0, pytest.param(0.0, marks=pytest.mark.slow)])
def test_a_door_on_two_hinges_swings_as_on_one(apart):
    """The coordinates satisfy all rows of a hinge; the angle is that of a physical pendulum."""
    places = {"low": -apart, "high": apart}
    joints = {
        name: cj.RevoluteJoint("ground", "door", (0, 0, z), (-0.5, 0, z), (0, 0, 1), (0, 0, 1))
        for name, z in places.items()
    }
    scene = cj.Scene({"door": cj.Body(20.0, (5.0, 6.0, 2.0))}, joints, gravity=(0, -9.81, 0))
    state = cj.State({"door": cj.body_state((0.5, 0, 0))})
    final = cj.simulate(scene, state, 0.5, cj.Settings(rtol=1e-9)).final.bodies["door"]

    def rates(t, y):
        return [y[1], -20.0 * 9.81 * 0.5 * np.cos(y[0]) / (2.0 + 20.0 * 0.25)]

    angle = solve_ivp(rates, (0.0, 0.5), [0.0, 0.0], rtol=1e-11, atol=1e-12).y[0, -1]
    expected = 0.5 * np.array([np.cos(angle), np.sin(angle), 0.0])
    np.testing.assert_allclose(final.position, expected, atol=1e-7)
