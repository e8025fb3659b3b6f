"""Long programs that are divided into pieces, and functions that exchange arrays in memory."""

import pickle
from contextlib import suppress
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from clearjoint._compilation.xla import elementwise
from clearjoint._math.stacked import FEWEST, Stacked, stacked, unstacked
from clearjoint._native import UnsupportedPrimitiveError, llvm_text, lowering, pieces
from clearjoint._native.functions import NativeProgram
from tests.internals.native.test_repeated_calls import START, derivatives, program, run
from tests.support.random_programs import RandomProgram


def assert_as_xla(function, *arguments):
    """Check results by those of XLA, and return the program."""
    native, expected = program(function, *arguments), jax.jit(function)(*arguments)
    for mine, theirs in zip(native(arguments), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-14, atol=1e-15)
    return native


@pytest.fixture
def short_pieces(monkeypatch):
    monkeypatch.setattr(llvm_text, "FEWEST", 0)
    monkeypatch.setattr(pieces, "LONGEST", 3)
    monkeypatch.setattr(pieces, "LENGTH", 2)


@pytest.mark.parametrize(("function", "tangents"), [(run, 0), (derivatives, 3)])
@pytest.mark.parametrize("smallest", [1, 10**9])
def test_divided_programs_have_the_same_bits(function, tangents, smallest, monkeypatch, request):
    monkeypatch.setattr(lowering, "SMALLEST_FUNCTION", smallest)
    monkeypatch.setattr(lowering, "SMALLEST_SHARED", smallest)
    closed = jax.make_jaxpr(function)(*START)
    whole = NativeProgram(closed, tangents)
    request.getfixturevalue("short_pieces")
    divided = NativeProgram(closed, tangents)
    assert divided.code.text.count("define") > whole.code.text.count("define") + 20
    jax.tree.map(np.testing.assert_array_equal, divided(START), whole(START))


@pytest.mark.parametrize(
    ("seeds", "size"),
    [(range(4000, 4012), 5), pytest.param(range(5000, 5300), 14, marks=pytest.mark.slow)],
    ids=["few", "many"],
)
def test_divided_random_programs_have_the_same_bits(seeds, size, monkeypatch, request):
    programs = {}
    for part in ("whole", "divided"):
        if part == "divided":
            request.getfixturevalue("short_pieces")
        for seed in seeds:
            random = RandomProgram(seed, size)
            tangents = 4 if seed % 4 == 3 else 0
            with suppress(UnsupportedPrimitiveError):
                native = program(random, *random.arguments(0), tangents=tangents)
                programs[part, seed] = native(random.arguments(1))
    assert len(programs) > len(seeds)
    for (part, seed), results in programs.items():
        for one, other in zip(results, programs["whole", seed], strict=True):
            np.testing.assert_array_equal(one, other, err_msg=f"{part}, seed {seed}")


def test_functions_get_and_return_large_arrays(monkeypatch):
    """Each call has arrays of its own, also those that are read after later calls."""
    monkeypatch.setattr(lowering, "SMALLEST_FUNCTION", 1)

    @jax.jit
    def rates(y, k, table):
        return jnp.sin(y) * k + table, y[0]

    def stages(y, k, table):
        first, a = rates(y, k, table)
        second, b = rates(y + 0.5 * first, k, table)
        third, c = rates(first - second, 2.0 * k, table)
        written = first.at[3].set(c)
        again, d = rates(written, k, table)
        return first, second, third, again, written, a + b + c + d

    table = jnp.asarray(np.random.default_rng(3).normal(size=60))
    native = assert_as_xla(stages, jnp.linspace(0.0, 2.0, 60), jnp.asarray(1.7), table)
    assert native.code.text.count("call void @f") == 4


def by_leaf(formula, h, tree):
    return jax.tree.map(partial(formula, h), tree)


def by_array(formula, h, tree):
    return unstacked(jax.tree.map(partial(elementwise, formula, h), stacked(tree)))


