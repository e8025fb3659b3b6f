"""Operations on scalars: the form of a program between a jaxpr and LLVM's language.

A value is named by an integer and computed once (static single assignment). Its kind is ``f``
(float64), ``i`` (int64), ``w`` (int32) or ``b`` (bool); with the suffix ``p`` it is a vector of
tangents of that kind. A block is a list of entries: pure operations, reads and writes of memory,
calls of functions, and branches and loops, which contain blocks.
"""

import math
import operator
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

Value = int
Number = float | int | bool
KINDS = {"float64": "f", "int64": "i", "int32": "w", "bool": "b", "uint32": "i"}
"""Kinds by the names of dtypes. uint32 is computed in int64, with results cut to 32 bits."""


@dataclass
class Operation:
    """`out` = name(arguments), where `name` is the name of a pure operation or one of these:

    - "load" reads a cell: `number`, or `number` + the argument if there is one.
    - "store" writes the first argument to the cell `number`, or `number` + the second argument.
    - "call" executes the function `number` of the program, whose arguments and results are in
      memory.

    The last two have no result: `out` is ``None``.
    """

    out: Value | None
    name: str
    arguments: tuple[Value, ...] = ()
    number: int = 0

    blocks = ()


@dataclass
class Branch:
    """Execute one of two blocks; `outs` are the values of the executed one."""

    condition: Value
    outs: list[Value]
    yes: "Block"
    yes_values: list[Value]
    no: "Block"
    no_values: list[Value]

    @property
    def arguments(self) -> tuple[Value, ...]:
        """The values that the branch uses, besides those that its blocks use."""
        return (self.condition, *self.yes_values, *self.no_values)

    @property
    def blocks(self) -> "tuple[Block, Block]":
        """Both blocks."""
        return self.yes, self.no


@dataclass
class Loop:
    """Execute `body` as long as `condition`, computed by `head`, holds.

    `carries` start as `first` and become `following`, computed by the body, at each iteration.
    """

    carries: list[Value]
    first: list[Value]
    head: "Block"
    condition: Value
    body: "Block"
    following: list[Value]

    @property
    def arguments(self) -> tuple[Value, ...]:
        """The values that the loop uses, besides those that its blocks use."""
        return (self.condition, *self.first, *self.following)

    @property
    def blocks(self) -> "tuple[Block, Block]":
        """Both blocks."""
        return self.head, self.body


Entry = Operation | Branch | Loop
Block = list[Entry]
"""Entries in the order of their execution."""


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
    "sqrt": lambda x: math.sqrt(x) if x >= 0.0 else (x if x == 0.0 else math.nan),
    **dict.fromkeys(("int_to_float", "bool_to_float"), float),
    **dict.fromkeys(("bool_to_int", "widen", "narrow"), int),
}
"""Operations that are computed here if all arguments are known, rounded as by the processor."""
_RANGE = {"i": 1 << 63, "w": 1 << 31}


