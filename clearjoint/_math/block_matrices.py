"""Sparse symmetric matrices in blocks, for systems of linear equations that are too large for
unrolled arithmetic.

A matrix S = D X^T is divided into blocks of `SIZE` rows and columns. The blocks that are not
structural zeros are stored in one array, block after block and row by row. The sequence of
operations on blocks is known while JAX traces, and listed in tables, over which loops run, so that
the length of the program does not depend on the matrix.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from typing_extensions import override

from .linear_solvers import AbstractMatrix, Rows, ScalarMatrix, Solve, elimination_order, inner
from .vectors import Scalar, is_zero

SIZE = 6
"""Number of rows and columns of a block: a joint has at most six constraint rows, and a body has
six speeds. Native code computes with the numbers of up to six rows as separate values."""
ELEMENTS = SIZE * SIZE
MOST_MULTIPLICATIONS = 2500
"""Largest number of multiplications of a system that is solved by unrolled arithmetic, as of about
15 rows without zeros. Compiling them takes about a second."""
_Place: TypeAlias = tuple[int, int]
_Step: TypeAlias = tuple[int, ...]
"""A row of a table: the kind or the factors of an operation, and indices of rows or blocks."""
_Change: TypeAlias = Callable[[jax.Array, jax.Array], tuple[jax.Array, jax.Array]]
_UPDATE, _DIVIDE, _FACTORISE = 0, 1, 2


def gram_matrix(first: Rows, second: Rows) -> AbstractMatrix:
    """Return the symmetric matrix S = D X^T, from the rows of D (`first`) and X (`second`): a
    `ScalarMatrix` if its system takes at most `MOST_MULTIPLICATIONS`, else a `BlockMatrix`."""
    supports = [[_support(row) for row in rows] for rows in (first, second)]
    # An entry (i, j) of S, with j <= i, takes one multiplication for each column in which row i of
    # D and row j of X both have an entry; it is zero if there is no such column.
    counts = [[len(a & b) for b in supports[1][: i + 1]] for i, a in enumerate(supports[0])]
    _, _, below = elimination_order(counts)
    # Eliminating an unknown that is coupled with m later ones takes m multiplications for the
    # column of the factor, and m (m + 1)/2 for the entries that it changes: m (m + 3)/2.
    multiplications = sum(map(sum, counts))
    multiplications += sum(len(column) * (len(column) + 3) // 2 for column in below)
    if multiplications > MOST_MULTIPLICATIONS:
        return BlockMatrix(first, second)
    rows = [
        [inner(a, b) if count else 0.0 for b, count in zip(second, of_row, strict=False)]
        for a, of_row in zip(first, counts, strict=True)
    ]
    return ScalarMatrix(rows)


class _Plan:
    """Places of the blocks of a symmetric matrix and of its factor, and the operations on them.

    - `order`: the groups of rows, one for each row of blocks, in their order of elimination. All
      other indices of groups are places in this order.
    - `sizes`: the number of rows of each group, at most `SIZE`.
    - `slots`: index of each stored block by its place (row, column), on or below the diagonal, also
      of blocks that are zero in the matrix but not in its factor (fill-in).
    - `entries`: the places of the blocks of the matrix itself.

    **Arguments:** `coupled`: row i tells for each j < i whether block (i, j) is not zero; `sizes`:
    as above. In both, the groups are in their original order.
    """

    def __init__(self, coupled: Sequence[Sequence[bool]], sizes: Sequence[int]):
        self.order, neighbours, self._below = elimination_order(coupled)
        self.sizes = [sizes[group] for group in self.order]
        places = [(i, j) for j, column in enumerate(self._below) for i in (j, *column)]
        self.slots = {at: k for k, at in enumerate(places)}
        self.entries = [(i, j) for i, j in places if i == j or i in neighbours[j]]

    def rows(self, group: int, block: int) -> list[int]:
        """Return the indices of the rows of `group` in the block with the index `block`. Rows of
        all blocks, `SIZE` in each, are counted from the first row of block 0 on."""
        return [SIZE * block + row for row in range(self.sizes[group])]

    def factorisation(self) -> list[_Step]:
        """Return the table for `_factor`, a list of operations (kind, target, source, block). The
        product of a block and the row `source` replaces the row `target` (`_DIVIDE`), is subtracted
        from it (`_UPDATE`), or serves to compute it (`_FACTORISE`). Rows have the indices of the
        method `rows`. Blocks are those in `slots`, then the inverses of the diagonal blocks."""
        table: list[_Step] = []
        slots, first_inverse = self.slots, len(self.slots)
        for j, column in enumerate(self._below):
            # The inverse of the factor L in the diagonal block, by which the blocks below are
            # multiplied. Each of its rows is found with the rows before it (see `_factor`).
            diagonal, inverse = self.rows(j, slots[j, j]), first_inverse + j
            for target, row in zip(self.rows(j, inverse), diagonal, strict=True):
                table.append((_FACTORISE, target, row, inverse))
            for i in column:
                table += [(_DIVIDE, row, row, inverse) for row in self.rows(i, slots[i, j])]
            # The column j is subtracted from the columns k after it, on and below the diagonal.
            for k in column:
                for i in column:
                    if i >= k:
                        targets, rows = (self.rows(i, slots[i, other]) for other in (k, j))
                        pairs = zip(targets, rows, strict=True)
                        table += [(_UPDATE, target, row, slots[k, j]) for target, row in pairs]
        return table

    def solution(self, sweeps: int) -> list[_Step]:
        """Return the table by which `_iterated` solves S x = b, in `sweeps` iterations. A row
        (former, sign, transposed, target, block, source) means part[target] = former *
        part[target] + sign * block @ part[source], with the block transposed if `transposed` is 1.
        The array `part` has the parts of b, then of x (first 0), then of the residual (first b)."""
        count = len(self.order)
        b, x, r = ([*range(first, first + count)] for first in (0, count, 2 * count))
        # The blocks of the matrix come first, then those of the factor, inverses, and the identity.
        of_factor = {place: len(self.slots) + slot for place, slot in self.slots.items()}
        first_inverse = 2 * len(self.slots)
        identity = first_inverse + count
        table: list[_Step] = []
        for sweep in range(sweeps):
            # The residual r = b - S x, which is b in the first sweep.
            if sweep:
                table += [(0, 1, 0, r[k], identity, b[k]) for k in range(count)]
                for target, slot, source, transposed in self.products():
                    table.append((1, -1, transposed, r[target], slot, x[source]))
            # r = (L L^T)^-1 r, by forward and back substitution. A division by a diagonal block of
            # L is a product with its inverse.
            for j, column in enumerate(self._below):
                table.append((0, 1, 0, r[j], first_inverse + j, r[j]))
                table += [(1, -1, 0, r[i], of_factor[i, j], r[j]) for i in column]
            for j, column in reversed([*enumerate(self._below)]):
                table += [(1, -1, 1, r[j], of_factor[i, j], r[i]) for i in column]
                table.append((0, 1, 1, r[j], first_inverse + j, r[j]))
            # x = x + r.
            table += [(1, 1, 0, x[k], identity, r[k]) for k in range(count)]
        return table

    def products(self) -> list[tuple[int, int, int, int]]:
        """Return the products of blocks and parts of a vector whose sum is matrix times vector:
        (part of the result, block, part of the vector, 1 if the block is transposed, else 0)."""
        # A block below the diagonal, transposed, is also the one above it.
        table = [(i, self.slots[i, j], j, 0) for i, j in self.entries]
        return table + [(j, slot, i, 1) for i, slot, j, _ in table if i != j]


class BlockMatrix(AbstractMatrix):
    """The symmetric matrix S = D X^T in blocks, from the rows of D (`first`) and X (`second`)."""

    def __init__(self, first: Sequence[Sequence[Scalar]], second: Sequence[Sequence[Scalar]]):
        self.n = len(first)
        # Rows of D with similar entries form groups: the rows of blocks of D, X and S.
        groups = _groups([{k // SIZE for k in _support(row)} for row in first])
        # The columns of blocks in which each group has entries, in D and in X.
        of_first, of_second = (
            [{k // SIZE for row in group for k in _support(rows[row])} for group in groups]
            for rows in (first, second)
        )
        # Block (i, j) of S is not zero if group i of D and group j of X share a column of blocks.
        # Either order counts, since S is symmetric.
        coupled = [
            [bool(of_first[i] & of_second[j] or of_first[j] & of_second[i]) for j in range(i)]
            for i in range(len(groups))
        ]
        self._plan = _Plan(coupled, [*map(len, groups)])
        order = self._plan.order
        self._groups = [groups[k] for k in order]
        # From here on, groups are in the order of elimination. The place of each row is its index
        # in a vector of `SIZE` elements for each group.
        self._places = np.zeros(self.n, int)
        for k, group in enumerate(self._groups):
            self._places[group] = SIZE * k + np.arange(len(group))
        of_first, of_second = ([part[k] for k in order] for part in (of_first, of_second))
        # Each block (i, j) of S is the sum over c of products A B^T of the blocks A = (i, c) of D
        # and B = (j, c) of X. These are numbered when they are first needed. A step adds one row of
        # a product, a row of A times B^T, to the same row of the block of S (the target).
        steps: list[_Step] = []
        slots_first: dict[_Place, int] = {}
        slots_second: dict[_Place, int] = {}
        for i, j in self._plan.entries:
            for c in sorted(of_first[i] & of_second[j]):
                a = slots_first.setdefault((i, c), len(slots_first))
                b = slots_second.setdefault((j, c), len(slots_second))
                targets, rows_of_a = (self._plan.rows(i, k) for k in (self._plan.slots[i, j], a))
                steps += [(target, row, b) for target, row in zip(targets, rows_of_a, strict=True)]
        left = _blocks(first, self._groups, list(slots_first))
        right = _blocks(second, self._groups, list(slots_second))
        # The sums begin with zeros, but with ones on the diagonal in the unused rows of blocks.
        self._blocks = _sums_of_products(self._padding(), left, right, steps)

    def _padding(self) -> np.ndarray:
        """Return all blocks, flattened: zeros, with ones on the diagonal in the unused rows of each
        group of fewer than `SIZE` rows. Without the ones, the matrix would be singular."""
        blocks = np.zeros((len(self._plan.slots), SIZE, SIZE))
        for k, group in enumerate(self._groups):
            for row in range(len(group), SIZE):
                blocks[self._plan.slots[k, k], row, row] = 1.0
        return blocks.ravel()

    def _diagonal(self) -> np.ndarray:
        """Return the indices of the diagonal of S in the flattened blocks, (n,)."""
        group, row = np.divmod(self._places, SIZE)
        slots = np.array([self._plan.slots[k, k] for k in group.tolist()])
        # Element (row, row) is the one with the index row * SIZE + row of its block.
        return slots * ELEMENTS + row * (SIZE + 1)

    def _vector(self, numbers: Sequence[Scalar]) -> jax.Array:
        index = np.full(SIZE * len(self._groups), -1)
        index[self._places] = np.arange(self.n)
        return _gathered(numbers, index)

    @override
    def trace(self) -> Scalar:
        return jnp.sum(_taken(self._blocks, self._diagonal()))

    @override
    def solving(self, shift: Scalar = 0.0, sweeps: int = 1) -> Solve:
        shifted = self._blocks
        if not is_zero(shift):
            mask = np.zeros(len(self._plan.slots) * ELEMENTS)
            mask[self._diagonal()] = 1.0
            shifted = shifted + shift * mask
        solve = _solving(self._plan, self._blocks, shifted, sweeps)
        return lambda right: list(_taken(solve(self._vector(right)), self._places))


def _support(row: Sequence[Scalar]) -> set[int]:
    return {k for k, entry in enumerate(row) if not is_zero(entry)}


def _groups(columns: Sequence[set[int]]) -> list[list[int]]:
    """Divide the rows of D into lists of at most `SIZE` consecutive rows. `columns`: for each row,
    the indices of the columns of blocks, `SIZE` wide, in which it has entries. A row joins the list
    before it if they share over half of all their columns, lest blocks couple unrelated rows."""
    groups: list[list[int]] = []
    union: set[int] = set()  # the columns of the rows in the last list
    for row, row_columns in enumerate(columns):
        differing, joined = row_columns ^ union, row_columns | union
        if groups and len(groups[-1]) < SIZE and 2 * len(differing) < len(joined):
            groups[-1].append(row)
            union = joined
        else:
            groups.append([row])
            union = row_columns
    return groups


def _blocks(
    rows: Sequence[Sequence[Scalar]], groups: Sequence[Sequence[int]], places: Sequence[_Place]
) -> jax.Array:
    # The blocks at the places (group of rows, column of blocks), flattened.
    entries: list[Scalar] = []
    index = np.full((len(places), SIZE, SIZE), -1)
    for block, (group, column) in enumerate(places):
        for i, row in enumerate(groups[group]):
            for j, entry in enumerate(rows[row][SIZE * column : SIZE * (column + 1)]):
                if not is_zero(entry):
                    index[block, i, j] = len(entries)
                    entries.append(entry)
    return _gathered(entries, index.ravel())


def _gathered(numbers: Sequence[Scalar], index: np.ndarray) -> jax.Array:
    """Return the array of `numbers` at the given indices, with zero for an index of -1."""
    array = jnp.stack([*map(jnp.asarray, (*numbers, 0.0))])
    # The remainder turns -1 into the index of the zero at the end.
    return _taken(array, index % len(array))


def _taken(array: jax.Array, index: np.ndarray) -> jax.Array:
    return array.at[index].get(mode="promise_in_bounds")


def _block(blocks: jax.Array, index: jax.Array) -> jax.Array:
    elements = jax.lax.dynamic_slice_in_dim(blocks, index * ELEMENTS, ELEMENTS)
    return elements.reshape(SIZE, SIZE)


def _row(array: jax.Array, index: jax.Array) -> jax.Array:
    """Return row `index` of a flat `array` of blocks, (SIZE,), where rows are counted through all
    blocks. In a vector, a row is a part of `SIZE` numbers."""
    return jax.lax.dynamic_slice_in_dim(array, index * SIZE, SIZE)


def _looped(step: _Change, start: jax.Array, table: Sequence[_Step]) -> jax.Array:
    """Return an array after a loop over the rows of a table. For the array and a row of the table,
    `step` returns the new numbers of one row of the array, (SIZE,), and the index of this row."""

    def changed(array: jax.Array, row: jax.Array) -> tuple[jax.Array, None]:
        numbers, index = step(array, row)
        return jax.lax.dynamic_update_slice_in_dim(array, numbers, index * SIZE, 0), None

    return jax.lax.scan(changed, start, jnp.asarray(table))[0]


def _sums_of_products(
    start: np.ndarray, first: jax.Array, second: jax.Array, table: Sequence[_Step]
) -> jax.Array:
    """Return the blocks `start` plus products A B^T of blocks A of `first` and B of `second`.

    Each row of the table adds one row of a product. It has the indices of the row that it changes,
    of the row of A, and of the block B.
    """

    def step(sums: jax.Array, row: jax.Array) -> tuple[jax.Array, jax.Array]:
        target, a, b = row
        return _row(sums, target) + _block(second, b) @ _row(first, a), target

    return _looped(step, jnp.asarray(start), table)


def _factor(plan: _Plan, blocks: jax.Array) -> jax.Array:
    """Return the blocks of L, where L L^T is the matrix in `blocks`, and after them the inverses of
    L's diagonal blocks, in one flat array. The diagonal blocks of L themselves are not computed."""
    # The inverse W of L in a diagonal block is computed row by row. With the rows of W that are
    # known, and zeros in the others, W times row i of the block is row i of L without its diagonal
    # element. A group may have fewer than `SIZE` rows: the rest of W is that of the identity.
    inverses = np.zeros((len(plan.order), SIZE, SIZE))
    for j, size in enumerate(plan.sizes):
        inverses[j, range(size, SIZE), range(size, SIZE)] = 1.0

    # Row `target` of W: `row` is that of the block, `lower` is W times `row`, and `inverse` has the
    # rows of W that are known. The pivot is 1 over the diagonal element of L.
    def inverse_row(row: jax.Array, lower: jax.Array, inverse: jax.Array, target: jax.Array):
        unit = jnp.asarray(np.arange(SIZE) == target % SIZE, float)
        # This element is zero already, because row `target` of `inverse` is still zero.
        lower = jnp.where(unit > 0.0, 0.0, lower)
        pivot = 1.0 / jnp.sqrt(jnp.sum(unit * row) - jnp.sum(lower * lower))
        return (unit - lower @ inverse) * pivot

    def step(blocks: jax.Array, entries: jax.Array) -> tuple[jax.Array, jax.Array]:
        # A row of the table of `_Plan.factorisation`.
        kind, target, source, block = entries
        # An update subtracts L_kj times a row of L_ij from the same row of block (i, k). A division
        # multiplies a row of block (i, j) by the inverse of L_jj, which gives the row of L_ij.
        former, row, factor = _row(blocks, target), _row(blocks, source), _block(blocks, block)
        image = factor @ row
        numbers = jax.lax.cond(
            kind == _FACTORISE,
            lambda: inverse_row(row, image, factor, target),
            lambda: jnp.where(kind == _UPDATE, former - image, image),
        )
        return numbers, target

    return _looped(step, jnp.concatenate([blocks, inverses.ravel()]), plan.factorisation())


