"""Vectors and 3x3 matrices whose components are separate scalars.

Scalars are faster than arrays here: native code consists of operations on scalars, and XLA compiles
a loop of elementwise arithmetic to one function, where each `stack` or `dot` would launch a kernel.
Under ``vmap``, each scalar becomes an array.

A component that is a Python ``0.0`` or ``1.0`` is *structural*: operations on it are omitted while
JAX traces, so that a fixed ground or a unit vector needs no arithmetic. A program is then compiled
for each pattern of zeros and ones, but not for each value of a number.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from types import ModuleType
from typing import TypeAlias, overload

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree
from typing_extensions import override

Scalar: TypeAlias = float | jax.Array
"""A number: a float of Python or NumPy, or a JAX array of shape ().

>>> def stiffening(depth: extend.Scalar) -> extend.Scalar:
...     return 1.0 + depth
"""
Condition: TypeAlias = bool | jax.Array
"""A truth value: a Python bool, or a boolean JAX array of shape ()."""


_NUMBERS = int, float
"""Types for `isinstance`: `int | float` would be made anew for each operand that JAX traces."""


def _is(value: Scalar, number: float) -> bool:
    return isinstance(value, _NUMBERS) and value == number


def are_traced_alike(a: Scalar, b: Scalar) -> bool:
    """Return whether both numbers are tracers of the same shape and dtype, so that a primitive can
    be called directly."""
    return isinstance(a, Tracer) and isinstance(b, Tracer) and a.aval == b.aval


def have_primitive(a: Scalar, b: Scalar) -> bool:
    """Return whether a primitive of JAX can be called with both numbers directly: two tracers of
    the same shape and dtype, or a float64 tracer of shape () and a Python float. An operator takes
    four times as long to trace."""
    if isinstance(a, Tracer) and isinstance(b, Tracer):
        return a.aval == b.aval
    traced, number = (a, b) if isinstance(a, Tracer) else (b, a)
    is_single = isinstance(traced, Tracer) and traced.shape == () and traced.dtype == np.float64
    return is_single and type(number) is float


def is_zero(a: Scalar) -> bool:
    """Return whether a number is a structural zero: a zero of Python, or of NumPy's float64."""
    return _is(a, 0)


def add(a: Scalar, b: Scalar) -> Scalar:
    """Return a + b: the other number itself if one of them is a structural zero."""
    if _is(a, 0):
        return b
    if _is(b, 0):
        return a
    return jax.lax.add(a, b) if have_primitive(a, b) else a + b


def subtract(a: Scalar, b: Scalar) -> Scalar:
    """Return a - b, without a subtraction if either is a structural zero or both are one object."""
    if a is b:
        return 0.0
    if _is(b, 0):
        return a
    if _is(a, 0):
        return jax.lax.neg(b) if isinstance(b, Tracer) else -b
    return jax.lax.sub(a, b) if have_primitive(a, b) else a - b


def multiply(a: Scalar, b: Scalar) -> Scalar:
    """Return a * b, without an operation if either is a structural zero or one."""
    if _is(a, 0) or _is(b, 0):
        return 0.0
    if _is(a, 1):
        return b
    if _is(b, 1):
        return a
    return jax.lax.mul(a, b) if have_primitive(a, b) else a * b


def larger(a: Scalar, b: Scalar) -> Scalar:
    """Return the larger of two numbers; NaN if one of them is NaN."""
    return jax.lax.max(a, b) if have_primitive(a, b) else jnp.maximum(a, b)


def square_root(a: Scalar) -> Scalar:
    """Return the square root of a number that is not negative."""
    return math.sqrt(a) if isinstance(a, int | float) else library((a,)).sqrt(a)


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class Vector:
    """Vector of three scalar components `x`, `y` and `z`.

    >>> force, arm = extend.Vector(0.0, 10.0, 0.0), extend.Vector(0.5, 0.0, 0.0)
    >>> arm.cross(force).z, arm.dot(force)
    (5.0, 0.0)
    """

    x: Scalar
    y: Scalar
    z: Scalar

    def __add__(self, other: "Vector") -> "Vector":
        return Vector(*map(add, self, other))

    def __sub__(self, other: "Vector") -> "Vector":
        return Vector(*map(subtract, self, other))

    def __neg__(self) -> "Vector":
        return ZERO - self

    def __mul__(self, factor: Scalar) -> "Vector":
        return Vector(multiply(self.x, factor), multiply(self.y, factor), multiply(self.z, factor))

    __rmul__ = __mul__

    def __iter__(self) -> Iterator[Scalar]:
        return iter((self.x, self.y, self.z))

    def dot(self, other: "Vector") -> Scalar:
        """Return the scalar product with another vector."""
        return add(
            add(multiply(self.x, other.x), multiply(self.y, other.y)), multiply(self.z, other.z)
        )

    def cross(self, other: "Vector") -> "Vector":
        """Return the vector product with another vector."""
        return Vector(
            subtract(multiply(self.y, other.z), multiply(self.z, other.y)),
            subtract(multiply(self.z, other.x), multiply(self.x, other.z)),
            subtract(multiply(self.x, other.y), multiply(self.y, other.x)),
        )

    def componentwise_product(self, other: "Vector") -> "Vector":
        """Return the vector (x1 x2, y1 y2, z1 z2)."""
        return Vector(*map(multiply, self, other))


