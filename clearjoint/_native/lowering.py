"""Lower jaxprs to operations on scalars.

The equations of inner jaxprs are added in the place of their calls. Only large jaxprs that are
called repeatedly become functions of machine code. An array has one of four forms (`Array`):

- a scalar is one value of the program;
- a small array is a NumPy array of values, one for each element, so that slices and concatenations
  need no operation;
- an array with one element for each tangent (derivative by a parameter) is one vector (`Packed`);
- an array of more than `LARGEST_UNROLLED` elements is in memory (`InMemory`) and is processed by
  loops. It is updated in place if nothing reads its former content.
"""

import math
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jax.core import ShapedArray
from jax.extend import core, source_info_util
from jax.interpreters import partial_eval
from numpy.typing import ArrayLike

from .._compilation.xla import CALLS, ELEMENTWISE, SHARED
from .cells import Region
from .elementary import ELEMENTARY
from .elementwise import FLOAT_OPERATIONS, IDENTITIES, PARAMETERS, RULES, WITHOUT_EFFECT, apply
from .operations import KINDS, Operations, Symbol, Value

LARGEST_UNROLLED = 48
"""Largest number of elements of an array whose elements are separate values. A larger array is
processed by loops, which saves code and time of compilation."""
LONGEST_PACKED = 16
"""Largest number of tangents in one vector, which takes two of the processor's 512-bit vectors."""
LONGEST_CHOICE = 24
"""Largest number of equations of a branch that is computed even if its result is not needed: a
jump around a longer one costs less."""
SMALLEST_FUNCTION = 1000
"""Number of equations from which on a jaxpr that is called repeatedly becomes a function. With a
shorter one, exchanging values in memory costs more than the function saves."""
SMALLEST_SHARED = 60
"""Number of equations from which on a jaxpr that many places share becomes a function."""
FEWEST_CALLS = 3
"""Number of calls from which on a jaxpr of `SMALLEST_FUNCTION` equations becomes a function."""
MOST_ELEMENTARY = 32
"""Number of elementary functions, such as sines, that are written out, with some 50 operations
each. Further ones in the same program are calls of a function."""
Atom = core.Var | core.Literal
Equation = core.JaxprEqn
# Kinds by dtype: finding the name of a dtype takes 20 times as long as this look-up.
_KINDS = {np.dtype(name): kind for name, kind in KINDS.items()}
_UNSIGNED, _LARGEST_UINT32 = np.dtype("uint32"), (1 << 32) - 1


class UnsupportedPrimitiveError(NotImplementedError):
    """Raised if there is no rule for a primitive or for the way it is used, if the type of an array
    is not supported, and if LLVM rejects the program."""

    def __init__(self, what: str, location: str = ""):
        super().__init__(f"{what}, in {location}" if location else what)
        self.location = location


@dataclass(frozen=True)
class Packed:
    """An array with one element for each tangent, as one vector."""

    value: Value


@dataclass(frozen=True)
class InMemory:
    """An array in memory from the cell `start` on, with elements of a `kind` (see `.operations`).
    It may be overwritten if it is `owned`, because nothing else then reads its cells."""

    start: int
    shape: tuple[int, ...]
    kind: str
    owned: bool = False

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    def overlaps(self, other: "InMemory") -> bool:
        return self.start < other.start + other.size and other.start < self.start + self.size


Array = Value | Packed | np.ndarray | InMemory
"""A scalar, a vector of tangents, a NumPy array of values, or an array in memory."""
EquationRule = Callable[..., Sequence[Array]]
"""Function that adds the operations of an equation to a program and returns the equation's results.
Its arguments are a `Lowering`, the equation and the equation's arguments. It raises
`UnsupportedPrimitiveError` for a use of the primitive that it does not support."""


def scalar(array: Array, what: str = "an array in the place of a number") -> Value:
    """Return an array of shape () as a value; `what` is the text of the error for other shapes."""
    if not isinstance(array, int):
        raise UnsupportedPrimitiveError(what)
    return array


def borrowed(array: Array) -> Array:
    """Return the array as one that must not be overwritten."""
    return replace(array, owned=False) if isinstance(array, InMemory) else array


def aval_of(atom: Atom) -> ShapedArray:
    if not isinstance(atom.aval, ShapedArray):
        raise UnsupportedPrimitiveError(f"values of type {type(atom.aval).__name__}")
    return atom.aval


