"""Bias, gain, drift and delay of sensors as parameters, on a mass on a spring in closed form."""

import numpy as np
import pytest

import clearjoint as cj
from tests.support.oscillator import on_spring

STIFFNESS, MASS, START, NOISE = 50.0, 2.0, 0.3, 1e-3
SCENE, STATE = on_spring("mass", STIFFNESS, MASS, START)
X, V = cj.quantities.Position("mass", "x"), cj.quantities.Velocity("mass", "x")
STIFF = cj.Parameter(lambda s: s.forces["spring"].stiffness, cj.Log())
TRUE = {"bias": 0.02, "gain": 0.95, "drift": -0.01, "delay": 0.013}
KINDS = {kind: getattr(cj.Parameter, kind) for kind in TRUE}
TIMES = np.linspace(0.05, 2.0, 60)


def reading(times, stiffness=STIFFNESS, bias=0.0, gain=1.0, drift=0.0, delay=0.0, derivative=False):
    rate = np.sqrt(stiffness / MASS)
    late = np.maximum(times - delay, 0.0)
    if derivative:
        return -gain * START * rate * np.sin(rate * late) + bias + drift * times
    return gain * START * np.cos(rate * late) + bias + drift * times


def jacobian(kinds, values, times=TIMES):
    """Return the derivatives of the reading by log stiffness and by the errors, (N, 1 + errors)."""
    points = [values | {kind: values[kind] + shift} for kind in kinds for shift in (1e-6, -1e-6)]
    rows = [reading(times, **point) for point in points]
    stiff = [reading(times, STIFFNESS * np.exp(shift), **values) for shift in (1e-6, -1e-6)]
    pairs = [stiff, *zip(rows[::2], rows[1::2], strict=True)]
    return np.stack([(up - down) / 2e-6 for up, down in pairs], axis=1)


def probe_of(values, seed=None):
    probe = cj.Series(X, TIMES, reading(TIMES, **values), NOISE)
    laser = cj.Series(V, TIMES, reading(TIMES, derivative=True), 10.0 * NOISE)
    data = cj.Measurements({"probe": probe, "laser": laser})
    return data if seed is None else data.with_noise(np.random.default_rng(seed))


def parameters_of(kinds):
    return {"stiffness": STIFF} | {kind: KINDS[kind]("probe") for kind in kinds}


@pytest.mark.slow
def test_predictions_of_accuracy_know_the_errors_of_sensors():
    kinds = ["gain", "drift", "bias"]
    parameters = {"stiffness": STIFF} | {
        kind: KINDS[kind]("probe", value=TRUE[kind]) for kind in kinds
    }
    values = {kind: TRUE[kind] for kind in kinds}
    rows = jacobian(kinds, values)
    found = cj.sensitivities(SCENE, STATE, 2.0, parameters, {"probe": X, "other": X}, TIMES)
    np.testing.assert_allclose(
        found.outputs["probe"], reading(TIMES, **values), rtol=0.0, atol=1e-8
    )
    np.testing.assert_allclose(found.outputs["other"], reading(TIMES), rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(found.derivatives["probe"], rows, atol=1e-6)
    probe = {"probe": cj.Sensor(X, TIMES, NOISE)}
    expected = NOISE * np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    report = cj.identifiability(SCENE, STATE, parameters, probe)
    np.testing.assert_allclose(report.deviations, expected, rtol=1e-5)


@pytest.mark.slow
def test_a_fit_estimates_all_errors_with_the_standard_errors_that_they_should_have():
    kinds = [*TRUE]
    fit = cj.identify(SCENE, STATE, probe_of(TRUE, 3), parameters_of(kinds), progress=False)
    rate = np.sqrt(STIFFNESS / MASS)
    laser = -START * rate * (np.sin(rate * TIMES) + rate * TIMES * np.cos(rate * TIMES)) / 2.0
    rows = np.vstack(
        [jacobian(kinds, TRUE) / NOISE, np.outer(laser / (10.0 * NOISE), [1, 0, 0, 0, 0])]
    )
    expected = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance)), expected, rtol=1e-2)
    for error, kind in zip(expected[1:], kinds, strict=True):
        assert abs(fit.estimates[kind] - TRUE[kind]) < 3.5 * error
        low, high = fit.intervals[kind]
        assert low < TRUE[kind] < high
    assert fit.scene.forces["spring"].stiffness == pytest.approx(STIFFNESS, 1e-2)
    assert fit.p_value > 1e-3
    assert fit.units == {"stiffness": "N/m", "bias": "m", "gain": "1", "drift": "m/s", "delay": "s"}
    assert fit.check.passed and fit.correlated == [] and fit.advice == []


