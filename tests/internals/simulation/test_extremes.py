"""The error of a rejected step."""

import numpy as np

from clearjoint._simulation.step.trial_step import REJECTED_ERROR


def test_rejected_errors_fit_into_single_precision():
    assert np.isfinite(np.float32(REJECTED_ERROR))
