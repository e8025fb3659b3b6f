"""The tolerance design runs in its quick setting."""

import re

import numpy as np
import pytest

from studies.slider_crank.runs import Settings, closed_form
from studies.tolerance_design.__main__ import main
from studies.tolerance_design.figures import ideal_pin_force
from studies.tolerance_design.search import POSITION, settled, start


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """Lines and pictures of a quick run."""
    folder = tmp_path_factory.mktemp("tolerance")
    with pytest.MonkeyPatch.context() as patch:
        lines: list[str] = []
        patch.setattr("builtins.print", lambda text: lines.extend(text.splitlines()))
        main(["--quick", "--output", str(folder)])
    return lines, {file.name: file.stat().st_size for file in folder.iterdir()}


def test_quick_study_draws_and_finds_the_largest_for_both_limits(printed):
    lines, pictures = printed
    assert set(pictures) == {"margin.png", "motion.png"} and min(pictures.values()) > 3000
    found = [line for line in lines if "first revolution" in line]
    position, force, both = (float(re.search(r"([\d.]+) µm\. Up", line)[1]) for line in found)
    assert both == min(position, force)
    margins = start().margins(np.array([0.999, 1.001]) * 1e-6 * both)
    assert np.min([*margins.values()], axis=0)[0] > 0.0 > np.min([*margins.values()], axis=0)[1]


def test_the_slider_is_off_by_clearance_and_penetration(printed):
    design = start()
    furthest = design.position_tolerance * np.exp(-design.margins(np.array([20e-6]))[POSITION])
    assert 20e-6 < furthest[0] < 1.1 * (20e-6 + 10e-6)


def test_ideal_pin_force_drives_the_slider_alone_at_the_dead_centres():
    design = settled(1.5)
    exact = closed_form(Settings(revolutions_a_minute=design.speed))
    found = ideal_pin_force(design, np.array([0.0, np.pi]))
    assert found[0] == pytest.approx(exact["force"], rel=1e-5)
    assert found[1] == pytest.approx(exact["force"] * exact["inner"] / exact["outer"], rel=1e-5)
