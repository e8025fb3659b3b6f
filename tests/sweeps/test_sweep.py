"""Sweeps of the double pendulum against single runs: states, saved rows, peaks, counts, energies.

Until the second impact a lane equals the single run to rounding, which the first impact magnifies
to 1e-11. In free flight the error of a step is rounding itself, and the next step's size follows
from it; from then on both are runs of different steps, and agree to the tolerance as far as the
motion's chaos allows.
"""

from dataclasses import fields
from itertools import product

import numpy as np
import pytest
import xarray as xr

import clearjoint as cj
from clearjoint import quantities as q

CLEARANCES, RESTITUTIONS = np.geomspace(5e-5, 1e-3, 5), [0.5, 0.9, 1.0]
END = 0.04
TIMES = np.linspace(0.0, END, 401)
ARMS = ("arm 2", "arm 3")
AXES = {
    "clearance": cj.Axis(lambda s: s.joints["shoulder"].clearance, CLEARANCES),
    "restitution": cj.Axis(lambda s: s.joints["shoulder"].law.restitution, RESTITUTIONS),
}
PATH = {
    f"path_{arm} {kind.__name__} {axis}": kind(arm, axis)
    for arm in ARMS
    for kind in (q.Position, q.Velocity)
    for axis in "xyz"
}
OUTPUTS = {
    "force": cj.Peak(q.ContactForce("shoulder", "V"), "N"),
    "impacts": cj.ImpactCount("shoulder"),
    "dissipated": cj.DissipatedEnergy(),
    "height": cj.Statistics(q.Position("arm 2", "y"), "m"),
    **PATH,
    "hits": cj.ImpactTable(4),
}
SAMPLED = cj.Saving(TIMES, states=False)
TABLED = [
    field.name for field in fields(cj.results.Impacts) if field.name not in ("joint", "contact")
]


@pytest.fixture(scope="module")
def grid():
    start, settings = cj.mechanisms.double_pendulum(), cj.Settings(ledger=True)
    return cj.sweep(*start, END, AXES, OUTPUTS, settings, SAMPLED, threads=1)


@pytest.fixture(scope="module")
def pairs(grid):
    """Each lane and the single run with its settings."""
    return [
        (grid.sel(clearance=c, restitution=e), single(clearance=c, restitution=e))
        for c in CLEARANCES
        for e in RESTITUTIONS
    ]


def single(**settings):
    start, save = cj.mechanisms.double_pendulum(**settings), cj.Saving(TIMES, impacts=True)
    return cj.simulate(*start, END, cj.Settings(ledger=True), save)


def path(lane, arm: str, kind: str) -> np.ndarray:
    """The saved rows of a lane, (times, 3)."""
    return np.stack([lane[f"path_{arm} {kind} {axis}"].values for axis in "xyz"], axis=1)


def apart(lane, run) -> np.ndarray:
    """Largest difference at each saved time of all positions and velocities, over their size."""
    parts = []
    for arm, kind in product(ARMS, ("Position", "Velocity")):
        there = getattr(run.states.bodies[arm], kind.lower())
        size = np.maximum(np.abs(there).max(axis=1), 1e-9)
        parts.append(np.abs(path(lane, arm, kind) - there).max(axis=1) / size)
    return np.max(parts, axis=0)


def test_lanes_equal_single_runs_to_rounding_until_the_second_impact(pairs):
    for lane, run in pairs:
        onsets = run.impacts.of("shoulder", "V").onset
        seen = onsets[1] if len(onsets) > 1 else END
        assert len(onsets) >= 1
        assert apart(lane, run)[seen > TIMES].max() < 1e-10


def test_lanes_equal_single_runs_to_the_tolerance_afterwards(pairs):
    """0.05 mm and no damping is the exception: sixteen impacts amplify to 1e-4."""
    for lane, run in pairs:
        assert apart(lane, run).max() < 2e-4
        if lane.clearance > 2e-4:
            assert apart(lane, run).max() < 2e-6


