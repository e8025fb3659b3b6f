"""From a jaxpr to operations on scalars.

Calls are inlined, and small arrays are taken apart: each element is a value of its own, so that
slices and concatenations cost nothing. An array of as many elements as there are tangents is kept
as one vector. Arrays of more than `LARGEST_TAKEN_APART` elements stay in memory and are worked on
by loops; a slice of them is written in place where nothing reads the older content any more.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jax.core import ShapedArray
from jax.extend import core
from numpy.typing import ArrayLike

from . import elementwise
from .elementwise import RULES, Parameters, Rule
from .operations import KINDS, Operations, Value

LARGEST_TAKEN_APART = 48
"""Elements of an array that are values of their own."""
LONGEST_PACKED = 16
FEWEST_PACKED = 60
"""Operations on arrays of one length from which on they are kept as vectors."""
LONGEST_CHOICE = 24
"""Equations of a branch up to which both branches are carried out and one is chosen."""
Atom = core.Var | core.Literal
"""A variable or a number in a jaxpr."""
_CALLS = {
    "jit": "jaxpr",
    "pjit": "jaxpr",
    "closed_call": "call_jaxpr",
    "core_call": "call_jaxpr",
    "remat": "jaxpr",
    "checkpoint": "jaxpr",
    "custom_jvp_call": "call_jaxpr",
    "custom_vjp_call": "call_jaxpr",
    "custom_vjp_call_jaxpr": "fun_jaxpr",
}
"""Primitives that call a jaxpr, and the parameter which holds it."""


class UnsupportedPrimitiveError(NotImplementedError):
    """A primitive, or a use of one, that has no rule here."""


@dataclass(frozen=True)
class Packed:
    """An array with one element for each tangent, kept as one vector."""

    value: Value


@dataclass
class InMemory:
    """An array in memory, from the cell `start` on.

    `owned`: whether its content may be overwritten, since nothing else reads it.
    """

    start: int
    shape: tuple[int, ...]
    kind: str
    owned: bool = False

    @property
    def size(self) -> int:
        """The number of elements."""
        return int(np.prod(self.shape, dtype=int))


Array = Value | Packed | np.ndarray | InMemory
"""A scalar, a vector of tangents, an array of values, or an array in memory."""


def kind_of(aval: ShapedArray) -> str:
    """The kind of the elements of an abstract array."""
    kind = KINDS.get(str(aval.dtype))
    if kind is None:
        raise UnsupportedPrimitiveError(f"arrays of {aval.dtype}")
    return kind


@dataclass(frozen=True)
class Region:
    """Where an array lies in memory: its first cell, and its shape, dtype and number of cells."""

    start: int
    shape: tuple[int, ...]
    dtype: np.dtype
    size: int

    @staticmethod
    def of(aval: ShapedArray, start: int) -> "Region":
        """The region of an array like an abstract one."""
        kind_of(aval)
        shape = tuple(aval.shape)
        return Region(start, shape, np.dtype(aval.dtype), int(np.prod(shape, dtype=int)))

    @property
    def end(self) -> int:
        """The cell behind the last."""
        return self.start + self.size


def inner_jaxprs(equation: core.JaxprEqn) -> Iterator[core.Jaxpr]:
    """The jaxprs among an equation's parameters."""
    for parameter in equation.params.values():
        items = parameter if isinstance(parameter, tuple | list) else [parameter]
        for item in items:
            jaxpr = getattr(item, "jaxpr", item)
            if hasattr(jaxpr, "eqns"):
                yield jaxpr


def count_equations(jaxpr: core.Jaxpr) -> int:
    """The number of equations, those of inner jaxprs included."""
    return sum(1 + sum(map(count_equations, inner_jaxprs(e))) for e in jaxpr.eqns)


def tangents_of(jaxpr: core.Jaxpr) -> int:
    """The length of the arrays that most operations work on: the number of tangents, or 0."""
    lengths: Counter[int] = Counter()

    def visit(jaxpr: core.Jaxpr) -> None:
        for equation in jaxpr.eqns:
            shape = getattr(equation.outvars[0].aval, "shape", ()) if equation.outvars else ()
            if equation.primitive.name in ("mul", "add", "add_any") and len(shape) == 1:
                lengths[shape[0]] += 1
            for inner in inner_jaxprs(equation):
                visit(inner)

    visit(jaxpr)
    for length, count in lengths.most_common():
        if 1 < length <= LONGEST_PACKED and count >= FEWEST_PACKED:
            return length
    return 0


