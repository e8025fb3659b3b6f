"""Calls of one function for many elements, computed together by vectors of the processor.

A program calls a function for each element of a kind, such as the contacts of thirty joints. Up to
`CALLS_AT_ONCE` calls that do not depend on each other become one call of a function of vectors,
which have an element for each call. The operations of this function are those of the original one,
so that the results have the same bits. For three contacts with the parameters p, q and r::

    a = evaluate f(p)           v = build(p, q, r)
    b = evaluate f(q)           w = evaluate f_of_vectors(v)
    c = evaluate f(r)           a, b, c = element(w, 0), element(w, 1), element(w, 2)
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator

from .operations import Block, Operation, Operations, Value, walked
from .pieces import cells_written

CALLS_AT_ONCE = 8
"""Largest number of calls that are joined: the number of floats in a vector of 512 bits."""
FEWEST = 3
"""Smallest number of calls that are joined, since making vectors of the arguments and taking
results apart costs time. The number is a guess: scenes have functions for four elements or more."""


def join_alike_calls(program: Operations, fixed: Iterable[int] = ()) -> None:
    """Join the calls in all blocks of a program. Values in the cells with the indices `fixed` are
    not moved to other cells, since the caller of the program writes or reads them."""
    _Joining(program, set(fixed)).join_all()


class _Joining:
    def __init__(self, program: Operations, fixed: set[int]):
        self._program, self._fixed = program, fixed
        # Cells to which the function that is being read writes, or a function that it calls.
        self._written = set[int]()
        # New numbers of cells that have moved next to each other, by their former numbers.
        self._moved: dict[int, int] = {}
        # Vectors of results that have been read, by the value of the joined call and that of the
        # result's index.
        self._vectors: dict[tuple[Value, Value], Value] = {}
        # Loads of single cells in the function that is being read, by their results.
        self._loads: dict[Value, Operation] = {}

    def join_all(self) -> None:
        program = self._program
        blocks = [*program.functions, program.block]
        # The cells that each function writes, for the blocks after it, which may call it.
        by_functions: list[set[int]] = []
        for number, block in enumerate(blocks):
            # `_join_block` moves cells of arguments next to each other, so that one load reads a
            # vector of them. It moves only cells whose loads it has noted in `_loads`, and none
            # that the block writes (`_written`).
            self._written = cells_written(program, block, by_functions)
            by_functions.append(self._written)
            # Functions of vectors contain no calls that could be joined further.
            if program.width_of(number) == 1:
                self._loads = {}
                self._join_block(block)
        for block in blocks:
            # Any block may read or write cells that have moved: give it their new numbers.
            for entry in walked(block):
                if isinstance(entry, Operation) and entry.name in ("load", "store"):
                    entry.number = self._moved.get(entry.number, entry.number)

    def _join_block(self, block: Block) -> None:
        """Join calls in a block, and in those inside it, but not across branches and loops."""
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
                self._join_block(inner)
            new.append(entry)
        block[:] = [*new, *self._joined(sequence)]

    def _joined(self, sequence: list[Operation]) -> list[Operation]:
        """Return a sequence of operations, without branches and loops, with its calls joined.

        The level of an operation is the largest number of calls, including itself, on any chain of
        operations that lead to it by their results. Calls on the same level do not depend on each
        other. The operations are executed in the order of their levels.
        """
        program = self._program
        levels: dict[Value, int] = {}
        by_level: dict[int, list[Operation]] = defaultdict(list)
        calls: dict[tuple[int, int], list[Operation]] = defaultdict(list)
        # Levels of the latest access of memory and of the latest write. A read stays after the
        # writes before it, and a write after all accesses before it.
        accessed = written = 0
        for operation in sequence:
            name = operation.name
            level = max([levels.get(value, 0) for value in operation.arguments], default=0)
            if name == "load":
                level = max(level, written)
                accessed = max(accessed, level)
            elif name in ("store", "call"):  # a called function takes its arguments from memory
                level = accessed = written = max(level, accessed)
            elif name == "evaluate":  # a call that exchanges values only
                function = int(program.constants[operation.arguments[0]])
                if function in program.of_vectors:
                    level += 1
                    calls[level, function].append(operation)
            by_level[level].append(operation)
            if operation.out is not None:
                levels[operation.out] = level
        if all(len(alike) < FEWEST for alike in calls.values()):
            return sequence
        # Calls that are joined, by their results: the call for all, and the place in its vectors.
        places: dict[Value | None, tuple[Operation, int]] = {}
        new: list[Operation] = []
        for level in sorted(by_level):
            # The joined calls come first on their level, since their arguments have lower levels.
            for (level_of_calls, function), alike in calls.items():
                if level_of_calls != level:
                    continue
                for group in _groups(alike):
                    *vectors, call = self._call_of_vectors(program.of_vectors[function], group)
                    new += [*vectors, call]
                    places |= {single.out: (call, place) for place, single in enumerate(group)}
            for operation in by_level[level]:
                # An operation "result" reads one result of the call that is its first argument.
                if operation.name == "result" and operation.arguments[0] in places:
                    new += self._element_for(operation, *places[operation.arguments[0]])
                elif operation.out not in places:
                    new.append(operation)
        return new

    def _call_of_vectors(self, function: int, calls: list[Operation]) -> Iterator[Operation]:
        """Yield the operations that make vectors of the arguments of calls, and last the call of
        the function of vectors with the index `function`."""
        program = self._program
        arguments: list[Value] = [program.constant("i", function)]
        # `values` are those of one argument in all calls; the first argument is the function.
        for values in zip(*(call.arguments[1:] for call in calls), strict=True):
            arguments.append(program.new(f"{program.kinds[values[0]]}v"))
            start = self._next_to_each_other(values)
            # One load, or one value for all elements, costs less than putting elements together.
            if start is not None:
                yield Operation(arguments[-1], "load", (), start)
            elif all(value == values[0] for value in values):
                yield Operation(arguments[-1], "splat", values[:1])
            else:
                yield Operation(arguments[-1], "build", values)
        yield Operation(program.new("results"), "evaluate", tuple(arguments))

    def _next_to_each_other(self, values: tuple[Value, ...]) -> int | None:
        """Move the cells from which `values` are read next to each other, so that one load reads
        all of them, and return the first cell. If any value is not read from a cell that can be
        moved, move none and return ``None``. Cells that can be moved hold values from outside of
        the function that reads them, such as parameters of elements."""
        program = self._program
        # A load of a vector reads `CALLS_AT_ONCE` cells, so it serves no smaller group of calls.
        if len(values) < CALLS_AT_ONCE or not all(value in self._loads for value in values):
            return None
        cells = [self._loads[value].number for value in values]
        # A cell that has moved already, is used twice or belongs to an array cannot move. A cell to
        # which the function writes stays, because a write may stand between the first read and the
        # call: the next call of a function overwrites the results of the one before.
        free = set(cells) - self._fixed - self._written - self._moved.keys()
        if len(free) < len(cells) or any(len(program.allocated_with(cell)) > 1 for cell in cells):
            return None
        start = program.allocate(len(cells))
        self._moved |= {cell: start + place for place, cell in enumerate(cells)}
        return start

    def _element_for(self, result: Operation, call: Operation, place: int) -> Iterator[Operation]:
        """Yield the operations that replace `result`, an operation that reads a result of one call.
        The joined `call` returns this result of all calls as a vector. The operations read this
        vector, unless it has been read already, and take its element `place`."""
        program, index_of_result = self._program, result.arguments[2]
        assert result.out is not None and call.out is not None
        # The first of the single calls reads the vector; the others take their elements of it.
        vector = self._vectors.get((call.out, index_of_result))
        if vector is None:
            vector = program.new(f"{program.kinds[result.out]}v")
            self._vectors[call.out, index_of_result] = vector
            yield Operation(vector, "result", (call.out, call.arguments[0], index_of_result))
        yield Operation(result.out, "element", (vector, program.constant("i", place)))


def _groups(calls: list[Operation]) -> Iterator[list[Operation]]:
    # The last calls are left as they are if they are too few.
    for start in range(0, len(calls), CALLS_AT_ONCE):
        if len(calls) - start >= FEWEST:
            yield calls[start : start + CALLS_AT_ONCE]
