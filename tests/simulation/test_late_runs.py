"""Derivatives of runs that start long after time zero, where times are rounded coarsely."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint.extend import UNIT_X, ZERO


class Push(cj.extend.AbstractForce):
    """A force along X on a body from a time on, s, growing by `slope` from there, N/s."""

    body: str = eqx.field(static=True)
    since: float
    slope: float

    def body_names(self):
        return (self.body,)

    def breakpoints(self):
        return self.since

    def wrenches(self, motions, t):
        load = jnp.where(t < self.since, 0.0, 1.0 + self.slope * (t - self.since))
        return {self.body: motions[self.body].wrench(UNIT_X * load, ZERO)}


@pytest.mark.parametrize(
    "start", [*(pytest.param(start, marks=pytest.mark.slow) for start in (-8.0, 0.0)), 2.0**20]
)
def test_forces_that_depend_on_time_use_the_time_of_the_scene(start):
    """m x'' = 1 + b s, s = t - t_s, so x = (s^2/2 + b s^3/6)/m, with sections where x = x_0."""
    mass, slope, after = 2.0, 3.0, 0.75
    push = Push("mass", start + 0.25, slope)
    scene = cj.Scene({"mass": cj.Body(mass, (1.0, 1.0, 1.0))}, forces={"push": push})
    x_of = cj.quantities.Position("mass", "x")
    reached = (0.5**2 / 2.0 + slope * 0.5**3 / 6.0) / mass
    section = cj.Section(lambda now: x_of(now) - reached, {"x": (x_of, "m")}, 2)
    result = cj.sensitivities(
        scene,
        cj.State({"mass": cj.body_state((0.0, 0.0, 0.0))}),
        start + 1.0,
        {"since": cj.Parameter(lambda s: s.forces["push"].since)},
        {"x": x_of, "reached": section},
        [start + 0.125, start + 1.0],
        start_time=start,
    )
    x = (after**2 / 2.0 + slope * after**3 / 6.0) / mass
    np.testing.assert_allclose(result.outputs["x"], [0.0, x], rtol=1e-8, atol=1e-12)
    to_since = -(after + slope * after**2 / 2.0) / mass
    np.testing.assert_allclose(result.derivatives["x"][:, 0], [0.0, to_since], rtol=1e-8)
    crossed = result.outputs["reached"].times - start
    assert crossed == pytest.approx([0.75], abs=0.01)  # roughly, in a step that long
