"""Explicit methods with unrolled stages against diffrax's: steps, dense output and time maps."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
import pytest

from clearjoint._simulation.step.solvers import (
    UnrolledExplicit,
    largest_component,
    ready_solver,
    unrolled,
)
from clearjoint._simulation.step.time_map import FromOnset, WithinContact

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


def test_stale_rates_are_recomputed():
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
    """With a reduction in it, programs would grow with each use of its result."""
    method, _, (*_, inside, _, _) = steps
    dense = unrolled(method).interpolation_cls(t0=T0, t1=T1, **inside)
    program = str(jax.make_jaxpr(dense.evaluate)(0.4))
    assert not any(name in program for name in ("reduce", "concatenate", "dot_general", "while"))


def test_other_methods_are_unchanged():
    implicit = diffrax.Kvaerno3()
    assert unrolled(implicit) is implicit
    assert isinstance(unrolled(diffrax.Ralston()), UnrolledExplicit)


def test_the_root_finder_of_an_implicit_method_is_kept_and_gets_tolerances():
    """The default finder, another one without tolerances, and one with its own."""
    chord, newton = map(
        diffrax.with_stepsize_controller_tols, (diffrax.VeryChord, optimistix.Newton)
    )
    own = optimistix.Newton(1e-3, 1e-4, optimistix.rms_norm)
    norm = largest_component
    for given, expected in (
        (chord(), diffrax.VeryChord(1e-6, 1e-9, norm)),
        (newton(), optimistix.Newton(1e-6, 1e-9, norm)),
        (own, own),
    ):
        finder = ready_solver(diffrax.Kvaerno3(root_finder=given), 1e-6, 1e-9).root_finder
        assert type(finder) is type(given)
        assert all(getattr(finder, k) == getattr(expected, k) for k in ("rtol", "atol", "norm"))


H = jnp.asarray(0.3)


def within(since, due, touches=True, begins=False):
    numbers = (jnp.asarray(touches), jnp.asarray(begins), jnp.asarray(since), jnp.asarray(due))
    return WithinContact.of(H, *numbers)


GRADED = {
    "from a begin": (FromOnset(jnp.asarray(True)), lambda t: t**1.5),
    "from a begin, with derivatives": (within(1e-6, jnp.inf, begins=True), lambda t: t**1.5),
    "after a begin": (within(0.05, 2.0), lambda t: (0.05 + t) ** 1.5),
    "before an end": (within(2.0, 0.5), lambda t: -((0.5 - t) ** 1.5)),
    "to an end": (within(2.0, 0.3), lambda t: -((0.3 - t) ** 1.5)),
}
"""Time maps, and a function of time that each makes a polynomial of the fraction x."""


def _stepped(time_map, function):
    """Return value, error and last rates of a step that integrates a function of time."""
    own, start = UnrolledExplicit(diffrax.Tsit5()), jnp.asarray(function(0.0))
    terms = diffrax.ODETerm(lambda t, y, args: jax.grad(function)(t))
    y1, error, information, last, _ = own.step(
        terms, 0.0, H, start, None, jax.grad(function)(0.0), False, time_map=time_map
    )
    dense = own.interpolation_cls(t0=0.0, t1=H, **information)
    return y1, error, last, lambda part: dense.evaluate(H * time_map.fraction(jnp.asarray(part)))


@pytest.mark.parametrize("case", GRADED)
def test_a_step_with_a_time_map_is_exact_where_forces_begin_and_end_as_a_root(case):
    """The method is exact for polynomials of third order in x, which are roots in time."""
    time_map, function = GRADED[case]
    y1, error, last, inside = _stepped(time_map, function)
    assert float(y1) == pytest.approx(function(0.3), rel=1e-13, abs=1e-15)
    assert abs(float(error)) < 1e-15
    assert float(last) == pytest.approx(float(jax.grad(function)(0.3)), rel=1e-13)
    for part in (0.0, 0.1, 0.5, 0.9, 1.0):
        expected = function(0.3 * part)
        assert float(inside(part)) == pytest.approx(expected, rel=1e-12, abs=1e-15)
    even = _stepped(within(0.1, 0.1, touches=False), function)
    assert abs(float(even[1])) > 1e-8


@pytest.mark.parametrize("case", GRADED)
def test_the_fraction_of_a_step_is_the_inverse_of_the_elapsed_time(case):
    time_map, _ = GRADED[case]
    for place in (0.0, 0.01, 0.3, 0.8, 1.0):
        part = time_map.elapsed(place)
        assert float(time_map.fraction(part)) == pytest.approx(place, rel=1e-7, abs=1e-12)
        ahead, back = (time_map.elapsed(place + side) for side in (1e-6, -1e-6))
        assert float(time_map.slope(place)) == pytest.approx(float(ahead - back) / 2e-6, abs=1e-9)


def test_the_next_step_of_a_contact_has_the_same_length_in_the_root_of_time():
    """Roots 0.5, 0.8, 1.1 after the onset; 0.5, 0.4, 0.3 before the end; a proposal beyond the end
    is unchanged."""
    keep, h = jnp.asarray(True), 0.8**2 - 0.5**2
    growing = WithinContact(jnp.asarray(h), jnp.asarray(0.5), jnp.asarray(0.8))
    assert float(growing.next_length(h, keep)) == pytest.approx(1.1**2 - 0.8**2)
    assert float(growing.next_length(h / 3.0, ~keep)) == pytest.approx(0.6**2 - 0.5**2)
    h = 0.5**2 - 0.4**2
    shrinking = WithinContact(jnp.asarray(h), jnp.asarray(0.5), jnp.asarray(0.4))
    assert float(shrinking.next_length(h, keep)) == pytest.approx(0.4**2 - 0.3**2)
    assert float(shrinking.next_length(5.0 * h, keep)) == pytest.approx(5.0 * h)


@pytest.mark.parametrize("since", [0.1, np.inf])
def test_time_is_uniform_without_known_contacts(since):
    for time_map in (within(since, np.inf, touches=False), within(np.inf, np.inf)):
        assert float(time_map.elapsed(0.3)) == pytest.approx(0.3, rel=1e-15)
        assert float(time_map.next_length(0.7, jnp.asarray(True))) == pytest.approx(0.7)
