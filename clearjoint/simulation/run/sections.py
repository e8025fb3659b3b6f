"""Poincaré sections: quantities where another one passes zero, rising.

Single runs and runs with derivatives table the crossings by a `SectionRecorder`; lanes of sweeps,
which may not write at an index of their own, have rings for them (`.batch.recording`). Both find
them by `Crossing`.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ...dynamics.system import System
from ...export.labelled import Labelled, labelled_dataset
from ...export.tabular import AbstractTabular
from ...fields.checks import require_count
from ...fields.conversion import on_device
from ...fields.readable import AbstractReadable
from ...math.interpolation import secant_root
from ...math.vectors import Scalar
from ...model.scene import Scene
from ...quantities.base import Quantity, check_quantity
from ...quantities.instant import Instant
from ..results.channels import Channels, check_channels, check_quantities
from ..step.dense_output import DenseStep, Snapshot, on_constraints
from ..step.step_state import Method, Step
from ..step.types import Numbers
from .advance import StepOutcome
from .row_buffer import RowBuffer

if TYPE_CHECKING:
    import xarray as xr

TIME = "time"
"""Name of the column of times, which no channel has."""


class Crossing(eqx.Module):
    """Where a Poincaré section is: a quantity passes zero, rising.

    **Arguments:** `quantity`: a scalar function of an `Instant`. `after`: s, earlier crossings are
    left out.
    """

    quantity: Quantity = eqx.field(static=True)
    after: Scalar

    def level(self, now: Instant) -> Scalar:
        """Value of the quantity that passes zero at a crossing, in its unit."""
        return jnp.asarray(self.quantity(now), dtype=float)

    def row(self, step_outcome: StepOutcome, before: Scalar, after: Scalar) -> Snapshot:
        """The row at the crossing, of levels at both ends of a stride that kept its step."""
        system = step_outcome.system

        def level(row: Snapshot) -> Scalar:
            return self.level(row.instant(system))

        row = crossing_row(step_outcome.method, step_outcome.dense_step, before, after, level)
        return Snapshot(row.t, on_constraints(system, row.y, row.t), row.entry_speeds)


def crossing_row(
    method: Method,
    dense_step: DenseStep,
    before: Scalar,
    after: Scalar,
    value: Callable[[Snapshot], Scalar],
) -> Snapshot:
    """The row where a function of rows, of given values at both ends of the step, rises through
    zero, by the dense output."""
    start, end = dense_step.start.t, dense_step.end.t
    x = secant_root(lambda x: value(dense_step.within(method, x)), before, after)
    return dense_step.at(method, start + x * (end - start))


class SectionRecorder(eqx.Module):
    """Tables the crossings of a section, the first `count` of them."""

    crossing: Crossing
    channels: tuple[tuple[str, Quantity], ...] = eqx.field(static=True)
    count: int = eqx.field(static=True)

    def start(self, system: System, step: Step) -> "SectionRecord":
        """The record before the first step: the level there, and no crossings."""
        now = Snapshot(step.t, step.y, step.entry_speeds).instant(system)
        table = RowBuffer.like(self.nothing(), self.count)
        return SectionRecord(self, self.crossing.level(now), table)

    def nothing(self) -> dict[str, Scalar]:
        """A row of zeros, in place of a crossing that is not there."""
        return {name: jnp.zeros(()) for name in (TIME, *dict(self.channels))}


class SectionRecord(eqx.Module):
    """The level of a section where a run is, and the table of its crossings."""

    recorder: SectionRecorder
    level: Scalar
    table: RowBuffer[dict[str, Scalar]]

    def after(self, step_outcome: StepOutcome) -> "SectionRecord":
        """The record after a stride, with a crossing more if the stride had one."""
        recorder, kept = self.recorder, step_outcome.kept
        crossing, before = recorder.crossing, self.level
        after = crossing.level(step_outcome.now)

        def columns() -> dict[str, Scalar]:
            row = crossing.row(step_outcome, before, after)
            found = row.columns(step_outcome.system, dict(recorder.channels))
            return {name: jnp.asarray(value, dtype=float) for name, value in found.items()}

        rises = kept & (before < 0.0) & (after >= 0.0)
        here = jax.lax.cond(rises, columns, lambda: recorder.nothing())
        wanted = rises & (here[TIME] >= crossing.after) & (self.table.count < recorder.count)
        level = jnp.where(kept, after, before)
        return SectionRecord(recorder, level, self.table.with_row(here, wanted))


def after_sections(
    records: Mapping[str, SectionRecord], step_outcome: StepOutcome
) -> dict[str, SectionRecord]:
    """The records of several sections after a stride, by name."""
    return {name: record.after(step_outcome) for name, record in records.items()}


class Crossings(AbstractReadable, AbstractTabular):
    """Where a run crossed a section: `times` (N,) s, and `values[name]` (N,), those of its channels
    there, in the `units` of the section, by name.

    >>> crossings = cj.results.Crossings(np.array([0.1, 0.2]), {"speed": np.array([1.0, 1.1])})
    >>> np.diff(crossings.times).round(6)  # the period
    array([0.1])
    """

    times: Numbers
    values: dict[str, Numbers]
    units: Mapping[str, str] = eqx.field(default_factory=dict, static=True)

    def to_xarray(self) -> "xr.Dataset":
        """An `xarray.Dataset` along "time", the times of the crossings, with units; see
        `AbstractTabular`."""
        values = {
            name: Labelled((TIME,), row, self.units.get(name)) for name, row in self.values.items()
        }
        times = Labelled((TIME,), self.times, "s", "time of the crossing")
        return labelled_dataset("crossings of a section", values, {TIME: times})

    def __len__(self) -> int:
        return self.times.shape[0]


def with_units(
    crossings: Mapping[str, Crossings], sections: "Mapping[str, Section]"
) -> dict[str, Crossings]:
    """The crossings with the units of the sections' channels."""
    units = {
        name: {key: unit for key, (_, unit) in section.channels.items()}
        for name, section in sections.items()
    }
    return {name: replace(found, units=units[name]) for name, found in crossings.items()}


