"""Native code against XLA: each primitive on random numbers, NaN and infinities."""

import itertools
import pickle
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from jax import lax

from clearjoint._native import NativeFunction, UnsupportedPrimitiveError
from clearjoint._native.cells import Cells
from clearjoint._native.functions import NativeProgram
from clearjoint._native.lanes import WIDTH, LaneLoop
from clearjoint._native.lowering import LARGEST_UNROLLED

# No subnormal numbers, which XLA takes for zero.
SPECIAL = [0.0, -0.0, 1.0, -1.0, np.inf, -np.inf, np.nan, 1e-30, 1e300, -1e-300, 0.5, 2.5, -3.5]
RANDOM = np.random.default_rng(0)
UNARY_NAMES = """
neg abs sign floor ceil is_finite sqrt rsqrt square sin cos tan asin acos atan sinh cosh tanh
exp exp2 expm1 log log1p cbrt logistic erf asinh acosh atanh stop_gradient
"""
WHOLE_NAMES = "add sub mul div rem max min lt le eq ne ge"
BINARY_NAMES = "add sub mul div rem max min pow atan2 nextafter lt le gt ge eq ne"
UNARY: dict[str, Callable] = {name: getattr(lax, name) for name in UNARY_NAMES.split()} | {
    # Primitives of JAX 0.11 or 0.12, and later.
    "one_minus_square": getattr(lax, "one_minus_square", lambda x: (1.0 + x) * (1.0 - x)),
    "log2": jnp.log2,
    "polynomial": lambda x: jnp.polyval(jnp.array([3.0, 0.5, 2.0]), x * x),
    "constant polynomial": lambda x: jnp.polyval(jnp.array([3.0]), x),
    "round": lambda x: lax.round(x, lax.RoundingMethod.TO_NEAREST_EVEN),
    "round_away": lax.round,
    "fifth": lambda x: lax.integer_pow(x, 5),
    "inverse_square": lambda x: lax.integer_pow(x, -2),
    "erfc": lambda x: lax.erfc(lax.clamp(-1.0, x, 1.0)),
    "to_bool": lambda x: x.astype(bool),
    "to_int": lambda x: x.astype(int),
    "to_short": lambda x: x.astype(jnp.int32),
    "copy": jnp.copy,
    "barrier": lax.optimization_barrier,
    "not": lambda x: ~(x > 0.0),
    "clamp": lambda x: lax.clamp(-0.5, x, 0.7),
}


def without_sign(x):
    """Have no negative zeros, which sorting tells from others."""
    return jnp.where(x == 0, 0.0, x)


