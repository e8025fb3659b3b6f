"""Random programs of JAX, for comparing two ways to compile them.

A program takes and returns the same list of arrays. All operations on floats are exact, so that the
results do not depend on the order of sums or on fused products: floats are small multiples of 1/4,
infinities and NaN. Arrays are used repeatedly and returned more than once, and functions are called
repeatedly.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

FLOAT, INT, SHORT, UNSIGNED, BOOL = map(np.dtype, ("f8", "i8", "i4", "u4", "?"))
SHAPES = [(), (), (4,), (2, 3), (60,), (60,), (20, 3)]
"""Those of more than 48 elements stay in memory."""
SPECIAL = [0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan]
DEEPEST = 2
Arrays = list[Any]


def drawn_number(rng: np.random.Generator) -> float:
    return float(rng.choice(SPECIAL)) if rng.random() < 0.3 else 0.25 * int(rng.integers(-40, 41))


def drawn_array(rng: np.random.Generator, shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """Random numbers; of floats few special ones, which would soon fill all arrays."""
    if dtype == FLOAT:
        numbers = 0.25 * rng.integers(-40, 41, shape)
        return np.where(rng.random(shape) < 0.05, rng.choice(SPECIAL, shape), numbers)
    if dtype == BOOL:
        return rng.random(shape) < 0.5
    return rng.integers(0 if dtype == UNSIGNED else -5, 6, shape).astype(dtype)


def tame(x: Any) -> Any:
    """Whole numbers in a range in which products and sums are exact."""
    return lax.clamp(-1024.0, lax.floor(x), 1024.0)


class RandomProgram:
    """A function of arrays whose operations are drawn anew, but equally, each time it is traced.

    Its `arguments` are some random arrays.
    """

    def __init__(self, seed: int, size: int = 12):
        self.seed, self.size = seed, size
        rng = np.random.default_rng([seed, 1])
        kinds = [FLOAT, FLOAT, FLOAT, INT, BOOL, SHORT, UNSIGNED]
        # At least one number, condition and large array, so that there is something to branch on.
        self.types = [((), FLOAT), ((), INT), ((), BOOL), ((60,), FLOAT), ((20, 3), FLOAT)]
        for _ in range(rng.integers(1, 4)):
            self.types.append((SHAPES[rng.integers(len(SHAPES))], kinds[rng.integers(len(kinds))]))

    def arguments(self, number: int) -> list[np.ndarray]:
        rng = np.random.default_rng([self.seed, 2, number])
        return [drawn_array(rng, *one) for one in self.types]

    def __call__(self, *arguments: Any) -> Arrays:
        drawing = Drawing(np.random.default_rng([self.seed, 3]), list(arguments), 0)
        drawing.grow(self.size)
        return drawing.results(self.types)


class Drawing:
    """Draws operations on a growing list of arrays, `known`, at a depth of nested control."""

    def __init__(self, rng: np.random.Generator, known: Arrays, depth: int):
        self.rng, self.known, self.depth = rng, known, depth
        self.functions: list[tuple[Callable[..., Arrays], list[Any]]] = []

    # Arrays.

    def pick(self, shape: tuple[int, ...] | None = None, dtype: np.dtype | None = None) -> Any:
        """A known array, often a recent one, made to fit if necessary."""
        fitting = [
            x
            for x in self.known
            if (shape is None or x.shape == shape) and (dtype is None or x.dtype == dtype)
        ]
        if fitting and self.rng.random() < 0.9:
            last = self.rng.random() < 0.5
            return fitting[-1] if last else fitting[self.rng.integers(len(fitting))]
        if self.rng.random() < 0.2 and shape is not None and dtype is not None:
            return jnp.asarray(drawn_array(self.rng, shape, dtype))
        x = self.known[self.rng.integers(len(self.known))]
        return self.fitted(x, x.shape if shape is None else shape, dtype or x.dtype)

    def fitted(self, x: Any, shape: tuple[int, ...], dtype: np.dtype) -> Any:
        if x.shape != shape:
            count = int(np.prod(shape))
            flat = jnp.ravel(x)
            x = (flat[:count] if flat.size >= count else jnp.resize(flat, count)).reshape(shape)
        return x.astype(dtype)

    def results(self, types: Sequence[tuple[tuple[int, ...], np.dtype]]) -> Arrays:
        """An array of each type; the same one may occur twice."""
        return [self.pick(*one) for one in types]

    def several(self, most: int) -> Arrays:
        return [self.pick() for _ in range(self.rng.integers(1, most + 1))]

    def inner(self, known: Sequence[Any], seed: int, size: int) -> "Drawing":
        """A drawing for the body of a branch, loop or function.

        The body of a function, but not of a branch or loop, is drawn once for all calls."""
        drawing = Drawing(np.random.default_rng(seed), list(known), self.depth + 1)
        drawing.grow(size)
        return drawing

    def seed(self) -> int:
        return int(self.rng.integers(1 << 30))

    # Operations.

    def grow(self, size: int) -> None:
        simple = [self.arithmetic, self.arithmetic, self.whole, self.logic, self.rearranged]
        simple += [self.combined, self.sliced, self.updated, self.updated, self.gathered]
        simple += [self.scattered]
        control = [self.branch, self.branch, self.loop, self.scan, self.called]
        for _ in range(size):
            nested = self.depth < DEEPEST and self.rng.random() < 0.3
            rules = control if nested else simple
            self.known += rules[self.rng.integers(len(rules))]()

    def choice(self, *options: Any) -> Any:
        return options[self.rng.integers(len(options))]

    def arithmetic(self) -> Arrays:
        x = self.pick(None, FLOAT)
        y = self.pick(x.shape, FLOAT) if self.rng.random() < 0.7 else drawn_number(self.rng)
        rule = self.choice(
            lambda: x + y,
            lambda: x - y,
            lambda: tame(x) * tame(jnp.asarray(y)),
            lambda: x / self.choice(1.0, -1.0, 4.0),
            lambda: jnp.maximum(x, y),
            lambda: jnp.minimum(x, y),
            lambda: -x,
            lambda: abs(x),
            lambda: jnp.sign(x),
            lambda: lax.integer_pow(tame(x), 3),
            lambda: lax.rem(x, jnp.full_like(x, 3.0)),
            lambda: lax.round(x, lax.RoundingMethod.TO_NEAREST_EVEN),
            lambda: jnp.where(x > y, x, y),
            lambda: jnp.where(self.pick(x.shape, BOOL), x, y),
            lambda: lax.select_n(self.pick((), BOOL), x, x + 1.0),
            lambda: lax.optimization_barrier(x),
        )
        return [lax.clamp(-1e6, rule(), 1e6) if self.rng.random() < 0.7 else rule()]

    def whole(self) -> Arrays:
        x = self.pick(None, self.choice(INT, SHORT, UNSIGNED))
        y = self.pick(x.shape, x.dtype)
        rule = self.choice(
            lambda: x + y,
            lambda: x - y,
            lambda: x * y,
            # XLA ends the process for some divisors 0 and -1; `test_primitives.py` has these.
            lambda: lax.div(x, lax.max(y & 7, jnp.ones_like(y))),
            lambda: lax.rem(x, lax.max(y & 7, jnp.ones_like(y))),
            lambda: lax.max(x, y),
            lambda: lax.min(x, y),
            lambda: x & y,
            lambda: x ^ y,
            lambda: ~x,
            lambda: x.astype(self.choice(FLOAT, INT, SHORT, UNSIGNED, BOOL)),
            lambda: self.pick(None, FLOAT).astype(x.dtype),
            lambda: jnp.where(x > y, x, y),
            lambda: lax.select_n(jnp.asarray(x, jnp.int32), x, y, x) if x.size == 1 else x - 1,
        )
        return [rule()]

    def logic(self) -> Arrays:
        x = self.pick(None, self.choice(FLOAT, INT, BOOL))
        y = self.pick(x.shape, x.dtype)
        rule = self.choice(
            lambda: x < y,
            lambda: x <= y,
            lambda: x == y,
            lambda: x != y,
            lambda: jnp.isfinite(x),
            lambda: (x > y) | (y == x),
            lambda: ~(x > y) & (y <= x),
        )
        return [rule()]

    def rearranged(self) -> Arrays:
        x = self.pick()
        rule = self.choice(
            lambda: [x.T],
            lambda: [jnp.flip(x)],
            lambda: [x.reshape(-1)],
            lambda: [x.reshape((-1, 1))],
            lambda: [jnp.broadcast_to(x, (2, *x.shape))[1]],
            lambda: [jnp.ravel(x)[1:]] if x.size > 1 else [x],
            lambda: [jnp.ravel(x)[::2]],
            lambda: [jnp.concatenate([jnp.ravel(x), jnp.ravel(self.pick(None, x.dtype))])],
            lambda: [jnp.stack([x, self.pick(x.shape, x.dtype)])],
            lambda: list(jnp.split(jnp.ravel(x), [1])) if x.size > 1 else [x],
            lambda: [jnp.pad(x[:3], (1, 2))] if x.ndim == 1 else [x],
            lambda: [jnp.arange(x.size).astype(x.dtype)],
            lambda: [jnp.tile(x.ravel(), 3)[:70]],
        )
        return [array for array in rule() if 0 < array.size <= 130]

    def combined(self) -> Arrays:
        x = self.pick()
        small = jnp.ravel(self.pick())[:6]
        rule = self.choice(
            lambda: jnp.sum(x),
            lambda: jnp.max(x),
            lambda: jnp.min(x),
            lambda: jnp.any(x > 0),
            lambda: jnp.all(x > 0),
            lambda: jnp.sum(small.reshape(-1, 1), axis=1),
            lambda: jnp.cumsum(small),
            lambda: lax.cummax(small.astype(float), reverse=True),
            lambda: jnp.argmax(small),
            lambda: jnp.argmin(small),
            lambda: jnp.cumsum(jnp.ravel(x)),
            lambda: jnp.prod(lax.clamp(-2.0, small.astype(float), 2.0)),
            lambda: jnp.dot(tame(small.astype(float)), tame(small[::-1].astype(float))),
        )
        return [rule()]

    def index(self) -> Any:
        """A random index: known, or as a part of the program; at times out of range."""
        return int(self.rng.integers(-3, 65)) if self.rng.random() < 0.3 else self.pick((), INT)

    def sliced(self) -> Arrays:
        x = self.pick()
        if x.ndim == 0:
            return [x]
        # Rows, which are consecutive in memory.
        size = int(self.rng.integers(1, x.shape[0] + 1))
        return [lax.dynamic_slice_in_dim(x, self.index(), size)]

    def updated(self) -> Arrays:
        x = self.pick(self.choice((60,), (20, 3), (60,), (4,)))
        size = int(self.rng.integers(1, x.shape[0] + 1))
        rows = self.pick((size, *x.shape[1:]), x.dtype)
        return [lax.dynamic_update_slice_in_dim(x, rows, self.index(), 0)]

    def gathered(self) -> Arrays:
        x = self.pick()
        if x.ndim == 0:
            return [x]
        indices = self.pick(self.choice((), (4,), (60,)), self.choice(INT, SHORT))
        return [x.at[indices].get(mode=self.choice("clip", "fill"))] if x.size <= 60 else [x]

    def scattered(self) -> Arrays:
        x, indices = self.pick((4,)), self.pick(self.choice((), (4,)), INT)
        values, mode = self.pick(indices.shape, x.dtype), self.choice("clip", "fill")
        if self.rng.random() < 0.5 or x.dtype == BOOL:
            return [x.at[indices].set(values, mode=mode)]
        return [x.at[indices].add(values, mode=mode)]

    # Control.

    def types_of_results(self, arguments: Arrays) -> list[tuple[tuple[int, ...], np.dtype]]:
        """Mostly those of arguments, whose cells may serve for the results."""
        types = [(x.shape, x.dtype) for x in arguments]
        chosen = [types[self.rng.integers(len(types))] for _ in range(self.rng.integers(1, 3))]
        # Of one type, so that one array may stand for several.
        return chosen * int(self.choice(1, 2))

    def body(
        self, types: list[Any], size: int, closed: Sequence[Any] = ()
    ) -> Callable[..., Arrays]:
        """A function that returns arrays of the given types, also of arrays that it closes over."""
        seed = self.seed()

        def call(*arguments: Any) -> Arrays:
            return self.inner([*closed, *arguments], seed, size).results(types)

        return call

    def branch(self) -> Arrays:
        arguments, closed = self.several(3), self.several(1)
        large = self.choice((60,), (20, 3))
        arguments += [self.pick(large, FLOAT) + k for k in range(2)]
        types = self.types_of_results(arguments if self.rng.random() < 0.5 else arguments[-1:])
        # Long branches are jumps, short ones are both executed.
        sizes = [int(self.rng.choice([0, 1, 3, 10])) for _ in range(2)]
        no, yes = (self.body(types, size, closed) for size in sizes)
        if self.rng.random() < 0.2:
            index = int(self.rng.integers(-1, 4))
            return lax.switch(index, [no, yes, no], *arguments)
        if self.rng.random() < 0.2:
            return lax.switch(self.pick((), INT), [no, yes], *arguments)
        return lax.cond(self.pick((), BOOL), yes, no, *arguments)

    def loop(self) -> Arrays:
        first, closed = self.several(3), self.several(1)
        body = self.body([(x.shape, x.dtype) for x in first], int(self.rng.integers(0, 5)), closed)
        end, stops = jnp.clip(self.index(), 0, 3), self.rng.random() < 0.3

        def holds(carry: Any) -> Any:
            goes = carry[0] < end
            return goes & (jnp.sum(carry[1]) != 0) if stops else goes

        step = lambda carry: (carry[0] + 1, *body(*carry[1:]))  # noqa: E731
        return list(lax.while_loop(holds, step, (0, *first))[1:])

    def scan(self) -> Arrays:
        first, closed = self.several(2), self.several(1)
        rows = [self.pick(self.choice((20, 3), (4,), (60,)))]
        length = rows[0].shape[0]
        if self.rng.random() < 0.5:
            rows.append(self.pick((length,)))
        carried = [(x.shape, x.dtype) for x in first]
        outs = self.types_of_results([*first, *(x[0] for x in rows)])
        outs = [one for one in outs if length * np.prod(one[0]) <= 130]
        body = self.body([*carried, *outs], int(self.rng.integers(0, 4)), closed)

        def step(carry: Any, row: Any) -> Any:
            results = body(*carry, *row)
            return tuple(results[: len(first)]), tuple(results[len(first) :])

        carry, out = lax.scan(step, tuple(first), tuple(rows), reverse=self.rng.random() < 0.3)
        return [*carry, *out]

    def called(self) -> Arrays:
        """A call of a function that may have been called before."""
        if not self.functions or self.rng.random() < 0.5:
            arguments = self.several(3)
            types = self.types_of_results(arguments)
            function = jax.jit(self.body(types, int(self.rng.integers(0, 5))))
            self.functions.append((function, [(x.shape, x.dtype) for x in arguments]))
        function, types = self.functions[self.rng.integers(len(self.functions))]
        calls = int(self.choice(1, 1, 3))
        return [x for _ in range(calls) for x in function(*self.results(types))]