def crossings_of(records: Mapping[str, SectionRecord]) -> dict[str, Crossings]:
    """The crossings that each section recorded, by its name, in host arrays."""
    tables = jax.device_get({name: record.table for name, record in records.items()})
    return {name: _crossings(table) for name, table in tables.items()}


def _crossings(table: RowBuffer[dict[str, Scalar]]) -> Crossings:
    columns = {name: np.asarray(values)[: int(table.count)] for name, values in table.rows.items()}
    return Crossings(columns.pop(TIME), columns)


@dataclass(frozen=True)
class Section:
    """A Poincaré section: quantities where another one passes zero, rising.

    **Arguments:**

    - `crossing`: the quantity that passes zero.
    - `channels`: quantity and unit by name, taken there.
    - `count`: how many crossings are kept, the first ones.
    - `after`: s; earlier crossings, of the transient, are left out.

    >>> touch = cj.Section(
    ...     cj.quantities.Penetration("shoulder", "V"),
    ...     {"speed": (cj.quantities.EntrySpeed("shoulder", "V"), "m/s")},
    ...     count=10,
    ... )
    >>> list(touch.channels)
    ['speed']
    """

    crossing: Quantity
    channels: Channels
    count: int
    after: float = 0.0

    def __post_init__(self) -> None:
        check_channels(self.channels)
        require_count("count", self.count, "pass a number of crossings")

    @property
    def condition(self) -> Crossing:
        """Where the section is, for a compiled program."""
        return Crossing(self.crossing, on_device(self.after))

    @property
    def recorder(self) -> SectionRecorder:
        """A recorder of the section's crossings in a run."""
        channels = tuple((name, quantity) for name, (quantity, _) in self.channels.items())
        return SectionRecorder(self.condition, channels, self.count)

    def check(self, scene: Scene) -> None:
        """Check that a scene has what the crossing and the channels name."""
        check_quantity("crossing", self.crossing, scene)
        check_quantities(self.channels, scene)
