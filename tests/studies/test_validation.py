"""The study of validation: published values, to the tolerance of their programs."""

import math

import pytest

import clearjoint as cj
from studies.validation.__main__ import main, table
from studies.validation.chain import double_pendulum, has
from studies.validation.identification import LINK_GUESS, driven_link, fitted
from studies.validation.siconos import four_bar_checks


@pytest.fixture(scope="module")
def checks(tmp_path_factory):
    return main(["--quick", "--output", str(tmp_path_factory.mktemp("validation"))])


def test_modelica_examples_agree_to_the_tolerance_of_their_solver(checks):
    examples = [check for check in checks if "Examples" in check.source]
    assert len(examples) == 12
    assert [check for check in examples if not check.difference < 2e-4] == []


def test_the_wheel_is_free_between_the_flanks(checks):
    """Closed form: the gap of pi/4 rad is crossed at constant speed."""
    found = {check.name: check.ours for check in checks}
    crossing = found["the other flank is met"] - found["its gap opens"]
    assert found["speed there"] * crossing == pytest.approx(-0.25 * math.pi, rel=1e-9)


def test_derivatives_across_an_elastic_collision_agree_with_the_closed_form(checks):
    slopes = [check for check in checks if check.source.startswith("nimble")]
    assert [check.name for check in slopes] == ["dx/dx1", "dx/dx2", "dx/dv1", "dx/dv2"]
    assert [check for check in slopes if not check.difference < 1e-7] == []


def test_the_linkage_of_siconos_moves_as_published(checks):
    torque, *angles = [check for check in checks if check.source.startswith("Siconos")]
    assert torque.difference < 1e-9
    assert len(angles) == 8
    assert [check for check in angles if not abs(check.ours - check.published) < 6e-5] == []


def test_its_error_is_proportional_to_the_step():
    linkage = four_bar_checks(quick=True)
    ratios = [a / b for a, b in zip(linkage.differences[:-1], linkage.differences[1:], strict=True)]
    assert ratios == pytest.approx([2.0] * len(ratios), rel=0.1)


def test_friction_and_inertia_are_identified_from_starts_near_zero(checks):
    found = {check.name: check for check in checks if check.source.startswith("mujoco#3284")}
    assert list(found) == ["mass", "inertia", "friction", "damping"]
    assert [check for check in found.values() if not check.difference < 2e-5] == []


def test_a_fit_of_the_whole_record_at_once_stalls_and_says_so():
    with pytest.warns(cj.PoorFitWarning):
        fit = fitted(driven_link(), LINK_GUESS)
    assert fit.ending.name != "CONVERGED"


def test_lugre_friction_is_identified(checks):
    found = {check.name: check for check in checks if check.source.startswith("mujoco#3286")}
    assert found["breakaway"].difference < 2e-4 and found["kinetic"].difference < 2e-4
    assert found["stiffness"].difference < 0.02


@pytest.mark.parametrize(("name", "tolerance"), [("MuJoCo", 1e-9), ("Exudyn", 1e-7)])
def test_a_double_pendulum_moves_as_in_other_programs(checks, name, tolerance):
    found = [check for check in checks if check.source.startswith(f"{name},")]
    assert len(found) == (2 if has(name.lower()) else 0)
    assert [check for check in found if not check.difference < tolerance] == []


def test_without_other_programs_their_rows_are_left_out(monkeypatch, capsys):
    monkeypatch.setattr("studies.validation.chain.has", lambda package: False)
    assert double_pendulum() == []
    assert capsys.readouterr().out.count("not installed") == 2


def test_each_value_has_a_row(checks):
    assert len(table(checks)) == 1 + len(checks)
