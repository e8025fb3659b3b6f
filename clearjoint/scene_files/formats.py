"""The text of a file, TOML or JSON, and its tables."""

import json
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from .complaints import FilePlace, Keys, Source

if TYPE_CHECKING:
    from tomlkit.items import Array, Item, Table

Document: TypeAlias = dict[str, object]
Units: TypeAlias = Mapping[Keys, str]
"""The unit of the numbers at a place, by its keys."""
SUFFIXES = ".toml", ".json"
SCHEMA = "$schema"
"""Where a JSON file says what describes it."""
LONGEST_LINE = 12
"""Numbers of a list in one line."""
DEEPEST = 32
"""Levels of tables and lists in a file, at most."""
DEEP_KEY = re.compile(rf"""(?<![\w"'-])(?:[\w"'-]++[ \t]*+\.[ \t]*+){{{DEEPEST}}}""")
"""A dotted key that nests too deeply, on which tomllib spends the square of its length."""
LARGEST = 200_000_000
"""Bytes of a file, at most."""


def suffix_of(path: Path) -> str:
    """The format that a path asks for.

    **Raises:** `ValueError` for any but .toml and .json.
    """
    if path.suffix not in SUFFIXES:
        FilePlace(str(path)).refuse(path.suffix, "the suffix .toml or .json", "rename the file")
    return path.suffix


def read_document(path: Path) -> tuple[Document, FilePlace]:
    """The tables of a file, and the place of their top level, for messages.

    **Raises:** `ValueError` for any other suffix than .toml and .json, for bytes that are not
    UTF-8, for a file that is too large, and as `parsed`.
    """
    suffix, place = suffix_of(path), FilePlace(str(path))
    size = path.stat().st_size
    if size > LARGEST:
        place.refuse(f"{size} bytes", f"at most {LARGEST}", "shorten the tables of numbers in it")
    content = path.read_bytes()
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        byte = f"byte 0x{content[error.start]:02x} at position {error.start}"
        place.refuse(byte, "UTF-8 text", "save the file in the encoding UTF-8")
    return parsed(text, suffix, str(path)), FilePlace(str(path), source=Source(text, suffix))


def parsed(text: str, suffix: str, file: str) -> Document:
    """The tables of a file's text.

    **Raises:** `ValueError` for text that is not of the format, with line and column, and for
    tables and lists inside one another to more than `DEEPEST` levels.
    """
    try:
        if suffix == ".toml" and DEEP_KEY.search(text):
            found = None
        elif suffix == ".toml":
            found = tomllib.loads(text)
        else:
            found = json.loads(text, object_pairs_hook=_without_repetition)
    except RecursionError:
        found = None
    except ValueError as error:
        reason = str(error).split("; use sys.", maxsplit=1)[0]
        raise ValueError(f"{file}: {reason}; mend the {suffix[1:].upper()} there.") from error
    if found is None or (isinstance(found, dict | list) and _is_deep(found)):
        expected = f"at most {DEEPEST} levels"
        FilePlace(file).refuse("deeper tables or lists", expected, "nest them less deeply")
    if not isinstance(found, dict):
        FilePlace(file).refuse(found, "an object with `bodies`", "write {...}")
    return {key: item for key, item in found.items() if key != SCHEMA}


def _is_deep(found: dict | list) -> bool:
    """Whether tables and lists are nested to more than `DEEPEST` levels; without recursion, whose
    depth Python limits."""
    level = [found]
    for _ in range(DEEPEST + 1):
        inside = [one.values() if isinstance(one, dict) else one for one in level]
        level = [item for items in inside for item in items if isinstance(item, dict | list)]
        if not level:
            return False
    return True


def _without_repetition(pairs: list[tuple[str, object]]) -> Document:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"the key {twice!r} stands twice in one object")
    return found


def text_of(document: Document, suffix: str, units: Units, schema: str | None) -> str:
    """The text of a file; TOML with its units in comments.

    **Arguments:** `schema`: the name of the JSON Schema beside it, for editors.
    """
    if suffix == ".json":
        described = document if schema is None else {SCHEMA: schema, **document}
        return json.dumps(described, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    import tomlkit  # only what is written needs it

    text = tomlkit.dumps(_toml_table(document, (), units))
    return text if schema is None else f"#:schema ./{schema}\n{text}"


def _toml_table(plain: Mapping[str, object], keys: Keys, units: Units) -> "Table":
    import tomlkit

    table = tomlkit.table(is_super_table=bool(plain) and all(map(_is_mapping, plain.values())))
    for key, value in plain.items():
        here = (*keys, key)
        item = _toml_item(value, here, units)
        unit = None if isinstance(value, str | Mapping) else units.get(here)
        if unit not in (None, "1"):
            item.comment(unit)
        table.add(key, item)
    return table


def _toml_item(value: object, keys: Keys, units: Units) -> "Item":
    import tomlkit

    if isinstance(value, Mapping):
        return _toml_table(value, keys, units)
    if isinstance(value, list) and value and all(map(_is_mapping, value)):
        tables = tomlkit.aot()
        for k, entry in enumerate(value):
            tables.append(_toml_table(entry, (*keys, k), units))
        return tables
    if isinstance(value, list):
        return _toml_array(value)
    return tomlkit.item(value)


def _toml_array(value: list) -> "Array":
    import tomlkit

    array = tomlkit.array()
    array.extend(value)
    return array.multiline(len(value) > LONGEST_LINE)


def _is_mapping(value: object) -> bool:
    return isinstance(value, Mapping)
