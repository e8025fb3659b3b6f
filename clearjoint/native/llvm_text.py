"""Text of a program in LLVM's intermediate language, written by llvmlite.

A product that is used only as a term of one sum is computed together with the sum, by a fused
multiply-add. This module decides for which products this is done. If LLVM decided, the choice
would depend on the number of lanes (runs that the program computes at once), so that the last bits
of a lane's results could depend on that number.

A program consists of blocks, which are lists of entries: operations, and branches and loops, which
contain blocks themselves (see `.operations`). A value is the result of an operation, a branch or a
loop, or a constant, and is named by an integer. Its kind is "f" (float64), "i" (int64), "w" (int32)
or "b" (bool). With the suffix "p" it is a vector of tangents, which are derivatives by parameters.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any, TypeAlias

from llvmlite import ir

from .operations import Block, Branch, Entry, Loop, Operation, Operations, Value
from .pieces import FEWEST, Division, cells_written, count_operations

_BASES = {"f": ir.DoubleType(), "i": ir.IntType(64), "w": ir.IntType(32), "b": ir.IntType(1)}
_CELL = {"f": "f", "i": "i", "w": "i", "b": "i"}
"""Kinds of numbers in memory, where all have 64 bits, by the first letters of values' kinds."""
_SIGNS = {"lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "==", "ne": "!="}
_INSTRUCTIONS: dict[str, tuple[str, ...]] = {
    **{name: (name,) for name in ("fadd", "fsub", "fmul", "fdiv", "fneg", "select", "xor")},
    **{name: (name,) for name in ("add", "sub", "mul")},
    **{name: (f"{name}_",) for name in ("and", "or", "not")},
    "divide_whole": ("sdiv",),
    "remainder_whole": ("srem",),
    "shift_left": ("shl",),
    "shift_right": ("ashr",),
    **{f"f{name}": ("fcmp_ordered", sign) for name, sign in _SIGNS.items()},
    **{f"i{name}": ("icmp_signed", sign) for name, sign in _SIGNS.items()},
    "fne": ("fcmp_unordered", "!="),
    "is_nan_either": ("fcmp_unordered", "uno"),
}
"""Methods of llvmlite's builder, by the names of operations. A method for comparisons stands
with its first argument, the comparison's sign."""
_CONVERSIONS = {
    "int_to_float": "sitofp",
    "bool_to_float": "uitofp",
    "bool_to_int": "zext",
    "widen": "sext",
    "narrow": "trunc",
    "float_bits": "bitcast",
    "float_of_bits": "bitcast",
}
"""Methods of llvmlite's builder that take the type of the result, by the names of operations."""
_INTRINSICS = {
    **{name: name for name in ("sqrt", "floor", "ceil", "fma", "copysign")},
    "abs": "fabs",
    "round_even": "roundeven",
    "round_away": "round",
}
"""LLVM's functions that most processors have as instructions, by the names of operations."""
Form: TypeAlias = Any
"""A type of LLVM, scalar or vector. Type checkers don't know the attributes of llvmlite's types."""
Word: TypeAlias = Any
"""A value in LLVM's language: a constant, an argument or the result of an instruction."""
LIBRARY = frozenset(
    "sin cos tan asin acos atan atan2 sinh cosh tanh "  # noqa: SIM905
    "asinh acosh atanh exp exp2 expm1 log log1p pow cbrt "
    "fmod nextafter erf erfc tgamma lgamma".split()
)
"""Functions of the C library, which are called for one lane, or tangent, after the other."""


LONGEST_BLOCK = 200
"""Largest number of operations that are written in one block. Without optimisation, LLVM selects
instructions in a time that grows with the square of a block's length: for 40 000 lines it took
5.8 s, and 0.8 s in short blocks. With all of its passes LLVM joins the blocks first, and the
machine code is the same."""


def llvm_text(program: Operations, result: Value | None = None, is_optimised: bool = True) -> str:
    """Return a program as the text of an LLVM module with one public function, "program".

    In C, the function would be declared as ``int64_t program(double *memory)``. It executes the
    program on memory at an address that is a multiple of 64. A cell of the memory has 8 bytes for
    each lane, which hold a float or a 64-bit integer.

    **Arguments:** `program`: the program, which is changed: results of branches that nothing uses
    are removed; `result`: a value of kind "i" whose number in the first lane the function returns.
    By default the function returns 0. `is_optimised`: whether LLVM optimises the text, so that a
    long program must be divided.
    """
    return _Writer(program).module(result, is_optimised)


class _Writer:
    """Writes the text of a program, in three passes over its entries.

    The first pass goes backwards and finds the entries that are needed. Of these, the second pass
    finds the products that are computed together with a sum, and the third pass writes the text.
    """

    def __init__(self, program: Operations):
        self._program, self._width = program, program.width
        self._module = ir.Module()
        self._functions: dict[int, ir.Function] = {}
        self._values: dict[Value, Word] = {}
        self._uses: Counter[Value] = Counter()
        # Identities of the entries that are needed, as returned by `id`.
        self._live: set[int] = set()
        # For each pure function, the indices of the results that any call needs.
        self._needed_results: dict[int, set[int]] = {}
        # Sums that absorb a product, and the factors of these products.
        self._fused: set[Value] = set()
        self._products: dict[Value, tuple[Value, ...]] = {}

    def module(self, result: Value | None, is_optimised: bool) -> str:
        """Return the text of the module; the arguments are those of `llvm_text`."""
        if result is not None:
            self._uses[result] += 1
        # The last block is the program itself.
        blocks = [*self._program.functions, self._program.block]
        # A function is called only by later ones, so its needed results are known.
        for number, block in reversed(list(enumerate(blocks))):
            self._uses.update(self._results(number))
            self._mark(block)
        for block in blocks:
            self._fuse(block)
            self._remove_unwritten(block)
        is_long = is_optimised and sum(map(count_operations, blocks)) >= FEWEST
        written: list[set[int]] = []
        for number, block in enumerate(blocks):
            is_program = block is blocks[-1]
            written.append(cells_written(self._program, block, written) if is_long else set())
            # Functions run several times in a step, so that passing values would cost more.
            if is_long and is_program:
                division = Division(
                    self._program, self._by_need, self._needed, len(blocks), written[-1]
                )
                division.divide(block, [] if result is None else [result])
                for piece, operations in division.pieces.items():
                    self._begin(piece, f"f{piece}", ir.VoidType())
                    self._write_operations(operations)
                    self._builder.ret_void()
            results = self._results(number)
            returned = _BASES["i"] if is_program else ir.VoidType()
            if results:
                returned = ir.LiteralStructType(list(map(self._type_of, results)))
            parameters, _ = self._program.signatures.get(number, ([], []))
            name = "program" if is_program else f"f{number}"
            function = self._begin(number, name, returned, parameters)
            if number in self._program.signatures and not _uses_memory(block):
                # Calls with equal arguments may be joined, and moved across writes to memory.
                function.attributes.add("readnone")
                function.attributes.add("nounwind")
            self._write(block)
            if results:
                together = returned(ir.Undefined)
                for k, value in enumerate(results):
                    together = self._builder.insert_value(together, self._value(value), k)
                self._builder.ret(together)
            elif not is_program:
                self._builder.ret_void()
        if result is None:
            returned = _BASES["i"](0)
        else:
            returned = self._value(result)
            returned = returned if self._width == 1 else self._element(returned, 0)
        self._builder.ret(returned)
        return str(self._module)

    def _begin(
        self, number: int, name: str, returned: Form, parameters: Sequence[Value] = ()
    ) -> ir.Function:
        """Begin a function, to which the following instructions are added."""
        form = ir.FunctionType(returned, [ir.PointerType(), *map(self._type_of, parameters)])
        function = ir.Function(self._module, form, name)
        # On an unaligned stack, vectors would extend across two cache lines.
        function.attributes.alignstack = 64
        if name != "program":
            # Functions save time of compilation. Inlined, one would be compiled for each call.
            function.linkage = "internal"
            function.attributes.add("noinline")
        self._memory, *arguments = function.args
        self._values.update(zip(parameters, arguments, strict=True))
        # A function reaches its memory by this pointer only, which LLVM cannot see by itself.
        self._memory.add_attribute("noalias")
        self._memory.attributes.align = 64
        self._functions[number] = function
        self._builder = ir.IRBuilder(function.append_basic_block())
        return function

    # Which operations are needed, and which products are fused.

    def _results(self, function: int) -> list[Value]:
        """Return the results of a pure function that any call needs; none for other functions."""
        needed = sorted(self._needed_results.get(function, ()))
        return [self._program.signatures[function][1][k] for k in needed]

    def _mark(self, block: Block) -> bool:
        """Count the uses of values in a block, from its end backwards, and find needed entries.

        **Returns:** whether the block has an effect other than the values that it computes.
        """
        # A list, since `any` alone would stop at the first effect and leave entries unmarked.
        effects = [self._mark_entry(entry) for entry in reversed(block)]
        return any(effects)

    def _mark_entry(self, entry: Entry) -> bool:
        """Count the uses of values in an entry, and record in `_live` whether the entry is needed.

        The entries after it must have been marked already. Results of a branch that nothing uses
        are removed from the branch.

        **Returns:** whether the entry is needed and may have an effect other than the values that
        it computes. An operation has such an effect if it has no result. Every needed branch or
        loop is taken to have one, even if it only computes values.
        """
        uses = self._uses
        if isinstance(entry, Operation):
            if entry.out is not None and not uses[entry.out]:
                return False
            uses.update(entry.arguments)
            if entry.name == "result":
                number, k = (int(self._program.constants[value]) for value in entry.arguments[1:])
                self._needed_results.setdefault(number, set()).add(k)
        elif isinstance(entry, Branch):
            # Values that nothing uses are removed, with all that is computed only for them.
            kept = [k for k, out in enumerate(entry.outs) if uses[out]]
            entry.outs = [entry.outs[k] for k in kept]
            entry.yes_values = [entry.yes_values[k] for k in kept]
            entry.no_values = [entry.no_values[k] for k in kept]
            uses.update((*entry.yes_values, *entry.no_values))
            effects = [self._mark(entry.yes), self._mark(entry.no)]
            if not kept and not any(effects):
                return False
            uses.update((entry.condition,))
        else:
            # The body computes the next values of the carries. All of these count as used, because
            # the uses of a carry in the body are not known before the whole body is read.
            uses.update((*entry.following, entry.condition))
            effects = [self._mark(entry.body), self._mark(entry.head)]
            uses.update(entry.first)
            if not any(effects) and not any(uses[carry] for carry in entry.carries):
                return False
        self._live.add(id(entry))
        return not isinstance(entry, Operation) or entry.out is None

    def _fuse(self, block: Block) -> None:
        """Find products whose only use is in a sum or difference of the same block.

        The products are recorded in `_products`, and the sums in `_fused`.

        If both terms of a sum are such products, only the first one is fused with the sum. A
        product whose sum is in an inner block is not fused, since a loop would compute it again in
        each iteration.
        """
        # Products that have been passed on the way and are not fused yet, with their factors.
        candidates: dict[Value, tuple[Value, ...]] = {}
        for entry in block:
            if id(entry) not in self._live:
                continue
            if not isinstance(entry, Operation):
                for inner in entry.blocks:
                    self._fuse(inner)
            elif entry.out is None:
                continue
            elif entry.name == "fmul" and self._uses[entry.out] == 1:
                candidates[entry.out] = entry.arguments
            elif entry.name in ("fadd", "fsub"):
                for value in entry.arguments:
                    if value in candidates:
                        self._products[value] = candidates.pop(value)
                        self._fused.add(entry.out)
                        break

    def _remove_unwritten(self, block: Block) -> None:
        """Remove entries that are not needed, and fused products, which are written together with
        their sums, from a block and the blocks inside of it."""
        block[:] = [
            entry
            for entry in block
            if id(entry) in self._live
            and not (isinstance(entry, Operation) and entry.out in self._products)
        ]
        for entry in block:
            for inner in entry.blocks:
                self._remove_unwritten(inner)

    # Text.

    def _type(self, kind: str) -> Form:
        """Return LLVM's type of a kind of values.

        It is a vector of tangents for a kind with the suffix "p", otherwise a scalar, or a vector
        of lanes if the program has several.
        """
        count = self._program.packed if kind.endswith("p") else self._width
        base = _BASES[kind[0]]
        return base if count == 1 and not kind.endswith("p") else ir.VectorType(base, count)

    def _type_of(self, value: Value) -> Form:
        return self._type(self._program.kinds[value])

    def _value(self, value: Value) -> Word:
        """Return LLVM's value for a value of the program, in the function that is being written: a
        constant, or the result of an instruction."""
        number = self._program.constants.get(value)
        if number is not None and value not in self._values:
            # llvmlite repeats the number in all elements of a vector.
            self._values[value] = self._type(self._program.kinds[value])(number)
        return self._values[value]

    def _write(self, block: Block) -> None:
        """Write the entries of a block."""
        straight: list[Operation] = []
        for entry in block:
            if isinstance(entry, Operation):
                straight.append(entry)
                continue
            self._write_operations(self._by_need(straight))
            straight = []
            if isinstance(entry, Branch):
                self._write_branch(entry)
            else:
                self._write_loop(entry)
        self._write_operations(self._by_need(straight))

    def _write_operations(self, operations: list[Operation]) -> None:
        """Write operations between which no branch or loop stands."""
        for k, operation in enumerate(operations, 1):
            if k % LONGEST_BLOCK == 0:
                following = self._builder.append_basic_block()
                self._builder.branch(following)
                self._builder.position_at_end(following)
            result = self._written(operation)
            if operation.out is not None and result is not None:
                self._values[operation.out] = result

    def _by_need(self, entries: list[Operation]) -> list[Operation]:
        """Return operations in a new order, in which most come right before the first use of their
        result.

        Loads, stores, calls, and operations whose results no other given operation uses keep their
        order; only the remaining operations are moved. If an operation needs the results of several
        others, the one at the end of the longest chain of dependent operations comes first. LLVM
        roughly keeps the order in which operations are written. In the new order fewer values
        occupy registers, and a single run takes 0.93 of the time.
        """
        # Operations that have not been placed and may be moved, by their results, and the lengths
        # of the longest chains that end with them.
        definitions: dict[Value, Operation] = {}
        depths: dict[Value, int] = {}
        used_here: set[Value] = set()
        for entry in entries:
            needed = self._needed(entry)
            used_here.update(needed)
            if entry.out is not None and entry.name != "load":
                definitions[entry.out] = entry
                depths[entry.out] = 1 + max((depths.get(value, 0) for value in needed), default=0)
        ordered: list[Operation] = []
        for entry in entries:
            # This operation is placed later, right before the one that needs its result.
            if entry.out in depths and entry.out in used_here:
                continue
            # A depth-first search without recursion: chains can be longer than Python's limit of
            # recursion.
            stack = [entry]
            while stack:
                needed = [value for value in self._needed(stack[-1]) if value in definitions]
                if needed:
                    stack.append(definitions[max(needed, key=depths.__getitem__)])
                else:
                    ordered.append(last := stack.pop())
                    if last.out in definitions:
                        del definitions[last.out]
        return ordered

    def _needed(self, entry: Operation) -> tuple[Value, ...]:
        """Return the values that an operation uses, with the factors of a fused product in place
        of the product."""
        if self._products.keys().isdisjoint(entry.arguments):
            return entry.arguments
        groups = (self._products.get(value, (value,)) for value in entry.arguments)
        return tuple(value for group in groups for value in group)

    def _written(self, entry: Operation) -> Word | None:
        """Write an operation and return its result.

        The operations "store" and "call" have no result: their `out` is ``None``, and what is
        returned for them must not be used.

        **Raises:** `NotImplementedError` for the name of an operation that this module cannot
        write, which would be an error of this package.
        """
        name, arguments, builder = entry.name, entry.arguments, self._builder
        if name == "call":
            return builder.call(self._functions[entry.number], [self._memory])
        if name == "evaluate":
            number, *values = arguments
            function = self._functions[int(self._program.constants[number])]
            return builder.call(function, [self._memory, *map(self._value, values)])
        if name == "result":
            together, *place = arguments
            number, k = (int(self._program.constants[value]) for value in place)
            return builder.extract_value(
                self._value(together), sorted(self._needed_results[number]).index(k)
            )
        if name == "load":
            return self._load(entry)
        if name == "store":
            return self._store(entry)
        assert entry.out is not None
        form = self._type(self._program.kinds[entry.out])
        if entry.out in self._fused:
            return self._fused_sum(entry, form)
        given = [self._value(value) for value in arguments]
        if name in _INSTRUCTIONS:
            method, *sign = _INSTRUCTIONS[name]
            return getattr(builder, method)(*sign, *given)
        if name in _CONVERSIONS:
            return getattr(builder, _CONVERSIONS[name])(*given, form)
        if name == "float_to_int":
            # Saturating: numbers out of range become the nearest integer, and NaN zero, whereas
            # the result of LLVM's plain instruction is undefined for them.
            return self._intrinsic(f"fptosi.sat.{_mangled(form)}", form, given)
        if name in _INTRINSICS:
            return self._intrinsic(_INTRINSICS[name], form, given)
        if name in LIBRARY:
            return self._library(name, form, given)
        if name == "splat":
            return self._splat(form, given[0])
        if name == "build":
            # Vectors of the processor have lengths that are powers of two, so the vector is longer
            # than the list of tangents unless their number is one too. The further elements repeat
            # the last tangent, so that conditions on them never differ from those on the tangents.
            # With undefined numbers, the program might take a branch that no tangent needs.
            return self._vector(form, given + given[-1:] * (form.count - len(given)))
        if name == "element":
            return self._element(given[0], int(self._program.constants[arguments[1]]))
        if name == "any":
            # The result is the same in all lanes.
            condition = self._holds_in_any(given[0])
            return condition if self._width == 1 else self._splat(form, condition)
        raise NotImplementedError(name)

    def _fused_sum(self, entry: Operation, form: Form) -> Word:
        """Write a sum or difference, one of whose terms is a product, as a fused multiply-add."""
        a, b = entry.arguments
        product, other = (a, b) if a in self._products else (b, a)
        given = [self._value(value) for value in (*self._products[product], other)]
        if entry.name == "fsub":
            # x y - z = fma(x, y, -z), and z - x y = fma(-x, y, z).
            k = 2 if product == a else 0
            given[k] = self._builder.fneg(given[k])
        return self._intrinsic("fma", form, given)

    def _intrinsic(self, name: str, form: Form, given: list[Word]) -> Word:
        """Call one of LLVM's functions, whose result has the type `form`.

        **Arguments:** `name`: name without the prefix "llvm." and the suffix for the type of the
        first argument; `given`: the arguments.
        """
        full = f"llvm.{name}.{_mangled(given[0].type)}"
        return self._builder.call(self._declared(full, form, given), given)

    def _declared(self, name: str, form: Form, given: list[Word]) -> ir.Function:
        """Return a function from outside of the module, and declare it if this is its first use.

        **Arguments:** `form`: type of the result; `given`: values of the types that the function
        takes.
        """
        known = self._module.globals.get(name)
        types = [value.type for value in given]
        return known or ir.Function(self._module, ir.FunctionType(form, types), name)

    def _library(self, name: str, form: Form, given: list[Word]) -> Word:
        """Call a function of the C library for each lane or tangent."""
        scalars = [_BASES["f"](None)] * len(given)
        function = self._declared(name, _BASES["f"], scalars)
        # Declared to have no side effects, so that LLVM may omit calls whose results are not used.
        function.attributes.add("nounwind")
        function.attributes.add("readnone")
        call = self._builder.call
        if not isinstance(form, ir.VectorType):
            return call(function, given)
        elements = (
            call(function, [self._element(value, k) for value in given]) for k in range(form.count)
        )
        return self._vector(form, elements)

    def _vector(self, form: Form, elements: Iterable[Word]) -> Word:
        """Return a vector of the type `form` with the given elements."""
        vector = form(ir.Undefined)
        for k, element in enumerate(elements):
            vector = self._builder.insert_element(vector, element, _BASES["w"](k))
        return vector

    def _element(self, vector: Word, k: int) -> Word:
        return self._builder.extract_element(vector, _BASES["w"](k))

    def _splat(self, form: Form, element: Word) -> Word:
        """Return a vector whose elements are all equal to a given one."""
        undefined = form(ir.Undefined)
        one = self._builder.insert_element(undefined, element, _BASES["w"](0))
        mask = ir.VectorType(_BASES["w"], form.count)(0)
        return self._builder.shuffle_vector(one, undefined, mask)

    def _holds_in_any(self, condition: Word) -> Word:
        """Return a scalar condition that is true if the given one holds in any lane or for any
        tangent."""
        if not isinstance(condition.type, ir.VectorType):
            return condition
        return self._intrinsic("vector.reduce.or", _BASES["b"], [condition])

    def _pointer(self, start: int, index: Value | None, lane: int = 0) -> Word:
        """Return the address of a lane's number in the cell `start`, or in `start` + `index`.

        The numbers of all lanes in a cell are consecutive, so the address for lane 0, the default,
        is also that of the whole cell.
        """
        number, builder = _BASES["i"], self._builder
        offset = number(start * self._width + lane)
        if index is not None:
            word = self._value(index)
            word = word if self._width == 1 else self._element(word, lane)
            offset = builder.add(builder.mul(word, number(self._width)), offset)
        return builder.gep(self._memory, [offset], inbounds=True, source_etype=_BASES["f"])

    def _is_one_cell(self, index: Value | None) -> bool:
        """Return whether all lanes are known to read or write the same cell.

        **Arguments:** `index`: index of the cell; ``None`` if the number of the cell is known.
        """
        return index is None or self._program.is_uniform(index)

    def _load(self, entry: Operation) -> Word:
        """Write the instructions that read a cell, and return the content. If the lanes may have
        different indices, and so read different cells, the cells are read lane by lane."""
        assert entry.out is not None
        kind, builder = self._program.kinds[entry.out], self._builder
        cell, index = self._type(_CELL[kind[0]] + kind[1:]), next(iter(entry.arguments), None)
        if self._is_one_cell(index):
            # Only 8 bytes of alignment are known: a vector of tangents may begin at any cell.
            content = builder.load(self._pointer(entry.number, index), align=8, typ=cell)
        else:
            pointers = (self._pointer(entry.number, index, lane) for lane in range(self._width))
            numbers = (builder.load(each, align=8, typ=cell.element) for each in pointers)
            content = self._vector(cell, numbers)
        if kind[0] == "b":
            return builder.icmp_signed("!=", content, cell(0))
        return builder.trunc(content, self._type(kind)) if kind[0] == "w" else content

    def _store(self, entry: Operation) -> None:
        """Write the instructions that store a value in a cell. If the lanes may have different
        indices, and so write to different cells, the numbers are stored lane by lane."""
        value, index = (*entry.arguments, None)[:2]
        assert value is not None
        kind, builder = self._program.kinds[value], self._builder
        cell, content = self._type(_CELL[kind[0]] + kind[1:]), self._value(value)
        # In memory, integers and bools have 64 bits.
        if kind[0] in "bw":
            extend = builder.zext if kind[0] == "b" else builder.sext
            content = extend(content, cell)
        if self._is_one_cell(index):
            builder.store(content, self._pointer(entry.number, index), align=8)
            return
        for lane in range(self._width):
            pointer = self._pointer(entry.number, index, lane)
            builder.store(self._element(content, lane), pointer, align=8)

    def _write_branch(self, entry: Branch) -> None:
        """Write a jump to the block `yes` if the condition holds in any lane or for any tangent,
        else to the block `no`.

        With several lanes or tangents, the block `yes` is thus executed also for those in which the
        condition does not hold. This method adds no instructions for them: the program contains
        operations "select", in `yes` or after the branch, which give them their results, and `yes`
        writes to memory only where the condition holds (see `.operations.Branch`).

        Both blocks continue after the branch. There, a phi instruction gives each result the value
        from the block that was executed.
        """
        builder, append = self._builder, self._builder.append_basic_block
        yes, no, end = append(), append(), append()
        builder.cbranch(self._holds_in_any(self._value(entry.condition)), yes, no)
        ends = []
        for label, block in ((yes, entry.yes), (no, entry.no)):
            builder.position_at_end(label)
            self._write(block)
            # If the block contains branches or loops, it does not end in the basic block `label`.
            ends.append(builder.block)
            builder.branch(end)
        builder.position_at_end(end)
        for out, *values in zip(entry.outs, entry.yes_values, entry.no_values, strict=True):
            phi = builder.phi(self._type(self._program.kinds[out]))
            for value, label in zip(values, ends, strict=True):
                phi.add_incoming(self._value(value), label)
            self._values[out] = phi

    def _write_loop(self, entry: Loop) -> None:
        """Write a loop, which consists of a head and a body.

        The head computes the condition. If it holds in any lane, the program jumps to the body,
        which ends with a jump back to the head; otherwise it jumps to the end. Phi instructions in
        the head set the carries: to their first values when the program comes from before the loop,
        and to the values `following` when it comes from the body. This method adds no instructions
        for lanes that have finished before others: the body itself contains the operations "select"
        by which such lanes keep their values (see `control.loop`).
        """
        builder, append = self._builder, self._builder.append_basic_block
        before, head, body, end = builder.block, append(), append(), append()
        builder.branch(head)
        builder.position_at_end(head)
        phis = [builder.phi(self._type(self._program.kinds[carry])) for carry in entry.carries]
        for carry, phi, first in zip(entry.carries, phis, entry.first, strict=True):
            phi.add_incoming(self._value(first), before)
            self._values[carry] = phi
        self._write(entry.head)
        builder.cbranch(self._holds_in_any(self._value(entry.condition)), body, end)
        builder.position_at_end(body)
        self._write(entry.body)
        # A phi names the basic block from which the jump comes. If the body contains branches or
        # loops, that is not `body` but the block in which its writing has ended.
        for phi, following in zip(phis, entry.following, strict=True):
            phi.add_incoming(self._value(following), builder.block)
        builder.branch(head)
        builder.position_at_end(end)


def _uses_memory(block: Block) -> bool:
    """Return whether a block reads or writes memory, or calls a function, which may do so."""
    names = ("load", "store", "call", "evaluate")
    return any(
        (isinstance(entry, Operation) and entry.name in names)
        or any(map(_uses_memory, entry.blocks))
        for entry in block
    )


def _mangled(form: Form) -> str:
    """Return the type as LLVM writes it at the end of the names of overloaded intrinsics, such as
    "v4f64" in "llvm.sqrt.v4f64"."""
    if isinstance(form, ir.VectorType):
        return f"v{form.count}{form.element.intrinsic_name}"
    return form.intrinsic_name
