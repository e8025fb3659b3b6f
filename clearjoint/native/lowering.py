"""Lower jaxprs to operations on scalars.

Calls of inner jaxprs are inlined, except for large ones that are called repeatedly: these become
functions of machine code. Arrays are kept in one of four forms (`Array`):

- a scalar is one value;
- a small array is a NumPy array of values, one for each element, so that slices and concatenations
  need no operation;
- an array with one element for each tangent is one vector (`Packed`);
- an array of more than `LARGEST_UNROLLED` elements is in memory (`InMemory`) and is processed by
  loops. It is updated in place where nothing reads its former content.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jax.core import ShapedArray
from jax.extend import core, source_info_util
from numpy.typing import ArrayLike

from . import elementwise
from .elementwise import RULES, Parameters, Rule
from .operations import KINDS, Operations, Value

LARGEST_UNROLLED = 48
"""Largest number of elements of an array whose elements are separate values."""
LONGEST_PACKED = 16
"""Largest number of tangents that are packed into a vector."""
FEWEST_PACKED = 60
"""Number of operations on arrays of one length from which on these are packed."""
LONGEST_CHOICE = 24
"""Number of equations up to which both branches of a condition are computed, to select from."""
SMALLEST_FUNCTION = 1000
"""Number of equations from which on a jaxpr that is called repeatedly becomes a function."""
FEWEST_CALLS = 3
"""Number of calls from which on a jaxpr becomes a function."""
Atom = core.Var | core.Literal
"""A variable or a number in a jaxpr."""
_CALLS = {
    "jit": "jaxpr",
    "pjit": "jaxpr",
    "closed_call": "call_jaxpr",
    "core_call": "call_jaxpr",
    "eval_jaxpr": "call_jaxpr",
    "checkpoint": "jaxpr",
    "remat2": "jaxpr",
    "custom_jvp_call": "call_jaxpr",
    "custom_vjp_call": "call_jaxpr",
    "custom_vjp_call_jaxpr": "fun_jaxpr",
}
"""Primitives that call a jaxpr, and the parameter that holds it."""
# Hashing a dtype takes a twentieth of the time of its name.
_KINDS = {np.dtype(name): kind for name, kind in KINDS.items()}
_UNSIGNED = np.dtype("uint32")


class UnsupportedPrimitiveError(NotImplementedError):
    """A primitive, or a use of one, that has no rule here, and the source line that called it."""

    def __init__(self, what: str, location: str = ""):
        super().__init__(f"{what}, in {location}" if location else what)
        self.location = location


@dataclass(frozen=True)
class Packed:
    """An array with one element for each tangent, as one vector."""

    value: Value


@dataclass
class InMemory:
    """An array in memory.

    - `start`: first cell.
    - `shape`: shape of the array.
    - `kind`: kind of its elements, see `.operations`.
    - `owned`: whether its cells may be overwritten, because nothing else reads its content.
    """

    start: int
    shape: tuple[int, ...]
    kind: str
    owned: bool = False

    @property
    def size(self) -> int:
        """The number of elements."""
        return math.prod(self.shape)


Array = Value | Packed | np.ndarray | InMemory
"""A scalar, a vector of tangents, a NumPy array of values, or an array in memory."""
EquationRule = Callable[..., Sequence[Array]]
"""Lowers an equation: takes the lowering, the equation and its arguments, returns the results."""


def aval_of(atom: Atom) -> ShapedArray:
    """Return the shape and dtype of a variable or a number in a jaxpr."""
    if not isinstance(atom.aval, ShapedArray):
        raise UnsupportedPrimitiveError(f"values of type {type(atom.aval).__name__}")
    return atom.aval


def kind_of(array: ShapedArray | np.ndarray) -> str:
    """Return the kind (see `.operations`) of the elements of an array."""
    kind = _KINDS.get(array.dtype)
    if kind is None:
        raise UnsupportedPrimitiveError(f"arrays of {array.dtype}")
    return kind


def element_indices(aval: ShapedArray) -> np.ndarray:
    """Return an array of the given shape that holds the flat index of each element."""
    return np.arange(aval.size).reshape(aval.shape)


def is_contiguous(indices: np.ndarray) -> bool:
    """Return whether flat indices rise by one from each to the next."""
    return indices.size > 0 and np.array_equal(
        indices, np.arange(indices[0], indices[0] + indices.size)
    )


@dataclass(frozen=True)
class Region:
    """Cells of an array in memory: the first one, and shape, dtype and size of the array."""

    start: int
    shape: tuple[int, ...]
    dtype: np.dtype
    size: int

    @staticmethod
    def of(aval: ShapedArray, start: int) -> "Region":
        """Return the region of an array with the given shape and dtype."""
        kind_of(aval)
        return Region(start, tuple(aval.shape), np.dtype(aval.dtype), aval.size)

    @property
    def end(self) -> int:
        """The first cell after the region."""
        return self.start + self.size


def inner_jaxprs(equation: core.JaxprEqn) -> Iterator[core.Jaxpr]:
    """Iterate over the jaxprs among an equation's parameters."""
    for parameter in equation.params.values():
        items = parameter if isinstance(parameter, tuple | list) else [parameter]
        for item in items:
            jaxpr = getattr(item, "jaxpr", item)
            if hasattr(jaxpr, "eqns"):
                yield jaxpr


