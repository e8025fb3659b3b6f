"""Operations on scalars: the form of a program between a jaxpr and LLVM's language.

A value is named by an integer and computed once (static single assignment). Its kind is ``f``
(float64), ``i`` (int64), ``w`` (int32) or ``b`` (bool). The suffix ``p`` marks a vector of
tangents: derivatives of one variable by several parameters. The suffix ``v`` marks a vector with an
element for each of several calls that are computed together. In a program that computes several
runs at once, called lanes, each value is a vector with a number for each lane.
"""

import bisect
import math
import operator
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

Value = int
"""Name of a value of a program."""
Number = float | int | bool
"""A number that is known while the program is built."""
KINDS = {"float64": "f", "int64": "i", "int32": "w", "bool": "b", "uint32": "i"}
"""Kinds by the names of dtypes. uint32 is computed in int64, with results cut to 32 bits."""


@dataclass(slots=True)
class Operation:
    """An operation: the value `out` becomes `name` of the values `arguments`.

    Most operations are pure, such as "fadd": they only compute `out` from the arguments.
    `.llvm_text` lists them. The others are

    - "load", which reads a cell: its index is `number`, or `number` plus the argument if any;
    - "store", which writes the first argument to a cell: its index is `number`, or `number` plus
      the second argument if any;
    - "call", which executes the function `number` of the program. The function reads its arguments
      from memory and writes its results there.

    A vector of tangents occupies the cells from `number` on. "store" and "call" have no `out`.
    """

    out: Value | None
    name: str
    arguments: tuple[Value, ...] = ()
    number: int = 0

    blocks = ()


@dataclass
class Branch:
    """Execute the block `yes` if the condition holds, else the block `no`.

    The values `outs` become `yes_values` or `no_values`, which the executed block computes. If the
    condition is a vector, of lanes or of tangents, `yes` is executed if any of its elements holds.
    Operations in `yes` or after the branch must then select the results of the other elements.
    """

    condition: Value
    outs: list[Value]
    yes: "Block"
    yes_values: list[Value]
    no: "Block"
    no_values: list[Value]

    @property
    def arguments(self) -> tuple[Value, ...]:
        """The condition, and the values that `outs` may become."""
        return (self.condition, *self.yes_values, *self.no_values)

    @property
    def blocks(self) -> "tuple[Block, Block]":
        return self.yes, self.no


@dataclass
class Loop:
    """Execute the block `head`, which computes `condition`; while it holds, run `body` and `head`.

    The values `carries` begin as `first`, and become `following` after each execution of the body.
    With several lanes, the body is executed for all lanes as long as the condition holds in any
    lane, and must leave the carries of the other lanes unchanged.
    """

    carries: list[Value]
    first: list[Value]
    head: "Block"
    condition: Value
    body: "Block"
    following: list[Value]

    @property
    def arguments(self) -> tuple[Value, ...]:
        return (self.condition, *self.first, *self.following)

    @property
    def blocks(self) -> "tuple[Block, Block]":
        return self.head, self.body


Entry = Operation | Branch | Loop
Block = list[Entry]
"""Entries in the order of their execution."""


def walked(block: Block) -> Iterator[Entry]:
    """Yield the entries of a block, each one before those of the blocks inside of it."""
    for entry in block:
        yield entry
        for inner in entry.blocks:
            yield from walked(inner)


def _divided(a: float, b: float) -> float:
    with np.errstate(all="ignore"):
        return float(np.float64(a) / np.float64(b))


