"""Compile functions of PyTrees to machine code, and call them."""

import math
import operator
import threading
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import compress
from typing import TypeVar, cast

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer
from jax.extend import core
from jax.interpreters import partial_eval
from jaxtyping import PyTree
from numpy.typing import ArrayLike
from typing_extensions import override

from .._compilation.xla import (
    begins_a_program,
    collector_at_rest,
    divided,
    joined,
    kind_of_leaf,
    program_is_made_inside,
    program_of,
)
from .._math.vectors import ConstantFolded, fold_constants
from . import control, indexing, linear_algebra, structure
from .alike_calls import CALLS_AT_ONCE, join_alike_calls
from .cells import Cells, Memory, Region
from .lowering import LARGEST_UNROLLED, LONGEST_PACKED, Lowering, UnsupportedPrimitiveError, aval_of
from .machine_code import Code, RecentPrograms, Stopwatch, load, load_or_make
from .operations import Number, Operations

RULES = structure.RULES | indexing.RULES | control.RULES | linear_algebra.RULES
"""Rules of the primitives that do not work element by element, by the primitives' names."""
LARGE = 256
"""Number of elements from which on an argument is written to memory by its own call of NumPy.
Smaller ones are written together, since a call takes longer than copying a few numbers."""
Argument = TypeVar("Argument")
_COMPILES = threading.RLock()
"""Lock that a thread holds while it makes a program, so that no two threads make the same one."""


class NativeProgram:
    """A closed jaxpr as machine code, to be called with arrays.

    - `inputs`: cells of memory for each argument; ``None`` if the program doesn't use the argument.
    - `outputs`: cells of memory for each result.

    **Arguments:** `tangents`: number of tangents, 0 for none. Arrays whose only axis has this
    length are computed as vectors of the processor. `stopwatch`: has the times of earlier stages.

    **Raises:** `UnsupportedPrimitiveError`, also for an unsupported dtype such as float32.
    """

    def __init__(
        self, closed: core.ClosedJaxpr, tangents: int = 0, stopwatch: Stopwatch | None = None
    ):
        stopwatch = Stopwatch() if stopwatch is None else stopwatch
        outs = closed.jaxpr.outvars
        # Equations and arguments that the results do not need are left out.
        jaxpr, used = partial_eval.dce_jaxpr(closed.jaxpr, [True] * len(outs), instantiate=False)
        lowering = Lowering(Operations(tangents=tangents, calls_at_once=CALLS_AT_ONCE), RULES)
        needed = iter(jaxpr.invars)
        self.inputs = [
            lowering.region(aval_of(next(needed))) if is_used else None for is_used in used
        ]
        arguments = [lowering.argument(r) for r in self.inputs if r is not None]
        # Results are views of the memory. With cells of their own, a caller who changes one of them
        # in place does not change another.
        results = control.apart(
            lowering, lowering.inline(core.ClosedJaxpr(jaxpr, closed.consts), arguments)
        )
        self.outputs = [
            lowering.stored(array, aval_of(out)) for array, out in zip(results, outs, strict=True)
        ]
        # The cells of arguments and results are known to the caller, so they must not move. Those
        # of arrays with several elements never do.
        regions = [*filter(None, self.inputs), *self.outputs]
        join_alike_calls(lowering.ops, (r.start for r in regions if r.size == 1))
        stopwatch.end("lowering")
        self.code = Code(lowering, stopwatch)
        # All small arguments of floats are written at once, and so are all those of integers and
        # bools. This takes a tenth of the time of separate writes. `_small` has an entry for floats
        # and one for the others: the indices of the arguments, and the results of `_joined_cells`.
        avals = [aval_of(variable) for variable in closed.jaxpr.invars]
        small = [k for k, aval in enumerate(avals) if aval.size < LARGE]
        self._small: list[tuple[list[int], np.ndarray, np.ndarray]] = []
        for are_floats in (True, False):
            indices = [k for k in small if (avals[k].dtype.kind == "f") is are_floats]
            cells_and_sources = _joined_cells(
                [self.inputs[k] for k in indices], [avals[k].size for k in indices]
            )
            self._small.append((indices, *cells_and_sources))
        self._large = {
            k: r for k, r in enumerate(self.inputs) if r is not None and avals[k].size >= LARGE
        }
        self._read = _Reading(self.outputs)

    def memory(self, leaves: Sequence[ArrayLike], floats: np.ndarray | None = None) -> Memory:
        """Return new memory with the program's constants and its arguments.

        **Arguments:** `leaves`: an array for each argument of the jaxpr, also for unused ones;
        `floats`: their `FlatArguments.floats`, if known.
        """
        memory = self.code.memory()
        # In the order of `_small`: where its numbers are written, and the numbers, if known.
        targets = (memory.floats, floats), (memory.integers, None)
        for (target, numbers), (indices, cells, sources) in zip(targets, self._small, strict=True):
            if len(cells):
                if numbers is None:
                    numbers = np.concatenate([leaves[k] for k in indices], axis=None)
                # The memory of a program without lanes has a single column.
                target[cells, 0] = numbers[sources]
        for k, region in self._large.items():
            memory.write(region, leaves[k])
        return memory

    def __call__(
        self, leaves: Sequence[ArrayLike], floats: np.ndarray | None = None
    ) -> list[np.ndarray]:
        """Return the results of the jaxpr for the arrays `leaves`, one for each argument. `floats`:
        the numbers of the small arrays of floats among them, if already joined (see `memory`)."""
        # The results may be views of the memory, so each call has its own.
        memory = self.memory(leaves, floats)
        self.code.run(memory)
        return self._read(memory)