def kind_of(array: ShapedArray | Region | np.ndarray) -> str:
    kind = _KINDS.get(array.dtype)
    if kind is None:
        raise UnsupportedPrimitiveError(f"arrays of {array.dtype}")
    return kind


def element_indices(aval: ShapedArray) -> np.ndarray:
    """Return the row-major index of each element, in the shape of the array."""
    return np.arange(aval.size).reshape(aval.shape)


def is_contiguous(indices: np.ndarray) -> bool:
    """Return whether each of the indices, (n,), is the previous one plus 1; false if n is 0."""
    return indices.size > 0 and np.array_equal(
        indices, np.arange(indices[0], indices[0] + indices.size)
    )


def inner_jaxprs(equation: Equation) -> Iterator[core.Jaxpr]:
    # Most primitives work element by element, and none of these has an inner jaxpr.
    if equation.primitive.name in RULES:
        return
    for parameter in equation.params.values():
        items = parameter if isinstance(parameter, tuple | list) else [parameter]
        for item in items:
            # A closed jaxpr holds the jaxpr itself. What has no equations is not a jaxpr.
            jaxpr = getattr(item, "jaxpr", item)
            if hasattr(jaxpr, "eqns"):
                yield jaxpr


def count_equations(jaxpr: core.Jaxpr) -> int:
    """Count the equations of a jaxpr and of its inner jaxprs."""
    outer = [e for e in jaxpr.eqns if e.primitive.name not in RULES]
    return len(jaxpr.eqns) + sum(count_equations(j) for e in outer for j in inner_jaxprs(e))


@dataclass
class RepeatedCall:
    """Several equations that call the same jaxpr. For each argument, `shared` tells whether it is
    the same in all calls. `function` computes the jaxpr; ``None`` until an equation is lowered."""

    shared: list[bool]
    function: "Function | None" = None


@dataclass(frozen=True)
class Function:
    """A function of machine code for a jaxpr, which exchanges values with its callers in memory.

    - `number`: its index in the program.
    - `places`: the arguments that differ between calls, as arrays inside the function. The caller
      copies arrays in memory to the cells of their places.
    - `parameters`: the first cell of each value in the other arrays. The caller writes the value.
    - `results`: arrays that the function returns, of values as they are named inside of it.
    - `cells`: the first cell of each value in `results` that the function computes and writes. All
      other values in `results` are computed outside, once for all calls.
    """

    number: int
    parameters: list[int]
    places: list[Array]
    results: list[Array]
    cells: dict[Value, int]


@dataclass(frozen=True)
class PureFunction:
    """A function of machine code that takes and returns values; `number`: its index in the program.

    - `results`: arrays that the function returns, of values as they are named inside of it.
    - `computed`: the values in `results` that the function returns. The others are constants.
    """

    number: int
    results: list[Array]
    computed: list[Value]


def repeated_calls(jaxpr: core.Jaxpr) -> dict[int, RepeatedCall]:
    """Return, by the `id` of each equation that calls a large inner jaxpr repeatedly, the
    `RepeatedCall` of this jaxpr."""
    # Calls of the same jaxpr share one object for it.
    groups: dict[int, list[Equation]] = {}
    for equation in jaxpr.eqns:
        if equation.primitive.name == "jit":
            groups.setdefault(id(equation.params["jaxpr"].jaxpr), []).append(equation)
    calls: dict[int, RepeatedCall] = {}
    for equations in groups.values():
        if len(equations) < FEWEST_CALLS:
            continue
        if count_equations(equations[0].params["jaxpr"].jaxpr) >= SMALLEST_FUNCTION:
            # For each argument of the jaxpr, what the equations pass for it.
            passed = zip(*(equation.invars for equation in equations), strict=True)
            call = RepeatedCall([_are_equal(atoms) for atoms in passed])
            calls.update((id(equation), call) for equation in equations)
    return calls


def _are_equal(atoms: Sequence[Atom]) -> bool:
    first = atoms[0]
    if not isinstance(first, core.Literal):
        return all(atom is first for atom in atoms)
    # The bits count: 0.0 and -0.0 are different numbers, and NaN is equal to itself.
    bits = {np.asarray(a.val).tobytes() for a in atoms if isinstance(a, core.Literal)}
    return len(bits) == 1 and all(isinstance(a, core.Literal) for a in atoms)


