"""The study of validation: published values, to the tolerance of their programs."""

import json
import math

import numpy as np
import pytest

import clearjoint as cj
from studies.validation.__main__ import main, table
from studies.validation.benchmarks import benchmarks
from studies.validation.bounce import bounce, mujoco_orders
from studies.validation.chain import double_pendulum
from studies.validation.collision import collision
from studies.validation.damper import UNITS, fit_damper, read
from studies.validation.identification import LINK_GUESS, driven_link, fitted, journal_friction
from studies.validation.programs import has
from studies.validation.rigid_ball import rigid_ball
from studies.validation.siconos import four_bar_checks


@pytest.fixture(scope="module")
def checks(tmp_path_factory):
    return main(["--quick", "--output", str(tmp_path_factory.mktemp("validation"))])


def far(found, tolerance):
    """Those values that are further from the published ones than a tolerance, or no numbers."""
    return [check for check in found if not check.difference < tolerance]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("source", "count", "tolerance"),
    [
        (".Examples.", 12, 2e-4),
        ("mujoco#3284", 4, 2e-5),
        ("MuJoCo, double pendulum", 2 * has("mujoco"), 1e-9),
        ("Exudyn, double pendulum", 2 * has("exudyn"), 1e-7),
        ("MuJoCo, bouncing ball", 2 * has("mujoco"), 1e-7),
        ("Exudyn, bouncing ball", 2 * has("exudyn"), 1e-7),
        ("IFToMM", 2, 1e-7),
    ],
)
def test_values_agree_with_the_published_ones(checks, source, count, tolerance):
    found = [check for check in checks if source in check.source]
    assert len(found) == count and far(found, tolerance) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("compute", "names", "tolerance"),
    [
        (collision, ["dx/dx1", "dx/dx2", "dx/dv1", "dx/dv2"], 1e-7),
        (journal_friction, ["breakaway", "kinetic", "stiffness"], 1e-3),
    ],
    ids=["derivatives across an elastic collision", "LuGre friction in a bearing"],
)
def test_values_agree_with_closed_forms_and_true_ones(compute, names, tolerance):
    found = compute()
    assert [check.name for check in found] == names and far(found, tolerance) == []


@pytest.mark.slow
def test_the_wheel_is_free_between_the_flanks(checks):
    """Closed form: the gap of pi/4 rad is crossed at constant speed."""
    found = {check.name: check.ours for check in checks}
    crossing = found["the other flank is met"] - found["its gap opens"]
    assert found["speed there"] * crossing == pytest.approx(-0.25 * math.pi, rel=1e-9)


@pytest.fixture(scope="module")
def linkage():
    return four_bar_checks(quick=True)


@pytest.mark.slow
def test_the_linkage_of_siconos_moves_as_published(linkage):
    torque, *angles = linkage.checks
    assert torque.difference < 1e-9
    assert len(angles) == 8
    assert [check for check in angles if not abs(check.ours - check.published) < 6e-5] == []


@pytest.mark.slow
def test_its_error_is_proportional_to_the_step(linkage):
    ratios = [a / b for a, b in zip(linkage.differences[:-1], linkage.differences[1:], strict=True)]
    assert ratios == pytest.approx([2.0] * len(ratios), rel=0.1)


@pytest.mark.slow
def test_the_ball_of_siconos_bounces_as_published():
    height, velocity, impulse = rigid_ball(quick=True)
    # An impact is found to half a step of 8 us, in which gravity changes the velocity by 4e-5 m/s.
    assert abs(height.ours - height.published) < 2e-5
    assert abs(velocity.ours - velocity.published) < 5e-4
    assert abs(impulse.ours - impulse.published) < 5e-4


@pytest.mark.slow
def test_a_fit_of_the_whole_record_at_once_stalls_and_says_so():
    with pytest.warns(cj.PoorFitWarning):
        fit = fitted(driven_link(), LINK_GUESS)
    assert fit.ending.name != "CONVERGED"


