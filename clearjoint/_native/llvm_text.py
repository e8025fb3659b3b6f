"""Text of a program in LLVM's intermediate language.

A product that is used only as a term of one sum is computed together with the sum, by a fused
multiply-add. This module decides for which products this is done. If LLVM decided, the choice, and
with it the last bits of a lane's results, would depend on the number of lanes.

The text is not written by `llvmlite.ir`, whose objects for instructions took three times as long.
"""

import struct
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import TypeAlias

from .operations import Block, Branch, Entry, Loop, Number, Operation, Operations, Value
from .pieces import FEWEST, Division, cells_written, count_operations

_BASES = {"f": "double", "i": "i64", "w": "i32", "b": "i1"}
_SIGNS = ("lt", "le", "gt", "ge", "eq")
_INSTRUCTIONS = {
    **{name: name for name in ("fadd", "fsub", "fmul", "fdiv", "xor", "and", "or")},
    **{name: name for name in ("add", "sub", "mul")},
    "divide_whole": "sdiv",
    "remainder_whole": "srem",
    "shift_left": "shl",
    "shift_right": "ashr",
    **{f"f{sign}": f"fcmp o{sign}" for sign in _SIGNS},
    **{f"i{sign}": f"icmp {'' if sign == 'eq' else 's'}{sign}" for sign in _SIGNS},
    "ine": "icmp ne",
    "fne": "fcmp une",
    "is_nan_either": "fcmp uno",
}
"""LLVM's instructions with two arguments of one type, by the names of operations."""
_CONVERSIONS = {
    "int_to_float": "sitofp",
    "bool_to_float": "uitofp",
    "bool_to_int": "zext",
    "widen": "sext",
    "narrow": "trunc",
    "float_bits": "bitcast",
    "float_of_bits": "bitcast",
}
"""LLVM's instructions that change the type of their argument, by the names of operations."""
_INTRINSICS = {
    **{name: name for name in ("sqrt", "floor", "ceil", "fma", "copysign")},
    "abs": "fabs",
    "round_even": "roundeven",
    "round_away": "round",
}
"""LLVM's functions that most processors have as instructions, by the names of operations."""
Form: TypeAlias = str
"""A type of LLVM, scalar or vector, such as "double" or "<4 x double>"."""
Word: TypeAlias = str
"""A value in LLVM's language: a constant, an argument or the result of an instruction."""
LIBRARY = frozenset(
    "sin cos tan asin acos atan atan2 sinh cosh tanh "  # noqa: SIM905
    "asinh acosh atanh exp exp2 expm1 log log1p pow cbrt "
    "fmod nextafter erf erfc tgamma lgamma".split()
)
"""Functions of the C library. Each element of a vector takes a call of its own."""
LONGEST_BLOCK = 200
"""Largest number of operations in one block. Without optimisation, LLVM's time for selecting
instructions grows with the square of a block's length: for 40 000 lines it was 5.8 s, and 0.8 s in
short blocks. With optimisation LLVM joins the blocks first: the machine code is the same."""


def llvm_text(program: Operations) -> str:
    """Return a program as the text of an LLVM module with one public function, "program".

    In C, the function would be declared as ``void program(double *memory)``, with an address that
    is a multiple of 64. `program` is changed, since what nothing uses is removed.
    """
    return _Writer(program).module()


