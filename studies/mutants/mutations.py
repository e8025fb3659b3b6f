"""Find all mutants of a source file: copies of its text in which one operator is changed."""

import ast
import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path

OPERATORS = {
    ast.Add: ("+", ["-"]),
    ast.Sub: ("-", ["+"]),
    ast.Mult: ("*", ["/"]),
    ast.Div: ("/", ["*"]),
    ast.FloorDiv: ("//", ["/"]),
    ast.Mod: ("%", ["*"]),
    ast.Pow: ("**", ["*"]),
    ast.MatMult: ("@", ["*"]),
    ast.BitAnd: ("&", ["|"]),
    ast.BitOr: ("|", ["&"]),
    ast.And: ("and", ["or"]),
    ast.Or: ("or", ["and"]),
    ast.Lt: ("<", ["<=", ">="]),
    ast.LtE: ("<=", ["<", ">"]),
    ast.Gt: (">", [">=", "<="]),
    ast.GtE: (">=", [">", "<"]),
    ast.Eq: ("==", ["!="]),
    ast.NotEq: ("!=", ["=="]),
    ast.Is: ("is", ["is not"]),
    ast.IsNot: ("is not", ["is"]),
    ast.In: ("in", ["not in"]),
    ast.NotIn: ("not in", ["in"]),
}
"""The text of each operator between two operands, and its replacements."""
UNARY = {ast.USub: "-", ast.Not: "not ", ast.Invert: "~"}
"""The text of each operator in front of an operand; it is removed."""
PAIRS = [
    ("sin", "cos"),
    ("sine", "cosine"),
    ("sinh", "cosh"),
    ("min", "max"),
    ("min_", "max_"),
    ("minimum", "maximum"),
    ("argmin", "argmax"),
    ("any", "all"),
    ("logical_and", "logical_or"),
]
"""Functions that replace each other."""
EXCHANGED = {**dict(PAIRS), **{second: first for first, second in PAIRS}}
SELECTIONS = {"where"}
"""Functions whose second and third arguments are exchanged."""
OF_TEXT = {"__repr__", "__str__"}
"""Methods that are left out, like all functions that are annotated to return text."""


@dataclass(frozen=True)
class Mutant:
    """A source file with one change.

    - `file`: path from the root of the checkout.
    - `function`: name of the changed function, after those of the classes and functions around it.
    - `lines`: numbers of the first and last line of the changed statement, or of its head.
    - `start`, `end`: where the replaced text begins and ends in the file, in bytes.
    - `offset`: where it begins in the function, in bytes.
    - `old`, `new`: the replaced text and its replacement.
    - `code`: the line in which the replaced text begins.
    """

    file: str
    function: str
    lines: tuple[int, int]
    start: int
    end: int
    offset: int
    old: str
    new: str
    code: str

    @property
    def room(self) -> str:
        """The folder in the package without underscore, such as "dynamics"."""
        return Path(self.file).parts[1].removeprefix("_")

    @property
    def identity(self) -> str:
        """Text that no other mutant has; it does not depend on the code outside of the function.

        Underscores of rooms are left out, so that the order of mutants is that of before the rooms
        had them.
        """
        return f"{self.file.replace('/_', '/')} {self.function} {self.offset} {self.old} {self.new}"

    def applied(self, text: str) -> str:
        """Return the file's text with the change."""
        content = text.encode()
        return (content[: self.start] + self.new.encode() + content[self.end :]).decode()

    def __str__(self) -> str:
        return f"{self.file}, {self.function}: `{self.old}` becomes `{self.new}` in `{self.code}`"


def in_random_order(root: Path, rooms: Sequence[str], seed: int) -> list[Mutant]:
    """Return all mutants of the functions in some rooms, in a random order.

    They are sorted by digests, so that a change of a function leaves the order of the mutants of
    all other functions as it was.
    """
    files = [file for room in rooms for file in (root / "clearjoint" / f"_{room}").rglob("*.py")]
    found = [mutant for file in files for mutant in mutants_of(root, file)]

    def digest(mutant: Mutant) -> bytes:
        return hashlib.sha256(f"{seed} {mutant.identity}".encode()).digest()

    return sorted(found, key=digest)


def mutants_of(root: Path, file: Path) -> list[Mutant]:
    """Return all mutants of the functions of a source file, in the order of the text.

    Left out are annotations, decorators, docstrings, messages of errors, and functions that return
    text, since they compute nothing.
    """
    text = file.read_text(encoding="utf-8")
    finder = _Finder(str(file.relative_to(root)), text)
    finder.visit(ast.parse(text))
    return sorted(finder.found, key=lambda mutant: (mutant.start, mutant.new))


