"""Programs that are kept on disk: loaded by the next process, and only where they are the same."""

import os
import tempfile
import threading
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint.compilation import (
    Compiled,
    keep_programs,
    kept_programs,
    package_code,
    plain_values,
)
from clearjoint.compilation.program_store import ProgramStore


class Pair(eqx.Module):
    first: Any
    second: Any
    name: str = eqx.field(default="a", static=True)


def added(pair, factor=1.0, places=None):
    del places
    return Pair(pair.first + factor * pair.second, "kept", pair.name), pair.first.shape


def shifted(constants, row):
    return {"row": row + constants[0]}


def ranked(row):
    return jnp.sin(jnp.sort(row)[::-1].cumsum())[jnp.argsort(row)]


def reports(x):
    jax.debug.callback(print, x)
    return x + 1.0


@pytest.fixture
def compiled(monkeypatch, tmp_path):
    """Names of the functions that are compiled, while programs are kept in a folder of the test,
    with this module among the packages whose code is accepted."""
    names = []
    original = kept_programs.compiled_program

    def compiled_program(function, *rest):
        names.append(function.__name__)
        return original(function, *rest)

    monkeypatch.setattr(kept_programs, "compiled_program", compiled_program)
    monkeypatch.setattr(package_code, "_STATE", package_code._State())
    package_code.remember_contents()
    accepted = (*plain_values.NUMERIC, __name__.split(".")[0])
    monkeypatch.setattr(plain_values, "NUMERIC", accepted)
    before = jax.config.jax_compilation_cache_dir  # pyright: ignore
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    keep_programs()
    yield names
    keep_programs(False)
    jax.config.update("jax_compilation_cache_dir", before)


def files(folder):
    return sorted((folder / "programs").glob("*.program"))


PAIR = Pair(np.arange(3.0), jnp.linspace(0.1, 0.7, 3))


def test_the_next_process_loads_it_and_the_bits_are_the_same(compiled):
    plain = eqx.filter_jit(added)(PAIR, 2.0)
    first, again = Compiled(added)(PAIR, 2.0), Compiled(added)(PAIR, 2.0)
    assert compiled == ["added"]
    for found in (first, again):
        assert found[0].name == "a" and found[0].second == "kept" and found[1] == (3,)
        assert jax.tree.structure(found) == jax.tree.structure(plain)
        np.testing.assert_array_equal(found[0].first, plain[0].first)


def test_what_came_from_the_cache_of_jax_is_kept_too(compiled, tmp_path):
    """An executable that was loaded can't be serialised again, or lacks functions if it can."""
    row = np.random.default_rng(1).normal(size=50)
    least = "jax_persistent_cache_min_compile_time_secs"
    before = jax.config.jax_persistent_cache_min_compile_time_secs  # pyright: ignore
    jax.config.update(least, 0.0)
    try:
        fresh = Compiled(ranked)(row)
        (file,) = files(tmp_path)
        file.unlink()
        jax.clear_caches()
        reloaded = Compiled(ranked)(row)
    finally:
        jax.config.update(least, before)
    assert len(files(tmp_path)) == 1
    loaded = Compiled(ranked)(row)
    assert compiled == ["ranked", "ranked"]
    np.testing.assert_array_equal(reloaded, fresh)
    np.testing.assert_array_equal(loaded, fresh)


def solved(matrix):
    """A function that calls LAPACK."""
    return jnp.linalg.eigh(matrix)[0]


def test_what_calls_a_library_is_not_kept(compiled, tmp_path):
    """Tracing makes LAPACK ready: a process that loaded the program crashed at its first call."""
    matrix = np.diag([2.0, 1.0])
    np.testing.assert_allclose(Compiled(solved)(matrix), [1.0, 2.0])
    assert compiled == ["solved"] and files(tmp_path) == []


class Other(eqx.Module):
    first: Any
    second: Any
    name: str = eqx.field(default="a", static=True)


ROWS = np.arange(3.0), np.ones(3)
UNLIKE = {
    "shape": (Pair(np.arange(4.0), np.ones(4)), 2.0),
    "type": (Pair(np.arange(3), np.ones(3)), 2.0),
    "static field": (Pair(*ROWS, "b"), 2.0),
    "number": (Pair(*ROWS), 3.0),
    "array": (Pair(*ROWS), np.asarray(2.0)),
    "class": (Other(*ROWS), 2.0),
}