def count_equations(jaxpr: core.Jaxpr) -> int:
    """Count the equations of a jaxpr and of its inner jaxprs."""
    return sum(1 + sum(map(count_equations, inner_jaxprs(e))) for e in jaxpr.eqns)


def tangents_of(jaxpr: core.Jaxpr) -> int:
    """Return the number of tangents: the length of most rank-one arrays that are added or
    multiplied, or 0 if there are few."""
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


@dataclass
class RepeatedCall:
    """Equations that call the same jaxpr.

    - `shared`: for each argument, whether it is the same in all calls.
    - `function`: the function for the jaxpr; ``None`` until the first call has been lowered.
    """

    shared: list[bool]
    function: "Function | None" = None


@dataclass(frozen=True)
class Function:
    """A function of machine code, which exchanges values with its callers by cells of memory.

    - `number`: identifies the function for `Operations.call`.
    - `parameters`: first cell of each value that differs between calls. The caller writes it there
      and the function reads it.
    - `results`: the arrays that the function returns, of values as named inside the function.
    - `cells`: for each value in `results` that the function computes, the first cell to which it
      writes the value and from which the caller reads it. The other values in `results` come from
      outside and are the same in all calls.
    """

    number: int
    parameters: list[int]
    results: list[Array]
    cells: dict[Value, int]


def repeated_calls(jaxpr: core.Jaxpr) -> dict[int, RepeatedCall]:
    """Return the calls of large jaxprs that `jaxpr` calls several times, by the id of the equation
    that makes the call."""
    groups: dict[int, list[core.JaxprEqn]] = {}
    for equation in jaxpr.eqns:
        if equation.primitive.name in ("jit", "pjit"):
            groups.setdefault(id(equation.params["jaxpr"].jaxpr), []).append(equation)
    calls: dict[int, RepeatedCall] = {}
    for equations in groups.values():
        if len(equations) < FEWEST_CALLS:
            continue
        closed = equations[0].params["jaxpr"]
        avals = [v.aval for v in equations[0].outvars]
        small = all(getattr(aval, "size", 0) <= LARGEST_UNROLLED for aval in avals)
        if small and count_equations(closed.jaxpr) >= SMALLEST_FUNCTION:
            columns = zip(*(equation.invars for equation in equations), strict=True)
            group = RepeatedCall([_are_equal(column) for column in columns])
            calls.update((id(equation), group) for equation in equations)
    return calls


def _are_equal(atoms: Sequence[Atom]) -> bool:
    first = atoms[0]
    if not isinstance(first, core.Literal):
        return all(atom is first for atom in atoms)
    return all(isinstance(a, core.Literal) and np.array_equal(a.val, first.val) for a in atoms)