class _Writer:
    """Writes the text of a program, in three passes over its entries. The first one, backwards,
    finds the entries that are needed; the second one the products that are computed together with a
    sum; and the third one writes the text."""

    def __init__(self, program: Operations):
        self._program, self._width = program, program.width
        self._lines: list[str] = []
        # The text of each value, and the type of each kind of value.
        self._values: dict[Value, Word] = {}
        self._types: dict[str, Form] = {}
        # Types of the results of the functions, and functions from outside of the module.
        self._returned: dict[int, Form] = {}
        self._declared: dict[str, str] = {}
        # The number of the latest result or label, and the label of the block that is written.
        self._number, self._block = 0, ""
        self._uses: Counter[Value] = Counter()
        # Identities of the entries that are needed, as returned by `id`.
        self._live: set[int] = set()
        # For each pure function, the indices of the results that any call needs.
        self._needed_results: dict[int, set[int]] = {}
        # Sums that absorb a product, and the factors of these products.
        self._fused: set[Value] = set()
        self._products: dict[Value, tuple[Value, ...]] = {}

    def module(self) -> str:
        # The last block is the program itself.
        blocks = [*self._program.functions, self._program.block]
        # A function is called only by later ones, so its needed results are known.
        for number, block in reversed(list(enumerate(blocks))):
            # The calls use these values of the function.
            self._uses.update(self._results(number))
            self._mark(block)
        # Entries without a text of their own are removed: those not needed, and fused products.
        for block in blocks:
            self._fuse(block)
            self._remove_unwritten(block)
        is_long = sum(map(count_operations, blocks)) >= FEWEST
        # The cells to which each block may write. Only a division of the program needs them.
        written: list[set[int]] = []
        for number, block in enumerate(blocks):
            if self._program.width_of(number) != self._width:
                # Types and constants depend on the number of lanes.
                self._width = self._program.width_of(number)
                self._types, self._values = {}, {}
            written.append(cells_written(self._program, block, written) if is_long else set())
            # Only the program itself is divided. Its functions run several times in a step, so that
            # passing values between their pieces would cost more.
            if is_long and block is blocks[-1]:
                division = Division(
                    self._program, self._by_need, self._needed, len(blocks), written[-1]
                )
                division.divide(block)
                for piece, operations in division.pieces.items():
                    self._begin(piece, "void")
                    self._write_operations(operations)
                    self._lines += ["ret void", "}"]
            results = self._results(number)
            returned = "void"
            if results:
                returned = f"{{{', '.join(map(self._type_of, results))}}}"
            self._begin(number, returned)
            self._write(block)
            if results:
                # A function returns several results as one structure.
                structure = "undef"
                for k, value in enumerate(results):
                    structure = self._add(
                        f"insertvalue {returned} {structure}, {self._typed(value)}, {k}"
                    )
                self._lines.append(f"ret {returned} {structure}")
            else:
                self._lines.append("ret void")
            self._lines.append("}")
        return "\n".join([*self._lines, *self._declared.values(), ""])

    def _begin(self, number: int, returned: Form) -> None:
        # The first numbers are those of functions; then come the program itself, and the pieces
        # into which a long program is divided.
        is_program = number == len(self._program.functions)
        self._returned[number] = returned
        parameters, _ = self._program.signatures.get(number, ([], []))
        self._values.update((value, f"%a{k}") for k, value in enumerate(parameters))
        # A function reaches its memory by this pointer only, which LLVM cannot see by itself.
        memory = "ptr noalias align 64 %memory"
        arguments = ", ".join([memory, *map(self._typed, parameters)])
        # Functions save time of compilation. Inlined, one would be compiled for each call.
        scope, name = ("", "program") if is_program else ("internal ", f"f{number}")
        attributes = "" if is_program else " noinline"
        # Calls with equal arguments may be joined, and moved across writes to memory.
        attributes += " nounwind readnone" if number in self._program.without_memory else ""
        # On an unaligned stack, vectors would extend across two cache lines.
        self._lines.append(
            f"define {scope}{returned} @{name}({arguments}){attributes} alignstack(64) {{"
        )
        self._begin_block(self._label())

    # Which operations are needed, and which products are fused.

    def _results(self, function: int) -> list[Value]:
        """Return the needed results of the pure function with this number; ``[]`` for others."""
        needed = sorted(self._needed_results.get(function, ()))
        return [self._program.signatures[function][1][k] for k in needed]

    def _mark(self, block: Block) -> bool:
        """Call `_mark_entry` from a block's end backwards; return whether any entry has effects."""
        # A list, since `any` alone would stop at the first effect and leave entries unmarked.
        effects = [self._mark_entry(entry) for entry in reversed(block)]
        return any(effects)

    def _mark_entry(self, entry: Entry) -> bool:
        """Count the uses of values in an entry if the entry is needed, and add it to `_live`. Later
        entries must have been marked before. Return whether the entry may do more than compute
        values: true for an operation without a result, and for a needed branch or loop."""
        uses = self._uses
        if isinstance(entry, Operation):
            if entry.out is not None and not uses[entry.out]:
                return False
            # Not by `update`, which takes several times as long for two or three values.
            for value in entry.arguments:
                uses[value] += 1
            # A function computes only those of its results that any call needs. The operation
            # "result" has a call, the number of its function, and the index of one result.
            if entry.name == "result":
                number, k = (int(self._program.constants[value]) for value in entry.arguments[1:])
                self._needed_results.setdefault(number, set()).add(k)
        elif isinstance(entry, Branch):
            # Values that nothing uses are removed, with all that is computed only for them.
            used = [k for k, out in enumerate(entry.outs) if uses[out]]
            entry.outs = [entry.outs[k] for k in used]
            entry.yes_values = [entry.yes_values[k] for k in used]
            entry.no_values = [entry.no_values[k] for k in used]
            uses.update((*entry.yes_values, *entry.no_values))
            effects = [self._mark(entry.yes), self._mark(entry.no)]
            if not used and not any(effects):
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
        """Find products whose only use is in a sum or difference of the same block. A product that
        is used in an inner block is not fused: a loop would compute it in each iteration. If both
        terms of a sum are such products, only the first one is fused with the sum."""
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
        # Entries that are not needed, and products, which are written with their sums.
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

    def _add(self, instruction: str) -> Word:
        self._number += 1
        word = f"%v{self._number}"
        self._lines.append(f"{word} = {instruction}")
        return word

    def _label(self) -> str:
        self._number += 1
        return f"b{self._number}"

    def _begin_block(self, label: str) -> None:
        self._lines.append(f"{label}:")
        self._block = label

    def _type(self, kind: str) -> Form:
        form = self._types.get(kind)
        if form is None:
            count = self._program.cells_of(kind) if kind[1:] else self._width
            form = _BASES[kind[0]]
            if count > 1 or kind[1:]:
                form = f"<{count} x {form}>"
            self._types[kind] = form
        return form

    def _type_of(self, value: Value) -> Form:
        return self._type(self._program.kinds[value])

    def _typed(self, value: Value) -> str:
        return f"{self._type_of(value)} {self._value(value)}"

    def _value(self, value: Value) -> Word:
        word = self._values.get(value)
        if word is None:
            form, number = self._type_of(value), self._program.constants[value]
            word = self._values[value] = _constant(form, number)
        return word

    def _write(self, block: Block) -> None:
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
        for k, operation in enumerate(operations, 1):
            # A jump to the next line only divides a long block, for the sake of LLVM's time.
            if k % LONGEST_BLOCK == 0:
                following = self._label()
                self._lines.append(f"br label %{following}")
                self._begin_block(following)
            result = self._written(operation)
            if operation.out is not None and result is not None:
                self._values[operation.out] = result

    def _by_need(self, entries: list[Operation]) -> list[Operation]:
        """Return operations reordered so that most come right before the first use of their result.

        LLVM roughly keeps the order in which operations are written. In the new order fewer values
        occupy registers, and a single run takes 0.93 of the time. Loads, stores, calls, and
        operations whose results none of the others uses keep their order. If an operation needs the
        results of several others, the one that ends the longest chain of operations comes first.
        """
        # Operations that have not been placed and may be moved, by their results, and the lengths
        # of the longest chains that end with them.
        definitions: dict[Value, Operation] = {}
        depths: dict[Value, int] = {}
        used_here: set[Value] = set()
        operands: dict[int, tuple[Value, ...]] = {}
        for entry in entries:
            needed = operands[id(entry)] = self._needed(entry)
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
                # Operands that are not placed yet come before the operation on top of the stack.
                unplaced = [value for value in operands[id(stack[-1])] if value in definitions]
                if unplaced:
                    stack.append(definitions[max(unplaced, key=depths.__getitem__)])
                else:
                    ordered.append(placed := stack.pop())
                    if placed.out in definitions:
                        del definitions[placed.out]
        return ordered

    def _needed(self, entry: Operation) -> tuple[Value, ...]:
        """Return the values that an operation uses, with a fused product's factors in its place."""
        if self._products.keys().isdisjoint(entry.arguments):
            return entry.arguments
        groups = (self._products.get(value, (value,)) for value in entry.arguments)
        return tuple(value for group in groups for value in group)

    def _written(self, entry: Operation) -> Word | None:
        """Write an operation and return its result; ``None`` if it has none."""
        name, arguments, add = entry.name, entry.arguments, self._add
        if name == "load":
            return self._load(entry)
        if name == "store":
            return self._store(entry)
        if name == "call":
            self._lines.append(f"call void @f{entry.number}(ptr %memory)")
            return None
        if name == "evaluate":
            number, *values = arguments
            function = int(self._program.constants[number])
            passed = ", ".join(["ptr %memory", *map(self._typed, values)])
            return add(f"call {self._returned[function]} @f{function}({passed})")
        if name == "result":
            structure, *place = arguments
            number, k = (int(self._program.constants[value]) for value in place)
            # The structure has only those results that any call needs.
            index = sorted(self._needed_results[number]).index(k)
            return add(f"extractvalue {self._returned[number]} {self._value(structure)}, {index}")
        assert entry.out is not None
        form = self._type_of(entry.out)
        if entry.out in self._fused:
            return self._fused_sum(entry, form)
        if name in _INSTRUCTIONS:
            a, b = arguments
            return add(f"{_INSTRUCTIONS[name]} {self._typed(a)}, {self._value(b)}")
        if name in _INTRINSICS:
            return self._intrinsic(_INTRINSICS[name], form, map(self._value, arguments))
        operand, words = self._typed(arguments[0]), [self._value(value) for value in arguments]
        if name == "fneg":
            return add(f"fneg {operand}")
        if name == "not":
            return add(f"xor {operand}, {_constant(form, -1)}")
        if name == "select":
            return add(f"select {', '.join(map(self._typed, arguments))}")
        if name in _CONVERSIONS:
            return add(f"{_CONVERSIONS[name]} {operand} to {form}")
        if name == "float_to_int":
            # Saturating: numbers out of range become the nearest integer, and NaN zero, whereas
            # the result of LLVM's plain instruction is undefined for them.
            floats = self._type_of(arguments[0])
            full = f"llvm.fptosi.sat.{_mangled(form)}.{_mangled(floats)}"
            return self._call(full, form, [(floats, words[0])])
        if name in LIBRARY:
            return self._library(name, form, words)
        if name == "splat":
            return self._splat(form, words[0])
        if name == "build":
            # Vectors of the processor have lengths that are powers of two, so the vector is longer
            # than the list of tangents unless their number is one too. The further elements repeat
            # the last tangent, so that conditions on them never differ from those on the tangents.
            # With undefined numbers, the program might take a branch that no tangent needs.
            _, count = _parts(form)
            return self._vector(form, words + words[-1:] * (count - len(words)))
        if name == "element":
            k = int(self._program.constants[arguments[1]])
            return self._element(self._type_of(arguments[0]), words[0], k)
        if name == "any":
            # The result is the same in all lanes.
            condition = self._holds_in_any(arguments[0])
            return condition if self._width == 1 else self._splat(form, condition)
        raise NotImplementedError(name)

    def _fused_sum(self, entry: Operation, form: Form) -> Word:
        a, b = entry.arguments
        product, other = (a, b) if a in self._products else (b, a)
        words = [self._value(value) for value in (*self._products[product], other)]
        if entry.name == "fsub":
            # x y - z = fma(x, y, -z), and z - x y = fma(-x, y, z).
            k = 2 if product == a else 0
            words[k] = self._add(f"fneg {form} {words[k]}")
        return self._intrinsic("fma", form, words)

    def _intrinsic(self, name: str, form: Form, words: Iterable[Word]) -> Word:
        return self._call(f"llvm.{name}.{_mangled(form)}", form, [(form, word) for word in words])

    def _call(
        self, name: str, form: Form, arguments: Sequence[tuple[Form, Word]], attributes: str = ""
    ) -> Word:
        """Write a call of a function from outside of the module, with a result of the type `form`,
        and return the result. `attributes` belong to the declaration, made at the first call."""
        if name not in self._declared:
            types = ", ".join(form_of_argument for form_of_argument, _ in arguments)
            self._declared[name] = f"declare {form} @{name}({types}){attributes}"
        words = ", ".join(f"{form_of_argument} {word}" for form_of_argument, word in arguments)
        return self._add(f"call {form} @{name}({words})")

    def _library(self, name: str, form: Form, words: list[Word]) -> Word:
        base, count = _parts(form)

        def call(words: Iterable[Word]) -> Word:
            # Declared to have no side effects, so that LLVM may omit calls whose results are not
            # used.
            return self._call(name, base, [(base, word) for word in words], " nounwind readnone")

        if count == 0:
            return call(words)
        return self._vector(
            form, [call([self._element(form, word, k) for word in words]) for k in range(count)]
        )

    def _vector(self, form: Form, elements: Iterable[Word]) -> Word:
        (base, _), vector = _parts(form), "undef"
        for k, element in enumerate(elements):
            vector = self._add(f"insertelement {form} {vector}, {base} {element}, i32 {k}")
        return vector

    def _element(self, form: Form, vector: Word, k: int) -> Word:
        return self._add(f"extractelement {form} {vector}, i32 {k}")

    def _splat(self, form: Form, element: Word) -> Word:
        base, count = _parts(form)
        first = self._add(f"insertelement {form} undef, {base} {element}, i32 0")
        mask = f"<{count} x i32> zeroinitializer"
        return self._add(f"shufflevector {form} {first}, {form} undef, {mask}")

    def _holds_in_any(self, condition: Value) -> Word:
        form, word = self._type_of(condition), self._value(condition)
        if _parts(form)[1] == 0:
            return word
        return self._call(f"llvm.vector.reduce.or.{_mangled(form)}", "i1", [(form, word)])

    def _pointer(self, start: int, index: Value | None, lane: int = 0) -> Word:
        """Write the computation of the address of a lane's number in the cell `start`, or `start` +
        `index`, and return the address; for lane 0, it is also the address of the whole cell."""
        offset: Word = str(start * self._width + lane)
        if index is not None:
            word = self._value(index)
            if self._width > 1:
                word = self._element(self._type_of(index), word, lane)
                word = self._add(f"mul i64 {word}, {self._width}")
            offset = self._add(f"add i64 {word}, {offset}")
        return self._add(f"getelementptr inbounds double, ptr %memory, i64 {offset}")

    def _is_one_cell(self, index: Value | None) -> bool:
        return index is None or self._program.is_uniform(index)

    def _form_in_memory(self, kind: str) -> Form:
        # In memory, integers and bools have 64 bits.
        return self._type(("f" if kind[0] == "f" else "i") + kind[1:])

    def _load(self, entry: Operation) -> Word:
        """Write a load of a cell or, if lanes may have different indices, of a cell per lane, and
        return the result."""
        assert entry.out is not None
        kind, index = self._program.kinds[entry.out], next(iter(entry.arguments), None)
        cell_form = self._form_in_memory(kind)

        def load(form: Form, lane: int = 0) -> Word:
            # Aligned to 8 bytes only: a vector of tangents is several cells, and starts at any one.
            pointer = self._pointer(entry.number, index, lane)
            return self._add(f"load {form}, ptr {pointer}, align 8")

        if self._is_one_cell(index):
            content = load(cell_form)
        else:
            element, _ = _parts(cell_form)
            content = self._vector(cell_form, [load(element, lane) for lane in range(self._width)])
        if kind[0] == "b":
            return self._add(f"icmp ne {cell_form} {content}, {_constant(cell_form, 0)}")
        if kind[0] == "w":  # an integer of 32 bits
            return self._add(f"trunc {cell_form} {content} to {self._type(kind)}")
        return content

    def _store(self, entry: Operation) -> None:
        """Write a store to a cell or, if lanes may have different indices, to a cell per lane."""
        value, index = (*entry.arguments, None)[:2]  # `None` if the operation has no index
        assert value is not None
        kind, content = self._program.kinds[value], self._value(value)
        cell_form = self._form_in_memory(kind)
        if kind[0] in "bw":  # bools and integers of 32 bits
            extend = "zext" if kind[0] == "b" else "sext"
            content = self._add(f"{extend} {self._typed(value)} to {cell_form}")
        if self._is_one_cell(index):
            pointer = self._pointer(entry.number, index)
            self._lines.append(f"store {cell_form} {content}, ptr {pointer}, align 8")
            return
        element, _ = _parts(cell_form)
        for lane in range(self._width):
            pointer = self._pointer(entry.number, index, lane)
            word = self._element(cell_form, content, lane)
            self._lines.append(f"store {element} {word}, ptr {pointer}, align 8")

    def _write_branch(self, entry: Branch) -> None:
        """Write the blocks `yes` and `no`, and the jump to `yes` if the condition holds in any of
        its elements, else to `no`."""
        yes, no, end = self._label(), self._label(), self._label()
        condition = self._holds_in_any(entry.condition)
        self._lines.append(f"br i1 {condition}, label %{yes}, label %{no}")
        ends = []
        for label, block in ((yes, entry.yes), (no, entry.no)):
            self._begin_block(label)
            self._write(block)
            # If the block contains branches or loops, it does not end in the basic block `label`.
            ends.append(self._block)
            self._lines.append(f"br label %{end}")
        self._begin_block(end)
        for out, *values in zip(entry.outs, entry.yes_values, entry.no_values, strict=True):
            self._values[out] = self._add(self._phi(values, ends))

    def _write_loop(self, entry: Loop) -> None:
        """Write a loop: a head, in which phi instructions set the carries and which computes the
        condition, and a body, which jumps back to the head."""
        before, head, body, end = self._block, self._label(), self._label(), self._label()
        self._lines.append(f"br label %{head}")
        self._begin_block(head)
        start = len(self._lines)
        # Completed below, since the values from the body have no names yet.
        self._values.update((carry, self._add("phi")) for carry in entry.carries)
        self._write(entry.head)
        condition = self._holds_in_any(entry.condition)
        self._lines.append(f"br i1 {condition}, label %{body}, label %{end}")
        self._begin_block(body)
        self._write(entry.body)
        # A phi lists the carry's value for each basic block from which a jump comes. If the body
        # contains branches or loops, the jump back comes not from `body` but from the block in
        # which the writing of the body has ended.
        carries = zip(entry.carries, entry.first, entry.following, strict=True)
        for k, (carry, *values) in enumerate(carries, start):
            phi = self._phi(values, [before, self._block])
            self._lines[k] = f"{self._values[carry]} = {phi}"
        self._lines.append(f"br label %{head}")
        self._begin_block(end)

    def _phi(self, values: Sequence[Value], labels: Sequence[str]) -> str:
        pairs = zip(values, labels, strict=True)
        incoming = ", ".join(f"[{self._value(value)}, %{label}]" for value, label in pairs)
        return f"phi {self._type_of(values[0])} {incoming}"


def _parts(form: Form) -> tuple[Form, int]:
    """Return the type of the elements of a vector, and their number: 0 for a scalar."""
    if not form.startswith("<"):
        return form, 0
    count, base = form[1:-1].split(" x ")
    return base, int(count)


def _constant(form: Form, number: Number) -> Word:
    base, count = _parts(form)
    # Floats are written by their bits.
    word = f"0x{struct.pack('>d', number).hex()}" if base == "double" else str(int(number))
    return f"<{', '.join([f'{base} {word}'] * count)}>" if count else word


def _mangled(form: Form) -> str:
    """Return a type as names of intrinsics have it, such as "v4f64" in "llvm.sqrt.v4f64"."""
    base, count = _parts(form)
    name = "f64" if base == "double" else base
    return f"v{count}{name}" if count else name
