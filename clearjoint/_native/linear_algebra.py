"""Rules of the primitives of linear algebra, by loops over arrays in memory.

Matrices are the last two axes of an array; the axes before them number the matrices.
"""

import math
from collections.abc import Callable

import numpy as np

from .elementwise import convert
from .lowering import Array, Equation, EquationRule, InMemory, Lowering, aval_of, kind_of
from .operations import Symbol, Value

Term = Callable[[Symbol], Symbol]


def _index(lower: Lowering, number: int) -> Symbol:
    return Symbol(lower.ops, lower.ops.constant("i", number))


def _counted(lower: Lowering, begin: Symbol, end: Symbol, visit: Callable[[Symbol], None]) -> None:
    def body(k: Value, _: list[Value]) -> list[Value]:
        visit(Symbol(lower.ops, k))
        return []

    lower.ops.counted(begin.value, end.value, [], body)


def _sum(lower: Lowering, first: Symbol, begin: Symbol, end: Symbol, term: Term) -> Symbol:
    """Return `first` plus the results of `term` for the indices from `begin` to `end` - 1."""
    ops = lower.ops

    def add(k: Value, totals: list[Value]) -> list[Value]:
        return [(Symbol(ops, totals[0]) + term(Symbol(ops, k))).value]

    (total,) = ops.counted(begin.value, end.value, [first.value], add)
    return Symbol(ops, total)


def _read(lower: Lowering, memory: InMemory, index: Symbol) -> Symbol:
    return Symbol(lower.ops, lower.load(memory, index.value))


def large_product(lower: Lowering, equation: Equation, *factors: Array) -> list[Array]:
    """Return the products of two arrays, summed along some axes (`jax.lax.dot_general`)."""
    contracted, batches = equation.params["dimension_numbers"]
    out = aval_of(equation.outvars[0])
    # Each element of the result is the inner product of two rows, which extend along the summed
    # axes of the factors. Of each factor: its memory, the index of the first element of each row,
    # and a table of the offsets of a row's elements from the first one, which all rows share.
    memories, starts, offsets = [], [], []
    for factor, atom, along, batch in zip(
        factors, equation.invars, contracted, batches, strict=True
    ):
        shape = tuple(aval_of(atom).shape)
        memories.append(lower.in_memory(factor, shape))
        # Row-major indices of the elements, in the order (batch, other axes, summed axes).
        others = [k for k in range(len(shape)) if k not in (*batch, *along)]
        indices = np.arange(math.prod(shape)).reshape(shape).transpose([*batch, *others, *along])
        batch_size, length = (math.prod(shape[k] for k in axes) for axes in (batch, along))
        rows = indices.reshape(batch_size, -1, length)
        starts.append(rows[:, :, 0])
        offsets.append(lower.table(rows[0, 0] - rows[0, 0, 0]))
    # For each element of the result, with the axes (batch, other axes of the first factor, other
    # axes of the second), the indices of the first elements of both rows.
    pairs = np.broadcast_arrays(starts[0][:, :, None], starts[1][:, None, :])
    tables_of_starts = [lower.table(numbers) for numbers in pairs]
    result = lower.new_array(tuple(out.shape), kind_of(out))
    zero = Symbol(lower.ops, lower.ops.constant(result.kind, 0))

    # Compute and write element n of the result.
    def visit(n: Symbol) -> None:
        begins = [_read(lower, table, n) for table in tables_of_starts]

        def term(k: Symbol) -> Symbol:
            # `preferred_element_type` may be wider than the arguments, which are converted first.
            values = (
                convert(_read(lower, memory, begin + _read(lower, of_row, k)), result.kind)
                for memory, begin, of_row in zip(memories, begins, offsets, strict=True)
            )
            a, b = values
            return a * b

        total = _sum(lower, zero, _index(lower, 0), _index(lower, offsets[0].size), term)
        lower.ops.store(total.value, result.start, n.value)

    _counted(lower, _index(lower, 0), _index(lower, result.size), visit)
    return [lower.in_usual_form(result)]


