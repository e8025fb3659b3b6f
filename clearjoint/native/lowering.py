"""From a jaxpr to operations on scalars.

Calls are inlined, and small arrays are taken apart: each element is a value of its own, so that
slices and concatenations cost nothing. An array of as many elements as there are tangents is kept
as one vector. Arrays of more than `LARGEST_TAKEN_APART` elements stay in memory and are worked on
by loops; a slice of them is written in place where nothing reads the older content any more.
"""

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
    "eval_jaxpr": "call_jaxpr",
    "checkpoint": "jaxpr",
    "remat2": "jaxpr",
    "custom_jvp_call": "call_jaxpr",
    "custom_vjp_call": "call_jaxpr",
    "custom_vjp_call_jaxpr": "fun_jaxpr",
}
"""Primitives that call a jaxpr, and the parameter which holds it."""
_KINDS = {np.dtype(name): kind for name, kind in KINDS.items()}
"""A dtype is looked up in a twentieth of the time that its name takes."""
_UNSIGNED = np.dtype("uint32")


SMALLEST_FUNCTION = 1000
FEWEST_CALLS = 3
"""Equations of a jaxpr, and calls of it in one place, from which on it becomes a function of
machine code: LLVM takes more than proportionally long for long blocks."""


class UnsupportedPrimitiveError(NotImplementedError):
    """A primitive, or a use of one, that has no rule here, and the line of code it comes from."""

    def __init__(self, what: str, place: str = ""):
        super().__init__(f"{what}, in {place}" if place else what)
        self.place = place


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


def aval_of(atom: Atom) -> ShapedArray:
    """The shape and dtype of a variable or a number in a jaxpr."""
    if not isinstance(atom.aval, ShapedArray):
        raise UnsupportedPrimitiveError(f"values of type {type(atom.aval).__name__}")
    return atom.aval


def kind_of(aval: ShapedArray) -> str:
    """The kind of the elements of an abstract array."""
    kind = _KINDS.get(aval.dtype)
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


@dataclass
class RepeatedCall:
    """Equations of one jaxpr that call another one.

    `same`: which of their arguments are the same for all; `function`: what they call, made for the
    first of them.
    """

    same: list[bool]
    function: "Function | None" = None


@dataclass(frozen=True)
class Function:
    """A function of machine code, and the cells of its arguments and of its results. Results that
    are the same for all calls are given as they are, without cells."""

    number: int
    parameters: list[int]
    results: list[Array]
    cells: dict[Value, int]


def repeated_calls(jaxpr: core.Jaxpr) -> dict[int, RepeatedCall]:
    """Calls of one large jaxpr, by the identities of their equations."""
    groups: dict[int, list[core.JaxprEqn]] = {}
    for equation in jaxpr.eqns:
        if equation.primitive.name in ("jit", "pjit"):
            groups.setdefault(id(equation.params["jaxpr"].jaxpr), []).append(equation)
    found: dict[int, RepeatedCall] = {}
    for equations in groups.values():
        if len(equations) < FEWEST_CALLS:
            continue
        closed = equations[0].params["jaxpr"]
        avals = [v.aval for v in equations[0].outvars]
        small = all(getattr(aval, "size", 0) <= LARGEST_TAKEN_APART for aval in avals)
        if small and count_equations(closed.jaxpr) >= SMALLEST_FUNCTION:
            columns = zip(*(equation.invars for equation in equations), strict=True)
            group = RepeatedCall([_is_one(column) for column in columns])
            found.update((id(equation), group) for equation in equations)
    return found


def _is_one(atoms: Sequence[Atom]) -> bool:
    first = atoms[0]
    if not isinstance(first, core.Literal):
        return all(atom is first for atom in atoms)
    return all(isinstance(a, core.Literal) and np.array_equal(a.val, first.val) for a in atoms)


