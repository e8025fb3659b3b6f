"""Runs of many steps: norm of Euler parameters, angles, memory, and the study of their drift."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint import BodyState
from clearjoint._math.rotations import kept_unit
from clearjoint._simulation.run.host_run import _first_rows
from clearjoint._simulation.step.method import Scheme
from clearjoint._simulation.step.step_state import Variables
from clearjoint._simulation.step.stepping import attempt, start
from clearjoint.extend import EulerParameters, pack, rotation_matrix, unpack, within_two_turns
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
        pack(rotation_matrix(after)), pack(rotation_matrix(before)), atol=1e-15
    )


@pytest.mark.parametrize("norm", [1.0, 1.0 + 4e-7, 1.0 - 4e-7])
def test_euler_parameters_of_unit_norm_keep_every_bit(norm):
    before = parameters(norm)
    assert (np.array(pack(kept_unit(before))) == np.array(pack(before))).all()


def test_angles_lose_double_turns_and_nothing_else():
    inside = np.linspace(-6.28, 6.28, 101)
    assert (within_two_turns(inside) == inside).all()
    for turns in (2, -4, 1000):
        angle = 0.75 + 2.0 * np.pi * turns
        assert float(within_two_turns(angle)) == pytest.approx(0.75, abs=1e-12)


def test_rates_kept_for_the_next_step_match_the_settled_state():
    scene, state = long_runs.top()
    body = state.bodies["rod"]
    off = BodyState(body.position, 1.01 * np.asarray(body.orientation), body.velocity, body.spin)
    scheme = Scheme.of(cj.Settings())
    method, system = scheme.method, scheme.system(unpack(scene))
    motion = system.encode(unpack({"rod": off}))
    t0, t_end, length = (jnp.asarray(number) for number in (0.0, 1.0, 1e-6))
    first = start(method, system, t0, t_end, length, Variables(motion, {}), {})
    step = jax.jit(lambda step: attempt(method, system, step, t_end).step)(first)
    assert int(step.accepted) == 1
    assert np.linalg.norm(pack(step.y.motion["rod"].orientation)) == pytest.approx(1.0, abs=1e-4)
    rates, _ = system.rates(step.y.motion, {}, step.t)
    np.testing.assert_allclose(
        pack(step.solver_state.motion["rod"].orientation),
        pack(rates["rod"].orientation),
        rtol=1e-12,
    )


def test_a_top_that_tumbles_for_long_keeps_its_norm():
    """Without the correction the norm would be 3.6 at the end."""
    outcome = long_runs.run(long_runs.Case("top", long_runs.top, 1e-3), 1e4, 1_000_000)
    assert outcome.time == 1e4
    assert outcome.norm < 1e-2


def spinning_pendulum():
    scene, _ = long_runs.pendulum()
    body = cj.body_state((0.5, 0.0, 0.0), velocity=(0.0, 50.0, 0.0), spin=(0.0, 0.0, 100.0))
    return scene, cj.State({"rod": body})


def test_a_thousand_turns_of_a_pendulum_are_as_good_as_the_first():
    """With a tolerance relative to all revolutions the energy error would be three times larger."""
    case = long_runs.Case("spinning", spinning_pendulum, 1e-6)
    outcome = long_runs.run(case, 1000.0, 1_000_000)
    assert outcome.time == 1000.0
    assert outcome.residuals is not None and outcome.residuals.max() < 1e-14
    early, late = (np.abs(outcome.energy[at]) for at in (144, 1440))
    assert late < 0.45 and late == pytest.approx(10.0 * early, rel=0.1)


def test_saved_states_keep_no_rows_that_were_not_reached():
    rows = _first_rows({"x": np.zeros(512)}, 3)["x"]
    assert rows.nbytes == 24 and rows.base is None


def test_quick_runs_do_not_drift(tmp_path):
    cases, span = long_runs.QUICK
    ideal, top = (long_runs.run(case, span, long_runs.MAX_STEPS) for case in cases)
    assert ideal.time == top.time == span
    assert ideal.residuals is not None and ideal.residuals.max() < 1e-14
    assert top.norm < 1e-3 and abs(ideal.mechanical[-1]) < 1e-2
    long_runs.figure([ideal, top]).savefig(tmp_path / "figure.png")
    head, *rows = long_runs.table([ideal, top])
    assert [len(row) for row in rows] == [len(head)] * 2


@pytest.mark.slow
def test_a_late_start_changes_little():
    (found,) = long_runs.late_starts((1e-6,))
    assert found.position < 1e-9 and found.entry_speed < 1e-6 and found.onset < 1e-9
