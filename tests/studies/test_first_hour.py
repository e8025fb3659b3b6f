"""A mechanism of one's own is seen, run, reported, swept and fitted by one file."""

import re

import pytest

from studies.first_hour import __main__ as first_hour


@pytest.mark.slow
def test_everything_is_written_and_the_clearance_is_found(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(first_hour, "FOLDER", tmp_path)
    first_hour.main()
    written = {file.name for file in tmp_path.iterdir()}
    assert written == {"scene.html", "motion.html", "report.pdf", "sweep.png", "sweep.zarr"}
    found = re.search(r"fitted: ([\d.]+) µm, converged", capsys.readouterr().out)
    assert found and float(found[1]) == pytest.approx(200.0, abs=1.0)
