"""Whether a motion has become periodic or steady, from what is seen of it once a period."""

from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Float

from ...model.bodies import State

SETTLED_STATISTICS = 0.1
"""Difference of means and of standard deviations between two spans, in the ranges of the motion,
below which statistics count as settled."""
CONFIRMING = 3
"""Periods at least over which a motion must repeat itself."""
STILL = 1e-6
"""Least range that a motion is taken to have, m, m/s and rad/s."""


@dataclass(frozen=True)
class Strobe:
    """What was seen of a motion, period by period.

    `rows`: (n, D) of n periods; `scales`: (D,) the range of what is in each column.
    """

    rows: Float[np.ndarray, "n D"]
    scales: Float[np.ndarray, " D"]

    def change(self, multiple: int) -> Float[np.ndarray, " changes"]:
        """Largest change of each period from that so many before it, in the ranges."""
        difference = np.abs(self.rows[multiple:] - self.rows[:-multiple])
        return np.max(difference / self.scales, axis=1, initial=0.0)

    def multiple(self, largest: int, tolerance: float) -> int | None:
        """The least number of periods after which the motion repeats itself within a tolerance,
        and did so for as many periods again; ``None`` if there is none up to the largest."""
        for multiple in range(1, largest + 1):
            needed = max(multiple, CONFIRMING)
            changes = self.change(multiple) if len(self.rows) > multiple else np.zeros(0)
            if len(changes) >= needed and bool(np.all(changes[-needed:] <= tolerance)):
                return multiple
        return None

    def statistics_settled(self) -> bool:
        """Whether means and standard deviations are the same in the third and the last quarter of
        all periods."""
        quarter = len(self.rows) // 4
        if quarter < 2:
            return False
        spans = self.rows[-2 * quarter : -quarter], self.rows[-quarter:]
        means, deviations = ([f(span, axis=0) for span in spans] for f in (np.mean, np.std))
        apart = [np.abs(a - b) / self.scales for a, b in (means, deviations)]
        return bool(np.max(apart) <= SETTLED_STATISTICS)


def columns(states: State) -> dict[str, Float[np.ndarray, "N bodies components"]]:
    """Positions m, velocities m/s, spins rad/s, and orientations of all bodies at N times.

    Orientations as products of Euler parameters, which are the same for both signs.
    """
    bodies = [jax.tree.map(np.asarray, body) for body in states.bodies.values()]
    turns = [b.orientation[:, :, None] * b.orientation[:, None, :] for b in bodies]
    return {
        "position": np.stack([b.position for b in bodies], axis=1),
        "velocity": np.stack([b.velocity for b in bodies], axis=1),
        "spin": np.stack([b.spin for b in bodies], axis=1),
        "orientation": np.stack([turn.reshape(len(turn), 16) for turn in turns], axis=1),
    }


def ranges(parts: dict[str, Float[np.ndarray, "N bodies components"]]) -> dict[str, float]:
    """How far the fastest component of each kind moves; of orientations, which are of unit size,
    one."""
    found = {name: float(np.max(np.ptp(part, axis=0), initial=0.0)) for name, part in parts.items()}
    return {name: max(size, STILL) for name, size in found.items()} | {"orientation": 1.0}


def strobe_of(states: State, phases: int) -> Strobe:
    """The motion once a period, from states at so many phases of each period."""
    parts = columns(states)
    sizes = ranges({name: part[-phases * CONFIRMING :] for name, part in parts.items()})
    whole = [part.reshape(len(part) // phases, -1) for part in parts.values()]
    scales = [np.full(one.shape[1], sizes[name]) for name, one in zip(parts, whole, strict=True)]
    return Strobe(np.concatenate(whole, axis=1), np.concatenate(scales))


def stillness(states: State, last: int) -> float:
    """How far anything moves in the last so many states, in the range of all of them."""
    parts = columns(states)
    sizes = ranges(parts)
    late = {name: part[-last:] for name, part in parts.items()}
    return max(float(np.max(np.ptp(part, axis=0))) / sizes[name] for name, part in late.items())


def section_strobe(times: Float[np.ndarray, " n"], values: list[np.ndarray]) -> Strobe:
    """The motion at its crossings of a section, at times (n,) s, from channels (n,) there; and the
    time that has passed since the crossing before.

    Scales are the largest magnitudes of the channels, and the mean time.
    """
    waits = np.diff(times)
    rows = np.stack([waits, *(value[1:] for value in values)], axis=1)
    sizes = [
        np.mean(waits) if len(waits) else 1.0,
        *(np.max(np.abs(v), initial=0.0) for v in values),
    ]
    return Strobe(rows, np.maximum(np.array(sizes), STILL))
