"""Compile functions of PyTrees to machine code, and call them."""

import math
import threading
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import cached_property
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
    program_is_made_inside,
    program_of,
)
from .._math.vectors import ConstantFolded, fold_constants
from . import control, indexing, linear_algebra, structure
from .alike_calls import CALLS_AT_ONCE, join_alike_calls
from .cells import Cells, Memory, Region
from .lowering import LARGEST_UNROLLED, LONGEST_PACKED, Lowering, UnsupportedPrimitiveError, aval_of
from .machine_code import Code, RecentPrograms, Stopwatch, is_weak, load, load_or_make
from .operations import Number, Operations

RULES = structure.RULES | indexing.RULES | control.RULES | linear_algebra.RULES
"""Rules of the primitives that do not work element by element, by the primitives' names."""
LARGE = 256
"""Number of elements from which on an argument is written to memory by a call of NumPy of its own.
Smaller arguments are joined and written together: for few numbers, a call takes longer than the
copying itself."""
Argument = TypeVar("Argument")
_COMPILES = threading.RLock()
"""Lock that a thread holds while it makes a program, so that no two threads make the same one."""


class NativeProgram:
    """A closed jaxpr as machine code, to be called with arrays.

    - `code`: the machine code.
    - `inputs`: cells of memory for each argument; ``None`` for an argument that the program does
      not use.
    - `outputs`: cells of memory for each result.

    **Arguments:** `tangents`: number of tangents, 0 for none. Arrays whose only axis has this
    length are computed as vectors of the processor. `stopwatch`: measures the stages of
    compilation.

    **Raises:** `UnsupportedPrimitiveError` for a primitive, or a use of one, without a rule, for an
    unsupported dtype such as float32, and if LLVM rejects the program.
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
        self.inputs = [lowering.region(aval_of(next(needed))) if yes else None for yes in used]
        arguments = [lowering.argument(r) for r in self.inputs if r is not None]
        # Results are views of the memory. With cells of their own, a caller who changes one of them
        # in place does not change another.
        results = control.apart(
            lowering, lowering.inline(core.ClosedJaxpr(jaxpr, closed.consts), arguments)
        )
        self.outputs = [
            lowering.stored(array, aval_of(out)) for array, out in zip(results, outs, strict=True)
        ]
        regions = [*filter(None, self.inputs), *self.outputs]
        join_alike_calls(lowering.ops, (k for r in regions for k in (r.start,) if r.size == 1))
        stopwatch.end("lowering")
        self.code = Code(lowering, stopwatch)
        # All small arguments of floats are written at once, and so are all those of integers and
        # bools. This takes a tenth of the time of separate writes. `_small` has an entry for floats
        # and one for the others: the arguments' numbers `ks`; the cells of those that the program
        # uses; and the indices of these elements if all arguments `ks` are joined to one array.
        avals = [aval_of(variable) for variable in closed.jaxpr.invars]
        small = [k for k, aval in enumerate(avals) if aval.size < LARGE]
        floats = [k for k in small if avals[k].dtype.kind == "f"]
        others = [k for k in small if avals[k].dtype.kind != "f"]
        self._small = []
        for ks in (floats, others):
            ends = np.cumsum([0, *(avals[k].size for k in ks)]).tolist()
            used_here = [(self.inputs[k], slice(*ends[n : n + 2])) for n, k in enumerate(ks)]
            pairs = [(r.cells, source) for r, source in used_here if r is not None]
            cells, sources = (_indices(pair[side] for pair in pairs) for side in (0, 1))
            self._small.append((ks, cells, sources))
        self._large = {
            k: r for k, r in enumerate(self.inputs) if r is not None and avals[k].size >= LARGE
        }
        self._read = _Reading(self.outputs)

    def memory(self, leaves: Sequence[ArrayLike], floats: np.ndarray | None = None) -> Memory:
        """Return new memory that contains the program's constants and its arguments.

        **Arguments:** `leaves`: an array for each argument of the jaxpr, also for unused ones;
        `floats`: their `FlatArguments.floats`, if known already.
        """
        memory = self.code.memory()
        small_floats, small_others = self._small
        for target, numbers, (ks, cells, sources) in (
            (memory.floats, floats, small_floats),
            (memory.integers, None, small_others),
        ):
            if len(cells):
                if numbers is None:
                    numbers = np.concatenate([leaves[k] for k in ks], axis=None)
                target[cells, 0] = numbers[sources]
        for k, region in self._large.items():
            memory.write(region, leaves[k])
        return memory

    def __call__(
        self, leaves: Sequence[ArrayLike], floats: np.ndarray | None = None
    ) -> list[np.ndarray]:
        """Return the results of the jaxpr, for arguments as in `memory`."""
        # The results may be views of the memory, so each call has its own.
        memory = self.memory(leaves, floats)
        self.code.run(memory)
        return self._read(memory)


class _Reading:
    """Reads small arrays of floats of equal shape together, because a separate read takes a
    microsecond, and results have hundreds of arrays."""

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


class BoundFunction:
    """A native function with some of its arguments fixed, for many calls.

    It takes and returns rows of numbers as in `Cells`, one row for each call. Only one thread may
    call it at a time, because all calls use the same memory.

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
        # Cells of the varied arguments that the program uses: in a row, and in memory.
        starts = np.cumsum([0, *(np.size(flat.arrays[k]) for k in varied)]).tolist()
        regions = zip(
            map(slice, starts, starts[1:]), (program.inputs[k] for k in varied), strict=True
        )
        used = [(row, region.cells) for row, region in regions if region is not None]
        self._source, self._target = (_indices(pair[k] for pair in used) for k in (0, 1))
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
    """Evaluate a scalar function of small arrays in Python, without compiling it.

    Operations on known numbers are computed while a jaxpr is lowered, so lowering alone gives the
    result. JAX itself would compile a program for each kind of operation, which takes 20 ms.

    **Returns:** the result of each of the calls, which must have arguments of the same shapes and
    dtypes; ``None`` if any of them cannot be computed in this way, for instance with loops or
    `exp`.
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
    """Key of flattened arguments, with a hash computed once. Equal keys are mostly the same object:
    for thirty joints, comparing two keys part by part takes as long as flattening."""

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


class FlatArguments:
    """Arguments of a function, flattened.

    - `parts`: one object of this class for each argument; none if this is such a part.
    - `arrays`: the arrays of NumPy and JAX among the leaves.
    - `traced`: whether JAX traces any of them.
    - `key`: equal for arguments that need the same program: structure, shapes and types of the
      arrays, and all other leaves with their types.
    - `all_floats`: whether all leaves are 64-bit NumPy arrays of floats.

    **Arguments:** `arguments`: returns the arguments themselves.
    """

    def __init__(
        self,
        arguments: Callable[[], tuple[PyTree, ...]],
        leaves: list[PyTree],
        arrays: list[ArrayLike],
        traced: bool,
        key: Hashable,
        parts: "tuple[FlatArguments, ...]" = (),
        all_floats: bool = False,
    ):
        self._arguments, self.leaves, self.arrays = arguments, leaves, arrays
        self.traced, self.key, self.parts, self.all_floats = traced, key, parts, all_floats

    @staticmethod
    def of(arguments: tuple[PyTree, ...]) -> "FlatArguments":
        """Flatten arguments, some of which may be flattened already."""
        return FlatArguments.joined(tuple(map(flattened, arguments)))

    @staticmethod
    def joined(parts: "tuple[FlatArguments, ...]") -> "FlatArguments":
        leaves, arrays, keys = [], [], []
        traced, all_floats = False, True
        for part in parts:
            leaves += part.leaves
            arrays += part.arrays
            keys.append(part.key)
            traced, all_floats = traced or part.traced, all_floats and part.all_floats
        return FlatArguments(
            lambda: tuple(argument for part in parts for argument in part.arguments),
            leaves,
            arrays,
            traced,
            tuple(keys),
            parts,
            all_floats,
        )

    @cached_property
    def arguments(self) -> tuple[PyTree, ...]:
        """The arguments themselves. Programs take their arrays, so those that are the results of
        another program are made only where Python needs them."""
        return self._arguments()

    @property
    def tree(self) -> PyTree:
        """The only argument, if this is a part."""
        (tree,) = self.arguments
        return tree

    @cached_property
    def structure(self) -> PyTree:
        return jax.tree.structure(self.arguments)

    @property
    def tree_structure(self) -> PyTree:
        """The structure of the only argument, if this is a part and no folded scene."""
        assert isinstance(self.key, _Key)
        return self.key.parts[0]

    @cached_property
    def floats(self) -> np.ndarray:
        """The numbers of all arrays of floats with fewer than `LARGE` elements, one array after the
        other. Those of a scene are joined once for all programs of a run."""
        if self.parts:
            return np.concatenate([part.floats for part in self.parts])
        layout = self._layout
        small = self.arrays if layout.others == [] else [*compress(self.arrays, layout.small)]
        if small and layout.all_double:
            # A third of the time of `np.concatenate`, and a scene has hundreds of arrays. Arrays of
            # JAX, and views such as of every second number, can't be joined in this way.
            with suppress(BufferError, TypeError):
                return np.frombuffer(b"".join(small))  # pyright: ignore
        return np.concatenate(small, axis=None) if small else _NONE

    @property
    def numbers(self) -> bytes:
        """The numbers of all arrays, as bytes: NaN equals NaN, and -0.0 differs from 0.0."""
        if self.parts:
            return b"".join([part.numbers for part in self.parts])
        others = [np.asarray(self.arrays[k]).tobytes() for k in self._layout.others]
        return b"".join([self.floats.tobytes(), *others])

    def changes(self, earlier: "FlatArguments") -> tuple[bool, ...] | None:
        """Return whether each leaf of a single argument differs from that of an earlier argument
        with the same key; ``None`` if it has other leaves than small arrays of floats."""
        if not self.all_floats or self._layout.others:
            return None
        ends = np.cumsum([array.size for array in self.arrays])  # pyright: ignore
        changed = np.zeros(len(ends), bool)
        numbers = np.flatnonzero(self.floats != earlier.floats)
        changed[np.searchsorted(ends, numbers, side="right")] = True
        return tuple(changed.tolist())

    @property
    def _layout(self) -> "_Layout":
        key = self.key
        assert isinstance(key, _Key)
        if key.layout is None:
            key.layout = _Layout(self.arrays)
        return key.layout


class _Layout:
    """Which of the arrays of an argument `FlatArguments.floats` joins.

    - `small`: for each array, whether it is joined: floats with fewer than `LARGE` elements.
    - `others`: indices of the arrays that are not joined.
    - `all_double`: whether all joined arrays have 64 bits.
    """

    def __init__(self, arrays: Sequence[ArrayLike]):
        kinds = [(array.size < LARGE, array.dtype) for array in arrays]  # pyright: ignore
        self.small = [is_small and dtype.kind == "f" for is_small, dtype in kinds]
        self.others = [k for k, is_small in enumerate(self.small) if not is_small]
        self.all_double = all(dtype == _FLOAT64 for _, dtype in compress(kinds, self.small))


_NONE = np.zeros(0)
_FLOAT64 = np.dtype(np.float64)


def flattened(argument: PyTree) -> FlatArguments:
    if isinstance(argument, FlatArguments):
        return argument
    if isinstance(argument, ConstantFolded):
        # The folded scene is an argument of each program of a run, so its parts are kept with it.
        kept = vars(argument)
        if "flattened" not in kept:
            kept["flattened"] = _folded(flattened(argument.tree), argument)
        return kept["flattened"]
    flat = _KEPT.get(id(argument))
    return _newly_flattened(argument) if flat is None else flat


_KEPT: RecentPrograms[FlatArguments] = RecentPrograms()
"""Flattened forms by the identity of the argument, which they hold, so that no other object has the
same identity."""


def keep_flattened(argument: Argument) -> Argument:
    """Keep the flattened form of a small argument of many calls, and return the argument."""
    _KEPT.add(id(argument), _newly_flattened(argument))
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
    if not tree.traced:
        vars(flat)["floats"] = tree.floats
    return flat


def _newly_flattened(argument: PyTree) -> FlatArguments:
    return of_leaves(argument, *jax.tree.flatten(argument))


def of_leaves(
    argument: PyTree,
    leaves: list[PyTree],
    structure: jax.tree_util.PyTreeDef,  # pyright: ignore
) -> FlatArguments:
    # Nearly all leaves are arrays of float64, of which the shape is the key. This loop takes most
    # of the time after that of flattening.
    keys: list[Hashable] = [
        leaf.shape if type(leaf) is np.ndarray and leaf.dtype is _FLOAT64 else None
        for leaf in leaves
    ]
    others = [k for k, key in enumerate(keys) if key is None]
    for k in others:
        keys[k] = _key_of_leaf(leaves[k])
    static = {k for k in others if not eqx.is_array(leaves[k])}
    arrays = [leaf for k, leaf in enumerate(leaves) if k not in static] if static else leaves
    traced = any(isinstance(leaves[k], Tracer) for k in others)
    key = _Key.of((structure, *keys))
    return FlatArguments(lambda: (argument,), leaves, arrays, traced, key, all_floats=not others)


def _key_of_leaf(leaf: PyTree) -> Hashable:
    if not eqx.is_array(leaf):
        # By their digits, since 0.0 == -0.0 and NaN != NaN.
        return type(leaf), leaf.hex() if type(leaf) is float else leaf
    # A weak type is the same as a strong one only for the numbers themselves.
    if leaf.dtype == _FLOAT64 and not is_weak(leaf):
        return leaf.shape
    return (leaf.shape, leaf.dtype, True) if is_weak(leaf) else (leaf.shape, leaf.dtype)


class NativeFunction:
    """A function of PyTrees that is compiled to machine code when it is first called. As with
    `equinox.filter_jit`, a change of anything other than the numbers in arrays compiles a further
    program. Arrays in results are NumPy's. Calls raise `UnsupportedPrimitiveError` as those of
    `NativeProgram` do."""

    def __init__(self, function: Callable[..., PyTree]):
        self._function, self._traced = function, begins_a_program(function)
        self._programs: RecentPrograms[tuple[NativeProgram, Result]] = RecentPrograms()
        self._count = 0

    def count(self) -> int:
        """Return how many programs have been compiled or loaded from disk."""
        return self._count

    def __call__(self, *arguments: PyTree) -> PyTree:
        return self.run(FlatArguments.of(arguments))

    def run(self, flat: FlatArguments) -> PyTree:
        program, result = self.program(flat)
        return result(program(flat.arrays, flat.floats))

    def run_in_parts(self, flat: FlatArguments) -> tuple[FlatArguments, ...]:
        """Return the parts of a result that is a tuple, each flattened, as arguments of a further
        call."""
        program, result = self.program(flat)
        return result.in_parts(program(flat.arrays, flat.floats))

    def rows(self, arguments: tuple[PyTree, ...], columns: Sequence[np.ndarray | None]) -> PyTree:
        """Return the results of n calls as one PyTree, with a leading axis of length n in each
        array.

        **Arguments:** `arguments`: those of one call; `columns`: for each leaf of the arguments its
        n values, (n, ...), or ``None`` if it is the same in all calls. At least one array must have
        a column; columns of leaves that are no arrays are not used.
        """
        flat = FlatArguments.of(arguments)
        pairs = [pair for pair in zip(flat.leaves, columns, strict=True) if eqx.is_array(pair[0])]
        varied = [k for k, (_, column) in enumerate(pairs) if column is not None]
        assert varied, "no array has a column"
        examples, values = ([pairs[k][part] for k in varied] for part in (0, 1))
        bound = BoundFunction(self, flat, varied)
        return bound.results.trees(bound(Cells(examples).rows(values)))

    def bound(self, shared: PyTree, *examples: PyTree) -> BoundFunction:
        """Return this function with its first argument fixed. Of the other arguments, `examples`
        have the structure, shapes, dtypes and static leaves; their numbers are not used."""
        flat, fixed = FlatArguments.of((shared, *examples)), len(FlatArguments.of((shared,)).arrays)
        return BoundFunction(self, flat, range(fixed, len(flat.arrays)))

    def program(self, flat: FlatArguments) -> tuple[NativeProgram, "Result"]:
        """Return the program, loaded or made, and the structure of its result."""
        program = self._programs.recent(flat.key)
        if program is None:
            # Calls may come from several threads, but each program is compiled once.
            with collector_at_rest(), program_is_made_inside(), _COMPILES:
                program = self._programs.recent(flat.key)
                if program is None:
                    program = load_or_make(
                        self._function, flat.arguments, lambda: self._compiled(flat)
                    )
                    self._add(flat, program)
        return program

    def _add(self, flat: FlatArguments, program: "tuple[NativeProgram, Result]") -> None:
        self._programs.add(flat.key, program)
        self._count += 1

    def is_made(self, flat: FlatArguments) -> bool:
        return flat.key in self._programs

    def load(self, flat: FlatArguments) -> None:
        program = load(self._function, flat.arguments)
        if program is not None:
            self._add(flat, cast(tuple[NativeProgram, Result], program))

    def _compiled(self, flat: FlatArguments) -> tuple[NativeProgram, "Result"]:
        # The structure of the function's result, known once JAX has traced `of_arrays`.
        result: list[PyTree] = []

        # Leaves that are no arrays are not arguments of the program but parts of it.
        def of_arrays(arrays: list[PyTree]) -> list[PyTree]:
            leaves = joined(divided(flat.leaves)[0], arrays)
            outs, structure = jax.tree.flatten(
                self._traced(*jax.tree.unflatten(flat.structure, leaves))
            )
            static, traced = divided(outs)
            result[:] = [jax.tree.unflatten(structure, static)]
            return traced

        stopwatch = Stopwatch()
        traced = program_of(of_arrays, flat.arrays)
        stopwatch.end("tracing")
        # A single tangent is a number, and more than `LONGEST_PACKED` are an array like any other.
        tangents = traced.tangents if 1 < traced.tangents <= LONGEST_PACKED else 0
        program = NativeProgram(traced.jaxpr, tangents, stopwatch)
        return program, Result(result[0])


class Result:
    """The structure and static leaves of a function's result, with `ARRAY` in place of its
    arrays."""

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
        """Return the parts of a result that is a tuple. Their PyTrees are made only where needed:
        for thirty joints, making and flattening them was a third of the time of a call."""
        remaining = iter(arrays)
        return tuple(part._flattened(remaining) for part in self._parts)

    @cached_property
    def _parts(self) -> "tuple[Result, ...]":
        return tuple(map(Result, self._tree))

    def _flattened(self, remaining: Iterator[np.ndarray]) -> FlatArguments:
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