ZERO = Vector(0.0, 0.0, 0.0)
"""The zero vector, whose components are structural zeros.

>>> extend.ZERO + extend.UNIT_X
Vector(x=1.0, y=0.0, z=0.0)
"""
UNIT_X = Vector(1.0, 0.0, 0.0)
"""The unit vector along x.

>>> extend.UNIT_X * 2.0
Vector(x=2.0, y=0.0, z=0.0)
"""
UNIT_Y = Vector(0.0, 1.0, 0.0)
"""The unit vector along y.

>>> extend.UNIT_Y * 2.0
Vector(x=0.0, y=2.0, z=0.0)
"""
UNIT_Z = Vector(0.0, 0.0, 1.0)
"""The unit vector along z.

>>> extend.UNIT_Z * 2.0
Vector(x=0.0, y=0.0, z=2.0)
"""


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class Matrix:
    """3x3 matrix, given by its three rows.

    >>> matrix = extend.Matrix(extend.UNIT_Y, -extend.UNIT_X, extend.UNIT_Z)
    >>> matrix @ extend.Vector(1.0, 2.0, 3.0)
    Vector(x=2.0, y=-1.0, z=3.0)
    """

    row_x: Vector
    row_y: Vector
    row_z: Vector

    @property
    def rows(self) -> tuple[Vector, Vector, Vector]:
        """The three rows."""
        return self.row_x, self.row_y, self.row_z

    @overload
    def __matmul__(self, other: Vector) -> Vector: ...

    @overload
    def __matmul__(self, other: "Matrix") -> "Matrix": ...

    def __matmul__(self, other: "Vector | Matrix") -> "Vector | Matrix":
        if isinstance(other, Matrix):
            return Matrix(*(other.transposed_times(row) for row in self.rows))
        return Vector(*(row.dot(other) for row in self.rows))

    def __add__(self, other: "Matrix") -> "Matrix":
        return Matrix(*(a + b for a, b in zip(self.rows, other.rows, strict=True)))

    def transposed_times(self, vector: Vector) -> Vector:
        """Return the product of the transposed matrix and a vector."""
        return self.row_x * vector.x + self.row_y * vector.y + self.row_z * vector.z

    @property
    def T(self) -> "Matrix":  # noqa: N802 (the field's symbol)
        """The transposed matrix."""
        return Matrix(*(Vector(*column) for column in zip(*self.rows, strict=True)))

    def minus_outer(self, column: Vector, row: Vector) -> "Matrix":
        """Return the matrix minus the outer product of `column` and `row`."""
        return Matrix(*(part - row * x for part, x in zip(self.rows, column, strict=True)))

    def inverse(self) -> "Matrix":
        """Return the inverse of a nonsingular matrix, computed from its cofactors."""
        x, y, z = self.rows
        columns = y.cross(z), z.cross(x), x.cross(y)
        scale = 1.0 / x.dot(columns[0])
        return Matrix(*(column * scale for column in columns)).T


