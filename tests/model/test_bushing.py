"""The bushing: rotation vectors, balance of forces and energies, and closed forms."""

import math
from typing import Any

import numpy as np
import pytest

import clearjoint as cj
from tests.support.shaft import ORIGIN, angle_about


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"stiffness": (1.0, -1.0, 1.0)}, "`stiffness` must be zero or positive"),
        ({"damping": 3.0}, "`damping` must be an array of shape"),
        ({"orientation_first": (1.0, 1.0, 0.0, 0.0)}, "`orientation_first` must be Euler"),
    ],
)
def test_invalid_bushings_are_refused(change, complaint):
    given: dict[str, Any] = {"stiffness": (1.0, 1.0, 1.0)}
    with pytest.raises(ValueError, match=complaint):
        cj.Bushing("a", "b", (0, 0, 0), (0, 0, 0), **(given | change))


@pytest.mark.slow
def test_each_axis_swings_as_a_damped_oscillator():
    """exp(-d t/2m) cos, along an axis and, by more than a right angle, about it; what the ledger
    says of the dissipated energy closes."""
    mass, inertia, stiffness, damping, torsion, drag = 2.0, 0.05, 800.0, 3.0, 5.0, 0.04
    liner = cj.Bushing(
        *("ground", "b", ORIGIN, ORIGIN),
        stiffness=(500.0, stiffness, 500.0),
        damping=(0.0, damping, 0.0),
        rotational_stiffness=(1.0, torsion, 2.0),
        rotational_damping=(0.0, drag, 0.0),
        orientation_first=(math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0),
        orientation_second=(math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0),
    )
    scene = cj.Scene({"b": cj.Body(mass, (inertia,) * 3)}, forces={"liner": liner})
    shift, turn = 0.01, 2.5
    start = cj.body_state((0.0, 0.0, shift), cj.rotation((0, 0, 1), turn))
    times = np.linspace(0.1, 1.5, 8)
    settings = cj.Settings(rtol=1e-11, atol=1e-13, ledger=True)
    solution = cj.simulate(scene, cj.State({"b": start}), 1.5, settings, save=cj.Saving(times))

    def swinging(start: float, mass: float, stiffness: float, damping: float) -> np.ndarray:
        decay = damping / (2 * mass)
        own = math.sqrt(stiffness / mass - decay**2)
        swing = np.cos(own * times) + decay / own * np.sin(own * times)
        return start * np.exp(-decay * times) * swing

    body = solution.states.bodies["b"]
    height = swinging(shift, mass, stiffness, damping)
    np.testing.assert_allclose(body.position[:, 2], height, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(
        angle_about(body), swinging(turn, inertia, torsion, drag), rtol=0.0, atol=1e-8
    )
    final = solution.final
    begun = 0.5 * (stiffness * shift**2 + torsion * turn**2)
    left = cj.observe(scene, solution).energies["mechanical"][-1]
    assert begun + float(final.work["supplied"]) == pytest.approx(left, rel=1e-8)
    assert float(final.work["supplied"]) < -0.5 * begun
