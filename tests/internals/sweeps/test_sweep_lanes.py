"""Lanes that wait to be stored, and lanes in programs of XLA."""

import time

import numpy as np
import pytest

from clearjoint._native.cells import Cells
from clearjoint._simulation.lanes import scheduler, xla_lanes
from clearjoint._sweeps.work import Work
from tests.support.datasets import assert_near, assert_same_bits
from tests.support.rotor import swept
from tests.sweeps import test_sweep_lanes
from tests.sweeps.test_sweep_lanes import STIFFNESS

lanes = test_sweep_lanes.lanes


def test_no_lanes_begin_while_ended_ones_wait_for_long(monkeypatch):
    """To be stored, for instance: a killed process loses few lanes that had ended."""
    numbers = []

    def slowly(work, lanes, on_ended, *, run=Work.run, **options):
        def ended(lanes, results):
            numbers.append(len(lanes))
            time.sleep(0.3)
            on_ended(lanes, results)

        return run(work, lanes, ended, **options)

    monkeypatch.setattr(Work, "run", slowly)
    monkeypatch.setattr(scheduler, "LONGEST_WAIT", 0.0)
    swept(np.linspace(1.0, 2.0, 40), outputs={})
    assert sum(numbers) == 40 and max(numbers) <= 16  # of a thread, with eight columns


@pytest.fixture
def by_xla(monkeypatch):
    """Lanes in programs of XLA of four columns, some of which are refilled."""
    monkeypatch.setenv("CLEARJOINT_NATIVE", "0")
    monkeypatch.setattr(xla_lanes, "ON_CPU", 4)


def test_a_loop_by_xla_advances_its_lanes_until_they_wait(by_xla):
    """Three lanes add 4 times their factors 700 times; the column without a lane cannot move, but
    does not count as waiting."""

    def turn(by, own, state):
        (end, factor), (count, total) = own, state
        goes = count < end
        return count + goes, total + goes * by * factor

    def status(by, own, state):
        (end, factor), (count, total) = own, state
        return {"moves": count < end, "count": count, "mean": total / (by * factor)}

    by, own, state = (
        np.asarray(4.0),
        (np.asarray(700), np.asarray(0.5)),
        (np.asarray(0), np.ones(())),
    )
    loop = xla_lanes.XlaLaneLoop(turn, status, by, own, state)
    columns, factors = loop.columns(by), np.array([0.5, 0.25, -2.0])
    for k, factor in enumerate(factors):
        loop.write_lane(columns, k, Cells(own).row((700, factor)), Cells(state).row((0, 0.0)))
    for count in (256, 512, 700):
        loop.run(columns)
        assert loop.status_of(columns)["count"][:3].tolist() == [count] * 3
    shown = {name: numbers[:3].tolist() for name, numbers in loop.status_of(columns).items()}
    assert shown == {"moves": [0, 0, 0], "count": [700] * 3, "mean": [700.0] * 3}
    for k, factor in enumerate(factors):
        assert Cells(state).tree(columns.floats[loop.state_cells, k]) == (700, 2800.0 * factor)
    assert columns.integers[loop.occupied].tolist() == [1, 1, 1, 0]


def test_a_function_by_xla_has_as_many_results_as_rows(by_xla):
    def function(by, first, second):
        return {"dot": by * first @ second[0], "count": second[1] + 1}

    first, second = np.arange(3.0), (np.ones(3), np.asarray(0))
    compiled = xla_lanes.XlaFunction(function, np.asarray(2.0), first, second)
    random = np.random.default_rng(4)
    a, b, counts = random.normal(size=(6, 3)), random.normal(size=(6, 3)), np.arange(6)
    rows = np.concatenate([Cells(first).rows(a), Cells(second).rows((b, counts))], axis=1)
    found = compiled.results.trees(compiled(rows))
    np.testing.assert_allclose(found["dot"], 2.0 * np.sum(a * b, axis=1), rtol=1e-12)
    np.testing.assert_array_equal(found["count"], counts + 1)
    assert compiled(rows[:0]).shape == (0, 2)


@pytest.mark.slow
def test_lanes_by_xla_are_those_of_native_code_whatever_runs_beside_them(lanes, by_xla):
    found = swept(STIFFNESS)
    assert_near(found, lanes, rtol=1e-7, atol=1e-9)
    assert_same_bits(swept(STIFFNESS[::-1]).isel(lane=slice(None, None, -1)), found)
    assert_same_bits(swept(STIFFNESS[[1, 6]]), found.isel(lane=[1, 6]))
    assert_same_bits(swept(STIFFNESS, threads=2), found)
