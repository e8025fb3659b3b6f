"""`HostFirst`: functions computed by NumPy, compiled only if they need JAX; whether JAX traces."""

import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._compilation.xla import HostFirst, is_tracing
from clearjoint._dynamics import constraint_report
from clearjoint._math.smoothing import cosine, polar_angle, sine, where
from clearjoint._simulation.run import run_checks
from studies.benchmark.first_calls import four_bar
from tests.support.programs import made_by


def kinked(x, y):
    return {"angle": polar_angle(sine(x), cosine(x)) / y, "part": where(x > 1.0, x, -x)}


def test_functions_that_numpy_can_compute_are_not_compiled():
    function = HostFirst(kinked)
    found = function(jnp.asarray(0.25), y=2.0)
    assert made_by(function) == 0
    assert found["angle"] == pytest.approx(0.125) and found["part"] == -0.25
    assert all(isinstance(leaf, np.ndarray | np.generic) for leaf in jax.tree.leaves(found))


def test_numpy_does_not_warn_of_numbers_that_are_not_finite(recwarn):
    found = HostFirst(kinked)(np.asarray(0.25), y=np.asarray(0.0))
    assert np.isinf(found["angle"]) and not recwarn


@pytest.mark.parametrize(
    "function",
    [lambda x: jax.jvp(jnp.sin, (x,), (jnp.ones_like(x),))[1], lambda x: x.at[()].set(jnp.cos(x))],
    ids=["a derivative", "a method of JAX's arrays"],
)
def test_functions_that_need_jax_are_compiled_once(function):
    asked = []

    def counted(x):
        asked.append(x)
        return function(x)

    first = HostFirst(counted)
    for x in (0.5, 0.75):
        assert first(jnp.asarray(x)) == pytest.approx(np.cos(x))
    assert made_by(first) == 1 and len(asked) == 2


def test_numpy_is_tried_after_a_call_while_jax_traces():
    function = HostFirst(kinked)
    x, y = jnp.asarray(0.25), jnp.asarray(2.0)
    traced = jax.jit(lambda x: function(x, y=y))(x)
    found = function(x, y=y)
    assert isinstance(found["angle"], np.ndarray | np.generic) and made_by(function) <= 1
    assert traced["angle"] == pytest.approx(found["angle"])


def test_where_under_vmap_selects_in_each_lane():
    x = jnp.linspace(-1.0, 1.0, 5)
    np.testing.assert_array_equal(jax.vmap(lambda a: where(a > 0.0, a, -a))(x), jnp.abs(x))


def test_constraints_by_numpy_equal_the_compiled_ones():
    scene, state = four_bar()
    coordinates = cj.AbsoluteCoordinates()

    def arrays(start_rows, state):
        rows = start_rows(scene, coordinates, state, jnp.asarray(0.0), with_jacobian=True)
        return rows.values, rows.rates, rows.jacobian, rows.reduced

    by_numpy = arrays(constraint_report.start_rows_by_numpy, state)
    compiled = jax.jit(partial(arrays, constraint_report.start_rows))(state)
    jax.tree.map(partial(np.testing.assert_allclose, rtol=0.0, atol=1e-15), by_numpy, compiled)


def test_numpy_computes_the_checks_of_a_start(monkeypatch):
    """A single operation of `jax.numpy` in one of them has cost 0.7 s of each first run."""
    modules = [module for name, module in sys.modules.items() if name.startswith("clearjoint.")]
    found = {
        id(value): value
        for module in modules
        for value in vars(module).values()
        if isinstance(value, HostFirst)
    }
    for function in found.values():
        monkeypatch.setattr(function, "_by_numpy", {})
    monkeypatch.setattr(run_checks, "starts", type(run_checks.starts)())
    # Without drivers that depend on time, which need JAX for their derivatives.
    for make in cj.mechanisms.double_pendulum, cj.mechanisms.four_bar:
        cj.simulate(*make(), 1e-6, progress=False)
    tried = {f.__wrapped__.__name__: [*f._by_numpy.values()] for f in found.values()}
    assert tried["start_values"]
    assert {name for name, worked in tried.items() if not all(worked)} == set()


TRANSFORMED = {
    "jit": lambda f: jax.jit(f)(1.0),
    "vmap": lambda f: jax.vmap(f)(jnp.ones(2)),
    "grad": lambda f: jax.grad(f)(1.0),
    "jvp": lambda f: jax.jvp(f, (1.0,), (1.0,)),
    "eval_shape": lambda f: jax.eval_shape(f, 1.0),
}


@pytest.mark.parametrize("name", TRANSFORMED)
def test_functions_are_traced_inside_of_transformations_only(name):
    found = []

    def square(x):
        found.append(is_tracing())
        return x * x

    TRANSFORMED[name](square)
    assert found == [True] and not is_tracing()


def test_another_thread_is_not_traced():
    def in_a_thread(x):
        with ThreadPoolExecutor(1) as pool:
            assert not pool.submit(is_tracing).result()
        return x

    jax.jit(in_a_thread)(1.0)
