"""The slider-crank's study runs in its quick setting."""

import importlib.util
from pathlib import Path

import pytest

FILE = Path(__file__).resolve().parents[1] / "studies" / "slider_crank.py"


@pytest.fixture(scope="module")
def study():
    spec = importlib.util.spec_from_file_location("slider_crank_study", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_quick_study_writes_its_files_and_finds_the_closed_forms(study, tmp_path):
    study.main(["--quick", "--output", str(tmp_path)])
    written = {file.name for file in tmp_path.iterdir()}
    assert written == {"motion.png", "orbit.png", "poincare.png", "table.md"}
    table = (tmp_path / "table.md").read_text(encoding="utf-8")
    rows = [line.strip("| ").split(" | ") for line in table.splitlines()]
    values = {row[0]: (float(row[1]), float(row[2])) for row in rows[2:8]}
    for expected, found in values.values():
        assert found == pytest.approx(expected, rel=1e-5)
    assert values["slider acceleration, outer dead centre, m/s²"][0] == pytest.approx(19419.4)
    assert values["largest crank moment, N m"][0] == pytest.approx(138.52, abs=0.005)
    peaks = {row[0]: float(row[1]) for row in rows if row[0].startswith("peak")}
    assert len(peaks) == 3 and min(peaks.values()) > 5.0


def test_too_few_revolutions_are_refused(study):
    with pytest.raises(SystemExit):
        study.parse(["--revolutions", "2"])
