"""Calls of one function for many elements, which vectors of the processor compute together."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from clearjoint._compilation.xla import SHARED
from clearjoint._native import alike_calls, functions, lowering
from clearjoint._native.functions import NativeProgram

TABLE = jnp.linspace(0.0, 1.0, 100)


def force(x, v, k):
    """A law with a branch, elementary functions, and products that are fused with sums."""

    def pressed():
        return k * jnp.exp(x) ** 1.5 * (1.0 + 0.3 * v) + jnp.sin(x * k)

    return lax.cond(x > 0.0, pressed, lambda: 0.1 * v), x + k * v, jnp.cos(k * v + x)


def from_memory(x, v, k):
    at = jnp.clip(jnp.floor(10.0 * x).astype(int), 0, 99)
    return TABLE[at] * v + k, x, v


def shared(function):
    def call(*arguments):
        return function(*arguments)

    call.__name__ = SHARED
    return jax.jit(call)


@pytest.fixture
def in_memory(monkeypatch):
    """Functions of any size exchange their numbers in memory."""
    monkeypatch.setattr(lowering, "SMALLEST_FUNCTION", 1)


def motion(function, n):
    """A loop that calls a function for n elements, and again for results of the first calls."""
    call = shared(function)

    def step(x, v, k):
        pulls = [call(*(a[j] for a in (x, v, k))) for j in range(n)]
        # Each of these needs the result of the element before, and so of the calls above.
        again = [call(pulls[j][0], pulls[j - 1][1], k[j]) for j in range(n)]
        turned = [jnp.sin(a[2] * b[2]) for a, b in zip(pulls, again, strict=True)]
        rates = jnp.stack([a[0] + t * b[1] for a, b, t in zip(pulls, again, turned, strict=True)])
        return 0.9 * x + 0.01 * rates, 0.5 * v - 0.1 * x, k

    def run(x, v, k):
        return lax.fori_loop(0, 5, lambda _, now: step(*now), (x, v, k))

    return run


def arguments(n, seed):
    rng = np.random.default_rng(seed)
    return tuple(rng.normal(size=(3, n)))


def programs(function, given, monkeypatch, tangents=0):
    """The program with calls computed together, and the one in which each stands alone."""
    monkeypatch.setattr(lowering, "SMALLEST_SHARED", 1)
    monkeypatch.setattr(lowering, "MOST_ELEMENTARY", 2)
    closed = jax.make_jaxpr(function)(*given)
    together = NativeProgram(closed, tangents)
    monkeypatch.setattr(functions, "CALLS_AT_ONCE", 1)
    return together, NativeProgram(closed, tangents)


def assert_equal(found, expected):
    """Check that results have the same bits."""
    jax.tree.map(np.testing.assert_array_equal, found, expected)


def calls_at_once(program):
    """Number of calls whose arguments are vectors of eight numbers."""
    return len(re.findall(r"= call \{[^}]*\} @f\d+\(ptr %memory, <8 x double>", program.code.text))


@pytest.mark.parametrize("n", [2, 3, 8, 11, 20])
@pytest.mark.parametrize("seed", range(2))
def test_calls_together_have_the_bits_of_single_calls(n, seed, monkeypatch):
    given = arguments(n, seed)
    together, alone = programs(motion(force, n), given, monkeypatch)
    assert (calls_at_once(together) > 0) == (n >= alike_calls.FEWEST)
    assert calls_at_once(alone) == 0
    results = together(given)
    assert_equal(results, alone(given))
    assert all(np.isfinite(joined).all() and np.ptp(joined) > 0.0 for joined in results)


def test_derivatives_have_the_bits_of_single_calls(monkeypatch):
    n = 9
    run = motion(force, n)

    def along(x, v, k):
        return jax.vmap(lambda d: jax.jvp(run, (x, v, k), (d * v, d * x, d * k)))(jnp.arange(3.0))

    given = arguments(n, 5)
    together, alone = programs(along, given, monkeypatch, tangents=3)
    assert_equal(together(given), alone(given))


def test_functions_that_use_memory_are_called_one_by_one(monkeypatch):
    given = arguments(8, 0)
    together, alone = programs(motion(from_memory, 8), given, monkeypatch)
    assert "@f0(ptr %memory, double" in together.code.text
    assert not re.search(r"@f0\(ptr %memory, <8", together.code.text)
    assert_equal(together(given), alone(given))


def test_parameters_are_read_together_from_memory(in_memory, monkeypatch):
    """As those of a scene's elements, which a function for all stages of a step reads there."""
    n, call = 11, shared(force)

    @jax.jit
    def rates(x, v, k):
        pulls = [call(x[j], v[j] * k[j], k[j]) for j in range(n)]
        # Cells can be next to each other in one order only.
        others = [call(k[j], x[n - 1 - j], v[j])[1] for j in range(n)]
        return jnp.stack([a[0] + b for a, b in zip(pulls, others, strict=True)])

    def run(x, v, k):
        for _ in range(3):
            x = 0.9 * x + 0.01 * rates(x, v, k)
        return x

    given = arguments(n, 3)
    together, alone = programs(run, given, monkeypatch)
    # Of x, v and k, and of v k, which is computed outside of the function.
    assert together.code.text.count("load <8 x double>") == 4
    assert_equal(together(given), alone(given))


