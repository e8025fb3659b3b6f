"""Interpolation in a step, against polynomials and closed forms of roots and maxima."""

from functools import partial

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from clearjoint._math.interpolation import (
    Bend,
    Point,
    Quintic,
    Slope,
    hermite_root,
    highest,
    highest_after,
    secant_root,
)


def test_quintics_are_reproduced_with_their_rates():
    places, length = np.linspace(0.0, 1.0, 11), 0.3
    curve = np.polynomial.Polynomial(np.random.default_rng(5).normal(size=6))
    start, end = (Bend(curve(t), curve.deriv()(t), curve.deriv(2)(t)) for t in (0.0, length))
    quintic = Quintic.through(start, end, length)
    np.testing.assert_allclose(quintic.value(places), curve(places * length), rtol=1e-12)
    np.testing.assert_allclose(quintic.rate(places), curve.deriv()(places * length), rtol=1e-11)
    assert float(Quintic.through(start, start, 0.0).rate(0.0)) == 0.0


@pytest.mark.parametrize("root", [0.05, 0.4, 0.9])
def test_roots_of_a_bent_curve(root):
    def value(x):
        return (x - root) * (2.0 + x)

    start, end = (Slope(jnp.asarray(value(x)), 2.0 + 2.0 * x - root) for x in (0.0, 1.0))
    assert float(hermite_root(start, end, 1.0)) == pytest.approx(root, abs=1e-9)
    ends = Point(0.0, start.value), Point(1.0, end.value)
    assert float(secant_root(value, *ends)) == pytest.approx(root, abs=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_secants_find_the_root_of_a_contact_right_after_another(seed):
    """Both ends of the step are at the wall, and the largest distance is between them."""
    rng = np.random.default_rng(seed)
    before, after = 10.0 ** rng.uniform(-15, -12, 2)
    distance, skew = 10.0 ** rng.uniform(-8, -3), rng.uniform(-0.5, 0.5)

    def value(x):
        arch = 4.0 * x * (1.0 - x) * (1.0 + skew * (x - 0.5))
        return (1.0 - x) * -before + x * after - distance * arch

    root = float(secant_root(value, Point(0.0, value(0.0)), Point(1.0, value(1.0))))
    assert root == pytest.approx(brentq(value, 0.5, 1.0, xtol=1e-16), abs=1e-14)


TOPS = [-0.2, 0.0, 0.003, 0.3, 0.5, 0.97, 1.0, 1.4]


def asymmetric(top, x):
    """A function whose asymmetry is that of an impact with restitution 0.5 in a step at usual
    tolerances."""
    angle = 0.3 * (x - top)
    return jnp.cos(angle) ** 1.5 * (1.0 + 0.2 * jnp.sin(angle) ** 3)


@pytest.mark.parametrize("top", TOPS)
def test_highest_finds_the_maximum_of_an_asymmetric_function(top):
    value = partial(asymmetric, top)
    ends = [Point(x, value(x)) for x in (0.0, 0.5, 1.0)]
    found = highest(value, *ends)
    position = min(max(top, 0.0), 1.0)
    assert float(found.value) == pytest.approx(float(value(position)), rel=1e-9)
    assert float(found.x) == pytest.approx(position, abs=1e-2)
    assert float(found.value) == pytest.approx(float(value(found.x)), rel=1e-14)


@pytest.mark.parametrize("top", TOPS)
@pytest.mark.parametrize("before", [-0.2, -1.0, -1.5])
def test_highest_after_needs_two_evaluations(top, before):
    """The maximum is found to 1e-5, and its position to a hundredth of a step."""
    value, positions = partial(asymmetric, top), []

    def counted(x):
        positions.append(float(x))
        return value(x)

    found = highest_after(counted, *(Point(x, value(x)) for x in (before, 0.0, 1.0)))
    position = min(max(top, 0.0), 1.0)
    assert float(found.value) == pytest.approx(float(value(position)), rel=1e-5)
    assert float(found.x) == pytest.approx(position, abs=1e-2)
    assert len(positions) == 2
    assert float(found.value) in [float(value(x)) for x in (0.0, *positions, 1.0)]


@pytest.mark.parametrize("before", [-5.0, 0.0, 0.6, 5.0])
@pytest.mark.parametrize("top", [0.02, 0.37, 0.5, 0.98])
def test_highest_after_does_not_exceed_a_kink(top, before):
    """Also if there is a jump between the point before and the step."""

    def value(x):
        return 1.0 - jnp.abs(x - top)

    found = highest_after(value, Point(-1.0, before), *(Point(x, value(x)) for x in (0.0, 1.0)))
    assert 0.75 < float(found.value) <= 1.0
    assert 0.0 <= float(found.x) <= 1.0


def test_highest_after_has_the_position_of_an_end_above_a_lower_peak():
    """The higher evaluation is above its neighbours, but `last` is not one of them."""
    evaluated = []

    def value(x):
        evaluated.append(float(x))
        return jnp.interp(
            x, jnp.array([0.0, 0.5, 0.6, 0.99, 1.0]), jnp.array([0, 0.8, 0.2, 0.2, 1])
        )

    found = highest_after(value, Point(-1.0, 0.0), Point(0.0, 0.0), Point(1.0, 1.0))
    assert evaluated[0] == 0.5 and 0.6 < evaluated[1] < 0.99
    assert (float(found.x), float(found.value)) == (1.0, 1.0)


def test_highest_after_of_a_constant_and_of_a_step_of_zero_length():
    flat = highest_after(lambda x: jnp.ones(()), *(Point(x, 1.0) for x in (0.0, 0.0, 1.0)))
    assert (float(flat.value), 0.0 <= float(flat.x) <= 1.0) == (1.0, True)


def test_highest_does_not_exceed_a_kink():
    def value(x):
        return 1.0 - jnp.abs(x - 0.37)

    found = highest(value, *(Point(x, value(x)) for x in (0.0, 0.5, 1.0)))
    assert 0.9 < float(found.value) <= 1.0
