"""Delays of measured series as fitted parameters, on a mass on a spring in closed form."""

import numpy as np
import pytest

import clearjoint as cj
from clearjoint._identification.comparison import Comparison
from clearjoint._identification.residuals import experiment, run_misfit, samples

STIFFNESS, MASS, START, NOISE = 50.0, 2.0, 0.3, 1e-3
LATE = 0.013
TIMES = np.linspace(0.05, 2.0, 40)
X, V = cj.quantities.Position("mass", "x"), cj.quantities.Velocity("mass", "x")
SPRING = cj.SpringDamper("ground", "mass", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), STIFFNESS)
SCENE = cj.Scene({"mass": cj.Body(MASS, (1.0, 1.0, 1.0))}, forces={"spring": SPRING})
STATE = cj.State({"mass": cj.body_state((START, 0.0, 0.0))})
STIFF = cj.Parameter(lambda s: s.forces["spring"].stiffness, cj.Log())
PARAMETERS = {"stiffness": STIFF, "delay": cj.Parameter.delay("probe")}


def position(times, stiffness=STIFFNESS):
    return START * np.cos(np.sqrt(stiffness / MASS) * times)


def velocity(times, stiffness=STIFFNESS):
    rate = np.sqrt(stiffness / MASS)
    return -rate * START * np.sin(rate * times)


@pytest.fixture(scope="module")
def data():
    """The probe's clock is late, that of the other sensor is right."""
    return cj.Measurements(
        {
            "probe": cj.Series(X, TIMES, position(TIMES - LATE), NOISE),
            "laser": cj.Series(V, TIMES, velocity(TIMES), 10.0 * NOISE),
        }
    )


@pytest.mark.slow
def test_a_delay_is_estimated_with_the_error_that_it_should_have(data):
    noisy = data.with_noise(np.random.default_rng(0))
    fit = cj.identify(SCENE, STATE, noisy, PARAMETERS, progress=False)
    columns = [
        np.concatenate([(of(TIMES - d, STIFFNESS * 1.001) - of(TIMES - d)) / 1e-3 / n, moved])
        for of, d, n, moved in ((position, LATE, NOISE, []), (velocity, 0.0, 10.0 * NOISE, []))
    ]
    rate = -velocity(TIMES - LATE) / NOISE
    jacobian = np.stack([np.concatenate(columns), np.concatenate([rate, np.zeros(40)])], axis=1)
    expected = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    errors = np.sqrt(np.diag(fit.covariance))
    np.testing.assert_allclose(errors, expected, rtol=5e-3)
    assert abs(fit.estimates["delay"] - LATE) < 3.0 * expected[1]
    assert fit.units["delay"] == "s" and fit.check.passed and fit.p_value > 1e-3
    low, high = fit.intervals["delay"]
    assert low < LATE < high and fit.scene.forces["spring"].stiffness == pytest.approx(50.0, 1e-2)


def test_runs_side_by_side_and_with_derivatives_have_the_same_delays(data):
    outputs = {"probe": X, "laser": V}
    runs = experiment(SCENE, STATE, PARAMETERS, outputs, TIMES, 0.0, cj.presets.identification)
    held = samples(data, len(runs.times))
    points = np.log(STIFFNESS) * np.array([[1, 0]] * 4) + [
        [0, 0.0],
        [0, LATE],
        [0, 0.1],
        [0, -0.05],
    ]
    lanes = Comparison(runs, held).chi_squared(points, 40)
    for point, curve in zip(points, lanes, strict=True):
        found = run_misfit(runs, held, float(TIMES[-1]), point)
        seen = position(np.maximum(TIMES - point[1], 0.0))
        np.testing.assert_allclose(found.predicted[0, :40], seen, atol=1e-8)
        np.testing.assert_allclose(found.predicted[1, :40], velocity(TIMES), atol=1e-7)
        late = TIMES - point[1]
        rate = np.where(late > 0.0, -velocity(late), 0.0) / NOISE
        jacobian = found.jacobian.reshape(2, -1, 2)[..., 1]
        np.testing.assert_allclose(jacobian[0, :40], rate, atol=1e-2)
        assert not jacobian[1].any()
        assert curve[-1] == pytest.approx(found.chi_squared, rel=1e-5, abs=1e-3)


def test_a_delay_belongs_to_measured_series():
    delay = {"delay": cj.Parameter.delay("probe")}
    with pytest.raises(ValueError, match=r"`series` must be names of series, but is \(\)"):
        cj.Parameter.delay()
    with pytest.raises(ValueError, match="A delay .of series 'probe'. is not a number of a scene"):
        cj.sensitivities(SCENE, STATE, 1.0, delay, {"x": X}, [0.5])
    with pytest.raises(ValueError, match=r"`parameters\['delay'\]` must be a delay of measured"):
        experiment(SCENE, STATE, delay, {"x": X}, TIMES, 0.0, None)
    both = {"one": cj.Parameter.delay("x"), "two": cj.Parameter.delay("x")}
    with pytest.raises(ValueError, match=r"`parameters\['two'\]` must be the only delay of its"):
        experiment(SCENE, STATE, both, {"x": X}, TIMES, 0.0, None)