@pytest.mark.parametrize("other", UNLIKE.values(), ids=UNLIKE)
def test_what_is_not_alike_is_compiled(compiled, other):
    Compiled(added)(PAIR, 2.0)
    Compiled(added)(*other)
    assert compiled == ["added", "added"]


def test_settings_are_part_of_the_key(compiled):
    Compiled(added)(PAIR, 2.0)
    with jax.default_matmul_precision("highest"):
        Compiled(added)(PAIR, 2.0)
    with jax.numpy_rank_promotion("raise"):
        Compiled(added)(PAIR, 2.0)
    assert len(compiled) == 3


def test_within_a_process_it_is_looked_for_once(compiled, tmp_path):
    function = Compiled(added)
    before = function.programs()
    function(PAIR, 2.0)
    for file in files(tmp_path):
        file.unlink()
    function(PAIR, 2.0)
    assert compiled == ["added"] and function.programs() == before + 1
    jax.clear_caches()
    assert function.programs() == 0


@pytest.mark.parametrize("damage", ["cut", "turned", "emptied", "strange"])
def test_a_damaged_file_is_compiled_anew(compiled, damage, tmp_path):
    Compiled(added)(PAIR, 2.0)
    (file,) = files(tmp_path)
    whole = file.read_bytes()
    middle = len(whole) // 2
    turned = whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :]
    strange = {"cut": whole[:middle], "turned": turned, "emptied": b"", "strange": b"x" * 99}
    file.write_bytes(strange[damage])
    found = Compiled(added)(PAIR, 2.0)
    assert compiled == ["added", "added"] and len(files(tmp_path)) == 1
    np.testing.assert_array_equal(found[0].first, PAIR.first + 2.0 * np.asarray(PAIR.second))
    Compiled(added)(PAIR, 2.0)
    assert compiled == ["added", "added"]


def test_machine_code_that_is_refused_is_compiled_anew_and_that_is_said_once(compiled, monkeypatch):
    def refuses(*_):
        raise jax.errors.JaxRuntimeError("INTERNAL: +prefer-no-gather is not supported")

    Compiled(added)(PAIR, 2.0)
    monkeypatch.setattr(kept_programs, "loaded_program", refuses)
    monkeypatch.setattr(kept_programs, "_said", False)
    with pytest.warns(UserWarning, match="refuses.*prefer-no-gather") as told:
        for _ in range(2):
            Compiled(added)(PAIR, 2.0)
    assert compiled == ["added"] * 3 and len(told) == 1


def test_a_folder_that_cannot_be_written_to_or_belongs_to_all_is_not_used(compiled, tmp_path):
    (tmp_path / "programs").mkdir(mode=0o700)
    (tmp_path / "programs").chmod(0o777)
    for _ in range(2):
        Compiled(added)(PAIR, 2.0)
    assert compiled == ["added", "added"] and files(tmp_path) == []
    (tmp_path / "programs").rmdir()
    (tmp_path / "programs").write_text("a file")
    Compiled(added)(PAIR, 2.0)
    assert len(compiled) == 3


def test_the_folder_is_its_owners_alone(compiled, tmp_path):
    Compiled(added)(PAIR, 2.0)
    assert (tmp_path / "programs").stat().st_mode & 0o077 == 0


def test_a_folder_that_may_only_be_read_is_read(compiled, monkeypatch):
    first = Compiled(added)(PAIR, 2.0)

    def refuses(*_):
        raise PermissionError

    monkeypatch.setattr(os, "utime", refuses)
    monkeypatch.setattr(tempfile, "mkstemp", refuses)
    again = Compiled(added)(PAIR, 2.0)
    assert compiled == ["added"]
    np.testing.assert_array_equal(first[0].first, again[0].first)


def test_memory_that_is_given_away_is(compiled):
    for _ in range(2):
        row = jnp.arange(8.0)
        found = Compiled(shifted, donate="all-except-first")((jnp.ones(()),), row)
        np.testing.assert_array_equal(found["row"], np.arange(8.0) + 1.0)
        assert row.is_deleted()
    assert compiled == ["shifted"]


def test_what_is_compiled_with_less_effort_is_another_program_of_the_same_result(compiled):
    found = [Compiled(added, effort=effort)(PAIR, 2.0)[0] for effort in ("full", "least")]
    np.testing.assert_allclose(found[1].first, found[0].first, rtol=1e-15)
    assert compiled == ["added", "added"]
    alone = Compiled(ranked, effort="least")
    keep_programs(False)
    np.testing.assert_allclose(alone(jnp.arange(4.0)), ranked(jnp.arange(4.0)), rtol=1e-14)
    assert alone.programs() == 1


