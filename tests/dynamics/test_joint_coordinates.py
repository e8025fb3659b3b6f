"""Scenes that joint coordinates cannot move, turns, and redundant hinges in closed form."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import clearjoint as cj
from clearjoint import GROUND
from tests.support.one_body import ORIGIN, Z, hinge, one_body

ABSOLUTE, JOINT = cj.AbsoluteCoordinates(), cj.JointCoordinates()


def test_antiparallel_axes_are_refused_and_run_in_absolute_coordinates():
    joint = cj.RevoluteJoint(GROUND, "rod", ORIGIN, ORIGIN, Z, (0, 0, -1))
    scene, state = one_body("rod", {"pin": joint}, spin=Z)
    with pytest.raises(ValueError, match="AbsoluteCoordinates"):
        cj.simulate(scene, state, 0.1)
    solution = cj.simulate(scene, state, 0.1, cj.Settings(coordinates=ABSOLUTE))
    np.testing.assert_allclose(solution.final.bodies["rod"].orientation[3], np.sin(0.05))


def test_structure_without_motion_is_for_absolute_coordinates():
    foot = {"foot": cj.FixedJoint(GROUND, "wall", ORIGIN, ORIGIN)}
    scene, state = one_body("wall", foot, mass=2.0, gravity=(0, 0, -9.81))
    with pytest.raises(ValueError, match="a degree of freedom is left"):
        cj.simulate(scene, state, 0.1)
    settings = cj.Settings(coordinates=ABSOLUTE)
    solution = cj.simulate(scene, state, 0.1, settings, cj.Saving([0.1]))
    force = cj.observe(scene, solution).reactions["foot"]["wall"].force[0]
    np.testing.assert_allclose(force, (0, 0, 19.62), rtol=0.0, atol=1e-12)


def test_orientations_keep_their_sign_over_several_turns():
    """The Euler parameters of a wheel after 450 degrees are not those of 90 degrees."""
    scene, state = one_body("wheel", {"axle": hinge(GROUND, "wheel")}, spin=Z)
    end = cj.simulate(scene, state, 2.5 * np.pi, cj.Settings(rtol=1e-9)).final
    half = 1.25 * np.pi
    expected = (np.cos(half), 0.0, 0.0, np.sin(half))
    np.testing.assert_allclose(end.bodies["wheel"].orientation, expected, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("apart", [1.0, pytest.param(0.0, marks=pytest.mark.slow)])
def test_a_door_on_two_hinges_swings_as_on_one(apart):
    """The coordinates satisfy all rows of a hinge; the angle is that of a physical pendulum."""
    places = {"low": -apart, "high": apart}
    joints = {name: hinge("ground", "door", (0, 0, z), (-0.5, 0, z)) for name, z in places.items()}
    door = {"mass": 20.0, "inertia": (5.0, 6.0, 2.0), "position": (0.5, 0, 0)}
    scene, state = one_body("door", joints, gravity=(0, -9.81, 0), **door)
    final = cj.simulate(scene, state, 0.5, cj.Settings(rtol=1e-9)).final.bodies["door"]

    def rates(t, y):
        return [y[1], -20.0 * 9.81 * 0.5 * np.cos(y[0]) / (2.0 + 20.0 * 0.25)]

    angle = solve_ivp(rates, (0.0, 0.5), [0.0, 0.0], rtol=1e-11, atol=1e-12).y[0, -1]
    expected = 0.5 * np.array([np.cos(angle), np.sin(angle), 0.0])
    np.testing.assert_allclose(final.position, expected, rtol=0.0, atol=1e-7)


def test_reactions_of_redundant_constraints_have_least_norm():
    """The weight of a door on two hinges is shared equally along the common axis."""
    joints = {f"hinge {z}": hinge("ground", "door", (0, 0, z), (0, 0, z)) for z in (-0.5, 0.5)}
    scene, state = one_body("door", joints, mass=2.0, gravity=(0.0, 0.0, -9.81))
    solution = cj.simulate(scene, state, 1e-3, save=cj.Saving([1e-3]))
    observed = cj.observe(scene, solution)
    assert len(solution.redundant_constraints) == 5 and not observed.reactions_unique
    for name in joints:
        force = observed.reactions[name]["door"].force[0]
        np.testing.assert_allclose(force, (0.0, 0.0, 9.81), rtol=1e-6, atol=1e-9)
