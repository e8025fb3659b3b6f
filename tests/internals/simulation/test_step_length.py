"""Lengths of steps after events, the sizes that errors of derivatives are compared with, and result
codes and errors of trial steps."""

from types import SimpleNamespace

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._dynamics.contact_events import ContactGap
from clearjoint._simulation.step import acceptance
from clearjoint._simulation.step.step_length import (
    length_after_breakpoints,
    lengths_after_contacts,
    tangent_sizes,
)
from clearjoint._simulation.step.step_state import Variables
from clearjoint._simulation.step.trial_step import REJECTED_ERROR
from clearjoint.extend import Formulation, System, unpack
from tests.support.one_body import one_body

FULL, ENTRY = 1e-3, 3e-5
OPEN = {"pin": {"V": ContactGap(jnp.asarray(-1e-4), jnp.asarray(0.1))}}
CLOSED = {"pin": {"V": ContactGap(jnp.asarray(1e-12), jnp.asarray(0.1))}}


def before(begins=False):
    """The state before a step of the length `FULL` that an event may cut short."""
    proposal = SimpleNamespace(full_length=FULL, begins_contact=begins, entry_length=ENTRY)
    return SimpleNamespace(t=2.0, proposal=proposal, contact_gaps=OPEN)


@pytest.mark.parametrize(
    ("tried", "proposed", "kept", "full"),
    [
        # An event cut the step short: the small error of the short step is no measure.
        (1e-4, 2e-4, True, FULL),
        (1e-4, 3e-3, True, 3e-3),
        # The step was not cut short, or only by rounding: the controller decides.
        (FULL, 2e-4, True, 2e-4),
        (0.995 * FULL, 2e-4, True, 2e-4),
        # The error of the short step was too large.
        (1e-4, 2e-5, False, 2e-5),
    ],
)
def test_a_step_after_one_that_was_cut_short_has_at_least_its_full_length(
    tried, proposed, kept, full
):
    step, keep, no = before(), jnp.asarray(kept), jnp.asarray(False)
    length = length_after_breakpoints(step, 2.0 + tried, keep, proposed)
    assert float(length) == pytest.approx(full, rel=1e-12)
    lengths = lengths_after_contacts(step, OPEN, 2.0 + tried, keep, no, proposed)
    assert [float(number) for number in lengths] == pytest.approx([full, 0.0, ENTRY], rel=1e-12)


def test_a_contact_begins_with_twice_the_length_of_the_last_one_at_most():
    yes, no = jnp.asarray(True), jnp.asarray(False)

    def lengths(step, after, tried, keep, lands):
        found = lengths_after_contacts(step, after, 2.0 + tried, keep, lands, 4e-4)
        return [float(number) for number in found]

    assert lengths(before(), CLOSED, 1e-4, yes, no) == pytest.approx([2.0 * ENTRY, 1.0, ENTRY])
    # The first step of the contact, cut short or not, and its rejected trial.
    assert lengths(before(True), OPEN, FULL, yes, no) == pytest.approx([4e-4, 0.0, FULL])
    assert lengths(before(True), OPEN, 1e-5, yes, no) == pytest.approx([FULL, 0.0, ENTRY])
    assert lengths(before(True), CLOSED, FULL, no, yes) == pytest.approx([FULL, 1.0, ENTRY])


@pytest.mark.parametrize(("scale", "largest"), [(1.0, 8.0), (0.1, 1.0)])
def test_derivatives_of_speeds_count_at_least_as_a_share_of_the_speeds(scale, largest):
    """A fifth of the speeds times the largest derivative of a position over the largest position,
    here a length or an Euler parameter; the derivatives alone where all positions are zero."""
    scene, _ = one_body("ball")
    system = System(unpack(scene), Formulation(cj.AbsoluteCoordinates()))

    def variables(position, velocity):
        _, state = one_body("ball", position=position, velocity=velocity)
        return Variables(system.encode(unpack(state.bodies)), {})

    sizes = variables((4.0 * scale, -8.0 * scale, 0.0), (3.0, 0.0, -5.0))
    along = variables((0.0, 0.0, 2.0), (0.0, -0.5, 0.25))
    motion = tangent_sizes(system, sizes, along).motion["ball"]
    share = 0.2 * 2.0 / largest
    assert [*motion.velocity] == pytest.approx([3.0 * share, 0.5, 0.25 + 5.0 * share], rel=1e-12)
    assert [*motion.position] == [0.0, 0.0, 2.0]
    none = jax.tree.map(jnp.zeros_like, sizes)
    motion = tangent_sizes(system, none, along).motion["ball"]
    assert [*motion.velocity] == pytest.approx([0.0, 0.5, 0.25], rel=1e-12)


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
    start = {"system": system, "step": step, "gaps": {}}
    ended = {"t1": now, "finite": jnp.asarray(True), "outcome": outcome, "solver_result": success}
    trial = SimpleNamespace(**start, **ended)
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