class Lowering:
    """Adds the equations of jaxprs to operations.

    **Arguments:** `program`: what to add to; `rules`: by the names of primitives that do not work
    element by element (see `.primitives`).

    `constants`: content of memory that is there from the start, by its first cell.
    """

    def __init__(self, program: Operations, rules: "Mapping[str, EquationRule]"):
        self.do, self._rules = program, rules
        self.constants: dict[int, np.ndarray] = {}
        self._repeated: dict[int, RepeatedCall] = {}

    # Values.

    def given(self, aval: ShapedArray, start: int) -> Array:
        """An argument in memory; small ones are read at once."""
        kind, shape = kind_of(aval), tuple(aval.shape)
        memory = InMemory(start, shape, kind, owned=True)
        return memory if memory.size > LARGEST_TAKEN_APART else self.read(memory)

    def constant(self, array: ArrayLike) -> Array:
        """A known array."""
        array = np.asarray(array)
        kind = _KINDS.get(array.dtype)
        if kind is None:
            raise UnsupportedPrimitiveError(f"arrays of {array.dtype}")
        if array.size > LARGEST_TAKEN_APART:
            start = self.do.allocate(array.size)
            self.constants[start] = array
            return InMemory(start, array.shape, kind)
        values = [self.do.constant(kind, x) for x in array.ravel().tolist()]
        return self.array(values, array.shape)

    def array(self, values: Sequence[Value], shape: tuple[int, ...]) -> Array:
        """The array of so many values in order."""
        if shape == ():
            return values[0]
        if self.is_packed(shape):
            return Packed(self.do.pack(list(values)))
        return np.array(values, dtype=np.int64).reshape(shape)

    def is_packed(self, shape: tuple[int, ...]) -> bool:
        """Whether arrays of a shape are kept as vectors of tangents."""
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

    def read(self, memory: InMemory) -> Array:
        """The elements of an array in memory."""
        if self.is_packed(memory.shape):
            return Packed(self.do.pack(self.values(memory)))
        return self.array(self.values(memory), memory.shape)

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
        self._repeated |= repeated_calls(jaxpr)
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
            kind = _KINDS.get(aval_of(atom).dtype)
            if kind is not None:
                return self.do.constant(kind, atom.val)
        return self.constant(np.asarray(atom.val, dtype=aval_of(atom).dtype))

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
        try:
            outs = self._outs(equation, arguments)
        except UnsupportedPrimitiveError as error:
            if error.place:
                raise
            place = source_info_util.summarize(equation.source_info)
            raise UnsupportedPrimitiveError(str(error), place) from error
        if len(outs) == 1 and isinstance(outs[0], int):
            known[equation.outvars[0]] = outs[0]
            return
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
            repeated = self._repeated.get(id(equation))
            if repeated is not None:
                return self._call(repeated, closed, arguments)
            return self.run(getattr(closed, "jaxpr", closed), self.consts(closed), arguments)
        rule = self._rules.get(name)
        if rule is None:
            raise UnsupportedPrimitiveError(name)
        return rule(self, equation, *arguments)

    def _call(
        self, repeated: RepeatedCall, closed: core.ClosedJaxpr, arguments: list[Array]
    ) -> list[Array]:
        """The results of a jaxpr that is one function for several calls."""
        do, rows = self.do, list(zip(arguments, repeated.same, strict=True))
        own = [array for array, same in rows if not same]
        if any(isinstance(array, InMemory) for array in own):
            return self.run(closed.jaxpr, self.consts(closed), arguments)
        values = self.flattened(own)
        if repeated.function is None:
            kinds = [do.kinds[value] for value in values]
            parameters = [do.allocate_for(kind) for kind in kinds]
            results: list[Array] = []
            cells: dict[Value, int] = {}

            def build() -> None:
                loaded = [do.load(*row) for row in zip(kinds, parameters, strict=True)]
                given = iter(self.restored(loaded, own))
                mixed = [array if same else next(given) for array, same in rows]
                results[:] = self.run(closed.jaxpr, self.consts(closed), mixed)
                for value in self.flattened(results):
                    if value not in cells and do.is_inside(value):
                        cells[value] = do.pass_on(value)

            number = do.function(build)
            repeated.function = Function(number, parameters, results, cells)
        function = repeated.function
        for value, cell in zip(values, function.parameters, strict=True):
            do.pass_on(value, cell)
        do.call(function.number)
        loaded = {v: do.load(do.kinds[v], cell) for v, cell in function.cells.items()}
        found = [loaded.get(value, value) for value in self.flattened(function.results)]
        return self.restored(found, function.results)

    def flattened(self, arrays: Sequence[Array]) -> list[Value]:
        """The values that arrays outside of memory consist of."""
        flat: list[Value] = []
        for array in arrays:
            if isinstance(array, Packed):
                flat.append(array.value)
            elif not isinstance(array, InMemory):
                flat += self.values(array)
        return flat

    def restored(self, values: Sequence[Value], like: Sequence[Array]) -> list[Array]:
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
                own = [next(remaining) for _ in range(array.size)]
                found.append(np.array(own, dtype=np.int64).reshape(array.shape))
        return found

    def consts(self, closed: core.ClosedJaxpr) -> list[Array]:
        """The constants of a jaxpr."""
        return [self.constant(const) for const in getattr(closed, "consts", ())]

    def _elementwise(self, equation: core.JaxprEqn, arguments: list[Array]) -> Array:
        aval = aval_of(equation.outvars[0])
        kind, shape = kind_of(aval), tuple(aval.shape)
        rule, do, parameters = RULES[equation.primitive.name], self.do, equation.params
        if aval.dtype == _UNSIGNED:
            rule = _unsigned(rule)
        if shape != ():
            arguments = [
                self._spread(argument, tuple(aval_of(v).shape), shape)
                for argument, v in zip(arguments, equation.invars, strict=True)
            ]
        try:
            if shape == ():
                return rule(do, kind, parameters, *arguments)
            if int(np.prod(shape)) > LARGEST_TAKEN_APART:
                return self.by_loop(
                    lambda *values: rule(do, kind, parameters, *values), kind, shape, arguments
                )
            if self.is_packed(shape):
                vectors = [self.vector(argument) for argument in arguments]
                return Packed(rule(do, f"{kind}p", parameters, *vectors))
            rows = [self._broadcast(argument, shape) for argument in arguments]
            values = [rule(do, kind, parameters, *row) for row in zip(*rows, strict=True)]
        except NotImplementedError as error:
            raise UnsupportedPrimitiveError(
                f"{equation.primitive.name} ({error})" if error.args else equation.primitive.name
            ) from error
        return self.array(values, shape)

    def _spread(self, array: Array, shape: tuple[int, ...], wanted: tuple[int, ...]) -> Array:
        """An array, unless it is a scalar, with axes of length one repeated as another shape has
        them."""
        if isinstance(array, int) or shape == wanted:
            return array
        size = int(np.prod(shape, dtype=int))
        places = np.broadcast_to(np.arange(size).reshape(shape), wanted)
        return self.at_places(array, places)

    def vector(self, array: Array) -> Value:
        """The vector of an array of tangents, or of a scalar."""
        if isinstance(array, Packed):
            return array.value
        values = self.values(array)
        return self.do.pack(values * (self.do.packed_length if len(values) == 1 else 1))

    def _broadcast(self, array: Array, shape: tuple[int, ...]) -> list[Value]:
        if isinstance(array, int):
            return [array] * int(np.prod(shape))
        return self.values(array)

    def by_loop(
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

    def moved(self, equation: core.JaxprEqn, array: Array, places: np.ndarray) -> Array:
        """The result of an equation, whose elements are at `places` among those of an array."""
        return self.at_places(array, places.reshape(aval_of(equation.outvars[0]).shape))

    def at_places(self, array: Array, places: np.ndarray) -> Array:
        """The array whose elements are at some places among those of another."""
        shape, flat = places.shape, places.ravel()
        if isinstance(array, InMemory):
            if flat.size and np.array_equal(flat, np.arange(flat[0], flat[0] + flat.size)):
                moved = InMemory(array.start + int(flat[0]), shape, array.kind, array.owned)
                if flat.size <= LARGEST_TAKEN_APART:
                    return self.read(moved)
                if flat.size < array.size:
                    moved = replace(moved, owned=False)
                return moved
            if flat.size <= LARGEST_TAKEN_APART:
                values = [self.do.load(array.kind, array.start + int(k)) for k in flat]
                return self.array(values, shape)
            return self.by_table(array, flat, shape)
        values = self.values(array)
        if flat.size > LARGEST_TAKEN_APART:
            if len(values) == 1:
                kind = self.do.kinds[values[0]]
                return self.by_loop(lambda value: value, kind, shape, values)
            source = self.in_memory(array, (len(values),))
            return self.by_table(source, flat, shape)
        return self.array([values[k] for k in flat], shape)

    def by_table(self, array: InMemory, places: np.ndarray, shape: tuple[int, ...]) -> InMemory:
        """The elements of an array in memory at many places, which a table lists."""
        start = self.do.allocate(places.size)
        self.constants[start] = places
        table = InMemory(start, (places.size,), "i")

        def at(place: Value) -> Value:
            return self.do.load(array.kind, array.start, place)

        return self.by_loop(at, array.kind, shape, [table])


def _unsigned(rule: Rule) -> Rule:
    """A rule whose result is cut to 32 bits."""

    def cut(do: Operations, kind: str, parameters: Parameters, *arguments: Value) -> Value:
        value = rule(do, kind, parameters, *arguments)
        return do.do("and", kind, value, elementwise.like(do, value, (1 << 32) - 1))

    return cut


EquationRule = Callable[..., Sequence[Array]]
"""Gives the results of an equation, from the lowering, the equation and its arguments."""
