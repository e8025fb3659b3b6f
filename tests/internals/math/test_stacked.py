"""Many scalars as one array."""

import pickle

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from clearjoint._math.stacked import FEWEST, Stacked, stacked, unstacked


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
