"""What a fit says of its estimates, on a straight line fitted by hand."""

import math
import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from scipy import signal, stats

import clearjoint as cj
from clearjoint import plot
from clearjoint._identification import goodness_of_fit as statistics
from clearjoint._identification.identify import warn_of
from clearjoint._identification.levenberg_marquardt import Search, WindowSearch
from clearjoint._identification.residuals import UNREACHED, RunMisfit
from clearjoint.results import Iteration
from tests.support.one_body import one_body

COUNT, NOISE = 200, 0.1
TIMES = np.linspace(0.01, 2.0, COUNT)


def path(scene):
    return scene.gravity[0]


PLAIN = {"offset": cj.Parameter(path, unit="m"), "slope": cj.Parameter(path, unit="m/s")}


def line(
    noise=NOISE, parameters=PLAIN, at=(1.0, 2.0), jacobian=None, ending=cj.results.Ending.CONVERGED
):
    """A fit of offset + slope * t to data of which the noise is 0.1; no run, but the algebra."""
    at, columns = np.array(at), np.column_stack([np.ones(COUNT), TIMES])
    predicted = columns @ at
    data = predicted + NOISE * np.random.default_rng(3).standard_normal(COUNT)
    series = cj.Series(cj.quantities.Position("arm 2", "x"), TIMES, data, noise)
    measurements = cj.Measurements({"laser": series})
    jacobian = columns / noise if jacobian is None else jacobian
    residuals, ended = (predicted - data) / noise, cj.RESULTS.successful
    best = RunMisfit(at, residuals, jacobian, predicted[None], ended)
    iteration = Iteration(0, True, best.chi_squared, at, 0.0, 1.0)
    search = Search(at, (WindowSearch(2.0, (iteration,), ending),), best)
    units = {n: getattr(p.variation, "unit", "s") for n, p in parameters.items()}
    scene, state = cj.mechanisms.double_pendulum()
    return cj.results.Fit(scene, state, parameters, units, measurements, (search,), search)


def test_errors_of_a_straight_line():
    """Closed form: variance of the slope is noise^2 / sum (t - mean)^2."""
    fit = line()
    spread = np.sum((TIMES - TIMES.mean()) ** 2)
    slope, offset = NOISE**2 / spread, NOISE**2 * (1 / COUNT + TIMES.mean() ** 2 / spread)
    assert fit.standard_errors["slope"] == pytest.approx(math.sqrt(slope), rel=1e-9)
    assert fit.standard_errors["offset"] == pytest.approx(math.sqrt(offset), rel=1e-9)
    correlation = -TIMES.mean() / math.sqrt(np.mean(TIMES**2))
    assert fit.correlation[0, 1] == pytest.approx(correlation, rel=1e-9)
    low, high = fit.intervals["slope"]
    assert (low, high) == pytest.approx(2.0 + 1.959964 * math.sqrt(slope) * np.array([-1, 1]))
    assert fit.degrees_of_freedom == COUNT - 2 and fit.estimates == {"offset": 1.0, "slope": 2.0}
    assert fit.warnings == []


def test_scales_carry_errors_to_values():
    scaled = {
        "offset": cj.Parameter(path, cj.Log(), unit="m"),
        "slope": cj.Parameter(path, cj.Bounded(0.0, 1.0), unit="m/s"),
    }
    fit, plain = line(parameters=scaled, at=(1.0, 4.0)), line(at=(1.0, 4.0))
    value = 1.0 / (1.0 + math.exp(-4.0))
    errors = plain.standard_errors
    assert fit.estimates["offset"] == pytest.approx(math.e)
    assert fit.standard_errors["offset"] == pytest.approx(math.e * errors["offset"])
    assert fit.standard_errors["slope"] == pytest.approx(value * (1 - value) * errors["slope"])
    low, high = line(parameters=scaled, at=(1.0, 4.0), jacobian=np.eye(COUNT, 2)).intervals["slope"]
    assert 0.0 < low < value < high < 1.0


@pytest.mark.parametrize(
    ("stated", "message"),
    [(0.5 * NOISE, " the noise is under"), (2 * NOISE, "the noise is overst")],
)
def test_mis_stated_noise(stated, message):
    fit = line(noise=stated)
    assert fit.p_value == pytest.approx(stats.chi2.sf(fit.chi_squared, COUNT - 2))
    (warning,) = fit.warnings
    assert message in warning
    assert fit.rms["laser"] == pytest.approx(NOISE / stated, rel=0.1)


