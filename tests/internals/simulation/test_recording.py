"""Impacts that are recorded with derivatives, and records of contacts in steps."""

from dataclasses import fields

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._simulation.run import host_run
from clearjoint._simulation.run import sampling as module
from clearjoint._simulation.run.impact_recorder import (
    ContactInstant,
    ContactRecord,
    ContactSoFar,
    ImpactRow,
    end_in_step,
    impact_rows_of,
    most,
    peak_in_step,
)
from clearjoint._simulation.run.recorders import RowBuffer
from tests.support.dropped_rod import dropped_rod

END = 2.0**-5


@pytest.mark.slow
def test_impacts_recorded_with_derivatives_are_those_of_a_run():
    clearance = {"clearance": cj.Parameter(lambda s: s.joints["pin"].clearance, cj.Log())}
    height, save = {"height": cj.quantities.Position("rod", "y")}, cj.Saving(impacts=True)
    arguments = clearance, height, [0.5 * END], cj.presets.derivatives, save
    found = cj.sensitivities(*dropped_rod(), END, *arguments, progress=False)
    run = cj.simulate(*dropped_rod(), END, cj.presets.derivatives, save)
    assert found.impacts is not None and len(found.impacts) == len(run.impacts) >= 2
    for field in fields(cj.results.Impacts):
        here, there = (getattr(table, field.name) for table in (found.impacts, run.impacts))
        if field.name in ("joint", "contact"):
            assert (here == there).all()
        else:
            np.testing.assert_allclose(here, there, rtol=1e-6, err_msg=field.name)


NO_IMPACT = ImpactRow(**{field.name: jnp.zeros(()) for field in fields(ImpactRow)})


def _record(count: int, room: int) -> dict[str, dict[str, ContactRecord]]:
    """A contact that ends `count` times, at intervals of one second."""
    table = RowBuffer.like(NO_IMPACT, room)
    for k in range(count):
        row = jax.tree.map(lambda leaf, k=k: leaf + k, NO_IMPACT)
        table = table.with_row(row, jnp.asarray(True)).with_row(row, jnp.asarray(False))
    here = ContactInstant(cj.extend.Gap(0.0, 0.0), jnp.zeros(()), None)
    contact = ContactSoFar(here, jnp.asarray(False), NO_IMPACT)
    return {"pin": {"V": ContactRecord(contact, table)}}


def _counted(count: int, room: int) -> dict[str, dict[str, ContactRecord]]:
    """A record of `count` impacts whose rows are zeros."""
    record = _record(0, room)["pin"]["V"]
    rows = RowBuffer(record.rows.rows, jnp.asarray(count))
    return {"pin": {"V": ContactRecord(record.contact, rows)}}


def test_a_full_table_holds_its_rows_and_its_count_exceeds_the_capacity_if_it_is_too_short():
    assert [row[2] for row in impact_rows_of(_record(3, 3), 10.0)] == [10.0, 11.0, 12.0]
    assert most(_record(3, 3)) == 3 and most(_record(5, 3)) == 5


@pytest.mark.slow
def test_a_run_goes_on_with_empty_buffers_when_they_are_full(monkeypatch):
    def kept() -> tuple:
        run = cj.simulate(*dropped_rod(), END, save=cj.Saving(steps=True, impacts=True))
        return run.steps, [getattr(run.impacts, field.name) for field in fields(run.impacts)]

    expected = kept()
    monkeypatch.setattr(host_run, "STEP_ROWS", 7)
    monkeypatch.setattr(host_run, "IMPACT_ROWS", 1)
    jax.tree.map(np.testing.assert_array_equal, kept(), expected)


def test_a_run_with_more_impacts_than_the_capacity_is_repeated(monkeypatch):
    rooms: list[int] = []

    def run(wanted: module.TangentRun) -> module.Sampled:
        rooms.append(wanted.recorders["impacts"].capacity)
        end, record = cj.RESULTS.successful, _counted(20, rooms[-1])
        return module.Sampled({}, {}, 0, 0, end, 0, 0, 0, None, {"impacts": record})

    monkeypatch.setattr(module, "sampled", run)
    monkeypatch.setattr(module, "IMPACTS_AT_FIRST", 2)
    wanted = module.TangentRun(*[None] * 8)  # pyright: ignore
    found = module.recorded_run(wanted, True)
    assert rooms == [2, 16, 128] and most(found.records["impacts"]) == 20


def at(t: float) -> ContactInstant:
    """A contact whose depth is a parabola, 1e-6 m at 0.2 ms."""
    depth = 1e-6 - (t - 0.2e-3) ** 2 * 100.0
    gap = cj.extend.Gap(jnp.asarray(depth), jnp.asarray(-200.0 * (t - 0.2e-3)))
    return ContactInstant(gap, jnp.asarray(-200.0), None)


def test_a_step_past_the_end_of_a_contact_has_its_peak_and_its_end():
    """Steps without landing end anywhere."""
    law, length = cj.laws.Hertz(1e9), 0.3e-3
    start, end = at(0.11e-3), at(0.11e-3 + length)
    force, depth = peak_in_step(law, start, end, length)
    assert float(depth) == pytest.approx(1e-6, rel=1e-9)
    assert float(force.value) == pytest.approx(1e9 * 1e-6**1.5, rel=1e-5)
    assert float(force.x) == pytest.approx(0.3, abs=2e-3)
    over = float(end_in_step(law, start, end, length))
    assert 0.11e-3 + over * length == pytest.approx(0.3e-3, rel=1e-3)


def test_onset_and_peak_of_a_contact_that_begins_inside_a_step_are_those_in_the_step():
    """Steps without landing: the contact recedes when its first step ends, and has had its peak."""
    law, t0, t1, onset = cj.laws.Hertz(1e9), 0.05e-3, 0.28e-3, 0.1e-3
    contact = ContactSoFar(at(t0), jnp.asarray(False), NO_IMPACT)
    contact, _, _ = contact.after(law, t0, t1, at(t1), lands=False)
    contact, over, row = contact.after(law, t1, 0.35e-3, at(0.35e-3), lands=False)
    assert bool(contact.begun) is False and bool(over)
    assert float(row.onset) == pytest.approx(onset, rel=1e-4)
    assert float(row.separation) == pytest.approx(0.3e-3, rel=1e-4)
    assert float(row.entry_speed) == pytest.approx(0.02, rel=1e-3)
    assert float(row.exit_speed) == pytest.approx(0.02, rel=1e-3)
    assert float(row.peak_force) == pytest.approx(1.0, rel=1e-5)
    assert float(row.peak_time) == pytest.approx(0.2e-3, rel=1e-2)
    assert float(row.largest_penetration) == pytest.approx(1e-6, rel=1e-9)


def test_a_contact_touches_beyond_the_onset_of_its_force_or_with_an_entry_speed():
    law = cj.laws.Hertz(1e9, exponent=1.0, smoothing=1e-6)
    for depth, touches in ((-0.5e-6, True), (-2e-6, False), (0.5e-6, True)):
        gap = cj.extend.Gap(jnp.asarray(depth), jnp.asarray(0.1))
        assert bool(ContactInstant(gap, jnp.zeros(()), None).touches(law)) == touches
        for speed in (0.0, 0.1):
            instant = ContactInstant(gap, jnp.zeros(()), jnp.asarray(speed))
            assert bool(instant.touches(law)) == (speed > 0.0)
    at_the_wall = ContactInstant(cj.extend.Gap(0.0, 0.1), jnp.zeros(()), None)
    assert not bool(at_the_wall.touches(cj.laws.Hertz(1e9)))