@pytest.mark.parametrize("effort", ["full", "least"])
def test_under_a_transformation_it_is_traced(compiled, effort):
    function = Compiled(added, effort=effort)

    def total(first, second):
        return function(Pair(first, second), 2.0)[0].first.sum()

    gradient = jax.grad(total, 1)(np.arange(3.0), np.ones(3))
    np.testing.assert_array_equal(gradient, [2.0, 2.0, 2.0])
    assert float(jax.jit(lambda: function(PAIR, 2.0)[0].first[0])()) == pytest.approx(0.2)
    jax.vmap(total)(np.ones((2, 3)), np.ones((2, 3)))
    assert compiled == []


def test_what_calls_back_is_compiled_as_without(compiled, capsys):
    assert float(Compiled(reports)(jnp.asarray(1.0))) == 2.0
    jax.effects_barrier()
    assert "1.0" in capsys.readouterr().out


def test_it_is_off_unless_switched_on_and_where_the_cache_is_off(compiled, tmp_path):
    keep_programs(False)
    Compiled(added)(PAIR, 2.0)
    keep_programs()
    jax.config.update("jax_enable_compilation_cache", False)
    try:
        Compiled(added)(PAIR, 2.0)
    finally:
        jax.config.update("jax_enable_compilation_cache", True)
    assert compiled == [] and not (tmp_path / "programs").exists()


def test_the_folder_is_bounded_and_loses_what_was_not_used_for_longest(tmp_path):
    store = ProgramStore(tmp_path, most_bytes=2500)
    contents = {name: np.random.default_rng(k).bytes(1000) for k, name in enumerate("abc")}
    for k, name in enumerate("ab"):
        store.write(name, contents[name])
        os.utime(tmp_path / f"{name}.program", (k, k))
    assert store.read("a") == contents["a"]
    store.write("c", contents["c"])
    assert store.read("b") is None
    assert [store.read(name) for name in "ac"] == [contents["a"], contents["c"]]


THREADS = 8


def in_threads(function):
    """What a function of 0, 1, ... gives in threads that begin together."""
    found: dict[int, Any] = {}
    barrier = threading.Barrier(THREADS)

    def work(k):
        barrier.wait()
        try:
            found[k] = function(k)
        except Exception as error:
            found[k] = error

    threads = [threading.Thread(target=work, args=(k,)) for k in range(THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return [found[k] for k in range(THREADS)]


def test_threads_that_compile_at_once_keep_each_its_own_program(compiled, tmp_path):
    """From JAX's cache too, of which what is read belongs to the thread that reads it."""
    least = "jax_persistent_cache_min_compile_time_secs"
    before = jax.config.jax_persistent_cache_min_compile_time_secs  # pyright: ignore
    jax.config.update(least, 0.0)

    def added_to(k):
        return np.asarray(Compiled(added)(Pair(row, row, f"{k}"), float(k))[0].first)

    row = np.random.default_rng(1).normal(size=50)
    try:
        for _ in range(2):
            for file in files(tmp_path):
                file.unlink()
            for k, found in enumerate(in_threads(added_to)):
                np.testing.assert_allclose(found, row + k * row, rtol=1e-14)
            jax.clear_caches()
    finally:
        jax.config.update(least, before)
    assert len(compiled) == 2 * THREADS and len(files(tmp_path)) == THREADS
    for k, found in enumerate(in_threads(added_to)):
        np.testing.assert_allclose(found, row + k * row, rtol=1e-14)
    assert len(compiled) == 2 * THREADS


@pytest.mark.slow
def test_threads_that_simulate_at_once_have_each_its_own_scene(compiled):
    def fall(k):
        body = {f"mass {k}": cj.Body(2.0, (1.0, 1.0, 1.0))}
        scene = cj.Scene(body, gravity=(0.0, 1.0 + k, 0.0))
        state = cj.State({f"mass {k}": cj.body_state((0.0, 0.0, 0.0))})
        end = cj.simulate(scene, state, 0.1, progress=False).final
        return float(end.bodies[f"mass {k}"].velocity[1])

    expected = [0.1 * (1.0 + k) for k in range(THREADS)]
    assert in_threads(fall) == pytest.approx(expected)
    number = len(compiled)
    jax.clear_caches()
    assert in_threads(fall) == pytest.approx(expected)
    assert number >= THREADS and len(compiled) == number
