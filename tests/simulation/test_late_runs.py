"""Derivatives of runs that start long after time zero, where times are rounded coarsely."""

import numpy as np
import pytest

import clearjoint as cj
from tests.support.one_body import one_body
from tests.support.push import Push
from tests.support.slow import slow_but


@pytest.mark.parametrize("start", slow_but([2.0**20], [-8.0, 0.0, 2.0**20]))
def test_forces_that_depend_on_time_use_the_time_of_the_scene(start):
    """m x'' = 1 + b s, s = t - t_s, so x = (s^2/2 + b s^3/6)/m, with sections where x = x_0."""
    mass, slope, after = 2.0, 3.0, 0.75
    pushed = one_body(
        "mass", forces={"push": Push("mass", 1.0, start + 0.25, slope=slope)}, mass=mass
    )
    x_of = cj.quantities.Position("mass", "x")
    reached = (0.5**2 / 2.0 + slope * 0.5**3 / 6.0) / mass
    section = cj.Section(lambda now: x_of(now) - reached, {"x": (x_of, "m")}, 2)
    result = cj.sensitivities(
        *pushed,
        start + 1.0,
        {"since": cj.Parameter(lambda s: s.forces["push"].start)},
        {"x": x_of, "reached": section},
        [start + 0.125, start + 1.0],
        start_time=start,
    )
    x = (after**2 / 2.0 + slope * after**3 / 6.0) / mass
    np.testing.assert_allclose(result.outputs["x"], [0.0, x], rtol=1e-8, atol=1e-12)
    to_since = -(after + slope * after**2 / 2.0) / mass
    np.testing.assert_allclose(result.derivatives["x"][:, 0], [0.0, to_since], rtol=1e-8)
    crossed = result.outputs["reached"].times - start
    assert crossed == pytest.approx([0.75], abs=0.01)  # roughly, in a step that long