IDENTITY = Matrix(UNIT_X, UNIT_Y, UNIT_Z)
"""The rotation matrix of a body whose axes are the global ones.

>>> extend.IDENTITY @ extend.UNIT_X
Vector(x=1.0, y=0.0, z=0.0)
"""
NOTHING = Matrix(ZERO, ZERO, ZERO)
"""The zero matrix."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class EulerParameters:
    """Unit quaternion, scalar part `e0` first, that transforms body components to global ones.

    >>> extend.rotation_matrix(extend.EulerParameters(1.0, 0.0, 0.0, 0.0)).row_x
    Vector(x=1.0, y=0.0, z=0.0)
    """

    e0: Scalar
    e1: Scalar
    e2: Scalar
    e3: Scalar


_KINDS = (Vector, EulerParameters, Matrix)
Pattern: TypeAlias = tuple[float | None, ...] | None
"""Structural components of an array: for each component 0.0, 1.0, or ``None`` if it is not
structural. The pattern of an array without structural components may be ``None``."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class ConstantFolded:
    """PyTree of numbers, with the structural components of its vectors and matrices.

    Compiled programs depend on the `patterns`, one for each leaf of `tree`, but not on the numbers.
    Empty `patterns` stand for no structural components at all.
    """

    tree: PyTree
    patterns: tuple[Pattern, ...] = field(metadata={"static": True})

    @override
    def __getstate__(self) -> dict[str, object]:
        # Native functions keep the leaves and structure here, which can't be pickled.
        return {"tree": self.tree, "patterns": self.patterns}


def fold_constants(
    tree: PyTree,
    varied: PyTree = None,
    flattened: tuple[list[PyTree], jax.tree_util.PyTreeDef] | None = None,  # pyright: ignore
) -> ConstantFolded:
    """Mark exact zeros and ones in arrays of shape (3,) and (3, 3) of a PyTree as structural.

    Not marked are tracers, arrays in fields with the metadata ``{"table": True}``, and leaves for
    which `varied`, a PyTree of the same structure, is true, because their numbers differ between
    runs of the same program (``None``: for no leaf). `flattened` are the leaves and the structure
    of `tree`, if known.
    """
    leaves, structure = jax.tree.flatten(tree) if flattened is None else flattened
    shapes = tuple([leaf.shape if type(leaf) is np.ndarray else np.shape(leaf) for leaf in leaves])
    vectors, sizes = _vectors(structure, shapes)
    arrays = [leaves[k] for k in vectors]
    if varied is not None or {*map(type, arrays)} != {np.ndarray}:
        # NaN stands for numbers that are unknown, or differ between runs.
        changing = [False] * len(leaves) if varied is None else jax.tree.leaves(varied)
        arrays = [
            np.full(size, np.nan)
            if changing[k] or isinstance(leaves[k], Tracer)
            else np.asarray(leaves[k], dtype=float)
            for k, size in zip(vectors, sizes, strict=True)
        ]
    # The numbers of all vectors are compared at once, since a scene has hundreds of vectors.
    numbers = np.concatenate([*arrays, ()], axis=None)
    is_one = numbers == 1.0
    # One digit for each number, as in `_DIGITS`: 1 for zero, 2 for one, 0 for all others.
    digits = (is_one | (numbers == 0.0)).astype(np.uint8) + is_one
    return ConstantFolded(tree, _patterns(digits.tobytes(), vectors, sizes, len(leaves)))


_DIGITS = (None, 0.0, 1.0)
"""Structural component (see `Pattern`) for each digit in the argument of `_patterns`."""


@lru_cache(maxsize=1024)
def _patterns(
    digits: bytes, vectors: tuple[int, ...], sizes: tuple[int, ...], leaves: int
) -> tuple[Pattern, ...]:
    """Return a `Pattern` for each leaf of a PyTree: ``None`` unless it is a vector or a matrix.
    `leaves`: number of all leaves; `vectors`: indices of the vectors and matrices; `sizes`: number
    of components of each of these; `digits`: for each component, its index in `_DIGITS`."""
    patterns: list[Pattern] = [None] * leaves
    components = iter(digits)
    for k, size in zip(vectors, sizes, strict=True):
        patterns[k] = tuple(_DIGITS[next(components)] for _ in range(size))
    return tuple(patterns)


