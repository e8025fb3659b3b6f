"""The stepping loop as a program, and interrupted."""

import signal

import equinox as eqx
import jax.numpy as jnp
import pytest

import clearjoint as cj
from clearjoint._simulation.run.host_run import begin, recorders_of, segment, segment_compiled
from clearjoint._simulation.run.outputs import requested_by
from clearjoint._simulation.step.method import Scheme
from clearjoint.extend import Formulation
from tests.simulation import test_simulate
from tests.simulation.test_simulate import END

rod = test_simulate.rod


@pytest.mark.slow
@pytest.mark.parametrize("saving", [None, jnp.linspace(0.0, END, 5)], ids=["plain", "saving"])
def test_the_stepping_loop_is_one_native_function(rod, saving):
    """Every while loop of the program but the outer ones that save is a call of native code."""
    scene, state = rod
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


def test_ctrl_c_in_the_last_segment_is_raised(rod, monkeypatch):
    """Otherwise a loop of runs of one segment could not be interrupted."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)

    def pressed(*arguments, in_parts=segment_compiled.in_parts):
        signal.raise_signal(signal.SIGINT)
        return in_parts(*arguments)

    monkeypatch.setattr(segment_compiled, "in_parts", pressed)
    try:
        with pytest.raises(cj.RunInterrupted, match="at t = 0.01 s") as stopped:
            cj.simulate(*rod, 0.01)
    finally:
        signal.signal(signal.SIGINT, before)
    assert stopped.value.solution.result == cj.RESULTS.successful
