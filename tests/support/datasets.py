"""Comparisons of results of sweeps."""

import numpy as np
import xarray as xr


def assert_same_bits(found: xr.Dataset, expected: xr.Dataset) -> None:
    """The variables are the same, bit for bit; coordinates and attributes may differ."""
    assert set(found.data_vars) == set(expected.data_vars)
    for name in expected.data_vars:
        values, others = found[name].values, expected[name].values
        np.testing.assert_array_equal(values, others, err_msg=str(name))
        assert values.tobytes() == others.tobytes(), name


def assert_near(found: xr.Dataset, expected: xr.Dataset, rtol: float, atol: float) -> None:
    """All variables of `expected` are there and close."""
    for name in expected.data_vars:
        np.testing.assert_allclose(
            found[name], expected[name], rtol=rtol, atol=atol, err_msg=str(name)
        )
