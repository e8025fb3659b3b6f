"""Residuals of a fit of the double pendulum, and their derivatives."""

from functools import partial

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._identification.comparison import _with_prior
from clearjoint._identification.residuals import UNREACHED, experiment, run_misfit, samples
from tests.identification import test_identify
from tests.identification.test_identify import (
    END,
    PARAMETERS,
    PROBES,
    SCENE,
    STATE,
    TIMES,
    true_coordinates,
)

clean = test_identify.clean
draws = test_identify.draws


@pytest.fixture(scope="session")
def problem(draws):
    """Runs, data and coordinates near the truth."""
    runs = experiment(SCENE, STATE, PARAMETERS, PROBES, TIMES, 0.0, None)
    at = true_coordinates() + [0.02, -0.03, 0.01]
    return runs, samples(draws[0], len(runs.base.times)), at


@pytest.mark.slow
def test_jacobian_is_that_of_the_residuals(problem):
    """Central differences of the residuals themselves."""
    runs, data, at = problem
    found = run_misfit(runs, data, END, at)
    for k, step in enumerate(1e-4 * np.eye(3)):
        ahead, behind = (run_misfit(runs, data, END, at + s).residuals for s in (step, -step))
        difference = (ahead - behind) / 2e-4
        size = np.abs(found.jacobian[:, k]).max()
        assert np.abs(difference - found.jacobian[:, k]).max() < 1e-4 * size


@pytest.mark.slow
def test_runs_that_fail_leave_large_residuals_without_slope(problem, draws):
    runs, data, at = problem
    stopped = eqx.tree_at(lambda r: r.max_steps, runs, jnp.asarray(300, int))
    found = run_misfit(stopped, data, END, at)
    assert found.result == cj.RESULTS.max_steps_reached
    late = found.residuals == UNREACHED
    for series, weights in zip(late.reshape(2, -1), data.weights, strict=True):
        sampled = series[weights > 0.0]
        assert not sampled[0] and sampled[-1] and np.all(np.diff(sampled.astype(int)) >= 0)
    assert np.all(found.jacobian[late] == 0.0) and np.all(np.isfinite(found.jacobian))
    whole = run_misfit(runs, data, END, at)
    np.testing.assert_allclose(found.residuals[~late], whole.residuals[~late], rtol=0.0, atol=1e-9)


@pytest.mark.slow
def test_windows_have_a_prior_at_their_start(problem):
    """The prior is one more measurement of each coordinate, with `max_step` as noise."""
    runs, data, at = problem
    centre, deviations = at + [0.5, -1.0, 3.0], np.array([1.0, 2.0, np.inf])
    plain = run_misfit(runs, data, END, at)
    with_prior = _with_prior(partial(run_misfit, runs, data, END), centre, deviations, at)
    np.testing.assert_allclose(with_prior.residuals[-3:], [-0.5, 0.5, 0.0])
    np.testing.assert_array_equal(with_prior.jacobian[-3:], np.diag([1.0, 0.5, 0.0]))
    np.testing.assert_array_equal(with_prior.residuals[:-3], plain.residuals)


def test_times_of_series_may_differ_and_angles_have_a_period():
    early, late = np.array([0.1, 0.2]), np.array([0.2, 0.35])
    angle = cj.Series(cj.quantities.JointAngle("elbow"), early, [3.1, -3.1], 0.1)
    probe = cj.Series(PROBES["x"], late, [1.0, 2.0], 0.5)
    data = samples(cj.Measurements({"angle": angle, "probe": probe}), 4)
    predicted = np.array([[-3.1, -3.2, 9.0, 9.0], [9.0, 1.5, np.nan, 9.0]])
    found = data.residuals(predicted)
    turn = 2.0 * np.pi - 6.2
    np.testing.assert_allclose(found[0], [turn / 0.1, -1.0, 0.0, 0.0], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(found[1], [0.0, 1.0, UNREACHED, 0.0])
    assert data.count == 4 and data.until([0.1, 0.2, 0.35, 0.35], 0.2).count == 3
