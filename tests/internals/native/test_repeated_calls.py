"""Jaxprs that are called repeatedly, as functions of machine code."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from clearjoint._compilation.xla import SHARED
from clearjoint._native import lowering
from clearjoint._native.cells import Cells
from clearjoint._native.functions import NativeProgram
from clearjoint._native.lanes import WIDTH, LaneLoop

RNG = np.random.default_rng(5)
TABLE = jnp.asarray(RNG.normal(size=100))
START = tuple(jnp.array([1.3, 0.2, -0.1]))


@jax.jit
def inner(x, k):
    return x * jnp.sin(k) + jnp.cos(k) * x**2


def alike(x, v, k):
    """An element of which a program has many."""
    slope = jnp.where(x > 0.0, jnp.exp(-x * k), 1.0)
    return 0.01 * jnp.arctan2(jnp.sin(x + k), k * v) * slope - 0.02 * jnp.tanh(v * k), 0.5


alike.__name__ = SHARED
alike = jax.jit(alike)


@jax.jit
def rates(x, v, k, scale):
    """Invariant arithmetic, a branch, a table in memory, and calls of another function."""
    stiff = jnp.sqrt(k * k + 2.0) * scale
    force = lax.cond(x > 0.0, lambda: -stiff * x * x - v / (1.0 + k), lambda: jnp.sin(v) * k)
    for _ in range(3):
        force = inner(force, k)
    read = TABLE[jnp.clip(jnp.floor(x * 10.0).astype(int), 0, 99)]
    for factor in (0.5, 1.0, 2.0):
        pull, half = alike(x, factor * v, k)
        force = force + half * pull
    return v, 0.1 * force + read, scale * k, k


def step(k, x, v):
    h, scale, stages = 0.01, 2.0 * k, []
    for weight in (0.0, 0.3, 0.5, 1.0):
        last = stages[-1] if stages else (0.0, 0.0)
        stages.append(rates(x + weight * h * last[0], v + weight * h * last[1], k, scale))
    # Of a call in a loop, some versions of JAX remove results that nothing reads.
    same = sum(s[2] + s[3] for s in stages)
    x, v = (y + h * sum(s[j] for s in stages) for j, y in enumerate((x, v)))
    return x, v + 1e-3 * same


def run(k, x, v):
    return lax.while_loop(lambda c: c[0] < 50, lambda c: (c[0] + 1, *step(k, *c[1:])), (0, x, v))


def derivatives(k, x, v):
    basis = jnp.eye(3)
    return jax.vmap(lambda d: jax.jvp(step, (k, x, v), tuple(d)))(basis)


@pytest.fixture(params=["functions", "inlined"])
def way(request, monkeypatch):
    set_way(request.param, monkeypatch)
    return request.param


def set_way(way, monkeypatch):
    """Have calls be functions of machine code, or inlined."""
    smallest, most = (1, 0) if way == "functions" else (10**9, 10**9)
    monkeypatch.setattr(lowering, "SMALLEST_FUNCTION", smallest)
    monkeypatch.setattr(lowering, "SMALLEST_SHARED", smallest)
    monkeypatch.setattr(lowering, "MOST_ELEMENTARY", most)


def program(function, *arguments, tangents=0):
    return NativeProgram(jax.make_jaxpr(function)(*arguments), tangents)


@pytest.mark.parametrize(("function", "tangents"), [(run, 0), (derivatives, 3)])
def test_functions_have_the_bits_of_inlined_code(function, tangents, monkeypatch):
    found = {}
    for way in ("functions", "inlined"):
        set_way(way, monkeypatch)
        made = program(function, *START, tangents=tangents)
        found[way] = made(START)
        assert ("call void @f" in made.code.text) == (way == "functions")
        # Those of `alike`, and of elementary functions.
        assert (made.code.text.count("define internal {") >= 3) == (way == "functions")
    jax.tree.map(np.testing.assert_array_equal, found["functions"], found["inlined"])
    expected = jax.tree.leaves(jax.jit(function)(*START))
    for one, other in zip(found["functions"], expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-13)


def test_invariants_of_all_calls_are_computed_once(monkeypatch):
    monkeypatch.setattr(lowering, "SMALLEST_FUNCTION", 1)
    text = program(run, *START).code.text
    assert text.count("call void @f") == 4 + 3  # Calls of `rates`, and in it of `inner`.
    functions, outside = text.split("define void @program(")
    assert outside.count("call double @llvm.sqrt") == 1
    assert "@llvm.sqrt.f64(double %" not in functions


def test_lanes_that_leave_a_branch_keep_results_of_functions(way):
    def turn(shared, own, state):
        k, (count, x, v) = own, state
        x, v = lax.cond(x < 0.4, lambda: step(k, x, v), lambda: (x - 0.3, v))
        return count + 1, x, v

    def status(shared, own, state):
        return {"moves": state[0] < 20}

    own, state = START[0], (jnp.asarray(0), *START[1:])
    loop = LaneLoop(turn, status, (), own, state)
    assert ("call void @f" in loop.code.text) == (way == "functions")
    stiffness = 1.0 + RNG.random(WIDTH)

    def ends(lanes):
        columns = loop.columns(())
        for lane in lanes:
            given = np.asarray(stiffness[lane])
            trees = jax.tree.map(lambda leaf: np.asarray(leaf)[None], (given, state))
            numbers = (
                Cells(one).rows(tree)[0] for one, tree in zip((own, state), trees, strict=True)
            )
            loop.write_lane(columns, lane, *numbers)
        loop.run(columns)
        assert columns.integers[loop.state_cells.start, lanes[0]] == 20
        return {lane: columns.floats[loop.state_cells, lane].copy() for lane in lanes}

    together = ends(range(WIDTH))
    for lane in (0, 3, WIDTH - 1):
        np.testing.assert_array_equal(ends([lane])[lane], together[lane])
    now = state
    for _ in range(20):
        now = turn((), jnp.asarray(stiffness[3]), now)
    np.testing.assert_allclose(together[3][1:], [float(y) for y in now[1:]], rtol=1e-12)


@jax.jit
def inverse(z, x):
    return 1.0 / z + x


def test_zeros_of_both_signs_are_different_arguments(way):
    inverses = program(lambda x: [inverse(z, x) for z in (0.0, -0.0, 0.0)], 1.0)
    assert np.ravel(inverses([1.0])).tolist() == [np.inf, -np.inf, np.inf]