@pytest.mark.parametrize("kind", [*TRUE])
def test_advice_names_the_error_of_the_sensor(kind):
    value = 0.9 if kind == "gain" else 2.0 * TRUE[kind]
    data = probe_of({kind: value}, 0)
    with pytest.warns(cj.PoorFitWarning):
        fit = cj.identify(SCENE, STATE, data, {"stiffness": STIFF}, progress=False, check_runs=0)
    (named,) = [sentence for sentence in fit.advice if "differs from the motion as if" in sentence]
    assert named.endswith(f"estimate it, by cj.Parameter.{kind}('probe') among the parameters.")
    shown = float(named.split(f"a {kind} of ")[1].split(",")[0].split()[0])
    assert shown == pytest.approx(value, rel=0.05)


@pytest.mark.slow
def test_the_horizon_of_a_fit_knows_the_errors_of_sensors():
    parameters = parameters_of(["bias", "drift", "gain"])
    probe = {"probe": cj.Sensor(X, TIMES, NOISE)}
    uncertainty = dict.fromkeys(parameters, 0.1)
    limits = cj.fit_horizon(SCENE, STATE, parameters, probe, uncertainty=uncertainty)
    rows = jacobian(["bias", "drift", "gain"], {"bias": 0.0, "drift": 0.0, "gain": 1.0})
    expected = NOISE * np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    np.testing.assert_allclose(limits.information.deviations, expected, rtol=1e-5)
    assert limits.single_shot == np.inf


@pytest.mark.slow
def test_a_posterior_and_a_minimisation_know_the_errors_of_sensors():
    parameters = parameters_of(["bias", "drift"])
    data = probe_of({"bias": 0.02, "drift": -0.01}, 0)
    spread = {"stiffness": 0.05, "bias": 0.01, "drift": 0.01}
    guess = {"bias": 0.02, "drift": -0.01}
    given = SCENE, STATE, data, parameters
    drawn = cj.posterior(*given, guess=guess, spread=spread, draws=100, progress=False)
    fit = cj.identify(*given, progress=False, check_runs=0)
    for name, error in fit.standard_errors.items():
        assert abs(drawn.means[name] - fit.estimates[name]) < 0.5 * error
        assert drawn.standard_deviations[name] == pytest.approx(error, rel=0.3)
    assert drawn.units == fit.units

    def squares(outputs):
        return ((outputs["x"] - reading(TIMES, bias=0.02)) ** 2).sum()

    bias = {"bias": cj.Parameter.bias("x", value=0.015, scale=cj.Linear(0.01))}
    found = cj.minimise(SCENE, STATE, squares, bias, {"x": X}, TIMES, iterations=60)
    assert found.estimates["bias"] == pytest.approx(0.02, rel=1e-2)


@pytest.mark.parametrize("kind", [*TRUE])
def test_an_error_of_a_sensor_belongs_to_measured_series(kind):
    of_series, data = KINDS[kind], probe_of({})
    with pytest.raises(ValueError, match=r"`series` must be names of series, but is \(\)"):
        of_series()
    axis = cj.Axis(of_series("probe").variation, [0.0])
    with pytest.raises(ValueError, match=f"A {kind} .of series 'probe'. is not a number of a scen"):
        cj.sweep(SCENE, STATE, 0.1, {"error": axis}, {"x": cj.Peak(X, "m")}, progress=False)
    twice = {"one": of_series("probe"), "two": of_series("probe")}
    with pytest.raises(ValueError, match=rf"`parameters\['two'\]` must be the only {kind} of its"):
        cj.identify(SCENE, STATE, data, twice, progress=False)
    lost, refused = {"lost": of_series("y")}, f"must be a {kind} of measured series: "
    with pytest.raises(ValueError, match=rf"`parameters\['lost'\]` {refused}probe, laser"):
        cj.identify(SCENE, STATE, data, lost, progress=False)
    # Derivatives of outputs have no delays.
    of_output = "A delay .of series 'y'. is not a number of a scene"
    with pytest.raises(ValueError, match=of_output if kind == "delay" else f"{refused}x"):
        cj.sensitivities(SCENE, STATE, 1.0, lost, {"x": X}, [0.5])


def test_an_error_with_a_unit_belongs_to_series_with_the_same():
    mixed = {"bias": cj.Parameter.bias("probe", "laser")}
    with pytest.raises(ValueError, match=r"`parameters\['bias'\]` must be an error of series with"):
        cj.identify(SCENE, STATE, probe_of({}), mixed, progress=False)
