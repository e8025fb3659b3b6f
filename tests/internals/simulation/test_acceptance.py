"""Result codes and errors of trial steps."""

from types import SimpleNamespace

import diffrax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._simulation.step import acceptance
from clearjoint._simulation.step.trial_step import REJECTED_ERROR

ULP = np.spacing(1.0)


@pytest.mark.parametrize(
    ("ahead", "end", "expected"),
    [
        (ULP, 2.0, "step_too_small"),
        (2 * ULP, 2.0, "step_too_small"),
        (4 * ULP, 2.0, "successful"),
        (ULP, 1.0, "successful"),
    ],
)
def test_steps_must_advance_before_the_end(ahead, end, expected, monkeypatch):
    """A step ends at 1 s, and the next one `ahead` of that; at the end of the run it is not
    taken."""
    monkeypatch.setattr(acceptance, "one_sided_time", lambda system, start, t: t)
    now, success = jnp.asarray(1.0), diffrax.RESULTS.successful
    system = SimpleNamespace(constraints_violated=lambda motion, t: None)
    outcome = SimpleNamespace(y=SimpleNamespace(motion=None))
    step = SimpleNamespace(t=jnp.asarray(0.5), result=cj.RESULTS.successful)
    trial = SimpleNamespace(
        system=system,
        step=step,
        t1=now,
        finite=jnp.asarray(True),
        outcome=outcome,
        gaps={},
        solver_result=success,
    )
    decision = acceptance._Decision(jnp.asarray(True), now + ahead, False, None, success, {})
    found = acceptance._result(trial, decision, jnp.asarray(end))
    assert bool(found == getattr(cj.RESULTS, expected))


def test_a_wrapped_controller_has_the_tolerance_of_the_inner_one():
    inner = diffrax.PIDController(rtol=1e-9, atol=1e-12)
    wrapped = diffrax.ClipStepSizeController(inner, jump_ts=jnp.asarray([0.1]))
    for controller, expected in (
        (inner, 1e-9),
        (wrapped, 1e-9),
        (diffrax.ConstantStepSize(), acceptance.DEFAULT_RTOL),
    ):
        assert acceptance._relative_tolerance(controller) == expected


def test_rejected_errors_fit_into_single_precision():
    assert np.isfinite(np.float32(REJECTED_ERROR))
