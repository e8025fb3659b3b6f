"""Text of TOML and JSON files, and locations in them for error messages.

A location is the keys of tables and the indices of lists that lead to it; its text, such as
"joints.pin.axis[0]", is a path. Limits stop files that would exhaust time or memory.
"""

import ast
import json
import re
import reprlib
import tomllib
import warnings
from bisect import bisect_left
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass
from functools import reduce
from itertools import count, islice
from operator import getitem
from pathlib import Path
from typing import NoReturn, TypeAlias

from jaxtyping import PyTree
from typing_extensions import override

from .._fields.checks import errors_about, require

Keys: TypeAlias = tuple[str | int, ...]
QUOTED = r"""'(?:[^'\\]|\\.)*'|"(?:[^"\\]|\\.)*\""""
"""Pattern of a key in quotation marks, as a string of Python: a backslash begins an escape."""
NAME = rf"""{QUOTED}|[^.\[\]'"]+"""
"""Pattern of one key or index, with or without quotation marks."""
KEY = re.compile(rf"\[({NAME})\]|(?:^|(?!^)\.)({NAME})")
"""Pattern of one key or index of a path: in brackets, after a dot, or at the beginning."""
SHORT = reprlib.Repr()
SHORT.maxlist = SHORT.maxtuple = 12
SHORT.maxstring = SHORT.maxother = 60


def split(text: str) -> tuple[str, ...]:
    """Return the keys and indices of a path as texts: ("joints", "pin", "axis", "0") for
    "joints.pin.axis[0]" or "joints['pin'].axis[0]". Other characters are skipped."""
    return tuple(map(_name, map("".join, KEY.findall(text))))


def _name(text: str) -> str:
    if text[0] not in "'\"":
        return text
    # Python warns of unknown escapes, such as \d, and refuses incomplete ones, such as \x.
    with suppress(ValueError, SyntaxError), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return ast.literal_eval(text)
    return text[1:-1]


def keys_of(text: str) -> tuple[str, ...]:
    """Return the keys and indices of a path as `split` does, but raise a `ValueError` for a path
    that is empty or has characters that `split` would skip."""
    expected = "names with dots between, such as joints.pin.clearance"
    remedy = "put names that contain dots into quotation marks"
    is_whole = text != "" and "".join(key[0] for key in KEY.finditer(text)) == text
    require(is_whole, "path", text, expected, remedy)
    return split(text)


def written(keys: Keys) -> str:
    """Return keys and indices as text: "joints.pin.axis[0]" for ("joints", "pin", "axis", 0). Keys
    with dots, brackets, quotes, equals signs or unprintable characters are quoted."""

    def quoted(key: str) -> str:
        is_plain = re.fullmatch(r"""[^.\[\]'"=]+""", key) and key.isprintable()
        return key if is_plain else repr(key)

    steps = (f"[{key}]" if isinstance(key, int) else f".{quoted(key)}" for key in keys)
    return "".join(steps).removeprefix(".")


def existing(content: object, keys: Sequence[str | int]) -> Keys:
    """Return the longest start of `keys` that exists in `content`, with indices as integers."""
    steps: list[str | int] = []
    for key in keys:
        if isinstance(content, Mapping) and key in content:
            content = content[key]
        elif isinstance(content, list) and str(key).isdecimal() and int(key) < len(content):
            key = int(key)
            content = content[key]
        else:
            break
        steps.append(key)
    return tuple(steps)


