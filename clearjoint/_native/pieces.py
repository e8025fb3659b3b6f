"""Division of long programs into pieces, so that LLVM's time is proportional to their length.

LLVM allocates registers for all values of a function together, and searches lists of its
instructions, so that its time grows with the square of the length: for a chain of 100 joints, it
was 39 s. Values pass from one piece to another through memory, where most of them would be anyway,
because the processor has registers for few of them.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from dataclasses import dataclass

from .operations import Block, Operation, Operations, Value, walked

FEWEST = 40_000
"""Number of operations from which on a program is divided. With 24 000, for a chain of 30 joints
with backlash, the exchange of values costs as much time of compilation as division saves."""
LONGEST = 1500
"""Largest number of operations in a row, without branches and loops, that are not divided."""
LENGTH = 250
"""Number of operations of a piece."""


# An entry in the place of a sequence that has been divided, until calls of its pieces replace it.
@dataclass
class _Pieces:
    numbers: range


class Division:
    """Divides the long sequences of operations of a function into pieces.

    - `pieces`: operations of each piece, by the `number` of the operations "call" that execute it.

    **Arguments:** `ordered`: returns operations in the order in which they shall be executed;
    `needed`: returns the values that an operation uses; `first`: number of the first piece;
    `written`: cells to which the function, and the functions that it calls, may write.
    """

    def __init__(
        self,
        program: Operations,
        ordered: Callable[[list[Operation]], list[Operation]],
        needed: Callable[[Operation], Iterable[Value]],
        first: int,
        written: Set[int],
    ):
        self._program, self._ordered, self._needed = program, ordered, needed
        self._first, self._written = first, written
        self.pieces: dict[int, list[Operation]] = {}
        # For values that are used, the pieces that use them; `None` stands for what is not divided.
        self._users: dict[Value, set[int | None]] = {}
        # The piece that computes a value, and the cell by which a value passes to other pieces.
        self._definers: dict[Value, int] = {}
        self._cells: dict[Value, int] = {}
        # Values that are read from cells which do not change, so that every piece can read them.
        self._unchanged: dict[Value, int] = {}

    def divide(self, block: Block) -> None:
        """Replace long sequences in a block by calls of pieces."""
        # A `_Pieces` stands for each long sequence until `_call` replaces it by calls of pieces.
        self._cut(block)
        if not self.pieces:
            return
        for number, piece in self.pieces.items():
            for operation in piece:
                if operation.out is not None:
                    self._definers[operation.out] = number
        # A value needs a cell unless only the piece that computes it uses it. The cell from which a
        # value is loaded serves if it does not change.
        for value, users in self._users.items():
            if value not in self._program.constants and users != {self._definers.get(value)}:
                cell = self._unchanged.get(value)
                kind = self._program.kinds[value]
                self._cells[value] = self._program.allocate_for(kind) if cell is None else cell
        for number, piece in self.pieces.items():
            piece[:] = list(self._with_exchange(number, piece))
        self._call(block)

    def _cut(self, block: Block) -> None:
        # Replace each sequence that is too long, also in inner blocks, by `_Pieces`.
        new, sequence = [], []

        # Keep the sequence that has ended, or replace it, and begin an empty one. Note which piece
        # uses which values; `None` stands for operations outside the pieces.
        def end() -> None:
            if len(sequence) <= LONGEST:
                self._use(None, sequence)
                new.extend(sequence)
            else:
                start = self._first + len(self.pieces)
                for number, piece in enumerate(_parts(self._ordered(sequence)), start):
                    self.pieces[number] = piece
                    self._use(number, piece)
                new.append(_Pieces(range(start, self._first + len(self.pieces))))
            sequence.clear()

        for entry in block:
            if isinstance(entry, Operation):
                sequence.append(entry)
                continue
            end()
            for value in entry.arguments:
                self._users.setdefault(value, set()).add(None)
            for inner in entry.blocks:
                self._cut(inner)
            new.append(entry)
        # The sequence at the end of the block.
        end()
        block[:] = new

    def _use(self, user: int | None, operations: list[Operation]) -> None:
        # Record what the operations of a piece, or of what is not divided (`None`), use and read.
        for operation in operations:
            for value in self._needed(operation):
                self._users.setdefault(value, set()).add(user)
            cell, out = operation.number, operation.out
            if out is None or operation.name != "load" or operation.arguments:
                continue
            if self._written.isdisjoint(cells_of(self._program, out, cell)):
                self._unchanged[out] = cell

    def _with_exchange(self, number: int, piece: list[Operation]) -> Iterator[Operation]:
        """Yield the operations of a piece, with a read of each value from outside right before the
        value's first use, and a write of each value that operations outside of the piece use."""
        loaded = set[Value]()
        for operation in piece:
            for value in self._needed(operation):
                if (
                    value in self._cells
                    and value not in loaded
                    and self._definers.get(value) != number
                ):
                    loaded.add(value)
                    yield Operation(value, "load", (), self._cells[value])
            yield operation
            if operation.out in self._cells and operation.out not in self._unchanged:
                yield Operation(None, "store", (operation.out,), self._cells[operation.out])

    def _call(self, block: Block) -> None:
        """Replace each `_Pieces` in a block by calls of its pieces. Before the calls, values from
        outside that pieces use are written; after the calls, values that pieces have computed for
        undivided operations are read."""
        new: Block = []
        for entry in block:
            if not isinstance(entry, _Pieces):
                for inner in entry.blocks:
                    self._call(inner)
                new.append(entry)
                continue
            numbers = entry.numbers
            # Not written here: values that a piece computes, since it writes them itself, and
            # values loaded from unchanged cells, which the pieces read from the same cells.
            for value, cell in self._cells.items():
                if value in self._definers or value in self._unchanged:
                    continue
                if not self._users[value].isdisjoint(numbers):
                    new.append(Operation(None, "store", (value,), cell))
            new += [Operation(None, "call", (), number) for number in numbers]
            # Among the users of a value, `None` stands for operations outside the pieces.
            for value, cell in self._cells.items():
                if self._definers.get(value) in numbers and None in self._users[value]:
                    new.append(Operation(value, "load", (), cell))
        block[:] = new


def count_operations(block: Block) -> int:
    return sum(1 for _ in walked(block))


def cells_of(program: Operations, value: Value, start: int) -> range:
    return range(start, start + program.cells_of(program.kinds[value]))


def cells_written(program: Operations, block: Block, by_functions: Sequence[Set[int]]) -> set[int]:
    """Return the cells to which a block may write. `by_functions` has, for each function that the
    block may call, the cells to which the function may write."""
    cells = set[int]()
    for entry in walked(block):
        if not isinstance(entry, Operation):
            continue
        if entry.name == "call":
            cells |= by_functions[entry.number]
        elif entry.name == "store":
            value, *index = entry.arguments
            # An index does not lead out of an array.
            start = entry.number
            cells.update(
                program.allocated_with(start) if index else cells_of(program, value, start)
            )
    return cells


def _parts(operations: list[Operation]) -> Iterator[list[Operation]]:
    """Yield parts of about `LENGTH` operations. The operations "result", which take single values
    out of a call "evaluate", are moved right after it: only such values can pass to other parts."""
    results: dict[Value, list[Operation]] = {}
    for operation in operations:
        if operation.name == "result":
            results.setdefault(operation.arguments[0], []).append(operation)
    part: list[Operation] = []
    for operation in operations:
        if operation.name != "result":
            part.append(operation)
        if operation.name == "evaluate" and operation.out is not None:
            part += results[operation.out]
        if len(part) >= LENGTH:
            yield part
            part = []
    if part:
        yield part