def _cholesky(lower: Lowering, equation: Equation, matrix: Array) -> list[Array]:
    """Return the lower triangular factor L of a matrix L L^T, of which only the lower triangle is
    read. The factor contains NaN if the matrix is not positive definite."""
    shape = tuple(aval_of(equation.invars[0]).shape)
    source, factor, n = lower.in_memory(matrix, shape), lower.new_array(shape, "f"), shape[-1]
    ops, zero = lower.ops, _index(lower, 0)

    def row(number: Symbol) -> None:
        # `number` counts the rows of all matrices. In row i, L_ij = rest(j) / L_jj for j < i, and
        # L_ii = sqrt(rest(i)), with rest(j) = A_ij - (sum of L_ik L_jk over k < j). `top` is the
        # index of the matrix's first number: i rows before this one, each of n numbers.
        i = number.emit("remainder_whole", n)
        top = (number - i) * n

        def rest(j: Symbol) -> Symbol:
            def term(k: Symbol) -> Symbol:
                a, b = (_read(lower, factor, top + line * n + k) for line in (i, j))
                return -(a * b)

            return _sum(lower, _read(lower, source, top + i * n + j), zero, j, term)

        def store(j: Symbol, value: Symbol) -> None:
            ops.store(value.value, factor.start, (top + i * n + j).value)

        def left_of_diagonal(j: Symbol) -> None:
            store(j, rest(j) / _read(lower, factor, top + j * n + j))

        def right_of_diagonal(j: Symbol) -> None:
            store(j, Symbol(ops, ops.constant("f", 0.0)))

        # Each element needs those left of it in its row, so the row is computed from the left.
        _counted(lower, zero, i, left_of_diagonal)
        store(i, rest(i).emit("sqrt"))
        _counted(lower, i + 1, _index(lower, n), right_of_diagonal)

    _counted(lower, zero, _index(lower, math.prod(shape[:-1])), row)
    return [lower.in_usual_form(factor)]


def _triangular_solve(
    lower: Lowering, equation: Equation, matrix: Array, right: Array
) -> list[Array]:
    """Return the solution X of A X = B, or of X A = B, by substitution, for a triangular A in
    `matrix` and any B in `right` (see `jax.lax.linalg.triangular_solve`)."""
    parameters, ops = equation.params, lower.ops
    shapes = [tuple(aval_of(atom).shape) for atom in equation.invars]
    pairs = zip((matrix, right), shapes, strict=True)
    a, b = (lower.in_memory(array, shape) for array, shape in pairs)
    x, n, on_left = lower.copied(b), shapes[0][-1], parameters["left_side"]
    # X A = B is A^T X^T = B^T, so that A is transposed once more if it stands on the right. The
    # first equation of a lower triangular matrix has one unknown, so substitution goes forward.
    # There are `columns` systems of n equations for each matrix. Successive unknowns of a system
    # are `step` cells from each other, and the first unknowns of successive systems `apart`.
    transposed = parameters["transpose_a"] == on_left
    forward = parameters["lower"] != transposed
    columns = shapes[1][-1] if on_left else shapes[1][-2]
    step, apart = (columns, 1) if on_left else (1, n)
    zero, count = _index(lower, 0), _index(lower, n)

    def solve(number: Symbol) -> None:
        # Systems are counted matrix by matrix: `block` is the number of the matrix, `column` that
        # of the right side. `top` is the index of the matrix's first number in `a`, and
        # `first_unknown` the index of the system's first unknown in `x`.
        column = number.emit("remainder_whole", columns)
        block = (number - column).emit("divide_whole", columns)
        top, first_unknown = block * (n * n), block * (n * columns) + column * apart

        def coefficient(i: Symbol, k: Symbol) -> Symbol:
            return _read(lower, a, top + (k * n + i if transposed else i * n + k))

        def unknown(turn: Symbol) -> None:
            # Forward substitution finds the unknowns from the first on, backward substitution from
            # the last. `solved` is the range of those that are known already.
            i = turn if forward else count - 1 - turn
            solved = (zero, i) if forward else (i + 1, count)
            place = first_unknown + i * step
            rest = _sum(
                lower,
                _read(lower, x, place),
                *solved,
                lambda k: -(coefficient(i, k) * _read(lower, x, first_unknown + k * step)),
            )
            if not parameters["unit_diagonal"]:
                rest = rest / coefficient(i, i)
            ops.store(rest.value, x.start, place.value)

        _counted(lower, zero, count, unknown)

    _counted(lower, zero, _index(lower, math.prod(shapes[0][:-2]) * columns), solve)
    return [lower.in_usual_form(x)]


RULES: dict[str, EquationRule] = {"cholesky": _cholesky, "triangular_solve": _triangular_solve}
"""Rules by the names of primitives."""
