"""The study of cost: its tables, and that absent features of a scene add nothing to its program."""

import re

import jax
import pytest

from clearjoint.testing import RunProgram, Stepper
from studies.cost import coordinates, features
from tests.support.replaced_code import FEATURES, without

CASES = features.cases()
NAMES = list(CASES)
FAST = 3
"""Index of the last case in the fast tests."""


def cases(numbers):
    return [
        pytest.param(number, marks=[pytest.mark.slow] if number > FAST else [], id=NAMES[number])
        for number in numbers
    ]


def program_text(number):
    """Return the jaxprs of a right-hand side and of an attempted step, without addresses."""
    case = CASES[NAMES[number]]
    run = RunProgram.of(case.scene, case.state, case.settings)
    jaxprs = [
        jax.make_jaxpr(lambda step, part=part: part(run.stepper(), step))(run.step)
        for part in (Stepper.rates, Stepper.attempt)
    ]
    return re.sub(r"0x[0-9a-f]+", "", "\n".join(map(str, jaxprs)))


@pytest.mark.parametrize("number", cases(range(len(CASES) - 1)))
def test_program_is_the_same_without_the_code_of_absent_features(number):
    text = program_text(number)
    with without(*list(FEATURES)[number:]):
        assert program_text(number) == text


@pytest.mark.parametrize("number", cases(range(1, len(CASES))))
def test_program_needs_the_code_of_its_own_feature(number):
    with without(list(FEATURES)[number - 1]), pytest.raises(AssertionError, match="lacks"):
        program_text(number)


def test_quick_features_have_times(tmp_path):
    found = features.measure(quick=True)
    assert [cost.name for cost in found] == NAMES[:2]
    features.figure(found).savefig(tmp_path / "figure.png")
    assert len(features.table(found)) == 3


def test_joint_coordinates_do_not_drift_and_take_fewer_steps():
    absolute, joint = coordinates.measure([coordinates.IDEAL])
    assert (absolute.coordinates, joint.coordinates) == ("absolute", "joint")
    assert 0 < joint.attempts < absolute.attempts
    assert joint.drift < 1e-14 < absolute.drift < 1e-8
    assert len(coordinates.table([absolute, joint])[1]) == len(coordinates.table([])[0])
