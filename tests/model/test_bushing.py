"""The bushing: rotation vectors, balance of forces and energies, and closed forms."""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint.extend import Matrix, Vector, unpack
from clearjoint.testing import moving

EULER = (0.8, 0.1, -0.3, 0.5)
LINER = cj.Bushing(
    "a",
    "b",
    (0.1, 0.2, 0.3),
    (0.3, -0.1, 0.2),
    stiffness=(2e4, 3e4, 4e4),
    damping=(20.0, 30.0, 50.0),
    rotational_stiffness=(30.0, 50.0, 70.0),
    rotational_damping=(0.1, 0.2, 0.4),
    orientation_first=np.array(EULER) / np.linalg.norm(EULER),
    orientation_second=(0.6, 0.0, 0.8, 0.0),
)
MOTIONS = {
    "a": moving((0.1, 0.2, 0.3), (0.9, 0.1, -0.3, 0.2), (0.5, -0.4, 0.3), (1.0, 2.0, -0.5)),
    "b": moving((-0.3, 0.1, 0.5), (0.4, 0.5, 0.2, -0.6), (-0.2, 0.7, 0.1), (-0.8, 0.3, 1.1)),
}


def rows(rotation: Matrix) -> tuple[Vector, ...]:
    return rotation.row_x, rotation.row_y, rotation.row_z


def test_forces_balance_and_do_the_work_of_springs_and_dampers():
    """Equal and opposite in force and moment; stored energy rises by what is not dissipated."""
    liner = unpack(LINER)
    wrenches = liner.wrenches(MOTIONS, 0.0)
    force = wrenches["a"].force + wrenches["b"].force
    moment = Vector(0.0, 0.0, 0.0)
    for name, motion in MOTIONS.items():
        wrench = wrenches[name]
        moment = moment + motion.position.cross(wrench.force) + motion.direction(wrench.moment)
    scale = float(max(abs(part) for part in wrenches["b"].force))
    parts = [float(part) for part in (*force, *moment)]
    np.testing.assert_allclose(parts, 0.0, atol=1e-13 * scale)
    rates = {
        name: cj.extend.Motion(
            motion.velocity,
            Matrix(*(row.cross(motion.spin) for row in rows(motion.rotation))),
            motion.velocity * 0.0,
            motion.spin * 0.0,
        )
        for name, motion in MOTIONS.items()
    }
    motions, rates = (jax.tree.map(jnp.asarray, tree) for tree in (MOTIONS, rates))
    _, growth = jax.jvp(lambda motions: liner.stored_energy(motions, 0.0), (motions,), (rates,))
    supplied = liner.supplied_power(MOTIONS, 0.0)
    power = sum(motion.power(wrenches[name]) for name, motion in MOTIONS.items())
    assert supplied < 0.0
    assert float(power) == pytest.approx(float(supplied - growth), rel=1e-12)


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
        "ground",
        "b",
        (0.0, 0.0, 0.0),
        (0.0, 0.0, 0.0),
        stiffness=(500.0, stiffness, 500.0),
        damping=(0.0, damping, 0.0),
        rotational_stiffness=(1.0, torsion, 2.0),
        rotational_damping=(0.0, drag, 0.0),
        orientation_first=(math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0),
        orientation_second=(math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0),
    )
    scene = cj.Scene({"b": cj.Body(mass, (inertia,) * 3)}, forces={"liner": liner})
    shift, turn = 0.01, 2.5
    start = cj.body_state((0.0, 0.0, shift), (math.cos(0.5 * turn), 0.0, 0.0, math.sin(0.5 * turn)))
    times = np.linspace(0.1, 1.5, 8)
    settings = cj.Settings(rtol=1e-11, atol=1e-13, ledger=True)
    solution = cj.simulate(scene, cj.State({"b": start}), 1.5, settings, save=cj.Saving(times))

    def swinging(start: float, mass: float, stiffness: float, damping: float) -> np.ndarray:
        decay = damping / (2 * mass)
        own = math.sqrt(stiffness / mass - decay**2)
        return (
            start
            * np.exp(-decay * times)
            * (np.cos(own * times) + decay / own * np.sin(own * times))
        )

    body = solution.states.bodies["b"]
    angle = 2.0 * np.arctan2(body.orientation[:, 3], body.orientation[:, 0])
    height = swinging(shift, mass, stiffness, damping)
    np.testing.assert_allclose(body.position[:, 2], height, atol=1e-10)
    np.testing.assert_allclose(angle, swinging(turn, inertia, torsion, drag), atol=1e-8)
    final = solution.final
    begun = 0.5 * (stiffness * shift**2 + torsion * turn**2)
    left = cj.observe(scene, solution).energies["mechanical"][-1]
    assert begun + float(final.work["supplied"]) == pytest.approx(left, rel=1e-8)
    assert float(final.work["supplied"]) < -0.5 * begun
