"""Residuals of a fit: with errors of sensors, at given predictions, and with a prior."""

import numpy as np
import pytest

import clearjoint as cj
from clearjoint._identification.comparison import Comparison, _with_prior
from clearjoint._identification.residuals import (
    UNREACHED,
    RunMisfit,
    experiment,
    run_misfit,
    samples,
)
from tests.identification.test_sensor_errors import (
    NOISE,
    SCENE,
    STATE,
    STIFFNESS,
    TIMES,
    TRUE,
    V,
    X,
    jacobian,
    parameters_of,
    probe_of,
    reading,
)
from tests.support.slow import slow

DELAYS = 0.0, 0.1, -0.05
"""s: none, one longer than the first samples last, and a clock that is early."""


@pytest.mark.parametrize("seed", [0, *map(slow, range(1, 10))])
def test_values_and_derivatives_are_those_of_the_closed_form(seed):
    """Random errors in random order, in single runs and in runs side by side."""
    generator = np.random.default_rng(seed)
    kinds = [str(kind) for kind in generator.permutation([*TRUE])]
    draws = [{kind: TRUE[kind] * generator.uniform(0.5, 1.5) for kind in kinds} for _ in range(4)]
    for values, delay in zip(draws[1:], DELAYS, strict=True):
        values["delay"] = delay
    parameters, data = parameters_of(kinds), probe_of(TRUE)
    outputs = {"probe": X, "laser": V}
    runs = experiment(SCENE, STATE, parameters, outputs, TIMES, 0.0, cj.presets.identification)
    held = samples(data, len(runs.base.times))
    points = np.array([[np.log(STIFFNESS), *values.values()] for values in draws])
    lanes = Comparison(runs, held).chi_squared(points, 60)
    for point, values, lane in zip(points, draws, lanes, strict=True):
        found = run_misfit(runs, held, float(TIMES[-1]), point)
        np.testing.assert_allclose(
            found.predicted[0, :60], reading(TIMES, **values), rtol=0.0, atol=1e-8
        )
        # The errors of one sensor don't change the reading of the other.
        expected = reading(TIMES, derivative=True)
        np.testing.assert_allclose(found.predicted[1, :60], expected, rtol=0.0, atol=1e-7)
        slopes = found.jacobian.reshape(2, -1, 5)
        np.testing.assert_allclose(slopes[0, :60] * NOISE, jacobian(kinds, values), atol=2e-5)
        assert not slopes[1, :, 1:].any()
        np.testing.assert_allclose(lane[-1], found.chi_squared, rtol=1e-5)


PROBE = cj.quantities.JournalOffset("shoulder", "x")


def test_windows_have_a_prior_at_their_start():
    """The prior is one more measurement of each coordinate, with `max_step` as noise."""
    residuals, jacobian = np.array([0.3, -2.0]), np.arange(6.0).reshape(2, 3)

    def misfit(at):
        return RunMisfit(at, residuals, jacobian, np.zeros((1, 2)), cj.RESULTS.successful)

    at, centre = np.zeros(3), np.array([0.5, -1.0, 3.0])
    found = _with_prior(misfit, centre, np.array([1.0, 2.0, np.inf]), at)
    np.testing.assert_allclose(found.residuals, [0.3, -2.0, -0.5, 0.5, 0.0])
    np.testing.assert_array_equal(found.jacobian, [*jacobian, *np.diag([1.0, 0.5, 0.0])])


def test_times_of_series_may_differ_and_angles_have_a_period():
    early, late = np.array([0.1, 0.2]), np.array([0.2, 0.35])
    angle = cj.Series(cj.quantities.JointAngle("elbow"), early, [3.1, -3.1], 0.1)
    probe = cj.Series(PROBE, late, [1.0, 2.0], 0.5)
    data = samples(cj.Measurements({"angle": angle, "probe": probe}), 4)
    predicted = np.array([[-3.1, -3.2, 9.0, 9.0], [9.0, 1.5, np.nan, 9.0]])
    found = data.residuals(predicted)
    turn = 2.0 * np.pi - 6.2
    np.testing.assert_allclose(found[0], [turn / 0.1, -1.0, 0.0, 0.0], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(found[1], [0.0, 1.0, UNREACHED, 0.0])
    assert data.count == 4 and data.until([0.1, 0.2, 0.35, 0.35], 0.2).count == 3