class Lowering:
    """Adds the equations of jaxprs to operations.

    `constants`: content of memory that is there from the start, by its first cell.
    """

    def __init__(self, program: Operations):
        self.do = program
        self.constants: dict[int, np.ndarray] = {}
        self._literals: dict[int, Array] = {}

    # Values.

    def given(self, aval: ShapedArray, start: int) -> Array:
        """An argument in memory; small ones are read at once."""
        kind, shape = kind_of(aval), tuple(aval.shape)
        memory = InMemory(start, shape, kind, owned=True)
        return memory if memory.size > LARGEST_TAKEN_APART else self._read(memory)

    def constant(self, array: ArrayLike) -> Array:
        """A known array."""
        array = np.asarray(array)
        kind = KINDS.get(str(array.dtype))
        if kind is None:
            raise UnsupportedPrimitiveError(f"arrays of {array.dtype}")
        if array.size > LARGEST_TAKEN_APART:
            start = self.do.allocate(array.size)
            self.constants[start] = array
            return InMemory(start, array.shape, kind)
        values = [self.do.constant(kind, x) for x in array.ravel().tolist()]
        return self._array(values, array.shape)

    def _array(self, values: Sequence[Value], shape: tuple[int, ...]) -> Array:
        """The array of so many values in order."""
        if shape == ():
            return values[0]
        if self._is_packed(shape):
            return Packed(self.do.pack(list(values)))
        return np.array(values, dtype=np.int64).reshape(shape)

    def _is_packed(self, shape: tuple[int, ...]) -> bool:
        return self.do.packed > 0 and shape == (self.do.packed_length,)

    def values(self, array: Array) -> list[Value]:
        """The elements of an array in order."""
        if isinstance(array, int):
            return [array]
        if isinstance(array, Packed):
            return [self.do.element(array.value, k) for k in range(self.do.packed_length)]
        if isinstance(array, InMemory):
            return [self.do.load(array.kind, array.start + k) for k in range(array.size)]
        return array.ravel().tolist()

    def _read(self, memory: InMemory) -> Array:
        if self._is_packed(memory.shape):
            return Packed(self.do.pack(self.values(memory)))
        return self._array(self.values(memory), memory.shape)

    def in_memory(self, array: Array, shape: tuple[int, ...]) -> InMemory:
        """The array in memory, written there if it isn't."""
        if isinstance(array, InMemory):
            return array
        values = self.values(array)
        memory = InMemory(self.do.allocate(len(values)), shape, self.do.kinds[values[0]], True)
        for k, value in enumerate(values):
            self.do.store(value, memory.start + k)
        return memory

    def stored(self, array: Array, aval: ShapedArray) -> Region:
        """The region of an array in memory, written there if it isn't."""
        if isinstance(array, InMemory):
            return Region.of(aval, array.start)
        region = Region.of(aval, self.do.allocate(int(np.prod(aval.shape, dtype=int))))
        for k, value in enumerate(self.values(array)):
            self.do.store(value, region.start + k)
        return region

    def copied(self, memory: InMemory, start: int | None = None) -> InMemory:
        """A copy of an array in memory, at new cells unless told where."""
        start = self.do.allocate(memory.size) if start is None else start

        def visit(k: Value) -> None:
            self.do.store(self.do.load(memory.kind, memory.start, k), start, k)

        self.do.repeat(memory.size, visit)
        return InMemory(start, memory.shape, memory.kind, owned=True)

    # Equations.

    def run(
        self, jaxpr: core.Jaxpr, consts: Sequence[Array], arguments: Sequence[Array]
    ) -> list[Array]:
        """The results of a jaxpr; owned arrays among the arguments may be overwritten."""
        known: dict[Atom, Array] = dict(zip(jaxpr.constvars, consts, strict=True))
        known |= dict(zip(jaxpr.invars, arguments, strict=True))
        last: dict[Atom, int] = {}
        for number, equation in enumerate(jaxpr.eqns):
            for atom in equation.invars:
                if not isinstance(atom, core.Literal):
                    last[atom] = number
        for atom in jaxpr.outvars:
            if not isinstance(atom, core.Literal):
                last[atom] = len(jaxpr.eqns)
        for number, equation in enumerate(jaxpr.eqns):
            self._run_equation(equation, known, last, number)
        return [self._atom(atom, known) for atom in jaxpr.outvars]

    def _atom(self, atom: Atom, known: dict[Atom, Array]) -> Array:
        if not isinstance(atom, core.Literal):
            return known[atom]
        if np.ndim(atom.val) == 0:
            kind = KINDS.get(str(atom.aval.dtype))
            if kind is not None:
                return self.do.constant(kind, atom.val)
        return self.constant(np.asarray(atom.val, dtype=atom.aval.dtype))

    def _run_equation(
        self, equation: core.JaxprEqn, known: dict[Atom, Array], last: dict[Atom, int], number: int
    ) -> None:
        arguments: list[Array] = []
        live: list[InMemory] = []
        for atom in equation.invars:
            array = self._atom(atom, known)
            if isinstance(array, InMemory):
                dies = last[atom] == number and list(equation.invars).count(atom) == 1
                if not dies:
                    live.append(array)
                    array = replace(array, owned=False)
            arguments.append(array)
        outs = self._outs(equation, arguments)
        starts = Counter(out.start for out in outs if isinstance(out, InMemory))
        for array in live:
            if array.start in starts:
                array.owned = False
        for variable, out in zip(equation.outvars, outs, strict=True):
            if isinstance(out, InMemory) and starts[out.start] > 1:
                out = replace(out, owned=False)
            known[variable] = out

    def _outs(self, equation: core.JaxprEqn, arguments: list[Array]) -> Sequence[Array]:
        name, parameters = equation.primitive.name, equation.params
        if name in RULES:
            if len(equation.outvars) == 1:
                return [self._elementwise(equation, arguments)]
            return arguments  # a barrier of several arrays
        if name in _CALLS:
            closed = parameters[_CALLS[name]]
            inner = getattr(closed, "jaxpr", closed)
            return self.run(inner, self._consts(closed), arguments)
        rule = getattr(self, f"_{name.replace('-', '_')}", None)
        if rule is None:
            raise UnsupportedPrimitiveError(name)
        return rule(equation, *arguments)

    def _consts(self, closed: core.ClosedJaxpr) -> list[Array]:
        return [self.constant(const) for const in getattr(closed, "consts", ())]

    def _elementwise(self, equation: core.JaxprEqn, arguments: list[Array]) -> Array:
        aval = equation.outvars[0].aval
        kind, shape = kind_of(aval), tuple(aval.shape)
        rule, do, parameters = RULES[equation.primitive.name], self.do, equation.params
        if str(aval.dtype) == "uint32":
            rule = _unsigned(rule)
        arguments = [
            self._spread(argument, tuple(v.aval.shape), shape)
            for argument, v in zip(arguments, equation.invars, strict=True)
        ]
        try:
            if shape == ():
                return rule(do, kind, parameters, *arguments)
            if int(np.prod(shape)) > LARGEST_TAKEN_APART:
                return self._by_loop(
                    lambda *values: rule(do, kind, parameters, *values), kind, shape, arguments
                )
            if self._is_packed(shape):
                vectors = [self._vector(argument) for argument in arguments]
                return Packed(rule(do, f"{kind}p", parameters, *vectors))
            rows = [self._broadcast(argument, shape) for argument in arguments]
            values = [rule(do, kind, parameters, *row) for row in zip(*rows, strict=True)]
        except NotImplementedError as error:
            raise UnsupportedPrimitiveError(
                f"{equation.primitive.name} ({error})" if error.args else equation.primitive.name
            ) from error
        return self._array(values, shape)

    def _spread(self, array: Array, shape: tuple[int, ...], wanted: tuple[int, ...]) -> Array:
        """An array, unless it is a scalar, with axes of length one repeated as another shape has
        them."""
        if isinstance(array, int) or shape == wanted:
            return array
        size = int(np.prod(shape, dtype=int))
        places = np.broadcast_to(np.arange(size).reshape(shape), wanted)
        return self._at_places(array, places)

    def _vector(self, array: Array) -> Value:
        """The vector of an array of tangents, or of a scalar."""
        if isinstance(array, Packed):
            return array.value
        values = self.values(array)
        return self.do.pack(values * (self.do.packed_length if len(values) == 1 else 1))

    def _broadcast(self, array: Array, shape: tuple[int, ...]) -> list[Value]:
        if isinstance(array, int):
            return [array] * int(np.prod(shape))
        return self.values(array)

    def _by_loop(
        self,
        rule: Callable[..., Value],
        kind: str,
        shape: tuple[int, ...],
        arguments: Sequence[Array],
    ) -> InMemory:
        """A rule applied to each element of arrays in memory."""
        out = InMemory(self.do.allocate(int(np.prod(shape))), shape, kind, owned=True)

        def visit(k: Value) -> None:
            values = [
                self.do.load(a.kind, a.start, k) if isinstance(a, InMemory) else a
                for a in arguments
            ]
            if not all(isinstance(value, int) for value in values):
                raise UnsupportedPrimitiveError("arrays of different sizes")
            self.do.store(rule(*values), out.start, k)

        self.do.repeat(out.size, visit)
        return out

    # Arrays whose elements are those of others.

    def _moved(self, equation: core.JaxprEqn, array: Array, places: np.ndarray) -> Array:
        return self._at_places(array, places.reshape(equation.outvars[0].aval.shape))

    def _at_places(self, array: Array, places: np.ndarray) -> Array:
        """The array whose elements are at some places among those of another."""
        shape, flat = places.shape, places.ravel()
        if isinstance(array, InMemory):
            if flat.size and np.array_equal(flat, np.arange(flat[0], flat[0] + flat.size)):
                moved = InMemory(array.start + int(flat[0]), shape, array.kind, array.owned)
                if flat.size <= LARGEST_TAKEN_APART:
                    return self._read(moved)
                if flat.size < array.size:
                    moved = replace(moved, owned=False)
                return moved
            if flat.size <= LARGEST_TAKEN_APART:
                values = [self.do.load(array.kind, array.start + int(k)) for k in flat]
                return self._array(values, shape)
            return self._by_table(array, flat, shape)
        values = self.values(array)
        if flat.size > LARGEST_TAKEN_APART:
            if len(values) == 1:
                kind = self.do.kinds[values[0]]
                return self._by_loop(lambda value: value, kind, shape, values)
            source = self.in_memory(array, (len(values),))
            return self._by_table(source, flat, shape)
        return self._array([values[k] for k in flat], shape)

    def _by_table(self, array: InMemory, places: np.ndarray, shape: tuple[int, ...]) -> InMemory:
        """The elements of an array in memory at many places, which a table lists."""
        start = self.do.allocate(places.size)
        self.constants[start] = places
        table = InMemory(start, (places.size,), "i")

        def at(place: Value) -> Value:
            return self.do.load(array.kind, array.start, place)

        return self._by_loop(at, array.kind, shape, [table])

    def _structure(self, equation: core.JaxprEqn, array: Array, move: Callable) -> list[Array]:
        aval = equation.invars[0].aval
        size = int(np.prod(aval.shape, dtype=int))
        return [self._moved(equation, array, move(np.arange(size).reshape(aval.shape)))]

    def _squeeze(self, equation: core.JaxprEqn, array: Array) -> list[Array]:
        shape = equation.outvars[0].aval.shape
        if isinstance(array, int):
            return [array]
        if isinstance(array, np.ndarray) and array.size == 1 and shape == ():
            return [int(array.ravel()[0])]
        return self._structure(equation, array, lambda places: places)

    def _reshape(self, equation: core.JaxprEqn, array: Array, *_: Array) -> list[Array]:
        return self._structure(equation, array, lambda places: places)

    _expand_dims = _reshape

    def _slice(self, equation: core.JaxprEqn, array: Array) -> list[Array]:
        parameters = equation.params
        steps = parameters["strides"] or (1,) * len(parameters["start_indices"])
        rows = zip(parameters["start_indices"], parameters["limit_indices"], steps, strict=True)
        at = tuple(slice(*row) for row in rows)
        if isinstance(array, Packed) and equation.outvars[0].aval.shape == (1,):
            element = self.do.element(array.value, at[0].start)
            return [self._array([element], (1,))]
        return self._structure(equation, array, lambda places: places[at])

    def _broadcast_in_dim(self, equation: core.JaxprEqn, array: Array, *_: Array) -> list[Array]:
        shape, dimensions = equation.params["shape"], equation.params["broadcast_dimensions"]
        if isinstance(array, int) and self._is_packed(tuple(shape)):
            return [Packed(self._vector(array))]

        def move(places: np.ndarray) -> np.ndarray:
            own = [1] * len(shape)
            for axis, size in zip(dimensions, places.shape, strict=True):
                own[axis] = size
            return np.broadcast_to(places.reshape(own), shape)

        return self._structure(equation, array, move)

    def _transpose(self, equation: core.JaxprEqn, array: Array) -> list[Array]:
        order = equation.params["permutation"]
        return self._structure(equation, array, lambda places: places.transpose(order))

    def _rev(self, equation: core.JaxprEqn, array: Array) -> list[Array]:
        axes = equation.params["dimensions"]
        return self._structure(equation, array, lambda places: np.flip(places, axes))

    def _tile(self, equation: core.JaxprEqn, array: Array) -> list[Array]:
        reps = equation.params["reps"]
        return self._structure(equation, array, lambda places: np.tile(places, reps))

    def _joined(
        self, equation: core.JaxprEqn, arrays: Sequence[Array], join: Callable
    ) -> list[Array]:
        """One array of several ones'."""
        sizes = [int(np.prod(v.aval.shape, dtype=int)) for v in equation.invars]
        starts = np.cumsum([0, *sizes])
        places = join(
            [
                np.arange(start, start + size).reshape(v.aval.shape)
                for start, size, v in zip(starts, sizes, equation.invars, strict=False)
            ]
        )
        shape = tuple(equation.outvars[0].aval.shape)
        if places.size <= LARGEST_TAKEN_APART:
            values = [value for array in arrays for value in self.values(array)]
            return [self._array([values[k] for k in places.ravel()], shape)]
        if not np.array_equal(places.ravel(), np.arange(starts[-1])):
            raise UnsupportedPrimitiveError(f"{equation.primitive.name} of large arrays")
        out = InMemory(
            self.do.allocate(places.size), shape, kind_of(equation.outvars[0].aval), True
        )
        for start, array in zip(starts, arrays, strict=False):
            if isinstance(array, InMemory):
                self.copied(array, out.start + int(start))
            else:
                for k, value in enumerate(self.values(array)):
                    self.do.store(value, out.start + int(start) + k)
        return [out]

    def _concatenate(self, equation: core.JaxprEqn, *arrays: Array) -> list[Array]:
        axis = equation.params["dimension"]
        return self._joined(equation, arrays, lambda places: np.concatenate(places, axis))

    def _stack(self, equation: core.JaxprEqn, *arrays: Array) -> list[Array]:
        axis = equation.params.get("axis", equation.params.get("dimension", 0))
        return self._joined(equation, arrays, lambda places: np.stack(places, axis))

    def _pad(self, equation: core.JaxprEqn, array: Array, padding: Array) -> list[Array]:
        aval, widths = equation.invars[0].aval, equation.params["padding_config"]
        if any(low < 0 or high < 0 or inside for low, high, inside in widths):
            raise UnsupportedPrimitiveError("pad with negative or inner padding")
        size = int(np.prod(aval.shape, dtype=int))
        places = np.pad(
            np.arange(size).reshape(aval.shape),
            [(low, high) for low, high, _ in widths],
            constant_values=size,
        )
        if places.size > LARGEST_TAKEN_APART:
            raise UnsupportedPrimitiveError("pad of large arrays")
        values = [*self.values(array), *self.values(padding)]
        return [self._array([values[k] for k in places.ravel()], places.shape)]

    def _split(self, equation: core.JaxprEqn, array: Array) -> list[Array]:
        sizes, axis = equation.params["sizes"], equation.params["axis"]
        aval = equation.invars[0].aval
        places = np.arange(int(np.prod(aval.shape, dtype=int))).reshape(aval.shape)
        parts = np.split(places, np.cumsum(sizes)[:-1], axis)
        if isinstance(array, InMemory):
            raise UnsupportedPrimitiveError("split of large arrays")
        values = self.values(array)
        return [self._array([values[k] for k in p.ravel()], p.shape) for p in parts]

    def _unstack(self, equation: core.JaxprEqn, array: Array) -> list[Array]:
        aval, axis = equation.invars[0].aval, equation.params.get("axis", 0)
        places = np.arange(aval.size).reshape(aval.shape)
        return [self._at_places(array, part) for part in np.moveaxis(places, axis, 0)]

    def _iota(self, equation: core.JaxprEqn) -> list[Array]:
        aval, axis = equation.outvars[0].aval, equation.params["dimension"]
        own = np.arange(aval.shape[axis]).reshape(
            [-1 if k == axis else 1 for k in range(len(aval.shape))]
        )
        return [self.constant(np.broadcast_to(own, aval.shape).astype(aval.dtype))]

    # Elements at computed places.

    def _strides(self, shape: Sequence[int]) -> list[int]:
        return [int(np.prod(shape[k + 1 :], dtype=int)) for k in range(len(shape))]

    def _whole(self, value: Value) -> Value:
        return elementwise.convert(self.do, "i", value)

    def _clamped(self, value: Value, high: int) -> Value:
        bounds = [self.do.constant("i", number) for number in (0, high)]
        return RULES["clamp"](self.do, "i", {}, bounds[0], self._whole(value), bounds[1])

    def _first_place(
        self, starts: Sequence[Array], shape: Sequence[int], sizes: Sequence[int]
    ) -> Value:
        """The place among all elements of a block of some sizes in an array."""
        do, total = self.do, self.do.constant("i", 0)
        rows = zip(starts, shape, sizes, self._strides(shape), strict=True)
        for start, length, size, stride in rows:
            own = self._clamped(self.values(start)[0], length - size)
            total = do.do("add", "i", total, do.do("mul", "i", own, do.constant("i", stride)))
        return total

    def _places_in(self, shape: Sequence[int], sizes: Sequence[int]) -> np.ndarray:
        every = np.arange(int(np.prod(shape, dtype=int))).reshape(shape)
        return every[tuple(slice(size) for size in sizes)].ravel()

    def _at(self, memory: InMemory, first: Value, places: Iterable[int]) -> list[Value]:
        return [self.do.load(memory.kind, memory.start + int(k), first) for k in places]

    def _dynamic_slice(self, equation: core.JaxprEqn, array: Array, *starts: Array) -> list[Array]:
        shape, sizes = equation.invars[0].aval.shape, equation.params["slice_sizes"]
        first = self._first_place(starts, shape, sizes)
        places = self._places_in(shape, sizes)
        known = self.do.number(first)
        if known is not None:
            return [self._moved(equation, array, (places + int(known)).reshape(sizes))]
        memory = self.in_memory(array, tuple(shape))
        if places.size <= LARGEST_TAKEN_APART:
            return [self._array(self._at(memory, first, places), tuple(sizes))]
        if not np.array_equal(places, np.arange(places.size)):
            raise UnsupportedPrimitiveError("dynamic_slice of many rows")

        def visit(k: Value) -> None:
            place = self.do.do("add", "i", first, k)
            self.do.store(self.do.load(memory.kind, memory.start, place), out.start, k)

        out = InMemory(self.do.allocate(places.size), tuple(sizes), memory.kind, True)
        self.do.repeat(places.size, visit)
        return [out]

    def _dynamic_update_slice(
        self, equation: core.JaxprEqn, array: Array, update: Array, *starts: Array
    ) -> list[Array]:
        shape, sizes = (equation.invars[k].aval.shape for k in (0, 1))
        first = self._first_place(starts, shape, sizes)
        places = self._places_in(shape, sizes)
        known = self.do.number(first)
        small = not isinstance(array, InMemory)
        if small and known is not None:
            values = self.values(array)
            for k, value in zip(places, self.values(update), strict=True):
                values[int(k) + int(known)] = value
            return [self._array(values, tuple(shape))]
        memory = self.in_memory(array, tuple(shape))
        if not memory.owned:
            memory = self.copied(memory)
        if isinstance(update, InMemory):
            if not np.array_equal(places, np.arange(places.size)):
                raise UnsupportedPrimitiveError("dynamic_update_slice of many rows")
            source = update

            def visit(k: Value) -> None:
                place = self.do.do("add", "i", first, k)
                self.do.store(self.do.load(source.kind, source.start, k), memory.start, place)

            self.do.repeat(places.size, visit)
        else:
            for k, value in zip(places, self.values(update), strict=True):
                self.do.store(value, memory.start + int(k), first)
        return [self._read(memory) if small else replace(memory, owned=True)]

    def _gather(self, equation: core.JaxprEqn, array: Array, indices: Array) -> list[Array]:
        parameters, shape = equation.params, equation.invars[0].aval.shape
        numbers = parameters["dimension_numbers"]
        sizes, out = parameters["slice_sizes"], equation.outvars[0].aval
        fills = "FILL" in str(parameters["mode"])
        if numbers.operand_batching_dims:
            raise UnsupportedPrimitiveError("gather of batches")
        batch = equation.invars[1].aval.shape[:-1]
        offsets = [k for k in range(len(shape)) if k not in numbers.collapsed_slice_dims]
        block = [sizes[k] for k in offsets]
        strides = self._strides(shape)
        inside = sum(
            np.arange(size).reshape([-1 if j == k else 1 for j in range(len(block))])
            * strides[axis]
            for k, (axis, size) in enumerate(zip(offsets, block, strict=True))
        )
        inside = np.broadcast_to(np.asarray(inside, dtype=int), block).ravel()
        depth = equation.invars[1].aval.shape[-1]
        memory: InMemory | None = array if isinstance(array, InMemory) else None
        small = None if memory is not None else self.values(array)

        def rows_at(starts: list[Value]) -> list[Value]:
            nonlocal memory
            do, first, fits = self.do, self.do.constant("i", 0), self.do.constant("b", True)
            for start, axis in zip(starts, numbers.start_index_map, strict=True):
                whole, high = self._whole(start), shape[axis] - sizes[axis]
                own = self._clamped(whole, high)
                fits = do.do("and", "b", fits, do.do("ieq", "b", own, whole))
                step = do.do("mul", "i", own, do.constant("i", strides[axis]))
                first = do.do("add", "i", first, step)
            known = do.number(first)
            if small is not None and known is not None:
                values = [small[int(known) + int(k)] for k in inside]
            else:
                if memory is None:
                    memory = self.in_memory(array, tuple(shape))
                values = self._at(memory, first, inside)
            if not fills:
                return values
            kind = do.kinds[values[0]]
            missing = do.constant(kind, np.nan if kind == "f" else 0)
            return [do.do("select", kind, fits, value, missing) for value in values]

        count = int(np.prod(batch, dtype=int))
        if int(np.prod(out.shape, dtype=int)) <= LARGEST_TAKEN_APART:
            flat = self.values(indices)
            rows = [rows_at(flat[k * depth : (k + 1) * depth]) for k in range(count)]
            values = np.array(rows, dtype=np.int64).reshape([*batch, *block])
            offset = set(numbers.offset_dims)
            order = [k for k in range(values.ndim) if k not in offset]
            own = [0] * values.ndim
            for k, axis in enumerate(order):
                own[axis] = k
            for k, axis in enumerate(numbers.offset_dims):
                own[axis] = len(batch) + k
            return [self._array(values.transpose(own).ravel().tolist(), tuple(out.shape))]
        if tuple(numbers.offset_dims) != tuple(range(len(batch), len(out.shape))):
            raise UnsupportedPrimitiveError("gather of large transposed arrays")
        table = self.in_memory(indices, equation.invars[1].aval.shape)
        if memory is None:
            memory = self.in_memory(array, tuple(shape))
        result = InMemory(
            self.do.allocate(count * inside.size), tuple(out.shape), memory.kind, True
        )

        def visit(k: Value) -> None:
            do = self.do
            row = do.do("mul", "i", k, do.constant("i", depth))
            starts = [do.load(table.kind, table.start + j, row) for j in range(depth)]
            first = do.do("mul", "i", k, do.constant("i", inside.size))
            for j, value in enumerate(rows_at(starts)):
                do.store(value, result.start + j, first)

        self.do.repeat(count, visit)
        return [result]

    def _scattered(
        self, equation: core.JaxprEqn, array: Array, indices: Array, updates: Array, name: str
    ) -> list[Array]:
        """A small array with some elements replaced, or joined with updates by a rule."""
        shape, numbers = equation.invars[0].aval.shape, equation.params["dimension_numbers"]
        update_shape, depth = equation.invars[2].aval.shape, equation.invars[1].aval.shape[-1]
        large = [a for a in (array, indices, updates) if isinstance(a, InMemory)]
        if large or numbers.operand_batching_dims:
            raise UnsupportedPrimitiveError(f"{equation.primitive.name} of large arrays")
        do, kind, values = self.do, kind_of(equation.outvars[0].aval), self.values(array)
        strides, starts, news = self._strides(shape), self.values(indices), self.values(updates)
        windows = list(numbers.update_window_dims)
        kept = [k for k in range(len(shape)) if k not in numbers.inserted_window_dims]
        batches = [k for k in range(len(update_shape)) if k not in windows]
        batch_shape = [update_shape[k] for k in batches]
        for new, place in zip(news, np.ndindex(*update_shape), strict=True):
            row = int(np.ravel_multi_index([place[k] for k in batches], batch_shape))
            row = row if batch_shape else 0
            offsets = dict.fromkeys(range(len(shape)), 0)
            offsets |= {axis: place[k] for k, axis in zip(windows, kept, strict=True)}
            own, fits = do.constant("i", 0), do.constant("b", True)
            for j, axis in enumerate(numbers.scatter_dims_to_operand_dims):
                start = self._whole(starts[row * depth + j])
                start = do.do("add", "i", start, do.constant("i", offsets.pop(axis)))
                inside = do.do("ige", "b", start, do.constant("i", 0))
                below = do.do("ilt", "b", start, do.constant("i", shape[axis]))
                fits = do.do("and", "b", fits, do.do("and", "b", inside, below))
                step = do.do("mul", "i", start, do.constant("i", strides[axis]))
                own = do.do("add", "i", own, step)
            rest = sum(strides[axis] * offset for axis, offset in offsets.items())
            own = do.do("add", "i", own, do.constant("i", rest))
            known = do.number(own)
            targets = range(len(values)) if known is None else [int(known)]
            for k in targets:
                if not 0 <= k < len(values):
                    continue
                here = do.do("and", "b", fits, do.do("ieq", "b", own, do.constant("i", k)))
                joined = new if not name else RULES[name](do, kind, {}, values[k], new)
                values[k] = do.do("select", kind, here, joined, values[k])
        return [self._array(values, tuple(shape))]

    def _scatter(self, equation: core.JaxprEqn, *arguments: Array) -> list[Array]:
        return self._scattered(equation, *arguments, name="")

    def _scatter_add(self, equation: core.JaxprEqn, *arguments: Array) -> list[Array]:
        return self._scattered(equation, *arguments, name="add")

    def _scatter_mul(self, equation: core.JaxprEqn, *arguments: Array) -> list[Array]:
        return self._scattered(equation, *arguments, name="mul")

    # Reductions.

    def _reduced(self, equation: core.JaxprEqn, array: Array, name: str) -> list[Array]:
        aval, axes = equation.invars[0].aval, tuple(equation.params["axes"])
        kind, out = kind_of(aval), equation.outvars[0].aval

        def join(a: Value, b: Value) -> Value:
            return RULES[name](self.do, kind, {}, a, b)

        if isinstance(array, InMemory):
            if out.shape != ():
                raise UnsupportedPrimitiveError(f"{equation.primitive.name} along some axes")
            return [self._scan_memory(array, join)[-1]]
        values = np.array(self.values(array)).reshape(aval.shape)
        rest = [k for k in range(values.ndim) if k not in axes]
        rows = values.transpose([*rest, *axes]).reshape(int(np.prod(out.shape, dtype=int)), -1)
        found = []
        for row in rows.tolist():
            total = row[0]
            for value in row[1:]:
                total = join(total, value)
            found.append(total)
        return [self._array(found, tuple(out.shape))]

    def _scan_memory(
        self,
        array: InMemory,
        join: Callable[[Value, Value], Value],
        out: InMemory | None = None,
    ) -> list[Value]:
        """Elements joined one after the other, each total stored if there is an array for them;
        the last index and total."""
        do = self.do
        first = do.load(array.kind, array.start)
        if out is not None:
            do.store(first, out.start)
        end = do.constant("i", array.size)

        def body(carries: list[Value]) -> list[Value]:
            k, total = carries
            total = join(total, do.load(array.kind, array.start, k))
            if out is not None:
                do.store(total, out.start, k)
            return [do.do("add", "i", k, do.constant("i", 1)), total]

        start = [do.constant("i", 1), first]
        return do.loop(start, lambda carries: do.do("ilt", "b", carries[0], end), body)

    def _reduce_sum(self, equation: core.JaxprEqn, array: Array) -> list[Array]:
        return self._reduced(equation, array, "add")

    def _reduce_prod(self, equation: core.JaxprEqn, array: Array) -> list[Array]:
        return self._reduced(equation, array, "mul")

    def _reduce_max(self, equation: core.JaxprEqn, array: Array) -> list[Array]:
        return self._reduced(equation, array, "max")

    def _reduce_min(self, equation: core.JaxprEqn, array: Array) -> list[Array]:
        return self._reduced(equation, array, "min")

    def _reduce_or(self, equation: core.JaxprEqn, array: Array) -> list[Array]:
        return self._reduced(equation, array, "or")

    def _reduce_and(self, equation: core.JaxprEqn, array: Array) -> list[Array]:
        return self._reduced(equation, array, "and")

    def _cumulated(self, equation: core.JaxprEqn, array: Array, name: str) -> list[Array]:
        aval, kind = equation.invars[0].aval, kind_of(equation.invars[0].aval)
        if len(aval.shape) != 1 or equation.params["reverse"]:
            raise UnsupportedPrimitiveError(f"{equation.primitive.name} of several axes")

        def join(a: Value, b: Value) -> Value:
            return RULES[name](self.do, kind, {}, a, b)

        if isinstance(array, InMemory):
            out = InMemory(self.do.allocate(array.size), array.shape, kind, True)
            self._scan_memory(array, join, out)
            return [out]
        values = self.values(array)
        for k in range(1, len(values)):
            values[k] = join(values[k - 1], values[k])
        return [self._array(values, tuple(aval.shape))]

    def _cumsum(self, equation: core.JaxprEqn, array: Array) -> list[Array]:
        return self._cumulated(equation, array, "add")

    def _cumprod(self, equation: core.JaxprEqn, array: Array) -> list[Array]:
        return self._cumulated(equation, array, "mul")

    def _cummax(self, equation: core.JaxprEqn, array: Array) -> list[Array]:
        return self._cumulated(equation, array, "max")

    def _cummin(self, equation: core.JaxprEqn, array: Array) -> list[Array]:
        return self._cumulated(equation, array, "min")

    def _extreme_place(self, equation: core.JaxprEqn, array: Array, compare: str) -> list[Array]:
        aval, (axis,) = equation.invars[0].aval, equation.params["axes"]
        out, do = equation.outvars[0].aval, self.do
        if isinstance(array, InMemory):
            raise UnsupportedPrimitiveError(f"{equation.primitive.name} of large arrays")
        values = np.moveaxis(np.array(self.values(array)).reshape(aval.shape), axis, -1)
        found = []
        for row in values.reshape(-1, aval.shape[axis]).tolist():
            best, place = row[0], do.constant(kind_of(out), 0)
            for k, value in enumerate(row[1:], 1):
                better = RULES[compare](do, "b", {}, value, best)
                if kind_of(aval) == "f":
                    is_nan = do.do("is_nan_either", "b", value, value)
                    better = do.do("or", "b", better, is_nan)
                    known = do.do("is_nan_either", "b", best, best)
                    better = do.do("and", "b", better, do.do("not", "b", known))
                best = do.do("select", kind_of(aval), better, value, best)
                place = do.do("select", kind_of(out), better, do.constant(kind_of(out), k), place)
            found.append(place)
        return [self._array(found, tuple(out.shape))]

    def _argmax(self, equation: core.JaxprEqn, array: Array) -> list[Array]:
        return self._extreme_place(equation, array, "gt")

    def _argmin(self, equation: core.JaxprEqn, array: Array) -> list[Array]:
        return self._extreme_place(equation, array, "lt")

    def _dot_general(self, equation: core.JaxprEqn, first: Array, second: Array) -> list[Array]:
        (left, right), (left_batch, right_batch) = equation.params["dimension_numbers"]
        if isinstance(first, InMemory) or isinstance(second, InMemory):
            raise UnsupportedPrimitiveError("dot_general of large arrays")
        out = equation.outvars[0].aval
        kind = kind_of(out)

        def rows(array: Array, number: int, batch: Sequence[int], along: Sequence[int]) -> list:
            shape = equation.invars[number].aval.shape
            values = np.array(self.values(array)).reshape(shape)
            rest = [k for k in range(len(shape)) if k not in (*batch, *along)]
            count = int(np.prod([shape[k] for k in batch], dtype=int))
            length = int(np.prod([shape[k] for k in along], dtype=int))
            return values.transpose([*batch, *rest, *along]).reshape(count, -1, length).tolist()

        add, multiply = RULES["add"], RULES["mul"]
        found = []
        left_rows, right_rows = (
            rows(first, 0, left_batch, left),
            rows(second, 1, right_batch, right),
        )
        for lefts, rights in zip(left_rows, right_rows, strict=True):
            for a in lefts:
                for b in rights:
                    terms = [multiply(self.do, kind, {}, x, y) for x, y in zip(a, b, strict=True)]
                    total = terms[0]
                    for term in terms[1:]:
                        total = add(self.do, kind, {}, total, term)
                    found.append(total)
        return [self._array(found, tuple(out.shape))]

    # Branches and loops.

    def _flattened(self, arrays: Sequence[Array]) -> list[Value]:
        """The values that arrays outside of memory consist of."""
        flat: list[Value] = []
        for array in arrays:
            if isinstance(array, Packed):
                flat.append(array.value)
            elif not isinstance(array, InMemory):
                flat += self.values(array)
        return flat

    def _restored(self, values: Sequence[Value], like: Sequence[Array]) -> list[Array]:
        """Arrays of the form of others, with other values."""
        remaining = iter(values)
        found: list[Array] = []
        for array in like:
            if isinstance(array, InMemory):
                found.append(array)
            elif isinstance(array, Packed):
                found.append(Packed(next(remaining)))
            elif isinstance(array, int):
                found.append(next(remaining))
            else:
                found.append(
                    np.array([next(remaining) for _ in range(array.size)], dtype=np.int64).reshape(
                        array.shape
                    )
                )
        return found

    def _cond(self, equation: core.JaxprEqn, which: Array, *arguments: Array) -> list[Array]:
        branches = equation.params["branches"]
        assert isinstance(which, int)
        number = self.do.number(which)
        if number is not None:
            chosen = branches[min(max(int(number), 0), len(branches) - 1)]
            return self.run(chosen.jaxpr, self._consts(chosen), arguments)
        if len(branches) != 2:
            raise UnsupportedPrimitiveError("switch between more than two branches")
        if self.do.kinds[which] != "b":
            which = self.do.do("igt", "b", which, elementwise.like(self.do, which, 0))
        no, yes = branches
        in_memory = any(
            int(np.prod(v.aval.shape, dtype=int)) > LARGEST_TAKEN_APART for v in equation.outvars
        )
        sizes = [count_equations(branch.jaxpr) for branch in branches]
        if not in_memory and max(sizes) <= LONGEST_CHOICE:
            both = [self.run(b.jaxpr, self._consts(b), arguments) for b in branches]
            return self._chosen(which, both[1], both[0])
        if self.do.width > 1:
            opposite = self.do.do("not", "b", which)
            found = self._if_any(which, yes, arguments, sizes[1], in_memory)
            others = self._if_any(opposite, no, arguments, sizes[0], in_memory)
            return self._chosen(which, found, others)
        return self._branch(which, yes, no, arguments)

    def _chosen(self, which: Value, yes: list[Array], no: list[Array]) -> list[Array]:
        for new, old in zip(yes, no, strict=True):
            if isinstance(new, InMemory) and isinstance(old, InMemory) and new.start != old.start:
                raise UnsupportedPrimitiveError("branches that give different arrays, in lanes")
        found = []
        for a, b in zip(self._flattened(yes), self._flattened(no), strict=True):
            kind = self.do.kinds[a]
            condition = which
            if kind.endswith("p"):
                condition = self.do.do("splat", "bp", which)
            found.append(self.do.do("select", kind, condition, a, b))
        return self._restored(found, yes)

    def _if_any(
        self,
        condition: Value,
        branch: core.ClosedJaxpr,
        arguments: Sequence[Array],
        size: int,
        in_memory: bool,
    ) -> list[Array]:
        """The results of a branch, which is left out where the condition holds in no lane; it
        writes to memory in the lanes in which it holds."""
        if size <= LONGEST_CHOICE and not in_memory:
            return self.run(branch.jaxpr, self._consts(branch), arguments)
        kept: list[Array] = []

        def compute() -> list[Value]:
            own = [replace(a) if isinstance(a, InMemory) else a for a in arguments]
            with self.do.masked(condition):
                kept[:] = self.run(branch.jaxpr, self._consts(branch), own)
            return self._flattened(kept)

        def leave_out() -> list[Value]:
            return [self.do.constant(self.do.kinds[v], 0) for v in self._flattened(kept)]

        return self._restored(self.do.branch(condition, compute, leave_out), kept)

    def _branch(
        self, which: Value, yes: core.ClosedJaxpr, no: core.ClosedJaxpr, arguments: Sequence[Array]
    ) -> list[Array]:
        results: dict[str, list[Array]] = {}

        def build(name: str, branch: core.ClosedJaxpr) -> Callable[[], list[Value]]:
            def compute() -> list[Value]:
                own = [replace(a) if isinstance(a, InMemory) else a for a in arguments]
                found = self.run(branch.jaxpr, self._consts(branch), own)
                if results:
                    pairs = zip(found, results["yes"], strict=True)
                    for new, old in pairs:
                        if isinstance(new, InMemory) and isinstance(old, InMemory):
                            self._agree(new, old)
                results[name] = found
                return self._flattened(found)

            return compute

        outs = self.do.branch(which, build("yes", yes), build("no", no))
        return self._restored(outs, results["yes"])

    def _agree(self, new: InMemory, old: InMemory) -> None:
        """Have the second branch leave an array where the first one does."""
        if new.start != old.start:
            if not old.owned:
                raise UnsupportedPrimitiveError("branches that give different arrays")
            self.copied(new, old.start)

    def _while(self, equation: core.JaxprEqn, *arguments: Array) -> list[Array]:
        parameters = equation.params
        head, body = parameters["cond_jaxpr"], parameters["body_jaxpr"]
        outside = parameters["cond_nconsts"]
        inside = outside + parameters["body_nconsts"]
        head_consts = [self.borrowed(a) for a in arguments[:outside]]
        body_consts = [self.borrowed(a) for a in arguments[outside:inside]]

        def holds(carries: list[Array]) -> Value:
            borrowed = [self.borrowed(a) for a in carries]
            (found,) = self.run(head.jaxpr, self._consts(head), [*head_consts, *borrowed])
            assert isinstance(found, int)
            return found

        def go(carries: list[Array]) -> list[Array]:
            return self.run(body.jaxpr, self._consts(body), [*body_consts, *carries])

        return self.loop(list(arguments[inside:]), holds, go)

    def borrowed(self, array: Array) -> Array:
        """The array, which must not be overwritten."""
        return replace(array, owned=False) if isinstance(array, InMemory) else array

    def loop(
        self,
        first: list[Array],
        holds: Callable[[list[Array]], Value],
        go: Callable[[list[Array]], list[Array]],
        uniform: bool = False,
    ) -> list[Array]:
        """A loop over arrays; those in memory stay at one place."""
        first = [self._own(a) if isinstance(a, InMemory) else a for a in first]
        do = self.do
        last: list[Value] = []

        def arrays(values: list[Value]) -> list[Array]:
            found = self._restored(values, first)
            return [replace(a, owned=True) if isinstance(a, InMemory) else a for a in found]

        def condition(values: list[Value]) -> Value:
            last[:] = [holds(arrays(values))]
            return last[0]

        def body(values: list[Value]) -> list[Value]:
            found = go(arrays(values))
            self._settle(first, found)
            following = self._flattened(
                [
                    f if isinstance(f, InMemory) else self._like(f, a)
                    for f, a in zip(found, first, strict=True)
                ]
            )
            if do.width == 1 or uniform:
                return following
            # Lanes for which the condition does not hold any more stay as they are.
            goes = holds(arrays(values))
            pairs = zip(following, values, strict=True)
            return [do.do("select", do.kinds[new], goes, new, old) for new, old in pairs]

        if do.width > 1 and not uniform and any(isinstance(a, InMemory) for a in first):
            raise UnsupportedPrimitiveError("loops over large arrays in lanes")
        return arrays(do.loop(self._flattened(first), condition, body))

    def _like(self, array: Array, other: Array) -> Array:
        """An array in the form of another one of the same shape."""
        if isinstance(other, Packed) and not isinstance(array, Packed):
            return Packed(self._vector(array))
        return array

    def _own(self, memory: InMemory) -> InMemory:
        return memory if memory.owned else self.copied(memory)

    def _settle(self, places: Sequence[Array], found: Sequence[Array]) -> None:
        """Move arrays in memory to where the next turn of a loop expects them."""
        moves = [
            (new, old)
            for new, old in zip(found, places, strict=True)
            if isinstance(new, InMemory) and isinstance(old, InMemory) and new.start != old.start
        ]
        taken = {old.start for old in places if isinstance(old, InMemory)}
        moves = [(self.copied(new) if new.start in taken else new, old) for new, old in moves]
        for new, old in moves:
            self.copied(new, old.start)

    def _scan(self, equation: core.JaxprEqn, *arguments: Array) -> list[Array]:
        parameters, do = equation.params, self.do
        constants, carried = parameters["num_consts"], parameters["num_carry"]
        length, closed = parameters["length"], parameters["jaxpr"]
        consts = [self.borrowed(a) for a in arguments[:constants]]
        first = list(arguments[constants : constants + carried])
        avals = [v.aval for v in equation.invars[constants + carried :]]
        rows = [
            self.borrowed(self.in_memory(a, tuple(aval.shape)))
            for a, aval in zip(arguments[constants + carried :], avals, strict=True)
        ]
        outs = [v.aval for v in equation.outvars[carried:]]
        made = [
            InMemory(
                do.allocate(int(np.prod(o.shape, dtype=int))), tuple(o.shape), kind_of(o), True
            )
            for o in outs
        ]
        one, end = do.constant("i", 1), do.constant("i", length - 1)

        def go(carries: list[Array]) -> list[Array]:
            k = carries[0]
            assert isinstance(k, int)
            row = do.do("sub", "i", end, k) if parameters["reverse"] else k
            items = [self._row(a, row) for a in rows if isinstance(a, InMemory)]
            found = self.run(closed.jaxpr, self._consts(closed), [*consts, *carries[1:], *items])
            for memory, array in zip(made, found[carried:], strict=True):
                self._put_row(memory, row, array)
            return [do.do("add", "i", k, one), *found[:carried]]

        def holds(carries: list[Array]) -> Value:
            assert isinstance(carries[0], int)
            do.mark_uniform(carries[0])
            return do.do("ile", "b", carries[0], end)

        results = self.loop([do.constant("i", 0), *first], holds, go, uniform=True)
        stacked = [m if m.size > LARGEST_TAKEN_APART else self._read(m) for m in made]
        return [*results[1:], *stacked]

    def _row(self, memory: InMemory, row: Value) -> Array:
        """A row of an array in memory."""
        shape = memory.shape[1:]
        size = int(np.prod(shape, dtype=int))
        first = self.do.do("mul", "i", row, self.do.constant("i", size))
        if size <= LARGEST_TAKEN_APART:
            return self._array(self._at(memory, first, range(size)), shape)
        out = InMemory(self.do.allocate(size), shape, memory.kind, True)

        def visit(k: Value) -> None:
            place = self.do.do("add", "i", first, k)
            self.do.store(self.do.load(memory.kind, memory.start, place), out.start, k)

        self.do.repeat(size, visit)
        return out

    def _put_row(self, memory: InMemory, row: Value, array: Array) -> None:
        size = int(np.prod(memory.shape[1:], dtype=int))
        first = self.do.do("mul", "i", row, self.do.constant("i", size))
        if not isinstance(array, InMemory):
            for k, value in enumerate(self.values(array)):
                self.do.store(value, memory.start + k, first)
            return

        def visit(k: Value) -> None:
            place = self.do.do("add", "i", first, k)
            self.do.store(self.do.load(array.kind, array.start, k), memory.start, place)

        self.do.repeat(size, visit)


def _unsigned(rule: Rule) -> Rule:
    """A rule whose result is cut to 32 bits."""

    def cut(do: Operations, kind: str, parameters: Parameters, *arguments: Value) -> Value:
        value = rule(do, kind, parameters, *arguments)
        return do.do("and", kind, value, elementwise.like(do, value, (1 << 32) - 1))

    return cut
