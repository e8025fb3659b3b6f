"""Panel of a catalogue figure: results as lines, expected values as dots."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from clearjoint.plot import style


class Compared(NamedTuple):
    """Curves and their expected values.

    - `at`, `found`: abscissae (T,) and values of C curves, (C, T).
    - `expected_at`, `expected`: abscissae (E,) and independent values, (C, E).
    """

    at: np.ndarray
    found: np.ndarray
    expected_at: np.ndarray
    expected: np.ndarray

    @staticmethod
    def along(at: np.ndarray, found: np.ndarray, expected: np.ndarray) -> "Compared":
        """Return curves with expected values, (C, T) or (T,), at all abscissae."""
        return Compared(at, np.atleast_2d(found), at, np.atleast_2d(expected))

    def off(self) -> float:
        """Return the largest difference at the expected abscissae, which the curves must have."""
        places = np.abs(self.at - self.expected_at[:, None]).argmin(axis=1)
        return float(np.abs(self.found[:, places] - self.expected).max())


def overlay(axes: Axes, compared: Compared, names: Sequence[str] = (), every: int = 1) -> None:
    """Draw curves with their names at the ends, and a part of the expected values."""
    for k, (found, expected) in enumerate(zip(compared.found, compared.expected, strict=True)):
        axes.plot(compared.at, found, color=style.BLUE, label="clearjoint" if k == 0 else None)
        axes.plot(
            compared.expected_at[::every],
            expected[::every],
            "o",
            color=style.VERMILLION,
            markersize=3,
            label="expected" if k == 0 else None,
        )
    for name, found in zip(names, compared.found, strict=False):
        last = compared.at[-1], found[-1]
        axes.annotate(name, last, (6, 0), textcoords="offset points", va="center", fontsize=8)


def legend(drawn: Figure, axes: Axes) -> None:
    """Draw the legend of all panels below them."""
    handles = axes.get_legend_handles_labels()
    drawn.legend(*handles, loc="outside lower center", ncols=len(handles[0]), frameon=False)
