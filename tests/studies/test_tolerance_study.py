"""The tolerance design runs in its quick setting; its derivatives are those of its margins."""

import numpy as np
import pytest

import clearjoint as cj
from studies.slider_crank.runs import PIN, Settings, closed_form
from studies.slider_crank.sweep import pin_force
from studies.tolerance_design.__main__ import main
from studies.tolerance_design.figures import ideal_pin_force
from studies.tolerance_design.search import FORCE, POSITION, distance, settled, start


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """Lines and pictures of a quick run."""
    folder = tmp_path_factory.mktemp("tolerance")
    with pytest.MonkeyPatch.context() as patch:
        lines: list[str] = []
        patch.setattr("builtins.print", lambda text: lines.extend(text.splitlines()))
        main(["--quick", "--output", str(folder)])
    return lines, {file.name: file.stat().st_size for file in folder.iterdir()}


def test_quick_study_draws_and_beats_bisection_where_margins_are_smooth(printed):
    lines, pictures = printed
    assert set(pictures) == {"margin.png", "motion.png"} and min(pictures.values()) > 3000
    alone = [line for line in lines if "first revolution" in line and "alone" in line]
    assert len(alone) == 2
    for line in alone:
        assert "in 4 looks; bisection takes 20" in line


def test_what_is_found_is_the_largest(printed):
    """The margin goes from positive to negative within a per cent."""
    checked = [line for line in printed[0] if "at 0.995" in line]
    assert len(checked) == 1
    assert "margin +" in checked[0] and "and -" in checked[0]


def test_slopes_are_those_of_the_margins(printed):
    """Central differences; the slider is off by clearance and penetration, the rod tilted."""
    design, place, step = start(), np.log(20e-6), 1e-4
    below, here, above = (design.look(place + shift) for shift in (-step, 0.0, step))
    for name in design.limits:
        difference = (above.margins[name] - below.margins[name]) / (2.0 * step)
        assert here.slopes[name] == pytest.approx(difference, rel=2e-5)
    furthest = design.position_tolerance * np.exp(-here.margins[POSITION])
    assert 20e-6 < furthest < 1.1 * (20e-6 + 10e-6)


def test_ideal_pin_force_drives_the_slider_alone_at_the_dead_centres():
    design = settled(1.5)
    exact = closed_form(Settings(revolutions_a_minute=design.speed))
    found = ideal_pin_force(design, np.array([0.0, np.pi]))
    assert found[0] == pytest.approx(exact["force"], rel=1e-5)
    assert found[1] == pytest.approx(exact["force"] * exact["inner"] / exact["outer"], rel=1e-5)


@pytest.mark.slow
def test_margins_are_those_of_a_sweep():
    """`Peak` sees every step of a run of its own."""
    design, clearances = start(), np.array([8e-6, 20e-6, 45e-6])
    scene, state = cj.slider_crank(speed=design.speed * np.pi / 30.0)
    swept = cj.sweep(
        scene,
        state,
        design.period,
        {"clearance": cj.Axis(lambda scene: scene.joints[PIN].clearance, clearances)},
        {POSITION: cj.Peak(distance, "m"), FORCE: cj.Peak(pin_force, "N")},
        settings=cj.Settings(rtol=1e-9),
    )
    for k, clearance in enumerate(clearances):
        looked = design.look(np.log(clearance))
        for name, limit in design.limits.items():
            expected = np.log(limit / float(swept[name][k]))
            assert looked.margins[name] == pytest.approx(expected, abs=2e-5)