class Operations:
    """Builds the blocks of a program.

    An operation on the same arguments is added once, and none is added whose result is known.

    **Arguments:** `width`: number of lanes, each value being a vector of them; `tangents`: number
    of tangents in a vector of tangents, 0 for none. Such a vector has `packed` elements, the next
    power of two, of which the last ones repeat.
    """

    def __init__(self, width: int = 1, tangents: int = 0):
        assert width == 1 or tangents == 0, "lanes carry no tangents"
        self.width, self.packed_length = width, tangents
        self.packed = 1 << (tangents - 1).bit_length() if tangents else 0
        self.kinds: list[str] = []
        self.constants: dict[Value, Number] = {}
        self.cells = 0
        self.block: Block = []
        self.functions: list[Block] = []
        # The blocks around the functions that are being built, each with the number of its scope.
        self._outside: list[tuple[Block, int]] = []
        # For values that are computed in functions, the number of functions around them.
        self._depths: dict[Value, int] = {}
        # Values by operation and arguments, and the keys that each open block has added: a value
        # can be reused in inner blocks, but not after its block.
        self._known: dict[tuple, Value] = {}
        self._scopes: list[list[tuple]] = [[]]
        self._definitions: dict[Value, tuple[str, tuple[Value, ...]]] = {}
        self._uniform: set[Value] = set()
        self._mask: Value | None = None

    def new(self, kind: str) -> Value:
        """Return a new value, for an entry other than a pure operation."""
        return self._new(kind, len(self._outside))

    def _new(self, kind: str, depth: int) -> Value:
        self.kinds.append(kind)
        value = len(self.kinds) - 1
        if depth:
            self._depths[value] = depth
        return value

    def constant(self, kind: str, number: Number) -> Value:
        """Return the value of a known number."""
        if kind == "f":
            number = float(number)
            # By its bits, since 0.0 == -0.0 and NaN != NaN.
            key = ("constant", "f", struct.pack("d", number))
        else:
            number = bool(number) if kind == "b" else int(number)
            key = ("constant", kind, number)
        value = self._known.get(key)
        if value is None:
            value = self._known[key] = self._new(kind, 0)
            self.constants[value] = number
        return value

    def number(self, value: Value) -> Number | None:
        """Return the number of a constant; ``None`` for a value that only the run determines."""
        return self.constants.get(value)

    def is_uniform(self, value: Value) -> bool:
        """Return whether a value is known to be the same in all lanes."""
        return self.width == 1 or value in self.constants or value in self._uniform

    def mark_uniform(self, value: Value) -> None:
        """Declare a value to be the same in all lanes."""
        self._uniform.add(value)

    def emit(self, name: str, kind: str, *arguments: Value) -> Value:
        """Add a pure operation and return its result."""
        simpler = self._simplified(name, kind, arguments)
        if simpler is not None:
            return simpler
        key = (name, kind, *arguments)
        value = self._known.get(key)
        if value is None:
            block, scope, depth = self.block, -1, len(self._outside)
            if depth:
                # In a function, an operation on values from outside is moved there, so that all
                # calls share its result.
                depth = max(self._depths.get(value, 0) for value in arguments)
                if depth < len(self._outside):
                    block, scope = self._outside[depth]
            value = self._known[key] = self._new(kind, depth)
            self._scopes[scope].append(key)
            self._definitions[value] = name, arguments
            if self.width > 1 and all(map(self.is_uniform, arguments)):
                self._uniform.add(value)
            block.append(Operation(value, name, arguments))
        return value

    def _simplified(self, name: str, kind: str, arguments: tuple[Value, ...]) -> Value | None:
        """Return the result of an operation that can be omitted.

        Every rule holds for all numbers, also for NaN, infinities and negative zeros: x + 0.0 is
        not x, for instance, if x is -0.0.
        """
        known = [self.constants.get(value) for value in arguments]
        if name in _FOLDED and None not in known:
            number = _FOLDED[name](*known)
            if kind in _RANGE:
                half = _RANGE[kind]
                number = (int(number) + half) % (2 * half) - half
            return self.constant(kind, number)
        if name == "select":
            return self._simplified_select(kind, arguments, known)
        if name in ("and", "or") and kind == "b":
            return self._simplified_logic(name, arguments, known)
        if name in ("fneg", "not"):
            return self._negated(arguments[0], name)
        if kind in ("f", "fp") and len(arguments) == 2:
            return self._simplified_float(name, kind, *arguments)
        return None

    def _simplified_float(self, name: str, kind: str, a: Value, b: Value) -> Value | None:
        if name == "fmul":
            for x, other in ((a, b), (b, a)):
                if self._is_all(x, 1.0):
                    return other
                if self._is_all(x, -1.0):
                    return self.emit("fneg", kind, other)
        elif name == "fdiv" and self._is_all(b, 1.0):
            return a
        elif name == "fadd":
            for x, other in ((a, b), (b, a)):
                if self._is_all(x, -0.0):
                    return other
                negated = self._negated(x, "fneg")
                if negated is not None:
                    return self.emit("fsub", kind, other, negated)
        elif name == "fsub":
            if self._is_all(b, 0.0):
                return a
            negated = self._negated(b, "fneg")
            if negated is not None:
                return self.emit("fadd", kind, a, negated)
        return None

    def _simplified_select(
        self, kind: str, arguments: tuple[Value, ...], known: list[Number | None]
    ) -> Value | None:
        condition, yes, no = arguments
        if known[0] is not None:
            return yes if known[0] else no
        if yes == no:
            return yes
        if kind == "b" and known[1] is not None and known[2] is not None:
            return condition if known[1] else self.emit("not", "b", condition)
        return None

    def _simplified_logic(
        self, name: str, arguments: tuple[Value, ...], known: list[Number | None]
    ) -> Value | None:
        if arguments[0] == arguments[1]:
            return arguments[0]
        for k, other in ((0, 1), (1, 0)):
            if known[k] is not None:
                neutral = known[k] if name == "and" else not known[k]
                return arguments[other] if neutral else arguments[k]
        return None

    def repeated_number(self, value: Value) -> Number | None:
        """Return the number of a value, or the number that all elements of a vector have.

        Return ``None`` if the number is unknown until the program runs.
        """
        # A vector with equal elements is made from one value by the operation "splat".
        name, arguments = self._definitions.get(value, ("", ()))
        return self.constants.get(arguments[0] if name == "splat" else value)

    def _is_all(self, value: Value, number: float) -> bool:
        """Return whether a float, or each element of a vector, is known to be a given number.

        0.0 and -0.0 count as different numbers.
        """
        known = self.repeated_number(value)
        return (
            isinstance(known, float)
            and known == number
            and math.copysign(1.0, known) == math.copysign(1.0, number)
        )

    def _negated(self, value: Value, name: str) -> Value | None:
        """Return x if a value was computed as `name`(x), else ``None``.

        **Arguments:** `name`: "fneg" or "not".
        """
        definition, arguments = self._definitions.get(value, ("", ()))
        return arguments[0] if definition == name else None

    # Vectors of tangents.

    def pack(self, values: list[Value]) -> Value:
        """Return the vector of values, one for each tangent."""
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
        """Return the k-th element of a vector of tangents."""
        name, arguments = self._definitions.get(vector, ("", ()))
        if name == "splat":
            return arguments[0]
        if name == "build":
            return arguments[k]
        return self.emit("element", self.kinds[vector][0], vector, self.constant("i", k))

    # Blocks.

    @contextmanager
    def inside(self, block: Block) -> Iterator[Block]:
        """Within the context, append operations to `block` instead.

        Values that are computed there cannot be reused outside of it.
        """
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
        self.cells += cells
        return self.cells - cells

    def load(self, kind: str, start: int, index: Value | None = None) -> Value:
        """Read the cell `start` + `index`, or `start` without an index, as a value of a kind."""
        cell, arguments = self._address(start, index)
        out = self.new(kind)
        self.block.append(Operation(out, "load", arguments, cell))
        return out

    def store(self, value: Value, start: int, index: Value | None = None) -> None:
        """Write a value to the cell `start` + `index`; without an index, to `start`.

        Within `masked`, only lanes in which the condition holds write.
        """
        if self._mask is not None:
            kind = self.kinds[value]
            value = self.emit("select", kind, self._mask, value, self.load(kind, start, index))
        cell, arguments = self._address(start, index)
        self.block.append(Operation(None, "store", (value, *arguments), cell))

    @contextmanager
    def masked(self, condition: Value) -> Iterator[None]:
        """Within the context, only lanes in which a condition holds write to memory."""
        outer = self._mask
        self._mask = condition if outer is None else self.emit("and", "b", outer, condition)
        try:
            yield
        finally:
            self._mask = outer

    def _address(self, start: int, index: Value | None) -> tuple[int, tuple[Value, ...]]:
        """Return the first cell, and the index as a tuple, empty if it is known."""
        known = None if index is None else self.constants.get(index)
        if known is None:
            return start, () if index is None else (index,)
        return start + int(known), ()

    # Functions.

    def function(self, build: Callable[[], None]) -> int:
        """Build a function and return its number, for calls in this block and in inner ones.

        Values from outside that the function uses are written to memory where it is built, and read
        by the function.
        """
        inner, depth = [], len(self._outside)
        self._outside.append((self.block, len(self._scopes) - 1))
        with self.inside(inner), self._unmasked():
            build()
        self._outside.pop()
        loads: list[Entry] = []
        for value in _used(inner):
            if value not in self.constants and self._depths.get(value, 0) <= depth:
                loads.append(Operation(value, "load", (), self.pass_on(value)))
        inner[:0] = loads
        self.functions.append(inner)
        return len(self.functions) - 1

    def is_inside(self, value: Value) -> bool:
        """Return whether a value is computed in the innermost function."""
        return self._depths.get(value, 0) == len(self._outside)

    def call(self, function: int) -> None:
        """Call a function."""
        self.block.append(Operation(None, "call", (), function))

    def pass_on(self, value: Value, cell: int | None = None) -> int:
        """Write a value to a cell, in all lanes, for a function or its caller.

        Returns the cell, which is a new one unless given. The mask is ignored: a function computes
        in all lanes.
        """
        if cell is None:
            cell = self.allocate_for(self.kinds[value])
        self.block.append(Operation(None, "store", (value,), cell))
        return cell

    def allocate_for(self, kind: str) -> int:
        """Reserve cells for a value of a kind and return the first one."""
        return self.allocate(self.packed if kind.endswith("p") else 1)

    @contextmanager
    def _unmasked(self) -> Iterator[None]:
        outer, self._mask = self._mask, None
        try:
            yield
        finally:
            self._mask = outer

    def branch(
        self,
        condition: Value,
        yes: Callable[[], list[Value]],
        no: Callable[[], list[Value]],
    ) -> list[Value]:
        """Add a branch and return its values; `yes` and `no` build the two blocks."""
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
        """Add a loop and return its carries after the last iteration."""
        carries = [self.new(self.kinds[value]) for value in first]
        head, inner = [], []
        with self.inside(head):
            condition = holds(carries)
        with self.inside(inner):
            following = body(carries)
        self.block.append(Loop(carries, first, head, condition, inner, following))
        return carries

    def repeat(self, count: int, visit: Callable[[Value], None]) -> None:
        """Add a loop whose body `visit` builds for the indices 0 to `count` - 1."""

        def holds(carries: list[Value]) -> Value:
            self.mark_uniform(carries[0])
            return self.emit("ilt", "b", carries[0], end)

        def body(carries: list[Value]) -> list[Value]:
            visit(carries[0])
            return [self.emit("add", "i", carries[0], self.constant("i", 1))]

        zero, end = self.constant("i", 0), self.constant("i", count)
        self.loop([zero], holds, body)


def _used(block: Block) -> dict[Value, None]:
    """Return the values that the entries of a block use, in order of their first use."""
    used: dict[Value, None] = {}
    for entry in block:
        used.update(dict.fromkeys(entry.arguments))
        for inner in entry.blocks:
            used.update(_used(inner))
    return used