@lru_cache(maxsize=1024)
def _vectors(
    structure: jax.tree_util.PyTreeDef,  # pyright: ignore
    shapes: tuple[tuple[int, ...], ...],
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the indices of the leaves of a PyTree that are vectors or matrices, whose components
    may be structural, and the number of components of each; from the `shapes` of all leaves."""
    rows = enumerate(zip(shapes, _in_tables(structure), strict=True))
    vectors = tuple(k for k, (shape, table) in rows if not table and shape in ((3,), (3, 3)))
    return vectors, tuple(math.prod(shapes[k]) for k in vectors)


@lru_cache(maxsize=1024)
def _in_tables(structure: jax.tree_util.PyTreeDef) -> list[bool]:  # pyright: ignore
    """Return for each leaf whether it is in a field with the metadata ``{"table": True}``, or in a
    layer of a network, where an array of shape (3,) is no vector."""
    return _leaves_in_tables(jax.tree.unflatten(structure, [0] * structure.num_leaves), False)


def _leaves_in_tables(node: PyTree, in_table: bool) -> list[bool]:
    if jax.tree_util.all_leaves([node]):
        return [in_table]
    declared, flags = getattr(type(node), "__dataclass_fields__", {}), []
    bases = type(node).__mro__
    in_table = in_table or any(base.__module__.startswith("equinox.nn") for base in bases)
    # The parts of the node itself, whatever its class, in JAX's order, each with its path of one
    # key: for a dataclass, the name of the field.
    parts = jax.tree_util.tree_leaves_with_path(node, is_leaf=lambda part: part is not node)
    for (key,), part in parts:
        name = getattr(key, "name", None)
        is_table = name in declared and declared[name].metadata.get("table", False)
        flags += _leaves_in_tables(part, in_table or is_table)
    return flags


def _unpack_leaf(leaf: jax.Array, pattern: Pattern, leading: int) -> PyTree:
    shape = jnp.shape(leaf)[leading:]
    if shape not in ((3,), (4,), (3, 3)):
        return leaf
    constants = (None,) * math.prod(shape) if pattern is None else pattern
    # Each component is its constant or, without one, the component of the leaf.
    if isinstance(leaf, Tracer):
        # One equation for all components, where an index would be two for each.
        components = jax.lax.unstack(jax.lax.collapse(leaf, leading), axis=leading)
        pairs = zip(components, constants, strict=True)
        parts = [component if constant is None else constant for component, constant in pairs]
    else:
        axes, pairs = (slice(None),) * leading, zip(np.ndindex(shape), constants, strict=True)
        parts = [leaf[axes + index] if constant is None else constant for index, constant in pairs]
    if shape == (4,):
        return EulerParameters(*parts)
    rows = [Vector(*parts[k : k + 3]) for k in range(0, len(parts), 3)]
    return rows[0] if shape == (3,) else Matrix(*rows)


def unpack(tree: PyTree, leading: int = 0) -> PyTree:
    """Replace each array of shape (3,), (4,) and (3, 3) in a PyTree by a `Vector`,
    `EulerParameters` or `Matrix`.

    In compiled programs, components that are exactly 0 or 1 become Python numbers. Fields declared
    by `quantity` with ``table=True`` keep their arrays. With `leading` axes before these shapes,
    the components are arrays with these axes.

    >>> extend.unpack(np.array([1.0, 2.0, 3.0])).y.item()
    2.0
    """
    # An empty tuple of patterns stands for no structural components.
    packed = tree if isinstance(tree, ConstantFolded) else ConstantFolded(tree, ())
    leaves, shape = jax.tree.flatten(packed.tree)
    patterns = packed.patterns or (None,) * len(leaves)
    rows = zip(leaves, patterns, _in_tables(shape), strict=True)
    scalars = [
        leaf if table else _unpack_leaf(leaf, pattern, leading) for leaf, pattern, table in rows
    ]
    # A tree in scalar form stays the same object, for which its topology is known.
    if all(scalar is leaf for scalar, leaf in zip(scalars, leaves, strict=True)):
        return packed.tree
    return jax.tree.unflatten(shape, scalars)


def _pack_leaf(leaf: PyTree) -> PyTree:
    if isinstance(leaf, Matrix):
        rows = [_pack_leaf(row) for row in leaf.rows]
        numpy = library(rows)
        # A row of structural components has no leading axes, but the others may have some.
        return numpy.stack(numpy.broadcast_arrays(*rows), axis=-2)
    if isinstance(leaf, Vector | EulerParameters):
        parts = jax.tree.leaves(leaf)
        numpy = library(parts)
        return numpy.stack(numpy.broadcast_arrays(*parts), axis=-1)
    return leaf


def library(parts: Sequence[Scalar]) -> ModuleType:
    """Return ``jax.numpy`` if any of the numbers is of JAX, else ``numpy``."""
    return jnp if any(isinstance(part, jax.Array) for part in parts) else np


def pack(tree: PyTree) -> PyTree:
    """Replace each `Vector`, `EulerParameters` and `Matrix` in a PyTree by an array; see `unpack`.

    >>> extend.pack(extend.Vector(1.0, 2.0, 3.0))
    array([1., 2., 3.])
    """
    return jax.tree.map(_pack_leaf, tree, is_leaf=lambda node: isinstance(node, _KINDS))