class Source:
    """Text of a file, for error messages that tell where a value is set. `changes`: the options
    ``--set`` of the command line, by the keys of the values that they set."""

    def __init__(self, text: str, suffix: str):
        self._text, self._is_toml = text, suffix == ".toml"
        self.changes: dict[Keys, str] = {}

    def where(self, keys: Keys) -> str:
        """Return where the value at `keys` is set, as a text that follows the name of the file.

        It is " with --set run.end=2", or ", line 12": the first line of the statement that sets the
        value or, if the file lacks the value, its table. It is empty if the line is unknown.
        """
        for depth in range(1, len(keys) + 1):
            if keys[:depth] in self.changes:
                return f" with --set {self.changes[keys[:depth]]}"
        # Lines of longer files would take too long to find, by parsing parts of the file again and
        # again.
        if not self._is_toml or len(self._text) > 100_000:
            return ""
        keys = existing(tomllib.loads(self._text), keys)  # a missing key: the table around it
        return f", line {self._line(keys)}" if keys else ""

    def _line(self, keys: Keys) -> int:
        """Return the number, from 1 on, of the line where the statement that sets `keys` begins."""
        lines = self._text.split("\n")

        def valid_lines(limit: int) -> tuple[int, object]:
            # The longest beginning of the file, of at most `limit` lines, that is valid TOML: its
            # number of lines and its content.
            for size in range(limit, 0, -1):
                with suppress(tomllib.TOMLDecodeError):
                    return size, tomllib.loads("\n".join(lines[:size]) + "\n")
            return 0, {}

        # tomllib reports no positions. The statement ends where the beginning of the file, if
        # parsed alone, has the key for the first time. Every longer beginning has it too, so that
        # bisection finds the line.
        end = bisect_left(
            range(len(lines)), True, key=lambda n: existing(valid_lines(n)[1], keys) == keys
        )
        # A statement of several lines begins after the valid text before it, and after empty lines
        # and comments.
        start = valid_lines(end - 1)[0]
        while not lines[start].strip() or lines[start].lstrip().startswith("#"):
            start += 1
        return start + 1  # `start` counts lines from 0


@dataclass
class FileLocation:
    file: str
    keys: Keys = ()
    source: Source | None = None

    def at(self, *keys: str | int) -> "FileLocation":
        return FileLocation(self.file, (*self.keys, *keys), self.source)

    @override
    def __str__(self) -> str:
        where = "" if self.source is None else self.source.where(self.keys)
        return f"{self.file}{where}, `{written(self.keys)}`" if self.keys else self.file

    def refuse(self, value: object, expected: str, remedy: str) -> NoReturn:
        raise ValueError(f"{self}: found {_shown(value)}, expected {expected}: {remedy}.")

    def in_errors(self) -> AbstractContextManager[None]:
        return errors_about(self)


def _shown(value: object) -> str:
    if isinstance(value, Mapping):
        return f"a table with {SHORT.repr(list(value))}" if value else "an empty table"
    return SHORT.repr(value)


def listed(names: Iterable[str]) -> str:
    return ", ".join(sorted(names)) or "none"


Document: TypeAlias = dict[str, object]
Units: TypeAlias = Mapping[Keys, str]
"""Unit of each value in a file, by the keys that lead to the value; "1" for none."""
SUFFIXES = ".toml", ".json"
SCHEMA = "$schema"
DEEPEST = 32
"""Largest depth of nested tables and lists in a file."""
DEEP_KEY = re.compile(rf"""(?<![\w"'-])(?:[\w"'-]++[ \t]*+\.[ \t]*+){{{DEEPEST}}}""")
"""Pattern of a dotted key with at least `DEEPEST` dots; the time that tomllib takes grows with the
square of the number of dots."""


JSON_END = re.compile(r'"(?:[^"\\]|\\.)*"|\}')
"""Pattern of the brace at the end of an object in JSON, or of a whole string."""


