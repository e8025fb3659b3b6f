"""Fingerprints of programs: digests of the traced operations, equal for equal programs."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from clearjoint._sweeps.store.program import fingerprints

X = jnp.linspace(0.0, 1.0, 3)


def digest(function):
    return fingerprints(lambda x: {"y": function(x)}, X)[0]["y"]


@pytest.mark.parametrize(
    ("one", "same", "other"),
    [
        (lambda x: 2.0 * x, lambda other: jnp.multiply(2.0, other), lambda x: 3.0 * x),
        (lambda x: jnp.sin(x), jax.jit(jnp.sin), jax.jit(jnp.cos)),
        (
            lambda x: x * np.arange(3.0),
            lambda y: y * jnp.array([0.0, 1, 2]),
            lambda x: x * np.ones(3),
        ),
        (
            lambda x: (jnp.sin(x), jnp.exp(x))[0],
            lambda x: (jnp.exp(x), jnp.sin(x))[1],
            lambda x: (jnp.sin(x), jnp.exp(x))[1],
        ),
        (
            lambda x: jax.lax.cond(x[0] > 0, jnp.sin, jnp.cos, x),
            lambda y: jax.lax.cond(y[0] > 0, lambda z: jnp.sin(z), lambda z: jnp.cos(z), y),
            lambda x: jax.lax.cond(x[0] > 0, jnp.cos, jnp.sin, x),
        ),
        (
            lambda x: jax.lax.fori_loop(0, 3, lambda k, y: y * x, x),
            lambda u: jax.lax.fori_loop(0, 3, lambda i, v: v * u, u),
            lambda x: jax.lax.fori_loop(0, 4, lambda k, y: y * x, x),
        ),
        (lambda x: jax.nn.relu(x), lambda y: jnp.maximum(y, 0), lambda x: jnp.minimum(x, 0)),
    ],
)
def test_digests_are_equal_where_the_numbers_are(one, same, other):
    assert digest(one) == digest(same) != digest(other)


def test_what_is_printed_on_the_way_does_not_count():
    def talks(x):
        jax.debug.print("{}", x)
        return jnp.sin(x)

    assert digest(talks) == digest(jnp.sin)


def test_each_result_has_a_digest_of_its_own():
    both, shapes = fingerprints(lambda x: {"a": x + 1.0, "b": 2.0 * x}, X)
    other, _ = fingerprints(lambda x: {"b": 2.0 * x, "a": x + 2.0}, X)
    assert both["b"] == other["b"] and both["a"] != other["a"]
    assert shapes["a"].shape == X.shape


def test_types_and_names_of_arguments_count():
    def found(tree):
        return fingerprints(lambda tree: {"y": tree["a"] - tree["b"]}, tree)[0]

    assert found({"a": X, "b": 0 * X}) == found({"b": X, "a": 2 * X})
    assert found({"a": X, "b": X}) != found({"a": X, "b": 1.0})
    assert digest(lambda x: x[0] - x[1]) != digest(lambda x: x[1] - x[0])


class Doubles:
    def __call__(self, x):
        return 2 * x


@pytest.mark.parametrize("function", [lambda x: 2 * x, Doubles()])
def test_callbacks_which_nothing_can_be_traced_of_are_refused(function):
    with pytest.raises(ValueError, match=r"`path` must be None .*\(pure_callback"):
        digest(lambda x: jax.pure_callback(function, x, x))