@pytest.mark.slow
def test_lugre_friction_is_identified(checks):
    found = {check.name: check for check in checks if check.source.startswith("mujoco#3286")}
    assert found["breakaway"].difference < 2e-4 and found["kinetic"].difference < 2e-4
    assert found["stiffness"].difference < 0.02


@pytest.mark.skipif(not has("mujoco"), reason="MuJoCo is not installed")
def test_the_bounce_of_mujoco_converges_with_the_order_of_its_method():
    assert mujoco_orders() == pytest.approx([4.0, 4.0], abs=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("checks_of_others", [double_pendulum, bounce])
def test_without_other_programs_their_rows_are_left_out(checks_of_others, monkeypatch, capsys):
    monkeypatch.setattr("studies.validation.programs.has", lambda package: False)
    assert checks_of_others() == []
    assert capsys.readouterr().out.count("not installed") == 2


@pytest.mark.slow
def test_all_benchmarks_end_at_their_references():
    found = benchmarks(quick=False)
    assert {check.source[:10] for check in found} == {f"IFToMM A0{k}" for k in range(1, 5)}
    assert far(found, 1e-7) == []


PLAY, STIFFNESS, FORWARDS, BACKWARDS = 3e-3, 4e6, 9e3, 7e3


@pytest.fixture
def damper_record(tmp_path):
    """A made-up record in the format of the dataset, of a massless drum.

    The drum stays where it is unless the spring behind the play exceeds the friction.
    """
    times = np.arange(0.0, 10.0, 1.0 / 1024.0)
    places = 0.02 * np.sin(np.pi * times)
    drum, forces = 0.0, []
    for place in places:
        drum = max(drum, place - 0.5 * PLAY - FORWARDS / STIFFNESS)
        drum = min(drum, place + 0.5 * PLAY + BACKWARDS / STIFFNESS)
        depth = abs(place - drum) - 0.5 * PLAY
        forces.append(math.copysign(STIFFNESS * max(depth, 0.0), place - drum))
    inch, kip = 25.4e-3, 4448.2216  # m, N
    rows = np.stack([times, places / inch, np.array(forces) / kip], axis=1)
    path = tmp_path / "made_up.json"
    path.write_text(json.dumps({"data": rows.tolist(), **UNITS}))
    return path


def test_a_record_of_the_damper_is_read_in_si_units(damper_record):
    record = read(damper_record)
    assert record.time[1] == 1.0 / 1024.0
    assert record.displacement.max() == pytest.approx(0.02, rel=1e-6)
    assert record.force.max() == pytest.approx(FORWARDS, rel=1e-6)
    assert record.force.min() == pytest.approx(-BACKWARDS, rel=1e-6)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[1, 2", "is not a JSON file"),
        ("[1, 2]", "has the units None"),
        (json.dumps({"data": [[0, 1, 2]], **UNITS, "time units": "ms"}), "'time units': 'ms'"),
        (json.dumps({"data": [[0, 1], [1, 2]], **UNITS}), r"the shape \(2, 2\)"),
        (json.dumps({"data": [[0, 1, 2], [1, 2]], **UNITS}), r"the shape \(0, 0\)"),
        (json.dumps({"data": [[0, 1, 1], [1, 1, 1]], **UNITS}), "0 rises"),
    ],
)
def test_a_file_that_is_no_record_of_the_damper_is_refused(tmp_path, text, complaint):
    path = tmp_path / "wrong.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=complaint):
        fit_damper(path)


@pytest.mark.slow
def test_play_and_friction_of_a_made_up_record_are_found(damper_record):
    fit = fit_damper(damper_record)
    friction = {"forwards": FORWARDS, "backwards": BACKWARDS}
    expected = {"play": PLAY, "stiffness": STIFFNESS, **friction}
    assert fit.estimates == pytest.approx(expected, rel=0.01)
    assert fit.rms < 0.02 * FORWARDS


@pytest.mark.slow
def test_each_value_has_a_row(checks):
    assert len(table(checks)) == 1 + len(checks)
