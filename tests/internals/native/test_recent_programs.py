"""Keys of native programs, how many are kept, and their memory."""

import errno
import gc
import pickle
import signal
import threading
import time
import weakref

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from clearjoint._compilation import program_store
from clearjoint._compilation.xla import HostFirst
from clearjoint._native import Native, NativeFunction, machine_code
from clearjoint._native.functions import FlatArguments


def scaled(x, factor):
    return x * factor


def test_weak_types_have_programs_of_their_own():
    """A product of a weak int64 and an int32 is an int32."""
    function, short = NativeFunction(scaled), np.asarray(3, np.int32)
    for number in (2, 2147483647):
        for one in (jnp.asarray(number), jnp.asarray(number, dtype=int), np.asarray(number)):
            found, expected = function(one, short), jax.jit(scaled)(one, short)
            assert (found.dtype, found) == (expected.dtype, expected)


@pytest.mark.parametrize("numbers", [(1, 1.0, True), (0.0, -0.0), (np.nan, 1.0)])
def test_numbers_that_are_equal_but_not_alike_have_keys_of_their_own(numbers):
    keys = [FlatArguments.of((number,)).key for number in numbers]
    assert len(set(keys)) == len(numbers)
    assert keys == [FlatArguments.of((float(n) if n != n else n,)).key for n in numbers]


def test_the_programs_used_least_recently_are_removed_and_made_again(monkeypatch):
    monkeypatch.setattr(machine_code, "MOST_PROGRAMS", 3)
    function, made = Native(lambda x: x.sum()), []
    function.native._compiled = lambda flat, make=function.native._compiled: (  # pyright: ignore
        made.append(flat.arrays[0].size),
        make(flat),
    )[1]
    for size in (1, 2, 3, 1, 4, 1, 2):
        assert function(np.ones(size)) == size
    assert made == [1, 2, 3, 4, 2]
    assert len(function.native._programs) == 3


def test_code_that_runs_is_not_freed(monkeypatch):
    """Of a program that is removed meanwhile; its memory is freed afterwards."""
    monkeypatch.setattr(machine_code, "MOST_PROGRAMS", 1)

    def turned(x):
        return lax.while_loop(lambda c: c[0] < 20_000_000, lambda c: (c[0] + 1, c[1] * x), (0, x))

    function, ends = NativeFunction(turned), []
    function(np.ones(1)[0])
    (program, _), *_ = function._programs.values()
    engine = weakref.ref(program.code._loaded[0])
    del program
    thread = threading.Thread(target=lambda: ends.append(function(np.ones(1)[0])))
    thread.start()
    time.sleep(0.01)
    function(np.float32(1.0).astype(int))
    gc.collect()
    thread.join()
    assert ends == [(20_000_000, 1.0)]
    gc.collect()
    assert engine() is None and len(function._programs) == 1


class LimitReachedError(Exception):
    """What a handler of signals raises."""


def interrupted(*_):
    raise LimitReachedError


def raise_in(function, *arguments):
    """Call a function that sends a signal, whose handler raises an error."""
    before = signal.signal(signal.SIGUSR1, interrupted)
    try:
        return function(*arguments)
    finally:
        signal.signal(signal.SIGUSR1, before)


def send(*_):
    signal.raise_signal(signal.SIGUSR1)


class Sends:
    """A value during whose pickling, reading and description the signal comes."""

    def __reduce__(self):
        send()
        return Sends, ()

    def __call__(self, x):
        send()
        return x


def reading_sends():
    send()


class SendsWhenRead:
    def __reduce__(self):
        return reading_sends, ()


def test_errors_of_handlers_of_signals_end_the_program(monkeypatch, tmp_path):
    with pytest.raises(LimitReachedError):
        raise_in(HostFirst(lambda x: (send(), x)[1]), 1.0)
    store = program_store.ProgramStore(tmp_path / "programs")
    place = store, "ab"
    with monkeypatch.context() as patched:
        patched.setattr(machine_code, "_place", lambda *_: place)
        patched.setattr(machine_code, "_is_unchanged", lambda: True)
        with pytest.raises(LimitReachedError):
            raise_in(machine_code.load_or_make, scaled, (), Sends)
        store.write("ab", pickle.dumps(SendsWhenRead()))
        with pytest.raises(LimitReachedError):
            raise_in(machine_code.load, scaled, ())
    monkeypatch.setattr(machine_code, "_store", lambda: store)
    monkeypatch.setattr(machine_code, "keeps_programs", lambda: True)
    monkeypatch.setattr(machine_code, "_key", send)
    with pytest.raises(LimitReachedError):
        raise_in(machine_code.load, scaled, ())


def test_time_limits_are_no_errors_of_the_file_system():
    with program_store.system_errors_suppressed():
        raise FileNotFoundError(errno.ENOENT, "no such file")
    with pytest.raises(TimeoutError), program_store.system_errors_suppressed():
        raise TimeoutError("the limit")