def _image(
    blocks: jax.Array, block: jax.Array, transposed: jax.Array, parts: jax.Array, source: jax.Array
) -> jax.Array:
    """Return block `block`, transposed if `transposed` is 1, times part `source` of `parts`."""
    matrix = _block(blocks, block)
    return jnp.where(transposed > 0, matrix.T, matrix) @ _row(parts, source)


def _product(plan: _Plan, blocks: jax.Array, vector: jax.Array) -> jax.Array:
    # The vector is not a part of the array that the loop changes, so that JAX can transpose the
    # loop where the blocks are derivatives.
    def step(sums: jax.Array, row: jax.Array) -> tuple[jax.Array, jax.Array]:
        target, block, source, transposed = row
        return _row(sums, target) + _image(blocks, block, transposed, vector, source), target

    return _looped(step, jnp.zeros_like(vector), plan.products())


def _iterated(blocks: jax.Array, right: jax.Array, table: Sequence[_Step]) -> jax.Array:
    """Solve S x = b. `right`: b; `blocks`: of S and its factor; `table`: a `_Plan.solution`."""

    def step(vectors: jax.Array, row: jax.Array) -> tuple[jax.Array, jax.Array]:
        former, sign, transposed, target, block, source = row
        image = _image(blocks, block, transposed, vectors, source)
        return former * _row(vectors, target) + sign * image, target

    start = jnp.concatenate([right, jnp.zeros_like(right), right])
    return _looped(step, start, table)[right.size : 2 * right.size]


