"""The search on functions written down by hand, against SciPy's."""

import numpy as np
import pytest
from scipy.optimize import least_squares

import clearjoint as cj
from clearjoint._identification.levenberg_marquardt import decrement, search_with_damping
from clearjoint._identification.residuals import UNREACHED, RunMisfit

TIMES = np.linspace(0.0, 3.0, 31)
FREE = np.full(2, np.inf)


def misfit(at, residuals, jacobian):
    ended = cj.RESULTS.successful
    return RunMisfit(at, residuals, jacobian, np.zeros((1, 0)), ended)


def decay(at, data=0.0):
    """Residuals of amplitude times exp(-rate * t), in the logarithms of both."""
    amplitude, rate = np.exp(at)
    curve = amplitude * np.exp(-rate * TIMES)
    slopes = np.column_stack([curve, -rate * TIMES * curve])
    return misfit(at, 100.0 * (curve - data), 100.0 * slopes)


CLEAN = decay(np.log([2.0, 1.5])).residuals / 100.0
DATA = CLEAN + 0.01 * np.random.default_rng(0).standard_normal(len(TIMES))
START = np.log([0.3, 6.0])


def of_data(at):
    return decay(at, DATA)


def run(evaluate, start, step_limits=FREE, tolerance=1e-6, limit=100):
    reported, start = [], np.array(start, float)
    options = step_limits, tolerance, limit, reported.append
    found = search_with_damping(evaluate, start, *options)
    assert tuple(reported) == found[1]
    return found


def test_same_minimum_as_scipy():
    best, iterations, ending = run(of_data, START)
    other = least_squares(lambda at: of_data(at).residuals, START, xtol=1e-14, ftol=1e-14)
    assert ending is cj.results.Ending.CONVERGED and len(iterations) < 20
    np.testing.assert_allclose(best.coordinates, other.x, rtol=0.0, atol=1e-7)
    assert min(i.chi_squared for i in iterations) == best.residuals @ best.residuals


def test_units_of_the_coordinates_do_not_matter():
    units = np.array([1e6, 1e-6])

    def scaled(at):
        found = of_data(at / units)
        return misfit(at, found.residuals, found.jacobian / units)

    plain, other = run(of_data, START), run(scaled, START * units)
    assert len(plain[1]) == len(other[1])
    np.testing.assert_allclose(other[0].coordinates / units, plain[0].coordinates, rtol=1e-6)


def test_what_fails_is_turned_back_from():

    def fragile(at):
        found = of_data(at)
        if at[1] < at[0] - 1.0:
            found.residuals[10:], found.jacobian[10:] = UNREACHED, 0.0
        return found

    start = np.log([0.05, 6.0])
    best, iterations, ending = run(fragile, start)
    assert any(i.chi_squared > 1e12 and not i.accepted for i in iterations)
    assert ending is cj.results.Ending.CONVERGED
    np.testing.assert_allclose(np.exp(best.coordinates), [2.0, 1.5], rtol=0.05)


def test_no_step_exceeds_the_stride():
    _, iterations, _ = run(of_data, np.log([0.01, 20.0]), np.full(2, 0.25))
    rows = np.array([i.coordinates for i in iterations if i.accepted])
    steps = np.abs(np.diff(rows, axis=0)).max(axis=0)
    np.testing.assert_allclose(steps, 0.25)


def test_a_rise_is_refused_though_the_model_predicts_a_larger_one():
    """Limiting one component of a step can turn it into one along which the model rises."""
    root = np.linalg.cholesky(np.array([[1.0, 0.9], [0.9, 1.0]])).T
    start = -root @ [4.8, -4.2]

    def rising(at):
        rise = 1e-6 if at.any() else 0.0
        return misfit(at, start * (1.0 + rise), root)

    best, iterations, _ = run(rising, [0.0, 0.0], np.array([1e-3, 5.0]))
    step = iterations[1].coordinates
    assert step[0] == pytest.approx(1e-3)
    assert np.sum((start + root @ step) ** 2) > start @ start + 0.05
    assert not any(one.accepted for one in iterations[1:])
    assert best.chi_squared == start @ start


def test_endings():
    assert run(of_data, START, limit=2)[2] is cj.results.Ending.EXHAUSTED

    def lying(at):
        found = of_data(at)
        return misfit(at, found.residuals, -found.jacobian)

    best, iterations, ending = run(lying, START)
    assert ending is cj.results.Ending.STALLED
    assert not any(i.accepted for i in iterations[1:])
    np.testing.assert_array_equal(best.coordinates, START)


def test_a_search_ends_where_chi_squared_no_longer_falls():
    """Steps of a third of the right ones come closer by a third of the way each."""
    start = np.log([1.8, 1.4])

    def slow(at):
        found = of_data(at)
        return misfit(at, found.residuals, 3.0 * found.jacobian)

    best, iterations, ending = run(slow, start, tolerance=1e-9)
    lowest = 2.0 * least_squares(lambda at: of_data(at).residuals, start).cost
    assert ending is cj.results.Ending.CONVERGED
    assert 0.0 < best.chi_squared - lowest < 0.1**2
    chi_squared = [i.chi_squared for i in iterations]
    assert all(i.accepted for i in iterations)
    # Of which the last five steps take less than a hundredth, and no five before them.
    falls = np.subtract(chi_squared[:-5], chi_squared[5:])
    assert falls[-1] < 0.1**2 < falls[:-1].min()


def test_a_parameter_without_effect_stays_where_it_is():

    def one(at):
        found = of_data(np.array([at[0], np.log(1.5)]))
        return misfit(at, found.residuals, found.jacobian * [1.0, 0.0])

    best, _, ending = run(one, [0.0, 7.0])
    assert ending is cj.results.Ending.CONVERGED and best.coordinates[1] == 7.0


def test_decrement_is_the_gauss_newton_step_in_standard_deviations():
    generator = np.random.default_rng(0)
    jacobian, residuals = generator.standard_normal((20, 3)), generator.standard_normal(20)
    step = np.linalg.lstsq(jacobian, -residuals)[0]
    expected = np.sqrt(step @ jacobian.T @ jacobian @ step)
    assert float(decrement(residuals, jacobian)) == pytest.approx(expected, rel=1e-12)
