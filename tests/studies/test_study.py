"""The study of the double pendulum in its quick setting, compared with the paper's statements."""

import numpy as np
import pytest

from studies.double_pendulum.__main__ import main, parse, run
from studies.double_pendulum.findings import report

WRITTEN = {*(f"figure_{k}.png" for k in range(13, 18)), "orbit.png", "journal.gif", "claims.md"}
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def output(tmp_path_factory):
    return tmp_path_factory.mktemp("study")


@pytest.fixture(scope="module")
def findings(output):
    return run(*parse(["--quick", "--output", str(output)]))


def test_writes_all_files(findings, output):
    del findings
    assert {file.name for file in output.iterdir()} == WRITTEN
    assert all(file.stat().st_size > 500 for file in output.iterdir())


def test_reaction_is_half_the_contact_force(findings):
    assert 0.48 < findings.reaction_share < 0.52


def test_impacts_get_weaker(findings):
    peaks = findings.peak_forces[:3]
    assert peaks == pytest.approx([1466.4, 1313.6, 1176.0], rel=2e-3)
    for values in (peaks, findings.loop_energies, findings.rebounds):
        assert len(values) == 3
        assert (np.diff(values) < 0.0).all()


def test_loops_enclose_the_energy_that_the_first_impacts_dissipate(findings):
    assert 2.0 * findings.loop_energies.sum() == pytest.approx(4.212e-3, rel=5e-3)


def test_bases_strike_together_at_first_and_then_alone(findings):
    assert len(findings.onset_gaps) == 4
    assert findings.onset_gaps[:3].max() < 1e-6
    assert findings.lone_strike == pytest.approx(73.24e-3, abs=0.1e-3)


def test_clearance_raises_the_peaks_of_acceleration(findings):
    assert findings.acceleration > 8.0 * findings.ideal_acceleration


def test_arm_slides_along_the_journal(findings):
    assert findings.slides[0.1] == pytest.approx(0.54e-3, rel=0.02)
    assert findings.slides[0.2] == pytest.approx(12.0e-3, rel=0.05)


def test_energy_is_accounted_for(findings):
    assert findings.dissipated > 4.2e-3
    assert abs(findings.ledger_residual) < 1e-3 * findings.dissipated


def test_report_names_each_statement(findings):
    text = report(findings)
    assert "49.9%" in text
    assert text.count("\n") == 12


def test_too_short_a_run_is_refused(output):
    with pytest.raises(SystemExit, match="raise --duration"):
        main(["--quick", "--duration", "0.02", "--output", str(output)])
