"""Runs with backlash against closed forms and published numbers."""

import math

import numpy as np
import pytest

import clearjoint as cj
from studies.catalogue import plays
from studies.catalogue.plays import TIGHT
from tests.support.one_body import ORIGIN
from tests.support.shaft import angle_about

pytestmark = pytest.mark.slow


def spins(state: cj.State, *names: str) -> list[float]:
    return [float(state.bodies[name].spin[2]) for name in names]


def test_impacts_without_duration_are_those_of_time_stepping():
    """Moreau's steps take couples, too: the speeds after as many impacts as the stiff law's."""
    scene, state = plays.shafts(0.6)
    coarse = cj.simulate_nonsmooth(scene, state, 2e-3, step=1e-6, restitution=0.6)
    fine = cj.simulate(scene, state, 2e-3, TIGHT)
    names = ("a", "b")
    assert spins(coarse.final, *names) == pytest.approx(spins(fine.final, *names), rel=1e-6)


def test_assembly_puts_what_penetrates_into_the_middle_of_the_play():
    scene, state = plays.shafts(0.6)
    half = 0.5 * 0.3
    ahead = cj.body_state(ORIGIN, (math.cos(half), 0.0, 0.0, math.sin(half)))
    put = cj.assemble(scene, cj.State({**state.bodies, "b": ahead}))
    first, second = (angle_about(put.bodies[name]) for name in "ab")
    assert first == pytest.approx(second, abs=1e-9)


def test_the_arm_falls_through_its_play_and_rests_as_published():
    """From rest: accelerations are the inertia matrix's inverse times gravity's load. The matrix in
    the nominal pose is the toolbox's `inertia(qn)` less the rotors' 200e-6 kg m^2 times the
    squares of the gear ratios; a play is short, so that they hardly change. At rest the flanks
    carry the load."""
    play, law = 2e-5, cj.laws.ExactRestitution(0.1, 1e9, exponent=1.0)
    scene, state = cj.mechanisms.robot_arm(play=play, law=law)
    solution = cj.simulate(scene, state, 0.5, save=cj.Saving([1e-3, 0.5]))
    observed = cj.observe(scene, solution)
    rotors = 200e-6 * np.array((62.6111, 107.815, 53.7063)) ** 2
    published = [[3.6594, -0.4044, 0.1006], [-0.4044, 4.4137, 0.3509], [0.1006, 0.3509, 0.9378]]
    falls = -np.linalg.solve(published - np.diag(rotors), (0.0, 31.6399, 6.0351))
    for k, fall in zip((2, 3), falls[1:], strict=True):
        flank = observed.contacts[f"play {k}"]["lower flank"]
        depth = 0.05 * (0.5 * -fall * 1e-6 - 0.5 * play)
        assert flank.penetration[0] == pytest.approx(depth, abs=1e-10)
        assert flank.penetration_rate[0] == pytest.approx(0.05 * -fall * 1e-3, rel=3e-3)
    for k, load in ((2, 31.6399), (3, 6.0351)):
        flanks = observed.contacts[f"play {k}"]
        pressed = flanks["lower flank"].normal_force[1] - flanks["upper flank"].normal_force[1]
        assert pressed * 0.05 == pytest.approx(load, rel=1e-3)
