"""The study of a design to a tolerance, in its quick setting."""

import numpy as np
import pytest

from studies.common.output import Output
from studies.slider_crank.runs import Settings, closed_form
from studies.tolerance_design.figures import ideal_pin_force
from studies.tolerance_design.findings import run
from studies.tolerance_design.search import POSITION, settled, start

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def output(tmp_path_factory):
    return Output(tmp_path_factory.mktemp("tolerance"), quick=True)


@pytest.fixture(scope="module")
def found(output):
    return run(output)


def test_quick_study_draws_and_finds_the_largest_for_both_limits(found, output):
    for name in ("margin", "motion"):
        assert (output.folder / f"{name}.png").stat().st_size > 3000
    (answer,) = found.answers
    both = answer.both.value
    assert both == pytest.approx(min(one.value for one in answer.alone.values()), rel=1e-4)
    margins = start().margins(np.array([0.999, 1.001]) * both)
    below, above = np.min([*margins.values()], axis=0)
    assert below > 0.0 > above
    assert len(found.lines()) == 3 + len(found.growths)


def test_the_slider_is_off_by_clearance_and_penetration():
    design = start()
    furthest = design.position_tolerance * np.exp(-design.margins(np.array([20e-6]))[POSITION])
    assert 20e-6 < furthest[0] < 1.1 * (20e-6 + 10e-6)


def test_ideal_pin_force_drives_the_slider_alone_at_the_dead_centres():
    design = settled(1.5)
    exact = closed_form(Settings(revolutions_a_minute=design.speed))
    found = ideal_pin_force(design, np.array([0.0, np.pi]))
    assert found[0] == pytest.approx(exact["force"], rel=1e-5)
    assert found[1] == pytest.approx(exact["force"] * exact["inner"] / exact["outer"], rel=1e-5)