_COMPARISONS = ("lt", "le", "gt", "ge", "eq", "ne")
_FOLDED: dict[str, Callable] = {
    **{f"f{name}": getattr(operator, name) for name in ("add", "sub", "mul", "neg", *_COMPARISONS)},
    **{f"i{name}": getattr(operator, name) for name in _COMPARISONS},
    **{name: getattr(operator, name) for name in ("abs", "add", "sub", "mul", "xor")},
    "and": operator.and_,
    "or": operator.or_,
    "fdiv": _divided,
    "sqrt": lambda x: math.sqrt(x) if x >= 0.0 else math.nan,
    **dict.fromkeys(("int_to_float", "bool_to_float"), float),
    **dict.fromkeys(("bool_to_int", "widen", "narrow"), int),
}
"""Operations that are computed while the program is built if all arguments are known, with the
rounding of the processor."""
_RANGE = {"i": 1 << 63, "w": 1 << 31}
"""For each kind of integers, the largest integer plus 1."""


class Operations:
    """Builds the blocks of a program.

    A pure operation is not added if its result is known, if its result is one of its operands (x
    times 1), or if this block, or one that contains it, has the same operation on the same
    arguments. A simpler operation with the same result is added in its place, such as a negation
    for x times -1. Loads, stores and calls are always added.

    - `kinds`: kind of each value.
    - `constants`: numbers of the values that are known.
    - `cells`: number of cells of memory that the program uses.
    - `block`: the block to which entries are added.
    - `functions`: blocks of the program's functions.
    - `signatures`: values of arguments and results of each pure function, by index in `functions`.
    - `without_memory`: indices of the pure functions that, with all that they call, neither read
      nor write memory, so that calls may be joined or moved.
    - `of_vectors`: by the index of a pure function, the index of the function that computes several
      of its calls at once (see `.alike_calls`).
    - `tangents`: number of tangents, 0 for none.
    - `padded_tangents`: number of elements, and of cells, of a vector of tangents: `tangents`
      rounded up to a power of two. The further elements repeat the last tangent.

    **Arguments:** `width`: number of lanes; `calls_at_once`: number of calls that a function in
    `of_vectors` computes, 1 for no such functions. A program of several lanes can have neither
    tangents nor such functions.
    """

    def __init__(self, width: int = 1, tangents: int = 0, calls_at_once: int = 1):
        assert width == 1 or (tangents == 0 and calls_at_once == 1), "lanes carry single numbers"
        self.calls_at_once = calls_at_once
        self.width, self.tangents = width, tangents
        self.padded_tangents = 1 << (tangents - 1).bit_length() if tangents else 0
        self.kinds: list[str] = []
        self.constants: dict[Value, Number] = {}
        self.cells = 0
        # The first cell of each group of cells that one call of `allocate` has reserved.
        self._starts: list[int] = []
        self.block: Block = []
        self.functions: list[Block] = []
        self.signatures: dict[int, tuple[list[Value], list[Value]]] = {}
        self.of_vectors: dict[int, int] = {}
        self.without_memory: set[int] = set()
        # For pure functions, the number of elements of their values.
        self._widths: dict[int, int] = {}
        # For each function that is being built, from the outermost one on: the block around it, and
        # the index of this block's keys in `_scopes`.
        self._outside: list[tuple[Block, int]] = []
        # For values that are computed in functions, the number of functions around them.
        self._depths: dict[Value, int] = {}
        # Values of constants, by kind and number.
        self._numbers: dict[tuple, Value] = {}
        # Values by operation, kind and arguments, and the keys that each open block has added. A
        # value can be reused in inner blocks, but not after the end of its block.
        self._known: dict[tuple, Value] = {}
        self._scopes: list[list[tuple]] = [[]]
        # For values that `emit` has added, the operation and its arguments, to simplify later ones.
        self._definitions: dict[Value, tuple[str, tuple[Value, ...]]] = {}
        # Values, besides constants, that are the same in all lanes.
        self._uniform: set[Value] = set()
        # The condition of `masked`; without one, all lanes write.
        self._mask: Value | None = None

    def new(self, kind: str, depth: int | None = None) -> Value:
        """Return a new value that is computed inside of `depth` nested functions, by default inside
        of all those that are being built."""
        depth = len(self._outside) if depth is None else depth
        self.kinds.append(kind)
        value = len(self.kinds) - 1
        if depth:
            self._depths[value] = depth
        return value

    def constant(self, kind: str, number: Number) -> Value:
        if kind == "f":
            number = float(number)
            # By its bits, since 0.0 == -0.0 and NaN != NaN.
            key = ("f", struct.pack("d", number))
        else:
            number = bool(number) if kind == "b" else int(number)
            key = (kind, number)
        value = self._numbers.get(key)
        if value is None:
            value = self._numbers[key] = self.new(kind, 0)
            self.constants[value] = number
        return value

    def number(self, value: Value) -> Number | None:
        """Return the number of a value; ``None`` if only the run determines it."""
        return self.constants.get(value)

    def is_uniform(self, value: Value) -> bool:
        """Return whether a value is known to be the same in all lanes."""
        return self.width == 1 or value in self.constants or value in self._uniform

    def mark_uniform(self, value: Value) -> None:
        """Declare that a value is the same in all lanes, such as the counter of a loop."""
        self._uniform.add(value)

    def emit(self, name: str, kind: str, *arguments: Value) -> Value:
        """Return the result, of the given kind, of a pure operation, which is added if needed."""
        simpler = self._simplified(name, kind, arguments)
        if simpler is not None:
            return simpler
        key = (name, kind, *arguments)
        value = self._known.get(key)
        if value is None:
            # The last list of `_scopes` has the keys of the current block.
            block, scope, depth = self.block, -1, len(self._outside)
            if depth:
                # An operation is moved out of functions that compute none of its operands, so that
                # all calls share its result. `depth`, the number of functions that it stays in, is
                # that of its innermost operand. `_outside` has the block at this depth.
                depth = max(self._depths.get(operand, 0) for operand in arguments)
                if depth < len(self._outside):
                    block, scope = self._outside[depth]
            value = self._known[key] = self.new(kind, depth)
            self._scopes[scope].append(key)
            self._definitions[value] = name, arguments
            if self.width > 1 and all(map(self.is_uniform, arguments)):
                self._uniform.add(value)
            block.append(Operation(value, name, arguments))
        return value

    def _simplified(self, name: str, kind: str, arguments: tuple[Value, ...]) -> Value | None:
        """Return the result of an operation without adding it, or ``None`` if no rule applies.

        Every rule holds for all numbers, also for NaN, infinities and negative zeros: there is none
        for x + 0.0, which is not x if x is -0.0.
        """
        known = [self.constants.get(value) for value in arguments]
        if name in _FOLDED and None not in known:
            number = _FOLDED[name](*known)
            # Integers beyond the range wrap around, as the processor's do.
            if kind in _RANGE:
                half = _RANGE[kind]
                number = (int(number) + half) % (2 * half) - half
            return self.constant(kind, number)
        # Mostly the operands are scalars and not known; a vector may repeat a known number. The
        # rules for "fmul" and "fdiv" do not apply then, and "fma" has none.
        is_unknown = kind == "f" and known.count(None) == len(known)
        if is_unknown and name in ("fmul", "fdiv", "fma"):
            return None
        first, *others = arguments
        # The negation of a negation is its operand.
        if name in ("fneg", "not"):
            return self._operand_of(name, first)
        if name == "select":
            yes, no = others
            if known[0] is not None:
                return yes if known[0] else no
            if yes == no:
                return yes
            # A choice between two known bools, which differ, is the condition or its opposite.
            if kind == "b" and None not in known[1:]:
                return first if known[1] else self.emit("not", "b", first)
        elif name in ("and", "or") and kind == "b":
            if first == others[0]:
                return first
            # Each argument, with its number if known, and beside it the other argument.
            for number, value, other in zip(known, arguments, arguments[::-1], strict=True):
                if number is not None:
                    # `x and True` and `x or False` are x; `x and False` is False, and `x or True`
                    # is True.
                    return other if bool(number) == (name == "and") else value
        elif name == "fmul":
            # Either factor may be the known one, and below either term of a sum.
            for x, other in (arguments, arguments[::-1]):
                if self._is_all(x, 1.0):
                    return other
                if self._is_all(x, -1.0):
                    return self.emit("fneg", kind, other)
        elif name == "fdiv":
            return first if self._is_all(others[0], 1.0) else None
        elif name == "fadd":
            # x + -0.0 is x, and x + (-y) is x - y.
            for x, other in (arguments, arguments[::-1]):
                if not is_unknown and self._is_all(x, -0.0):
                    return other
                negated = self._operand_of("fneg", x)
                if negated is not None:
                    return self.emit("fsub", kind, other, negated)
        elif name == "fsub":
            # x - 0.0 is x, and x - (-y) is x + y.
            if not is_unknown and self._is_all(others[0], 0.0):
                return first
            negated = self._operand_of("fneg", others[0])
            if negated is not None:
                return self.emit("fadd", kind, first, negated)
        return None

    def repeated_number(self, value: Value) -> Number | None:
        """Return the known number of a value, or of all elements of a vector, else ``None``."""
        # A vector with equal elements is made from one value by the operation "splat".
        element = self._operand_of("splat", value)
        return self.constants.get(value if element is None else element)

    def _is_all(self, value: Value, number: float) -> bool:
        """Return whether a float, or each element of a vector, is known to be `number`, where 0.0
        and -0.0 are different numbers."""
        repeated = self.repeated_number(value)
        return (
            isinstance(repeated, float)
            and repeated == number
            and math.copysign(1.0, repeated) == math.copysign(1.0, number)
        )

    def _operand_of(self, name: str, value: Value) -> Value | None:
        """Return the first argument of the operation that computes `value` if this operation has
        the given name, else ``None``."""
        definition, arguments = self._definitions.get(value, ("", ()))
        return arguments[0] if definition == name else None

    # Vectors of tangents.

    def pack(self, values: list[Value]) -> Value:
        kind = self.kinds[values[0]]
        name, arguments = self._definitions.get(values[0], ("", ()))
        if name == "element":
            # The elements of one vector in order are that vector.
            vector = arguments[0]
            if all(self.element(vector, k) == value for k, value in enumerate(values)):
                return vector
        if all(value == values[0] for value in values):
            return self.emit("splat", f"{kind}p", values[0])
        return self.emit("build", f"{kind}p", *values)

    def element(self, vector: Value, k: int) -> Value:
        name, arguments = self._definitions.get(vector, ("", ()))
        if name == "splat":
            return arguments[0]
        if name == "build":
            return arguments[k]
        return self.emit("element", self.kinds[vector][0], vector, self.constant("i", k))

    # Blocks.

    @contextmanager
    def inside(self, block: Block) -> Iterator[Block]:
        """Add entries to `block` within the context. The entries' values are not reused after the
        context, because the program may not have executed the block."""
        outer, self.block = self.block, block
        self._scopes.append([])
        try:
            yield block
        finally:
            for key in self._scopes.pop():
                del self._known[key]
            self.block = outer

    def allocate(self, cells: int) -> int:
        """Reserve cells of memory and return the first one."""
        self._starts.append(self.cells)
        self.cells += cells
        return self._starts[-1]

    def allocated_with(self, cell: int) -> range:
        """Return the cells that have been reserved together with a cell."""
        after = bisect.bisect_right(self._starts, cell)
        end = self._starts[after] if after < len(self._starts) else self.cells
        return range(self._starts[after - 1], end)

    def load(self, kind: str, start: int, index: Value | None = None) -> Value:
        """Add a read of the cell `start`, or `start` + `index`, and return the value that is read.
        A value of the kind of a vector is read from that cell and the following ones."""
        cell, arguments = self._address(start, index)
        out = self.new(kind)
        self.block.append(Operation(out, "load", arguments, cell))
        return out

    def store(self, value: Value, start: int, index: Value | None = None) -> None:
        """Add the write of a value to the cell `start`, or `start` + `index`. Within the context
        `masked`, only lanes in which the context's condition holds write."""
        if self._mask is not None:
            kind = self.kinds[value]
            value = self.emit("select", kind, self._mask, value, self.load(kind, start, index))
        cell, arguments = self._address(start, index)
        self.block.append(Operation(None, "store", (value, *arguments), cell))

    @contextmanager
    def masked(self, condition: Value | None) -> Iterator[None]:
        """Let only lanes in which a condition holds write to memory within the context. The
        conditions of nested contexts must all hold. With ``None``, all lanes write, whatever the
        conditions of outer contexts."""
        outer = self._mask
        if outer is None or condition is None:
            self._mask = condition
        else:
            self._mask = self.emit("and", "b", outer, condition)
        try:
            yield
        finally:
            self._mask = outer

    def _address(self, start: int, index: Value | None) -> tuple[int, tuple[Value, ...]]:
        """Return, for a load or store of the cell `start` + `index`, its `number` and a tuple with
        its argument for the index; a known index is added to the number, and the tuple is empty."""
        number = None if index is None else self.constants.get(index)
        if number is None:
            return start, () if index is None else (index,)
        return start + int(number), ()

    # Functions.

    def function(self, build: Callable[[], None]) -> int:
        """Add a function that the current block, and blocks inside it, can call; return its index.

        `build` adds the entries of the function. Values from outside that the function uses are
        written to memory in the current block, and the function reads them there. The function
        writes in all lanes, even if it is added inside a `masked` context.
        """
        inner, depth = [], len(self._outside)
        # By this entry, `emit` adds operations that use no value of the function to this block.
        self._outside.append((self.block, len(self._scopes) - 1))
        # All lanes compute in a function, also if it is called where a condition holds in few:
        # calls in other places have other conditions.
        with self.inside(inner), self.masked(None):
            build()
        self._outside.pop()
        # Used values with at most `depth` functions around them come from outside of this function.
        # A load at its beginning defines them in it, under the same names.
        loads: list[Entry] = []
        used = (value for entry in walked(inner) for value in entry.arguments)
        for value in dict.fromkeys(used):
            if value not in self.constants and self._depths.get(value, 0) <= depth:
                loads.append(Operation(value, "load", (), self.pass_on(value)))
        inner[:0] = loads
        self.functions.append(inner)
        return len(self.functions) - 1

    def pure_function(
        self, kinds: list[str], build: Callable[[list[Value]], list[Value]], width: int = 0
    ) -> int:
        """Add a function that takes and returns values, and return its index, for `called`.

        **Arguments:** `kinds`: kinds of the function's arguments; `build`: adds the entries of the
        function for given arguments, and returns the results; `width`: number of elements of the
        function's values, by default the number of lanes. Of the values from outside, the function
        may use only constants. What it writes to memory must not be read outside.
        """
        # Nothing from outside is reused in the function, and nothing is moved out of it.
        outside, scopes, known = self._outside, self._scopes, self._known
        self._outside, self._scopes, self._known = [], [[]], {}
        outer_width, self.width = self.width, width or self.width
        inner, parameters = [], [self.new(kind) for kind in kinds]
        try:
            # All lanes compute, whatever the conditions at the calls.
            with self.inside(inner), self.masked(None):
                results = build(parameters)
        finally:
            self._outside, self._scopes, self._known = outside, scopes, known
            inner_width, self.width = self.width, outer_width
        self.functions.append(inner)
        number = len(self.functions) - 1
        self.signatures[number] = parameters, results
        self._widths[number] = inner_width
        if not self._uses_memory(inner):
            self.without_memory.add(number)
        return number

    def add_function_of_vectors(
        self, function: int, kinds: list[str], build: Callable[[list[Value]], list[Value]]
    ) -> None:
        """Add a function to `of_vectors` that computes `calls_at_once` calls of the pure function
        with the index `function` together; `kinds` and `build` are those given for that function.

        None is added in a program of several lanes, nor if the function uses memory or vectors of
        tangents. If this shows only after building, the new function remains without calls.
        """
        if (
            self.calls_at_once == 1
            or self.width > 1
            or function not in self.without_memory
            or any(kind[1:] for kind in kinds)  # a suffix marks vectors
        ):
            return
        kinds_before = len(self.kinds)
        number = self.pure_function(kinds, build, self.calls_at_once)
        # Results of a joined call replace those of single calls, and must have the same kinds.
        kinds_of_results, new_kinds_of_results = (
            [self.kinds[value] for value in self.signatures[each][1]] for each in (function, number)
        )
        is_alike = kinds_of_results == new_kinds_of_results
        has_tangents = any(kind.endswith("p") for kind in self.kinds[kinds_before:])
        if is_alike and not has_tangents and number in self.without_memory:
            self.of_vectors[function] = number

    def _uses_memory(self, block: Block) -> bool:
        for entry in walked(block):
            if isinstance(entry, Operation):
                if entry.name in ("load", "store", "call"):
                    return True
                if entry.name == "evaluate":
                    called = int(self.constants[entry.arguments[0]])
                    if called not in self.without_memory:
                        return True
        return False

    def width_of(self, function: int) -> int:
        """Return the number of elements of each value in the function with the index `function`:
        the number of lanes or, if the function is one of vectors, the number of calls."""
        return self._widths.get(function, self.width)

    def called(self, function: int, arguments: list[Value]) -> list[Value]:
        """Add a call of the pure function with the index `function`, unless there is an equal one
        that can be reused, and return the results of the call."""
        _, results = self.signatures[function]
        number = self.constant("i", function)
        all_results = self.emit("evaluate", "results", number, *arguments)
        return [
            self.emit("result", self.kinds[value], all_results, number, self.constant("i", k))
            for k, value in enumerate(results)
        ]

    def once(self, key: tuple, add: Callable[[], Value]) -> Value:
        """Call `add`, which adds entries to the program, and return its result. If this has been
        done for the same `key` in the current block, or in one around it, return that result."""
        value = self._known.get(key)
        if value is None:
            value = self._known[key] = add()
            self._scopes[-1].append(key)
        return value

    def is_inside(self, value: Value) -> bool:
        return self._depths.get(value, 0) == len(self._outside)

    def call(self, function: int) -> None:
        self.block.append(Operation(None, "call", (), function))

    def pass_on(self, value: Value, cell: int | None = None) -> int:
        """Write an argument or a result of a function to a cell, by default a new one, and return
        the cell. All lanes write, even within `masked`."""
        if cell is None:
            cell = self.allocate_for(self.kinds[value])
        self.block.append(Operation(None, "store", (value,), cell))
        return cell

    def allocate_for(self, kind: str) -> int:
        """Reserve the cells of a value of a kind and return the first one."""
        return self.allocate(self.cells_of(kind))

    def cells_of(self, kind: str) -> int:
        return {"p": self.padded_tangents, "v": self.calls_at_once}.get(kind[1:], 1)

    def branch(
        self, condition: Value, yes: Callable[[], list[Value]], no: Callable[[], list[Value]]
    ) -> list[Value]:
        """Add a branch and return its values. `yes` and `no` each add the entries of a block and
        return its results, of the same kinds."""
        blocks, values = ([], []), []
        for block, build in zip(blocks, (yes, no), strict=True):
            with self.inside(block):
                values.append(build())
        outs = [self.new(self.kinds[value]) for value in values[0]]
        self.block.append(Branch(condition, outs, blocks[0], values[0], blocks[1], values[1]))
        return outs

    def loop(
        self,
        first: list[Value],
        holds: Callable[[list[Value]], Value],
        body: Callable[[list[Value]], list[Value]],
    ) -> list[Value]:
        """Add a loop, whose carries begin as `first`, and return its carries after the last
        iteration. As functions of the carries, `holds` adds the condition for a further iteration,
        and `body` adds the loop's body and returns the next carries."""
        # The condition is computed in its own block, which is executed once more than the body.
        carries = [self.new(self.kinds[value]) for value in first]
        head, inner = [], []
        with self.inside(head):
            condition = holds(carries)
        with self.inside(inner):
            following = body(carries)
        self.block.append(Loop(carries, first, head, condition, inner, following))
        return carries

    def counted(
        self,
        begin: Value,
        end: Value,
        first: list[Value],
        visit: Callable[[Value, list[Value]], list[Value]],
    ) -> list[Value]:
        """Add a loop over the indices from `begin` to `end` - 1, with carries as in `loop`. `visit`
        adds the body for an index and carries, and returns the next carries."""

        def holds(carries: list[Value]) -> Value:
            # All lanes have the same index, so they can read and write a cell at once.
            self.mark_uniform(carries[0])
            return self.emit("ilt", "b", carries[0], end)

        def body(carries: list[Value]) -> list[Value]:
            following = visit(carries[0], carries[1:])
            return [self.emit("add", "i", carries[0], self.constant("i", 1)), *following]

        return self.loop([begin, *first], holds, body)[1:]

    def repeat(self, count: int, visit: Callable[[Value], None]) -> None:
        """Add a loop over the indices 0 to `count` - 1, whose body `visit` adds for an index."""

        def body(k: Value, _: list[Value]) -> list[Value]:
            visit(k)
            return []

        self.counted(self.constant("i", 0), self.constant("i", count), [], body)


