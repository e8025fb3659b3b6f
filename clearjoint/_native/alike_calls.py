"""Calls of one function for many elements, computed together by vectors of the processor.

A program calls a function for each element of a kind, such as the contacts of thirty joints. Calls
that do not depend on each other are joined, `CALLS_AT_ONCE` of them to one call of a function whose
values are vectors with an element for each call. Its operations are those of the original function,
so that the results have the same bits.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator

from .operations import Block, Operation, Operations, Value
from .pieces import cells_written

CALLS_AT_ONCE = 8
"""Largest number of calls that are joined: the floats of a vector of 512 bits."""
FEWEST = 3
"""Smallest number of calls that are joined. A call for vectors takes up to twice the time of a
single one, and its arguments must be joined before and its results taken apart after."""


def join_alike_calls(program: Operations, fixed: Iterable[int] = ()) -> None:
    """Join the calls in all blocks of a program.

    **Arguments:** `fixed`: cells of memory that must stay where they are, because the caller of the
    program writes or reads them.
    """
    _Joining(program, set(fixed)).all()


class _Joining:
    """Joins the calls of a program."""

    def __init__(self, program: Operations, fixed: set[int]):
        self._program, self._fixed = program, fixed
        # Cells to which the function whose blocks are read writes, or those that it calls.
        self._written = set[int]()
        # Cells that have moved next to each other, by their former numbers.
        self._moved: dict[int, int] = {}
        # Loads of the function whose blocks are read, by their results.
        self._loads: dict[Value, Operation] = {}

    def all(self) -> None:
        """Join the calls in all blocks."""
        program = self._program
        blocks = [*program.functions, program.block]
        by_functions: list[set[int]] = []
        for number, block in enumerate(blocks):
            self._written = cells_written(program, block, by_functions)
            by_functions.append(self._written)
            # Functions of vectors contain no calls that could be joined further.
            if program.width_of(number) == 1:
                self._loads = {}
                self._inside(block)
        for block in blocks:
            self._move(block)

    def _inside(self, block: Block) -> None:
        """Join calls between which no branch or loop stands, in a block and in those inside it."""
        new: Block = []
        sequence: list[Operation] = []
        for entry in block:
            if isinstance(entry, Operation):
                sequence.append(entry)
                if entry.name == "load" and not entry.arguments and entry.out is not None:
                    self._loads[entry.out] = entry
                continue
            new += self._joined(sequence)
            sequence = []
            for inner in entry.blocks:
                self._inside(inner)
            new.append(entry)
        block[:] = [*new, *self._joined(sequence)]

    def _joined(self, sequence: list[Operation]) -> list[Operation]:
        """Return a sequence of operations with its calls joined.

        The level of an operation is the largest number of calls on a way that leads to it, from a
        result of one to an argument of the next. Calls on the same level don't depend on each
        other. The operations are executed in the order of their levels.
        """
        program = self._program
        levels: dict[Value, int] = {}
        by_level: dict[int, list[Operation]] = defaultdict(list)
        calls: dict[tuple[int, int], list[Operation]] = defaultdict(list)
        # Levels of the latest access of memory, and of the latest write, which keep their order.
        accessed = written = 0
        for operation in sequence:
            name = operation.name
            level = max([levels.get(value, 0) for value in operation.arguments], default=0)
            if name == "load":
                level = max(level, written)
                accessed = max(accessed, level)
            elif name in ("store", "call"):
                level = accessed = written = max(level, accessed)
            elif name == "evaluate":
                function = int(program.constants[operation.arguments[0]])
                if function in program.of_vectors:
                    level += 1
                    calls[level, function].append(operation)
            by_level[level].append(operation)
            if operation.out is not None:
                levels[operation.out] = level
        if all(len(together) < FEWEST for together in calls.values()):
            return sequence
        # Calls that are joined, by their results: the call for all, and the place in its vectors.
        places: dict[Value | None, tuple[Operation, int]] = {}
        vectors: dict[tuple[Value | None, Value], Value] = {}
        new: list[Operation] = []
        for level in sorted(by_level):
            for (at, function), together in calls.items():
                for part in _parts(together) if at == level else ():
                    *arguments, call = self._together(program.of_vectors[function], part)
                    new += [*arguments, call]
                    places |= {each.out: (call, place) for place, each in enumerate(part)}
            for operation in by_level[level]:
                if operation.name == "result" and operation.arguments[0] in places:
                    new += self._taken_apart(operation, *places[operation.arguments[0]], vectors)
                elif operation.out not in places:
                    new.append(operation)
        return new

    def _together(self, function: int, calls: list[Operation]) -> Iterator[Operation]:
        """Yield the operations that join the arguments of calls, and the call of the function of
        vectors with the number `function`."""
        program = self._program
        arguments: list[Value] = [program.constant("i", function)]
        for values in zip(*(call.arguments[1:] for call in calls), strict=True):
            arguments.append(program.new(f"{program.kinds[values[0]]}v"))
            start = self._next_to_each_other(values)
            if start is not None:
                yield Operation(arguments[-1], "load", (), start)
            elif all(value == values[0] for value in values):
                yield Operation(arguments[-1], "splat", values[:1])
            else:
                yield Operation(arguments[-1], "build", values)
        yield Operation(program.new("results"), "evaluate", tuple(arguments))

    def _next_to_each_other(self, values: tuple[Value, ...]) -> int | None:
        """Move the cells from which values are read next to each other, and return the first one;
        ``None`` if they are not all read from cells, or if the cells can't be moved.

        A function receives values from outside, such as the parameters of elements, in cells. It
        reads those of all calls at once if they are next to each other. Cells to which the function
        writes stay: a write may stand between the first read and the call, as that of results by
        the next call of the function that has left them there.
        """
        program = self._program
        if len(values) < CALLS_AT_ONCE or not all(value in self._loads for value in values):
            return None
        cells = [self._loads[value].number for value in values]
        free = set(cells) - self._fixed - self._written - self._moved.keys()
        if len(free) < len(cells) or any(len(program.allocated_with(cell)) > 1 for cell in cells):
            return None
        start = program.allocate(len(cells))
        self._moved |= {cell: start + place for place, cell in enumerate(cells)}
        return start

    def _taken_apart(
        self,
        result: Operation,
        call: Operation,
        place: int,
        vectors: dict[tuple[Value | None, Value], Value],
    ) -> Iterator[Operation]:
        """Yield the operations that take the result of a call from the vector of the results of
        all, which is read once."""
        program, number = self._program, result.arguments[2]
        assert result.out is not None and call.out is not None
        vector = vectors.get((call.out, number))
        if vector is None:
            vector = program.new(f"{program.kinds[result.out]}v")
            vectors[call.out, number] = vector
            yield Operation(vector, "result", (call.out, call.arguments[0], number))
        yield Operation(result.out, "element", (vector, program.constant("i", place)))

    def _move(self, block: Block) -> None:
        """Let operations read and write the cells that have moved at their new places."""
        for entry in block:
            if isinstance(entry, Operation) and entry.name in ("load", "store"):
                entry.number = self._moved.get(entry.number, entry.number)
            for inner in entry.blocks:
                self._move(inner)


def _parts(calls: list[Operation]) -> Iterator[list[Operation]]:
    """Yield groups of up to `CALLS_AT_ONCE` calls, without the last ones if they are too few."""
    for start in range(0, len(calls), CALLS_AT_ONCE):
        if len(calls) - start >= FEWEST:
            yield calls[start : start + CALLS_AT_ONCE]
