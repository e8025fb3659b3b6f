"""Bristles at the first contact, and the energy stored in them at the start."""

import diffrax
import jax.numpy as jnp
import pytest

import clearjoint as cj
from clearjoint._dynamics.bristles import updated_bristles
from clearjoint._dynamics.contact_events import ContactGap
from clearjoint._simulation.step.step_state import Variables
from clearjoint._simulation.step.stepping import _initial_ledger
from clearjoint._simulation.step.trial_step import rates_of
from clearjoint.extend import Formulation, System, Vector, unpack
from tests.simulation.test_bristles import BELT_SPEED, LUGRE
from tests.support.sliding_block import WEIGHT, block


def test_a_ledger_without_integrals_starts_at_the_energy_stored_in_the_bristles():
    """Springs of the stiffness times the normal force, with half their work stored."""
    scene, state = block(cj.frictions.Dahl(0.3, 1e4))
    system = System(unpack(scene), Formulation(ledger=True))
    bristles = {"floor": {"belt": Vector(3e-6, -4e-6, 0.0)}}
    motion = system.encode(unpack(state.bodies))
    time = jnp.zeros(())
    term, args = diffrax.ODETerm(lambda t, y, args: rates_of(args[0], y, args[1], t)), (system, {})
    work = _initial_ledger(term, args, time, Variables(motion, {}, bristles), False)
    assert float(work["friction"]) == pytest.approx(0.5 * WEIGHT * 1e4 * 5e-6**2, rel=1e-9)
    given = Variables(motion, {"friction": 0.7}, bristles)
    assert float(_initial_ledger(term, args, time, given, False)["friction"]) == 0.7


def test_bristles_are_relaxed_at_exactly_zero_penetration():
    scene, state = block(LUGRE, BELT_SPEED)
    system = System(unpack(scene), Formulation(cj.AbsoluteCoordinates()))
    motions = system.motions(system.encode(unpack(state.bodies)))
    for depth, left in ((0.0, 0.0), (1e-9, 1e-6)):
        gaps = {"floor": {"belt": ContactGap(depth, 0.0)}}
        bristles = {"floor": {"belt": Vector(1e-6, 0.0, 0.0)}}
        updated = updated_bristles(system.scene, bristles, motions, gaps, gaps, False)
        assert float(updated["floor"]["belt"].x) == left
