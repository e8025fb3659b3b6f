"""Standard errors of quantiles."""

import numpy as np
import pytest

from clearjoint._statistics.ensemble import _quantile_errors


@pytest.mark.parametrize("draws", [5, 20, 100])
@pytest.mark.parametrize("shape", ["standard_normal", "standard_exponential", "random"])
def test_standard_errors_of_quantiles_are_those_of_many_ensembles_or_nan(draws, shape):
    """Formerly 0.06 to 0.6 of them at levels that few draws do not reach."""
    levels = np.array([0.01, 0.05, 0.5, 0.95, 0.99])
    runs = getattr(np.random.default_rng(0), shape)((1000, draws))
    errors = _quantile_errors(runs, levels)
    ratios = errors.mean(axis=0) / np.quantile(runs, levels, axis=1).std(axis=1)
    known = np.minimum(levels, 1.0 - levels) * (draws + 1) > 1.0 - 1e-9
    assert (np.isfinite(ratios) == known).all()
    assert ((ratios[known] > 0.65) & (ratios[known] < 1.15)).all()
    assert np.isnan(_quantile_errors(np.array([1.0, np.nan]), levels)).all()
