"""Residuals and lanes of a fit with a delay."""

import numpy as np
import pytest

import clearjoint as cj
from clearjoint._identification.comparison import Comparison
from clearjoint._identification.residuals import experiment, run_misfit, samples
from tests.identification import test_delays
from tests.identification.test_delays import (
    LATE,
    NOISE,
    PARAMETERS,
    SCENE,
    STATE,
    STIFFNESS,
    TIMES,
    V,
    X,
    position,
    velocity,
)

data = test_delays.data


@pytest.mark.slow
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