def test_warnings_of_bounds_blindness_and_no_convergence():
    bounded = {**PLAIN, "slope": cj.Parameter(path, cj.Bounded(0.0, 0.5), unit="m/s")}
    assert "slope is at its bound 0.5." in line(parameters=bounded, at=(1.0, 9.0)).warnings
    twins = np.column_stack([np.ones(COUNT), -0.5 * np.ones(COUNT) + 1e-6 * TIMES])
    (warning,) = line(jacobian=twins).warnings
    assert "hardly determine the combination +0.5 offset +1 slope" in warning
    stalled = line(ending=cj.results.Ending.STALLED)
    assert stalled.warnings[0].startswith("Not converged: no step improves the fit")


def with_minima(*moves):
    """A fit of a line with further minima, each a move of the estimates and a chi squared above."""
    fit, found = line(), []
    for move, excess in moves:
        residuals = np.full(COUNT, np.sqrt((fit.chi_squared + excess) / COUNT))
        changes = {"coordinates": fit.coordinates + move, "residuals": residuals}
        found.append(replace(fit.best, best=replace(fit.best.best, **changes)))
    return replace(fit, searches=(fit.best, *found)), fit


def test_minima_that_the_data_allow_widen_intervals_and_are_reported():
    """Closed form: where chi squared of either is at most 1.959964^2 above the best."""
    both, fit = with_minima(([0.0, 0.1], 1.5), ([0.0, 0.11], 1.6), ([0.2, 0.0], 9.0))
    deviation = fit.standard_errors["slope"]
    low, high = both.intervals["slope"]
    first = 2.1 + math.sqrt(1.959964**2 - 1.5) * deviation
    second = 2.11 + math.sqrt(1.959964**2 - 1.6) * deviation
    assert low == pytest.approx(fit.intervals["slope"][0], abs=1e-9)
    assert high == pytest.approx(max(first, second), abs=1e-6)
    (rival,) = both.rivals
    assert rival == pytest.approx({"offset": 1.0, "slope": 2.1})
    (warning,) = both.warnings
    assert warning.startswith("Another minimum is only 1.5 higher in chi squared, at offset 1, slo")


def test_an_estimate_at_an_end_of_its_scale_went_there_from_the_start_of_its_own_search():
    scaled = {**PLAIN, "slope": cj.Parameter(path, cj.Log(), unit="m/s")}
    fit = line(parameters=scaled, jacobian=np.column_stack([np.ones(COUNT), 1e-6 * TIMES]))
    from_above, from_below = (
        replace(fit.best, start=fit.coordinates + [0.0, change]) for change in (9.0, -9.0)
    )
    fell = replace(fit, searches=(from_below, from_above), best=from_above).intervals["slope"]
    rose = replace(fit, searches=(from_above, from_below), best=from_below).intervals["slope"]
    assert fell[0] == 0.0 and math.isfinite(fell[1])
    assert rose[0] > 0.0 and math.isinf(rose[1])


def test_the_same_minimum_twice_is_no_rival():
    twice, fit = with_minima(([1e-9, 0.0], 1e-6))
    assert twice.rivals == [] and twice.warnings == []
    assert twice.intervals["slope"] == pytest.approx(fit.intervals["slope"], rel=1e-6)


def test_the_least_seen_direction():
    """Information with known axes: sizes 3 and 4 along coordinates, then a sum that is unseen."""
    seen = statistics.directions(np.diag([3.0, 4.0]))
    assert sorted(found.deviation for found in seen) == pytest.approx([0.25, 1.0 / 3.0])
    blind = statistics.directions(np.array([[1.0, 1.0], [1.0, 1.0], [2.0, 2.0]]))[0]
    np.testing.assert_allclose(blind.change, [1.0, -1.0], rtol=1e-6)
    assert blind.deviation > 1e10
    absent = statistics.directions(np.array([[1.0, 0.0], [2.0, 0.0]]))[0]
    np.testing.assert_allclose(absent.change, [0.0, 1.0], atol=1e-6)


