"""Runs that JAX traces end at once, with the result `domain`, where others raise an error."""

from dataclasses import replace

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint import extend
from tests.support.dropped_rod import dropped_rod

END = 2e-3
GOOD = {
    "clearance": 5e-4,
    "bearing_radius": 10e-3,
    "journal_length": 20e-3,
    "restitution": 0.9,
    "mass": 1.0,
    "height": 0.0,
    "end_time": END,
    "save_time": 1e-3,
    "rtol": 1e-6,
}
BAD = [
    ("clearance", np.nan),
    ("clearance", np.inf),
    ("clearance", 0.02),
    ("bearing_radius", np.nan),
    ("journal_length", -1.0),
    ("restitution", -1.0),
    ("mass", np.inf),
    ("height", np.nan),
    ("end_time", np.nan),
    ("save_time", 1.0),
    ("rtol", -1e-6),
]
CODES = extend.result_numbers()
LANES = {name: jnp.asarray([GOOD[name]] * (len(BAD) + 1)) for name in GOOD}
for lane, (bad, value) in enumerate(BAD, start=1):
    LANES[bad] = LANES[bad].at[lane].set(value)


def changed(numbers):
    """Scene and state with the numbers."""
    scene, state = dropped_rod()
    for name in ("clearance", "bearing_radius", "journal_length"):
        scene = cj.set_value(scene, lambda s, n=name: getattr(s.joints["pin"], n), numbers[name])
    scene = cj.set_value(scene, lambda s: s.joints["pin"].law.restitution, numbers["restitution"])
    scene = cj.set_value(scene, lambda s: s.bodies["rod"].mass, numbers["mass"])
    position = jnp.stack([jnp.asarray(0.5), numbers["height"], jnp.asarray(0.0)])
    return scene, cj.set_value(state, lambda s: s.bodies["rod"].position, position)


def run(numbers) -> cj.results.Solution:
    few_stages = diffrax.Bosh3()  # compiles in half the time
    settings = replace(cj.presets.default, rtol=numbers["rtol"], solver=few_stages)
    save = cj.Saving(numbers["save_time"][None])
    return cj.simulate(*changed(numbers), numbers["end_time"], settings, save, progress=False)


@pytest.mark.slow
def test_lanes_with_bad_numbers_take_no_step():
    found = jax.jit(jax.vmap(run))(LANES)
    codes = extend.result_number(found.result)
    assert codes.tolist() == [CODES["successful"]] + [CODES["domain"]] * len(BAD)
    assert found.time[0] == END and not found.time[1:].any() and not found.attempts[1:].any()
    heights = found.final.bodies["rod"].position[:, 1]
    assert np.array_equal(heights[1:], LANES["height"][1:], equal_nan=True)
    assert np.isclose(heights[0], 0.5 * 9.81 * END**2)  # free fall


@pytest.mark.parametrize(("name", "value"), BAD)
def test_the_same_numbers_raise_outside_of_jax(name, value):
    numbers = {key: np.asarray(number) for key, number in GOOD.items()} | {name: np.asarray(value)}
    with pytest.raises(ValueError, match=r"must be"):
        run(numbers)


@pytest.mark.slow
def test_rigid_contacts():
    def rigid(clearance, step):
        scene, state = dropped_rod()
        scene = cj.set_value(scene, lambda s: s.joints["pin"].clearance, clearance)
        return cj.simulate_nonsmooth(scene, state, END, step=step)

    clearances, steps = jnp.asarray([5e-4, np.nan, 5e-4]), jnp.asarray([1e-3, 1e-3, -1.0])
    found = jax.jit(jax.vmap(rigid))(clearances, steps)
    codes = extend.result_number(found.result)
    assert codes.tolist() == [CODES["successful"], CODES["domain"], CODES["domain"]]
    assert found.steps.tolist() == [2, 0, 0]
    single, lanes = (run.final.bodies["rod"].position for run in (rigid(5e-4, 1e-3), found))
    np.testing.assert_allclose(lanes[0], single, rtol=0.0, atol=1e-12)
