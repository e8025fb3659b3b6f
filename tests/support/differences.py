"""Derivatives by differences of runs."""

from collections.abc import Callable
from typing import Any

import numpy as np

import clearjoint as cj


def by_differences(
    evaluate: Callable[[cj.Scene], Any], scene: cj.Scene, path: Callable[[Any], Any], step: float
) -> np.ndarray:
    """The derivative of what `evaluate` returns for a scene by the number at a path, by central
    differences; `step` has the number's unit."""
    value = float(path(scene))
    after, before = (
        np.asarray(evaluate(cj.set_value(scene, path, value + change))) for change in (step, -step)
    )
    return (after - before) / (2.0 * step)
