"""Recurrence of a motion: comparison of its states once a period."""

from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Float

from ...model.bodies import State

SETTLED_STATISTICS = 0.1
"""Statistics count as settled if means and standard deviations of two spans differ by less than
this, relative to the ranges of the motion."""
CONFIRMING = 3
"""Least number of periods over which a motion must repeat."""
STILL = 1e-6
"""Lower bound of the ranges of a motion, in m, m/s and rad/s."""


@dataclass(frozen=True)
class Strobe:
    """A motion once a period.

    `rows`: (n, D), D numbers in each of n periods; `scales`: (D,), the range of each column.
    """

    rows: Float[np.ndarray, "n D"]
    scales: Float[np.ndarray, " D"]

    def change(self, multiple: int) -> Float[np.ndarray, " changes"]:
        """Return the largest relative change of each period from the one `multiple` before it."""
        difference = np.abs(self.rows[multiple:] - self.rows[:-multiple])
        return np.max(difference / self.scales, axis=1, initial=0.0)

    def multiple(self, largest: int, tolerance: float) -> int | None:
        """Return the smallest number of periods after which the motion repeats.

        It must repeat within the tolerance for as many periods again, and at least `CONFIRMING`.
        ``None`` if there is no such number up to `largest`.
        """
        for multiple in range(1, largest + 1):
            needed = max(multiple, CONFIRMING)
            changes = self.change(multiple) if len(self.rows) > multiple else np.zeros(0)
            if len(changes) >= needed and bool(np.all(changes[-needed:] <= tolerance)):
                return multiple
        return None

    def statistics_settled(self) -> bool:
        """Whether means and standard deviations agree in the third and the last quarter."""
        quarter = len(self.rows) // 4
        if quarter < 2:
            return False
        spans = self.rows[-2 * quarter : -quarter], self.rows[-quarter:]
        means, deviations = ([f(span, axis=0) for span in spans] for f in (np.mean, np.std))
        apart = [np.abs(a - b) / self.scales for a, b in (means, deviations)]
        return bool(np.max(apart) <= SETTLED_STATISTICS)


def columns(states: State) -> dict[str, Float[np.ndarray, "N bodies components"]]:
    """Return positions in m, velocities in m/s, spins in rad/s and orientations of all bodies.

    Orientations are products of Euler parameters, which do not depend on their common sign.
    """
    bodies = [jax.tree.map(np.asarray, body) for body in states.bodies.values()]
    products = [b.orientation[:, :, None] * b.orientation[:, None, :] for b in bodies]
    return {
        "position": np.stack([b.position for b in bodies], axis=1),
        "velocity": np.stack([b.velocity for b in bodies], axis=1),
        "spin": np.stack([b.spin for b in bodies], axis=1),
        "orientation": np.stack([part.reshape(len(part), 16) for part in products], axis=1),
    }


def ranges(parts: dict[str, Float[np.ndarray, "N bodies components"]]) -> dict[str, float]:
    """Return the largest range of a component of each kind; 1 for orientations."""
    sizes = {name: float(np.max(np.ptp(part, axis=0), initial=0.0)) for name, part in parts.items()}
    return {name: max(size, STILL) for name, size in sizes.items()} | {"orientation": 1.0}


def strobe_of(states: State, phases: int) -> Strobe:
    """Return the motion once a period, from states at `phases` phases of each period."""
    parts = columns(states)
    sizes = ranges({name: part[-phases * CONFIRMING :] for name, part in parts.items()})
    whole = [part.reshape(len(part) // phases, -1) for part in parts.values()]
    scales = [np.full(one.shape[1], sizes[name]) for name, one in zip(parts, whole, strict=True)]
    return Strobe(np.concatenate(whole, axis=1), np.concatenate(scales))


def stillness(states: State, last: int) -> float:
    """Return the largest range in the last states, relative to that in all states."""
    parts = columns(states)
    sizes = ranges(parts)
    late = {name: part[-last:] for name, part in parts.items()}
    return max(float(np.max(np.ptp(part, axis=0))) / sizes[name] for name, part in late.items())


def section_strobe(times: Float[np.ndarray, " n"], values: list[np.ndarray]) -> Strobe:
    """Return the channels at the crossings of a section, and the times since the last crossing.

    `times`: (n,) s. Scales are the largest magnitudes of the channels, and the mean time between
    crossings.
    """
    waits = np.diff(times)
    rows = np.stack([waits, *(value[1:] for value in values)], axis=1)
    sizes = [
        np.mean(waits) if len(waits) else 1.0,
        *(np.max(np.abs(v), initial=0.0) for v in values),
    ]
    return Strobe(rows, np.maximum(np.array(sizes), STILL))
