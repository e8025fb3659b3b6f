"""Text of a program in LLVM's language.

A product whose only use is a sum becomes a fused multiply-add with it. This is decided here and not
by LLVM, whose decisions depend on the number of lanes: a lane then has the same bits at any width.
"""

import struct
from collections import Counter
from collections.abc import Iterable

from .operations import (
    Block,
    Branch,
    Call,
    Entry,
    LoadCell,
    Loop,
    Operation,
    Operations,
    StoreCell,
    Value,
)

_BASE = {"f": "double", "i": "i64", "w": "i32", "b": "i1"}
_PLAIN = {
    **{name: name for name in ("fadd", "fsub", "fmul", "fdiv", "add", "sub", "mul")},
    **{name: name for name in ("and", "or", "xor")},
    "divide_whole": "sdiv",
    "remainder_whole": "srem",
    "shift_left": "shl",
    "shift_right": "ashr",
}
"""Operations on two arguments that are instructions of LLVM."""
_COMPARISONS = {
    **{f"f{name}": f"fcmp o{name}" for name in ("lt", "le", "gt", "ge", "eq")},
    "fne": "fcmp une",
    "is_nan_either": "fcmp uno",
    **{f"i{name}": f"icmp s{name}" for name in ("lt", "le", "gt", "ge")},
    "ieq": "icmp eq",
    "ine": "icmp ne",
}
_CONVERSIONS = {
    "int_to_float": "sitofp",
    "bool_to_float": "uitofp",
    "bool_to_int": "zext",
    "widen": "sext",
    "narrow": "trunc",
    "float_bits": "bitcast",
    "float_of_bits": "bitcast",
}
_INTRINSICS = {
    "sqrt": "sqrt",
    "abs": "fabs",
    "floor": "floor",
    "ceil": "ceil",
    "round_even": "roundeven",
    "round_away": "round",
    "fma": "fma",
    "copysign": "copysign",
}
"""Functions of floats for which processors have instructions, or short sequences of them."""
LIBRARY = frozenset(
    "sin cos tan asin acos atan atan2 sinh cosh tanh "  # noqa: SIM905
    "asinh acosh atanh exp exp2 expm1 log log1p pow cbrt "
    "fmod nextafter erf erfc tgamma lgamma".split()
)
"""Functions of the C library, which are called for each lane and tangent."""
_Straight = Operation | LoadCell | StoreCell
"""Entries that contain no blocks."""


def llvm_text(program: Operations, name: str, result: Value | None = None) -> str:
    """Return a program as the text of an LLVM module with one public function.

    In C, the function would be declared as ``int64_t name(double *memory)``. It executes the
    program, whose cells it reads and writes in `memory`, at an address that is a multiple of 64. A
    cell has 8 bytes for each lane, which hold a float or a 64-bit integer.

    **Arguments:** `name`: name of the function; `result`: a 64-bit integer of the program, whose
    number in the first lane the function returns. By default the function returns 0.
    """
    return _Writer(program).module(name, result)