def _operator(
    float_name: str, name: str, bool_name: str = ""
) -> "Callable[[Symbol, Symbol | Number], Symbol]":
    names = {"f": float_name, "b": bool_name or name}
    return lambda a, b: a.emit(names.get(a.letter, name), b)


class Symbol:
    """A value of a program on which Python's operators act: they add operations to the program.

    The first operand's kind decides the operation: `+` is "fadd" for floats and "add" for integers.
    Sum, difference and product of bools are "or", "xor" and "and". The second operand may be a
    number. `letter` is the kind of a single element: "f" for a vector of tangents of the kind "fp".
    """

    __slots__ = ("kind", "letter", "ops", "value")

    def __init__(self, ops: Operations, value: Value):
        self.ops, self.value, self.kind = ops, value, ops.kinds[value]
        self.letter = self.kind[0]

    def like(self, number: Number) -> "Symbol":
        constant = self.ops.constant(self.letter, number)
        if self.kind.endswith("p"):
            constant = self.ops.emit("splat", self.kind, constant)
        return Symbol(self.ops, constant)

    def emit(self, name: str, *others: "Symbol | Number", letter: str = "") -> "Symbol":
        """Return the result of the operation `name` of this value and `others`. The kind of the
        result has the given `letter`, by default the letter of this value."""
        kind = letter + self.kind[1:] if letter else self.kind
        values = [(x if isinstance(x, Symbol) else self.like(x)).value for x in others]
        return Symbol(self.ops, self.ops.emit(name, kind, self.value, *values))

    __add__ = _operator("fadd", "add", "or")
    __sub__ = _operator("fsub", "sub", "xor")
    __mul__ = _operator("fmul", "mul", "and")
    __truediv__ = _operator("fdiv", "fdiv")
    __and__, __or__, __xor__ = (_operator(name, name) for name in ("and", "or", "xor"))

    def __neg__(self) -> "Symbol":
        return self.emit("fneg") if self.letter == "f" else self.like(0) - self

    def __invert__(self) -> "Symbol":
        return self.emit("not")

    def compare(self, name: str, other: "Symbol | Number") -> "Symbol":
        """Return the comparison "lt", "le", "gt", "ge", "eq" or "ne" with another value."""
        return self.emit(("f" if self.letter == "f" else "i") + name, other, letter="b")

    def select(self, yes: "Symbol", no: "Symbol") -> "Symbol":
        value = self.ops.emit("select", yes.kind, self.value, yes.value, no.value)
        return Symbol(self.ops, value)

    def is_nan(self) -> "Symbol":
        return self.emit("is_nan_either", self, letter="b")
