"""Warning before a program that takes long to compile."""

import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

import clearjoint as cj
from clearjoint._dynamics.contact_events import initial_entry_speeds
from clearjoint._math.vectors import fold_constants
from clearjoint._model.contact import hunt_crossley
from clearjoint._model.contact.laws import WeightedLaw
from clearjoint._parametrisation.parameter import coordinates_of
from clearjoint._parametrisation.parametrised_scene import parametrised
from clearjoint._simulation.run.host_run import begin
from clearjoint._simulation.run.run_checks import derivative_scheme
from clearjoint._simulation.run.sampling import first_step_of
from clearjoint._simulation.step import stepping
from clearjoint._simulation.step.method import Scheme
from clearjoint._simulation.step.step_state import Variables
from clearjoint._simulation.step.stepping import MANY_OPERATIONS, shapes_of
from clearjoint._simulation.step.trial_step import rates_of
from studies.benchmark.chain import ideal_chain

SPAN = (0.0, 1.0, 1e-6)


def _begun(scene, state):
    """Trace the start of a run, before anything is compiled."""
    scheme, form = derivative_scheme(scene, state, cj.presets.derivatives), fold_constants(scene)
    starting = lambda form, state, *span: begin(scheme, form, state, *span, {})[0].t  # noqa: E731
    eqx.filter_eval_shape(starting, form, state, *SPAN)


def _begun_with_derivatives(scene, state):
    parameters = {"mass": cj.Parameter(lambda s: s.bodies["rod 1"].mass)}
    values = jnp.asarray(coordinates_of(scene, state, parameters))
    family = parametrised(scene, state, parameters, values)
    scheme = derivative_scheme(scene, state, cj.presets.derivatives)
    eqx.filter_eval_shape(
        lambda family, *span: first_step_of(scheme, family, *span).t, family, *SPAN
    )


def test_a_large_program_causes_a_warning_before_it_is_compiled(monkeypatch):
    """The limit is between chains of two and three rods, lower with derivatives."""
    monkeypatch.setattr(stepping, "MANY_OPERATIONS", 300)
    shorter, longer = ideal_chain(2), ideal_chain(3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        _begun(*shorter)
    with pytest.warns(UserWarning, match="compiling takes half a minute or more"):
        _begun_with_derivatives(*shorter)
    with pytest.warns(UserWarning, match=r"operations for each stage .* 8 GB"):
        _begun(*longer)


def test_shapes_are_those_of_the_function():
    def many():
        total = jnp.zeros(3)
        for _ in range(MANY_OPERATIONS + 1):
            total = jax.lax.neg(total)
        return total, {"a": 1.0}

    with pytest.warns(UserWarning, match="operations for each stage"):
        shapes = shapes_of(many, derivatives=False)
    assert shapes[0].shape == (3,) and shapes[1]["a"].shape == ()


def test_damping_factors_are_not_searched_for_in_steps(monkeypatch):
    """In each evaluation of a force, the search took four fifths of the time of a step."""
    searched, search = [], hunt_crossley.exact_damping_factor
    monkeypatch.setattr(
        hunt_crossley, "exact_damping_factor", lambda e: searched.append(e) or search(e)
    )
    law = WeightedLaw(cj.laws.ExactRestitution(0.7, 1.2345e9), 0.5)
    scene, state = cj.extend.unpack(cj.mechanisms.double_pendulum(law=law))
    system = Scheme.of(cj.presets.default).system(scene)
    assert len(searched) == 1
    searched.clear()
    y, speeds = Variables(system.encode(state.bodies), {}, {}, {}), state.entry_speeds
    gaps = system.contact_gaps(y.motion)
    rates_of(system, y, initial_entry_speeds(scene, gaps, speeds), jnp.asarray(0.0))
    assert searched == []
