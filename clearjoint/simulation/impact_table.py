"""The table of impacts, from the record of accepted steps."""

from dataclasses import dataclass, fields, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..dynamics.formulation import Formulation
from ..dynamics.system import System
from ..math.groups import by_group, by_name
from ..math.vectors import Structured, unpack
from ..model.bodies import State
from ..model.contact.gap import Gap
from ..model.contact.laws import AbstractContactLaw, contact_normal_force
from ..model.scene import Scene

SAMPLES_A_STEP = 33
PIECE = 4096
RESOLVED_TRAVEL = 1e-8
"""Distance in m that a step must cover at entry speed for depths to tell the rate within it."""


@dataclass(frozen=True)
class Impacts:
    """Finished contacts in the order of their onsets; each field is an array over the contacts.

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
    """One contact at N recorded instants.

    `touching`: as the run saw it. `depth` m and `rate` m/s at the instants; `entry_speed` m/s.
    `peak_force` N, `peak_time` s and `largest_depth` m: the largest from each instant to the next
    (the last entries are those of the instant itself).
    """

    touching: Any
    depth: Any
    rate: Any
    entry_speed: Any
    peak_force: Any
    peak_time: Any
    largest_depth: Any


class Sample(eqx.Module):
    """A contact at one instant: its gap, the second derivative of its depth, and its memory."""

    gap: Gap
    second_rate: Any
    entry_speed: Any


@eqx.filter_jit
def contact_histories(
    form: Structured, formulation: Formulation, times: Any, states: State
) -> dict[str, dict[str, History]]:
    """The contacts at recorded states (in scalar form, times in front)."""
    alone: Scene = unpack(form)
    laws = alone.laws()
    system = System.of(alone, formulation)

    def at(t: Any, state: State) -> dict[str, dict[str, Sample]]:
        variables = system.encode(state.bodies)
        memory = by_group(state.memory, system.scene.joints)
        rates, _ = system.rates(variables, memory, t)
        rates = jax.tree.map(lambda like, rate: rate + 0.0 * like, variables, rates)
        seconds = by_name(system.second_rates(variables, rates))
        found = by_name(system.contact_forces(variables, memory))
        return {
            name: {
                label: Sample(
                    jax.tree.map(jnp.asarray, force.contact.gap),
                    seconds[name][label],
                    state.memory.get(name, {}).get(label),
                )
                for label, force in family.items()
            }
            for name, family in found.items()
        }

    samples = jax.vmap(at)(times, states)
    return {
        name: {
            label: _history(laws[name][label], times, sample) for label, sample in family.items()
        }
        for name, family in samples.items()
    }


def _history(law: AbstractContactLaw, times: Any, sample: Sample) -> History:
    """The contact, between the instants by a quintic through depth and its two derivatives."""
    following = jax.tree.map(lambda leaf: jnp.concatenate([leaf[1:], leaf[-1:]]), sample)
    h = jnp.concatenate([jnp.diff(times), jnp.zeros(1)])
    x = jnp.linspace(0.0, 1.0, SAMPLES_A_STEP)[:, None]
    speed = sample.gap.rate if sample.entry_speed is None else sample.entry_speed
    depth, rate = _interpolated(x, h, sample, following, speed)
    gap = Gap(depth, rate, sample.gap.bearing_radius, sample.gap.clearance)
    # The first instant of a contact remembers its entry speed, so a step has that of its start.
    force = contact_normal_force(law, gap, sample.entry_speed)
    peak_force, where = _peak(force)
    depth_here, rate_here = sample.gap.depth, sample.gap.rate
    touching, entry_speed = depth_here + law.reach() > 0.0, rate_here
    if sample.entry_speed is not None:
        touching, entry_speed = sample.entry_speed > 0.0, sample.entry_speed
    return History(
        touching,
        depth_here,
        rate_here,
        entry_speed,
        peak_force,
        times + h * where,
        _peak(depth)[0],
    )


def _interpolated(x: Any, h: Any, start: Sample, end: Sample, speed: Any) -> tuple[Any, Any]:
    """Depth and rate at fractions x of steps of length h.

    The rate is the quintic's slope, or in steps so short that rounding of the depth would spoil it
    the cubic through the rates and their derivatives.
    """
    a, da, dda = start.gap.depth, h * start.gap.rate, h * h * start.second_rate
    b, db, ddb = end.gap.depth, h * end.gap.rate, h * h * end.second_rate
    rise = b - a - da - 0.5 * dda
    slope, bend = db - da - dda, ddb - dda
    c3 = 10 * rise - 4 * slope + 0.5 * bend
    c4 = -15 * rise + 7 * slope - bend
    c5 = 6 * rise - 3 * slope + 0.5 * bend
    depth = a + x * (da + x * (0.5 * dda + x * (c3 + x * (c4 + x * c5))))
    slopes = da + x * (dda + x * (3 * c3 + x * (4 * c4 + x * 5 * c5)))
    bent = start.gap.rate + x * (
        h * start.second_rate
        + x
        * (
            3 * (end.gap.rate - start.gap.rate)
            - h * (2 * start.second_rate + end.second_rate)
            + x * (h * (start.second_rate + end.second_rate) - 2 * (end.gap.rate - start.gap.rate))
        )
    )
    moves = h * jnp.abs(speed) > RESOLVED_TRAVEL
    return depth, jnp.where(moves, slopes / jnp.where(moves, h, 1.0), bent)


def _peak(values: Any) -> tuple[Any, Any]:
    """Largest value over the first axis, and its fraction, by a parabola about the best sample."""
    last = values.shape[0] - 1
    best = jnp.clip(jnp.argmax(values, axis=0), 1, last - 1)
    left, middle, right = (
        jnp.take_along_axis(values, (best + k)[None], axis=0)[0] for k in (-1, 0, 1)
    )
    curvature = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / jnp.where(curvature < 0.0, curvature, -jnp.inf)
    shift = jnp.clip(shift, -1.0, 1.0)
    vertex = middle - 0.25 * (left - right) * shift
    ends = jnp.where(right > left, right, left)
    inside = (curvature < 0.0) & (jnp.abs(shift) < 1.0)
    value = jnp.where(inside, vertex, jnp.maximum(ends, middle))
    where = jnp.where(inside, shift, jnp.where(right > left, 1.0, -1.0))
    return value, (best + where) / last


class ImpactCollector:
    """Builds the table from successive pieces of the record, keeping only contacts still open."""

    def __init__(self, form: Structured, formulation: Formulation):
        self._form, self._formulation = form, replace(formulation, ledger=False)
        self._tails: dict[tuple[str, str], tuple[np.ndarray, History]] = {}
        self._rows: list[tuple[Any, ...]] = []
        self._last_row: tuple[np.ndarray, State] | None = None

    def add(self, times: np.ndarray, states: State) -> None:
        """Take in a piece of the record, in scalar form."""
        rows = (times, State(states.bodies, states.memory))
        if self._last_row is not None:
            rows = jax.tree.map(lambda a, b: np.concatenate([a, b]), self._last_row, rows)
        # Pieces share a row, since a history looks from each row to the next.
        for first in range(0, max(len(rows[0]) - 1, 1), PIECE - 1):
            cut = slice(first, first + PIECE)
            self._add_piece(*jax.tree.map(lambda leaf, cut=cut: leaf[cut], rows))
        self._last_row = jax.tree.map(lambda leaf: leaf[-1:], rows)

    def _add_piece(self, times: np.ndarray, states: State) -> None:
        count = len(times)
        full = jax.tree.map(
            lambda leaf: np.concatenate([leaf, np.repeat(leaf[-1:], PIECE - count)]),
            (times, states),
        )
        histories = contact_histories(self._form, self._formulation, *full)
        for joint, family in histories.items():
            for contact, history in family.items():
                cut = jax.tree.map(lambda leaf: np.asarray(leaf)[:count], history)
                self._take((joint, contact), times, cut)

    def _take(self, key: tuple[str, str], times: np.ndarray, history: History) -> None:
        if key in self._tails:
            old_times, old = self._tails[key]
            times = np.concatenate([old_times[:-1], times])
            history = jax.tree.map(lambda a, b: np.concatenate([a[:-1], b]), old, history)
        touching = history.touching
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
    steps = slice(onset, end)
    strongest = onset + int(np.argmax(history.peak_force[steps]))
    return (
        begun,
        over,
        over - begun,
        float(history.entry_speed[onset]),
        -float(history.rate[end]),
        float(history.peak_force[strongest]),
        float(history.peak_time[strongest]),
        float(history.largest_depth[steps].max()),
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
