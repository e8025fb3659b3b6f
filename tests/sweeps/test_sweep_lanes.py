"""Lanes of a sweep in closed form, refilled ones too."""

import numpy as np
import pytest

import clearjoint as cj
from tests.support.datasets import assert_same_bits
from tests.support.rotor import AFTER, END, INERTIA, SPEED, TIMES, swept

STIFFNESS = np.geomspace(1.0, 1000.0, 9)
FREQUENCY = np.sqrt(STIFFNESS / INERTIA)
AMPLITUDE = SPEED / FREQUENCY
"""Every lane turns past a quarter of its period."""


@pytest.fixture(scope="module")
def lanes():
    return swept(STIFFNESS)


def test_saved_rows_are_at_the_times_and_on_the_motion(lanes):
    """Many lie within one step of the softest spring."""
    w = FREQUENCY[:, None]
    np.testing.assert_array_equal(lanes.saved_time, TIMES)
    assert lanes.swing_angle.dims == ("lane", "saved_time") and "saved_position" not in lanes
    exact = SPEED / w * np.sin(w * TIMES)
    error = np.abs(lanes.swing_angle - exact).max(axis=1) / AMPLITUDE
    assert (error < 1e-5).all() and len(TIMES) > 8 * int(lanes.accepted[0])
    np.testing.assert_allclose(
        lanes.swing_spin, SPEED * np.cos(w * TIMES), rtol=0.0, atol=5e-6 * SPEED
    )
    np.testing.assert_array_equal(lanes.swing_angle[:, 0], 0.0)
    np.testing.assert_array_equal(lanes.swing_spin[:, -1], lanes.final_spin[:, 0, 2])


def test_sections_keep_the_first_crossings_after_the_transient(lanes):
    """Of up to fifteen, those before 0.3 s are left out and two are kept."""
    exact = np.full((9, 2), np.nan)
    for lane, period in enumerate(2 * np.pi / FREQUENCY):
        crossings = period * np.arange(1, 20)
        found = crossings[(crossings > AFTER) & (crossings < END)][:2]
        exact[lane, : len(found)] = found
    assert set(lanes.zero_count.values) == {0, 1, 2}
    np.testing.assert_array_equal(lanes.zero_count, np.isfinite(exact).sum(axis=1))
    np.testing.assert_allclose(lanes.zero_time, exact, rtol=0.0, atol=2e-7)
    spins = np.where(np.isnan(exact), np.nan, SPEED)
    np.testing.assert_allclose(lanes.zero_spin, spins, rtol=5e-6)


def test_peaks_and_statistics_of_an_oscillation(lanes):
    """Of parabolas over the steps; and over a window that begins and ends within steps."""
    w, amplitude = FREQUENCY, AMPLITUDE
    np.testing.assert_allclose(lanes.largest, amplitude, rtol=2e-5)
    turns = (lanes.largest_time.values * w / (np.pi / 2) - 1.0) / 4
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-3)
    mean = SPEED / w**2 * (1 - np.cos(w))
    np.testing.assert_allclose(lanes.angle_mean / amplitude, mean / amplitude, atol=1e-6)
    rms = amplitude * np.sqrt(0.5 - np.sin(2 * w) / (4 * w))
    np.testing.assert_allclose(lanes.angle_rms, rms, rtol=1e-5)
    np.testing.assert_allclose(lanes.angle_largest, amplitude, rtol=1e-5)
    full = 1.5 * np.pi < w
    np.testing.assert_allclose(lanes.angle_smallest[full], -amplitude[full], rtol=1e-5)
    late = SPEED / w**2 * (np.cos(0.5 * w) - np.cos(0.75 * w)) / 0.25
    np.testing.assert_allclose(lanes.late_mean / amplitude, late / amplitude, atol=2e-5)


def test_reductions_of_ones_own(lanes):
    np.testing.assert_array_equal(lanes.turnings, np.floor(FREQUENCY / np.pi + 0.5))
    np.testing.assert_array_equal(lanes.turnings_steps, lanes.accepted)
    np.testing.assert_array_equal(lanes.turnings_end, 1.0)
    assert lanes.turnings_end.attrs["units"] == "s"


def test_more_lanes_than_columns(lanes):
    """Lanes come in while others are in mid-run."""
    many = np.concatenate([STIFFNESS, np.linspace(2.0, 500.0, 591)])
    found = swept(many)
    assert (found.result == 0).all()
    assert_same_bits(found.isel(lane=slice(9)), lanes)
    w = np.sqrt(many / INERTIA)
    np.testing.assert_allclose(found.swing_angle[:, -1] * w / SPEED, np.sin(w), atol=1e-5)


def test_products_and_lists_have_the_same_lanes(lanes):
    """The outer product has its last axis fastest."""
    at_rest = [0.0, 0.0]
    product = swept(STIFFNESS[:3], offset=at_rest, zipped=False)
    assert product.sizes["stiffness"] == 3 and product.sizes["offset"] == 2
    for k in range(2):
        assert_same_bits(product.isel(offset=k), lanes.isel(lane=slice(3)))


def test_end_and_saved_times_follow_the_scene():
    """A quarter of each lane's own period, so that all end at their amplitude."""

    def quarter(scene) -> float:
        return 0.5 * np.pi / np.sqrt(scene.forces["spring"].stiffness / INERTIA)

    own = cj.Saving(lambda scene: TIMES * quarter(scene), states=False)
    found = swept(STIFFNESS, end_time=quarter, save=own)
    ends = 0.5 * np.pi / FREQUENCY
    np.testing.assert_array_equal(found.time_reached, ends)
    np.testing.assert_allclose(found.saved_time, ends[:, None] * TIMES, rtol=1e-15)
    np.testing.assert_allclose(found.swing_angle[:, -1], SPEED / FREQUENCY, rtol=1e-6)
