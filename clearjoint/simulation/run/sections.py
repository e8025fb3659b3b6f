"""Poincaré sections: values of quantities at instants at which another quantity rises through zero.

Single runs and runs with derivatives compute the channels, the values of quantities, at each
crossing (`SectionRecorder`). Lanes of sweeps record the state at each crossing, from which the
channels are computed later (`clearjoint.simulation.lanes`).
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
"""Column of the times of crossings. No channel may have this name."""


class Crossing(eqx.Module):
    """The condition of a Poincaré section: a quantity rises through zero.

    **Arguments:** `quantity`: a scalar function of an `Instant`; `after`: s, time before which
    crossings are ignored.
    """

    quantity: Quantity = eqx.field(static=True)
    after: Scalar

    def level(self, now: Instant) -> Scalar:
        """Return the section's level, which is the quantity that is zero at a crossing."""
        return jnp.asarray(self.quantity(now), dtype=float)

    def row(self, step_outcome: StepOutcome, before: Scalar, after: Scalar) -> Snapshot:
        """Return time and state at the crossing in an accepted step.

        For a step without a crossing the result has no meaning.

        **Arguments:** `before`, `after`: the levels at the start and the end of the step.
        """
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
    """Return time and state at the instant of a step at which a function rises through zero.

    **Arguments:** `value`: the function of time and state; `before`, `after`: its values at the
    start and the end of the step.
    """
    start, end = dense_step.start.t, dense_step.end.t
    x = secant_root(lambda x: value(dense_step.within(method, x)), before, after)
    return dense_step.at(method, start + x * (end - start))


class SectionRecorder(eqx.Module):
    """Recorder that tabulates the first `count` crossings of a section.

    `channels`: pairs of a name and a quantity, which is evaluated at each crossing.
    """

    crossing: Crossing
    channels: tuple[tuple[str, Quantity], ...] = eqx.field(static=True)
    count: int = eqx.field(static=True)

    def start(self, system: System, step: Step) -> "SectionRecord":
        """Return the record before the first step: the level at the start, and an empty table."""
        now = Snapshot(step.t, step.y, step.entry_speeds).instant(system)
        table = RowBuffer.like(self.nothing(), self.count)
        return SectionRecord(self, self.crossing.level(now), table)

    def nothing(self) -> dict[str, Scalar]:
        """Return a row of zeros: the time and each channel, by name."""
        return {name: jnp.zeros(()) for name in (TIME, *dict(self.channels))}


class SectionRecord(eqx.Module):
    """The crossings of a section in a run so far.

    - `level`: the section's quantity after the latest accepted step, in its unit.
    - `table`: time and values of the channels at each crossing.
    """

    recorder: SectionRecorder
    level: Scalar
    table: RowBuffer[dict[str, Scalar]]

    def after(self, step_outcome: StepOutcome) -> "SectionRecord":
        """Return the record after a step was tried.

        Its table includes the step's crossing if the step was accepted, the time of the crossing is
        not below `Crossing.after`, and the table has room.
        """
        recorder, kept = self.recorder, step_outcome.kept
        crossing, before = recorder.crossing, self.level
        after = crossing.level(step_outcome.now)

        def columns() -> dict[str, Scalar]:
            row = crossing.row(step_outcome, before, after)
            values = row.columns(step_outcome.system, dict(recorder.channels))
            return {name: jnp.asarray(value, dtype=float) for name, value in values.items()}

        rises = kept & (before < 0.0) & (after >= 0.0)
        # Most steps have no crossing: the root is searched for only in those that have.
        found = jax.lax.cond(rises, columns, lambda: recorder.nothing())
        wanted = rises & (found[TIME] >= crossing.after) & (self.table.count < recorder.count)
        level = jnp.where(kept, after, before)
        return SectionRecord(recorder, level, self.table.with_row(found, wanted))


def after_sections(
    records: Mapping[str, SectionRecord], step_outcome: StepOutcome
) -> dict[str, SectionRecord]:
    """Return the updated records of several sections, by name, after a step was tried."""
    return {name: record.after(step_outcome) for name, record in records.items()}


class Crossings(AbstractReadable, AbstractTabular):
    """N crossings of a section.

    - `times`: (N,) s, times of the crossings.
    - `values`: by name of a channel, (N,) values of its quantity at the crossings.
    - `units`: by name of a channel, the unit of its values.

    >>> crossings = cj.results.Crossings(np.array([0.1, 0.2]), {"speed": np.array([1.0, 1.1])})
    >>> np.diff(crossings.times).round(6)  # the period
    array([0.1])
    """

    times: Numbers
    values: dict[str, Numbers]
    units: Mapping[str, str] = eqx.field(default_factory=dict, static=True)

    def to_xarray(self) -> "xr.Dataset":
        """Return the crossings as an `xarray.Dataset`: a variable along "time" for each channel.

        "time" has the times of the crossings, s. See `AbstractTabular` for other formats.
        """
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
    """Return copies of crossings, by name of the section, with the units of its channels added."""
    units = {
        name: {key: unit for key, (_, unit) in section.channels.items()}
        for name, section in sections.items()
    }
    return {name: replace(found, units=units[name]) for name, found in crossings.items()}


def crossings_of(records: Mapping[str, SectionRecord]) -> dict[str, Crossings]:
    """Return the crossings that the records contain, by name of the section, as NumPy arrays."""
    tables = jax.device_get({name: record.table for name, record in records.items()})
    return {name: _crossings(table) for name, table in tables.items()}


def _crossings(table: RowBuffer[dict[str, Scalar]]) -> Crossings:
    columns = {name: np.asarray(values)[: int(table.count)] for name, values in table.rows.items()}
    return Crossings(columns.pop(TIME), columns)


@dataclass(frozen=True)
class Section:
    """A Poincaré section: values of quantities at instants at which another one rises through zero.

    **Arguments:**

    - `crossing`: the quantity whose rise through zero is a crossing, a function of an `Instant`.
    - `channels`: the quantities to evaluate at each crossing, as pairs (quantity, unit) by name.
    - `count`: largest number of crossings; later ones are not kept.
    - `after`: s, time before which crossings are ignored, to leave out a transient.

    **Raises:** `ValueError` for channels that are not such pairs, for names that no array can have,
    and for a `count` that is not a positive integer.

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
        """The condition of the section, as an argument of compiled programs."""
        return Crossing(self.crossing, on_device(self.after))

    @property
    def recorder(self) -> SectionRecorder:
        """The recorder that tabulates the section's crossings in a run."""
        channels = tuple((name, quantity) for name, (quantity, _) in self.channels.items())
        return SectionRecorder(self.condition, channels, self.count)

    def check(self, scene: Scene) -> None:
        """Check that a scene has the elements that `crossing` and `channels` name.

        **Raises:** `ValueError` otherwise.
        """
        check_quantity("crossing", self.crossing, scene)
        check_quantities(self.channels, scene)
