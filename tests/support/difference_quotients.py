"""Derivatives by differences of runs, with which those of the package are compared."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

import clearjoint as cj

Places = Mapping[str, tuple[Callable[[cj.Scene], Any], float]]
"""Numbers of a scene by name: their place, and the step of the differences."""


def central(function: Callable[[float], Any], step: float) -> Any:
    """The derivative of a function at zero, by a central difference."""
    return (function(step) - function(-step)) / (2.0 * step)


def fourth_order(function: Callable[[float], Any], step: float) -> Any:
    """The derivative of a function at zero, by central differences of fourth order."""
    return (4.0 * central(function, step) - central(function, 2.0 * step)) / 3.0


def parameters_at(places: Places) -> dict[str, cj.Parameter]:
    return {name: cj.Parameter(place) for name, (place, _) in places.items()}


def by_differences(
    scene: cj.Scene,
    places: Places,
    measured: Callable[[cj.Scene], Any],
    derivative: Callable[[Callable[[float], Any], float], Any] = central,
) -> np.ndarray:
    """The derivatives along each number, on the last axis, of what is measured of a scene."""
    columns = [
        derivative(lambda by, at=place: measured(cj.set_value(scene, at, at(scene) + by)), step)
        for place, step in places.values()
    ]
    return np.stack(columns, axis=-1)
