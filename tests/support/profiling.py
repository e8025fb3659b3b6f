"""How much of Python a call needs, and whether that grows linearly."""

import cProfile
import pstats
import sys
from collections.abc import Callable, Sequence
from typing import Any


def calls(function: Callable[[], Any]) -> int:
    """How many functions Python calls in a call of a function."""
    profile = cProfile.Profile()
    profile.runcall(function)
    return pstats.Stats(profile).total_calls  # pyright: ignore[reportAttributeAccessIssue]


def frames(function: Callable[[], Any]) -> int:
    """How many functions written in Python are called in a call of a function."""
    count = 0

    def counted(frame: Any, event: str, argument: Any) -> None:
        nonlocal count
        count += event == "call"

    sys.setprofile(counted)
    try:
        function()
    finally:
        sys.setprofile(None)
    return count


def assert_linear(counts: Sequence[int], slack: float = 1.1) -> None:
    """Check that counts for sizes n, 2 n and 4 n grow with the size, but for the slack."""
    small, middle, large = counts
    assert large - middle < 2.0 * slack * (middle - small), counts
