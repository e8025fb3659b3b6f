"""Values that other programs have published, to the tolerance that these ran with."""

import pytest

from studies.validation.__main__ import main, table


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    return main(["--quick", "--output", str(tmp_path_factory.mktemp("validation"))])


def test_modelica_s_examples_agree_to_the_tolerance_of_their_solver(examples):
    checks = [check for example in examples for check in example.checks]
    assert len(checks) == 12
    far = [check for check in checks if not check.difference < 2e-4]
    assert far == []


def test_the_wheel_is_free_between_the_flanks(examples):
    """Closed form: the gap of pi/4 rad is crossed at constant speed."""
    found = {check.name: check.ours for check in examples[0].checks}
    crossing = found["the other flank is met"] - found["its gap opens"]
    assert found["speed there"] * crossing == pytest.approx(-3.141592653589793 / 4.0, rel=1e-9)


def test_each_published_value_has_a_row(examples):
    assert len(table(examples)) == 1 + 12
