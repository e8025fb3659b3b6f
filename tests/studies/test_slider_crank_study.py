"""The study of the slider-crank in its quick setting."""

import numpy as np
import pytest

import clearjoint as cj
from studies.slider_crank.__main__ import main, parse
from studies.slider_crank.runs import run
from studies.slider_crank.sweep import periods, with_ratios


@pytest.mark.slow
def test_quick_study_writes_its_files_and_finds_the_closed_forms(tmp_path):
    found = run(*parse(["--quick", "--output", str(tmp_path)]))
    written = {file.name for file in tmp_path.iterdir()}
    assert written == {"motion.png", "orbit.png", "poincare.png", "table.md"}
    for expected, value in found.ideal.values():
        assert value == pytest.approx(expected, rel=1e-5)
    acceleration, _ = found.ideal["slider acceleration, outer dead centre, m/s²"]
    moment, _ = found.ideal["largest crank moment, N m"]
    assert acceleration == pytest.approx(19419.4, rel=1e-5)
    assert moment == pytest.approx(138.52, abs=0.005)
    assert len(found.peak_ratios) == 3 and min(found.peak_ratios.values()) > 5.0


def test_too_few_revolutions_are_refused():
    with pytest.raises(SystemExit):
        parse(["--revolutions", "2"])


@pytest.mark.slow
def test_quick_sweep_writes_its_figures_and_repeats_with_small_clearances(tmp_path, capsys):
    """With 5 µm the journal stays on the wall, and peaks are nearly those of the ideal joint."""
    main(["sweep", "--quick", "--output", str(tmp_path)])
    written = {file.name for file in tmp_path.glob("*.png")}
    assert written == {"bifurcation.png", "map.png", "orbits.png"}
    assert "0 lanes failed" in capsys.readouterr().out
    swept = with_ratios(cj.open_sweep(tmp_path / "map.zarr"))
    tight = swept.isel(clearance=0, crank_speed=-1)
    assert tight["period"] == 1.0
    for peak in ("acceleration", "moment", "force"):
        assert float(tight[f"peak_{peak}_over_ideal"]) == pytest.approx(1.0, abs=0.03)
        assert float(swept[f"peak_{peak}_over_ideal"].max()) > 10.0


def test_period_is_the_least_number_of_points_after_which_a_section_repeats():
    alternating = np.tile([[0.0, 1.0], [0.5, -1.0]], (10, 1))
    drifting = np.stack([np.linspace(0.0, 2.0, 20), np.zeros(20)], axis=1)
    found = periods(np.stack([np.ones((20, 2)), alternating, drifting]))
    np.testing.assert_array_equal(found, [1.0, 2.0, np.nan])
