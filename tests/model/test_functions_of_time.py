"""Torques and loads over time: tables, functions, their breakpoints, and runs by closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

import clearjoint as cj
from clearjoint.extend import unpack
from tests.support.one_body import one_body
from tests.support.push import Push
from tests.support.shaft import ON_SHAFT, ORIGIN, Z, angle_about, shaft, turned

TIMES, LEVELS = [0.0, 0.2, 0.3], [2.0, -1.0, 0.5]


def test_a_piecewise_constant_table_holds_each_value_up_to_the_next_time():
    steps = unpack(cj.PiecewiseConstant(TIMES, LEVELS))
    found = [float(steps(t)) for t in (-1.0, 0.0, 0.199, 0.2, 0.299, 0.3, 9.0)]
    assert found == [2.0, 2.0, 2.0, -1.0, -1.0, 0.5, 0.5]
    np.testing.assert_array_equal(steps.breakpoints(), [0.2, 0.3])


def test_a_piecewise_linear_table_is_that_of_numpy_and_exact_at_its_points():
    lines = unpack(cj.PiecewiseLinear(TIMES, LEVELS))
    times = np.linspace(-0.1, 0.5, 61)
    found = jax.vmap(lines)(times)
    np.testing.assert_allclose(found, np.interp(times, TIMES, LEVELS), rtol=1e-14)
    assert [float(lines(t)) for t in TIMES] == LEVELS
    np.testing.assert_array_equal(lines.breakpoints(), TIMES)


@pytest.mark.parametrize("seed", range(3))
def test_derivatives_at_the_times_of_a_table_are_those_just_after_them(seed):
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.1, 1.0, 4)) + rng.normal()
    values, rates = rng.normal(size=(2, 4))
    lines, spline = cj.PiecewiseLinear(times, values), cj.Spline(times, values, rates)
    slopes = [*np.diff(values) / np.diff(times), 0.0]
    np.testing.assert_allclose([jax.grad(unpack(lines))(t) for t in times], slopes, rtol=1e-12)
    # At the last time, the tangent continues the spline.
    curvatures = CubicHermiteSpline(times, values, rates)(times, 2)
    found = [jax.grad(jax.grad(unpack(spline)))(t) for t in times]
    np.testing.assert_allclose([jax.grad(unpack(spline))(t) for t in times], rates, rtol=1e-12)
    np.testing.assert_allclose(found, curvatures, rtol=1e-10)


@pytest.mark.parametrize("start", [0.0, -0.3])
def test_a_driven_run_begins_at_the_first_time_of_its_table(start):
    times = start + np.array([0.0, 0.25, 0.5])
    scene = shaft(motor=cj.PrescribedAngle(*ON_SHAFT, cj.PiecewiseLinear(times, [0, 0.1, 0.4])))
    state = cj.assemble(scene, turned(), start)
    np.testing.assert_allclose(state.bodies["shaft"].spin, (0, 0, 0.4), rtol=1e-12)
    solution = cj.simulate(scene, state, times[-1] - 0.05, start_time=start)
    assert solution.result == cj.RESULTS.successful
    np.testing.assert_allclose(solution.final.bodies["shaft"].spin, (0, 0, 1.2), rtol=1e-9)


@pytest.mark.parametrize("start", [1e3, 1e6])
def test_a_driver_begins_to_move_at_a_late_time(start):
    """The time of a breakpoint has a rounding error, in which a fast driver moves a little."""
    times, angles = start + np.array([0.1, 0.2, 0.3]), [0.1, 2.5, 1.0]
    motor = cj.PrescribedAngle(*ON_SHAFT, cj.PiecewiseLinear(times, angles))
    solution = cj.simulate(shaft(motor=motor), turned(0.1), start + 0.4, start_time=start)
    assert angle_about(solution.final.bodies["shaft"]) == pytest.approx(1.0, abs=1e-8)


def test_elements_have_the_breakpoints_of_their_functions():
    steps, lines = cj.PiecewiseConstant(TIMES, LEVELS), cj.PiecewiseLinear([0.5, 0.6], [0, 1])
    load = cj.AppliedLoad("rod", (steps, 0.0, lines), torque=(0.0, 0.0, lambda t: t))
    for element, expected in (
        (load, [0.2, 0.3, 0.5, 0.6]),
        (cj.AppliedLoad("rod", (1.0, 0.0, 0.0)), []),
        (cj.DriveTorque("a", "b", Z, steps), [0.2, 0.3]),
        (cj.DriveTorque("a", "b", Z, 2.0), []),
        (cj.PrescribedAngle("a", "b", Z, lines), [0.5, 0.6]),
        (cj.PrescribedAngle("a", "b", Z, cj.Polynomial([1.0])), []),
        (cj.PrescribedTranslation("a", "b", ORIGIN, ORIGIN, Z, lines), [0.5, 0.6]),
        (cj.Motor("a", "b", Z, lines, 1.0, 0.1), [0.5, 0.6]),
    ):
        found = np.concatenate([[], *jax.tree.leaves(element.breakpoints())])
        np.testing.assert_array_equal(found, expected, err_msg=type(element).__name__)


@pytest.mark.parametrize("how", [jnp.greater, jnp.greater_equal])
def test_a_load_that_is_switched_at_time_zero(how):
    """A force of 1 N on 1 kg; `how` decides whether at this time itself."""
    pushed = one_body("rod", forces={"switch": Push("rod", 1.0, 0.0, how)})
    found = cj.simulate(*pushed, 1.0, start_time=-1.0)
    np.testing.assert_allclose(found.final.bodies["rod"].position[0], 0.5, rtol=1e-9)
    assert found.attempts < 12
