"""Runs with backlash against closed forms and published numbers."""

import math
from dataclasses import replace

import numpy as np
import pytest

import clearjoint as cj
from studies.catalogue import plays
from studies.catalogue.plays import INERTIAS, PLAY, RADIUS, SPEED, TIGHT
from tests.support.one_body import ORIGIN

pytestmark = pytest.mark.slow
IMPACTS = cj.Saving(impacts=True)


def shafts(law: cj.extend.AbstractContactLaw, play: float = PLAY) -> tuple[cj.Scene, cj.State]:
    """Two shafts on one axis with play; the first one turns."""
    scene, state = plays.shafts(1.0)
    joint = replace(scene.joints["play"], law=law, play=play)
    return replace(scene, joints={**scene.joints, "play": joint}), state


def turned(state: cj.State, name: str) -> float:
    """A body's angle about z, rad."""
    e0, _, _, e3 = state.bodies[name].orientation
    return 2.0 * math.atan2(e3, e0)


def spins(state: cj.State, *names: str) -> list[float]:
    return [float(state.bodies[name].spin[2]) for name in names]


@pytest.mark.parametrize("restitution", [1.0, 0.6])
def test_two_shafts_hit_each_other_as_their_inertias_and_restitution_say(restitution):
    """Speeds, times in flight and the energy lost, in closed form; the contacts of a linear spring
    of stiffness k at an effective mass m last pi sqrt(m/k) where they are elastic."""
    law = cj.laws.ExactRestitution(restitution, 1e8, exponent=1.0)
    scene, state = shafts(law)
    settings = replace(TIGHT, ledger=True)
    solution = cj.simulate(scene, state, 0.02, settings, IMPACTS)
    hits = solution.impacts
    count = len(hits)
    assert count >= 4
    entries = RADIUS * SPEED * restitution ** np.arange(count)
    np.testing.assert_allclose(hits.entry_speed, entries, rtol=1e-7)
    np.testing.assert_allclose(hits.onset[0], 0.5 * PLAY / SPEED, rtol=1e-9)
    flights = hits.onset[1:] - hits.separation[:-1]
    np.testing.assert_allclose(flights, RADIUS * PLAY / entries[1:], rtol=1e-6)
    assert list(hits.contact[:3]) == ["upper flank", "lower flank", "upper flank"]
    first, second = INERTIAS
    effective = first * second / (first + second) / RADIUS**2
    if restitution == 1.0:
        np.testing.assert_allclose(hits.duration, math.pi * math.sqrt(effective / 1e8), rtol=1e-6)
        peaks = entries * math.sqrt(effective * 1e8)
        np.testing.assert_allclose(hits.peak_force, peaks, rtol=1e-6)
    a, b = spins(solution.final, "a", "b")
    assert first * a + second * b == pytest.approx(first * SPEED, rel=1e-10)
    lost = 0.5 * effective * entries[0] ** 2 * (1.0 - restitution ** (2 * count))
    dissipated = float(solution.final.work["normal damping"])
    assert dissipated == pytest.approx(lost, rel=1e-6, abs=1e-12)


def test_many_turns_meet_the_same_play():
    """Two hundred turns a second: the flights are as long as those of shafts that hardly turn."""
    scene, state = shafts(cj.laws.ExactRestitution(1.0, 1e8, exponent=1.0))
    common = 400.0 * math.pi
    fast = cj.State(
        {
            name: cj.body_state(ORIGIN, spin=(0, 0, common + s))
            for name, s in (("a", SPEED), ("b", 0))
        }
    )
    runs = [cj.simulate(scene, start, 0.02, TIGHT, IMPACTS).impacts for start in (state, fast)]
    assert len(runs[0]) == len(runs[1]) >= 15
    np.testing.assert_allclose(runs[1].onset, runs[0].onset, rtol=1e-6)


def test_impacts_without_duration_are_those_of_time_stepping():
    """Moreau's steps take couples, too: the speeds after as many impacts as the stiff law's."""
    scene, state = shafts(cj.laws.ExactRestitution(0.6, 1e8, exponent=1.0))
    coarse = cj.simulate_nonsmooth(scene, state, 2e-3, step=1e-6, restitution=0.6)
    fine = cj.simulate(scene, state, 2e-3, TIGHT)
    names = ("a", "b")
    assert spins(coarse.final, *names) == pytest.approx(spins(fine.final, *names), rel=1e-6)


def test_assembly_puts_what_penetrates_into_the_middle_of_the_play():
    scene, state = shafts(cj.laws.ExactRestitution(0.6, 1e8, exponent=1.0))
    half = 0.5 * 0.3
    ahead = cj.body_state(ORIGIN, (math.cos(half), 0.0, 0.0, math.sin(half)))
    put = cj.assemble(scene, cj.State({**state.bodies, "b": ahead}))
    assert turned(put, "a") == pytest.approx(turned(put, "b"), abs=1e-9)


def test_gravity_loads_the_arm_as_published():
    """31.6399 and 6.0351 N m in the nominal pose (P. Corke, Robotics, Vision and Control, the
    toolbox's `gravload(qn)`)."""
    scene, state = cj.mechanisms.robot_arm(play=None)
    observed = cj.observe(scene, cj.simulate(scene, state, 1e-6, save=cj.Saving([0.0])))
    torques = [
        np.linalg.norm(observed.reactions[f"motor {k}"][f"link {k}"].moment[0]) for k in (1, 2, 3)
    ]
    np.testing.assert_allclose(torques, (0.0, 31.6399, 6.0351), atol=6e-5)


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
