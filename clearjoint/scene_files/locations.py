"""Name locations in a file, and raise errors about the values there."""

import re
import tomllib
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import NoReturn, TypeAlias

from ..fields.checks import require

Keys: TypeAlias = tuple[str | int, ...]
"""Keys of tables and indices of lists that lead to a location."""
KEY = re.compile(r"""\[?(?:'([^']*)'|"([^"]*)"|([^.\[\]'"]+))\]?\.?""")
"""One key of a written path, without or with quotation marks, which may be in brackets. A written
path names a location by a text such as "joints.pin.clearance"."""
LONGEST = 60
"""Largest number of characters of a value that an error message shows."""


def split(text: str) -> tuple[str, ...]:
    """Return the keys and indices of a written path: ("joints", "crank pin", "clearance") for
    "joints.crank pin.clearance".

    Keys that contain dots are in quotation marks. Keys and indices may also be in brackets, as in
    "joints['crank pin'].clearance", the form that `clearjoint.parameters` returns. Characters that
    don't belong to a path, such as a second dot in a row, are skipped.
    """
    return tuple("".join(groups) for groups in KEY.findall(text))


def keys_of(text: str) -> tuple[str, ...]:
    """Return the keys and indices of a written path, see `split`.

    **Raises:** `ValueError` for a text that is not a path.
    """
    expected = "names with dots between, such as joints.pin.clearance"
    remedy = "put names that contain dots into quotation marks"
    is_whole = text != "" and "".join(key[0] for key in KEY.finditer(text)) == text
    require(is_whole, "path", text, expected, remedy)
    return split(text)


def written(keys: Keys) -> str:
    """Return the written path of keys and indices, such as "joints.crank pin.axis[0]"; keys that
    contain dots are quoted."""
    steps = [
        f"[{key}]" if isinstance(key, int) else f".'{key}'" if "." in key else f".{key}"
        for key in keys
    ]
    return "".join(steps).removeprefix(".")


def existing(content: object, keys: Sequence[str | int]) -> Keys:
    """Return the first of the given keys, up to the last one that exists in nested tables and
    lists: the part of a path that can be followed. Indices of lists are returned as integers.

    **Arguments:** `content`: the tables; `keys`: keys of tables and indices of lists.
    """
    found: list[str | int] = []
    for key in keys:
        if isinstance(content, Mapping) and key in content:
            content = content[key]
        elif isinstance(content, list) and str(key).isdecimal() and int(key) < len(content):
            key = int(key)
            content = content[key]
        else:
            break
        found.append(key)
    return tuple(found)


class Source:
    """The text of a file, in which error messages find the line of a value.

    - `changes`: changes that the command line makes, such as "joints.pin.clearance=2mm", by the
      keys of the changed value.

    **Arguments:** `text`: the text; `suffix`: ".toml" or ".json"; lines are found in TOML only.
    """

    def __init__(self, text: str, suffix: str):
        self._text, self._is_toml = text, suffix == ".toml"
        self.changes: dict[Keys, str] = {}

    def where(self, keys: Keys) -> str:
        """Return the text that a message adds to the path of the file for the value at `keys`.

        This is ", line 12" for the statement that sets the value or the closest table around it,
        " with --set …" for a value that the command line sets, and empty if neither is known.
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
        """Return the number, from 1 on, of the first line of the statement that sets an existing
        key."""
        lines = self._text.split("\n")

        def valid_lines(limit: int) -> tuple[int, object]:
            """Return the largest number of lines, at most `limit`, that are valid TOML if parsed
            alone, and their tables."""
            for count in range(limit, 0, -1):
                try:
                    return count, tomllib.loads("\n".join(lines[:count]) + "\n")
                except tomllib.TOMLDecodeError:
                    continue
            return 0, {}

        # tomllib reports no positions. The statement ends where the beginning of the file, if
        # parsed alone, has the key for the first time.
        end = bisect_left(
            range(len(lines)), True, key=lambda n: existing(valid_lines(n)[1], keys) == keys
        )
        # A statement of several lines begins after the valid text before it.
        first = valid_lines(end - 1)[0]
        while not lines[first].strip() or lines[first].lstrip().startswith("#"):
            first += 1
        return first + 1


class FileLocation:
    """Location of a value in a file.

    - `file`: path of the file.
    - `keys`: keys of tables and indices of lists that lead to the value.
    - `source`: text of the file, if known.
    """

    def __init__(self, file: str, keys: Keys = (), source: Source | None = None):
        self.file = file
        self.keys = keys
        self.source = source

    def at(self, *keys: str | int) -> "FileLocation":
        """Return the location of the entry to which further `keys` lead."""
        return FileLocation(self.file, (*self.keys, *keys), self.source)

    def __str__(self) -> str:
        where = "" if self.source is None else self.source.where(self.keys)
        return f"{self.file}{where}, `{written(self.keys)}`" if self.keys else self.file

    def refuse(self, value: object, expected: str, remedy: str) -> NoReturn:
        """Raise a `ValueError` that names this location, the `value` found there, what was
        `expected`, and the `remedy`: what the user can do."""
        raise ValueError(f"{self}: found {_shown(value)}, expected {expected}: {remedy}.")

    @contextmanager
    def in_errors(self) -> Iterator[None]:
        """Return a context in which messages of `ValueError` begin with this location, for errors
        of functions that know nothing of the file."""
        try:
            yield
        except ValueError as error:
            raise ValueError(f"{self}: {error}") from error


def _shown(value: object) -> str:
    """Return the text of a value for a message. Long lists are cut between entries, other values
    after `LONGEST` characters; of a table only the keys are shown."""
    if isinstance(value, Mapping):
        return f"a table with {_shown(list(value))}" if value else "an empty table"
    if isinstance(value, list | tuple) and value:
        texts = []
        for item in value:
            texts.append(_shown(item))
            if sum(map(len, texts)) > LONGEST and len(texts) < len(value):
                texts.append(f"... ({len(value)} entries)")
                break
        return f"[{', '.join(texts)}]"
    text = repr(value)
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}... ({len(text)} characters)"


def listed(names: Iterable[str]) -> str:
    """Return names as a text for a message, in alphabetical order; "none" without names."""
    return ", ".join(sorted(names)) or "none"