class _Reading:
    """Reads the arrays in given regions of memory. Small arrays of floats with equal shapes are
    read together: results have hundreds of arrays, and each separate read takes a microsecond."""

    def __init__(self, regions: Sequence[Region]):
        by_shape: dict[tuple[int, ...], list[int]] = {}
        for k, region in enumerate(regions):
            if region.dtype == np.float64 and region.size < LARGE:
                by_shape.setdefault(region.shape, []).append(k)
        order = [k for ks in by_shape.values() for k in ks]
        self._cells = _indices(regions[k].cells for k in order)
        self._groups = [(shape, len(ks)) for shape, ks in by_shape.items()]
        others = sorted(set(range(len(regions))) - set(order))
        self._others = [regions[k] for k in others]
        # The arrays are read in the order [*order, *others]; this is the place of each in it.
        self._places = np.argsort([*order, *others]).tolist() if regions else []

    def __call__(self, memory: Memory) -> list[np.ndarray]:
        block, start = memory.floats[self._cells, 0], 0
        arrays: list[np.ndarray] = []
        for shape, count in self._groups:
            end = start + count * math.prod(shape)
            if shape:
                arrays += list(block[start:end].reshape(count, *shape))
            else:
                # Indexed by a number alone, an array gives no array but a number.
                arrays += [block[k, ...] for k in range(start, end)]
            start = end
        arrays += [memory.read(region) for region in self._others]
        return [arrays[k] for k in self._places]


def _indices(cells: Iterable[slice]) -> np.ndarray:
    return np.r_[(slice(0, 0), *cells)]


