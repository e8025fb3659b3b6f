"""The search on functions written down by hand, against SciPy's with its own derivatives."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import least_squares

import clearjoint as cj
from clearjoint.identification.place import Place
from clearjoint.identification.residuals import UNREACHED
from clearjoint.identification.trust_region import search_in_trust_region

TIMES = np.linspace(0.0, 3.0, 31)
FREE = np.full(2, np.inf)


@dataclass
class LinearisedMisfit:
    coordinates: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray


def decay(at, data=0.0):
    """Residuals of amplitude times exp(-rate * t), in the logarithms of both."""
    amplitude, rate = np.exp(at)
    curve = amplitude * np.exp(-rate * TIMES)
    return LinearisedMisfit(
        at, 100.0 * (curve - data), 100.0 * np.column_stack([curve, -rate * TIMES * curve])
    )


def noisy():
    clean = decay(np.log([2.0, 1.5])).residuals / 100.0
    return clean + 0.01 * np.random.default_rng(0).standard_normal(len(TIMES))


def run(evaluate, start, strides=FREE, tolerance=1e-6, limit=100):
    told = []
    found = search_in_trust_region(
        evaluate, np.array(start, float), strides, tolerance, limit, told.append
    )
    assert tuple(told) == found[1]
    return found


def test_same_minimum_as_scipy():
    data, start = noisy(), np.log([0.3, 6.0])
    best, iterations, ending = run(lambda at: decay(at, data), start)
    other = least_squares(lambda at: decay(at, data).residuals, start, xtol=1e-14, ftol=1e-14)
    assert ending is cj.Ending.CONVERGED and len(iterations) < 20
    np.testing.assert_allclose(best.coordinates, other.x, atol=1e-7)
    assert min(i.chi_squared for i in iterations) == best.residuals @ best.residuals


def test_units_of_the_coordinates_do_not_matter():
    data, units = noisy(), np.array([1e6, 1e-6])

    def scaled(at):
        found = decay(at / units, data)
        return LinearisedMisfit(at, found.residuals, found.jacobian / units)

    start = np.log([0.3, 6.0])
    plain, other = run(lambda at: decay(at, data), start), run(scaled, start * units)
    assert len(plain[1]) == len(other[1])
    np.testing.assert_allclose(other[0].coordinates / units, plain[0].coordinates, rtol=1e-6)


def test_what_fails_is_turned_back_from():
    data = noisy()

    def fragile(at):
        found = decay(at, data)
        if at[1] < at[0] - 1.0:
            found.residuals[10:], found.jacobian[10:] = UNREACHED, 0.0
        return found

    start = np.log([0.05, 6.0])
    best, iterations, ending = run(fragile, start)
    assert any(i.chi_squared > 1e12 and not i.accepted for i in iterations)
    assert ending is cj.Ending.CONVERGED
    np.testing.assert_allclose(np.exp(best.coordinates), [2.0, 1.5], rtol=0.05)


@pytest.mark.parametrize("far", [np.nan, np.inf])
def test_what_is_not_finite_is_turned_back_from(far):
    data = noisy()

    def fragile(at):
        found = decay(at, data)
        if at[1] < at[0] - 1.0:
            found.jacobian[3] = far
        return found

    best, iterations, ending = run(fragile, np.log([0.05, 6.0]))
    assert any(i.chi_squared == np.inf and not i.accepted for i in iterations)
    assert ending is cj.Ending.CONVERGED
    np.testing.assert_allclose(np.exp(best.coordinates), [2.0, 1.5], rtol=0.05)
    start = np.log([6.0, 0.3])
    best, iterations, ending = run(fragile, start)
    assert ending is cj.Ending.STALLED and len(iterations) == 1
    np.testing.assert_array_equal(best.coordinates, start)


@pytest.mark.parametrize("effect", [1.0, 1e-3])
def test_strides_bound_the_first_step_also_along_what_is_hardly_seen(effect):
    data, start, stride = noisy(), np.log([0.01, 20.0]), 0.05
    units = np.array([1.0, 1.0 / effect])

    def misfit(at):
        found = decay(at / units, data)
        return LinearisedMisfit(at, found.residuals, found.jacobian / units)

    _, held, _ = run(misfit, start * units, np.full(2, stride))
    _, free, _ = run(misfit, start * units)
    steps = [np.abs(one[1].coordinates - start * units) for one in (held, free)]
    assert stride < 1.01 * steps[0].max() and steps[0].max() < 1.5 * stride
    assert np.all(steps[1] > 1.0)
    assert held[1].trust < 0.1 and free[1].trust == pytest.approx(1.0)


def test_endings():
    data = noisy()
    assert run(lambda at: decay(at, data), np.log([0.3, 6.0]), limit=2)[2] is cj.Ending.EXHAUSTED

    def lying(at):
        found = decay(at, data)
        return LinearisedMisfit(at, found.residuals, -found.jacobian)

    best, iterations, ending = run(lying, np.log([0.3, 6.0]))
    assert ending is cj.Ending.STALLED
    assert not any(i.accepted for i in iterations[1:])
    np.testing.assert_array_equal(best.coordinates, np.log([0.3, 6.0]))


def test_a_parameter_without_effect_stays_where_it_is():
    data = noisy()

    def one(at):
        found = decay(np.array([at[0], np.log(1.5)]), data)
        return LinearisedMisfit(at, found.residuals, found.jacobian * [1.0, 0.0])

    best, _, ending = run(one, [0.0, 7.0])
    assert ending is cj.Ending.CONVERGED and best.coordinates[1] == 7.0


def test_length_is_the_gauss_newton_step_in_standard_deviations():
    generator = np.random.default_rng(0)
    jacobian, residuals = generator.standard_normal((20, 3)), generator.standard_normal(20)
    step = np.linalg.lstsq(jacobian, -residuals)[0]
    place = Place(LinearisedMisfit(np.zeros(3), residuals, jacobian))
    np.testing.assert_allclose(place.step, step, rtol=1e-12)
    information = jacobian.T @ jacobian
    assert place.length == pytest.approx(np.sqrt(step @ information @ step), rel=1e-12)
