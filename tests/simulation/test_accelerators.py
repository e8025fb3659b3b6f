"""Runs, sweeps and derivatives on an accelerator, compared with native code on the CPU."""

import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from studies.common.fresh_process import in_process

SPAN = 0.02
"""Simulated time, s: two impacts of the double pendulum."""
CODE = """
import clearjoint as cj
cj.configure()
from tests.simulation.test_accelerators import results
import json
print(json.dumps(results()))
"""


def results():
    """The results of each way to compute, as lists of numbers by name."""
    scene, state = cj.mechanisms.double_pendulum(0.5e-3, 0.9)
    clearances = np.linspace(3e-4, 6e-4, 8)

    def path(s):
        return s.joints["shoulder"].clearance

    def height(clearance):
        solution = cj.simulate(eqx.tree_at(path, scene, clearance), state, SPAN)
        return solution.final.bodies["arm 2"].position[1]

    run = cj.simulate(scene, state, SPAN, save=cj.Saving(impacts=True), progress=False)
    axes = {"clearance": cj.Axis(path, clearances)}
    peak = {"peak": cj.Peak(cj.quantities.ContactForce("shoulder"), "N")}
    parameters = {"clearance": cj.Parameter(path, cj.Log())}
    quantity = {"y": cj.quantities.Position("arm 2", "y")}
    slopes = cj.sensitivities(scene, state, SPAN, parameters, quantity, [SPAN], progress=False)
    found = {
        "run": run.final.bodies["arm 2"].position,
        "onsets": run.impacts.onset,
        "sweep": cj.sweep(scene, state, SPAN, axes, peak, progress=False)["peak"],
        "derivative": slopes.derivatives["y"],
        "vmap": jax.jit(jax.vmap(height))(jnp.asarray(clearances)),
        "jacfwd": jax.jit(jax.jacfwd(height))(jnp.asarray(5e-4)),
    }
    return {name: np.asarray(values).tolist() for name, values in found.items()}


@pytest.mark.slow
def test_an_accelerator_agrees_with_native_code():
    if jax.default_backend() == "cpu":
        pytest.skip("no accelerator")
    here = results()
    expected = in_process(CODE, JAX_PLATFORMS="cpu", PYTHONPATH=":".join(sys.path))[1]
    for name, values in expected.items():
        np.testing.assert_allclose(here[name], values, rtol=1e-7, err_msg=name)
