"""The study of speed against accuracy: steppers, count of right-hand sides, Pareto front, parts."""

import diffrax
import numpy as np
import pytest

import clearjoint as cj
from studies.common.output import Output
from studies.speed_accuracy import evaluations, settings
from studies.speed_accuracy.__main__ import PARTS
from studies.speed_accuracy.front import excess, front, standings
from studies.speed_accuracy.preset_table import largest, onsets_and_peaks
from studies.speed_accuracy.runs import QUICK, measured
from studies.speed_accuracy.steppers import RungeKutta4, SemiImplicitEuler

FREQUENCY, STEP, COUNT = 3.0, 0.05, 40
"""Frequency, rad/s, step, s, and number of steps of an oscillator."""
ROTATION = FREQUENCY * STEP * np.array([[0.0, 1.0], [-1.0, 0.0]])
PER_STEP = {
    # The exponential's series up to the fourth term.
    RungeKutta4(): sum(
        np.linalg.matrix_power(ROTATION, k) / factor for k, factor in enumerate((1, 1, 2, 6, 24))
    ),
    # Speed first: v + h a(x), then x + h v at the new speed.
    SemiImplicitEuler(): np.array(
        [[1.0 - (FREQUENCY * STEP) ** 2, FREQUENCY * STEP], [-FREQUENCY * STEP, 1.0]]
    ),
}


@pytest.mark.parametrize("solver", PER_STEP, ids=lambda solver: type(solver).__name__)
def test_fixed_steps_of_an_oscillator_are_powers_of_a_matrix(solver):
    """The vector has the position and the speed over the frequency."""
    body = cj.Body(2.0, (0.1, 0.1, 0.1))
    spring = cj.SpringDamper("ground", "body", (0, 0, 0), (0, 0, 0), 2.0 * FREQUENCY**2)
    scene = cj.Scene({"body": body}, {}, {"spring": spring})
    solution = cj.simulate(
        scene,
        cj.State({"body": cj.body_state((0.1, 0.0, 0.0))}),
        COUNT * STEP,
        cj.Settings(
            solver=solver,
            controller=diffrax.ConstantStepSize(),
            first_step=STEP,
            landing_tolerance=None,
        ),
    )
    end = solution.final.bodies["body"]
    found = np.array([end.position[0], end.velocity[0] / FREQUENCY])
    expected = np.linalg.matrix_power(PER_STEP[solver], COUNT) @ np.array([0.1, 0.0])
    assert int(solution.attempts) == COUNT
    np.testing.assert_allclose(found, expected, rtol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("lands", [True, False])
@pytest.mark.parametrize("solver", settings.EXPLICIT, ids=lambda solver: type(solver).__name__)
def test_right_hand_sides_are_as_many_as_the_tableau_says(solver, lands):
    """One more is needed at the start."""
    chosen = settings.adaptive(solver, 1e-5, lands).settings
    counted = evaluations.counted(0.03, chosen)
    assert 0.0 < counted - evaluations.an_attempt(chosen) < 0.03


def test_the_largest_force_of_a_sweep_is_that_of_the_reference():
    expected = onsets_and_peaks(0.05)[:, 1].max()
    assert largest(0.05, cj.presets.default) == pytest.approx(expected, rel=1e-6)


def itself(item):
    return item


ITEMS = [(1.0, 1.0), (2.0, 0.1), (2.5, 0.5), (4.0, 0.1), (8.0, 0.01), (9.0, np.nan), (0.5, 0.0)]
"""Cost and error: the second beats the third and fourth; the last two are invalid."""


def test_front_has_the_items_that_no_other_beats():
    assert front(ITEMS, itself) == [(1.0, 1.0), (2.0, 0.1), (8.0, 0.01)]


def test_excess_is_relative_to_the_cheapest_item_as_exact():
    assert [excess(item, ITEMS, itself) for item in ITEMS[:5]] == [1.0, 1.0, 1.25, 2.0, 1.0]


def test_a_family_is_dominated_if_a_cheaper_item_is_as_exact_everywhere():
    family = {1.0: "a", 2.0: "a", 8.0: "a", 2.5: "b", 4.0: "c"}
    found = {one.family: one for one in standings(ITEMS[:5], itself, lambda item: family[item[0]])}
    assert list(found) == ["a", "b", "c"]
    assert [found[name].dominated for name in "abc"] == [False, False, True]
    assert (found["c"].least, found["c"].nearest) == (2.0, "(4.0, 0.1)")


@pytest.mark.slow
def test_error_falls_and_work_grows_with_the_tolerance():
    points = [measured(setting, QUICK) for setting in settings.quick_grid()]
    assert len(points) == 3
    assert (np.diff([point.error for point in points]) < 0.0).all()
    assert (np.diff([point.short_evaluations for point in points]) > 0.0).all()
    assert points[-1].error < 1e-7


@pytest.mark.slow
@pytest.mark.parametrize("part", PARTS)
def test_parts_run(part, tmp_path):
    text = "\n".join(PARTS[part](Output(tmp_path, quick=True), QUICK))
    assert text.count("\n|") > 3 and "nan" not in text