class _Finder(ast.NodeVisitor):
    """Visit a module, and collect the mutants of its functions in `found`."""

    def __init__(self, file: str, text: str):
        self.found: list[Mutant] = []
        self._file, self._content = file, text.encode()
        self._lines = self._content.splitlines(keepends=True)
        self._starts = [0, *accumulate(map(len, self._lines))]
        self._names: list[str] = []
        self._function: int | None = None
        """Where the present function begins, in bytes; ``None`` outside of functions."""
        self._statement = (0, 0)

    def visit(self, node: ast.AST) -> None:
        """Visit a node; a statement becomes the one to which the mutants inside belong."""
        before = self._statement
        if isinstance(node, ast.stmt):
            # Of a statement with a body, the lines of the head alone.
            body = getattr(node, "body", None)
            last = body[0].lineno - 1 if body else node.end_lineno
            self._statement = (node.lineno, max(node.lineno, last or 0))
        super().visit(node)
        self._statement = before

    def visit_ClassDef(self, node: ast.ClassDef) -> None:  # noqa: N802
        """Visit the body only."""
        self._names.append(node.name)
        for child in node.body:
            self.visit(child)
        self._names.pop()

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:  # noqa: N802
        """Visit default values and body."""
        if node.name in OF_TEXT or (node.returns and ast.unparse(node.returns) == "str"):
            return
        before = self._function
        self._function = self._offset(node.lineno, node.col_offset)
        self._names.append(node.name)
        defaults = [*node.args.defaults, *filter(None, node.args.kw_defaults)]
        for child in [*defaults, *node.body]:
            self.visit(child)
        self._names.pop()
        self._function = before

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:  # noqa: N802
        """Visit the value only."""
        if node.value:
            self.visit(node.value)

    def visit_Raise(self, node: ast.Raise) -> None:  # noqa: N802
        """Leave out."""

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:  # noqa: N802
        """Leave out."""

    def visit_BinOp(self, node: ast.BinOp) -> None:  # noqa: N802
        """Replace the operator, unless it joins texts."""
        if not any(_is_text(side) for side in (node.left, node.right)):
            self._between(node.left, node.op, node.right)
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:  # noqa: N802
        """Replace the operator, unless it joins texts."""
        if not _is_text(node.value):
            self._between(node.target, node.op, node.value)
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:  # noqa: N802
        """Replace each operator."""
        for left, right in zip(node.values, node.values[1:], strict=False):
            self._between(left, node.op, right)
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:  # noqa: N802
        """Replace each operator."""
        operands = [node.left, *node.comparators]
        for left, operator, right in zip(operands, node.ops, operands[1:], strict=False):
            self._between(left, operator, right)
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:  # noqa: N802
        """Remove the operator."""
        if type(node.op) in UNARY:
            start = self._offset(node.lineno, node.col_offset)
            length = len(UNARY[type(node.op)])
            self._add(start, start + length, "")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:  # noqa: N802
        """Exchange 0 and 1, and add one to other numbers."""
        if isinstance(node.value, int | float) and not isinstance(node.value, bool):
            value = 1 - node.value if node.value in (0, 1) else node.value + 1
            self._add(*self._span(node), repr(value))

    def visit_Call(self, node: ast.Call) -> None:  # noqa: N802
        """Exchange the branches of `where`, minimum and maximum, sine and cosine."""
        match node.func:
            case ast.Name(id=name) | ast.Attribute(attr=name):
                end = self._span(node.func)[1]
                if name in EXCHANGED:
                    self._add(end - len(name), end, EXCHANGED[name])
                if name in SELECTIONS and len(node.args) == 3:
                    (start, middle), (other, last) = map(self._span, node.args[1:])
                    parts = [(other, last), (middle, other), (start, middle)]
                    self._add(start, last, "".join(self._text(*part) for part in parts))
        self.generic_visit(node)

    def _between(self, left: ast.expr, operator: ast.AST, right: ast.expr) -> None:
        """Add the mutants of an operator between two operands."""
        if type(operator) not in OPERATORS:
            return
        old, replacements = OPERATORS[type(operator)]
        start, end = self._span(left)[1], self._span(right)[0]
        # Besides the operator there are only parentheses, line ends and comments.
        between = re.sub(r"#.*", lambda comment: " " * len(comment[0]), self._text(start, end))
        place = re.search(re.escape(old).replace(r"\ ", r"\s+"), between)
        assert place is not None, f"{self._file}: no {old!r} in {between!r}"
        for new in replacements:
            self._add(start + place.start(), start + place.end(), new)

    def _add(self, start: int, end: int, new: str) -> None:
        if self._function is None:
            return
        line = self._content.count(b"\n", 0, start)
        self.found.append(
            Mutant(
                self._file,
                ".".join(self._names),
                self._statement,
                start,
                end,
                start - self._function,
                self._text(start, end),
                new,
                self._lines[line].decode().strip(),
            )
        )

    def _span(self, node: ast.expr) -> tuple[int, int]:
        assert node.end_lineno is not None and node.end_col_offset is not None
        return (
            self._offset(node.lineno, node.col_offset),
            self._offset(node.end_lineno, node.end_col_offset),
        )

    def _offset(self, line: int, column: int) -> int:
        return self._starts[line - 1] + column

    def _text(self, start: int, end: int) -> str:
        return self._content[start:end].decode()


def _is_text(node: ast.expr) -> bool:
    """Return whether an expression is a literal text, or a sum that contains one."""
    if isinstance(node, ast.BinOp):
        return _is_text(node.left) or _is_text(node.right)
    return isinstance(node, ast.JoinedStr) or (
        isinstance(node, ast.Constant) and isinstance(node.value, str)
    )
