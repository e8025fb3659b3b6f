"""What values are, in words that another process would use too: their data, and their code.

A value that holds a class or a function, of a notebook say, is described by all that this can
reach: its code, bases, defaults, closures, and globals of its module that it uses, helpers in other
files among them. Code of this package and of trusted ones is described by its name. What can't be
described raises `UndescribedError`.
"""

import hashlib
from collections import deque

from .trusted_names import trusted_name
from .value_words import words_of
from .words import DATA, Part, Unordered, Words


class Description:
    """The digest of values and of all that they can reach.

    Each value is described once, and where it occurs again by its number, so that values may hold
    one another.
    """

    def __init__(self) -> None:
        self._hash = hashlib.blake2b(digest_size=20)
        self._numbers: dict[int, int] = {}
        self._waiting: deque[object] = deque()
        self._kept: list[object] = []
        self.packages: set[str] = set()
        """Modules of trusted classes and functions that occur."""

    def add(self, value: object) -> None:
        """Describe a value."""
        self._write([Part(value)])
        while self._waiting:
            self._write(words_of(self._waiting.popleft()))

    def digest(self) -> str:
        """Of all that has been described."""
        return self._hash.hexdigest()

    def _write(self, words: Words) -> None:
        for word in words:
            if isinstance(word, Unordered):
                self._enter(*sorted(map(described, word.values)))
            else:
                self._enter(self._reference(word.value) if isinstance(word, Part) else word)
        self._hash.update(b";")

    def _enter(self, *contents: object) -> None:
        for content in contents:
            content = content if isinstance(content, bytes) else str(content).encode()
            self._hash.update(b"%d:" % len(content))
            self._hash.update(content)

    def _reference(self, value: object) -> str:
        """Data itself; for anything else its number, and it is described later."""
        if type(value) in DATA:
            return f"{type(value).__name__} {value!r}"
        if (name := trusted_name(value)) is not None:
            self.packages.add(name.split(" ")[0])
            return name
        if id(value) not in self._numbers:
            self._numbers[id(value)] = len(self._numbers)
            self._kept.append(value)
            self._waiting.append(value)
        return f"#{self._numbers[id(value)]}"


def described(value: object) -> str:
    """The digest of one value."""
    description = Description()
    description.add(value)
    return description.digest()
