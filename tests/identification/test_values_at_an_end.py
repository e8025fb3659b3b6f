"""Parameters that the data show to be zero, infinite, or at a bound, on a body that drifts."""

from dataclasses import replace

import numpy as np
import pytest

import clearjoint as cj
from tests.support.one_body import one_body

SCENE, STATE = one_body("puck")
TIMES, NOISE = np.linspace(0.1, 1.0, 10), 1e-3
ERROR = NOISE / np.linalg.norm(TIMES)
"""Standard deviation of the speed, by linear least squares of positions."""


def with_speed(scene, state, speed):
    velocity = np.array([1.0, 0.0, 0.0]) * speed
    return scene, cj.State({"puck": replace(state.bodies["puck"], velocity=velocity)})


def with_pace(scene, state, pace):
    return with_speed(scene, state, 1.0 / pace)


def fitted(change, scale, positions):
    series = cj.Series(cj.quantities.Position("puck", "x"), TIMES, positions, NOISE)
    parameters = {"value": cj.Parameter.change(change, 1.0, scale)}
    options = {"check_runs": 0, "progress": False}
    return cj.identify(SCENE, STATE, cj.Measurements({"x": series}), parameters, **options)


@pytest.mark.parametrize(
    "change, scale, limits",
    [
        (with_speed, cj.Log(), (0.0, 1.96 * ERROR)),
        (with_pace, cj.Log(), (1.0 / (1.96 * ERROR), np.inf)),
        (with_speed, cj.Bounded(0.0, 10.0), (0.0, 1.96 * ERROR)),
    ],
)
def test_intervals_are_those_of_linear_least_squares(change, scale, limits):
    fit = fitted(change, scale, -0.2 * ERROR * TIMES)
    assert fit.ending is cj.results.Ending.CONVERGED
    assert fit.intervals["value"] == pytest.approx(limits, rel=0.1)
    assert any("value is at" in warning for warning in fit.warnings)


def without_effect(scene, state, value):
    return cj.set_value(scene, lambda s: s.bodies["puck"].inertia[1], 1.0 + value**2), state


@pytest.mark.parametrize(
    "scale, limits",
    [
        (cj.Log(), (0.0, np.inf)),
        (cj.Linear(), (-np.inf, np.inf)),
        (cj.Bounded(0.0, 10.0), (0.0, 10.0)),
    ],
)
def test_without_effect_any_value_is_in_the_interval(scale, limits):
    fit = fitted(without_effect, scale, 0.0 * TIMES)
    assert fit.intervals["value"] == limits
    assert not any("at most" in warning or "at least" in warning for warning in fit.warnings)


@pytest.mark.slow
@pytest.mark.parametrize("truth", [0.0, 0.5, 1.0, 3.0])
def test_intervals_hold_small_values_in_36_of_40_draws(truth):
    generator, inside = np.random.default_rng(1), 0
    for _ in range(40):
        positions = truth * ERROR * TIMES + NOISE * generator.standard_normal(len(TIMES))
        low, high = fitted(with_speed, cj.Log(), positions).intervals["value"]
        inside += low <= truth * ERROR <= high
    assert inside >= 36
