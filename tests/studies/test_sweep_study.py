"""The study of the clearance in its quick settings, compared with closed forms."""

import numpy as np
import pytest

import clearjoint as cj
from clearjoint import plot
from studies.clearance_sweep import limit as clearance_limit
from studies.clearance_sweep import sweeps as clearance_sweep
from studies.clearance_sweep.__main__ import main
from studies.common.output import Output

pytestmark = pytest.mark.slow

GRAVITY = 9.81


@pytest.fixture(scope="module")
def output(tmp_path_factory):
    return Output(tmp_path_factory.mktemp("clearance"), quick=True)


@pytest.fixture(scope="module")
def swept(output):
    clearance_sweep.sweep(output)
    return cj.open_sweep(output.folder / "sweep.zarr")


def pictures(output, *names):
    return all((output.folder / f"{name}.png").stat().st_size > 3000 for name in names)


def test_sweep_draws_and_stores_what_does_not_fail(output, swept):
    assert pictures(output, "summary", "impacts", "orbits")
    assert (swept["result"] == 0).all()
    assert swept.sizes["clearance"] == 16


def test_journal_falls_freely_at_first(swept):
    """The offset is g t^2 / 2 up to the wall, which is met at sqrt(2 g c) after sqrt(2 c / g)."""
    clearance = swept["clearance"].values
    assert swept["impact_entry_speed"][:, 0].values == pytest.approx(
        np.sqrt(2 * GRAVITY * clearance)
    )
    assert swept["impact_time"][:, 0].values == pytest.approx(np.sqrt(2 * clearance / GRAVITY))
    falling = swept["saved_time"] < 0.99 * swept["impact_time"][:, 0]
    for offset, expected in (("x", 0.0), ("y", 0.5 * GRAVITY * swept["saved_time"] ** 2)):
        error = (swept[offset] - expected).where(falling)
        assert float(np.abs(error).max()) < 1e-12


def test_restitution_is_the_delivered_one(swept):
    """It is that of impacts 1 and 2; the extended-precision reference has 0.9115 at 0.5 mm."""
    half = swept["impact_entry_speed"].sel(clearance=0.5e-3, method="nearest").values
    assert half[1] / half[0] == pytest.approx(0.9115, abs=3e-4)


def test_journal_stays_in_its_bearing(swept):
    eccentricity = np.hypot(swept["x"], swept["y"])
    assert float((eccentricity - swept["clearance"]).max()) < 20e-6


def test_a_finished_sweep_is_read_and_not_computed(output, swept, capsys):
    def written():
        return {path: path.stat().st_mtime_ns for path in (output.folder / "sweep.zarr").rglob("*")}

    before = written()
    findings = clearance_sweep.sweep(output)
    assert written() == before
    assert "has 16 of 16 lanes" in capsys.readouterr().out
    assert "0 of 16 lanes failed" in findings


def test_map_of_clearance_and_restitution(output):
    findings = clearance_sweep.restitution_map(output)
    assert pictures(output, "map")
    mapped = cj.open_sweep(output.folder / "map.zarr")
    assert mapped["peak_force"].shape == (6, 4)
    assert float(np.abs(mapped["dissipated_energy"].sel(restitution=1.0)).max()) == 0.0
    impacts = mapped["impacts"].sum("clearance").values
    assert impacts[-1] > 5 * impacts[0]
    assert any("nothing is dissipated" in line for line in findings)


def test_limit_is_the_ideal_joint_if_the_journal_is_fixed_axially(output):
    """Its tilt over 20 mm moves the end arm's centre, sqrt(1.25) m away, 112 times the gap."""
    fixed = clearance_limit.deviations(output, "limit_held", cj.FixedAxially())
    rate = plot.power_law_exponent(fixed, "deviation", "play", within=(0, 0.3e-3))
    assert rate == pytest.approx(1.0, abs=0.05)
    ratio = (fixed["deviation"] / fixed["play"]).sel(clearance=slice(None, 0.3e-3))
    assert float(ratio.min()) > 100.0
    assert float(ratio.max()) < 160.0


def test_limit_is_another_joint_if_it_is_not(output):
    findings = clearance_limit.limit(output)
    assert pictures(output, "limit")
    assert len(findings) == 5
    free = clearance_limit.deviations(output, "limit_free", cj.FreeAxially())
    assert float(free["deviation"][0]) > 0.04


def test_a_store_of_another_sweep_is_refused(output, swept, monkeypatch):
    monkeypatch.setattr(clearance_sweep, "QUICK_DURATION", 0.25)
    with pytest.raises(SystemExit, match="end_time"):
        main(["sweep", "--quick", "--output", str(output.folder)])
