"""Delays of measured series as fitted parameters, on a mass on a spring in closed form."""

import numpy as np
import pytest

import clearjoint as cj
from tests.support.oscillator import on_spring

STIFFNESS, MASS, START, NOISE = 50.0, 2.0, 0.3, 1e-3
LATE = 0.013
TIMES = np.linspace(0.05, 2.0, 40)
X, V = cj.quantities.Position("mass", "x"), cj.quantities.Velocity("mass", "x")
SCENE, STATE = on_spring("mass", STIFFNESS, MASS, START)
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
