"""Parameters of tests of which only a few are fast."""

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def slow(*values: Any) -> Any:
    """The arguments of one test, which is slow."""
    return pytest.param(*values, marks=pytest.mark.slow)


def slow_but(fast: Collection[Any], values: Iterable[Any]) -> list[Any]:
    """The arguments of tests that are slow but for a few."""
    return [value if value in fast else slow(value) for value in values]
