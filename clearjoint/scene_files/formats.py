"""Parse and format the text of TOML and JSON files.

The limits on sizes and depths stop files that would exhaust time or memory.
"""

import json
import re
import tomllib
from collections.abc import Mapping
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import TypeAlias

from jaxtyping import PyTree

from .locations import FileLocation, Keys, Source

Document: TypeAlias = dict[str, object]
"""Content of a file, as parsed: nested dictionaries (tables), lists, numbers and texts."""
Units: TypeAlias = Mapping[Keys, str]
"""Units of all values in a file, by the keys that lead to them; "1" for values without unit."""
SUFFIXES = ".toml", ".json"
"""Suffixes of the files that can be read and written."""
SCHEMA = "$schema"
"""The key under which a JSON file names its JSON Schema."""
DEEPEST = 32
"""Largest number of nested tables and lists in a file."""
DEEP_KEY = re.compile(rf"""(?<![\w"'-])(?:[\w"'-]++[ \t]*+\.[ \t]*+){{{DEEPEST}}}""")
"""A dotted key with at least `DEEPEST` dots. It is refused before tomllib reads the text, since
tomllib's time grows with the square of the key's length."""


def suffix_of(path: Path) -> str:
    """Return the suffix of a path, ".toml" or ".json".

    **Raises:** `ValueError` for another suffix.
    """
    if path.suffix not in SUFFIXES:
        FileLocation(str(path)).refuse(path.suffix, "the suffix .toml or .json", "rename the file")
    return path.suffix


def read_document(path: Path) -> tuple[Document, FileLocation]:
    """Read a TOML or JSON file; return its tables and their location, for error messages.

    **Raises:** `ValueError` for a suffix other than .toml and .json, for bytes that are not UTF-8,
    for a file of more than 200 MB, and as `parse`.
    """
    suffix, location = suffix_of(path), FileLocation(str(path))
    content = read_bytes(path, 200_000_000)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        byte = f"byte 0x{content[error.start]:02x} at position {error.start}"
        location.refuse(byte, "UTF-8 text", "save the file in the encoding UTF-8")
    location.source = Source(text, suffix)
    return parse(text, suffix, str(path)), location


def read_bytes(path: Path, most: int) -> bytes:
    """Return the content of a file.

    **Raises:** `ValueError` for a file of more than `most` bytes.
    """
    size = path.stat().st_size
    if size > most:
        FileLocation(str(path)).refuse(f"{size} bytes", f"at most {most}", "shorten the file")
    return path.read_bytes()


def parse(text: str, suffix: str, file: str) -> Document:
    """Return the tables of the text of a file, without the reference of a JSON file to its schema.

    **Arguments:** `suffix`: ".toml" or ".json"; `file`: path of the file, for messages.

    **Raises:** `ValueError` with line and column for text that is not valid, and for more than
    `DEEPEST` nested tables and lists.
    """
    try:
        is_deep = suffix == ".toml" and DEEP_KEY.search(text) is not None
        if suffix == ".json":
            content = json.loads(text, object_pairs_hook=_without_repetition)
        else:
            content = {} if is_deep else tomllib.loads(text)
    except RecursionError:  # the parsers follow nested content by recursion
        content, is_deep = {}, True
    except ValueError as error:
        # Python's message about a number with too many digits ends with advice for programmers.
        reason = str(error).split("; use sys.", maxsplit=1)[0]
        raise ValueError(f"{file}: {reason}; correct the {suffix[1:].upper()}.") from error
    if is_deep or (isinstance(content, dict | list) and _is_deep(content)):
        expected = f"at most {DEEPEST} levels"
        FileLocation(file).refuse("deeper tables or lists", expected, "nest them less deeply")
    if not isinstance(content, dict):
        FileLocation(file).refuse(content, "an object with `bodies`", "write {...}")
    return {key: item for key, item in content.items() if key != SCHEMA}


def _is_deep(content: dict | list) -> bool:
    """Return whether more than `DEEPEST` tables and lists are nested."""
    # By level instead of recursion, whose depth Python limits.
    level = [content]
    for _ in range(DEEPEST + 1):
        entries = [node.values() if isinstance(node, dict) else node for node in level]
        level = [item for items in entries for item in items if isinstance(item, dict | list)]
        if not level:
            return False
    return True


def _without_repetition(pairs: list[tuple[str, object]]) -> Document:
    """Return the table of an object in a JSON file, given as pairs of a key and a value.

    **Raises:** `ValueError` for a key that occurs twice, of which `json` would silently take the
    last value; TOML forbids it.
    """
    table: Document = {}
    for name, value in pairs:
        if name in table:
            raise ValueError(f"the key {name!r} occurs twice in one object")
        table[name] = value
    return table


def format_document(document: Document, suffix: str, units: Units, schema: str | None) -> str:
    """Return the text of a file with the given tables; TOML has the units in comments.

    **Arguments:** `suffix`: ".toml" or ".json"; `units`: units of the values, by the keys that lead
    to them; `schema`: name of the JSON Schema file to which the text refers for editors, or None.
    """
    if suffix == ".json":
        whole = document if schema is None else {SCHEMA: schema, **document}
        return json.dumps(whole, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    import tomlkit  # only needed to write
    from tomlkit.items import Array, Table

    tables: PyTree = tomlkit.item(document)
    for (*parents, last), unit in units.items():
        # Only entries of tables can have comments; entries of lists and of inline tables share a
        # line with others.
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
