"""Words that describe values: strings, bytes, and what is to be described on its own."""

from collections.abc import Iterable

Words = Iterable[object]
"""Strings, bytes, `Part`s, and `Unordered` ones."""
DATA = (type(None), bool, int, float, complex, str, bytes, type(Ellipsis), type(NotImplemented))
"""Classes of values that are described by their text."""
HEAP_TYPE = 1 << 9
"""Flag of classes that are made while Python runs."""


class UndescribedError(Exception):
    """A value that is more than what can be seen in it."""


class Part:
    """A value inside another, to be described on its own."""

    def __init__(self, value: object):
        self.value = value


class Unordered:
    """Values inside another whose order means nothing."""

    def __init__(self, values: Iterable[object]):
        self.values = values