BINARY: dict[str, Callable] = {name: getattr(lax, name) for name in BINARY_NAMES.split()} | {
    "select": lambda a, b: jnp.where(a > b, a, b * 2.0),
    "and": lambda a, b: (a > 0.0) & (b > 0.0),
    "or": lambda a, b: (a > 0.0) | (b > 0.0),
    "xor": lambda a, b: (a > 0.0) ^ (b > 0.0),
    "to an integer": lambda a, b: lax.pow(a, jnp.int32(3)),
    "sorted before": lambda a, b: lax.lt_to_p.bind(without_sign(a), without_sign(b)),
    "not sorted after": lambda a, b: lax.le_to_p.bind(without_sign(a), without_sign(b)),
    "sorted as equal": lambda a, b: lax.eq_to_p.bind(without_sign(a), without_sign(b)),
    "compare bools": lambda a, b: (a > 0.0) < (b > 0.0),
}
WHOLE: dict[str, Callable] = {
    **{name: getattr(lax, name) for name in WHOLE_NAMES.split()},
    "and": lax.bitwise_and,
    "or": lax.bitwise_or,
    "xor": lax.bitwise_xor,
    "not": lambda a, b: ~a,
    "neg": lambda a, b: -a,
    "clamp": lambda a, b: lax.clamp(-2, a, 5),
    "cube": lambda a, b: lax.integer_pow(a, 3),
    "chosen": lambda a, b: lax.select_n((abs(b) % 3).astype(jnp.int32), a, b, -a),
    "bools added": lambda a, b: lax.max(a > 0, b > 0).astype(int) + lax.min(a > 0, b > 0),
    "bools compared": lambda a, b: ((a > 0) >= (b > 0)) & ((a < 3) == (b < 3)),
    "unsigned difference": lambda a, b: a.astype(jnp.uint32) - b.astype(jnp.uint32),
    "unsigned order": lambda a, b: a.astype(jnp.uint32) < b.astype(jnp.uint32),
    "unsigned as float": lambda a, b: a.astype(jnp.uint32).astype(float),
    "short, cut": lambda a, b: (a * 2**31).astype(jnp.int32),
    "short products": lambda a, b: a.astype(jnp.int32) * (b * 2**28).astype(jnp.int32),
    "abs": lambda a, b: abs(a),
    "sign": lambda a, b: lax.sign(a),
    "float": lambda a, b: a.astype(float) / 3.0,
    "short": lambda a, b: a.astype(jnp.int32) + b.astype(jnp.int32),
    "floor": lambda a, b: a // jnp.where(b == 0, 1, b),
    "least divided": lambda a, b: lax.div(jnp.where(a > 0, a, -(2**63)), b),
    "rest of the least": lambda a, b: lax.rem(jnp.where(a > 0, a, -(2**63)), b),
    "rest of the short least": lambda a, b: lax.rem(
        jnp.where(a > 0, a, -(2**31)).astype(jnp.int32), b.astype(jnp.int32)
    ),
    "wider product": lambda a, b: lax.mul(
        (a * 2**28).astype(jnp.int32), b.astype(jnp.int32), out_dtype=int
    ),
    "floats as unsigned": lambda a, b: (a * 1e9).astype(jnp.uint32).astype(float),
    "unsigned sums": lambda a, b: lax.cumsum(a.astype(jnp.uint32)).astype(float),
    "unsigned added": lambda a, b: (
        (abs(a) + 1).astype(jnp.uint32).at[1].add(jnp.uint32(2**32 - 1)).astype(float)
    ),
    "unsigned dot": lambda a, b: lax.dot(a.astype(jnp.uint32), b.astype(jnp.uint32)).astype(float),
    "wider dot": lambda a, b: lax.dot(a, b, preferred_element_type=float),
}


