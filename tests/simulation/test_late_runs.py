"""Times of runs: derivatives of runs that start long after time zero, where times are rounded
coarsely, and times that are refused."""

import numpy as np
import pytest

import clearjoint as cj
from tests.support.one_body import one_body
from tests.support.oscillator import on_spring
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


X, STIFFNESS = cj.quantities.Position("ball", "x"), lambda scene: scene.forces["spring"].stiffness
DATA = cj.Measurements({"x": cj.Series(X, [0.1, 0.2], [0.05, -0.04], noise=1e-3)})
AXES, PEAK = {"k": cj.Axis(STIFFNESS, [100.0, 200.0])}, {"p": cj.Peak(X, "m")}
LIMIT = (cj.Parameter(STIFFNESS), cj.quantities.Velocity("ball"), 2.0)
TOLERANCE = {"k": cj.Uncertain(STIFFNESS, half_width=5.0)}
CALLS = {
    "simulate": lambda end, **rest: cj.simulate(*on_spring(), end, **rest),
    "sensitivities": lambda end, **rest: cj.sensitivities(
        *on_spring(), end, {"k": LIMIT[0]}, {"x": X}, [0.1], **rest
    ),
    "sweep": lambda end, **rest: cj.sweep(*on_spring(), end, AXES, PEAK, **rest),
    "ensemble": lambda end, **rest: cj.ensemble(*on_spring(), end, AXES, PEAK, **rest),
    "statistics_derivatives": lambda end, **rest: cj.statistics_derivatives(
        *on_spring(), end, TOLERANCE, PEAK, draws=40, **rest
    ),
    "largest_feasible": lambda end, **rest: cj.largest_feasible(
        *on_spring(), end, *LIMIT, between=(1.0, 200.0), **rest
    ),
    "settle": lambda end, **rest: cj.settle(*on_spring(), period=0.6, **rest),
    "identify": lambda end, **rest: cj.identify(*on_spring(), DATA, {"k": LIMIT[0]}, **rest),
}


@pytest.mark.parametrize("call", CALLS)
@pytest.mark.parametrize("time", ["now", None, [0.0, 0.1]])
def test_times_that_are_no_single_numbers_are_named(call, time):
    with pytest.raises(ValueError, match="Argument `start_time` must be"):
        CALLS[call](0.5, start_time=time)
    if call not in ("settle", "identify"):
        with pytest.raises(ValueError, match="Argument `end_time` must be"):
            CALLS[call](time)
    if call in ("sweep", "ensemble", "statistics_derivatives"):
        with pytest.raises(ValueError, match="Argument `end_time` must be"):
            CALLS[call](lambda scene: time)