def suffix_of(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        FileLocation(str(path)).refuse(path.suffix, "the suffix .toml or .json", "rename the file")
    return suffix


def read_document(path: Path) -> tuple[Document, FileLocation]:
    suffix, location = suffix_of(path), FileLocation(str(path))
    content = read_bytes(path, 200_000_000)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        # The decoder counts from the end of a byte order mark.
        position = error.start + len(content) - len(error.object)
        byte = f"byte 0x{content[position]:02x} at position {position}"
        location.refuse(byte, "UTF-8 text", "save the file in the encoding UTF-8")
    location.source = Source(text, suffix)
    return parse(text, suffix, str(path)), location


def read_bytes(path: Path, most: int) -> bytes:
    size = path.stat().st_size
    if size > most:
        FileLocation(str(path)).refuse(f"{size} bytes", f"at most {most}", "shorten the file")
    return path.read_bytes()


def parse(text: str, suffix: str, file: str) -> Document:  # without the key `SCHEMA`
    try:
        # tomllib would take too long for a key with very many dots, so such a text is not parsed.
        is_deep = suffix == ".toml" and DEEP_KEY.search(text) is not None
        if suffix == ".json":
            content = _parsed_json(text)
        else:
            content = {} if is_deep else tomllib.loads(text)
        is_deep = is_deep or _depth(content) > DEEPEST + 1  # 1 for the file, which is a table
    except RecursionError:  # of a parser or of `_depth`
        content, is_deep = {}, True
    except ValueError as error:
        # Python's message about a number with too many digits ends with advice for programmers.
        reason = str(error).split("; use sys.", maxsplit=1)[0]
        raise ValueError(f"{file}: {reason}; correct the {suffix[1:].upper()}.") from error
    if is_deep:
        expected = f"at most {DEEPEST} levels"
        FileLocation(file).refuse("deeper tables or lists", expected, "nest them less deeply")
    if not isinstance(content, dict):
        FileLocation(file).refuse(content, "an object with `bodies`", "write {...}")
    return {key: item for key, item in content.items() if key != SCHEMA}


def _depth(content: object) -> int:
    if not isinstance(content, dict | list):
        return 0
    entries = content.values() if isinstance(content, dict) else content
    return 1 + max(map(_depth, entries), default=0)


def _parsed_json(text: str) -> object:
    """Return the content of a JSON text; refuse repeated keys, of which `json` takes the last."""
    numbers = count()

    # The parser calls this function for each object, with its keys and values.
    def table(pairs: list[tuple[str, object]]) -> Document:
        number, content = next(numbers), dict(pairs)
        if len(content) < len(pairs):
            repeated, _ = Counter(name for name, _ in pairs).most_common(1)[0]
            # The parser makes the tables in the order in which their objects end.
            ends = (match.start() for match in JSON_END.finditer(text) if match[0] == "}")
            message = f"the key {repeated!r} occurs twice in the object that ends here"
            raise json.JSONDecodeError(message, text, next(islice(ends, number, None)))
        return content

    return json.loads(text, object_pairs_hook=table)


def format_document(document: Document, suffix: str, units: Units, schema: str | None) -> str:
    """Return the text of a file of the format `suffix` with the tables `document`, with the `units`
    as comments in TOML, and with a reference to the JSON Schema file `schema`, if any."""
    if suffix == ".json":
        content = document if schema is None else {SCHEMA: schema, **document}
        return json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    import tomlkit  # only needed to write
    from tomlkit.items import Array, Table

    tables: PyTree = tomlkit.item(document)
    for (*parents, last), unit in units.items():
        # Only entries of tables can have comments, because entries of lists and of inline tables
        # share a line with other entries. For entries without comment, `item` is an empty text, so
        # that they are skipped in the same way as texts and tables, which have no unit.
        parent = reduce(getitem, parents, tables) if isinstance(last, str) else None
        item: PyTree = parent[str(last)] if isinstance(parent, Table) else ""
        if isinstance(item, str | Mapping):
            continue
        if unit != "1":
            item.comment(unit)
        # An array of more than 12 entries, such as a table of values, would make too long a line.
        if isinstance(item, Array):
            item.multiline(len(item) > 12)
    text = tomlkit.dumps(tables)
    return text if schema is None else f"#:schema ./{schema}\n{text}"
