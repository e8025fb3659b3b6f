"""The stepping loop as a program: compiled once, and interrupted."""

import signal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._simulation.run.host_run import begin, recorders_of, segment, segment_compiled
from clearjoint._simulation.run.outputs import requested_by
from clearjoint._simulation.step.method import Scheme
from clearjoint.extend import Formulation
from tests.simulation import test_simulate
from tests.simulation.test_simulate import END, hung

pendulum = test_simulate.pendulum
plain = test_simulate.plain


@pytest.mark.slow
@pytest.mark.parametrize("saving", [None, jnp.linspace(0.0, END, 5)], ids=["plain", "saving"])
def test_the_stepping_loop_is_one_native_function(pendulum, saving):
    """Every while loop of the program but the outer ones that save is a call of native code."""
    scene, state = pendulum
    scheme = Scheme(Scheme.of(cj.Settings(atol=1e-9)).method, Formulation())
    times = [jnp.asarray(t) for t in (0.0, END, 1e-7)]
    recorders = recorders_of(requested_by(None, cj.Saving(saving)))
    step, records, _ = eqx.filter_jit(begin)(scheme, scene, state, *times, recorders)
    arguments = scheme, scene, recorders, step, records, saving, times[1], jnp.asarray(9), {}
    lowered = eqx.filter_jit(segment).lower(*arguments)
    compiled = lowered.compile()
    text = compiled.compiled.as_text()
    assert text.count("xla_cpu_small_call") >= 1
    assert "custom-call(" not in text.replace("xla_cpu_small_call", "")
    outer_loops = 0 if saving is None else 1
    in_entry = text[text.index("\nENTRY") :]
    assert in_entry.count(" while(") <= outer_loops


def test_changing_numbers_compiles_nothing(pendulum, plain):
    """Clearance, law, geometry, masses, tolerances and times are arguments of one program."""
    scene, state = pendulum
    cj.simulate(scene, state, 0.3)
    compiled = segment_compiled.programs()
    other, _ = hung(clearance=3e-4, restitution=0.7, journal_length=0.03)
    other = eqx.tree_at(lambda s: s.bodies["arm 2"].mass, other, np.asarray(6.0))
    settings = cj.Settings(rtol=1e-7, first_step=1e-6, landing_tolerance=1e-11)
    solution = cj.simulate(other, state, 0.4, settings)
    assert solution.result == cj.RESULTS.successful
    assert segment_compiled.programs() == compiled


def test_ctrl_c_in_the_last_segment_is_raised(pendulum, monkeypatch):
    """Otherwise a loop of runs of one segment could not be interrupted."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)

    def pressed(*arguments, in_parts=segment_compiled.in_parts):
        signal.raise_signal(signal.SIGINT)
        return in_parts(*arguments)

    monkeypatch.setattr(segment_compiled, "in_parts", pressed)
    try:
        with pytest.raises(cj.RunInterrupted, match="at t = 0.01 s") as stopped:
            cj.simulate(*pendulum, 0.01)
    finally:
        signal.signal(signal.SIGINT, before)
    assert stopped.value.solution.result == cj.RESULTS.successful
