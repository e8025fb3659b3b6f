"""The text of a file, TOML or JSON, and its tables."""

import json
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from .complaints import FilePlace, Keys

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


def suffix_of(path: Path) -> str:
    """The format that a path asks for.

    **Raises:** `ValueError` for any but .toml and .json.
    """
    if path.suffix not in SUFFIXES:
        FilePlace(str(path)).refuse(path.suffix, "the suffix .toml or .json", "rename the file")
    return path.suffix


def parsed(text: str, suffix: str, file: str) -> Document:
    """The tables of a file's text.

    **Raises:** `ValueError` for text that is not of the format, with line and column.
    """
    try:
        if suffix == ".toml":
            return tomllib.loads(text)
        found = json.loads(text, object_pairs_hook=_without_repetition)
    except ValueError as error:
        raise ValueError(f"{file}: {error}; mend the {suffix[1:].upper()} there.") from error
    if not isinstance(found, dict):
        FilePlace(file).refuse(found, "an object with `bodies`", "write {...}")
    return {key: item for key, item in found.items() if key != SCHEMA}


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
