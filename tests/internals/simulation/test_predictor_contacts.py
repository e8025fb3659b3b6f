"""Reverse mode across impacts with bristles, between shoulders, and in a loop with two plays."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

import clearjoint as cj
from tests.internals.simulation.test_predictor import SETTINGS, difference_from_forward_mode
from tests.support.one_body import bearing, one_body


class Case(NamedTuple):
    """A motion with a number of onsets of contact, a body, and parameters."""

    scene: cj.Scene
    state: cj.State
    end: float
    impacts: int
    body: str
    parameters: dict[str, cj.Parameter]


def logarithm(path: Callable) -> cj.Parameter:
    return cj.Parameter(path, cj.Log())


def with_bristles() -> Case:
    """A four-bar whose pin flies, strikes and rubs with LuGre friction."""
    friction = cj.frictions.LuGre(0.2, 0.1, stribeck_speed=0.05, stiffness=1e4, damping=1.0)
    pin = "crank pin"
    scene, state = cj.mechanisms.four_bar({pin: 1e-4}, 0.7, speed=10.0, friction=friction)
    numbers = ("breakaway", "kinetic", "stribeck_speed", "stiffness", "damping")
    parameters = {
        name: logarithm(lambda s, name=name: getattr(s.joints[pin].friction, name))
        for name in numbers
    }
    parameters["clearance"] = logarithm(lambda s: s.joints[pin].clearance)
    parameters["speed"] = cj.Parameter.initial(lambda s: s.bodies["rocker"].spin[2])
    return Case(scene, state, 0.02, 10, "rocker", parameters)


def between_shoulders() -> Case:
    """A rotor that strikes the wall of its bearing and thrust faces with friction at both ends."""
    law = cj.laws.LankaraniNikravesh(restitution=0.6, stiffness=1e9)
    face = cj.EndPlay(2e-4, law, cj.frictions.RegularisedCoulomb(0.15, 1e-2), 12e-3)
    friction = cj.frictions.RegularisedCoulomb(0.1, 1e-2)
    pin = bearing(law, "rotor", clearance=1e-4, friction=friction, axial=face)
    parameters = {
        "play": logarithm(lambda s: s.joints["pin"].axial.play),
        "radius": logarithm(lambda s: s.joints["pin"].axial.radius),
        "friction": logarithm(lambda s: s.joints["pin"].axial.friction.coefficient),
        "restitution": cj.Parameter(lambda s: s.joints["pin"].axial.law.restitution),
        "mass": logarithm(lambda s: s.bodies["rotor"].mass),
        "speed": cj.Parameter.initial(lambda s: s.bodies["rotor"].velocity[2]),
    }
    thrown = {"velocity": (0.02, 0.0, 0.1), "spin": (0.0, 0.0, 20.0)}
    body = {"inertia": (1e-3,) * 3, "gravity": (0.0, -9.81, 1.0)}
    return Case(*one_body("rotor", {"pin": pin}, **body, **thrown), 0.03, 11, "rotor", parameters)


def with_two_plays(end: float, impacts: int) -> Case:
    """A four-bar with play and friction at two pins."""
    clearance = {"crank pin": 1e-4, "rocker foot": 2e-4}
    friction = cj.frictions.RegularisedCoulomb(0.1, 1e-2)
    scene, state = cj.mechanisms.four_bar(clearance, 0.7, speed=30.0, friction=friction)
    parameters = {
        "clearance": logarithm(lambda s: s.joints["crank pin"].clearance),
        "other clearance": logarithm(lambda s: s.joints["rocker foot"].clearance),
        "friction": logarithm(lambda s: s.joints["rocker foot"].friction.coefficient),
        "restitution": cj.Parameter(lambda s: s.joints["crank pin"].law.restitution),
        "mass": logarithm(lambda s: s.bodies["coupler"].mass),
        "speed": cj.Parameter.initial(lambda s: s.bodies["rocker"].spin[2]),
    }
    return Case(scene, state, end, impacts, "rocker", parameters)


CASES = {
    "LuGre": with_bristles,
    "end play": between_shoulders,
    # Of the next impacts, forward mode itself has errors above 1e-6 at this tolerance.
    "two plays": lambda: with_two_plays(0.025, 20),
}


def onsets(case: Case) -> int:
    """Return the number of times at which a contact begins."""
    saved = cj.Saving(impacts=True)
    run = cj.simulate(case.scene, case.state, case.end, SETTINGS, saved, progress=False)
    assert run.impacts is not None
    return len(np.unique(run.impacts.onset))


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_gradients_across_impacts_are_those_of_forward_mode(name):
    case = CASES[name]()
    scene, state, end, impacts, *chosen = case
    assert onsets(case) == impacts
    assert difference_from_forward_mode(scene, state, end, *chosen) < 1e-6