def _solving(
    plan: _Plan, blocks: jax.Array, shifted: jax.Array, sweeps: int
) -> Callable[[jax.Array], jax.Array]:
    """Factorise the matrix `shifted`, S + shift I, and return the function that solves S x = b for
    the matrix S in `blocks`, in `sweeps` iterations (see `AbstractMatrix.solving`).

    The factorisation and the iteration are not differentiated, but the solution x of S x = b is: of
    a nonsingular S, x' = S^-1 (b' - S' x). Of a singular one, of constant rank and with the
    pseudoinverse P, x' = P (b' - S' x) + (I - P S) S' P x.
    """
    fixed = jax.lax.stop_gradient(blocks)
    # All blocks in one array, in the order that `_Plan.solution` uses.
    factor = _factor(plan, jax.lax.stop_gradient(shifted))
    stored = jnp.concatenate([fixed, factor, np.eye(SIZE).ravel()])
    table = plan.solution(sweeps)

    @jax.custom_jvp
    def solution(stored: jax.Array, blocks: jax.Array, right: jax.Array) -> jax.Array:
        return _iterated(stored, right, table)

    @solution.defjvp
    def _(
        primals: tuple[jax.Array, ...], tangents: tuple[jax.Array, ...]
    ) -> tuple[jax.Array, jax.Array]:
        (stored, blocks, right), (_, matrix_rate, right_rate) = primals, tangents
        solve = partial(solution, stored, blocks)
        x = solve(right)
        rate = solve(right_rate - _product(plan, matrix_rate, x))
        # Only a singular matrix takes several sweeps. Here `solve` is P, and S' P x is `image`.
        if sweeps > 1:
            image = _product(plan, matrix_rate, solve(x))
            rate += image - solve(_product(plan, blocks, image))
        return x, rate

    return partial(solution, stored, blocks)