def random_program(seed):
    """A function of numbers that calls functions of elements, and one in memory, in random order,
    each with any of the numbers so far; some in branches and loops."""
    elements = [shared(force), shared(lambda x, v, k: (jnp.sin(x) * v + k, x - v))]
    turned = jax.jit(lambda *x: tuple(jnp.sin(2.0 * a + 0.1 * b) for a, b in zip(x, x[1:])))  # noqa: B905

    def grown(rng, numbers, depth):
        numbers, rows_of_memory = list(numbers), []
        for _ in range(rng.integers(3, 9)):

            def pick(count, numbers=numbers):
                return [numbers[k] for k in rng.integers(len(numbers), size=count)]

            way = rng.integers(6 if depth else 4)
            if way == 0:
                call = elements[rng.integers(2)]
                rows = [pick(3) for _ in range(rng.integers(1, 12))]
                numbers += [part for row in rows for part in call(*row)]
            elif way == 1:
                rows_of_memory.append(turned(*pick(9)))
                numbers += rows_of_memory[-1]
            elif way == 2 and rows_of_memory:
                # Numbers that stand in memory, where a later call may have overwritten them.
                row, others = rows_of_memory[rng.integers(len(rows_of_memory))], pick(2)
                numbers += [elements[0](number, *others)[0] for number in row]
            elif way in (2, 3):
                a, b, c = pick(3)
                numbers.append(a * b + c)
            else:
                inner, first = rng.integers(2**32), pick(4)

                def body(*given, inner=inner):
                    made = grown(np.random.default_rng(inner), given, depth - 1)
                    return tuple(jnp.sin(number) for number in made[-4:])

                if way == 4:
                    numbers += lax.cond(first[0] > 0.0, body, lambda *given: given, *first)
                else:
                    numbers += lax.fori_loop(0, 3, lambda _, now, of=body: of(*now), tuple(first))
        return [jnp.sin(number) for number in numbers]

    return lambda *given: grown(np.random.default_rng(seed), given, 2)


@pytest.mark.parametrize(
    "seeds", [range(8), pytest.param(range(100, 400), marks=pytest.mark.slow)], ids=["few", "many"]
)
def test_random_programs_have_the_bits_of_single_calls(seeds, in_memory, monkeypatch):
    given = list(np.random.default_rng(0).normal(size=6))
    joined = 0
    for seed in seeds:
        with monkeypatch.context() as patch:
            together, alone = programs(random_program(seed), given, patch)
        joined += calls_at_once(together)
        assert_equal(together(given), alone(given))
    assert joined > len(seeds)