@pytest.mark.slow
def test_whiteness_and_normality_have_the_probabilities_they_claim():
    """The tests reject 5 % of white normal noise, and always other noise."""
    generator = np.random.default_rng(1)
    draws = generator.standard_normal((800, 200))
    for test in (statistics.whiteness, statistics.normality):
        refused = np.mean([test(row) < 0.05 for row in draws])
        assert 0.03 < refused < 0.08
        assert math.isnan(test(draws[0][:10])) and math.isnan(test(np.zeros(200)))
    assert statistics.whiteness(np.convolve(draws[0], [1.0, 0.8], "valid")) < 1e-6
    assert statistics.normality(np.exp(draws[0])) < 1e-6


def test_figures_of_a_fit():
    fit = line()
    above, below = plot.fitted(fit)[:, 0]
    measured, fitted = above.lines
    np.testing.assert_allclose(fitted.get_ydata(), 1.0 + 2.0 * TIMES)
    np.testing.assert_allclose(measured.get_ydata(), fit.measurements["laser"].values)
    np.testing.assert_allclose(below.lines[0].get_ydata(), fit.residuals["laser"])
    assert (above.get_ylabel(), below.get_xlabel()) == ("laser, m", "time, s")
    axes = plot.correlations(fit)
    assert {text.get_text() for text in axes.texts} == {"1.00", f"{fit.correlation[0, 1]:.2f}"}
    with pytest.raises(ValueError, match="`series` must be names of series, but is .*from laser"):
        plot.fitted(fit, ["radar"])


def test_series_of_different_lengths_are_drawn_over_times_in_one_unit():
    quantity, ones, ends = cj.quantities.Position("arm 2", "x"), np.ones(5), (0.01, 2.0)
    series = {f"to {e} s": cj.Series(quantity, np.linspace(0.0, e, 5), ones, 1.0) for e in ends}
    measurements, numbers = cj.Measurements(series), dict.fromkeys(series, ones)
    model = SimpleNamespace(measurements=measurements, predictions=numbers, residuals=numbers)
    for below, end in zip(plot.fitted(model)[1], ends, strict=True):
        assert below.get_xlabel() == "time, s"
        assert below.lines[0].get_xdata()[-1] == pytest.approx(end)


def test_a_fit_is_a_table_by_parameter(tmp_path):
    fit = line()
    frame = fit.to_dataframe()
    assert frame.index.tolist() == list(fit.parameters)
    assert frame["estimate"].to_dict() == fit.estimates
    assert frame["standard_error"].to_dict() == fit.standard_errors
    assert frame["unit"].to_dict() == fit.units
    first, second = fit.parameters
    assert frame[f"correlation.{second}"][first] == fit.correlation[0, 1]
    assert frame["interval.high"][second] == fit.intervals[second][1]
    fit.to_netcdf(tmp_path / "fit.nc")
    with xr.open_dataset(tmp_path / "fit.nc", engine="scipy") as read:
        assert read.attrs["ending"] == "converged"
        np.testing.assert_array_equal(read["estimate"], frame["estimate"])


def with_data(change, count=1, ending=cj.results.Ending.CONVERGED, at=(1.0, 2.0), **options):
    """The straight line's fit, to data that are changed, of so many searches."""
    fit = line(ending=ending, at=at)
    laser = fit.measurements["laser"]
    data = change(np.asarray(laser.values).copy())
    measurements = cj.Measurements({"laser": cj.Series(laser.channel, TIMES, data, NOISE)})
    best = replace(fit.best.best, residuals=(fit.predictions["laser"] - data) / NOISE)
    search = replace(fit.best, best=best)
    options |= {"measurements": measurements, "searches": (search,) * count, "best": search}
    return replace(fit, **options)


def off(data):
    """Data that no straight line fits, from the first sample on."""
    return data + 5.0 * np.sin(20.0 * TIMES)


def saying(fit, text):
    """The sentences of the advice that contain a text."""
    return [sentence for sentence in fit.advice if text in sentence]


def test_a_fine_fit_needs_no_advice():
    assert line().advice == [] and "Remedies" not in str(line())


