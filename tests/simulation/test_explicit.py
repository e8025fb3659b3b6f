"""Explicit methods with their stages written out are diffrax's, step and dense output."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from clearjoint.simulation.unrolled_runge_kutta import (
    UnrolledExplicit,
    dense_weights,
    place_in_step,
    unrolled,
)

METHODS = [diffrax.Heun, diffrax.Bosh3, diffrax.Tsit5, diffrax.Dopri5, diffrax.Dopri8]
Y0 = {"a": jnp.asarray(0.7), "b": jnp.asarray(-0.4)}
T0, T1 = 0.3, 0.55


def field(t, y, args):
    return {"a": jnp.sin(y["b"] + t) * args, "b": -y["a"] * y["b"] + jnp.cos(3.0 * t)}


def step(solver, made_jump):
    terms = diffrax.ODETerm(field)
    args = jnp.asarray(1.3)
    state = solver.init(terms, T0, T1, Y0, args)
    return solver.step(terms, T0, T1, Y0, args, state, made_jump)


@pytest.fixture(params=METHODS, ids=lambda method: method.__name__, scope="module")
def steps(request):
    method = request.param()
    return method, step(method, False), step(unrolled(method), False)


def test_steps_and_error_estimates_are_those_of_diffrax(steps):
    method, (y1, error, *_), (own_y1, own_error, *_) = steps
    for name in Y0:
        assert float(own_y1[name]) == pytest.approx(float(y1[name]), rel=1e-15, abs=1e-16)
        assert float(own_error[name]) == pytest.approx(float(error[name]), rel=1e-11, abs=1e-16)
    assert any(abs(float(value)) > 1e-12 for value in error.values())


def test_the_last_rates_start_the_next_step(steps):
    method, _, (y1, _, _, rates, _) = steps
    expected = field(T1, y1, 1.3)
    for name in Y0:
        assert float(rates[name]) == pytest.approx(float(expected[name]), rel=1e-14)


def test_stale_rates_are_computed_anew():
    terms, own = diffrax.ODETerm(field), unrolled(diffrax.Tsit5())
    stale = jax.tree.map(lambda leaf: leaf + 1.0, Y0)
    y1, *_ = own.step(terms, T0, T1, Y0, 1.3, stale, jnp.asarray(True))
    expected, *_ = step(own, False)
    assert float(y1["a"]) == float(expected["a"])


def test_dense_output_is_that_of_diffrax(steps):
    method, (_, _, information, *_), (_, _, inside, *_) = steps
    dense = method.interpolation_cls(t0=T0, t1=T1, **information)
    own = unrolled(method).interpolation_cls(t0=T0, t1=T1, **inside)
    for x in (0.0, 0.1, 0.5, 0.77, 1.0):
        t = T0 + x * (T1 - T0)
        found, expected = own.evaluate(t), dense.evaluate(t)
        for name in Y0:
            assert float(found[name]) == pytest.approx(float(expected[name]), rel=2e-14)


def test_dense_output_is_arithmetic_without_loops(steps):
    """A reduction in it would make programs grow with each use of what it gives."""
    method, _, (*_, inside, _, _) = steps
    dense = unrolled(method).interpolation_cls(t0=T0, t1=T1, **inside)
    program = str(jax.make_jaxpr(dense.evaluate)(0.4))
    assert not any(name in program for name in ("reduce", "concatenate", "dot_general", "while"))


def test_dense_weights_begin_at_zero_and_end_with_the_step(steps):
    method, *_ = steps
    weights = dense_weights(method)
    np.testing.assert_allclose(weights[:, 0], 0.0, atol=1e-13)
    np.testing.assert_allclose(weights.sum(axis=1), method.tableau.b_sol, atol=1e-12)


def test_other_methods_stay_as_they_are():
    implicit = diffrax.Kvaerno3()
    assert unrolled(implicit) is implicit
    assert isinstance(unrolled(diffrax.Ralston()), UnrolledExplicit)


def test_a_graded_step_is_of_full_order_where_rates_begin_as_a_root():
    """y' = 1.5 sqrt(t), so y = t^1.5: in the square root of time a polynomial, which is exact."""
    terms = diffrax.ODETerm(lambda t, y, args: 1.5 * jnp.sqrt(t))
    own, start = unrolled(diffrax.Tsit5()), jnp.zeros(())
    h = jnp.asarray(0.3)
    found = {}
    for graded in (True, False):
        y1, error, information, last, _ = own.step(
            terms, 0.0, h, start, None, start, False, graded=jnp.asarray(graded)
        )
        found[graded] = float(y1), float(error)
        assert float(last) == pytest.approx(1.5 * 0.3**0.5, rel=1e-15)
        if graded:
            dense = own.interpolation_cls(t0=0.0, t1=h, **information)
            for x in (0.1, 0.5, 0.9):
                value = float(dense.evaluate(h * place_in_step(x, graded)))
                assert value == pytest.approx((0.3 * x) ** 1.5, rel=1e-13)
    assert found[True][0] == pytest.approx(0.3**1.5, rel=1e-14)
    assert abs(found[True][1]) < 1e-15
    assert abs(found[False][0] / 0.3**1.5 - 1.0) > 1e-4