class Lowering:
    """Adds the equations of jaxprs to the operations of a program.

    - `ops`: the operations of the program.
    - `constants`: arrays that must be in memory before the program starts, by their first cells.

    **Arguments:** `ops`: the operations to add to; `rules`: rules for the primitives that do not
    work element by element, by the names of the primitives.
    """

    def __init__(self, ops: Operations, rules: Mapping[str, EquationRule]):
        self.ops, self._rules = ops, rules
        self.constants: dict[int, np.ndarray] = {}
        self._repeated: dict[int, RepeatedCall] = {}

    # Forms of arrays.

    def argument(self, aval: ShapedArray, start: int) -> Array:
        """Return the argument of the program that is in memory from the cell `start` on; small
        arrays are read from there."""
        memory = InMemory(start, tuple(aval.shape), kind_of(aval), owned=True)
        return memory if memory.size > LARGEST_UNROLLED else self.read(memory)

    def constant(self, array: ArrayLike) -> Array:
        """Return an array whose numbers are known, in one of the four forms."""
        array = np.asarray(array)
        kind = kind_of(array)
        if array.size > LARGEST_UNROLLED:
            start = self.ops.allocate(array.size)
            self.constants[start] = array
            return InMemory(start, array.shape, kind)
        values = [self.ops.constant(kind, x) for x in array.ravel().tolist()]
        return self.array(values, array.shape)

    def array(self, values: Sequence[Value], shape: tuple[int, ...]) -> Array:
        """Return an array of values, given in row-major order."""
        if shape == ():
            return values[0]
        if self.is_packed(shape):
            return Packed(self.ops.pack(list(values)))
        return np.array(values, dtype=np.int64).reshape(shape)

    def new_array(self, shape: tuple[int, ...], kind: str) -> InMemory:
        """Allocate an array in memory."""
        return InMemory(self.ops.allocate(math.prod(shape)), shape, kind, owned=True)

    def is_packed(self, shape: tuple[int, ...]) -> bool:
        """Return whether arrays of a shape are kept as vectors of tangents."""
        return self.ops.packed > 0 and shape == (self.ops.packed_length,)

    def values(self, array: Array) -> list[Value]:
        """Return the elements of an array in row-major order."""
        if isinstance(array, int):
            return [array]
        if isinstance(array, Packed):
            return [self.ops.element(array.value, k) for k in range(self.ops.packed_length)]
        if isinstance(array, InMemory):
            return [self.ops.load(array.kind, array.start + k) for k in range(array.size)]
        return array.ravel().tolist()

    def vector(self, array: Array) -> Value:
        """Return an array of tangents, or a scalar repeated for all tangents, as a vector."""
        if isinstance(array, Packed):
            return array.value
        values = self.values(array)
        return self.ops.pack(values * (self.ops.packed_length if len(values) == 1 else 1))

    def read(self, memory: InMemory) -> Array:
        """Read an array from memory."""
        return self.array(self.values(memory), memory.shape)

    def write(self, array: Array, start: int, index: Value | None = None) -> None:
        """Write an array to the cells from `start` on, or from `start` + `index` on."""
        ops = self.ops
        if not isinstance(array, InMemory):
            for k, value in enumerate(self.values(array)):
                ops.store(value, start + k, index)
            return

        def visit(k: Value) -> None:
            target = k if index is None else ops.emit("add", "i", index, k)
            ops.store(ops.load(array.kind, array.start, k), start, target)

        ops.repeat(array.size, visit)

    def in_memory(self, array: Array, shape: tuple[int, ...]) -> InMemory:
        """Return the array in memory; write it to new cells unless it is in memory already."""
        if isinstance(array, InMemory):
            return array
        memory = self.new_array(shape, self.ops.kinds[self.values(array)[0]])
        self.write(array, memory.start)
        return memory

    def stored(self, array: Array, aval: ShapedArray) -> Region:
        """Return the region of an array; write it to new cells unless it is in memory already."""
        if isinstance(array, InMemory):
            return Region.of(aval, array.start)
        region = Region.of(aval, self.ops.allocate(aval.size))
        self.write(array, region.start)
        return region

    def copied(self, memory: InMemory) -> InMemory:
        """Copy an array in memory to new cells."""
        copy = self.new_array(memory.shape, memory.kind)
        self.write(memory, copy.start)
        return copy

    def flatten(self, arrays: Sequence[Array]) -> list[Value]:
        """Return all values of arrays, except for those in memory."""
        flat: list[Value] = []
        for array in arrays:
            if isinstance(array, Packed):
                flat.append(array.value)
            elif not isinstance(array, InMemory):
                flat += self.values(array)
        return flat

    def unflatten(self, values: Sequence[Value], like: Sequence[Array]) -> list[Array]:
        """Return arrays of the forms of `like` with other values: the inverse of `flatten`."""
        remaining = iter(values)
        arrays: list[Array] = []
        for array in like:
            if isinstance(array, InMemory):
                arrays.append(array)
            elif isinstance(array, Packed):
                arrays.append(Packed(next(remaining)))
            elif isinstance(array, int):
                arrays.append(next(remaining))
            else:
                elements = [next(remaining) for _ in range(array.size)]
                arrays.append(np.array(elements, dtype=np.int64).reshape(array.shape))
        return arrays

    def take(self, array: Array, indices: np.ndarray) -> Array:
        """Return the elements of an array at known flat indices, in the shape of `indices`."""
        shape, flat = indices.shape, indices.ravel()
        if isinstance(array, InMemory):
            if is_contiguous(flat):
                part = InMemory(array.start + int(flat[0]), shape, array.kind, array.owned)
                if flat.size <= LARGEST_UNROLLED:
                    return self.read(part)
                # Other parts of the same array may be read later: only a view of the whole array
                # may be overwritten.
                return replace(part, owned=False) if flat.size < array.size else part
            if flat.size <= LARGEST_UNROLLED:
                values = [self.ops.load(array.kind, array.start + int(k)) for k in flat]
                return self.array(values, shape)
            return self._take_by_table(array, flat, shape)
        values = self.values(array)
        if flat.size > LARGEST_UNROLLED:
            if len(values) == 1:
                kind = self.ops.kinds[values[0]]
                return self._by_loop(lambda value: value, kind, shape, values)
            return self._take_by_table(self.in_memory(array, (len(values),)), flat, shape)
        return self.array([values[k] for k in flat], shape)

    def _take_by_table(
        self, array: InMemory, indices: np.ndarray, shape: tuple[int, ...]
    ) -> InMemory:
        """Take elements by a loop that reads their indices from a constant table."""
        start = self.ops.allocate(indices.size)
        self.constants[start] = indices
        table = InMemory(start, (indices.size,), "i")

        def load(index: Value) -> Value:
            return self.ops.load(array.kind, array.start, index)

        return self._by_loop(load, array.kind, shape, [table])

    def _by_loop(
        self,
        rule: Callable[..., Value],
        kind: str,
        shape: tuple[int, ...],
        arguments: Sequence[Array],
    ) -> InMemory:
        """Add a loop that applies a rule to each element of arrays in memory, and to scalars, and
        return the array of the results."""
        out = self.new_array(shape, kind)

        def visit(k: Value) -> None:
            values = [
                self.ops.load(a.kind, a.start, k) if isinstance(a, InMemory) else a
                for a in arguments
            ]
            if not all(isinstance(value, int) for value in values):
                raise UnsupportedPrimitiveError("arrays of different sizes")
            self.ops.store(rule(*values), out.start, k)

        self.ops.repeat(out.size, visit)
        return out

    # Equations.

    def inline(
        self, jaxpr: core.ClosedJaxpr | core.Jaxpr, arguments: Sequence[Array]
    ) -> list[Array]:
        """Add the equations of a jaxpr and return its results."""
        if isinstance(jaxpr, core.ClosedJaxpr):
            return self.inline_with(jaxpr.jaxpr, jaxpr.consts, arguments)
        return self.inline_with(jaxpr, (), arguments)

    def inline_with(
        self, jaxpr: core.Jaxpr, consts: Sequence[ArrayLike], arguments: Sequence[Array]
    ) -> list[Array]:
        """Add the equations of a jaxpr with the given constants and return its results.

        Owned arrays in memory among the arguments may be overwritten.
        """
        constants = [self.constant(const) for const in consts]
        self._repeated |= repeated_calls(jaxpr)
        known: dict[Atom, Array] = dict(zip(jaxpr.constvars, constants, strict=True))
        known |= dict(zip(jaxpr.invars, arguments, strict=True))
        last_reads: dict[Atom, int] = {}
        for number, equation in enumerate(jaxpr.eqns):
            for atom in equation.invars:
                if not isinstance(atom, core.Literal):
                    last_reads[atom] = number
        for atom in jaxpr.outvars:
            if not isinstance(atom, core.Literal):
                last_reads[atom] = len(jaxpr.eqns)
        for number, equation in enumerate(jaxpr.eqns):
            self._add_equation(equation, known, last_reads, number)
        return [self._atom(atom, known) for atom in jaxpr.outvars]

    def _atom(self, atom: Atom, known: dict[Atom, Array]) -> Array:
        if not isinstance(atom, core.Literal):
            return known[atom]
        if np.ndim(atom.val) == 0:
            kind = _KINDS.get(aval_of(atom).dtype)
            if kind is not None:
                return self.ops.constant(kind, atom.val)
        return self.constant(np.asarray(atom.val, dtype=aval_of(atom).dtype))

    def _add_equation(
        self,
        equation: core.JaxprEqn,
        known: dict[Atom, Array],
        last_reads: dict[Atom, int],
        number: int,
    ) -> None:
        """Lower the equation with the given number, add its results to `known`, and decide which
        arrays in memory may be overwritten."""
        arguments: list[Array] = []
        live: list[InMemory] = []
        for atom in equation.invars:
            array = self._atom(atom, known)
            if isinstance(array, InMemory):
                # A rule may overwrite an argument that no later equation reads. If the argument
                # occurs twice in this equation, writing for one would change the other.
                dies = last_reads[atom] == number and list(equation.invars).count(atom) == 1
                if not dies:
                    live.append(array)
                    array = replace(array, owned=False)
            arguments.append(array)
        try:
            outs = self._lower(equation, arguments)
        except UnsupportedPrimitiveError as error:
            if error.location:
                raise
            location = source_info_util.summarize(equation.source_info)
            raise UnsupportedPrimitiveError(str(error), location) from error
        if len(outs) == 1 and isinstance(outs[0], int):
            known[equation.outvars[0]] = outs[0]
            return
        # A result may be a view of an argument, or of the same cells as another result: then
        # neither of the two may be overwritten.
        starts = Counter(out.start for out in outs if isinstance(out, InMemory))
        for array in live:
            if array.start in starts:
                array.owned = False
        for variable, out in zip(equation.outvars, outs, strict=True):
            if isinstance(out, InMemory) and starts[out.start] > 1:
                out = replace(out, owned=False)
            known[variable] = out

    def _lower(self, equation: core.JaxprEqn, arguments: list[Array]) -> Sequence[Array]:
        name = equation.primitive.name
        if name in RULES:
            if len(equation.outvars) == 1:
                return [self._elementwise(equation, arguments)]
            return arguments  # `optimization_barrier` of several arrays
        if name in _CALLS:
            closed = equation.params[_CALLS[name]]
            repeated = self._repeated.get(id(equation))
            if repeated is not None:
                return self._call(repeated, closed, arguments)
            return self.inline(closed, arguments)
        rule = self._rules.get(name)
        if rule is None:
            raise UnsupportedPrimitiveError(name)
        return rule(self, equation, *arguments)

    def _call(
        self, repeated: RepeatedCall, closed: core.ClosedJaxpr, arguments: list[Array]
    ) -> list[Array]:
        """Call the function for a jaxpr, which the first call builds.

        LLVM takes more than proportionally long for long blocks, and a step of a run calls its
        rates once for each stage.
        """
        ops, pairs = self.ops, list(zip(arguments, repeated.shared, strict=True))
        varied = [array for array, shared in pairs if not shared]
        if any(isinstance(array, InMemory) for array in varied):
            return self.inline(closed, arguments)
        values = self.flatten(varied)
        if repeated.function is None:
            kinds = [ops.kinds[value] for value in values]
            parameters = [ops.allocate_for(kind) for kind in kinds]
            results: list[Array] = []
            cells: dict[Value, int] = {}

            def build() -> None:
                loaded = [ops.load(*row) for row in zip(kinds, parameters, strict=True)]
                remaining = iter(self.unflatten(loaded, varied))
                mixed = [array if shared else next(remaining) for array, shared in pairs]
                results[:] = self.inline(closed, mixed)
                # Values from outside of the function are the same for all calls.
                for value in self.flatten(results):
                    if value not in cells and ops.is_inside(value):
                        cells[value] = ops.pass_on(value)

            number = ops.function(build)
            repeated.function = Function(number, parameters, results, cells)
        function = repeated.function
        for value, cell in zip(values, function.parameters, strict=True):
            ops.pass_on(value, cell)
        ops.call(function.number)
        loaded = {v: ops.load(ops.kinds[v], cell) for v, cell in function.cells.items()}
        new = [loaded.get(value, value) for value in self.flatten(function.results)]
        return self.unflatten(new, function.results)

    def _elementwise(self, equation: core.JaxprEqn, arguments: list[Array]) -> Array:
        aval = aval_of(equation.outvars[0])
        kind, shape = kind_of(aval), tuple(aval.shape)
        rule, ops, parameters = RULES[equation.primitive.name], self.ops, equation.params
        if aval.dtype == _UNSIGNED:
            rule = _unsigned(rule)
        if shape != ():
            arguments = [
                self._repeat_axes(argument, aval_of(v), shape)
                for argument, v in zip(arguments, equation.invars, strict=True)
            ]
        try:
            if shape == ():
                return rule(ops, kind, parameters, *arguments)
            if aval.size > LARGEST_UNROLLED:
                return self._by_loop(
                    lambda *values: rule(ops, kind, parameters, *values), kind, shape, arguments
                )
            if self.is_packed(shape):
                vectors = [self.vector(argument) for argument in arguments]
                return Packed(rule(ops, f"{kind}p", parameters, *vectors))
            rows = [
                [argument] * aval.size if isinstance(argument, int) else self.values(argument)
                for argument in arguments
            ]
            values = [rule(ops, kind, parameters, *row) for row in zip(*rows, strict=True)]
        except NotImplementedError as error:
            raise UnsupportedPrimitiveError(
                f"{equation.primitive.name} ({error})" if error.args else equation.primitive.name
            ) from error
        return self.array(values, shape)

    def _repeat_axes(self, array: Array, aval: ShapedArray, shape: tuple[int, ...]) -> Array:
        """Return the array in `shape`, with axes of length one repeated; a scalar is unchanged."""
        if isinstance(array, int) or tuple(aval.shape) == shape:
            return array
        return self.take(array, np.broadcast_to(element_indices(aval), shape))


def _unsigned(rule: Rule) -> Rule:
    """Return the rule with results cut to 32 bits, since uint32 is computed in 64-bit integers."""

    def cut(ops: Operations, kind: str, parameters: Parameters, *arguments: Value) -> Value:
        value = rule(ops, kind, parameters, *arguments)
        return ops.emit("and", kind, value, elementwise.like(ops, value, (1 << 32) - 1))

    return cut