@pytest.mark.filterwarnings("ignore::clearjoint.LooseBodyWarning")
@pytest.mark.filterwarnings("ignore::clearjoint.PoorFitWarning")
@pytest.mark.parametrize("low", [None, 0.0, -np.pi])
def test_predicted_angles_are_in_the_revolution_of_the_measured_ones(low):
    """Also the advice about a late sensor is the same for angles that jump by a revolution."""
    torque = cj.DriveTorque("ground", "rotor", (0, 0, 1), cj.Polynomial((0.0, 1.2)))
    scene, state = one_body("rotor", forces={"drive": torque}, inertia=(0.01, 0.01, 0.01))
    times = np.linspace(0.03, 1.0, 60)
    # The closed form, late by 0.02 s.
    angles = 20.0 * (times - 0.02) ** 3 + 2e-3 * np.random.default_rng(0).normal(size=60)
    angles = angles if low is None else (angles - low) % (2.0 * np.pi) + low
    encoder = cj.Series(cj.quantities.Angle("rotor", (0, 0, 1)), times, angles, 2e-3)
    mass = {"mass": cj.Parameter(lambda scene: scene.bodies["rotor"].mass, cj.Log())}
    options = {"check_runs": 0, "max_iterations": 2, "progress": False}
    fit = cj.identify(scene, state, cj.Measurements({"encoder": encoder}), mass, **options)
    expected = 20.0 * (times**3 - (times - 0.02) ** 3)
    np.testing.assert_allclose(fit.predictions["encoder"] - angles, expected, atol=0.02)
    (advice,) = saying(fit, "as if its clock and trigger had a delay of 0.0")
    assert float(advice.split("a delay of ")[1].split(" s")[0]) == pytest.approx(0.02, rel=0.1)


def test_advice_to_grow_windows_where_the_run_deviates():
    fit = with_data(lambda data: data + np.where(TIMES > 1.0, 5.0 * np.sin(9.0 * TIMES), 0.0))
    until = float(saying(fit, "grow=")[0].split("up to ")[1].split(" s")[0])
    assert 0.8 < until <= 1.05
    words = "grow=", "cj.fit_horizon", "cj.Starts", "Parameter.initial"
    order = [fit.advice.index(saying(fit, word)[0]) for word in words]
    assert order == sorted(order)
    assert f"1. {fit.advice[0]}" in str(fit)


def test_advice_to_grow_windows_and_check_the_scene_where_the_first_samples_deviate():
    fit = with_data(off)
    (advice,) = saying(fit, "from the first samples on")
    first, end = TIMES[0], TIMES[-1]
    ends = [float(one) for one in advice.split("grow=(")[1].split(")")[0].split(", ")]
    np.testing.assert_allclose(ends, first + (end - first) * np.array([1, 2, 4, 8, 16]) / 20, 1e-3)
    assert "the scene, the initial state or a unit is wrong" in advice
    search = replace(fit.best, windows=fit.best.windows * 2)
    again = replace(fit, best=search, searches=(search,))
    (advice,) = saying(again, "from the first samples on")
    assert "were fitted first" in advice and f"grow=({ends[0]:.4g}, ...)" in advice


def test_white_residuals_are_noise():
    generator = np.random.default_rng(0)
    fit = with_data(lambda data: data + 4.0 * NOISE * generator.standard_normal(COUNT))
    assert "a noise 3.88 times" in fit.advice[0]


def test_outliers_are_seen_and_what_parameters_make_up_for_is_no_error_of_sensors():
    def spoilt(data):
        data[[20, 90]] += 8.0
        return data

    (outliers,) = saying(with_data(spoilt), "outliers")
    assert outliers.startswith("4 of 200 samples contribute 9")
    assert f"{TIMES[20]:.6g} s" in outliers or f"{TIMES[90]:.6g} s" in outliers
    # A shift of a straight line is one of its offset, which is a parameter already.
    assert not saying(with_data(lambda data: data - 2.0 * 0.3), "cj.Parameter.delay")


def test_samples_that_a_failed_run_does_not_reach_are_no_outliers():
    fit = line(ending=cj.results.Ending.FAILED)
    residuals = fit.best.best.residuals.copy()
    residuals[-2:] = UNREACHED
    best = replace(fit.best.best, residuals=residuals, result=cj.RESULTS.max_steps_reached)
    fit = replace(fit, best=replace(fit.best, best=best))
    np.testing.assert_array_equal(fit.residuals["laser"], residuals)
    assert not saying(fit, "outliers") and not saying(fit, "late")


@pytest.mark.parametrize(("limit", "advised"), [(TIMES[-1], True), (np.inf, False)])
def test_a_record_that_ends_at_its_horizon_is_too_long(limit, advised):
    fit = with_data(off, horizon=SimpleNamespace(single_shot=limit))
    assert bool(saying(fit, "that ends before 2 s")) == advised


