"""The study of the clearance in its quick settings."""

import numpy as np
import pytest

import clearjoint as cj
from clearjoint import plot
from studies.clearance_sweep import limit as clearance_limit
from studies.clearance_sweep import sweeps as clearance_sweep
from studies.clearance_sweep.__main__ import main
from studies.common.output import Output

pytestmark = pytest.mark.slow


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
