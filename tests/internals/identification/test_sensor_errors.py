"""Residuals of a fit with errors of sensors, in single runs and side by side."""

import numpy as np
import pytest

import clearjoint as cj
from clearjoint._identification.comparison import Comparison
from clearjoint._identification.residuals import experiment, run_misfit, samples
from tests.identification.test_delays import SCENE, STATE, V, X
from tests.identification.test_sensor_errors import (
    NOISE,
    STIFFNESS,
    TIMES,
    TRUE,
    jacobian,
    parameters_of,
    probe_of,
    reading,
)


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 10))]
)
def test_values_and_derivatives_are_those_of_the_closed_form(seed):
    """Random errors in random order, in single runs and in runs side by side."""
    generator = np.random.default_rng(seed)
    kinds = [str(kind) for kind in generator.permutation([*TRUE])]
    values = {kind: TRUE[kind] * generator.uniform(0.5, 1.5) for kind in kinds}
    parameters, data = parameters_of(kinds), probe_of(TRUE)
    outputs = {"probe": X, "laser": V}
    runs = experiment(SCENE, STATE, parameters, outputs, TIMES, 0.0, cj.presets.identification)
    held = samples(data, len(runs.times))
    point = np.array([np.log(STIFFNESS), *values.values()])
    found = run_misfit(runs, held, float(TIMES[-1]), point)
    np.testing.assert_allclose(found.predicted[0, :60], reading(TIMES, **values), atol=1e-8)
    np.testing.assert_allclose(
        found.jacobian.reshape(2, -1, 5)[0, :60] * NOISE, jacobian(kinds, values), atol=2e-5
    )
    # The errors of one sensor don't change the reading of the other.
    assert not found.jacobian.reshape(2, -1, 5)[1, :, 1:].any()
    lanes = Comparison(runs, held).chi_squared(np.tile(point, (3, 1)), 60)
    np.testing.assert_allclose(lanes[:, -1], found.chi_squared, rtol=1e-5)
