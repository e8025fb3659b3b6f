"""Margins and the search for their zero, on functions and on a drop with a closed form."""

import numpy as np
import pytest

import clearjoint as cj
from clearjoint.quantities import ContactForce, Eccentricity
from studies.tolerance_design.margins import (
    Margins,
    first_failure,
    largest_within,
    margins_of,
    predicted,
)

MASS, GRAVITY, STIFFNESS = 7.0, 9.81, 1e8
LARGEST = {"eccentricity": 0.5e-3, "force": 150.0}


def made(function, slope):
    """A look with one output, and the places it was asked for."""
    asked = []

    def look(place):
        asked.append(place)
        return Margins(place, {"x": function(place)}, {"x": slope(place)}, {"x": 0.0})

    return look, asked


def test_a_power_law_takes_two_runs():
    look, asked = made(lambda place: 1.0 - 2.0 * place, lambda place: -2.0)
    found = largest_within(look, -3.0, 4.0)
    assert found.place == pytest.approx(0.5) and found.known
    assert len(asked) == 2


@pytest.mark.parametrize("slope", [0.0, 1.0, -1e9, -1e-9, np.nan])
def test_a_wrong_slope_costs_runs_and_not_the_answer(slope):
    look, asked = made(lambda place: 1.0 - np.exp(place - 0.3), lambda place: slope)
    assert largest_within(look, -3.0, 4.0).place == pytest.approx(0.3, abs=1e-5)
    assert 10 < len(asked) < 80


def test_a_margin_that_jumps_ends_on_the_side_that_holds():
    look, _ = made(lambda place: 1.0 if place < 0.3 else -1.0, lambda place: -1.0)
    place = largest_within(look, -3.0, 4.0).place
    assert 0.3 - 1e-5 <= place < 0.3


def test_a_run_that_fails_does_not_hold():
    look, _ = made(lambda place: 1.0 if place < 0.3 else np.nan, lambda place: np.nan)
    assert largest_within(look, -3.0, 4.0).place == pytest.approx(0.3, abs=1e-5)


def test_ends_that_hold_and_fail():
    look, asked = made(lambda place: 10.0 - place, lambda place: -1.0)
    found = largest_within(look, 0.0, 4.0)
    assert (found.place, found.known, asked) == (4.0, False, [0.0, 4.0])
    with pytest.raises(ValueError, match="`low` must be a place that holds, with `x`, but is 11"):
        largest_within(look, 11.0, 12.0)


def test_lanes_show_what_a_search_does_not_see():
    """cos is negative between pi/2 and 3 pi/2, and zero again at 5 pi/2."""
    look, _ = made(np.cos, lambda place: -np.sin(place))
    lanes = [look(place) for place in np.arange(0.0, 9.0)]
    assert first_failure(lanes, 2.5 * np.pi) == (1.0, 2.0)
    assert first_failure(lanes, 0.5 * np.pi) is None
    assert predicted(lanes, "x", 0.2) == 1.0  # trapezia err by up to 1/12
    assert predicted(lanes, "x", 0.01) < 0.5


def test_the_narrowest_margin_decides():
    both = Margins(0.0, {"a": 0.2, "b": 0.1}, {"a": -1.0, "b": -2.0}, {"a": 3.0, "b": 4.0})
    assert (both.narrowest, both.margin, both.slope, both.holds) == ("b", 0.1, -2.0, True)
    assert both.of("a").slope == -1.0


@pytest.fixture(scope="module")
def drop():
    """Margins of the first impact of a mass that falls in its bearing, without damping."""
    law = cj.Hertz(STIFFNESS)
    scene = cj.Scene(
        {"mass": cj.Body(MASS, (1e-2, 1e-2, 1e-2))},
        {
            "pin": cj.ClearanceJoint(
                "ground",
                "mass",
                bearing_radius=10e-3,
                clearance=0.3e-3,
                journal_length=20e-3,
                law=law,
            )
        },
        gravity=(0.0, -GRAVITY, 0.0),
    )
    outputs = {"eccentricity": Eccentricity("pin"), "force": ContactForce("pin", "V")}
    state = cj.State({"mass": cj.body_state((0.0, 0.0, 0.0))})
    times = np.linspace(0.0, 0.02, 512)  # as many as a program is compiled for; the run goes on

    def look(place):
        at = cj.Parameter(lambda scene: scene.joints["pin"].clearance, cj.Log())
        varied = cj.put(scene, lambda scene: scene.joints["pin"].clearance, np.exp(place))
        run = cj.sensitivities(varied, state, 0.03, {"clearance": at}, outputs, times)
        return margins_of(run, place, LARGEST)

    return look


@pytest.mark.slow
def test_largest_clearance_of_a_drop_is_the_closed_form(drop):
    """At the lowest point m g (c + d) = 2 (2/5) K d^(5/2), and the force at a base is K d^(3/2)."""
    allowed = LARGEST["eccentricity"]
    depth = (1.25 * MASS * GRAVITY * allowed / STIFFNESS) ** 0.4
    eccentricity = allowed - depth
    depth = (LARGEST["force"] / STIFFNESS) ** (2.0 / 3.0)
    force = 0.8 * STIFFNESS * depth**2.5 / (MASS * GRAVITY) - depth
    for name, expected in (("eccentricity", eccentricity), ("force", force)):
        found = largest_within(
            lambda place, name=name: drop(place).of(name), *np.log((0.05e-3, 1e-3)), 1e-8
        )
        assert np.exp(found.place) == pytest.approx(expected, rel=1e-7)
        assert len(found.path) < 7
    both = largest_within(drop, *np.log((0.05e-3, 1e-3)), 1e-8)
    assert np.exp(both.place) == pytest.approx(min(eccentricity, force), rel=1e-7)
