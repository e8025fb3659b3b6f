"""Native programs on disk, and when they are loaded."""

import os
import sys
import tempfile
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._compilation import package_code, plain_values
from clearjoint._compilation.program_store import ProgramStore, keep_programs
from clearjoint._dynamics.joint_coordinates.trees import topology
from clearjoint._native import Native, NativeFunction, lanes
from clearjoint._native.machine_code import RecentPrograms
from clearjoint._simulation.run import run_checks
from studies.benchmark.chain import chain
from tests.support.one_body import one_body


class Pair(eqx.Module):
    first: Any
    second: Any
    name: str = eqx.field(default="a", static=True)


class Other(Pair):
    """Another class with the same fields."""


TRACED = []


def added(pair, factor=1.0):
    TRACED.append("added")
    return Pair(pair.first + factor * pair.second, "kept", pair.name), pair.first.shape


def call(pair, factor):
    """Call the function without a program in memory, as in another process."""
    return NativeFunction(added)(pair, factor)


@pytest.fixture
def folder(monkeypatch, tmp_path):
    """The folder of saved programs; code of this module is accepted like that of the packages."""
    TRACED.clear()
    monkeypatch.setattr(package_code, "_contents", [])
    package_code.remember_contents()
    known = plain_values._KNOWN | {__name__.split(".")[0]}
    monkeypatch.setattr(plain_values, "_KNOWN", known)
    before = jax.config.jax_compilation_cache_dir  # pyright: ignore
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    keep_programs()
    yield tmp_path / "native"
    keep_programs(False)
    jax.config.update("jax_compilation_cache_dir", before)


PAIR = Pair(np.arange(3.0), jnp.linspace(0.1, 0.7, 3))


def test_the_next_process_traces_nothing_and_the_bits_are_the_same(folder):
    first, again = call(PAIR, 2.0), call(PAIR, 2.0)
    assert len(TRACED) == 1 and folder.stat().st_mode & 0o077 == 0
    for found in (first, again):
        assert found[0].name == "a" and found[0].second == "kept" and found[1] == (3,)
        np.testing.assert_allclose(found[0].first, PAIR.first + 2.0 * np.asarray(PAIR.second))
    np.testing.assert_array_equal(first[0].first, again[0].first)


def test_numbers_in_arrays_are_not_part_of_the_key(folder):
    call(PAIR, np.asarray(2.0))
    found = call(Pair(PAIR.first + 1.0, PAIR.second), np.asarray(3.0))
    assert len(TRACED) == 1
    np.testing.assert_allclose(found[0].first, PAIR.first + 1.0 + 3.0 * np.asarray(PAIR.second))


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
def test_arguments_of_another_structure_are_compiled(folder, other):
    call(PAIR, 2.0)
    call(*other)
    assert len(TRACED) == 2


def test_settings_are_part_of_the_key(folder):
    call(PAIR, 2.0)
    with jax.numpy_dtype_promotion("strict"):
        call(PAIR, 2.0)
    with jax.numpy_rank_promotion("raise"):
        call(PAIR, 2.0)
    assert len(TRACED) == 3


def test_a_process_with_replaced_code_neither_reads_nor_saves_programs(folder, monkeypatch):
    call(PAIR, 2.0)
    with monkeypatch.context() as patch:
        patch.setattr(run_checks, "check_numbers", lambda *_: None)
        call(PAIR, 2.0)
        call(PAIR, 3.0)
    call(PAIR, 3.0)
    assert len(TRACED) == 4
    package_code.remember_contents()
    call(PAIR, 2.0)
    assert len(TRACED) == 4


def test_the_disk_is_searched_once_in_a_process(folder):
    function = NativeFunction(added)
    function(PAIR, 2.0)
    for file in folder.iterdir():
        file.unlink()
    function(PAIR, 2.0)
    assert len(TRACED) == 1 and len(function._programs) == 1


def simulated(scene, state):
    return cj.simulate(scene, state, 1e-3, progress=False).final


@pytest.mark.slow
def test_what_a_process_knows_of_scenes_is_no_change_of_code(folder):
    """Otherwise, it would keep no programs from then on."""
    scene, state = chain(2)
    topology(scene)
    simulated(scene, state)
    assert package_code.source_digest()


def swept(scene, state):
    axis = cj.Axis(lambda s: s.joints["joint 1"].clearance, [4e-4, 5e-4])
    return cj.sweep(scene, state, 1e-3, {"clearance": axis}, progress=False).final_position.values


