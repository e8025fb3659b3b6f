"""Levels of LLVM's optimisation: results do not depend on when a program is optimised."""

import pickle
from concurrent.futures import ThreadPoolExecutor
from time import sleep

import jax
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._compilation.program_store import ProgramStore
from clearjoint._native import Native, NativeFunction, machine_code, over_rows
from clearjoint._native.llvm_text import LONGEST_BLOCK
from clearjoint._simulation.run import host_run, simulate
from clearjoint._simulation.run.host_run import SAVES_A_SEGMENT
from studies.benchmark.backlash_chain import chain
from studies.benchmark.chain import ideal_chain
from studies.benchmark.first_calls import four_bar

SCENES = [
    pytest.param(lambda: ideal_chain(1), id="rod"),
    pytest.param(
        lambda: cj.mechanisms.double_pendulum(0.5e-3, 0.9), id="pendulum", marks=pytest.mark.slow
    ),
    pytest.param(four_bar, id="four-bar", marks=pytest.mark.slow),
    pytest.param(lambda: chain(2), id="backlash", marks=pytest.mark.slow),
]


@pytest.fixture(autouse=True)
def nothing_saved(monkeypatch) -> None:
    monkeypatch.setattr(machine_code, "_store", lambda: None)


AT_ONCE, DURING, NEVER = 0.0, 1e-12, 1e6
"""Seconds of running for each character of text after which programs are optimised. Saving divides
the runs below into several segments, so that programs change during a run."""


@pytest.mark.parametrize("make", SCENES)
def test_bits_of_a_run_do_not_depend_on_the_level(make, monkeypatch):
    scene, state = make()
    results, codes = [], []
    save = cj.Saving(np.linspace(0.0, 0.02, 2 * SAVES_A_SEGMENT), impacts=True)
    for seconds in (AT_ONCE, DURING, NEVER):
        monkeypatch.setattr(machine_code, "SECONDS_A_CHARACTER", seconds)
        programs = Native(host_run.segment)
        monkeypatch.setattr(host_run, "segment_compiled", programs)
        begun = Native(host_run.begin)
        monkeypatch.setattr(simulate, "begin_compiled", begun)
        solution = cj.simulate(scene, state, 0.02, save=save, progress=False)
        ((program, _),) = programs.native._programs.values()
        codes.append(program.code._object_file)
        arrays = jax.tree.leaves((solution.final, solution.saved, solution.attempts))
        bits = b"".join(np.ascontiguousarray(array).tobytes() for array in arrays)
        assert solution.impacts is not None
        results.append((bits, solution.impacts.to_dataframe().to_csv()))
    assert results[0] == results[1] == results[2]
    assert codes[0] == codes[1] != codes[2]


def product_and_sum(x):
    return x * x + 1.0


def program_of_product(monkeypatch, seconds: float) -> NativeFunction:
    monkeypatch.setattr(machine_code, "SECONDS_A_CHARACTER", seconds)
    function = NativeFunction(product_and_sum)
    assert function(np.asarray(3.0)) == 10.0
    return function


def code_of(function: NativeFunction) -> machine_code.Code:
    ((program, _),) = function._programs.values()
    return program.code


def test_later_processes_read_the_optimised_code(tmp_path, monkeypatch):
    monkeypatch.setattr(machine_code, "_store", lambda: ProgramStore(tmp_path))
    quick = code_of(program_of_product(monkeypatch, NEVER))
    saved = pickle.dumps(quick)
    optimised = code_of(program_of_product(monkeypatch, AT_ONCE))
    assert len(list(tmp_path.iterdir())) == 2
    # Another process traces the function again, or reads the program that was saved before.
    again = code_of(program_of_product(monkeypatch, NEVER))
    assert again._object_file == pickle.loads(saved)._object_file == optimised._object_file
    assert quick._object_file != optimised._object_file
    assert pickle.loads(saved).text == quick.text


def test_threads_share_a_program_while_it_is_optimised(monkeypatch):
    levels: list[int] = []
    compiled = machine_code._object_file

    def counted(text: str, level: int) -> bytes:
        levels.append(level)
        sleep(0.05 * level)  # so that others run meanwhile
        return compiled(text, level)

    monkeypatch.setattr(machine_code, "_object_file", counted)
    function = program_of_product(monkeypatch, NEVER)
    code_of(function)._seconds_left = 0.0
    with ThreadPoolExecutor(4) as pool:
        numbers = np.arange(400.0)
        np.testing.assert_array_equal(list(pool.map(function, numbers)), numbers**2 + 1.0)
    assert levels == [machine_code.QUICK, machine_code.OPTIMISED]


def test_a_program_survives_that_its_optimisation_is_interrupted(monkeypatch):
    function = program_of_product(monkeypatch, NEVER)
    code = code_of(function)

    def interrupted(text: str, level: int) -> bytes:
        raise KeyboardInterrupt

    code._seconds_left = 0.0
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(machine_code, "_object_file", interrupted)
        function(np.asarray(4.0))
    before = code._object_file
    assert function(np.asarray(4.0)) == 17.0 and code._object_file != before


def test_only_the_first_rows_are_computed():
    def shifted(number, row):
        return {"sum": number + row.sum(), "row": row * number, "low": number < 2.0}

    def all_rows(count, numbers, rows):
        return over_rows(shifted, count, numbers, rows)

    random = np.random.default_rng(0)
    numbers, rows = np.arange(600.0), random.uniform(size=(600, 3))
    function = NativeFunction(all_rows)
    for count in (0, 1, 7, 600):
        found = function(np.asarray(count), numbers, rows)
        expected = shifted(numbers[:, None], rows)["row"]
        np.testing.assert_array_equal(found["row"][:count], expected[:count])
        np.testing.assert_array_equal(found["low"], (numbers < 2.0) & (numbers < count))
        assert not found["sum"][count:].any()


def test_straight_code_is_written_in_short_blocks():
    """LLVM's time without optimisation grew with the square of a block's length."""

    def powers(x: jax.Array) -> jax.Array:
        for k in range(1000):
            x = x * x + float(k)
        return x

    function = NativeFunction(powers)
    function(np.asarray(0.5))
    blocks = code_of(function).text.split("br label")
    assert max(block.count("\n") for block in blocks) < 2 * LONGEST_BLOCK