def test_peak_force_is_that_of_the_impact_table(pairs):
    """Within steps too, by the dense output: of successive steps' ends it would be 1e-3 off."""
    for lane, run in pairs:
        impacts = run.impacts.of("shoulder", "V")
        strongest = impacts.peak_force.argmax()
        assert float(lane.force) == pytest.approx(impacts.peak_force[strongest], rel=1e-6)
        assert float(lane.force_time) == pytest.approx(impacts.peak_time[strongest], abs=2e-8)


@pytest.mark.parametrize("base", ["V", "W"])
def test_impacts_are_those_of_the_single_run(pairs, base):
    """The first to rounding, those after it as far as the motion's chaos allows; of more than the
    table has room for, the first ones."""
    counts = set()
    for lane, run in pairs:
        lane, expected = lane.sel(hits_contact=f"shoulder {base}"), run.impacts.of("shoulder", base)
        count = int(lane.hits_count)
        counts.add(count)
        assert count == min(len(expected), 4)
        for name in TABLED:
            found, there = lane[f"hits_{name}"].values, getattr(expected, name)
            assert np.isnan(found[count:]).all()
            np.testing.assert_allclose(found[0], there[0], rtol=1e-10, err_msg=name)
            np.testing.assert_allclose(found[:count], there[:count], rtol=2e-6, err_msg=name)
        assert lane.hits_peak_force[:count].values.argmax() == expected.peak_force[:count].argmax()
    assert counts == {1, 2, 3, 4}


def test_impacts_are_counted_open_ones_included(pairs):
    for lane, run in pairs:
        still = sum(float(speed) > 0.0 for speed in run.final.entry_speeds["shoulder"].values())
        assert int(lane.impacts) == len(run.impacts) + still


def test_dissipated_energy_is_that_of_the_ledger(pairs):
    for lane, run in pairs:
        taken = run.final.work["normal damping"]
        assert float(lane.dissipated) == pytest.approx(float(taken), rel=1e-5, abs=1e-15)


def test_results_with_names_in_any_alphabet_can_be_written_as_netcdf(tmp_path):
    names = ["π", "a/b", "a_b", "it's", 'the "x"', "e\u0301", "new\nline", "a.b", "\\", "轴 1"]
    scene = cj.Scene({name: cj.Body(mass=1.0, inertia=(1.0, 1.0, 1.0)) for name in names})
    state = cj.State({name: cj.body_state(position=(0.0, 0.0, 0.0)) for name in names})
    masses = cj.Axis(lambda scene: scene.bodies["轴 1"].mass, [1.0, 2.0])
    found = cj.sweep(scene, state, 0.01, {"mass": masses}, progress=False)
    found.to_netcdf(tmp_path / "found.nc", engine="scipy")
    again = xr.load_dataset(tmp_path / "found.nc", engine="scipy")
    xr.testing.assert_equal(again, found)
    written = [name for name in again.attrs if name.startswith("scene.bodies.")]
    assert sum(name.endswith(".mass") for name in written) == len(names) - 1


def test_result_is_labelled_with_units_and_settings(grid):
    assert grid.sizes["clearance"] == 5 and grid.sizes["restitution"] == 3
    assert grid.clearance.attrs["units"] == "m" and grid.restitution.attrs["units"] == "1"
    assert grid.force.attrs == {"units": "N", "long_name": "Peak"}
    units = {"final_spin": "rad/s", "dissipated": "J", "saved_time": "s", "impacts": "1"}
    units |= {"hits_exit_speed": "m/s", "hits_peak_force": "N", "hits_largest_penetration": "m"}
    assert {name: grid[name].attrs["units"] for name in units} == units
    assert grid.final_position.dims == ("clearance", "restitution", "body", "component")
    assert list(grid.body.values) == list(ARMS)
    meanings = grid.result.attrs["flag_meanings"].split()
    codes = dict(zip(meanings, grid.result.attrs["flag_values"], strict=True))
    assert codes["pending"] == -1 and codes["successful"] == 0 and "bad_parameters" in codes
    assert float(grid.attrs["rtol"]) == cj.presets.default.rtol
    assert grid.attrs["scene.bodies.arm 2.mass"] == "7.02"