def differentiated(scene, state):
    mass = {"mass": cj.Parameter(lambda s: s.bodies["rod 2"].mass)}
    height = {"y": cj.quantities.Position("rod 2", "y")}
    return cj.sensitivities(scene, state, 1e-3, mass, height, [1e-3], progress=False).derivatives


@pytest.fixture
def forget(monkeypatch):
    """Function that removes all programs from memory; it has been called once."""

    def forget():
        lanes._LOOPS.clear()
        # After many starts in earlier tests, a program would check those of this one.
        monkeypatch.setattr(run_checks.starts, "_seen", Counter())
        modules = [m for name, m in sys.modules.items() if name.startswith("clearjoint.")]
        for found in [value for module in modules for value in vars(module).values()]:
            if isinstance(found, Native):
                monkeypatch.setattr(found.native, "_programs", RecentPrograms())

    forget()
    return forget


@pytest.mark.parametrize(
    "call",
    [simulated, *(pytest.param(call, marks=pytest.mark.slow) for call in (swept, differentiated))],
)
def test_programs_are_read_by_the_next_process(forget, folder, call):
    """The next process reads them, writes none, and does not read their separate machine code."""
    scene, state = chain(2)
    first = call(scene, state)
    files = list(folder.iterdir())
    for file in files:
        os.utime(file, (0, 0))
    forget()
    again = call(scene, state)
    assert sorted(folder.iterdir()) == sorted(files)
    read = [file for file in files if file.stat().st_mtime > 0]
    assert len(files) == 2 * len(read) > 0
    jax.tree.map(np.testing.assert_array_equal, first, again)


@pytest.mark.parametrize("damage", ["cut", "turned", "emptied", "strange"])
def test_programs_in_damaged_files_are_compiled_again(folder, damage):
    call(PAIR, 2.0)
    for file in folder.iterdir():
        whole = file.read_bytes()
        middle = len(whole) // 2
        turned = whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :]
        strange = {"cut": whole[:middle], "turned": turned, "emptied": b"", "strange": b"x" * 99}
        file.write_bytes(strange[damage])
    found = call(PAIR, 2.0)
    np.testing.assert_allclose(found[0].first, PAIR.first + 2.0 * np.asarray(PAIR.second))
    call(PAIR, 2.0)
    assert len(TRACED) == 2


def test_a_folder_to_which_all_may_write_is_not_used(folder):
    folder.mkdir(mode=0o700)
    folder.chmod(0o777)
    for _ in range(2):
        call(PAIR, 2.0)
    assert len(TRACED) == 2 and list(folder.iterdir()) == []
    folder.rmdir()
    folder.write_text("a file")
    call(PAIR, 2.0)
    assert len(TRACED) == 3


def test_a_read_only_folder_is_read(folder, monkeypatch):
    call(PAIR, 2.0)

    def refuses(*_):
        raise PermissionError

    monkeypatch.setattr(os, "utime", refuses)
    monkeypatch.setattr(tempfile, "mkstemp", refuses)
    call(PAIR, 2.0)
    assert len(TRACED) == 1


def test_saving_is_off_by_default_and_without_a_cache(folder):
    keep_programs(False)
    call(PAIR, 2.0)
    call(PAIR, 2.0)
    keep_programs()
    jax.config.update("jax_enable_compilation_cache", False)
    try:
        call(PAIR, 2.0)
    finally:
        jax.config.update("jax_enable_compilation_cache", True)
    assert len(TRACED) == 3


def test_the_oldest_files_of_a_full_folder_are_removed(tmp_path):
    store = ProgramStore(tmp_path, most_bytes=2500)
    contents = {name: np.random.default_rng(k).bytes(1000) for k, name in enumerate("abc")}
    for k, name in enumerate("ab"):
        store.write(name, contents[name])
        os.utime(tmp_path / f"{name}.program", (k, k))
    assert store.read("a") == contents["a"]
    store.write("c", contents["c"])
    assert store.read("b") is None
    assert [store.read(name) for name in "ac"] == [contents["a"], contents["c"]]


@pytest.mark.slow
def test_threads_simulate_different_scenes_at_once(folder):
    def fall(k):
        scene, state = one_body(f"mass {k}", gravity=(0.0, 1.0 + k, 0.0))
        end = cj.simulate(scene, state, 0.1, progress=False).final
        return float(end.bodies[f"mass {k}"].velocity[1])

    with ThreadPoolExecutor(4) as threads:
        speeds = list(threads.map(fall, range(4)))
    assert speeds == pytest.approx([0.1 * (1.0 + k) for k in range(4)])
