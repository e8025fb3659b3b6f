"""The first hour: one file animates, simulates, reports, sweeps and fits a mechanism."""

import pytest

from studies.first_hour import __main__ as first_hour


@pytest.mark.slow
def test_everything_is_written_and_the_clearance_is_found(tmp_path, monkeypatch):
    monkeypatch.setattr(first_hour, "FOLDER", tmp_path)
    fit = first_hour.main()
    for name in ("scene.html", "motion.html", "report.pdf", "sweep.png"):
        assert (tmp_path / name).stat().st_size > 1000
    assert fit.ending is fit.ending.CONVERGED
    assert fit.estimates["clearance"] == pytest.approx(200e-6, abs=1e-6)
