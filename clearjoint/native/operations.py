"""Operations on scalars: what a jaxpr becomes before it is written in LLVM's language.

A value is a number (its index). Each value has a kind: ``f`` float64, ``i`` int64, ``w`` int32,
``b`` bool; with ``p`` behind it, a vector of tangents of that kind, which is kept as one value.
Operations are pure and stand in blocks; loops and branches are entries of a block that hold blocks
of their own.
"""

import math
import operator
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

Value = int
Number = float | int | bool
KINDS = {"float64": "f", "int64": "i", "int32": "w", "bool": "b", "uint32": "i"}
"""Kinds by the names of dtypes. Results of arithmetic on uint32 are cut to their 32 bits."""


@dataclass
class Operation:
    """A pure operation: `out` = name(arguments)."""

    out: Value
    name: str
    arguments: tuple[Value, ...]


@dataclass
class LoadCell:
    """Read the cell `start` + `index`, unless the index is ``None``."""

    out: Value
    start: int
    index: Value | None


@dataclass
class StoreCell:
    """Write a value to the cell `start` + `index`, unless the index is ``None``."""

    value: Value
    start: int
    index: Value | None


@dataclass
class Branch:
    """Carry out one of two blocks; `outs` are the values of the block that was carried out."""

    condition: Value
    outs: list[Value]
    yes: "Block"
    yes_values: list[Value]
    no: "Block"
    no_values: list[Value]


@dataclass
class Loop:
    """Carry out `body` as long as `condition`, computed by `head`, holds.

    `carries` start as `first` and go on as `following`, computed by the body.
    """

    carries: list[Value]
    first: list[Value]
    head: "Block"
    condition: Value
    body: "Block"
    following: list[Value]


@dataclass
class Call:
    """Carry out a function of the program, which reads and writes memory."""

    function: int


Entry = Operation | LoadCell | StoreCell | Branch | Loop | Call


@dataclass
class Block:
    """Entries in the order in which they are carried out."""

    entries: list[Entry] = field(default_factory=list)


def _divided(a: float, b: float) -> float:
    with np.errstate(all="ignore"):
        return float(np.float64(a) / np.float64(b))


_COMPARED = {
    "lt": operator.lt,
    "le": operator.le,
    "gt": operator.gt,
    "ge": operator.ge,
    "eq": operator.eq,
    "ne": operator.ne,
}
_FOLDED: dict[str, Callable] = {
    "fadd": operator.add,
    "fsub": operator.sub,
    "fmul": operator.mul,
    "fdiv": _divided,
    "fneg": operator.neg,
    "sqrt": lambda x: math.sqrt(x) if x >= 0.0 else (x if x == 0.0 else math.nan),
    "abs": abs,
    "add": operator.add,
    "sub": operator.sub,
    "mul": operator.mul,
    "and": operator.and_,
    "or": operator.or_,
    "xor": operator.xor,
    "int_to_float": float,
    "bool_to_int": int,
    "int_to_bool": lambda x: x != 0,
    "float_to_bool": lambda x: x != 0.0,
    "bool_to_float": float,
    "widen": int,
    "narrow": int,
    **{f"f{name}": compare for name, compare in _COMPARED.items()},
    **{f"i{name}": compare for name, compare in _COMPARED.items()},
}
"""Operations that are carried out at once where all arguments are known; each rounds as the
machine does."""
_RANGE = {"i": 1 << 63, "w": 1 << 31}