class _Writer:
    def __init__(self, program: Operations):
        self._program = program
        self._width = program.width
        self._declared: dict[str, str] = {}
        self._lines: list[str] = []
        self._label = "entry"
        self._labels = 0
        self._temporaries = 0
        self._uses: Counter[Value] = Counter()
        # Ids of the entries that are needed.
        self._live: set[int] = set()
        # Sums that absorb a product, and the factors of these products.
        self._fused: set[Value] = set()
        self._products: dict[Value, tuple[Value, Value]] = {}

    def module(self, name: str, result: Value | None) -> str:
        """Return the text of the module; arguments as for `llvm_text`."""
        block = self._program.block
        if result is not None:
            self._uses[result] += 1
        blocks = [*self._program.functions, block]
        for each in reversed(blocks):  # A function is called by later ones only.
            self._mark(each)
        memory = "ptr noalias nocapture align 64 %memory"
        for number, each in enumerate(blocks):
            self._fuse(each)
            last = each is block
            head = f"i64 @{name}({memory})" if last else f"internal void @f{number}({memory})"
            # On an unaligned stack, vectors would extend across two cache lines.
            attributes = "alignstack(64)" if last else "noinline alignstack(64)"
            self._lines.append(f"define {head} {attributes} {{")
            self._begin("entry")
            self._write(each)
            if not last:
                self._lines.append("ret void\n}")
        returned = "0" if result is None else self._first_lane(result)
        self._lines.append(f"ret i64 {returned}\n}}\n")
        return "\n".join([*self._declared.values(), *self._lines])

    def _first_lane(self, value: Value) -> str:
        """Return LLVM's name of a value's number in the first lane."""
        word = self._word(value)
        if self._width == 1:
            return word
        out = self._temporary()
        self._lines.append(f"{out} = extractelement {self._type(value)} {word}, i32 0")
        return out

    # Which operations are needed, and which products are fused.

    def _mark(self, block: Block) -> bool:
        """Count the uses of values, from the end backwards, and mark the needed entries.

        Returns whether the block has an effect other than the values that it computes.
        """
        effect = False
        for entry in reversed(block.entries):
            needed = self._mark_entry(entry)
            effect = effect or (needed and not isinstance(entry, Operation | LoadCell))
        return effect

    def _mark_entry(self, entry: Entry) -> bool:
        uses = self._uses
        if isinstance(entry, Call):
            self._live.add(id(entry))
            return True
        if isinstance(entry, StoreCell):
            self._use((entry.value, entry.index))
            self._live.add(id(entry))
            return True
        if isinstance(entry, Operation | LoadCell):
            if not uses[entry.out]:
                return False
            arguments = entry.arguments if isinstance(entry, Operation) else (entry.index,)
            self._use(arguments)
            self._live.add(id(entry))
            return True
        if isinstance(entry, Branch):
            # Outputs that nothing uses are removed, with all that is computed only for them.
            kept = [k for k, out in enumerate(entry.outs) if uses[out]]
            entry.outs = [entry.outs[k] for k in kept]
            entry.yes_values = [entry.yes_values[k] for k in kept]
            entry.no_values = [entry.no_values[k] for k in kept]
            self._use((*entry.yes_values, *entry.no_values))
            effects = [self._mark(entry.yes), self._mark(entry.no)]
            if not kept and not any(effects):
                return False
            self._use((entry.condition,))
        else:
            # Uses of carries are known only after the whole body, which computes their next values:
            # all of these count as used.
            self._use((*entry.following, entry.condition))
            effects = [self._mark(entry.body), self._mark(entry.head)]
            self._use(entry.first)
            if not any(effects) and not any(uses[carry] for carry in entry.carries):
                return False
        self._live.add(id(entry))
        return True

    def _use(self, values: Iterable[Value | None]) -> None:
        for value in values:
            if value is not None:
                self._uses[value] += 1

    def _fuse(self, block: Block) -> None:
        """Find products whose only use is a sum in the same block.

        A sum absorbs one product at most, the first of its arguments.
        """
        candidates: dict[Value, tuple[Value, Value]] = {}
        for entry in block.entries:
            if id(entry) not in self._live:
                continue
            if isinstance(entry, Branch):
                self._fuse(entry.yes)
                self._fuse(entry.no)
            elif isinstance(entry, Loop):
                self._fuse(entry.head)
                self._fuse(entry.body)
            elif isinstance(entry, Operation):
                if entry.name == "fmul" and self._uses[entry.out] == 1:
                    candidates[entry.out] = entry.arguments[0], entry.arguments[1]
                elif entry.name in ("fadd", "fsub"):
                    for value in entry.arguments:
                        if value in candidates:
                            self._products[value] = candidates.pop(value)
                            self._fused.add(entry.out)
                            break

    # Text.

    def _temporary(self) -> str:
        self._temporaries += 1
        return f"%t{self._temporaries}"

    def _type(self, value: Value) -> str:
        return self._type_of(self._program.kinds[value])

    def _type_of(self, kind: str) -> str:
        count = self._program.packed if kind.endswith("p") else self._width
        base = _BASE[kind[0]]
        return base if count == 1 and not kind.endswith("p") else f"<{count} x {base}>"

    def _word(self, value: Value) -> str:
        number = self._program.constants.get(value)
        if number is None:
            return f"%v{value}"
        kind = self._program.kinds[value]
        if kind == "f":
            # LLVM reads decimals only if they are exact, and the bits of a float always.
            word = "0x" + struct.pack(">d", number).hex().upper()
        elif kind == "b":
            word = "true" if number else "false"
        else:
            word = str(number)
        if self._width == 1:
            return word
        return "<" + ", ".join([f"{_BASE[kind]} {word}"] * self._width) + ">"

    def _write(self, block: Block) -> None:
        straight: list[_Straight] = []
        for entry in block.entries:
            if id(entry) not in self._live:
                continue
            if isinstance(entry, _Straight):
                if not (isinstance(entry, Operation) and entry.out in self._products):
                    straight.append(entry)
                continue
            self._write_straight(straight)
            straight = []
            if isinstance(entry, Branch):
                self._write_branch(entry)
            elif isinstance(entry, Call):
                self._lines.append(f"call void @f{entry.function}(ptr %memory)")
            else:
                self._write_loop(entry)
        self._write_straight(straight)

    def _write_straight(self, entries: list[_Straight]) -> None:
        for entry in self._by_need(entries):
            if isinstance(entry, Operation):
                self._write_operation(entry)
            elif isinstance(entry, LoadCell):
                self._write_load(entry)
            else:
                self._write_store(entry)

    def _by_need(self, entries: list[_Straight]) -> list[_Straight]:
        """Order entries so that operations come right before their first use.

        Loads, stores and results that other blocks use keep their order. Of the operations that an
        entry needs, the one at the end of the longest chain comes first. LLVM roughly keeps the
        order that it is given; in this one fewer values occupy registers, and a single run takes
        0.93 of the time.
        """
        definitions: dict[Value, Operation] = {}
        depths: dict[Value, int] = {}
        used_here: set[Value] = set()
        for entry in entries:
            needed = self._needed(entry)
            used_here.update(needed)
            if isinstance(entry, Operation):
                definitions[entry.out] = entry
                depths[entry.out] = 1 + max((depths.get(value, 0) for value in needed), default=0)
        ordered: list[_Straight] = []
        for entry in entries:
            if isinstance(entry, Operation) and entry.out in used_here:
                continue
            # Depth first, by a stack, since chains can be longer than Python's limit of recursion.
            stack: list[_Straight] = [entry]
            while stack:
                needed = [value for value in self._needed(stack[-1]) if value in definitions]
                if needed:
                    stack.append(definitions[max(needed, key=depths.__getitem__)])
                    continue
                last = stack.pop()
                ordered.append(last)
                if isinstance(last, Operation):
                    del definitions[last.out]
        return ordered

    def _needed(self, entry: _Straight) -> list[Value]:
        """Return the values that occur in an entry's text."""
        if isinstance(entry, LoadCell | StoreCell):
            given = (entry.index,) if isinstance(entry, LoadCell) else (entry.value, entry.index)
            return [value for value in given if value is not None]
        pairs = (self._products.get(value, (value,)) for value in entry.arguments)
        return [value for pair in pairs for value in pair]

    def _write_operation(self, entry: Operation) -> None:
        out, name, arguments = f"%v{entry.out}", entry.name, entry.arguments
        lines = self._lines
        if entry.out in self._fused:
            self._write_fused(entry)
            return
        words = [self._word(value) for value in arguments]
        kind = self._type(entry.out)
        first = self._type(arguments[0])
        if name in _PLAIN:
            lines.append(f"{out} = {_PLAIN[name]} {kind} {words[0]}, {words[1]}")
        elif name in _COMPARISONS:
            lines.append(f"{out} = {_COMPARISONS[name]} {first} {words[0]}, {words[1]}")
        elif name == "select":
            condition = self._type(arguments[0])
            lines.append(
                f"{out} = select {condition} {words[0]}, {kind} {words[1]}, {kind} {words[2]}"
            )
        elif name == "fneg":
            lines.append(f"{out} = fneg {kind} {words[0]}")
        elif name == "not":
            one = self._ones(entry.out)
            lines.append(f"{out} = xor {kind} {words[0]}, {one}")
        elif name in _CONVERSIONS:
            lines.append(f"{out} = {_CONVERSIONS[name]} {first} {words[0]} to {kind}")
        elif name in ("int_to_bool", "float_to_bool"):
            compare = "icmp ne" if name == "int_to_bool" else "fcmp une"
            lines.append(f"{out} = {compare} {first} {words[0]}, zeroinitializer")
        elif name == "float_to_int":
            self._write_call(out, kind, "llvm.fptosi.sat", [first], words, by_argument=True)
        elif name in _INTRINSICS:
            types = [self._type(value) for value in arguments]
            self._write_call(out, kind, f"llvm.{_INTRINSICS[name]}", types, words)
        elif name in LIBRARY:
            self._write_library(entry, words)
        elif name == "splat":
            one = self._temporary()
            lines.append(f"{one} = insertelement {kind} poison, {first} {words[0]}, i32 0")
            mask = f"<{self._program.packed} x i32> zeroinitializer"
            lines.append(f"{out} = shufflevector {kind} {one}, {kind} poison, {mask}")
        elif name == "build":
            self._write_build(entry, words)
        elif name == "element":
            k = self._program.constants[arguments[1]]
            lines.append(f"{out} = extractelement {first} {words[0]}, i32 {k}")
        elif name == "any":
            self._write_any(out, words[0], first)
        else:
            raise NotImplementedError(name)

    def _ones(self, value: Value) -> str:
        kind = self._type(value)
        if not kind.startswith("<"):
            return "true" if kind == "i1" else "-1"
        count, base = kind[1:-1].split(" x ")
        word = "true" if base == "i1" else "-1"
        return "<" + ", ".join([f"{base} {word}"] * int(count)) + ">"

    def _write_fused(self, entry: Operation) -> None:
        kind = self._type(entry.out)
        a, b = entry.arguments
        product, other = (a, b) if a in self._products else (b, a)
        words = [self._word(value) for value in (*self._products[product], other)]
        if entry.name == "fsub":
            # x y - z = fma(x, y, -z), and z - x y = fma(-x, y, z).
            k = 2 if product == a else 0
            negative = self._temporary()
            self._lines.append(f"{negative} = fneg {kind} {words[k]}")
            words[k] = negative
        self._write_call(f"%v{entry.out}", kind, "llvm.fma", [kind] * 3, words)

    def _write_call(
        self,
        out: str,
        kind: str,
        function: str,
        types: list[str],
        words: list[str],
        by_argument: bool = False,
    ) -> None:
        full = f"{function}.{_mangled(kind)}" + (f".{_mangled(types[0])}" if by_argument else "")
        self._declared[full] = f"declare {kind} @{full}({', '.join(types)})"
        given = ", ".join(f"{t} {word}" for t, word in zip(types, words, strict=True))
        self._lines.append(f"{out} = call {kind} @{full}({given})")

    def _write_library(self, entry: Operation, words: list[str]) -> None:
        """Call a function of the C library for each lane or tangent."""
        function, arity = entry.name, len(words)
        declared = ", ".join(["double"] * arity)
        self._declared[function] = f"declare double @{function}({declared}) nounwind memory(none)"
        kind = self._type(entry.out)
        if not kind.startswith("<"):
            given = ", ".join(f"double {word}" for word in words)
            self._lines.append(f"%v{entry.out} = call double @{function}({given})")
            return
        count, vector = int(kind[1:].split(" ")[0]), "poison"
        for k in range(count):
            parts = []
            for word in words:
                part = self._temporary()
                self._lines.append(f"{part} = extractelement {kind} {word}, i32 {k}")
                parts.append(f"double {part}")
            result = self._temporary()
            self._lines.append(f"{result} = call double @{function}({', '.join(parts)})")
            following = f"%v{entry.out}" if k == count - 1 else self._temporary()
            self._lines.append(
                f"{following} = insertelement {kind} {vector}, double {result}, i32 {k}"
            )
            vector = following

    def _write_build(self, entry: Operation, words: list[str]) -> None:
        kind, vector = self._type(entry.out), "poison"
        base = self._type(entry.arguments[0])
        count = self._program.packed
        words = [*words, *[words[-1]] * (count - len(words))]
        for k, word in enumerate(words):
            following = f"%v{entry.out}" if k == count - 1 else self._temporary()
            self._lines.append(
                f"{following} = insertelement {kind} {vector}, {base} {word}, i32 {k}"
            )
            vector = following

    def _write_any(self, out: str, word: str, kind: str) -> None:
        if kind == "i1":
            self._lines.append(f"{out} = or i1 {word}, false")
            return
        condition = self._scalar_condition(word, kind)
        one = self._temporary()
        self._lines.append(f"{one} = insertelement {kind} poison, i1 {condition}, i32 0")
        self._lines.append(
            f"{out} = shufflevector {kind} {one}, {kind} poison, "
            f"<{self._width} x i32> zeroinitializer"
        )

    def _scalar_condition(self, word: str, kind: str) -> str:
        """Return the LLVM name of an `i1` that is true if a condition holds in any lane.

        For a vector of lanes, the instruction that computes it is appended to the program's lines.

        **Arguments:** `word`: name of the condition; `kind`: its LLVM type, `i1` or a vector of
        `i1`.
        """
        if kind == "i1":
            return word
        reduce = f"llvm.vector.reduce.or.v{self._width}i1"
        self._declared[reduce] = f"declare i1 @{reduce}({kind})"
        result = self._temporary()
        self._lines.append(f"{result} = call i1 @{reduce}({kind} {word})")
        return result

    def _address(self, start: int, index: Value | None) -> str:
        out = self._temporary()
        if index is None:
            offset = str(start * self._width)
        else:
            word = self._first_lane(index)
            scaled, offset = self._temporary(), self._temporary()
            self._lines.append(f"{scaled} = mul i64 {word}, {self._width}")
            self._lines.append(f"{offset} = add i64 {scaled}, {start * self._width}")
        self._lines.append(f"{out} = getelementptr inbounds double, ptr %memory, i64 {offset}")
        return out

    def _lane_pointer(self, start: int, index: str, lane: int) -> str:
        """Append instructions for the address of one lane's number in memory; return its name.

        **Arguments:** `start`: first cell of the array; `index`: name of the vector of indices into
        the array, one for each lane; `lane`: number of the lane.
        """
        lane_index, scaled, offset, out = (self._temporary() for _ in range(4))
        width = self._width
        self._lines += [
            f"{lane_index} = extractelement <{width} x i64> {index}, i32 {lane}",
            f"{scaled} = mul i64 {lane_index}, {width}",
            f"{offset} = add i64 {scaled}, {start * width + lane}",
            f"{out} = getelementptr inbounds double, ptr %memory, i64 {offset}",
        ]
        return out

    def _load_by_lane(self, cell: str, entry: LoadCell) -> str:
        assert entry.index is not None
        index, vector, base = self._word(entry.index), "poison", cell[1:-1].split(" x ")[1]
        for lane in range(self._width):
            pointer = self._lane_pointer(entry.start, index, lane)
            part, following = self._temporary(), self._temporary()
            self._lines.append(f"{part} = load {base}, ptr {pointer}, align 8")
            self._lines.append(
                f"{following} = insertelement {cell} {vector}, {base} {part}, i32 {lane}"
            )
            vector = following
        return vector

    def _store_by_lane(self, cell: str, word: str, entry: StoreCell) -> None:
        assert entry.index is not None
        index, base = self._word(entry.index), cell[1:-1].split(" x ")[1]
        for lane in range(self._width):
            pointer, part = self._lane_pointer(entry.start, index, lane), self._temporary()
            self._lines.append(f"{part} = extractelement {cell} {word}, i32 {lane}")
            self._lines.append(f"store {base} {part}, ptr {pointer}, align 8")

    def _cell_type(self, value: Value) -> tuple[str, str]:
        """Return two LLVM types of a value: in memory and in operations.

        In memory all numbers have 64 bits; a condition is an `i64` there and an `i1` elsewhere.
        """
        kind = self._program.kinds[value]
        cell = kind if kind[0] == "f" else "i" + kind[1:]
        return self._type_of(cell), self._type_of(kind)

    def _write_load(self, entry: LoadCell) -> None:
        cell, kind = self._cell_type(entry.out)
        out = f"%v{entry.out}"
        if entry.index is None or self._program.is_uniform(entry.index):
            pointer = self._address(entry.start, entry.index)
            content = out if cell == kind else self._temporary()
            self._lines.append(f"{content} = load {cell}, ptr {pointer}, align 8")
        else:
            content = self._load_by_lane(cell, entry)
            if cell == kind:
                # A copy: LLVM has no instruction that only names a value.
                self._lines.append(f"{out} = freeze {cell} {content}")
        if cell == kind:
            return
        if self._program.kinds[entry.out][0] == "b":
            self._lines.append(f"{out} = icmp ne {cell} {content}, zeroinitializer")
        else:
            self._lines.append(f"{out} = trunc {cell} {content} to {kind}")

    def _write_store(self, entry: StoreCell) -> None:
        cell, kind = self._cell_type(entry.value)
        word = self._word(entry.value)
        if cell != kind:
            extend = "zext" if self._program.kinds[entry.value][0] == "b" else "sext"
            wide = self._temporary()
            self._lines.append(f"{wide} = {extend} {kind} {word} to {cell}")
            word = wide
        if entry.index is not None and not self._program.is_uniform(entry.index):
            self._store_by_lane(cell, word, entry)
            return
        pointer = self._address(entry.start, entry.index)
        self._lines.append(f"store {cell} {word}, ptr {pointer}, align 8")

    def _new_labels(self, *names: str) -> list[str]:
        self._labels += 1
        return [f"{name}{self._labels}" for name in names]

    def _begin(self, label: str) -> None:
        self._lines.append(f"{label}:")
        self._label = label

    def _write_branch(self, entry: Branch) -> None:
        yes, no, end = self._new_labels("yes", "no", "end")
        condition = self._scalar_condition(self._word(entry.condition), self._type(entry.condition))
        self._lines.append(f"br i1 {condition}, label %{yes}, label %{no}")
        ends = []
        for label, block in ((yes, entry.yes), (no, entry.no)):
            self._begin(label)
            self._write(block)
            ends.append(self._label)
            self._lines.append(f"br label %{end}")
        self._begin(end)
        for out, one, other in zip(entry.outs, entry.yes_values, entry.no_values, strict=True):
            self._lines.append(
                f"%v{out} = phi {self._type(out)} "
                f"[{self._word(one)}, %{ends[0]}], [{self._word(other)}, %{ends[1]}]"
            )

    def _write_loop(self, entry: Loop) -> None:
        head, body, end = self._new_labels("head", "body", "done")
        before = self._label
        self._lines.append(f"br label %{head}")
        self._begin(head)
        # The values that the body computes have no text yet: the phis are inserted afterwards.
        phis = len(self._lines)
        self._write(entry.head)
        condition = self._scalar_condition(self._word(entry.condition), self._type(entry.condition))
        self._lines.append(f"br i1 {condition}, label %{body}, label %{end}")
        self._begin(body)
        self._write(entry.body)
        last = self._label
        self._lines.append(f"br label %{head}")
        rows = zip(entry.carries, entry.first, entry.following, strict=True)
        self._lines[phis:phis] = [
            f"%v{carry} = phi {self._type(carry)} "
            f"[{self._word(first)}, %{before}], [{self._word(following)}, %{last}]"
            for carry, first, following in rows
        ]
        self._begin(end)


def _mangled(kind: str) -> str:
    """Return a type as LLVM writes it in names of functions."""
    names = {"double": "f64", "i64": "i64", "i32": "i32", "i1": "i1"}
    if not kind.startswith("<"):
        return names[kind]
    count, base = kind[1:-1].split(" x ")
    return f"v{count}{names[base]}"
