"""The page of figures and tables of a run."""

from dataclasses import replace

import matplotlib.pyplot as plt
import pytest

import clearjoint as cj
from clearjoint import plot
from clearjoint._export.datasets import setting_notes
from tests.support.tumbling_bearing import solution_of, tumbling_bearing


def test_a_report_has_all_panels_and_tables(tmp_path):
    scene, solution, _ = tumbling_bearing()
    rows = [
        ("pin", "V", 0.01 * k, 0.01 * k + 1e-3, 1e-3, 0.1, 0.09, 10.0 * k, 0.0, 1e-6)
        for k in range(1, 11)
    ]
    solution = solution_of(solution.saved, cj.results.Impacts.of_rows(rows))
    solution = replace(solution, settings=setting_notes(vars(cj.Settings(rtol=1e-7))))
    page = plot.report(scene, solution, tmp_path / "page.png", title="Round")
    assert (tmp_path / "page.png").stat().st_size > 50_000
    texts = [text.get_text().replace("\n", " ") for text in page.findobj(plt.Text)]
    for text in (
        "Round",
        "500 µm",
        "Hertz",
        "bearing – journal",
        "Steps: 60 steps accepted of 70 tried; 10 finished impacts, "
        "the largest of 100 N at one contact",
        "Equations: Tsit5, rtol 1e-07, AbsoluteCoordinates, Baumgarte, without energy ledger",
        "Scene: 2 bodies of 2 kg, 1 joint, 0 forces, no gravity",
        "pin: orbit",
        "normal force, N",
        "following",
        "amplitude of spin of journal about its x, rad/s",
        "100.0",
    ):
        assert text in texts, text
    assert "20.0" not in texts  # of ten impacts the eight largest
    orbit = next(axes for axes in page.findobj(plt.Axes) if axes.get_title() == "pin: orbit")
    assert orbit.get_aspect() == 1.0
    with pytest.raises(ValueError, match=r"`file` must be with the suffix .png or .pdf"):
        plot.report(scene, solution, tmp_path / "page.doc")
    plt.close("all")
