"""Multiple shooting: pieces that become one motion, and the same estimates as a single run."""

import dataclasses
from dataclasses import dataclass

import numpy as np
import pytest

import clearjoint as cj
from clearjoint.identification import gauss_newton
from clearjoint.identification.multiple_shooting import identify as multiple_shooting
from studies.common.identification_problem import TRUTH, ideal
from studies.shooting import fits as shooting

Q = cj.quantities
STIFFNESS, START, END = 50.0, 0.3, 3.0
TIMES = np.linspace(0.05, END, 60)
CUTS = [0.7, 1.4, 2.2]
PARAMETERS = {"stiffness": cj.Parameter(lambda s: s.forces["spring"].stiffness, cj.Log())}


@dataclass(frozen=True)
class Found:
    coordinates: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray


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
    assert np.abs(pieces.gaps).max() < 1e-10
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


def test_a_window_out_of_reach_is_reached_in_halves(monkeypatch):
    arguments = *_oscillator(), _measured(), PARAMETERS, CUTS
    ends = []
    real = multiple_shooting.search_in_whole_steps

    def first_fails(evaluate, at, tolerance, most, tell):
        found, iterations, ending = real(evaluate, at, tolerance, most, tell)
        far = len(ends) == 1
        ends.append(iterations[-1])
        last = dataclasses.replace(iterations[-1], decrement=2.0) if far else iterations[-1]
        return found, (*iterations[:-1], last), ending

    monkeypatch.setattr(multiple_shooting, "search_in_whole_steps", first_fails)
    pieces = cj.identify_by_shots(*arguments, progress=False)
    reached = [window.end_time for window in pieces.fit.best.windows]
    assert reached == pytest.approx([0.7, 1.4, 1.05, 1.4, 2.2, 3.0])
    assert pieces.fit.ending is cj.Ending.CONVERGED


def _valley(at):
    """Rosenbrock's, a thousand times as steep: (1, 1) at the end of a curved valley."""
    x, y = at
    residuals = np.array([1e4 * (y - x * x), 1.0 - x])
    return Found(np.array(at), residuals, np.array([[-2e4 * x, 1e4], [-1.0, 0.0]]))


def test_whole_steps_leave_a_steep_valley_and_come_back():
    """By hand: the first step goes to x = 1 and leaves the valley, the second goes back to it."""
    found, iterations, ending = gauss_newton.search_in_whole_steps(
        _valley, np.array([-1.2, 1.44]), 1e-6, 20, lambda one: None
    )
    assert ending is cj.Ending.CONVERGED
    np.testing.assert_allclose(found.coordinates, 1.0, rtol=1e-12)
    assert [one.accepted for one in iterations] == [True, False, True]


def test_a_search_returns_to_the_best_where_steps_lead_nowhere():
    """The root of |x|: a whole step leads to its mirror image, a quarter of it half the way."""

    def root(at):
        value = 1e3 * np.sqrt(np.abs(at))
        return Found(np.array(at), value, np.diag(0.5 * value / at))

    found, iterations, ending = gauss_newton.search_in_whole_steps(
        root, np.array([1.0]), 1e-3, 300, lambda one: None
    )
    assert ending is cj.Ending.CONVERGED
    assert found.coordinates[0] == pytest.approx(0.0, abs=1e-8)
    assert iterations[1].coordinates[0] == pytest.approx(-1.0)
    assert not iterations[1].accepted


@pytest.mark.slow
def test_the_pendulum_over_five_horizons():
    """Probes over 0.187 s, where a single run is lost after 37 to 114 ms (test_horizon)."""
    clean, _ = ideal("probes", shooting.END)
    attempt, pieces = shooting.by_shots(clean.with_noise(np.random.default_rng(0)), shooting.END)
    assert np.abs(pieces.gaps).max() < 1e-8
    assert 0.95 < pieces.fit.chi_squared / pieces.fit.samples < 1.1
    for name, value in TRUTH.items():
        error = attempt.fit.standard_errors[name]
        assert abs(attempt.fit.estimates[name] - value) < 4.0 * error
    assert attempt.fit.standard_errors["young"] < 2e-3 * TRUTH["young"]