def _joined_cells(
    regions: Sequence[Region | None], sizes: Sequence[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the memory cells of several arrays and, for each cell, the index of its number in the
    concatenation of the arrays. Each array has a region and a size; one with the region ``None`` is
    not in memory and has no cells, but is part of the concatenation."""
    pairs = zip(regions, np.cumsum(sizes).tolist(), strict=True)
    used = [(r.cells, slice(end - r.size, end)) for r, end in pairs if r is not None]
    return _indices(cells for cells, _ in used), _indices(elements for _, elements in used)


class BoundFunction:
    """A native function with some of its arguments fixed, for many calls.

    It takes rows of numbers (see `Cells`), one with the varied arguments of each call, and returns
    rows of results. Only one thread may use it at a time, because all calls use the same memory.

    - `results`: converts rows of results to PyTrees.

    **Arguments:** `flat`: all arguments of the function; `varied`: indices in `flat.arrays` of the
    arrays that differ between calls.
    """

    def __init__(self, function: "NativeFunction", flat: "FlatArguments", varied: Sequence[int]):
        program, result = function.program(flat)
        outputs = program.outputs
        # Of an example of a result, `Cells` uses the structure, shapes, dtypes and static leaves.
        self.results = Cells(result([np.zeros(region.shape, region.dtype) for region in outputs]))
        # Arguments that are not varied are written to memory here. A program may overwrite those
        # with more than `LARGEST_UNROLLED` elements (see `Lowering.argument`), so these are written
        # again before each call.
        self._code, self._memory = program.code, program.memory(flat.arrays)
        self._fixed = [
            (region, flat.arrays[k])
            for k, region in enumerate(program.inputs)
            if region is not None and k not in varied and region.size > LARGEST_UNROLLED
        ]
        # Of the numbers of the varied arguments that the program uses: their cells in memory, and
        # their indices in a row.
        self._target, self._source = _joined_cells(
            [program.inputs[k] for k in varied], [np.size(flat.arrays[k]) for k in varied]
        )
        self._out = _indices(region.cells for region in outputs)

    def __call__(self, rows: np.ndarray) -> np.ndarray:
        results, numbers = np.empty((len(rows), len(self._out))), self._memory.floats[:, 0]
        for row, result in zip(rows[:, self._source], results, strict=True):
            numbers[self._target] = row
            for region, array in self._fixed:
                self._memory.write(region, array)
            self._code.run(self._memory)
            result[:] = numbers[self._out]
        return results


def evaluated(
    function: Callable[..., ArrayLike], calls: Sequence[tuple[ArrayLike, ...]]
) -> list[Number] | None:
    """Return the results of calls of a scalar function of small arrays, without compiling it.

    The calls must have arguments of the same shapes and dtypes. Operations on known numbers are
    computed while a jaxpr is lowered, so lowering alone gives the result. JAX itself would compile
    a program for each kind of operation, which takes 20 ms. The result is ``None`` if a call cannot
    be computed in this way, for instance with loops or `exp`.
    """
    # Shapes and dtypes are those of all calls, so one jaxpr serves them all.
    closed = jax.make_jaxpr(function)(*calls[0])
    lowering, results = Lowering(Operations(), RULES), []
    for arguments in calls:
        try:
            [out] = lowering.inline(closed, [*map(lowering.constant, arguments)])
        except UnsupportedPrimitiveError:
            return None
        # A scalar result is the name of a value. Its number is unknown if only a run of the program
        # would determine it.
        number = lowering.ops.number(out) if isinstance(out, int) else None
        if number is None:
            return None
        results.append(number)
    return results


class _Key:
    """Key of flattened arguments, hashed once. `of` returns the same key for equal `parts`, so that
    `is` mostly suffices: to compare the parts of thirty joints takes as long as to flatten them."""

    __slots__ = ("_hash", "layout", "parts")

    def __init__(self, parts: tuple[Hashable, ...], number: int):
        self.parts, self._hash = parts, number
        # The layout of arrays with this key, once it is known.
        self.layout: _Layout | None = None

    @override
    def __hash__(self) -> int:
        return self._hash

    @override
    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, _Key) and self.parts == other.parts)

    @staticmethod
    def of(parts: tuple[Hashable, ...]) -> "_Key":
        key = _KEYS.get(parts)
        if key is None:
            key = _Key(parts, hash(parts))
            _KEYS.add(parts, key)
        return key


_KEYS: RecentPrograms[_Key] = RecentPrograms()
"""Recent keys by their parts."""


@dataclass(eq=False)
class FlatArguments:
    """Arguments of a function, flattened: all of them, or a single one (a part).

    - `make`: returns the arguments themselves.
    - `arrays`: the arrays of NumPy and JAX among the leaves.
    - `traced`: whether JAX traces any of the arrays.
    - `key`: equal for arguments that need the same program: structure, shapes and types of the
      arrays, and all other leaves with their types.
    - `parts`: one object for each argument; empty in a part.
    - `all_floats`: whether all leaves are 64-bit NumPy arrays of floats.
    """

    make: Callable[[], tuple[PyTree, ...]]
    leaves: list[PyTree]
    arrays: list[ArrayLike]
    traced: bool
    key: Hashable
    parts: "tuple[FlatArguments, ...]" = ()
    all_floats: bool = False

    @staticmethod
    def of(arguments: tuple[PyTree, ...]) -> "FlatArguments":
        """Flatten arguments, some of which may be flattened already."""
        return FlatArguments.joined(tuple(map(flattened, arguments)))

    @staticmethod
    def joined(parts: "tuple[FlatArguments, ...]") -> "FlatArguments":
        return FlatArguments(
            lambda: tuple(argument for part in parts for argument in part.arguments),
            reduce(operator.iadd, [part.leaves for part in parts], []),
            reduce(operator.iadd, [part.arrays for part in parts], []),
            any(part.traced for part in parts),
            tuple([part.key for part in parts]),
            parts,
            all(part.all_floats for part in parts),
        )

    @cached_property
    def arguments(self) -> tuple[PyTree, ...]:
        """The arguments themselves, made at the first use, since programs need only the arrays."""
        return self.make()

    @property
    def tree(self) -> PyTree:
        """The single argument itself, if this is a part."""
        (tree,) = self.arguments
        return tree

    @cached_property
    def structure(self) -> PyTree:
        return jax.tree.structure(self.arguments)

    @property
    def tree_structure(self) -> PyTree:
        """The structure of a part's argument; invalid if this argument is a `ConstantFolded`."""
        assert isinstance(self.key, _Key)
        return self.key.parts[0]

    @cached_property
    def floats(self) -> np.ndarray:
        """The numbers of all arrays of floats with fewer than `LARGE` elements, as one array. For a
        scene they are joined once for all programs of a run."""
        if self.parts:
            return np.concatenate([part.floats for part in self.parts])
        layout = self._layout
        # Most parts have no other arrays, and need no selection.
        small = self.arrays if layout.others == [] else [*compress(self.arrays, layout.small)]
        if small and layout.all_double:
            # A third of the time of `np.concatenate`, and a scene has hundreds of arrays. Arrays of
            # JAX, and views such as of every second number, can't be joined in this way.
            with suppress(BufferError, TypeError):
                return np.frombuffer(b"".join(small))  # pyright: ignore
        return np.concatenate(small, axis=None) if small else np.zeros(0)

    @property
    def numbers(self) -> bytes:
        """The numbers of all arrays, as bytes: NaN equals NaN, and -0.0 differs from 0.0."""
        if self.parts:
            return b"".join([part.numbers for part in self.parts])
        others = [np.asarray(self.arrays[k]).tobytes() for k in self._layout.others]
        return b"".join([self.floats.tobytes(), *others])

    def changes(self, earlier: "FlatArguments") -> tuple[bool, ...] | None:
        """Return for each leaf of a part whether its numbers differ from those in `earlier`, a part
        with the same key; ``None`` if there are leaves other than small arrays of floats."""
        if not self.all_floats or self._layout.others:
            return None
        ends = np.cumsum([array.size for array in self.arrays])  # pyright: ignore
        changed = np.zeros(len(ends), bool)
        differing = np.flatnonzero(self.floats != earlier.floats)
        # A number belongs to the first leaf whose end is after the number's index.
        changed[np.searchsorted(ends, differing, side="right")] = True
        return tuple(changed.tolist())

    @property
    def _layout(self) -> "_Layout":
        key = self.key
        assert isinstance(key, _Key)
        if key.layout is None:
            key.layout = _Layout(self.arrays)
        return key.layout


class _Layout:
    """Which arrays of a function's argument are joined in `FlatArguments.floats`.

    - `small`: for each array, whether it is joined: floats with fewer than `LARGE` elements.
    - `others`: indices of the others. `all_double`: whether all joined arrays have 64 bits.
    """

    def __init__(self, arrays: Sequence[ArrayLike]):
        kinds = [(array.size < LARGE, array.dtype) for array in arrays]  # pyright: ignore
        self.small = [is_small and dtype.kind == "f" for is_small, dtype in kinds]
        self.others = [k for k, is_small in enumerate(self.small) if not is_small]
        self.all_double = all(dtype == _FLOAT64 for _, dtype in compress(kinds, self.small))


_FLOAT64 = np.dtype(np.float64)


def flattened(argument: PyTree) -> FlatArguments:
    if isinstance(argument, FlatArguments):
        return argument
    if isinstance(argument, ConstantFolded):
        # The folded scene is an argument of each program of a run, so its flattened form is kept.
        kept = vars(argument)
        if "flattened" not in kept:
            kept["flattened"] = _folded(flattened(argument.tree), argument)
        return kept["flattened"]
    flat = _KEPT.get(id(argument))
    return of_leaves(argument, *jax.tree.flatten(argument)) if flat is None else flat


_KEPT: RecentPrograms[FlatArguments] = RecentPrograms()
"""Flattened forms by the `id` of the argument. Each holds its argument, so that no other object
gets the same `id`."""


def keep_flattened(argument: Argument) -> Argument:
    """Return the argument, which must not change: its flattened form is kept for further calls."""
    _KEPT.add(id(argument), of_leaves(argument, *jax.tree.flatten(argument)))
    return argument


def folded(tree: FlatArguments) -> ConstantFolded:
    """Return `fold_constants` of a flattened argument, without flattening it again."""
    made = fold_constants(tree.tree, flattened=(tree.leaves, tree.tree_structure))
    vars(made)["flattened"] = _folded(tree, made)
    return made


def _folded(tree: FlatArguments, made: ConstantFolded) -> FlatArguments:
    patterns = made.patterns
    flat = FlatArguments(
        # Not `made`, which holds this object: only the garbage collector frees a cycle.
        lambda: (ConstantFolded(tree.tree, patterns),),
        tree.leaves,
        tree.arrays,
        tree.traced,
        _Key.of((tree.key, patterns)),
    )
    # Both have the same arrays, whose numbers are joined once.
    if not tree.traced:
        vars(flat)["floats"] = tree.floats
    return flat


def of_leaves(
    argument: PyTree,
    leaves: list[PyTree],
    structure: jax.tree_util.PyTreeDef,  # pyright: ignore
) -> FlatArguments:
    # Nearly all leaves are arrays of float64, of which the shape is the key. Besides flattening,
    # this loop takes most of the time, so it does nothing else.
    keys: list[Hashable] = [
        leaf.shape if type(leaf) is np.ndarray and leaf.dtype is _FLOAT64 else None
        for leaf in leaves
    ]
    others = [k for k, key in enumerate(keys) if key is None]
    for k in others:
        keys[k] = _key_of_leaf(leaves[k])
    # Leaves that are no arrays are parts of the program, and are not passed to it.
    static = {k for k in others if not eqx.is_array(leaves[k])}
    arrays = [leaf for k, leaf in enumerate(leaves) if k not in static] if static else leaves
    traced = any(isinstance(leaves[k], Tracer) for k in others)
    key = _Key.of((structure, *keys))
    return FlatArguments(lambda: (argument,), leaves, arrays, traced, key, all_floats=not others)


def _key_of_leaf(leaf: PyTree) -> Hashable:
    # As in `of_leaves`, the shape is the key of an array of float64, unless its type is weak.
    kind = kind_of_leaf(leaf)
    return kind[1] if kind[2:] == (_FLOAT64, False) else kind


class NativeFunction:
    """A function of PyTrees that is compiled to machine code when it is first called, or loaded
    from disk. As with `equinox.filter_jit`, a change of anything other than the numbers in arrays
    compiles a further program. Arrays in results are NumPy's.

    **Raises:** `UnsupportedPrimitiveError`, when a program cannot be made.
    """

    def __init__(self, function: Callable[..., PyTree]):
        self._function, self._traced = function, begins_a_program(function)
        self._programs: RecentPrograms[tuple[NativeProgram, Result]] = RecentPrograms()

    def __call__(self, *arguments: PyTree) -> PyTree:
        return self.run(FlatArguments.of(arguments))

    def run(self, flat: FlatArguments) -> PyTree:
        program, result = self.program(flat)
        return result(program(flat.arrays, flat.floats))

    def run_in_parts(self, flat: FlatArguments) -> tuple[FlatArguments, ...]:
        """Return the elements of the result, a tuple, in the form of arguments of later calls."""
        program, result = self.program(flat)
        return result.in_parts(program(flat.arrays, flat.floats))

    def rows(self, arguments: tuple[PyTree, ...], columns: Sequence[np.ndarray | None]) -> PyTree:
        """Return the results of n calls as one PyTree of arrays (n, ...).

        **Arguments:** `arguments`: arguments of one call; `columns`: for each of their leaves its n
        values, (n, ...), or ``None`` if it is the same in all calls. At least one array must have a
        column; columns of leaves that are no arrays are not used.
        """
        flat = FlatArguments.of(arguments)
        # The arrays among the leaves, as in `flat.arrays`, each with its column.
        pairs = [pair for pair in zip(flat.leaves, columns, strict=True) if eqx.is_array(pair[0])]
        varied = [k for k, (_, column) in enumerate(pairs) if column is not None]
        assert varied, "no array has a column"
        examples, values = [pairs[k][0] for k in varied], [pairs[k][1] for k in varied]
        bound = BoundFunction(self, flat, varied)
        rows_of_arguments = Cells(examples).rows(values)
        return bound.results.trees(bound(rows_of_arguments))

    def bound(self, shared: PyTree, *examples: PyTree) -> BoundFunction:
        """Return this function with `shared` as its first argument in all calls. The numbers in the
        `examples` of the other arguments are not used."""
        flat, fixed = FlatArguments.of((shared, *examples)), len(FlatArguments.of((shared,)).arrays)
        return BoundFunction(self, flat, range(fixed, len(flat.arrays)))

    def program(self, flat: FlatArguments) -> tuple[NativeProgram, "Result"]:
        """Return the program for arguments, loaded or made if new, and the form of its result."""
        program = self._programs.recent(flat.key)
        if program is None:
            # Calls may come from several threads, but each program is compiled once: another thread
            # may have made it while this one waited for the lock.
            with collector_at_rest(), program_is_made_inside(), _COMPILES:
                program = self._programs.recent(flat.key)
                if program is None:
                    program = load_or_make(
                        self._function, flat.arguments, lambda: self._compiled(flat)
                    )
                    self._programs.add(flat.key, program)
        return program

    def is_made(self, flat: FlatArguments) -> bool:
        return flat.key in self._programs

    def load(self, flat: FlatArguments) -> None:
        program = load(self._function, flat.arguments)
        if program is not None:
            self._programs.add(flat.key, cast(tuple[NativeProgram, Result], program))

    def _compiled(self, flat: FlatArguments) -> tuple[NativeProgram, "Result"]:
        # The function's result with `ARRAY` in place of its arrays, as the only member of this
        # list, once JAX has traced `of_arrays`.
        result: list[PyTree] = []

        # Leaves that are no arrays are not arguments of the program but parts of it.
        def of_arrays(arrays: list[PyTree]) -> list[PyTree]:
            leaves = joined(divided(flat.leaves)[0], arrays)
            outs, structure = jax.tree.flatten(
                self._traced(*jax.tree.unflatten(flat.structure, leaves))
            )
            placeholders_and_others, out_arrays = divided(outs)
            result[:] = [jax.tree.unflatten(structure, placeholders_and_others)]
            return out_arrays

        stopwatch = Stopwatch()
        traced = program_of(of_arrays, flat.arrays)
        stopwatch.end("tracing")
        # From 2 to `LONGEST_PACKED` tangents are computed as one vector. With 0 they are not: a
        # single tangent is a number, and more tangents are an array like any other.
        tangents = traced.tangents if 1 < traced.tangents <= LONGEST_PACKED else 0
        program = NativeProgram(traced.jaxpr, tangents, stopwatch)
        return program, Result(result[0])


class Result:
    """Form of a function's result: a PyTree with `ARRAY` in place of its arrays."""

    def __init__(self, tree: PyTree):
        self._tree = tree
        self._leaves, self._structure = jax.tree.flatten(tree)
        # Of a flattened result, once one is known: its key, whether all leaves are arrays, and
        # whether of floats. The result itself is not kept, because it holds the memory of its call.
        self._form: tuple[Hashable, bool, bool] | None = None

    @override
    def __reduce__(self) -> tuple[object, ...]:
        # JAX's object for a structure can't be pickled.
        return Result, (self._tree,)

    def __call__(self, arrays: Sequence[np.ndarray]) -> PyTree:
        return jax.tree.unflatten(self._structure, joined(self._leaves, arrays))

    def in_parts(self, arrays: Sequence[np.ndarray]) -> tuple[FlatArguments, ...]:
        """Return the elements of a result that is a tuple, as flattened arguments, from the arrays
        of the result. PyTrees of the elements are made only when needed: for thirty joints, making
        and flattening PyTrees was a third of the time of a call."""
        remaining = iter(arrays)
        return tuple(part._flattened(remaining) for part in self._parts)

    @cached_property
    def _parts(self) -> "tuple[Result, ...]":
        return tuple(map(Result, self._tree))

    def _flattened(self, remaining: Iterator[np.ndarray]) -> FlatArguments:
        # Takes as many of the remaining arrays as this part has.
        leaves, structure = joined(self._leaves, remaining), self._structure
        if self._form is None:
            example = of_leaves(None, leaves, structure)
            self._form = example.key, example.arrays is leaves, example.all_floats
        key, all_arrays, all_floats = self._form
        return FlatArguments(
            lambda: (jax.tree.unflatten(structure, leaves),),
            leaves,
            leaves if all_arrays else [leaf for leaf in leaves if eqx.is_array(leaf)],
            traced=False,
            key=key,
            all_floats=all_floats,
        )
