"""Depths from forces and speeds, profiles that a parameter moves, stages and their store."""

from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

import clearjoint as cj
from clearjoint._durability import wear as wear_module
from clearjoint._durability.wear_depths import SIGNALS, depths_from_signals
from clearjoint._durability.wear_derivatives import MovingSpline
from tests.durability.test_wear import (
    CLEARANCE,
    CYCLE,
    LENGTH,
    OF_PIN,
    OPTIONS,
    RADIUS,
    RATE,
    rough,
    whirling,
)


def test_derivatives_of_depths_are_those_of_differences():
    """By the signals of a run and by the numbers of the joint."""
    angles = np.linspace(0.0, 0.3, 41)
    size = CLEARANCE + 5e-6
    signals = dict.fromkeys(SIGNALS, np.ones(41)) | {
        "V x": size * np.cos(angles),
        "V y": size * np.sin(angles),
        "W x": 0.9 * size * np.cos(angles),
        "W y": 0.9 * size * np.sin(angles),
        "x_along_y": np.zeros(41),
        "y_along_x": np.zeros(41),
    }
    pin = whirling()[0].joints["pin"]

    def depths(change):
        joint = eqx.tree_at(lambda j: j.clearance, pin, CLEARANCE * (1.0 + change))
        moved = signals | {"V x": signals["V x"] * (1.0 + 0.5 * change)}
        rates = jnp.asarray([RATE * (1.0 + change), RATE])
        return depths_from_signals(joint, rates, np.linspace(0.0, 1.0, 41), moved, 16)

    _, slopes = jax.jvp(depths, (0.0,), (1.0,))
    differences = (depths(1e-5) - depths(-1e-5)) / 2e-5
    assert float(jnp.abs(slopes).max()) > 1e-12
    np.testing.assert_allclose(
        slopes, differences, rtol=0.0, atol=1e-4 * float(jnp.abs(slopes).max())
    )


def test_asperities_wear_before_the_surfaces_touch():
    """The worn volume is rate times power times time, where the contact is open by 3 um."""
    signals = dict.fromkeys(SIGNALS, np.ones(3)) | {
        **dict.fromkeys(("V x", "W x"), np.full(3, CLEARANCE - 3e-6)),
        **dict.fromkeys(("V y", "W y", "x_along_y", "y_along_x"), np.zeros(3)),
    }
    pin, times = rough()[0].joints["pin"], np.array([0.0, 1.0, 2.0])
    wall, _ = depths_from_signals(pin, np.array([RATE, RATE]), times, signals, 96)
    volume = wall.mean() * 2.0 * np.pi * RADIUS * LENGTH
    np.testing.assert_allclose(volume, RATE * 2.0 * 2.0, rtol=1e-12)


def test_a_parameter_moves_a_worn_profile():
    coefficients = 1e-6 * np.cos(np.arange(8))
    directions = np.concatenate([np.ones(8), np.sin(np.arange(8))])
    still = MovingSpline(coefficients, directions, [0.0, 0.0])
    moved = MovingSpline(coefficients, directions, [0.0, 2e-7])
    angle = 1.3
    assert still.at(angle).value == cj.profiles.PeriodicSpline(coefficients).at(angle).value
    along = cj.profiles.PeriodicSpline(directions[8:]).at(angle).value
    assert moved.at(angle).value - still.at(angle).value == pytest.approx(2e-7 * along)


@pytest.mark.slow
def test_a_store_of_an_earlier_version_is_not_continued(tmp_path):
    """Forces were added to the result later."""
    scene, state = whirling()
    whole = cj.wear(scene, state, CYCLE, OF_PIN, 10.0, stages=1, **OPTIONS)
    store = wear_module._Store(tmp_path / "wear", "same")
    store.write(whole.drop_vars("force"), {})
    run = SimpleNamespace(directions={}, rates=OF_PIN, samples=whole.sizes["angle"])
    first = wear_module._Stages.first(run, scene, state)
    refused = "a store of this version.*without force.: pass another folder"
    with pytest.raises(ValueError, match=refused):
        store.read(first)


def test_a_store_recognises_functions_by_what_they_compute():
    """In another process, equal functions have other addresses."""

    ball, state = cj.Body(1.0, (1e-3, 1e-3, 1e-3)), cj.State({"ball": cj.body_state((0.1, 0, 0))})
    fields = {"cycles": np.array([10.0]), "largest_change": None, "stages": 9, "depth": None}
    run = wear_module.CycleRun(OF_PIN, CYCLE, 1, 2, 0.1, 16, **fields)

    def digest(size):
        load = cj.AppliedLoad("ball", force=(lambda t: size * jnp.cos(t), 0.0, 0.0))
        return wear_module._digest(cj.Scene({"ball": ball}, forces={"load": load}), state, run)

    assert digest(10.0) == digest(10.0) != digest(20.0)


def test_a_store_that_is_replaced_while_it_is_read_is_read_again(tmp_path, monkeypatch):
    store, opened, reads = wear_module._Store(tmp_path / "wear", ""), xr.open_zarr, []

    def write(stages):
        depths = ("joint", "stage", "angle"), np.full((1, stages, 8), 1e-6 * stages)
        store.write(xr.Dataset({"bearing_depth": depths}), {})

    def replaced(*arguments, **options):
        found = opened(*arguments, **options)
        if not reads:
            write(3)
        reads.append(found)
        return found

    write(2)
    monkeypatch.setattr(xr, "open_zarr", replaced)
    found = cj.open_wear(store.path)
    np.testing.assert_array_equal(found["bearing_depth"], np.full((1, 3, 8), 3e-6))
    assert len(reads) == 2


def test_the_last_stage_ends_at_the_goal_without_rounding(monkeypatch):
    goal, begun = 961.1, 177.8
    assert begun + (goal - begun) < goal
    depths = np.zeros((1, 0, 2, 8))
    run = SimpleNamespace(cycles=np.array(goal), largest_change=None)
    stages = wear_module._Stages(run, None, None, [0.0, begun], [depths] * 2, [depths])
    monkeypatch.setattr(stages, "_grown", lambda length: (depths, length))
    stages._extrapolate(np.inf)
    assert stages.cycles == [0.0, begun, goal]


def test_runs_that_fail_shorten_the_stages_until_the_depths_hardly_change(monkeypatch):
    """All runs with more than 3 um of wear fail."""
    measure, limit = wear_module.CycleRun.measure, [3e-6]

    def failing(run, scene, state, depths):
        measured = measure(run, scene, state, depths)
        return measured._replace(failure="broken") if depths.max() > limit[0] else measured

    monkeypatch.setattr(wear_module.CycleRun, "measure", failing)
    found = cj.wear(*whirling(), CYCLE, OF_PIN, 1000.0, **OPTIONS)
    assert found.attrs["failure"] == found.attrs["ending"] == "the run of a stage failed: broken"
    deepest = found["bearing_depth"][0].max("angle").values
    assert 2.9e-6 < deepest[-2] <= 3e-6 < deepest[-1] < 3.1e-6
    assert np.isnan(found["force"][0, -1]) and np.isfinite(found["force"][0, :-1]).all()
    limit[0] = -1.0  # The first run fails too.
    with pytest.raises(ValueError, match="broken"):
        cj.wear(*whirling(), CYCLE, OF_PIN, 1000.0, **OPTIONS)
