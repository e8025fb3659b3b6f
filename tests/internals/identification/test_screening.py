"""Screening, on a mass on a spring over 16 periods: of its stiffness, chi squared has a minimum for
each number of periods, so that no slope leads from a far guess to the truth."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

import clearjoint as cj
from clearjoint._export.tables import duration
from clearjoint._identification import checking
from clearjoint._identification.comparison import Comparison
from clearjoint._identification.identify import _Problem
from clearjoint._identification.residuals import UNREACHED, experiment, samples
from tests.support.oscillator import on_spring

STIFFNESS, MASS, START, NOISE = 50.0, 2.0, 0.3, 0.01
TIMES = np.linspace(0.1, 20.0, 200)
LANES = 12
FAR = {"stiffness": 20.0}
CHANNEL = cj.quantities.Position("mass", "x")
PARAMETERS = {"stiffness": cj.Parameter(lambda s: s.forces["spring"].stiffness, cj.Log())}
SCENE, STATE = on_spring("mass", STIFFNESS, MASS, START)


def moved(stiffness):
    """Closed form."""
    return START * np.cos(np.sqrt(stiffness / MASS) * TIMES)


@pytest.fixture(scope="module")
def data():
    series = cj.Series(CHANNEL, TIMES, moved(STIFFNESS), NOISE)
    return cj.Measurements({"x": series.with_noise(np.random.default_rng(4))})


def side_by_side(data, **options):
    settings = replace(cj.presets.derivatives, rtol=1e-8, **options)
    runs = experiment(SCENE, STATE, PARAMETERS, {"x": CHANNEL}, TIMES, 0.0, settings)
    return Comparison(runs, samples(data, len(runs.base.times)), PARAMETERS)


def fitted(data, guess=None, progress=False, **options):
    return cj.identify(SCENE, STATE, data, PARAMETERS, guess=guess, progress=progress, **options)


fitted_from_far = partial(fitted, guess=FAR)


def poorly_fitted(data, **options):
    with pytest.warns(cj.PoorFitWarning, match="Standard errors are not valid"):
        return fitted(data, **options)


def test_chi_squared_over_time_is_that_of_the_closed_form(data):
    stiffnesses, lanes = np.geomspace(20.0, 130.0, LANES), side_by_side(data)
    assert lanes.count == 200 and lanes.time(0.0) == 0.0
    assert lanes.time(1.5) == TIMES[1] and lanes.time(2.0) == TIMES[1]
    residuals = np.array([(moved(k) - data["x"].values) / NOISE for k in stiffnesses])
    means = [np.convolve(row, np.full(10, 0.1))[:200] for row in residuals]
    for smoothing, expected, count in ((1, residuals, 200), (10, means, 150)):
        found = lanes.chi_squared(np.log(stiffnesses)[:, None], count, smoothing)
        assert found.shape == (LANES, count + 1) and (found[:, 0] == 0.0).all()
        sums = np.cumsum(np.square(expected), axis=1)[:, :count]
        np.testing.assert_allclose(found[:, 1:], sums, rtol=1e-3, atol=0.1)


def test_runs_that_end_early_count_as_far_off(data):
    lanes = side_by_side(data, max_steps=400)
    found = lanes.chi_squared(np.full((LANES, 1), np.log(STIFFNESS)), 200)[0]
    steps = np.diff(found)
    last = int(np.argmax(steps > 0.5 * UNREACHED**2))
    assert 10 < last < 190 and found[last] < 2.0 * last
    np.testing.assert_allclose(steps[last:], UNREACHED**2)


@pytest.fixture(scope="module")
def screened(data):
    starts = cj.Screening(40, spread=1.5, keep=10, finish=2, smoothing=1)
    return fitted_from_far(data, starts=starts)


def test_screening_finds_what_no_slope_leads_to(data, screened):
    lost = fitted_from_far(data)
    assert lost.chi_squared > 100.0 * screened.chi_squared
    low, high = screened.intervals["stiffness"]
    assert low < STIFFNESS < high and high - low < 0.01 * STIFFNESS
    assert screened.warnings == []
    (found,) = screened.screened
    assert found.complete and found.times[-1] == TIMES[-1]
    assert found.points.shape == (10, 1) and len(found.times) < 15
    assert found.runs >= 4 * 40 + (len(found.times) - 1) * (40 + 10)
    np.testing.assert_array_equal([s.start for s in screened.searches], found.starts)
    assert "starts from screening by" in str(screened)


def test_an_incomplete_screening_is_reported(data):
    starts = cj.Screening(40, spread=1.5, keep=10, smoothing=1, rounds=2)
    few = fitted_from_far(data, starts=starts)
    (warning,) = [text for text in few.warnings if text.startswith("Screening reached only")]
    assert warning.endswith(" s: increase its rounds.")
    (found,) = few.screened
    assert not found.complete and len(found.times) == 2


@pytest.mark.slow
def test_what_noise_does_not_explain_is_screened_anew(data):
    understated = cj.Measurements({"x": cj.Series(CHANNEL, TIMES, data["x"].values, NOISE / 2)})
    starts = cj.Screening(40, spread=1.5, keep=10, finish=1, smoothing=1, passes=2)
    fit = fitted_from_far(understated, starts=starts)
    first, second = fit.screened
    assert len(fit.searches) == 2 and first.starts != second.starts
    assert fit.estimates["stiffness"] == pytest.approx(STIFFNESS, rel=0.01)
    assert "noise is understated" in fit.warnings[-1]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"number": 0}, "`number` must be a whole number, positive, but is 0"),
        ({"smoothing": 0}, "`smoothing` must be a whole number, positive, but is 0"),
        ({"spread": -1.0}, "`spread` must be finite and positive, but is -1.0: pass the"),
        ({"spread": {"a": np.inf}}, "`spread` must be finite and positive, but is {'a': inf}"),
        ({"finish": 40}, "`keep` must be above 4, at least finish = 40, .*, but is 32"),
        ({"keep": 4}, "`keep` must be above 4"),
        ({"keep": 32.0}, "`keep` must be a whole number, positive, but is 32.0"),
        ({"keep": 1000}, "at most 4 times number, but is 1000: keep about a fifth of number"),
    ],
)
def test_invalid_settings_of_a_screening_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        cj.Screening(**settings)


def test_invalid_arguments_of_a_screening_are_refused(data):
    with pytest.raises(ValueError, match=r"`spread` must be values of estimated .*\['mass'\]"):
        fitted_from_far(data, starts=cj.Screening(spread={"mass": 1.0}))
    with pytest.raises(ValueError, match="`guess` must be one guess, for a screening, but"):
        fitted(data, [FAR, FAR], starts=cj.Screening())


EARLY, LATE = (TIMES > 0.75) & (TIMES < 2.05), TIMES > 18.45
UNEQUAL = np.where(EARLY, 0.15, np.where(LATE, 0.75, 1e3))
"""Noise, m, of samples of which early ones are precise and late ones make ripples; the others, as
good as none, are there to share the compiled runs of the tests above."""


@pytest.fixture(scope="module")
def rough():
    series = cj.Series(CHANNEL, TIMES, moved(STIFFNESS), UNEQUAL)
    return cj.Measurements({"x": series.with_noise(np.random.default_rng(6))})


def rough_curve(rough):
    """Stiffnesses on a fine grid that is even on the scale of the parameter, and chi squared."""
    grid = np.geomspace(STIFFNESS / np.e**2, STIFFNESS * np.e**2, 40001)
    return grid, (((moved(grid[:, None]) - rough["x"].values) / UNEQUAL) ** 2).sum(axis=1)


@pytest.mark.slow
def test_intervals_cover_the_minima_that_runs_around_the_estimate_find(rough, monkeypatch):
    """By chi squared in closed form on a fine grid: two minima, the lower one 8 standard errors
    from where a search from the truth ends. A posterior that would take too many runs fails no
    fit."""
    monkeypatch.setattr(checking, "MOST_RUNS", 1)
    fit = poorly_fitted(rough, check_runs=400)
    plain = fitted(rough, check_runs=0)
    grid, curve = rough_curve(rough)
    assert fit.posterior is None
    assert fit.chi_squared == pytest.approx(curve.min(), abs=0.01)
    assert fit.estimates["stiffness"] == pytest.approx(grid[curve.argmin()], rel=1e-3)
    assert fit.chi_squared < plain.chi_squared and plain.check is None
    allowed = grid[curve <= curve.min() + 3.84]
    assert fit.intervals["stiffness"] == pytest.approx((allowed[0], allowed[-1]), rel=0.01)
    assert fit.check.minima == 2 and len(fit.rivals) == 1
    first, second = str(fit).split("\n\n")[:2]
    assert first.startswith("Fit of 200 samples") and second == fit.warnings[0]
    assert f"with 2 minima ({fit.check.runs} runs around the estimates" in second


def test_a_check_costs_about_as_much_as_the_fit_unless_asked_for(rough):
    """In runs without derivatives, two of which cost as much as one with derivatives."""
    fit = poorly_fitted(rough)
    local = sum(search.evaluations for search in fit.check.searches)
    tested = len(fit.check.test.actual)
    explored = fit.check.runs - tested - local
    allowed = 2 * (sum(one.evaluations for one in fit.searches) + tested)
    # The first round, with one local search, and the last, more accurate search may exceed it.
    slack = checking.LEAST_NUMBER + 2 * 5 * checking.STEPS_DOWN
    assert explored + 2 * local <= allowed + slack and fit.posterior is None and fit.check.bounded
    assert fit.chi_squared == fit.check.exploration.lowest
    assert ("pass check_runs=400" in str(fit)) == (not fit.check.exploration.settled)


def test_durations_are_readable():
    shown = {0.0123: "0.012 s", 9.94: "9.9 s", 9.96: "10 s", 110.2: "110 s", 200.0: "3 min 20 s"}
    for seconds, text in shown.items():
        assert duration(seconds) == text
    assert duration(3599.9) == "1 h 0 min" and duration(119.6) == "2 min 0 s"


@pytest.mark.slow
def test_intervals_come_from_a_posterior_where_chi_squared_is_not_quadratic(rough):
    """Their probability by chi squared in closed form; equal bits in a second fit."""
    fit, again = (poorly_fitted(rough, check_runs=100) for _ in range(2))
    grid, curve = rough_curve(rough)
    distribution = np.cumsum(np.exp(-0.5 * (curve - curve.min())))
    low, high = np.interp(fit.intervals["stiffness"], grid, distribution / distribution[-1])
    assert 0.9 < high - low < 0.99 and low < 0.06 and high > 0.94
    assert fit.intervals["stiffness"][0] < STIFFNESS < fit.intervals["stiffness"][1]
    assert fit.intervals["stiffness"] == pytest.approx(fit.posterior.intervals["stiffness"])
    assert len(fit.posterior.weights) >= 2 and fit.posterior.runs <= 7500
    assert f"those of a posterior by {fit.posterior.runs} more runs" in str(fit).split("\n\n")[1]
    assert again.intervals == fit.intervals and again.posterior.runs == fit.posterior.runs


def raising(error):
    def fail(*_):
        raise error

    return fail


def test_an_interruption_in_the_posterior_keeps_the_fit(rough, monkeypatch):
    monkeypatch.setattr(checking, "drawn_posterior", raising(KeyboardInterrupt()))
    with pytest.raises(cj.FitInterrupted) as stopped:
        fitted(rough, check_runs=50)
    (fit,) = stopped.value.fits
    assert fit.check is None and fit.posterior is None and fit.chi_squared < 220.0


@pytest.mark.slow
def test_a_singular_cloud_has_no_posterior(rough, monkeypatch):
    singular = np.linalg.LinAlgError("Matrix is not positive definite")
    monkeypatch.setattr("clearjoint._identification.posterior.posterior.draw", raising(singular))
    fit = poorly_fitted(rough, check_runs=50)
    assert fit.posterior is None and fit.check is not None


def test_other_errors_of_the_posterior_are_not_hidden(rough, monkeypatch):
    monkeypatch.setattr(checking, "drawn_posterior", raising(ValueError("a defect")))
    with pytest.raises(ValueError, match="a defect"):
        fitted(rough, check_runs=50)


def test_a_valid_covariance_is_confirmed_by_few_runs(data, monkeypatch):
    monkeypatch.setattr(checking, "drawn_posterior", None)  # An additional run would fail.
    fit = fitted(data)
    assert fit.check.passed and fit.check.exploration is None and fit.doubts == []
    assert fit.posterior is None
    assert fit.check.runs == len(fit.check.test.actual) == 14
    np.testing.assert_allclose(fit.check.test.actual, fit.check.test.predicted, rtol=0.3, atol=0.3)
    assert "up to 4 standard errors away (14 runs around" in str(fit)


def test_an_interrupted_screening_has_no_fit(data, monkeypatch):
    monkeypatch.setattr(Comparison, "chi_squared", raising(KeyboardInterrupt()))
    with pytest.raises(cj.FitInterrupted, match="before the first run of a search") as stopped:
        fitted_from_far(data, starts=cj.Screening(40))
    assert stopped.value.fits == []


def test_fits_of_earlier_sets_are_not_the_best_of_an_interrupted_one(data, monkeypatch):
    options = {"guess": {"stiffness": 51.0}, "check_runs": 0, "progress": False}
    fit = fitted(data, **options)
    results = iter([(fit, False), (None, True)])
    monkeypatch.setattr(_Problem, "fit", lambda *_, show: next(results))
    with pytest.raises(cj.FitInterrupted, match="before the first run .* earlier sets") as stopped:
        cj.identify_many(SCENE, STATE, [data, data], PARAMETERS, **options)
    assert len(stopped.value.fits) == 1 and stopped.value.fits[0] is fit


@pytest.mark.parametrize("last", [2, 5])
def test_an_interrupted_fit_has_the_best_run_so_far(data, last):
    """In the first window, and in the one that grows from it."""
    seen = []

    def stop(iteration):
        seen.append(iteration)
        if len(seen) == last:
            raise KeyboardInterrupt

    with pytest.raises(cj.FitInterrupted, match="the best so far has chi squared") as stopped:
        fitted(data, {"stiffness": 48.0}, grow=(2.0,), progress=stop)
    (fit,) = stopped.value.fits
    assert fit.ending is cj.results.Ending.INTERRUPTED and fit.check is None
    assert "Not converged: it was interrupted" in str(fit)
    assert any(np.array_equal(fit.coordinates, one.coordinates) for one in seen)
    residuals = (moved(fit.estimates["stiffness"]) - data["x"].values) / NOISE
    assert fit.chi_squared == pytest.approx(np.sum(residuals**2), rel=1e-3)
    with pytest.raises(KeyboardInterrupt):
        raise stopped.value
