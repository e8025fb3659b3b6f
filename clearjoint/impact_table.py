"""The table of impacts, from the record of accepted steps."""

from dataclasses import dataclass, fields
from typing import Any

import equinox as eqx
import jax
import numpy as np

from .bodies import State
from .dynamics import Formulation, contact_forces, state_rates
from .scene import Scene
from .vectors import unpack


@dataclass(frozen=True)
class Impacts:
    """Finished contacts in the order of their onsets; each field is an array with one entry a contact.

    - `joint`, `contact`: names.
    - `onset`, `separation`, `duration`, `peak_time`: s.
    - `entry_speed`, `exit_speed`: m/s, both positive.
    - `peak_force`: N, of the normal force; `largest_penetration`: m.
    """

    joint: np.ndarray
    contact: np.ndarray
    onset: np.ndarray
    separation: np.ndarray
    duration: np.ndarray
    entry_speed: np.ndarray
    exit_speed: np.ndarray
    peak_force: np.ndarray
    peak_time: np.ndarray
    largest_penetration: np.ndarray

    def __len__(self) -> int:
        return len(self.onset)

    def of(self, joint: str, contact: str) -> "Impacts":
        """The impacts of one contact."""
        chosen = (self.joint == joint) & (self.contact == contact)
        return Impacts(**{f.name: getattr(self, f.name)[chosen] for f in fields(self)})


class History(eqx.Module):
    """Depth (m), normal force (N), their rates, and entry speed (m/s) of one contact over time."""

    depth: Any
    rate: Any
    force: Any
    force_rate: Any
    entry_speed: Any


@eqx.filter_jit
def contact_histories(
    scene: Scene, formulation: Formulation, times: Any, states: State
) -> dict[str, dict[str, History]]:
    """The contacts at recorded states (in scalar form, times in front)."""
    scene = unpack(scene)

    def at(t: Any, state: State) -> dict[str, dict[str, History]]:
        variables = formulation.coordinates.encode(scene, state.bodies)
        rates, _ = state_rates(scene, formulation, variables, state.memory, t)

        def forces(variables: Any) -> Any:
            motions = formulation.coordinates.motions(scene, variables)
            found = contact_forces(scene, motions, state.memory)
            return {
                name: {
                    label: (f.contact.gap.depth, f.contact.gap.rate, f.normal_force)
                    for label, f in family.items()
                }
                for name, family in found.items()
            }

        values, slopes = jax.jvp(forces, (variables,), (_floats(variables, rates),))
        return {
            name: {
                label: History(
                    depth, rate, force, slopes[name][label][2],
                    state.memory.get(name, {}).get(label, rate),
                )
                for label, (depth, rate, force) in family.items()
            }
            for name, family in values.items()
        }

    return jax.vmap(at)(times, states)


def _floats(like: Any, rates: Any) -> Any:
    return jax.tree.map(lambda a, b: b + 0.0 * a, like, rates)


class ImpactCollector:
    """Builds the table from successive pieces of the record, keeping only contacts still open."""

    def __init__(self, scene: Scene, formulation: Formulation):
        self._scene, self._formulation = scene, formulation
        self._tails: dict[tuple[str, str], tuple[np.ndarray, History]] = {}
        self._rows: list[tuple[Any, ...]] = []

    def add(self, times: np.ndarray, states: State, count: int) -> None:
        """Take in the first `count` rows of a piece of the record."""
        histories = contact_histories(self._scene, self._formulation, times, states)
        for joint, family in histories.items():
            for contact, history in family.items():
                cut = jax.tree.map(lambda leaf: np.asarray(leaf)[:count], history)
                self._take((joint, contact), np.asarray(times)[:count], cut)

    def _take(self, key: tuple[str, str], times: np.ndarray, history: History) -> None:
        if key in self._tails:
            old_times, old = self._tails[key]
            times = np.concatenate([old_times, times])
            history = jax.tree.map(lambda a, b: np.concatenate([a, b]), old, history)
        touching = history.depth > 0.0
        onsets = np.flatnonzero(~touching[:-1] & touching[1:]) + 1
        ends = np.flatnonzero(touching[:-1] & ~touching[1:]) + 1
        last = len(times) - 1
        for onset in onsets:
            after = ends[ends > onset]
            if after.size == 0:
                last = onset - 1
                break
            self._rows.append((*key, *_impact(times, history, int(onset), int(after[0]))))
        self._tails[key] = (times[last:], jax.tree.map(lambda leaf: leaf[last:], history))

    def table(self) -> Impacts:
        """The finished contacts so far."""
        rows = sorted(self._rows, key=lambda row: (row[2], row[0], row[1]))
        columns = list(zip(*rows, strict=True)) or [()] * len(fields(Impacts))
        text, numbers = columns[:2], columns[2:]
        return Impacts(
            *(np.array(column, dtype=object) for column in text),
            *(np.array(column, dtype=float) for column in numbers),
        )


def _impact(times: np.ndarray, history: History, onset: int, end: int) -> tuple[float, ...]:
    """One row of the table: the contact from row `onset` to the row `end` where it is over."""
    begun = times[onset] - history.depth[onset] / history.rate[onset]
    over = _separation(times, history, end)
    span = slice(onset, end + 1)
    force, when = _largest(times[span], history.force[span], history.force_rate[span])
    depth, _ = _largest(times[span], history.depth[span], history.rate[span])
    exit_speed = abs(float(np.interp(over, times[span], history.rate[span])))
    return (
        begun, over, over - begun, float(history.entry_speed[onset]), exit_speed, force, when, depth
    )


def _separation(times: np.ndarray, history: History, end: int) -> float:
    """Root of the depth's cubic Hermite interpolant in the last step of a contact."""
    h = times[end] - times[end - 1]
    a, b = history.depth[end - 1], history.depth[end]
    da, db = h * history.rate[end - 1], h * history.rate[end]
    cubic = np.array([2 * a + da - 2 * b + db, -3 * a - 2 * da + 3 * b - db, da, a])
    roots = np.roots(cubic)
    real = roots[np.abs(roots.imag) < 1e-9].real
    inside = real[(real >= -1e-9) & (real <= 1 + 1e-9)]
    fraction = float(inside.max()) if inside.size else 1.0
    return float(times[end - 1] + fraction * h)


def _largest(
    times: np.ndarray, values: np.ndarray, slopes: np.ndarray
) -> tuple[float, float]:
    """Largest value, and its time, of the piecewise cubic through values and slopes."""
    best = int(np.argmax(values))
    peak, when = float(values[best]), float(times[best])
    for k in (best - 1, best):
        if k < 0 or k + 1 >= len(times):
            continue
        h = times[k + 1] - times[k]
        a, b, da, db = values[k], values[k + 1], h * slopes[k], h * slopes[k + 1]
        cubic = np.array([2 * a + da - 2 * b + db, -3 * a - 2 * da + 3 * b - db, da, a])
        for x in np.roots(np.polyder(cubic)):
            if abs(x.imag) < 1e-12 and 0.0 < x.real < 1.0:
                value = float(np.polyval(cubic, x.real))
                if value > peak:
                    peak, when = value, float(times[k] + x.real * h)
    return peak, when
