"""Residuals of a fit at given predictions, and with a prior."""

import numpy as np

import clearjoint as cj
from clearjoint._identification.comparison import _with_prior
from clearjoint._identification.residuals import UNREACHED, RunMisfit, samples

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