def test_what_was_tried_already_is_not_advised():
    several = with_data(off, 3)
    assert "one minimum" in saying(several, "3 searches ended")[0]
    assert not saying(several, "cj.Starts")
    free = {"offset": cj.Parameter.initial(lambda state: state.bodies["arm 2"].spin[2])}
    assert not saying(with_data(off, parameters=PLAIN | free), "Parameter.initial")
    assert saying(with_data(off, ending=cj.results.Ending.EXHAUSTED), "max_iterations")


def test_a_poor_fit_is_warned_of_once():
    fine, poor = line(), with_data(off)
    with pytest.warns(cj.PoorFitWarning, match="2 of 3 fits are") as caught:
        warn_of([fine, poor, poor])
    assert len(caught) == 1 and "1. " in str(caught[0].message)
    with warnings.catch_warnings(action="error"):
        warn_of([fine])


def coloured(correlation, count, generator):
    """Return noise of unit variance, (count,), whose samples k apart have correlation**k."""
    white = np.sqrt(1.0 - correlation**2) * generator.standard_normal(count)
    white[0] = generator.standard_normal()
    return signal.lfilter([1.0], [1.0, -correlation], white)


def coverage(correlation, seeds):
    """Return the shares of 95 % intervals that hold the truth, with and without the widening."""
    held, plain = [], []
    for seed in range(seeds):
        noise = coloured(correlation, COUNT, np.random.default_rng(seed))
        data = 1.0 + 2.0 * TIMES + NOISE * noise
        slope, offset = np.polyfit(TIMES, data, 1)
        fit = with_data(lambda _: data, at=(offset, slope))  # noqa: B023
        low, high = np.array([*fit.intervals.values()]).T
        held.append((low < [1.0, 2.0]) & (high > [1.0, 2.0]))
        errors = np.sqrt(np.diag(fit.best.best.covariance))
        plain.append(np.abs(np.array([offset, slope]) - [1.0, 2.0]) < 1.96 * errors)
    return np.mean(held), np.mean(plain)


SHARES = {0.0: 0.9, 0.5: 0.88, 0.8: 0.86, 0.9: 0.84}
"""Of the intervals that hold the truth, at least, by the correlation."""


@pytest.mark.parametrize(
    ("seeds", "shares"),
    [(25, {0.0: 0.9, 0.8: 0.8}), pytest.param(500, SHARES, marks=pytest.mark.slow)],
    ids=["few draws", "many draws"],
)
def test_intervals_hold_the_truth_where_noise_is_coloured(seeds, shares):
    for correlation, least in shares.items():
        held, plain = coverage(correlation, seeds)
        assert held > least and (correlation == 0.0 or plain < held - 0.1), correlation


@pytest.mark.parametrize("correlation", [-0.6, 0.5, 0.9])
def test_correlated_noise_is_that_of_the_process(correlation):
    noise = coloured(correlation, 20000, np.random.default_rng(0))
    found = statistics.correlated_noise(noise)
    np.testing.assert_allclose(found.autocovariances[:5], correlation ** np.arange(5), atol=0.05)
    # The variance of the mean of N samples is (1 + r)/(1 - r)/N.
    mean = np.full((20000, 1), 1.0 / 20000)
    expected = (1.0 + correlation) / (1.0 - correlation) / 20000
    assert found.gradient_covariance(mean)[0, 0] == pytest.approx(expected, rel=0.15)
    effective = (1.0 - correlation**2) / (1.0 + correlation**2) * 20000
    assert found.effective == pytest.approx(effective, rel=0.1)


def test_a_report_begins_with_correlated_residuals():
    noise = coloured(0.9, COUNT, np.random.default_rng(0))
    fit = with_data(lambda data: data + 2.0 * NOISE * noise)
    assert fit.correlated == ["laser"] and fit.whiteness["laser"] < 1e-3
    assert fit.widening.min() > 2.0
    np.testing.assert_allclose(fit.correlation, line().correlation)
    ratio = fit.standard_errors["slope"] / line().standard_errors["slope"]
    assert ratio == pytest.approx(fit.widening[1])
    assert str(fit).split("\n\n")[1].startswith("Residuals are not white in 'laser' (p = ")
    assert fit.warnings[0].startswith("Residuals are not white")
