"""The table of impacts, from the record of accepted steps."""

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...export.labelled import Labelled, labelled_dataset, texts
from ...export.tabular import AbstractTabular
from ...dynamics.formulation import Formulation
from ...dynamics.system import System
from ...math.groups import by_group, by_name
from ...math.vectors import Scalar, ConstantFolded, unpack
from ...model.bodies import State
from ...model.contact.laws import AbstractContactLaw
from ...model.scene import Scene
from ...native import Native, over_rows
from ..step.contact_step import (ContactInstant, begin_before, contact_instants, end_in_step, peak_in_step,)

if TYPE_CHECKING:
    import xarray as xr

PIECE = 4096
NAMED = "joint", "contact"
"""The columns that are names."""
IMPACT_UNITS = {
    "onset": "s",
    "separation": "s",
    "duration": "s",
    "entry_speed": "m/s",
    "exit_speed": "m/s",
    "peak_force": "N",
    "peak_time": "s",
    "largest_penetration": "m",
}
"""Of what is reported of an impact."""


@dataclass(frozen=True)
class Impacts(AbstractTabular):
    """Finished contacts in the order of their onsets; each field is an array over the contacts.

    - `joint`, `contact`: names.
    - `onset`, `separation`, `duration`, `peak_time`: s.
    - `entry_speed`, `exit_speed`: m/s, both positive.
    - `peak_force`: N, of the normal force; `largest_penetration`: m.

    `simulate(..., save=Saving(impacts=True)).impacts` is one. By hand:

    >>> columns = [np.array([name]) for name in ("pin", "V")]
    >>> numbers = 0.01, 0.0102, 0.0002, 0.1, 0.08, 900.0, 0.0101, 2e-6  # in the order above
    >>> columns += [np.array([number]) for number in numbers]
    >>> impacts = cj.results.Impacts(*columns)
    >>> print(f"{impacts.exit_speed[0] / impacts.entry_speed[0]:.2f}")  # the restitution
    0.80
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

    def to_xarray(self) -> "xr.Dataset":
        """An `xarray.Dataset` along "impact", with units; see `AbstractTabular`."""
        names = {name: Labelled(("impact",), texts(getattr(self, name))) for name in NAMED}
        numbers = {
            name: Labelled(("impact",), getattr(self, name), unit, name.replace("_", " "))
            for name, unit in IMPACT_UNITS.items()
        }
        order = Labelled(("impact",), np.arange(len(self), dtype=np.int32))
        return labelled_dataset("impacts", {**names, **numbers}, {"impact": order})

    @staticmethod
    def of_rows(rows: Iterable[tuple[str | float, ...]]) -> "Impacts":
        """The impacts of rows of fields, in any order."""
        ordered = sorted(rows, key=lambda row: (row[2], row[0], row[1]))
        columns = list(zip(*ordered, strict=True)) or [()] * len(fields(Impacts))
        text, numbers = columns[:2], columns[2:]
        return Impacts(
            *(np.array(column, dtype=object) for column in text),
            *(np.array(column, dtype=float) for column in numbers),
        )

    def of(self, joint: str, contact: str) -> "Impacts":
        """The impacts of one contact of a joint, both by name."""
        chosen = (self.joint == joint) & (self.contact == contact)
        return Impacts(**{f.name: getattr(self, f.name)[chosen] for f in fields(self)})

    def within(self, after: float = -np.inf, until: float = np.inf) -> "Impacts":
        """Those that began in a window of time, s: from `after` on, and before `until`.

        ``np.quantile(solution.impacts.within(after=0.5).peak_force, 0.95)`` is a quantile of them.
        """
        chosen = (self.onset >= after) & (self.onset < until)
        return Impacts(**{f.name: getattr(self, f.name)[chosen] for f in fields(self)})


class History(eqx.Module):
    """One contact at a recorded instant, or at N, each field () or (N,).

    - `touching`: as the run saw it. `rate`, `entry_speed`: m/s.
    - `begun`: s, when it began if it did just before the instant.
    - `over`: s, when it is over if it is so before the next instant.
    - `peak_force` N, `peak_time` s and `largest_depth` m: the largest from each instant to the next
      (the last entries are those of the instant itself).
    """

    touching: Bool[Array, "..."]
    rate: Float[Array, "..."]
    entry_speed: Float[Array, "..."]
    begun: Float[Array, "..."]
    over: Float[Array, "..."]
    peak_force: Float[Array, "..."]
    peak_time: Float[Array, "..."]
    largest_depth: Float[Array, "..."]


Instants = dict[str, dict[str, ContactInstant]]
Histories = dict[str, dict[str, History]]
"""By joint and contact."""


@Native
def contact_histories(
    folded_scene: ConstantFolded, formulation: Formulation, times: Float[Array, " N"], states: State
) -> Histories:
    """The contacts at recorded states (in scalar form, times in front)."""
    alone: Scene = unpack(folded_scene)
    laws = alone.laws()
    system = System.of(alone, formulation)

    def at(t: Scalar, state: State) -> Instants:
        variables = system.encode(state.bodies)
        entry_speeds = by_group(state.entry_speeds, system.scene.joints)
        bristles = by_group(state.bristles, system.scene.joints)
        rates, _ = system.rates(variables, entry_speeds, t, bristles=bristles)
        rates = jax.tree.map(lambda like, rate: rate + 0.0 * like, variables, rates)
        seconds = by_name(system.second_rates(variables, rates))
        forces = by_name(system.contact_forces(variables, entry_speeds, bristles))
        return contact_instants(forces, seconds, state.entry_speeds)

    def until(t: Scalar, here: Instants, t_next: Scalar, following: Instants) -> Histories:
        return {
            name: {
                label: _history(laws[name][label], t, contact, t_next - t, following[name][label])
                for label, contact in family.items()
            }
            for name, family in here.items()
        }

    rows = times, over_rows(at, times, states)
    following = jax.tree.map(lambda leaf: jnp.concatenate([leaf[1:], leaf[-1:]]), rows)
    return over_rows(until, *rows, *following)


def _history(
    law: AbstractContactLaw, t: Scalar, here: ContactInstant, h: Scalar, following: ContactInstant
) -> History:
    """The contact at an instant and until the next, which is h later."""
    peak = peak_in_step(law, here, following, h)
    return History(
        jnp.asarray(here.touches(law)),
        jnp.asarray(here.gap.rate),
        jnp.asarray(here.speed()),
        t - begin_before(law, here),
        t + h * end_in_step(law, here, following, h),
        jnp.asarray(peak.force),
        t + h * peak.fraction,
        jnp.asarray(peak.depth),
    )


class ImpactCollector:
    """Builds the table from successive pieces of the record, keeping only contacts still open."""

    def __init__(self, folded_scene: ConstantFolded, formulation: Formulation):
        self._folded_scene, self._formulation = folded_scene, replace(formulation, ledger=False)
        self._tails: dict[tuple[str, str], History] = {}
        self._rows: list[tuple[str | float, ...]] = []
        self._last_row: tuple[np.ndarray, State] | None = None

    def add(self, times: np.ndarray, states: State) -> None:
        """Take in a piece of the record, in scalar form."""
        rows = (times, State(states.bodies, states.entry_speeds, bristles=states.bristles))
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
        histories = contact_histories(self._folded_scene, self._formulation, *full)
        for joint, family in histories.items():
            for contact, history in family.items():
                cut = jax.tree.map(lambda leaf: np.asarray(leaf)[:count], history)
                self._take((joint, contact), cut)

    def _take(self, key: tuple[str, str], history: History) -> None:
        if key in self._tails:
            old = self._tails[key]
            history = jax.tree.map(lambda a, b: np.concatenate([a[:-1], b]), old, history)
        touching = history.touching
        onsets = np.flatnonzero(~touching[:-1] & touching[1:]) + 1
        ends = np.flatnonzero(touching[:-1] & ~touching[1:]) + 1
        last = len(touching) - 1
        for onset in onsets:
            after = ends[ends > onset]
            if after.size == 0:
                last = onset - 1
                break
            self._rows.append((*key, *_impact(history, int(onset), int(after[0]))))
        self._tails[key] = jax.tree.map(lambda leaf: leaf[last:], history)

    def table(self) -> Impacts:
        """All contacts that are finished so far, by their onset."""
        return Impacts.of_rows(self._rows)


def _impact(history: History, onset: int, end: int) -> tuple[float, ...]:
    """One row of the table: the contact from row `onset` to the row `end` where it is over."""
    begun, over = float(history.begun[onset]), float(history.over[end - 1])
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
