"""What is said of a place in a file: where it is, what was found, what was expected, the remedy."""

from collections.abc import Iterable
from typing import NoReturn, TypeAlias

Keys: TypeAlias = tuple[str | int, ...]
"""Keys of tables, and indices in lists, that lead to a place."""
LONGEST = 60
"""Letters of what was found that are shown."""


class FilePlace:
    """Where a value stands: a file and the keys that lead there."""

    def __init__(self, file: str, keys: Keys = ()):
        self.file = file
        self.keys = keys

    def at(self, key: str | int) -> "FilePlace":
        """The place of an entry."""
        return FilePlace(self.file, (*self.keys, key))

    def __str__(self) -> str:
        shown = "".join(map(_step, self.keys)).removeprefix(".")
        return f"{self.file}, `{shown or 'top level'}`"

    def refuse(self, found: object, expected: str, remedy: str) -> NoReturn:
        """Raise the ``ValueError`` of a value that can't stand here."""
        text = repr(found)
        text = text if len(text) <= LONGEST else f"{text[:LONGEST]}..."
        raise ValueError(f"{self}: found {text}, expected {expected}: {remedy}.")


def _step(key: str | int) -> str:
    if isinstance(key, int):
        return f"[{key}]"
    return f".{key}" if key.replace("-", "_").isidentifier() else f".{key!r}"


def listed(names: Iterable[str]) -> str:
    """Names for a message, in their alphabet's order."""
    return ", ".join(sorted(names)) or "none"
