"""Breakpoints in long tables, found by bisection, against a look at each of them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._dynamics.breakpoints import FEW, next_breakpoint, one_sided_time, since_breakpoints
from tests.support.programs import inside
from tests.support.slow import slow

BODIES = {"rod": cj.Body(1.0, (0.1, 0.1, 0.1))}


class OneByOne(cj.AppliedLoad):
    """A load whose breakpoints are not known to be increasing."""

    def breakpoints(self):
        return jax.tree.leaves(super().breakpoints())


def system(kind: type, *tables: cj.extend.AbstractFunctionOfTime, origin=None) -> cj.extend.System:
    forces = {f"load {k}": kind("rod", (table, 0.0, 0.0)) for k, table in enumerate(tables)}
    return cj.extend.System(cj.Scene(BODIES, forces=forces), cj.extend.Formulation(), origin)


def found(system, start, t):
    return (
        next_breakpoint(system, start),
        one_sided_time(system, start, t),
        since_breakpoints(system, start, t),
    )


@pytest.mark.parametrize("seed", [0, *map(slow, range(1, 40))])
def test_bisection_finds_what_looking_at_all_finds(seed):
    """At random times, and within a few rounding errors of a breakpoint."""
    rng = np.random.default_rng(seed)
    sizes = rng.choice([FEW - 1, FEW + 1, 17, 64, 65], 2)
    first = rng.choice([0.0, -0.3, 1e-12, 40.0])
    columns = [first + np.cumsum(rng.choice([1e-6, 1e-3, 0.1], size)) for size in sizes]
    kinds = rng.choice([cj.PiecewiseConstant, cj.PiecewiseLinear], 2)
    tables = [kind(times, times) for kind, times in zip(kinds, columns, strict=True)]
    origin = rng.choice([None, 0.0, first, -1000.1])
    ours, plain = (system(kind, *tables, origin=origin) for kind in (cj.AppliedLoad, OneByOne))
    each = np.concatenate(columns)
    near = rng.choice(each, 40) + rng.integers(-20, 21, 40) * np.spacing(1.0 + abs(first))
    starts = np.concatenate([near, rng.uniform(each.min() - 0.1, each.max() + 0.1, 20)])
    starts = np.asarray([ours.own_time(t) for t in starts])
    # Steps end at the next breakpoint, or before it.
    soonest = jax.vmap(lambda t: next_breakpoint(plain, t))(starts)
    ends = jnp.where(jnp.isinf(soonest) | (rng.random(60) < 0.5), starts + 1e-7, soonest)
    ends = jnp.minimum(ends, soonest)
    one, other = (
        jax.jit(jax.vmap(lambda s, t, system=system: found(system, s, t)))(starts, ends)
        for system in (ours, plain)
    )
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        np.testing.assert_array_equal(a, b)


def arithmetic(program, size: int) -> list[str]:
    """Names of the primitives that compute `size` numbers."""
    copies = ("slice", "convert_element_type", "stop_gradient", "reshape", "squeeze")
    names = []
    for equation in program.eqns:
        shapes = [out.aval.shape for out in equation.outvars]
        if (size,) in shapes and equation.primitive.name not in copies and not inside(equation):
            names.append(equation.primitive.name)
        for part in inside(equation):
            names += arithmetic(part, size)
    return names


@pytest.mark.parametrize("kind", [cj.PiecewiseConstant, cj.PiecewiseLinear])
def test_no_step_looks_at_all_breakpoints_of_a_long_table(kind):
    size = 1000
    count = size + (kind is cj.PiecewiseConstant)
    table = kind(np.linspace(0.0, 1.0, count), np.ones(count))
    for load, expected in ((cj.AppliedLoad, False), (OneByOne, True)):
        program = jax.make_jaxpr(found)(system(load, table), 0.1, 0.2)
        assert bool(arithmetic(program.jaxpr, size)) == expected


def test_derivatives_by_the_times_of_a_long_table_are_those_of_the_breakpoint():
    times = np.linspace(0.0, 1.0, 33)

    def since(times):
        table = cj.PiecewiseLinear(times, times)
        start, end = 0.26, jax.lax.stop_gradient(times[9])
        return since_breakpoints(system(cj.AppliedLoad, table), start, end)["load 0"][1]

    np.testing.assert_array_equal(jax.jacfwd(since)(times), np.where(np.arange(33) == 9, -1.0, 0.0))