def _parameter_of(equation: Equation) -> object:
    """Return the parameter of an elementwise primitive that its rule takes; ``None`` without one.

    **Raises:** `UnsupportedPrimitiveError` if another parameter is not ``None``, such as `accuracy`
    of `jax.lax.exp`, and not in `WITHOUT_EFFECT`: a later JAX may add one that changes the result.
    """
    name = equation.primitive.name
    taken = PARAMETERS.get(name)
    for key, value in equation.params.items():
        if value is not None and key != taken and key not in WITHOUT_EFFECT:
            raise UnsupportedPrimitiveError(f"{name} with the parameter {key!r}")
    return None if taken is None else equation.params[taken]


def _float_operation(equation: Equation) -> str | None:
    operation = FLOAT_OPERATIONS.get(equation.primitive.name)
    if operation is None or any(value is not None for value in equation.params.values()):
        return None
    aval = aval_of(equation.outvars[0])
    return operation if aval.shape == () and _KINDS.get(aval.dtype) == "f" else None


@dataclass(frozen=True)
class Survey:
    """Properties of a jaxpr, found once, although it may be inlined at hundreds of places.

    - `operations`: each equation's operation in `FLOAT_OPERATIONS`; ``None`` if it needs a rule.
    - `last_reads`: for each variable, the index of the last equation that reads it, which may
      overwrite it. A result of the jaxpr has the number of equations, so that none overwrites it.
    - `has_repeated_calls`: whether the jaxpr has `repeated_calls`.
    """

    operations: list[str | None]
    last_reads: dict[Atom, int]
    has_repeated_calls: bool

    @staticmethod
    def of(jaxpr: core.Jaxpr) -> "Survey":
        # The results are read last.
        reads = [*(equation.invars for equation in jaxpr.eqns), jaxpr.outvars]
        # A later read of a variable replaces the earlier ones in the dictionary.
        last_reads: dict[Atom, int] = {
            atom: number
            for number, atoms in enumerate(reads)
            for atom in atoms
            if not isinstance(atom, core.Literal)
        }
        operations = [_float_operation(equation) for equation in jaxpr.eqns]
        return Survey(operations, last_reads, bool(repeated_calls(jaxpr)))