def numbers(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return two arrays with all pairs of special numbers, if there is room, and random ones."""
    a, b = np.meshgrid(SPECIAL, SPECIAL)
    pairs = np.concatenate([[a.ravel(), b.ravel()], 3.0 * RANDOM.normal(size=(2, 100))], axis=1)
    chosen = RANDOM.permutation(pairs.shape[1])[:size] if size < pairs.shape[1] else slice(None)
    return pairs[0][chosen], pairs[1][chosen]


def every(a, b):
    """All primitives of one and two floats."""
    return {name: f(a) for name, f in UNARY.items()} | {
        f"{name} of two": f(a, b) for name, f in BINARY.items()
    }


def assert_same(found, expected, ulp=4):
    for name, values in expected.items():
        here, there = np.asarray(found[name]), np.asarray(values)
        assert here.dtype == there.dtype and here.shape == there.shape, name
        if here.dtype.kind == "f":
            assert np.array_equal(np.isnan(here), np.isnan(there)), name
            fine = np.isfinite(there)
            infinite = np.isinf(there)
            assert np.array_equal(here[infinite], there[infinite]), name
            off = np.abs(here[fine] - there[fine])
            wrong = off > ulp * np.spacing(np.abs(there[fine]))
            assert not wrong.any(), (name, here[fine][wrong], there[fine][wrong])
        else:
            assert np.array_equal(here, there), name


def assert_as_xla(function, *arguments, ulp=4):
    assert_same(NativeFunction(function)(*arguments), jax.jit(function)(*arguments), ulp)


@pytest.mark.filterwarnings("ignore:.*encountered in")
@pytest.mark.parametrize("size", [7, 269])
def test_floats(size):
    """Small arrays, whose elements are separate values, and arrays in memory."""
    a, b = numbers(size)
    a, b = a[:size], b[:size]
    with jax.debug_nans(False):
        assert (len(a) > LARGEST_UNROLLED) == (size > 7)
        expected = jax.jit(every)(a, b)
    assert_same(NativeFunction(every)(a, b), with_numpy(expected, a, b))


def with_numpy(expected, a, b):
    """NumPy's values where XLA's are off by several units in the last place."""
    return {
        **expected,
        "atanh": np.arctanh(a),
        "asinh": np.arcsinh(a),
        "acosh": np.arccosh(a),
        "cbrt": np.cbrt(a),
        "exp": np.exp(a),
        "log1p": np.log1p(a),
        "nextafter of two": np.nextafter(a, b),
        "rem of two": np.fmod(a, b),
    }


def test_vectors_of_tangents():
    a, b = numbers(5)
    closed = jax.make_jaxpr(lambda a, b: list(every(a, b).values()))(a, b)
    found = NativeProgram(closed, tangents=5)([a, b])
    alone = NativeFunction(every)(a, b)
    for name, values in zip(every(a, b), found, strict=True):
        assert np.array_equal(values, alone[name], equal_nan=True), name


def test_lanes_have_the_bits_of_a_lane_alone():
    a, b = numbers(WIDTH)
    state = {"a": a[0], "b": b[0], "n": np.zeros((), int), "out": every(a[0], b[0])}
    state = jax.tree.map(np.asarray, state)

    def turn(shared, own, state):
        return {**state, "n": state["n"] + 1, "out": every(state["a"], state["b"])}

    def status(shared, own, state):
        return {"moves": state["n"] < 1}

    loop = LaneLoop(turn, status, None, None, state)
    columns, cells = loop.columns(None), Cells(state)
    for k in range(WIDTH):
        own = {**state, "a": np.asarray(a[k]), "b": np.asarray(b[k])}
        (row,) = cells.rows(jax.tree.map(lambda leaf: leaf[None], own))
        loop.write_lane(columns, k, np.zeros(0), row)
    loop.run(columns)
    all_found = cells.trees(columns.floats[loop.state_cells].T)
    assert all_found["n"].tolist() == [1] * WIDTH
    for k in range(WIDTH):
        found = jax.tree.map(lambda leaf, k=k: leaf[k], all_found)
        alone = NativeFunction(every)(np.asarray(a[k]), np.asarray(b[k]))
        for name, value in found["out"].items():
            assert np.array_equal(value, alone[name], equal_nan=True), name


def test_integers():
    a = RANDOM.integers(-9, 9, 40)
    b = RANDOM.integers(-3, 3, 40)

    def all_of(a, b):
        return {name: f(a, b) for name, f in WHOLE.items()}

    assert_as_xla(all_of, a, b)


def structural(x, y, table, k):
    """Rearranged, reduced and indexed arrays, at known and at computed indices."""
    return {
        "stack": jnp.stack([x, x + 1.0], axis=1),
        "concatenate": jnp.concatenate([x, y[:2]]),
        "transposed": jnp.outer(x, y).T,
        "by columns": jnp.ravel(jnp.outer(x, y), order="F"),
        "table by columns": jnp.ravel(table, order="F"),
        "flipped": x[::-1],
        "padded": jnp.pad(x, (1, 2)),
        "tiled": jnp.tile(x, 30),
        "matrix": jnp.outer(x, y) @ jnp.outer(y, x),
        "sum": jnp.outer(x, y).sum(axis=0),
        "largest": x.max(),
        "any": (x > 0.0).any(),
        "where": jnp.argmax(x),
        "cumulated": jnp.cumsum(x),
        "cumulated products": jnp.cumprod(x),
        "largest so far": lax.cummax(x),
        "smallest so far": lax.cummin(jnp.outer(x, y), axis=1),
        "backwards": lax.cumsum(jnp.outer(x, y), reverse=True),
        "product": x.prod(),
        "smallest": jnp.outer(x, y).min(axis=1),
        "all": (x > -9.0).all(),
        "index of the smallest": jnp.argmin(jnp.outer(x, y), axis=0),
        "padded within": lax.pad(x, 7.0, [(1, -1, 2)]),
        "cut": lax.pad(jnp.outer(x, y), 0.0, [(-1, 1, 0), (2, -2, 0)]),
        "table padded within": lax.pad(table, x[0], [(-2, 3, 1), (1, 0, 0)]),
        "padded to a table": lax.pad(jnp.outer(x, y), y[0], [(0, 40, 0), (1, 1, 0)]),
        "cut from a table": lax.pad(table, 0.0, [(-20, 1, 0), (0, -1, 0)]),
        "split": jnp.split(jnp.outer(x, y), [1], axis=1)[1],
        "rows of a table": jnp.split(table, [7, 70])[1],
        "columns of a table": jnp.split(table, [1], axis=1)[1],
        "unstacked": jnp.unstack(table, axis=1)[1],
        "elements": jnp.unstack(x),
        "elements of a table": jnp.unstack(jnp.ravel(table))[5:9],
        "table turned": table.T,
        "large outer product": jnp.outer(x, y).reshape(9, 1) @ jnp.outer(x, y).reshape(1, 9) + 1.0,
        "batches": jnp.einsum("ij,kjl->ikl", jnp.outer(x, y), jnp.ones((2, 3, 2))),
        "repeated": jnp.expand_dims(x, (0, 2)) + jnp.zeros((2, 3, 2)),
        "small part": lax.dynamic_slice(x, (k + 1,), (2,)),
        "small part written": lax.dynamic_update_slice(x, y[:2], (k + 1,)),
        "row from the end": lax.dynamic_index_in_dim(table, -1 - k, 0, keepdims=False),
        "at, clipped": x.at[jnp.array([7 + k, -9])].get(mode="clip"),
        "set": x.at[1].set(7.0),
        "added": x.at[jnp.array([0, 2])].add(y[:2]),
        "applied": x.at[jnp.array([k, 1, 1])].apply(jnp.sin),
        "part of an empty array": lax.dynamic_slice(table[:0], (0, k), (0, 1)),
        "at": x[k],
        "row": table[k],
        "outside": (jnp.arange(5) * k).at[jnp.array([7, 1])].get(mode="fill"),
        "outside of floats": x.at[jnp.array([3, 0])].get(mode="fill"),
        "outside, as given": x.at[jnp.array([3, k])].get(mode="fill", fill_value=4.0),
        "outside of bools": (x > 0.0).at[jnp.array([3 + k, 0])].get(mode="fill"),
        "rows": table[jnp.array([1, 90, -2])],
        "many": table[jnp.arange(60) % 7],
        "part": lax.dynamic_slice(table, (k, 0), (40, 2)),
        "written": lax.dynamic_update_slice(table, jnp.outer(y, y)[:, :2], (k, 0)),
        "cumulated table": jnp.cumsum(table[:, 0]),
        "table's sum": table[:, 1].sum(),
        "interpolated": jnp.interp(y[0], table[:, 0], y[1] * table[:, 1]),
        "searched": jnp.searchsorted(table[:, 0], y[0]),
        "iota": jnp.arange(100) * k,
        "known infinite angle": jnp.sin(jnp.inf) + x[0],
        "polynomials": jnp.polyval(jnp.outer(x, y)[:, :, None], y**2),
    }


def test_structure():
    x, y = RANDOM.normal(size=3), RANDOM.normal(size=3)
    table = np.cumsum(RANDOM.uniform(size=(80, 2)), axis=0)
    # A plain number is known when the program is built, an array only when it runs.
    for k in (0, 2, np.asarray(2)):
        assert_as_xla(structural, x, 10.0 * abs(y), table, k, ulp=64)


@pytest.mark.parametrize("mode", ["clip", "fill"])
def test_scatters_outside(mode):
    """A window that lies partly outside is dropped as a whole, or moved inside."""
    numbers = lax.ScatterDimensionNumbers((0,), (), (0,))

    def scattered(x, k):
        at, window = x.at[k], jnp.array([7.0, 8.0])
        own = lax.GatherScatterMode.from_any(mode)
        return {
            "set": at.set(9.0, mode=mode),
            "added": at.add(jnp.array([1.0, 2.0, 4.0]), mode=mode),
            "multiplied": at.multiply(3.0, mode=mode),
            "smallest": at.min(0.5, mode=mode),
            "largest": at.max(2.5, mode=mode),
            "window": lax.scatter(x, k[:1], window, numbers, mode=own),
            "column": jnp.outer(x, x).at[:, k[0]].set(1.0, mode=mode),
        }

    for k in ([0, 2, 2], [4, 1, -1], [-1, 9, -9], [9, 0, 4]):
        assert_as_xla(scattered, np.arange(5.0), np.array(k))


def control(x, n, rows):
    """Loops and branches, over scalars, small arrays and arrays in memory."""

    def turn(carry):
        k, total, table = carry
        row = jnp.stack([total, total * 0.5])
        table = lax.cond(
            total > 3.0, lambda: lax.dynamic_update_index_in_dim(table, row, k, 0), lambda: table
        )
        return k + 1, total * 1.1 + x, table

    def visit(carry, row):
        inner = lax.while_loop(lambda c: c[0] < row[0], lambda c: (c[0] + 0.3, c[1] + 1), (0.0, 0))
        carry = carry * 0.9 + inner[0]
        return carry, (carry, row * carry, inner[1])

    table = jnp.zeros((60, 2))
    many = lax.while_loop(lambda c: c[0] < n, turn, (0, 1.0, table))
    few = lax.while_loop(lambda c: c[0] < n, turn, (0, 1.0, table[:20]))
    swapped = lax.fori_loop(0, n, lambda k, ab: (ab[1], ab[0] + k), (table, table + 1.0))
    return {
        "k": many[0],
        "total": many[1],
        "table": many[2],
        "few": few[2],
        "swapped": swapped[0],
        "scanned": lax.scan(visit, x, rows)[1][1],
        "backwards": lax.scan(visit, x, rows, reverse=True)[1][0],
        "turns": lax.scan(visit, x, rows)[1][2],
        "mapped": lax.map(lambda row: row.sum() ** 2, rows),
        "old table": table,
        "switched": lax.cond(x > 0.5, lambda v: v * 2.0, lambda v: v - 1.0, rows),
    }


@pytest.mark.parametrize("x", [0.25, 0.75])
def test_loops_and_branches(x):
    for count in (6, 70):
        assert_as_xla(control, x, 15, RANDOM.uniform(size=(count, 2)), ulp=64)


@pytest.mark.parametrize("size", [60, 300])
def test_fixed_arguments_of_bound_functions_are_the_same_in_all_calls(size):
    def moved(table, k):
        return lax.dynamic_update_slice(table, jnp.zeros(1), (k,)).sum()

    table, ks = np.ones(size), np.arange(5)
    found = NativeFunction(moved).rows((table, ks[0]), [None, ks])
    np.testing.assert_array_equal(found, size - 1.0)


def test_results_do_not_share_memory():
    first, second, part = NativeFunction(lambda x: (x, x, x[1:]))(np.arange(100.0))
    first[:] = -1.0
    np.testing.assert_array_equal(second, np.arange(100.0))
    np.testing.assert_array_equal(part, np.arange(1.0, 100.0))


@pytest.mark.parametrize("size", [4, 14])
def test_linear_systems(size):
    """Small matrices, and matrices in memory; all sides, triangles and transposes."""
    draws = RANDOM.normal(size=(2, size, size))
    given = draws[0] @ draws[0].T + np.eye(size), draws[1, 0]

    def solution(matrix, right):
        factor = jax.scipy.linalg.cho_factor(matrix)
        return jax.scipy.linalg.cho_solve(factor, right)

    def solutions(matrix, right):
        found = {"factor": jnp.linalg.cholesky(matrix), "solution": solution(matrix, right)}
        found["derivative"] = jax.jvp(solution, (matrix, right), (matrix.T, right * right))[1]
        found["several"] = jax.vmap(solution)(
            jnp.stack([matrix, 2.0 * matrix]), jnp.stack([right] * 2)
        )
        for left, lower, turned, ones in itertools.product([True, False], repeat=4):
            options = {"left_side": left, "lower": lower, "transpose_a": turned}
            rows = jnp.outer(right, jnp.arange(1.0, 4.0))
            found[f"{options} {ones}"] = lax.linalg.triangular_solve(
                matrix, rows if left else rows.T, unit_diagonal=ones, **options
            )
        return found

    found, expected = NativeFunction(solutions)(*given), jax.jit(solutions)(*given)
    for name, values in expected.items():
        scale = 1e-12 * np.abs(values).max()
        np.testing.assert_allclose(found[name], values, rtol=1e-10, atol=scale, err_msg=name)


PRODUCTS = {
    "ij,jk->ik": ((20, 9), (9, 30)),
    "bij,bkj->bik": ((3, 20, 4), (3, 2, 4)),
    "ij,j->i": ((20, 9), (9,)),
    "i,i->": ((90,), (90,)),
    "i,j->ij": ((90,), (3,)),
    "abc,cbd->ad": ((3, 9, 4), (4, 9, 2)),
}


def test_large_products():
    def products(pairs):
        return {name: jnp.einsum(name, *pair) for name, pair in pairs.items()}

    pairs = {name: tuple(map(RANDOM.random, shapes)) for name, shapes in PRODUCTS.items()}
    expected = {name: np.einsum(name, *pair) for name, pair in pairs.items()}
    assert_same(NativeFunction(products)(pairs), expected, ulp=64)


def test_large_constants_may_be_literals_of_a_program():
    table, flag = jnp.arange(100.0), "jax_use_simplified_jaxpr_constants"
    before = getattr(jax.config, flag, None)
    try:
        # Later versions of JAX may do this in any case.
        if before is not None:
            jax.config.update(flag, True)
        found = NativeFunction(lambda k: lax.dynamic_index_in_dim(table, k))(np.asarray(5))
    finally:
        if before is not None:
            jax.config.update(flag, before)
    np.testing.assert_array_equal(found, [5.0])


def assert_exact(ours, exact, *arguments, bits=200):
    """Check a function of numbers to a unit in the last place; where it is infinite, the exact
    value must be too large."""
    with mpmath.workprec(bits):
        for found, *at in zip(NativeFunction(ours)(*arguments), *arguments, strict=True):
            expected = exact(*map(mpmath.mpf, at))
            if not np.isfinite(found):
                assert found == float(expected), (at, found, expected)
            else:
                error = abs(mpmath.mpf(float(found)) - expected) / np.spacing(abs(found))
                assert error <= 1.0, (at, found, error)


def test_sines_and_cosines_are_correct_to_a_unit_in_the_last_place():
    x = np.concatenate(
        [
            RANDOM.uniform(-10.0, 10.0, 500),
            RANDOM.uniform(-1e8, 1e8, 200),
            np.arange(-60, 60) * (np.pi / 2.0),
            [1e9, -1e300, 5e-324],
        ]
    )
    assert_exact(jnp.sin, mpmath.sin, x)
    assert_exact(jnp.cos, mpmath.cos, x)


SIZES = np.concatenate([RANDOM.uniform(0.0, 1.0, 200), 10.0 ** RANDOM.uniform(-310, 308, 300)])
NEAR_ONE = 1.0 + RANDOM.normal(size=300) * 10.0 ** RANDOM.uniform(-16, 0, 300)
SIGNED = np.concatenate([RANDOM.normal(size=200) * 10.0 ** RANDOM.uniform(-12, 3, 200), -SIZES])
ENDS = [0.0, -0.0, 5e-324, -5e-324, 2.3e-308, np.inf, -np.inf, np.nan, 1.0, -1.0, 700.0, -745.0]
EXACT: dict[str, tuple[Callable, Callable, np.ndarray]] = {
    "exp": (jnp.exp, mpmath.exp, SIGNED),
    "expm1": (jnp.expm1, mpmath.expm1, SIGNED),
    "tanh": (jnp.tanh, mpmath.tanh, SIGNED),
    "log": (jnp.log, mpmath.log, np.concatenate([SIZES, NEAR_ONE])),
    "log1p": (jnp.log1p, mpmath.log1p, np.concatenate([SIZES, NEAR_ONE - 1.0])),
    "arctan": (lax.atan, mpmath.atan, np.concatenate([SIGNED, NEAR_ONE])),
}


@pytest.mark.parametrize("name", EXACT)
def test_elementary_functions_are_correct_to_a_unit_in_the_last_place(name):
    ours, exact, x = EXACT[name]
    x = x[(x > -1.0) | (name in ("exp", "expm1", "tanh", "arctan"))]
    x = x[(x > 0.0) | (name != "log")]
    x = x[:: 3 if name in ("exp", "expm1") else 1]  # Their exact values take longest.
    assert_exact(ours, exact, x, bits=1200)
    ends = np.array(ENDS)
    with np.errstate(all="ignore"):
        expected = getattr(np, name)(ends)
    found = NativeFunction(ours)(ends)
    assert np.array_equal(found, expected, equal_nan=True)
    assert np.array_equal(np.signbit(found)[:4], np.signbit(expected)[:4])


def test_powers_are_correct_to_a_unit_in_the_last_place():
    x = np.concatenate([SIZES, abs(NEAR_ONE), 10.0 ** RANDOM.uniform(-8, 3, 500)])
    y = RANDOM.normal(size=x.size) * 10.0 ** RANDOM.uniform(-3, 3, x.size)
    y[::3] = RANDOM.choice([1.5, -0.2, 1.0 / 3.0, 2.5, 10.0 / 9.0], y[::3].size)
    with np.errstate(all="ignore"):
        size = y * np.log2(x)
    is_number = (size > -1074.0) & (size < 1023.0)
    assert_exact(jnp.power, mpmath.power, x[is_number], y[is_number])
    a, b = (pair.ravel() for pair in np.meshgrid(ENDS + [0.5, 2.0, 3.0], ENDS + [0.5, 2.0, 3.0]))
    with np.errstate(all="ignore"):
        np.testing.assert_allclose(NativeFunction(jnp.power)(a, b), a**b, rtol=3e-16, atol=0.0)


def test_angles_are_correct_to_a_unit_in_the_last_place():
    angle = np.concatenate(
        [
            RANDOM.uniform(-np.pi, np.pi, 600),
            # Where the reduction changes, and beside the axes.
            (np.arange(-8, 9) * np.pi / 8.0 + RANDOM.normal(size=(20, 17)) * 1e-9).ravel(),
        ]
    )
    length = 10.0 ** RANDOM.uniform(-250.0, 250.0, angle.size)
    y, x = length * np.sin(angle), length * np.cos(angle)
    y[::7] *= 10.0 ** RANDOM.uniform(-40.0, 40.0, y[::7].size)
    assert_exact(jnp.arctan2, mpmath.atan2, y, x)
    y, x = (pair.ravel() for pair in np.meshgrid(ENDS, ENDS))
    found, expected = NativeFunction(jnp.arctan2)(y, x), np.arctan2(y, x)
    assert np.array_equal(found, expected, equal_nan=True)
    assert np.array_equal(np.signbit(found), np.signbit(expected) & ~np.isnan(expected))


@pytest.mark.parametrize("axes", [(0,), (1,), (2,), (0, 1), (1, 2), (-1,)])
def test_large_arrays_are_reduced_along_axes(axes):
    array = RANDOM.normal(size=(4, 5, 6))
    array[1, 2, 3] = np.nan

    def reduced(a: jax.Array) -> list[jax.Array]:
        return [jnp.sum(a, axes), jnp.max(a, axes), jnp.prod(a, axes)]

    for native, expected in zip(
        NativeFunction(reduced)(array), reduced(jnp.asarray(array)), strict=True
    ):
        assert native.shape == expected.shape
        np.testing.assert_allclose(native, expected, rtol=1e-13, equal_nan=True)


def test_transposed_loops_begin_with_empty_arrays():
    def last(a: jax.Array) -> jax.Array:
        def step(total: jax.Array, k: jax.Array) -> tuple[jax.Array, None]:
            return total * 0.5 + a[k], None

        return lax.scan(step, jnp.zeros(()), jnp.arange(3))[0]

    def pulled(a: jax.Array) -> jax.Array:
        return jax.grad(last)(a)

    np.testing.assert_array_equal(NativeFunction(pulled)(np.ones(3)), [0.25, 0.5, 1.0])


@pytest.mark.parametrize(
    ("function", "arguments", "message"),
    [
        (jnp.linalg.inv, [np.eye(3)], "lu"),
        (jnp.prod, [np.zeros(0)], "no elements"),
        (
            jax.vmap(lambda a: lax.while_loop(lambda x: x < 9.0, jnp.exp, a)),
            [np.ones(3)],
            "a loop whose condition is an array",
        ),
        (lambda a: a @ a, [np.zeros(0)], "dot_general of no elements"),
        (
            lambda a: lax.cumsum(a, reverse=True),
            [np.zeros(99)],
            "cumsum of large arrays in reverse order",
        ),
        (
            jax.vmap(lambda a, k: a.at[k].set(1.0)),
            [np.zeros((2, 3)), np.array([0, 1])],
            "scatter of batches",
        ),
    ],
)
def test_unknown_primitives_are_named(function, arguments, message):
    with pytest.raises(UnsupportedPrimitiveError, match=message):
        NativeFunction(function)(*arguments)


def with_parameters(function: Callable, change: Callable[[dict], dict]) -> NativeProgram:
    """The program of a function, with other parameters in its equations."""
    closed = jax.make_jaxpr(function)(np.arange(4.0))
    equations = [equation.replace(params=change(equation.params)) for equation in closed.jaxpr.eqns]
    return NativeProgram(closed.replace(jaxpr=closed.jaxpr.replace(eqns=equations)))


ELEMENTWISE = [
    lambda a: a * a,
    lambda a: a**3,
    lax.round,
    lambda a: lax.convert_element_type(a, int),
]


@pytest.mark.parametrize(
    "function",
    [
        *ELEMENTWISE,
        *(lambda a: lax.reduce_sum(a, (0,)), lax.cumsum, lambda a: lax.slice(a, (0,), (3,))),
        *(lambda a: lax.stack([a, a], axis=1), lambda a: lax.concatenate([a, a], 0)),
        lambda a: lax.unstack(lax.reshape(a, (2, 2)), axis=1),
    ],
)
def test_a_renamed_parameter_is_left_to_xla(function):
    """Such as that of a later JAX; the rule would take the default in its place."""
    with_parameters(function, dict)
    with pytest.raises(UnsupportedPrimitiveError, match="without the parameter|with the parameter"):
        with_parameters(function, lambda old: {f"new_{key}": value for key, value in old.items()})


@pytest.mark.parametrize("function", ELEMENTWISE)
def test_an_unknown_parameter_is_left_to_xla(function):
    with pytest.raises(UnsupportedPrimitiveError, match="with the parameter 'doubled'"):
        with_parameters(function, lambda old: {**old, "doubled": True})


def test_an_accuracy_of_an_elementary_function_is_left_to_xla():
    with pytest.raises(UnsupportedPrimitiveError, match="exp with the parameter 'accuracy'"):
        NativeFunction(lambda a: lax.exp(a, accuracy=lax.AccuracyMode.HIGHEST))(1.0)


def test_threads_may_load_a_program_at_once():
    """As they do with a program that was kept on disk. A loop long enough that they are in it
    together."""

    def halved(x):
        return lax.while_loop(
            lambda now: now[0] < 1_000_000, lambda now: (now[0] + 1, 0.5 * now[1] + x), (0, x)
        )[1]

    kept = pickle.dumps(NativeProgram(jax.make_jaxpr(halved)(1.0)))
    for _ in range(10):
        program, begin = pickle.loads(kept), threading.Barrier(4)

        def run(_, program=program, begin=begin):
            begin.wait()
            return program([1.0])[0]

        with ThreadPoolExecutor(4) as threads:
            assert list(threads.map(run, range(4))) == [2.0] * 4
