"""Multiple shooting: pieces that become one motion, and the same estimates as a single run."""

import numpy as np
import pytest

import clearjoint as cj

Q = cj.quantities
STIFFNESS, START, END = 50.0, 0.3, 3.0
TIMES = np.linspace(0.05, END, 60)
CUTS = [0.7, 1.4, 2.2]
PARAMETERS = {"stiffness": cj.Parameter(lambda s: s.forces["spring"].stiffness, cj.Log())}


def _oscillator(stiffness=STIFFNESS):
    origin = (0.0, 0.0, 0.0)
    spring = cj.SpringDamper("ground", "mass", origin, origin, stiffness)
    scene = cj.Scene({"mass": cj.Body(2.0, (1.0, 1.0, 1.0))}, forces={"spring": spring})
    return scene, cj.State({"mass": cj.body_state((START, 0.0, 0.0))})


def _measured(noise=1e-3):
    """The closed form, x = x0 cos(sqrt(k/m) t), with noise."""
    exact = START * np.cos(np.sqrt(STIFFNESS / 2.0) * TIMES)
    series = cj.Series(Q.Position("mass", "x"), TIMES, exact, noise)
    return cj.Measurements({"x": series.with_noise(np.random.default_rng(5))})


@pytest.fixture(scope="module")
def fits():
    scene, state = _oscillator(1.02 * STIFFNESS)
    single = cj.identify(scene, state, _measured(), PARAMETERS, progress=False)
    pieces = cj.identify_by_shots(scene, state, _measured(), PARAMETERS, CUTS, progress=False)
    return single, pieces


def test_pieces_become_one_motion(fits):
    _, pieces = fits
    assert pieces.fit.ending is cj.Ending.CONVERGED
    np.testing.assert_array_equal(pieces.boundaries, CUTS)
    assert pieces.gaps.shape == (3, 13)
    assert np.abs(pieces.gaps).max() < 1e-8
    assert "4 windows, gaps between them at most" in str(pieces)


def test_estimates_and_errors_are_those_of_a_single_run(fits):
    single, pieces = fits
    error = single.standard_errors["stiffness"]
    assert pieces.fit.standard_errors["stiffness"] == pytest.approx(error, rel=1e-3)
    difference = pieces.fit.estimates["stiffness"] - single.estimates["stiffness"]
    assert abs(difference) < 1e-2 * error
    assert pieces.fit.chi_squared == pytest.approx(single.chi_squared, rel=1e-4)
    assert abs(single.estimates["stiffness"] - STIFFNESS) < 4.0 * error


@pytest.mark.parametrize("factor", [0.3, 4.0])
def test_a_guess_far_off_is_led_back_where_a_single_run_goes_astray(factor):
    """The phase is wrong by more than a turn in the end, but not within a window."""
    arguments = *_oscillator(factor * STIFFNESS), _measured(), PARAMETERS
    single = cj.identify(*arguments, progress=False)
    pieces = cj.identify_by_shots(*arguments, CUTS, progress=False)
    error = pieces.fit.standard_errors["stiffness"]
    assert abs(single.estimates["stiffness"] - STIFFNESS) > 100.0 * error
    assert abs(pieces.fit.estimates["stiffness"] - STIFFNESS) < 4.0 * error


@pytest.mark.parametrize("boundaries", [[], [1.4, 0.7], [0.7, 5.0]])
def test_boundaries_that_cut_nothing_are_refused(boundaries):
    with pytest.raises(ValueError, match="`boundaries` must be rising times between"):
        cj.identify_by_shots(*_oscillator(), _measured(), PARAMETERS, boundaries)
