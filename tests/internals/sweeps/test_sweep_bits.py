"""The bits of a lane depend on its own numbers alone."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

import clearjoint as cj
from clearjoint._sweeps.store.store import SweepStore
from tests.support.datasets import assert_same_bits
from tests.support.rotor import LARGEST, SPEED, TIMES, swept

pytestmark = pytest.mark.filterwarnings("ignore:.*lanes failed")

STIFFNESS = np.concatenate([np.geomspace(1.0, 1e3, 24), [2.0 * LARGEST, 3.0 * LARGEST]])
"""The last two make their lanes fail at the start."""


def end(scene):
    """Lanes of very different lengths: a few end with their first step."""
    stiffness = scene.forces["spring"].stiffness
    return 1e-9 if 2.0 < stiffness < 5.0 else 3.0 / np.sqrt(stiffness)


SAVE = cj.Saving(lambda scene: end(scene) * TIMES, states=False)
"""Each lane at times of its own."""
LANES = st.lists(st.integers(0, len(STIFFNESS) - 1), min_size=1, max_size=40)
THREADS = st.integers(1, 5)


def sweep_of(lanes: list[int], threads: int, **options) -> xr.Dataset:
    return swept(STIFFNESS[lanes], end_time=end, save=SAVE, threads=threads, **options)


@pytest.fixture(scope="module")
def whole() -> xr.Dataset:
    return sweep_of(list(range(len(STIFFNESS))), 1)


def test_the_lanes_are_as_different_as_they_are_meant_to_be(whole):
    assert set(whole.result.values[:24]) == {0} and (whole.result.values[24:] > 0).all()
    steps = np.sort(whole.accepted.values[:24])
    assert 5 * steps[0] < steps[-1]
    first = np.abs(whole.swing_spin.values[:24, 0] / SPEED - 1.0)
    assert first.max() < 1e-12


@settings(max_examples=10, deadline=None)
@given(lanes=LANES, threads=THREADS)
def test_neighbours_order_number_and_threads_change_no_bit(whole, lanes, threads):
    assert_same_bits(sweep_of(lanes, threads), whole.isel(lane=lanes))


@pytest.mark.slow
@settings(max_examples=1, deadline=None)
@given(
    lanes=st.lists(st.integers(0, len(STIFFNESS) - 1), min_size=1, max_size=26, unique=True),
    threads=THREADS,
    again=THREADS,
    chunk=st.integers(1, 9),
    writes=st.integers(0, 6),
)
def test_an_interruption_changes_no_bit(whole, lanes, threads, again, chunk, writes):
    """A sweep whose process stops after some writes to its store, and the sweep that resumes it."""
    left = [writes]

    def write(store, *args, write=SweepStore.write):
        if not left[0]:
            raise KeyboardInterrupt
        left[0] -= 1
        write(store, *args)

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sweep.zarr"
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(SweepStore, "write", write)
            try:
                sweep_of(lanes, threads, chunk=chunk, path=path)
            except KeyboardInterrupt:
                assert (cj.open_sweep(path).result.values < 0).any()
        found = sweep_of(lanes, again, chunk=chunk, path=path)
        assert_same_bits(found, whole.isel(lane=lanes))
