"""Constraints of all lanes, and the warning of lanes without a result."""

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from clearjoint._sweeps.axes import lanes_of
from clearjoint._sweeps.sweep import _warn_of_failures, checked_starts
from clearjoint.extend import result_numbers
from tests.sweeps.test_sweep_failures import ABSOLUTE, distances, held_at_two_points


@pytest.mark.parametrize("lowest, redundant", [(0.0, True), (0.1, False)])
def test_constraints_of_all_lanes_decide_whether_they_depend_on_each_other(lowest, redundant):
    """Not those of the first alone, and not those of a lane that nothing runs."""
    values = np.array([0.2, 1e-6, lowest, 0.3])
    lanes = lanes_of(*held_at_two_points(0.2), {"d": distances(values)}, {"d": values})
    lanes, found = checked_starts(lanes, 0.0, ABSOLUTE)
    assert found == redundant and set(lanes.bad) == {1}


def test_pending_lanes_have_not_failed():
    """Another process may discard lanes that this one has computed."""
    lanes = SimpleNamespace(bad={})
    limit = result_numbers()["max_steps_reached"]
    for codes, text in (
        ([-1, 0, -1], "^2 of 3 lanes are pending: .*same arguments"),
        ([-1, limit, 0], "^1 of 3 lanes failed: 1 max_steps_reached.*1 of 3 lanes are pending"),
    ):
        with pytest.warns(UserWarning, match=text) as caught:
            _warn_of_failures(xr.Dataset({"result": ("lane", codes)}), lanes, 0.0, None)
        assert caught[0].filename == __file__