@pytest.mark.parametrize("size", [FEWEST - 1, FEWEST, pytest.param(200, marks=pytest.mark.slow)])
def test_stacked_trees_have_the_results_of_their_leaves(size):
    rng = np.random.default_rng(size)
    tree = {f"x{k}": jnp.asarray(v) for k, v in enumerate(rng.normal(size=size))}

    def formula(h, x):
        return x + h * (0.3 * jnp.exp(x) - 0.1 * x)

    assert isinstance(stacked(tree), Stacked) == (size >= FEWEST)
    natives = [program(partial(by, formula), 0.5, tree) for by in (by_leaf, by_array)]
    leaves = [0.5, *jax.tree.leaves(tree)]
    written_out, array = (np.ravel(native(leaves)) for native in natives)
    np.testing.assert_array_equal(array, written_out)
    np.testing.assert_allclose(array, jax.tree.leaves(by_array(formula, 0.5, tree)), rtol=1e-15)
    if size == 200:
        assert len(natives[1].code.text) < 0.8 * len(natives[0].code.text)


@pytest.mark.parametrize("is_linear", [True, False])
@pytest.mark.parametrize("count", [1, 3, pytest.param(8, marks=pytest.mark.slow)])
def test_stacked_trees_have_the_derivatives_of_their_leaves(count, is_linear):
    rng = np.random.default_rng(count)
    names = [f"x{k:03}" for k in range(FEWEST + 1)]
    tree = dict(zip(names, jnp.asarray(rng.normal(size=len(names))), strict=True))
    along = {name: jnp.asarray(rng.normal(size=count)) for name in names}

    def formula(h, x):
        return x + h * (0.3 * (x if is_linear else jnp.exp(x)) - 0.1 * x)

    def differentiated(h, tree, along, by):
        # Twice, so that tangents of a result are those of an argument.
        def twice(tree):
            return by(formula, h, by(formula, 2.0 * h, tree))

        derivative = jax.vmap(lambda along: jax.jvp(twice, (tree,), (along,)), out_axes=(None, 0))
        return derivative(along)

    arguments = 0.5, tree, along
    # As in runs with derivatives, tangents are vectors of the processor.
    tangents = count if count > 1 else 0
    programs = [
        program(partial(differentiated, by=by), *arguments, tangents=tangents)
        for by in (by_leaf, by_array)
    ]
    leaves = jax.tree.leaves(arguments)
    written_out, array = (np.concatenate(native(leaves), axis=None) for native in programs)
    # A nonlinear function has a loop for its values and others for its derivatives, so that other
    # products are fused with sums.
    if is_linear:
        np.testing.assert_array_equal(array, written_out)
    values = np.array([*tree.values()]), np.array([*along.values()]).T
    value, derivatives = differentiated(0.5, *values, by=lambda formula, *of: formula(*of))
    expected = np.concatenate([value, derivatives.T], axis=None)
    np.testing.assert_allclose(array, expected, rtol=1e-13, atol=1e-15)


def test_stacked_trees_are_in_memory():
    assert FEWEST == lowering.LARGEST_UNROLLED + 1


def test_elementwise_functions_without_rules_for_elements_are_computed():
    def function(h, x):
        return elementwise(lambda h, x: jnp.cumsum(jnp.broadcast_to(h, x.shape) * x), h, x)

    assert_as_xla(function, jnp.asarray(0.5), jnp.linspace(0.0, 1.0, 60))


def test_other_trees_are_not_stacked():
    mixed = [jnp.asarray(1.0)] * 60 + [jnp.zeros(2)]
    assert stacked(mixed) is mixed
    numbers = [1.0] * 60
    assert stacked(numbers) is numbers
    assert unstacked(numbers) is numbers


class Pair(eqx.Module):
    first: jax.Array
    second: jax.Array


def test_a_pickled_copy_has_the_same_structure():
    """A run whose first program is loaded from disk, and whose second one is made, needs this."""
    tree = [Pair(jnp.asarray(float(k)), jnp.asarray(-0.5 * k)) for k in range(FEWEST)]
    original = stacked(tree)
    copy = pickle.loads(pickle.dumps(original))
    assert isinstance(original, Stacked) and isinstance(copy, Stacked)
    assert jax.tree.structure(copy) == jax.tree.structure(original)
    np.testing.assert_array_equal(copy.array, original.array)
    assert [float(pair.second) for pair in unstacked(copy)] == [-0.5 * k for k in range(FEWEST)]
