"""Errors of a place in a file: where it is, what was found, what was expected, the remedy."""

import tomllib
from collections.abc import Iterable, Mapping
from typing import NoReturn, TypeAlias

Keys: TypeAlias = tuple[str | int, ...]
"""Keys of tables, and indices in lists, that lead to a place."""
LONGEST = 60
"""Characters of what was found that are shown."""
LONGEST_SOURCE = 100_000
"""Characters of a file in which lines are looked up."""


class Source:
    """The text of a file, in which the lines of its keys are found.

    `changes`: what was set otherwise than in the file, such as "joints.pin.clearance=2mm", by keys.
    """

    def __init__(self, text: str, suffix: str):
        self._text, self._is_toml = text, suffix == ".toml"
        self.changes: dict[Keys, str] = {}

    def where(self, keys: Keys) -> str:
        """The line of the statement that sets a key, or its closest table; empty if unknown."""
        for depth in range(1, len(keys) + 1):
            if keys[:depth] in self.changes:
                return f" with --set {self.changes[keys[:depth]]}"
        if not self._is_toml or len(self._text) > LONGEST_SOURCE:
            return ""
        whole = tomllib.loads(self._text)
        while keys and not _has(whole, keys):
            keys = keys[:-1]
        return f", line {self._line(keys)}" if keys else ""

    def _line(self, keys: Keys) -> int:
        """The first line of the statement that sets a key that is there.

        The parser itself decides: the statement is the last one of the shortest beginning of the
        file that is valid and has the key.
        """
        lines = self._text.split("\n")

        def valid_lines(most: int) -> tuple[int, object]:
            """Lines of the longest valid beginning, of so many lines at most, and its tables."""
            for count in range(most, 0, -1):
                try:
                    return count, tomllib.loads("\n".join(lines[:count]) + "\n")
                except tomllib.TOMLDecodeError:
                    continue
            return 0, {}

        without, enough = 0, len(lines)
        while enough - without > 1:
            middle = (without + enough) // 2
            if _has(valid_lines(middle)[1], keys):
                enough = middle
            else:
                without = middle
        first = valid_lines(enough - 1)[0]
        while not lines[first].strip() or lines[first].lstrip().startswith("#"):
            first += 1
        return first + 1


def _has(tables: object, keys: Keys) -> bool:
    for key in keys:
        try:
            tables = tables[key]  # pyright: ignore
        except (KeyError, IndexError, TypeError):
            return False
    return True


class FilePlace:
    """Where a value stands: a file, the keys that lead there, and the file's text if known."""

    def __init__(self, file: str, keys: Keys = (), source: Source | None = None):
        self.file = file
        self.keys = keys
        self.source = source

    def at(self, key: str | int) -> "FilePlace":
        """The place of an entry."""
        return FilePlace(self.file, (*self.keys, key), self.source)

    def __str__(self) -> str:
        shown = "".join(map(_step, self.keys)).removeprefix(".")
        where = "" if self.source is None else self.source.where(self.keys)
        return f"{self.file}{where}, `{shown}`" if shown else self.file

    def refuse(self, found: object, expected: str, remedy: str) -> NoReturn:
        """Raise the ``ValueError`` of a value that can't stand here."""
        raise ValueError(f"{self}: found {_shown(found)}, expected {expected}: {remedy}.")


def _shown(found: object) -> str:
    """What was found, cut between the entries of a table or list, and else after `LONGEST`."""
    if isinstance(found, Mapping):
        return f"a table with {_shown(list(found))}" if found else "an empty table"
    if isinstance(found, list | tuple) and found:
        texts, length = [], 0
        for item in found:
            texts.append(_shown(item))
            length += len(texts[-1])
            if length > LONGEST and len(texts) < len(found):
                texts.append(f"... ({len(found)} entries)")
                break
        return f"[{', '.join(texts)}]"
    text = repr(found)
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}... ({len(text)} characters)"


def _step(key: str | int) -> str:
    if isinstance(key, int):
        return f"[{key}]"
    return f".{key}" if key.replace("-", "_").isidentifier() else f".{key!r}"


def listed(names: Iterable[str]) -> str:
    """Names for a message, in their alphabet's order."""
    return ", ".join(sorted(names)) or "none"
