"""Whether JAX traces a function, by public names of JAX."""

from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import pytest

from clearjoint._compilation.xla import is_tracing

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
