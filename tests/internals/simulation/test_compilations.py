"""Programs of runs, checks and records: how many are compiled."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._fields.objects import on_device, with_arrays
from clearjoint._simulation.run import run_checks
from clearjoint._simulation.run.host_run import segment_compiled
from clearjoint._simulation.run.run_checks import BY_NUMPY, flat_start, starts
from clearjoint._simulation.run.simulate import begin_compiled
from tests.simulation import test_compilations
from tests.simulation.test_compilations import SHORT
from tests.support.oscillator import on_spring
from tests.support.programs import made_by

compiled = test_compilations.compiled
rod = test_compilations.rod


@pytest.mark.parametrize("value", [0.125, 3, np.float64(2.0), np.zeros(13), np.zeros((2, 7))])
def test_numbers_of_the_host_come_to_the_device_without_a_program(value, compiled):
    before = compiled()
    array = on_device(value)
    assert compiled() == before
    assert array.dtype == float and not array.weak_type
    np.testing.assert_array_equal(array, value)


NUMBERS = (1.1e-3, np.float64(1.2e-3), np.float32(1.3e-3), np.asarray(1.4e-3), jnp.asarray(1.5e-3))


def native_programs() -> int:
    """How many programs runs, and checks of their starts, have compiled."""
    return sum(made_by(one) for one in (begin_compiled, segment_compiled)) + len(
        starts._function._programs
    )


def test_a_number_is_a_number_whatever_its_type(rod):
    """`equinox.tree_at` puts it into a scene as it is, where it would be part of the program."""
    scene, state = rod
    scene = eqx.tree_at(lambda s: s.bodies["rod"].mass, scene, 1)
    cj.simulate(scene, state, SHORT, progress=False)
    before = native_programs()
    finals = []
    for number in NUMBERS:
        wider = eqx.tree_at(lambda s: s.joints["pin"].clearance, scene, number)
        same = cj.set_value(scene, lambda s: s.joints["pin"].clearance, float(number))
        runs = [cj.simulate(one, state, SHORT, progress=False) for one in (wider, same)]
        finals.append([run.final.bodies["rod"].position for run in runs])
    assert native_programs() - before <= 1  # Of the checks, once they are many.
    np.testing.assert_array_equal(*zip(*finals, strict=True))


def test_a_start_that_has_passed_is_not_checked_again(rod, monkeypatch):
    """Other numbers are, and so is a start that leads to a warning."""
    scene, state = rod
    checked, own = [], type(starts)()
    monkeypatch.setattr(run_checks, "starts", own)

    def check(scene, state):
        return run_checks.check_start(*with_arrays((scene, state)), 0.0, cj.JointCoordinates())

    wider = cj.set_value(scene, lambda s: s.joints["pin"].clearance, 1.9e-3)
    with monkeypatch.context() as patch:
        patch.setattr(run_checks, "_recheck", checked.append)
        for _ in range(3):
            for each in (scene, wider):
                check(each, state)
    assert len(checked) == 2
    deep = cj.set_value(state, lambda s: s.bodies["rod"].position, (2e-3, -0.2, 0.0))
    for _ in range(2):
        with pytest.warns(cj.UnusualValueWarning, match="deep in the wall"):
            check(scene, deep)
    for mass in np.linspace(1.0, 2.0, BY_NUMPY + 2):
        check(cj.set_value(scene, lambda s: s.bodies["rod"].mass, mass), state)
        for number in (np.nan, -1.0):
            with pytest.raises(ValueError, match="`mass` must be (finite|positive)"):
                wrong = eqx.tree_at(lambda s: s.bodies["rod"].mass, scene, np.asarray(number))
                check(wrong, state)
    assert len(own._function._programs) == 1


def test_the_first_starts_of_a_structure_are_checked_without_a_program():
    (scene, state), own, found = on_spring(), type(starts)(), []
    for _ in range(BY_NUMPY + 2):
        redundant = own.redundant(flat_start(scene, state, 0.0, cj.AbsoluteCoordinates()))
        found.append((redundant, len(own._function._programs)))
    assert found == [(None, 0)] * BY_NUMPY + [((), 1)] * 2


def test_a_number_of_a_class_that_converts_none_stays_part_of_the_program():
    repeated = with_arrays({"own": Repeated(3, True), "state": cj.State({}, work={"air": 2})})
    assert repeated["own"].times == 3 and repeated["own"].flag is True
    assert repeated["state"].work["air"].dtype == float


class Repeated(eqx.Module):
    times: int
    flag: bool
