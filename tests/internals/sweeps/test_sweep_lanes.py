"""Lanes that wait to be stored, and lanes in programs of XLA."""

import time

import numpy as np
import pytest

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


@pytest.mark.slow
def test_lanes_by_xla_are_those_of_native_code_whatever_runs_beside_them(lanes, monkeypatch):
    """In programs of four columns, some of which are refilled."""
    monkeypatch.setenv("CLEARJOINT_NATIVE", "0")
    monkeypatch.setattr(xla_lanes, "ON_CPU", 4)
    found = swept(STIFFNESS)
    assert_near(found, lanes, rtol=1e-7, atol=1e-9)
    assert_same_bits(swept(STIFFNESS[::-1]).isel(lane=slice(None, None, -1)), found)
    assert_same_bits(swept(STIFFNESS[[1, 6]]), found.isel(lane=[1, 6]))
    assert_same_bits(swept(STIFFNESS, threads=2), found)
