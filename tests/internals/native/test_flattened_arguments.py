"""Arguments and results of native functions in their flattened form."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from clearjoint._native import Native, NativeFunction
from clearjoint._native.compiled import SWITCH
from clearjoint._native.functions import LARGE, FlatArguments
from tests.support.programs import made_by


def random_array(random: np.random.Generator):
    """Return an array of some type, layout and size, of NumPy or JAX."""
    shape = tuple(random.integers(0, 4, random.integers(0, 3)))
    array = random.normal(size=(*shape, 6))[..., :: random.choice([1, 2, -1])]
    kind = random.integers(6)
    if kind == 0:
        return array.astype(random.choice(["int64", "bool"]))
    if kind == 1:
        return jnp.asarray(array)
    if kind == 2:
        return np.asfortranarray(array)
    if kind == 3:
        return np.zeros(LARGE + random.integers(-1, 2))
    return array[..., 0] if kind == 4 else array


@pytest.mark.parametrize("seed", range(30))
def test_numbers_are_joined_whatever_the_arrays(seed):
    random = np.random.default_rng(seed)
    arrays = [random_array(random) for _ in range(random.integers(1, 9))]
    if seed % 3 == 0:
        arrays = [array.astype(float) for array in arrays]
    small = [a for a in arrays if a.size < LARGE and jnp.issubdtype(a.dtype, jnp.floating)]
    joined = np.concatenate([np.ravel(a) for a in small]) if small else np.zeros(0)
    flat = FlatArguments.of((arrays, {"a": np.ones(2)}))
    np.testing.assert_array_equal(flat.floats, [*joined, 1.0, 1.0])

    def doubled(arrays, ones):
        return [2 * array for array in arrays], ones["a"]

    result, _ = NativeFunction(doubled)(*flat.arguments)
    for array, twice in zip(arrays, result, strict=True):
        np.testing.assert_array_equal(twice, 2 * np.asarray(array))


def split(x, named):
    return {"sum": x.sum(), "static": "text", **named}, (x > 0.0, [x * 2.0])


def together(named, parts, x):
    return parts[1][0] + named["sum"] + named["n"] + x


@pytest.mark.parametrize("native", ["1", "0"])
def test_parts_of_results_are_arguments_of_further_calls(native, monkeypatch):
    monkeypatch.setenv(SWITCH, native)
    first, second = Native(split), Native(together)
    for x in (np.arange(3.0), np.asarray([1.0, -2.0, 5.0])):
        named = {"n": np.asarray(4)}
        parts = first.in_parts(x, named)
        trees = first(x, named)
        leaves = jax.tree.leaves([part.tree for part in parts])
        for leaf, expected in zip(leaves, jax.tree.leaves(trees), strict=True):
            np.testing.assert_array_equal(leaf, expected)
        # A part may stand beside an ordinary argument.
        np.testing.assert_array_equal(second(*parts, x), 3.0 * x + x.sum() + 4.0)
        np.testing.assert_array_equal(second(parts[0], trees[1], x), 3.0 * x + x.sum() + 4.0)
    assert made_by(first) == made_by(second) == 1


def test_single_and_double_precision_are_joined():
    flat = FlatArguments.of(([np.full(2, 0.1, np.float32), np.zeros(1)],))
    np.testing.assert_array_equal(flat.floats, [*np.full(2, 0.1, np.float32), 0.0])
