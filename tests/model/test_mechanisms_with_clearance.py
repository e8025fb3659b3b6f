"""Mechanisms with clearance in guides, slots and sockets: published motions and closed forms."""

import math
import warnings

import numpy as np
import pytest
from scipy.optimize import brentq

import clearjoint as cj
from tests.support.observations import penetrations
from tests.support.shaft import angle_about

FINE = cj.Settings(rtol=1e-10, atol=1e-12)


@pytest.mark.slow
def test_slider_in_its_guide_as_published():
    """Flores, Leine and Glocker's slider-crank. Until the first contact, of the corners 1 and 2,
    against an independent converged solution. Later against the rows at 0.01 and 0.05 s of
    Siconos' SliderCrankMoreauJeanCombinedProjectionOSI.ref: crank turns and crank speeds within two
    hundredths. Its scheme projects positions at steps of 0.1 ms; that of `simulate_nonsmooth` with
    rigid contacts, at shorter steps, agrees within two thousandths."""
    scene, state = cj.mechanisms.guided_slider_crank()
    save = cj.Saving([1e-3, 0.002692503, 0.01, 0.05], impacts=True)
    solution = cj.simulate(scene, state, 0.055, cj.Settings(rtol=1e-9), save=save)
    impacts, crank = solution.impacts, solution.states.bodies["crank"]
    assert set(impacts.contact[:2]) == {"rear upper", "front upper"}
    np.testing.assert_allclose(impacts.onset[:2], 0.002692503, rtol=2e-7)
    spin, turns = np.asarray(crank.spin)[:, 2], angle_about(crank) / (2.0 * math.pi)
    np.testing.assert_allclose(spin[:2], [139.1159, 109.5577], rtol=1e-6)
    assert turns[1] == pytest.approx(0.056548, rel=1e-5)
    rigid = cj.simulate_nonsmooth(scene, state, 0.055, step=2e-5, save=cj.Saving(save.times))
    rigid_spin = np.asarray(rigid.saved.states.bodies["crank"].spin)[:, 2]
    np.testing.assert_allclose(rigid_spin, spin, rtol=2e-3)
    np.testing.assert_allclose(spin[2:], [68.0890009, 68.7812286], rtol=0.02)
    np.testing.assert_allclose(turns[2:] % 1.0, [0.151616754, 0.770408323], rtol=0.02)


def first_contact(shaft: float, play: float, sense: float) -> float:
    """Angle of the output from the disc, rad, at which one of six pins reaches the wall of its
    hole: the distance of their centres is the eccentricity plus the play."""
    eccentricity, radius, disc = 1e-3, 25e-3, -shaft / 10
    found = []
    for around in disc + 2.0 * np.pi * np.arange(6) / 6:

        def distance(turn: float, around=around) -> float:
            pin = radius * np.exp(1j * (around + turn))
            hole = radius * np.exp(1j * around) + eccentricity * np.exp(1j * shaft)
            return abs(pin - hole) - eccentricity - play

        if distance(sense * 0.01) > 0.0:
            found.append(brentq(distance, 0.0, sense * 0.01, xtol=1e-16))
    return min(found, key=abs)


@pytest.mark.slow
@pytest.mark.parametrize("shaft", [0.0, 0.3, 2.0])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_the_backlash_of_a_cycloid_stage_is_that_of_its_pins(shaft, sense):
    """One pin touches at the angle at which the geometry has it touch, and the others are free."""
    play = 0.02e-3
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene, state = cj.mechanisms.cycloid_stage(play, angle=shaft)
    report = cj.constraint_report(scene, state)
    assert report.degrees_of_freedom() == 1
    assert np.abs(report.values).max() < 1e-12 and np.abs(report.rates).max() < 1e-12
    turn = first_contact(shaft, play, sense)
    # To first order by the formula of the docstring: a pin moves across its radius.
    directions = -shaft / 10 + np.pi / 2 + 2.0 * np.pi * np.arange(6) / 6
    cosine = np.abs(np.cos(directions - shaft)).max()
    assert abs(turn) == pytest.approx(play / 25e-3 / cosine, rel=0.02)
    angle = -shaft / 10 + turn
    output = cj.body_state((0.0, 0.0, 0.0), cj.rotation((0.0, 0.0, 1.0), angle))
    gaps = penetrations(scene, cj.State({**state.bodies, "output": output}))
    deepest = sorted(family["V"] for family in gaps.values())
    assert deepest[-1] == pytest.approx(0.0, abs=1e-14)
    assert deepest[-2] < -1e-7 or shaft == 0.0  # by symmetry, two pins touch at once then


@pytest.mark.slow
def test_a_cycloid_stage_transmits_with_the_ratio_of_its_lobes():
    """The torque keeps the output ahead of the disc by the backlash, at every angle of the
    shaft, and the disc rotates backwards by a tenth of it."""
    play, speed = 0.02e-3, 20.0
    scene, state = cj.mechanisms.cycloid_stage(play, speed=speed, torque=0.1)
    times = np.linspace(0.04, 0.1, 31)
    bodies = cj.simulate(scene, state, 0.1, FINE, cj.Saving(times), progress=False).states.bodies
    disc = angle_about(bodies["disc"])
    np.testing.assert_allclose(disc, -speed * times / 10, rtol=0.0, atol=1e-9)
    ahead = angle_about(bodies["output"]) - disc
    expected = [first_contact(speed * t, play, 1.0) for t in times]
    np.testing.assert_allclose(ahead, expected, rtol=1e-2)
    assert np.ptp(expected) > 0.1 * np.mean(expected)
