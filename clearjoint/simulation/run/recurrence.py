"""Comparison of a motion with itself some periods earlier, to see whether it repeats."""

from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Float

from ...model.bodies import State

SETTLED_STATISTICS = 0.1
"""Largest difference of the means, and of the standard deviations, of two spans of a motion whose
statistics count as settled. It is relative to the range of the motion."""
CONFIRMING = 3
"""Smallest number of successive periods that must each equal an earlier period in a motion that
counts as periodic."""
STILL = 1e-6
"""Lower bound of the ranges of a motion, in m, m/s and rad/s."""


@dataclass(frozen=True)
class Strobe:
    """A motion as D numbers for each of n periods.

    - `rows`: (n, D), the numbers, such as positions and velocities at some phases of the period.
    - `scales`: (D,), for each column the range by which its changes are divided.
    """

    rows: Float[np.ndarray, "n D"]
    scales: Float[np.ndarray, " D"]

    def change(self, multiple: int) -> Float[np.ndarray, " changes"]:
        """Return the largest relative change since `multiple` periods earlier, for each period.

        **Returns:** (n - multiple,), changes over the `scales`, the largest over all columns.
        """
        difference = np.abs(self.rows[multiple:] - self.rows[:-multiple])
        return np.max(difference / self.scales, axis=1, initial=0.0)

    def multiple(self, largest: int, tolerance: float) -> int | None:
        """Return the smallest number m of periods after which the motion repeats.

        The last m periods, and at least the last `CONFIRMING`, must each equal the period m periods
        earlier, within the relative `tolerance`. The result is ``None`` if there is no such m up to
        `largest`.
        """
        for multiple in range(1, largest + 1):
            needed = max(multiple, CONFIRMING)
            changes = self.change(multiple) if len(self.rows) > multiple else np.zeros(0)
            if len(changes) >= needed and bool(np.all(changes[-needed:] <= tolerance)):
                return multiple
        return None

    def statistics_settled(self) -> bool:
        """Check whether means and standard deviations agree in the third and the last quarter of
        the periods, within `SETTLED_STATISTICS`."""
        quarter = len(self.rows) // 4
        if quarter < 2:
            return False
        spans = self.rows[-2 * quarter : -quarter], self.rows[-quarter:]
        means, deviations = ([f(span, axis=0) for span in spans] for f in (np.mean, np.std))
        apart = [np.abs(a - b) / self.scales for a, b in (means, deviations)]
        return bool(np.max(apart) <= SETTLED_STATISTICS)


def columns(states: State) -> dict[str, Float[np.ndarray, "N bodies components"]]:
    """Return "position" (m), "velocity" (m/s), "spin" (rad/s) and "orientation" of all bodies.

    Each is an array (N, bodies, components) for N states. An orientation has as its 16 components
    the products of its Euler parameters, since these do not depend on their common sign.
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
    """Return the range of each array of `columns`, by name: the largest range of a component.

    It is at least `STILL`, and 1 for orientations.
    """
    sizes = {name: float(np.max(np.ptp(part, axis=0), initial=0.0)) for name, part in parts.items()}
    return {name: max(size, STILL) for name, size in sizes.items()} | {"orientation": 1.0}


def strobe_of(states: State, phases: int) -> Strobe:
    """Return the motion of n periods, from states at `phases` instants of each period.

    **Arguments:** `states`: n * phases states, in the order of time. The scales are the ranges in
    the last `CONFIRMING` periods.
    """
    parts = columns(states)
    sizes = ranges({name: part[-phases * CONFIRMING :] for name, part in parts.items()})
    whole = [part.reshape(len(part) // phases, -1) for part in parts.values()]
    scales = [np.full(one.shape[1], sizes[name]) for name, one in zip(parts, whole, strict=True)]
    return Strobe(np.concatenate(whole, axis=1), np.concatenate(scales))


def stillness(states: State, last: int) -> float:
    """Return the range of the motion in the `last` states, relative to the range in all states.

    It is the largest of the relative ranges of positions, velocities, spins and orientations.
    """
    parts = columns(states)
    sizes = ranges(parts)
    late = {name: part[-last:] for name, part in parts.items()}
    return max(float(np.max(np.ptp(part, axis=0))) / sizes[name] for name, part in late.items())


def section_strobe(times: Float[np.ndarray, " n"], values: list[np.ndarray]) -> Strobe:
    """Return the motion with a row for each crossing of a section except the first.

    A row has the time since the previous crossing, s, and the value of each channel. The scales are
    the mean time between crossings, and the largest magnitude of each channel.

    **Arguments:** `times`: (n,) s, times of the crossings; `values`: for each channel, its values
    at the crossings, (n,).
    """
    waits = np.diff(times)
    rows = np.stack([waits, *(value[1:] for value in values)], axis=1)
    sizes = [
        np.mean(waits) if len(waits) else 1.0,
        *(np.max(np.abs(v), initial=0.0) for v in values),
    ]
    return Strobe(rows, np.maximum(np.array(sizes), STILL))