class Operations:
    """Builds blocks of operations: none twice, and none whose result is known beforehand.

    **Arguments:** `width`: number of lanes that each value has side by side; `tangents`: number of
    tangents that vectors hold, 0 for none. Vectors have the next power of two of elements
    (`packed`), of which the last ones repeat.
    """

    def __init__(self, width: int = 1, tangents: int = 0):
        assert width == 1 or tangents == 0, "lanes carry no tangents"
        self.width, self.packed_length = width, tangents
        self.packed = 1 << (tangents - 1).bit_length() if tangents else 0
        self.kinds: list[str] = []
        self.constants: dict[Value, Number] = {}
        self.cells = 0
        self.block = Block()
        self.functions: list[Block] = []
        self._outside: list[tuple[Block, int]] = []
        self._depths: dict[Value, int] = {}
        self._known: dict[tuple, Value] = {}
        self._scopes: list[list[tuple]] = [[]]
        self._made: dict[Value, tuple[str, tuple[Value, ...]]] = {}
        self._uniform: set[Value] = set()
        self._mask: Value | None = None

    def new(self, kind: str) -> Value:
        """A value that something else than a pure operation computes."""
        return self._new(kind, len(self._outside))

    def _new(self, kind: str, depth: int) -> Value:
        """A value that is computed in so many functions, one inside the other."""
        self.kinds.append(kind)
        value = len(self.kinds) - 1
        if depth:
            self._depths[value] = depth
        return value

    def constant(self, kind: str, number: Number) -> Value:
        """The value of a known number."""
        if kind == "f":
            number = float(number)
            key = ("constant", "f", struct.pack("d", number))
        else:
            number = bool(number) if kind == "b" else int(number)
            key = ("constant", kind, number)
        found = self._known.get(key)
        if found is None:
            found = self._known[key] = self._new(kind, 0)  # of all scopes
            self.constants[found] = number
        return found

    def number(self, value: Value) -> Number | None:
        """The number of a known value, else ``None``."""
        return self.constants.get(value)

    def is_uniform(self, value: Value) -> bool:
        """Whether a value is known to be the same in all lanes."""
        return self.width == 1 or value in self.constants or value in self._uniform

    def mark_uniform(self, value: Value) -> None:
        """Say that a value is the same in all lanes."""
        self._uniform.add(value)

    def is_float(self, value: Value, number: float) -> bool:
        """Whether a value is known to be a number; positive and negative zero differ."""
        known = self.constants.get(value)
        return (
            isinstance(known, float)
            and known == number
            and math.copysign(1.0, known) == math.copysign(1.0, number)
        )

    def do(self, name: str, kind: str, *arguments: Value) -> Value:
        """The result of a pure operation."""
        simpler = self._simplified(name, kind, arguments)
        if simpler is not None:
            return simpler
        key = (name, kind, *arguments)
        found = self._known.get(key)
        if found is None:
            block, scope, depth = self.block, -1, len(self._outside)
            if depth:
                depth = max(self._depths.get(value, 0) for value in arguments)
                if depth < len(self._outside):
                    block, scope = self._outside[depth]
            found = self._known[key] = self._new(kind, depth)
            self._scopes[scope].append(key)
            self._made[found] = name, arguments
            if self.width > 1 and all(map(self.is_uniform, arguments)):
                self._uniform.add(found)
            block.entries.append(Operation(found, name, arguments))
        return found

    def _simplified(self, name: str, kind: str, arguments: tuple[Value, ...]) -> Value | None:
        """The result if no operation is needed, by rules that hold for all numbers, NaN among
        them."""
        constants = self.constants
        known = [constants.get(value) for value in arguments]
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
        if kind not in ("f", "fp") or len(arguments) != 2:
            return self._simplified_one(name, arguments)
        a, b = arguments
        if name == "fmul":
            for one, other in ((a, b), (b, a)):
                if self._is_all(one, 1.0):
                    return other
                if self._is_all(one, -1.0):
                    return self.do("fneg", kind, other)
        elif name == "fdiv" and self._is_all(b, 1.0):
            return a
        elif name == "fadd":
            for one, other in ((a, b), (b, a)):
                if self._is_all(one, -0.0):
                    return other
                if self._made_by(one, "fneg"):
                    return self.do("fsub", kind, other, self._made[one][1][0])
        elif name == "fsub":
            if self._is_all(b, 0.0):
                return a
            if self._made_by(b, "fneg"):
                return self.do("fadd", kind, a, self._made[b][1][0])
        return None

    def repeated_number(self, value: Value) -> Number | None:
        """The number that a value, or each tangent of a vector, is known to be, else ``None``."""
        return self.constants.get(self._splatted(value))

    def _splatted(self, value: Value) -> Value:
        return self._made[value][1][0] if self._made_by(value, "splat") else value

    def _is_all(self, value: Value, number: float) -> bool:
        """Whether a float, or all tangents of a vector, are known to be a number."""
        return self.is_float(self._splatted(value), number)

    def _made_by(self, value: Value, name: str) -> bool:
        made = self._made.get(value)
        return made is not None and made[0] == name

    def _simplified_one(self, name: str, arguments: tuple[Value, ...]) -> Value | None:
        (a, *_) = arguments
        if name in ("fneg", "not") and self._made_by(a, name):
            return self._made[a][1][0]
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
            return condition if known[1] else self.do("not", "b", condition)
        return None

    def _simplified_logic(
        self, name: str, arguments: tuple[Value, ...], known: list[Number | None]
    ) -> Value | None:
        a, b = arguments
        if a == b:
            return a
        for one, other in ((0, 1), (1, 0)):
            if known[one] is not None:
                neutral = known[one] if name == "and" else not known[one]
                return arguments[other] if neutral else arguments[one]
        return None

    # Vectors of tangents.

    def pack(self, values: list[Value]) -> Value:
        """The vector of as many values as there are tangents."""
        kind = self.kinds[values[0]]
        made = self._made.get(values[0])
        if made is not None and made[0] == "element":
            vector = made[1][0]
            if all(self.element(vector, k) == value for k, value in enumerate(values)):
                return vector
        if all(value == values[0] for value in values):
            return self.do("splat", f"{kind}p", values[0])
        return self.do("build", f"{kind}p", *values)

    def element(self, vector: Value, k: int) -> Value:
        """The k-th element of a vector of tangents."""
        made = self._made.get(vector)
        if made is not None and made[0] == "splat":
            return made[1][0]
        if made is not None and made[0] == "build":
            return made[1][k]
        return self.do("element", self.kinds[vector][0], vector, self.constant("i", k))

    # Blocks.

    @contextmanager
    def inside(self, block: Block) -> Iterator[Block]:
        """Build in another block, whose values are not known outside."""
        outer, self.block = self.block, block
        self._scopes.append([])
        try:
            yield block
        finally:
            for key in self._scopes.pop():
                del self._known[key]
            self.block = outer

    def allocate(self, cells: int) -> int:
        """The first of so many new cells of memory."""
        self.cells += cells
        return self.cells - cells

    def load(self, kind: str, start: int, index: Value | None = None) -> Value:
        """The content of a cell."""
        start, index = self._address(start, index)
        out = self.new(kind)
        self.block.entries.append(LoadCell(out, start, index))
        return out

    def store(self, value: Value, start: int, index: Value | None = None) -> None:
        """Write a value to a cell, in the lanes that a mask leaves."""
        start, index = self._address(start, index)
        if self._mask is not None:
            kind = self.kinds[value]
            value = self.do("select", kind, self._mask, value, self.load(kind, start, index))
        self.block.entries.append(StoreCell(value, start, index))

    @contextmanager
    def masked(self, condition: Value) -> Iterator[None]:
        """A context in which only the lanes for which a condition holds write to memory."""
        outer = self._mask
        self._mask = condition if outer is None else self.do("and", "b", outer, condition)
        try:
            yield
        finally:
            self._mask = outer

    def _address(self, start: int, index: Value | None) -> tuple[int, Value | None]:
        known = None if index is None else self.constants.get(index)
        return (start, index) if known is None else (start + int(known), None)

    # Functions, whose arguments and results are in memory.

    def function(self, build: Callable[[], None]) -> int:
        """The number of a function, to be called in this block and in those inside.

        It finds values from outside in memory. Operations on them alone are carried out outside,
        once for all calls.
        """
        inner, depth = Block(), len(self._outside)
        self._outside.append((self.block, len(self._scopes) - 1))
        with self.inside(inner), self._unmasked():
            build()
        self._outside.pop()
        given: list[Entry] = []
        for value in _used(inner):
            if value not in self.constants and self._depths.get(value, 0) <= depth:
                given.append(LoadCell(value, self.pass_on(value), None))
        inner.entries[:0] = given
        self.functions.append(inner)
        return len(self.functions) - 1

    def is_inside(self, value: Value) -> bool:
        """Whether a value is computed in the innermost function."""
        return self._depths.get(value, 0) == len(self._outside)

    def call(self, function: int) -> None:
        """Carry out a function."""
        self.block.entries.append(Call(function))

    def pass_on(self, value: Value, cell: int | None = None) -> int:
        """The first cell of a value that is written to memory in all lanes; a new one unless
        given."""
        if cell is None:
            cell = self.allocate_for(self.kinds[value])
        self.block.entries.append(StoreCell(value, cell, None))
        return cell

    def allocate_for(self, kind: str) -> int:
        """The first of new cells for a value of a kind."""
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
        """The values of one of two functions, each of which builds a block."""
        blocks, values = (Block(), Block()), []
        for block, build in zip(blocks, (yes, no), strict=True):
            with self.inside(block):
                values.append(build())
        outs = [self.new(self.kinds[value]) for value in values[0]]
        self.block.entries.append(
            Branch(condition, outs, blocks[0], values[0], blocks[1], values[1])
        )
        return outs

    def loop(
        self,
        first: list[Value],
        holds: Callable[[list[Value]], Value],
        body: Callable[[list[Value]], list[Value]],
    ) -> list[Value]:
        """Values that start as the first ones and go on by `body` as long as `holds` is true."""
        carries = [self.new(self.kinds[value]) for value in first]
        head, inner = Block(), Block()
        with self.inside(head):
            condition = holds(carries)
        with self.inside(inner):
            following = body(carries)
        self.block.entries.append(Loop(carries, first, head, condition, inner, following))
        return carries

    def repeat(self, count: int, visit: Callable[[Value], None]) -> None:
        """Build a block that is carried out for each number from zero to a count."""

        def holds(carries: list[Value]) -> Value:
            self.mark_uniform(carries[0])
            return self.do("ilt", "b", carries[0], end)

        def body(carries: list[Value]) -> list[Value]:
            visit(carries[0])
            return [self.do("add", "i", carries[0], self.constant("i", 1))]

        zero, end = self.constant("i", 0), self.constant("i", count)
        self.loop([zero], holds, body)


def _used(block: Block) -> list[Value]:
    """The values that a block takes as arguments, those made in it among them."""
    found: dict[Value, None] = {}

    def add(*values: Value | None) -> None:
        found.update((value, None) for value in values if value is not None)

    for entry in block.entries:
        if isinstance(entry, Operation):
            add(*entry.arguments)
        elif isinstance(entry, LoadCell):
            add(entry.index)
        elif isinstance(entry, StoreCell):
            add(entry.value, entry.index)
        elif isinstance(entry, Branch):
            inside = _used(entry.yes), _used(entry.no)
            add(entry.condition, *entry.yes_values, *entry.no_values, *inside[0], *inside[1])
        elif isinstance(entry, Loop):
            inside = _used(entry.head), _used(entry.body)
            add(entry.condition, *entry.first, *entry.following, *inside[0], *inside[1])
    return list(found)
