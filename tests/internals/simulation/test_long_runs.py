"""Norms of Euler parameters in a step, and rows that are saved."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint import BodyState
from clearjoint._math.rotations import kept_unit
from clearjoint._simulation.run.host_run import _first_rows
from clearjoint._simulation.step.dense_output import stabilised
from clearjoint._simulation.step.method import Scheme
from clearjoint._simulation.step.step_state import Variables
from clearjoint._simulation.step.stepping import attempt, start
from clearjoint._simulation.step.trial_step import term_of
from clearjoint.extend import EulerParameters, Formulation, System, pack, rotation_matrix, unpack
from studies.cost import long_runs


def parameters(norm):
    return EulerParameters(*(norm * np.array([0.5, -0.1, 0.7, np.sqrt(0.25)])))


@pytest.mark.parametrize("norm", [0.3, 0.9, 0.999, 1.001, 1.1, 3.0])
def test_euler_parameters_off_their_norm_come_nearer_to_it_and_turn_nothing(norm):
    before = parameters(norm)
    after = kept_unit(before)
    off = 1.0 - float(np.linalg.norm(pack(after)))
    assert off == pytest.approx((norm - 1.0) ** 2 / (norm**2 + 1.0), rel=1e-6)
    np.testing.assert_allclose(
        pack(rotation_matrix(after)), pack(rotation_matrix(before)), rtol=0.0, atol=1e-15
    )


@pytest.mark.parametrize("norm", [1.0, 1.0 + 4e-7, 1.0 - 4e-7])
def test_euler_parameters_of_unit_norm_keep_every_bit(norm):
    before = parameters(norm)
    assert (np.array(pack(kept_unit(before))) == np.array(pack(before))).all()


def test_rates_kept_for_the_next_step_match_the_settled_state():
    scene, state = long_runs.top()
    body = state.bodies["rod"]
    off = BodyState(body.position, 1.01 * np.asarray(body.orientation), body.velocity, body.spin)
    scheme = Scheme.of(cj.Settings())
    method, system = scheme.method, scheme.system(unpack(scene))
    motion = system.encode(unpack({"rod": off}))
    t0, t_end, length = (jnp.asarray(number) for number in (0.0, 1.0, 1e-6))
    first = start(method, term_of(method), system, t0, t_end, length, Variables(motion, {}), {})
    step = jax.jit(lambda step: attempt(method, system, step, t_end).step)(first)
    assert int(step.accepted) == 1
    assert np.linalg.norm(pack(step.y.motion["rod"].orientation)) == pytest.approx(1.0, abs=1e-4)
    rates, _ = system.rates(step.y.motion, {}, step.t)
    np.testing.assert_allclose(
        pack(step.solver_state.motion["rod"].orientation),
        pack(rates["rod"].orientation),
        rtol=1e-12,
    )


def test_the_ledger_books_the_energy_that_a_projection_removes():
    """Half m v^2 of a body that a ball joint holds at its centre of mass; its rotation stays."""
    pivot = cj.SphericalJoint("ground", "rod", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    scene = cj.Scene({"rod": cj.Body(2.0, (1.0, 2.0, 3.0))}, {"pivot": pivot})
    formulation = Formulation(cj.AbsoluteCoordinates(), cj.Projection(), ledger=True)
    system = System(unpack(scene), formulation)
    state = cj.body_state((0.0, 0.0, 0.0), velocity=(0.3, 0.0, -0.4), spin=(0.0, 5.0, 7.0))
    motion = system.encode(unpack({"rod": state}))
    y = stabilised(system, Variables(motion, {"stabilisation": jnp.asarray(1.5)}), 0.0)
    assert float(y.work["stabilisation"]) == pytest.approx(1.5 + 0.25, rel=1e-12)
    np.testing.assert_allclose(pack(y.motion["rod"].velocity), 0.0, atol=1e-15)
    np.testing.assert_allclose(pack(y.motion["rod"].spin), (0.0, 5.0, 7.0), rtol=1e-12)


def test_saved_states_keep_no_rows_that_were_not_reached():
    rows = _first_rows({"x": np.zeros(512)}, 3)["x"]
    assert rows.nbytes == 24 and rows.base is None
