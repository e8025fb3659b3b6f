"""Derivatives by differences of runs, with which those of the package are compared."""

from collections.abc import Callable
from typing import Any


def central(function: Callable[[float], Any], step: float) -> Any:
    """The derivative of a function at zero, by a central difference."""
    return (function(step) - function(-step)) / (2.0 * step)


def fourth_order(function: Callable[[float], Any], step: float) -> Any:
    """The derivative of a function at zero, by central differences of fourth order."""
    return (4.0 * central(function, step) - central(function, 2.0 * step)) / 3.0
