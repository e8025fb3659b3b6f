"""What bars say while programs are compiled. Tracing that sleeps stands for long compiling."""

import threading
import time

import jax.numpy as jnp
import pytest
from tqdm.std import TqdmDefaultWriteLock

import clearjoint as cj
from clearjoint._compilation.xla import (
    Compiled,
    begins_a_program,
    program_is_made_inside,
    seconds_of_compiling,
)
from clearjoint._simulation.lanes.scheduler import Running
from clearjoint._simulation.run import host_run, sampling, terminal
from clearjoint._simulation.run.terminal import compiling_bar
from clearjoint._sweeps.computing import lane_progress, show_running
from tests.support.oscillator import on_spring

LONG, TICK = 0.5, 0.02


@pytest.fixture(autouse=True)
def short_ticks(monkeypatch):
    """In a terminal; and no thread is left behind for more than a tick, whatever happens."""
    monkeypatch.setattr(terminal, "TICK", TICK)
    monkeypatch.setattr(terminal, "is_live", lambda stream: True)
    yield
    for thread in watches():
        thread.join(500 * TICK)  # on a busy machine a tick may take a second
    assert watches() == []


def watches():
    """The threads beside bars; tqdm has one of its own, which stays."""
    return [thread for thread in threading.enumerate() if thread.name == terminal.WATCH]


def slow(seconds=LONG, then=None):
    """A function that takes long to trace, and then may fail."""

    def traced(x):
        time.sleep(seconds)
        if then is not None:
            raise then
        return x + 1.0

    return Compiled(traced)


def test_a_bar_says_for_how_long_it_compiles_and_then_what_it_did(capsys):
    with lane_progress(4, 0, True) as bar:
        assert len(watches()) == 1
        slow()(jnp.zeros(()))
        assert "compiling, 0 s" in capsys.readouterr().err
        deadline = time.monotonic() + 500 * TICK  # on a busy machine a tick may take a second
        while bar.desc != "stored" and time.monotonic() < deadline:
            time.sleep(TICK)
        assert bar.desc == "stored"
    last = capsys.readouterr().err.split("\r")
    assert "stored" in "".join(last) and last[-1].strip() == ""


def test_seconds_are_counted_from_the_start_of_tracing():
    seen = []

    def traced(x):
        inner = Compiled(lambda y: 2.0 * y)
        time.sleep(TICK)
        x = inner(x)
        seen.append(seconds_of_compiling())
        return x

    assert seconds_of_compiling() == 0.0
    Compiled(traced)(jnp.ones(()))
    assert TICK <= seen[0] < 60.0
    assert seconds_of_compiling() == 0.0


def test_a_program_traced_outside_the_context_is_not_counted():
    """Nothing would end the time: a batch of gradients left it running for the whole process."""
    assert begins_a_program(lambda x: x + 1.0)(1.0) == 2.0
    assert seconds_of_compiling() == 0.0


def test_the_time_ends_with_the_innermost_context_that_compiles():
    with program_is_made_inside():
        with program_is_made_inside():
            begins_a_program(lambda x: x)(1.0)
            time.sleep(TICK)
            assert seconds_of_compiling() >= TICK
        assert seconds_of_compiling() == 0.0


def test_a_compiled_program_is_not_said_to_compile(capsys):
    program = slow()
    program(jnp.zeros(()))
    with compiling_bar(True):
        program(jnp.ones(()))
        time.sleep(10 * TICK)
    assert capsys.readouterr().err == ""


def test_nothing_is_shown_and_no_thread_begins_where_progress_is_off(capsys):
    with lane_progress(4, 0, False):
        slow()(jnp.zeros(()))
        assert watches() == []
    with compiling_bar(False):
        slow()(jnp.zeros(()))
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("error", [ValueError("wrong"), KeyboardInterrupt()])
def test_an_error_inside_ends_the_counting(error, capsys):
    with pytest.raises(type(error)), compiling_bar(True):
        slow(then=error)(jnp.zeros(()))
    assert seconds_of_compiling() == 0.0
    said = capsys.readouterr().err
    assert "compiling, 0 s" in said and said.split("\r")[-1].strip() == ""
    time.sleep(5 * TICK)
    assert capsys.readouterr().err == ""


def test_one_thread_updates_all_bars(capsys):
    with compiling_bar(True):
        with lane_progress(4, 0, True) as inner:
            assert len(watches()) == 1
            slow()(jnp.zeros(()))
            time.sleep(3 * TICK)
            assert inner.desc == "stored"
        capsys.readouterr()
        slow()(jnp.zeros(()))
        assert "compiling, 0 s" in capsys.readouterr().err
    [thread] = watches()
    with compiling_bar(True):
        assert watches() == [thread]


def slowly(function):
    """The function, which takes so long that another thread gets its turn."""

    def call(*arguments):
        time.sleep(0.05)
        return function(*arguments)

    return call


@pytest.mark.parametrize("progress", [True, False])
def test_runs_show_it_unless_progress_is_off(progress, capsys, monkeypatch):
    monkeypatch.setattr(terminal, "TICK", 1e-4)
    monkeypatch.setattr(terminal, "seconds_of_compiling", lambda: 12.3)
    scene, state = on_spring("mass", 50.0, 2.0, 0.3, 0.5)
    segments = host_run.segment_compiled
    monkeypatch.setattr(segments, "in_parts", slowly(segments.in_parts))
    monkeypatch.setattr(sampling, "sampled_compiled", slowly(sampling.sampled_compiled))
    cj.simulate(scene, state, 0.3, progress=progress)
    assert ("compiling, 12 s:   0%" in capsys.readouterr().err) == progress
    parameters = {"k": cj.Parameter(lambda s: s.forces["spring"].stiffness, cj.Log())}
    outputs = {"x": cj.quantities.Position("mass", "x")}
    cj.sensitivities(scene, state, 0.3, parameters, outputs, [0.1], progress=progress)
    assert ("compiling, 12 s" in capsys.readouterr().err) == progress


def test_a_log_file_gets_a_line_now_and_then(capsys, monkeypatch):
    monkeypatch.undo()
    with lane_progress(100, 0, True) as bar:
        bar.start_t -= 10
        bar.update(20)
        bar.refresh()
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(terminal, "LINE_PERIOD", 0.0)
    running = Running(lanes=7, earliest=0.25, latest=1.0, seconds_left=90.0)
    with lane_progress(100, 40, True) as bar:
        bar.update(20)
        show_running(bar, running)
    said = capsys.readouterr().err
    assert "\r" not in said and said.endswith("\n")
    first, last = said.splitlines()[0], said.splitlines()[-1]
    assert first == "40 of 100 lanes are in the store; 60 are computed"
    assert last.startswith("stored:  60%") and "60/100 lanes [00:00, left 01:30" in last
    assert "7 running lanes have reached 0.25 s to 1 s" in last


def test_bars_make_no_semaphores():
    """Those of processes that are killed are left behind, which Python then warns of."""
    assert not isinstance(terminal.ProgressBar.get_lock(), TqdmDefaultWriteLock)