class Lowering:
    """Adds the equations of jaxprs to a program. A rule receives this object to add operations.

    - `ops`: operations of the program.
    - `constants`: arrays that must be in memory before the program starts, by their first cells.

    **Arguments:** `rules`: rules of the primitives that do not work element by element, by the
    primitives' names. The rules of the others are in `.elementwise`.
    """

    def __init__(self, ops: Operations, rules: Mapping[str, EquationRule]):
        self.ops, self._rules = ops, rules
        self.constants: dict[int, np.ndarray] = {}
        self._repeated: dict[int, RepeatedCall] = {}
        # Functions that every block can call: those of shared jaxprs by the jaxpr and the forms of
        # its arguments, and elementary functions by their names and the kind of their arguments.
        self._shared: dict[Hashable, PureFunction] = {}
        self._surveys: dict[int, Survey] = {}
        # Jaxprs whose identity is a key above. They are kept, so that no other one gets it.
        self._jaxprs: list[core.Jaxpr] = []
        self._count_of_elementary = 0

    # Forms of arrays.

    def region(self, aval: ShapedArray) -> Region:
        """Reserve cells for an array and return them as a region."""
        return Region.of(aval, self.ops.allocate(aval.size))

    def argument(self, region: Region) -> Array:
        """Return the array that a caller writes to a region, and that the program may overwrite."""
        return self.in_usual_form(InMemory(region.start, region.shape, kind_of(region), owned=True))

    def constant(self, array: ArrayLike) -> Array:
        array = np.asarray(array)
        kind = kind_of(array)
        if array.size > LARGEST_UNROLLED:
            start = self.ops.allocate(array.size)
            self.constants[start] = array
            return InMemory(start, array.shape, kind)
        values = [self.ops.constant(kind, x) for x in array.ravel().tolist()]
        return self.array(values, array.shape)

    def array(self, values: Sequence[Value], shape: tuple[int, ...]) -> Array:
        """Return the array with the given elements, in row-major order."""
        if shape == ():
            return values[0]
        if self.is_packed(shape):
            return Packed(self.ops.pack(list(values)))
        return np.array(values, dtype=np.int64).reshape(shape)

    def table(self, numbers: np.ndarray) -> InMemory:
        """Return known integers as an array in memory with one axis, from which loops read."""
        table = InMemory(self.ops.allocate(numbers.size), (numbers.size,), "i")
        self.constants[table.start] = numbers.ravel()
        return table

    def load(self, memory: InMemory, index: Value | None = None, offset: int = 0) -> Value:
        """Return the element of an array with the row-major index `index` + `offset`."""
        value = self.ops.load(memory.kind, memory.start + offset, index)
        # In a table, the same index has the same number in all lanes.
        if memory.start in self.constants and (index is None or self.ops.is_uniform(index)):
            self.ops.mark_uniform(value)
        return value

    def new_array(self, shape: tuple[int, ...], kind: str) -> InMemory:
        return InMemory(self.ops.allocate(math.prod(shape)), shape, kind, owned=True)

    def is_packed(self, shape: tuple[int, ...]) -> bool:
        """Return whether an array of this shape is kept as a vector of tangents."""
        return self.ops.padded_tangents > 0 and shape == (self.ops.tangents,)

    def values(self, array: Array) -> list[Value]:
        """Return the elements of an array in row-major order, each as a value of its own."""
        if isinstance(array, int):
            return [array]
        if isinstance(array, Packed):
            return [self.ops.element(array.value, k) for k in range(self.ops.tangents)]
        if isinstance(array, InMemory):
            return [self.load(array, offset=k) for k in range(array.size)]
        return array.ravel().tolist()

    def vector(self, array: Array) -> Value:
        """Return an array with one element for each tangent as a vector; a scalar is repeated."""
        if isinstance(array, Packed):
            return array.value
        if isinstance(array, int) and self.ops.kinds[array].endswith("p"):
            return array
        values = self.values(array)
        return self.ops.pack(values * (self.ops.tangents if len(values) == 1 else 1))

    def in_usual_form(self, memory: InMemory) -> Array:
        """Return an array of more than `LARGEST_UNROLLED` elements as it is, others as values."""
        return memory if memory.size > LARGEST_UNROLLED else self.read(memory)

    def read(self, memory: InMemory) -> Array:
        """Load the elements of an array, at most `LARGEST_UNROLLED`; return the array of values."""
        return self.array(self.values(memory), memory.shape)

    def write(self, array: Array, start: int, index: Value | None = None) -> None:
        """Write an array to the cells from `start`, or `start` + `index`, on. The cells of an array
        in memory must not be among these, since it is copied element by element."""
        ops = self.ops
        if not isinstance(array, InMemory):
            for k, value in enumerate(self.values(array)):
                ops.store(value, start + k, index)
            return

        def visit(k: Value) -> None:
            target = k if index is None else ops.emit("add", "i", index, k)
            ops.store(self.load(array, k), start, target)

        ops.repeat(array.size, visit)

    def in_memory(self, array: Array, shape: tuple[int, ...]) -> InMemory:
        if isinstance(array, InMemory):
            return array
        values = self.values(array)
        # Nothing reads an array without elements, so its kind does not matter.
        memory = self.new_array(shape, self.ops.kinds[values[0]] if values else "f")
        self.write(array, memory.start)
        return memory

    def stored(self, array: Array, aval: ShapedArray) -> Region:
        if isinstance(array, InMemory):
            return Region.of(aval, array.start)
        region = self.region(aval)
        self.write(array, region.start)
        return region

    def copied(self, memory: InMemory) -> InMemory:
        copy = self.new_array(memory.shape, memory.kind)
        self.write(memory, copy.start)
        return copy

    def flatten(self, arrays: Sequence[Array]) -> list[Value]:
        """Return the values of arrays in one list, the form in which branches, loops and functions
        exchange them. A vector of tangents is one value; arrays in memory have no values."""
        flat: list[Value] = []
        for array in arrays:
            if isinstance(array, Packed):
                flat.append(array.value)
            elif not isinstance(array, InMemory):
                flat += self.values(array)
        return flat

    def unflatten(self, values: Sequence[Value], like: Sequence[Array]) -> list[Array]:
        """Return the arrays `like` with the given values, in the order of `flatten`, in place of
        theirs; arrays in memory are returned unchanged."""
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
        """Return the elements of an array at row-major `indices`, in the shape of `indices`. If the
        array is in memory, the result may share its cells."""
        shape, flat, ops = indices.shape, indices.ravel(), self.ops
        # Consecutive elements in memory need no copy.
        if isinstance(array, InMemory) and is_contiguous(flat):
            part = InMemory(array.start + int(flat[0]), shape, array.kind, array.owned)
            if flat.size <= LARGEST_UNROLLED:
                return self.read(part)
            # Other parts of the same array may be read later: only a view of the whole array may be
            # overwritten.
            return replace(part, owned=False) if flat.size < array.size else part
        if isinstance(array, InMemory) and flat.size <= LARGEST_UNROLLED:
            return self.array([self.load(array, offset=int(k)) for k in flat], shape)
        if not isinstance(array, InMemory):
            values = self.values(array)
            if flat.size <= LARGEST_UNROLLED:
                return self.array([values[k] for k in flat], shape)
            # A large result that repeats one value everywhere is filled by a loop.
            if len(values) == 1:
                return self._by_loop(lambda value: value, ops.kinds[values[0]], shape, values)
            array = self.in_memory(array, (len(values),))
        # A loop reads the indices of the elements from a table in memory.
        table = self.table(flat)
        return self._by_loop(partial(self.load, array), array.kind, shape, [table])

    def _by_loop(
        self,
        rule: Callable[..., Value],
        kind: str,
        shape: tuple[int, ...],
        arguments: Sequence[Array],
        by_vectors: bool = False,
    ) -> InMemory:
        """Add a loop over the elements of arrays, and return the array of its results.

        **Arguments:** `rule`: adds operations for one element of each argument, with a result of
        the given kind; `arguments`: arrays of the given shape, and scalars; `by_vectors`: whether
        `rule` also takes vectors, by which programs with tangents compute several elements at once.
        """
        ops = self.ops
        out = self.new_array(shape, kind)
        # Each iteration reads its elements from memory; a scalar serves all iterations.
        operands = [a if isinstance(a, int) else self.in_memory(a, shape) for a in arguments]

        # Compute the element `index` or, with the suffix "p", a vector of elements from there on.
        def apply_to(suffix: str, sources: Sequence[Value | InMemory], index: Value) -> None:
            values = [
                a if isinstance(a, int) else ops.load(a.kind + suffix, a.start, index)
                for a in sources
            ]
            ops.store(rule(*values), out.start, index)

        elements_at_once = ops.padded_tangents if by_vectors and ops.padded_tangents else 1
        if elements_at_once == 1:
            ops.repeat(out.size, partial(apply_to, "", operands))
            return out
        vectors = [self.vector(a) if isinstance(a, int) else a for a in operands]
        length = ops.constant("i", elements_at_once)

        def visit(k: Value) -> None:
            apply_to("p", vectors, ops.emit("mul", "i", k, length))

        ops.repeat(out.size // elements_at_once, visit)
        # The elements that don't fill a vector.
        for k in range(out.size // elements_at_once * elements_at_once, out.size):
            apply_to("", operands, ops.constant("i", k))
        return out

    def _by_one_loop(self, closed: core.ClosedJaxpr, arguments: list[Array]) -> list[Array]:
        """Add a jaxpr that `xla.elementwise` has made, or a derivative of one: for each result, add
        one loop over its elements. If the equations do not allow this, add them one by one."""
        results: list[Array] = []
        for out in closed.jaxpr.outvars:
            # The jaxpr of this result alone, and which arguments it needs. Arguments that are
            # not needed may have another shape, such as those of a linear function in a derivative.
            of_result, used = partial_eval.dce_jaxpr(
                closed.jaxpr, [other is out for other in closed.jaxpr.outvars]
            )
            shape, kind = tuple(aval_of(out).shape), kind_of(aval_of(out))
            variables = (*of_result.invars, *(v for e in of_result.eqns for v in e.outvars))
            # Some versions of JAX repeat a scalar by an equation of its own, which has no rule for
            # single elements. Each operation then gets a loop of its own.
            if not all(tuple(aval_of(v).shape) in ((), shape) for v in variables) or not all(
                equation.primitive.name in RULES for equation in of_result.eqns
            ):
                return self.inline(closed, arguments)
            needed = [array for array, is_used in zip(arguments, used, strict=True) if is_used]
            rule = partial(self._element, of_result)
            results.append(self._by_loop(rule, kind, shape, needed, by_vectors=True))
        return results

    def _element(self, jaxpr: core.Jaxpr, *values: Value) -> Value:
        """Add the equations of a jaxpr to the program for one element, or one vector register of
        elements, of each argument; return the result."""
        arrays: dict[Atom, Array] = dict(zip(jaxpr.invars, values, strict=True))
        are_vectors = any(self.ops.kinds[value].endswith("p") for value in values)
        for equation in jaxpr.eqns:
            name = equation.primitive.name
            operands = [scalar(self._atom(atom, arrays)) for atom in equation.invars]
            # Numbers in the jaxpr are scalars, also if the arguments are vectors.
            operands = [*map(self.vector, operands)] if are_vectors else operands
            parameter = _parameter_of(equation)
            rule = self.operation(name, aval_of(equation.outvars[0]), parameter)
            arrays[equation.outvars[0]] = rule(*operands)
        return scalar(self._atom(jaxpr.outvars[0], arrays))

    # Equations.

    def inline(
        self, jaxpr: core.ClosedJaxpr | core.Jaxpr, arguments: Sequence[Array]
    ) -> list[Array]:
        """Add the equations of a jaxpr to the program and return its results. Arguments in memory
        may be overwritten if they are `owned`."""
        closed = jaxpr if isinstance(jaxpr, core.ClosedJaxpr) else core.ClosedJaxpr(jaxpr, ())
        opened = closed.jaxpr
        constants = [self.constant(const) for const in closed.consts]
        survey = self._surveys.get(id(opened))
        if survey is None:
            survey = self._surveys[id(opened)] = Survey.of(opened)
            self._jaxprs.append(opened)  # kept, so that no other jaxpr gets its `id`
        if survey.has_repeated_calls:
            self._repeated |= repeated_calls(opened)
        arrays: dict[Atom, Array] = dict(zip(opened.constvars, constants, strict=True))
        arrays |= dict(zip(opened.invars, arguments, strict=True))
        equations = zip(opened.eqns, survey.operations, strict=True)
        for number, (equation, operation) in enumerate(equations):
            if operation is None:
                self._add_equation(equation, number, arrays, survey)
            else:
                # Most equations are one operation on floats, added twice as fast without a rule.
                operands = [scalar(self._atom(atom, arrays)) for atom in equation.invars]
                arrays[equation.outvars[0]] = self.ops.emit(operation, "f", *operands)
        return [self._atom(atom, arrays) for atom in opened.outvars]

    def _atom(self, atom: Atom, arrays: dict[Atom, Array]) -> Array:
        if not isinstance(atom, core.Literal):
            return arrays[atom]
        if np.ndim(atom.val) == 0:
            kind = _KINDS.get(aval_of(atom).dtype)
            if kind is not None:
                return self.ops.constant(kind, atom.val)
        return self.constant(np.asarray(atom.val, dtype=aval_of(atom).dtype))

    def _add_equation(
        self, equation: Equation, number: int, arrays: dict[Atom, Array], survey: Survey
    ) -> None:
        """Add an equation, of index `number` in the jaxpr of the `survey`, to the program, and its
        results to `arrays`. Mark arrays in memory that are read later as not owned, so that no rule
        overwrites them: arguments that are read again, and results that share cells with these or
        with each other."""
        arguments: list[Array] = []
        read_later: dict[Atom, InMemory] = {}
        for atom in equation.invars:
            array = self._atom(atom, arrays)
            # The numbers of a literal are never overwritten.
            if isinstance(array, InMemory) and not isinstance(atom, core.Literal):
                # A rule may overwrite an argument that no later equation reads. If the argument
                # occurs twice in this equation, writing for one would change the other.
                is_last_read = survey.last_reads[atom] == number
                if not (is_last_read and list(equation.invars).count(atom) == 1):
                    read_later[atom] = array
                    array = replace(array, owned=False)
            arguments.append(array)
        try:
            outs = self._lower(equation, arguments)
        except UnsupportedPrimitiveError as error:
            if error.location:
                raise
            location = source_info_util.summarize(equation.source_info)
            raise UnsupportedPrimitiveError(str(error), location) from error
        except KeyError as error:
            # Another version of JAX may have renamed the parameter that the rule reads.
            key = error.args[0]
            if not isinstance(key, str) or key in equation.params:
                raise
            what = f"{equation.primitive.name} without the parameter {key!r}"
            location = source_info_util.summarize(equation.source_info)
            raise UnsupportedPrimitiveError(what, location) from error
        # In most equations the result is a scalar, which is not in memory.
        if len(outs) == 1 and isinstance(outs[0], int):
            arrays[equation.outvars[0]] = outs[0]
            return
        # A result, such as a part of an array, may have cells in common with an argument that is
        # read later or with another result. Then neither of the two may be overwritten.
        in_memory = [out for out in outs if isinstance(out, InMemory)]
        for atom, array in read_later.items():
            if any(map(array.overlaps, in_memory)):
                arrays[atom] = replace(array, owned=False)
        for variable, out in zip(equation.outvars, outs, strict=True):
            # Each result in memory overlaps with itself.
            if isinstance(out, InMemory) and sum(map(out.overlaps, in_memory)) > 1:
                out = replace(out, owned=False)
            arrays[variable] = out

    def _lower(self, equation: Equation, arguments: list[Array]) -> Sequence[Array]:
        name = equation.primitive.name
        if name in IDENTITIES:
            return arguments
        if name in RULES:
            return [self._elementwise(equation, arguments)]
        # Some calls become calls of functions, or loops; the jaxprs of all others are inlined.
        if name in CALLS:
            closed = equation.params[CALLS[name]]
            if equation.params.get("name") == SHARED:
                return self._call_shared(closed, arguments)
            is_elementwise = equation.params.get("name") == ELEMENTWISE
            if is_elementwise and any(isinstance(array, InMemory) for array in arguments):
                return self._by_one_loop(closed, arguments)
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
        """Add a call of the function for the jaxpr `closed`, and with the first call the function
        itself; return the results of the call. Functions keep programs short, since LLVM's time for
        a block grows faster than its length: each Runge-Kutta stage computes the rates by the same
        large jaxpr."""
        # Arguments that are the same in all calls are used directly; the others are passed.
        ops, pairs = self.ops, list(zip(arguments, repeated.shared, strict=True))
        varied = [array for array, shared in pairs if not shared]
        values = self.flatten(varied)
        if repeated.function is None:
            kinds = [ops.kinds[value] for value in values]
            parameters = [ops.allocate_for(kind) for kind in kinds]
            # The code of a function names the cells that it reads, so arrays in memory have cells
            # of their own in it.
            places = [
                borrowed(self.new_array(array.shape, array.kind))
                if isinstance(array, InMemory)
                else array
                for array in varied
            ]
            results: list[Array] = []
            cells: dict[Value, int] = {}

            def build() -> None:
                loaded = [ops.load(*row) for row in zip(kinds, parameters, strict=True)]
                remaining = iter(self.unflatten(loaded, places))
                all_arguments = [array if shared else next(remaining) for array, shared in pairs]
                results[:] = self.inline(closed, all_arguments)
                # Values from outside of the function are the same for all calls.
                for value in self.flatten(results):
                    if value not in cells and ops.is_inside(value):
                        cells[value] = ops.pass_on(value)

            number = ops.function(build)
            repeated.function = Function(number, parameters, places, results, cells)
        # The call: write the arguments, execute the function, and read its results.
        function = repeated.function
        for value, cell in zip(values, function.parameters, strict=True):
            ops.pass_on(value, cell)
        # All lanes compute in a function, whatever the conditions at the call.
        with ops.masked(None):
            for array, place in zip(varied, function.places, strict=True):
                if isinstance(array, InMemory) and isinstance(place, InMemory):
                    self.write(array, place.start)
        ops.call(function.number)
        # Values that the function does not compute are those from outside of it.
        loaded = {v: ops.load(ops.kinds[v], cell) for v, cell in function.cells.items()}
        result_values = [loaded.get(value, value) for value in self.flatten(function.results)]
        # The next call overwrites the arrays that the function has left in memory.
        return [
            self.copied(array) if isinstance(array, InMemory) else array
            for array in self.unflatten(result_values, function.results)
        ]

    def _call_shared(self, closed: core.ClosedJaxpr, arguments: list[Array]) -> list[Array]:
        """Add a call of the function for a jaxpr that many places share, and with the first call
        the function itself; return the results of the call. The function uses no values but its
        arguments and constants, unlike that of `_call`, so that any block can call it."""
        ops = self.ops
        # The function takes values only, which an array in memory does not have.
        if any(isinstance(array, InMemory) for array in arguments):
            return self.inline(closed, arguments)
        values = self.flatten(arguments)
        kinds = [ops.kinds[value] for value in values]
        shapes = (np.shape(array) if isinstance(array, np.ndarray) else () for array in arguments)
        key = id(closed.jaxpr), (*shapes, *kinds), ops.width
        function = self._shared.get(key)
        if function is None:
            # Passing the values of a short function would take longer than computing its results.
            if count_equations(closed.jaxpr) < SMALLEST_SHARED:
                return self.inline(closed, arguments)
            function = self._shared_function(partial(self.inline, closed), arguments, kinds)
            self._shared[key] = function
            # The jaxpr is kept, since its identity is a part of the key.
            self._jaxprs.append(closed.jaxpr)
        return self.unflatten(self._called(function, values), function.results)

    def _shared_function(
        self, add: Callable[[list[Array]], list[Array]], like: list[Array], kinds: list[str]
    ) -> PureFunction:
        """Add a function that can be called from any block. `add` adds the function's operations,
        and returns its results, for arguments like `like`, whose values have the given kinds."""

        def build(
            results: list[Array], computed: list[Value], parameters: list[Value]
        ) -> list[Value]:
            results[:] = add(self.unflatten(parameters, like))
            values = dict.fromkeys(self.flatten(results))
            computed[:] = [value for value in values if self.ops.number(value) is None]
            return computed

        # `build` fills the two lists of the function.
        function, count_before = PureFunction(0, [], []), self._count_of_elementary
        number = self.ops.pure_function(kinds, partial(build, function.results, function.computed))
        # A function of vectors computes several calls at once. It begins with the same count, which
        # decides what becomes a call (see `_elementary`), so that its operations, and with them the
        # bits of results, are those for one call. If it can't be built, calls remain single.
        self._count_of_elementary = count_before
        with suppress(UnsupportedPrimitiveError):
            # The lists that it fills are not used: its results correspond to those of `function`.
            self.ops.add_function_of_vectors(number, kinds, partial(build, [], []))
        return replace(function, number=number)

    def _called(self, function: PureFunction, values: list[Value]) -> list[Value]:
        computed = self.ops.called(function.number, values)
        values_by_name = dict(zip(function.computed, computed, strict=True))
        return [values_by_name.get(value, value) for value in self.flatten(function.results)]

    def _elementary(self, name: str, *values: Value) -> Value:
        """Add the operations of an elementary function of floats, such as "exp", or, after
        `MOST_ELEMENTARY` such functions, a call of a function of machine code; return the result. A
        sine and a cosine call one function, which returns both from operations that they share."""
        ops = self.ops
        # Functions of known numbers are not counted: a sine, for instance, needs no operation then.
        if all(ops.number(value) is not None for value in values):
            return apply(ops, name, *values)
        self._count_of_elementary += 1
        if self._count_of_elementary <= MOST_ELEMENTARY:
            return apply(ops, name, *values)
        names = ("sin", "cos") if name in ("sin", "cos") else (name,)
        kinds = [ops.kinds[value] for value in values]
        key = names, *kinds, ops.width
        function = self._shared.get(key)
        if function is None:

            def add(arguments: list[Array]) -> list[Array]:
                return [apply(ops, each, *map(scalar, arguments)) for each in names]

            function = self._shared_function(add, list(values), kinds)
            self._shared[key] = function
        return self._called(function, list(values))[names.index(name)]

    def operation(
        self, name: str, aval: ShapedArray, parameter: object = None
    ) -> Callable[..., Value]:
        """Return the function that adds the operations of the elementwise primitive `name` for
        values, and returns the result, of the dtype of `aval`. `parameter`: as for `apply`."""
        if name in ELEMENTARY:
            return partial(self._elementary, name)

        def rule(*values: Value) -> Value:
            value = apply(self.ops, name, *values, parameter=parameter)
            if aval.dtype != _UNSIGNED:
                return value
            # uint32 is computed in 64-bit integers, whose higher bits are cut off.
            return (Symbol(self.ops, value) & _LARGEST_UINT32).value

        return rule

    def _elementwise(self, equation: Equation, arguments: list[Array]) -> Array:
        aval, name = aval_of(equation.outvars[0]), equation.primitive.name
        kind, shape = kind_of(aval), tuple(aval.shape)
        parameter = _parameter_of(equation)
        rule = self.operation(name, aval, parameter)
        if shape == ():
            return rule(*self.flatten(arguments))
        # Axes of length 1 are repeated.
        arguments = [
            array
            if isinstance(array, int) or tuple(aval_of(atom).shape) == shape
            else self.take(array, np.broadcast_to(element_indices(aval_of(atom)), shape))
            for array, atom in zip(arguments, equation.invars, strict=True)
        ]
        if aval.size > LARGEST_UNROLLED:
            return self._by_loop(rule, kind, shape, arguments, by_vectors=True)
        if self.is_packed(shape):
            return Packed(rule(*map(self.vector, arguments)))
        # A small array: the operation is added for each element.
        rows = [
            [argument] * aval.size if isinstance(argument, int) else self.values(argument)
            for argument in arguments
        ]
        return self.array([rule(*row) for row in zip(*rows, strict=True)], shape)
