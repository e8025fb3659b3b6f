"""Absent features of a scene add nothing to its program."""

import re

import jax
import jax.numpy as jnp
import pytest

from clearjoint._math.vectors import fold_constants, unpack
from clearjoint._simulation.run.run_checks import check_start
from clearjoint._simulation.run.run_loop import begin_run
from clearjoint._simulation.step.method import Scheme
from clearjoint._simulation.step.stepping import attempt
from clearjoint._simulation.step.trial_step import rates_of
from tests.internals.support.replaced_code import FEATURES, without
from tests.studies.test_cost import CASES, NAMES

FAST = 2
"""Index of the last case in the fast tests."""


def cases(numbers):
    return [
        pytest.param(number, marks=[pytest.mark.slow] if number > FAST else [], id=NAMES[number])
        for number in numbers
    ]


def program_text(number):
    """Return the jaxprs of a right-hand side and of an attempted step, without addresses."""
    case = CASES[NAMES[number]]
    redundant = check_start(case.scene, case.state, 0.0, case.settings.coordinates)
    scheme, scene = Scheme.of(case.settings, bool(redundant)), fold_constants(case.scene)
    begin, end, first_step = (jnp.asarray(time) for time in (0.0, 1e9, 1e-6))
    step = begin_run(
        scheme.method, scheme.system(unpack(scene)), case.state, begin, end, first_step
    )

    def rates(scheme, scene, step):
        return rates_of(scheme.system(unpack(scene)), step.y, step.entry_speeds, step.t)

    def attempted(scheme, scene, step):
        return attempt(scheme.method, scheme.system(unpack(scene)), step, jnp.asarray(jnp.inf)).step

    # The numbers of the scene are constants here, which a run passes as arguments.
    jaxprs = [
        jax.make_jaxpr(lambda step, part=part: part(scheme, scene, step))(step)
        for part in (rates, attempted)
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
