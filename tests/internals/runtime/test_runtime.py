"""Settings of a process by `configure` and environment variables."""

import os

import jax
import numpy as np
import pytest

import clearjoint as cj
from clearjoint import _runtime as runtime
from tests.support.processes import printed


def lines_of(code, **variables):
    """Return the output of a process without other settings than those given."""
    kept = {n: value for n, value in os.environ.items() if "JAX" not in n and "XLA" not in n}
    return printed(code, env=kept | variables).split("\n")[:-1]


@pytest.mark.parametrize(
    ("cache", "base", "folder"),
    [
        ("", "", "/home/me/.cache/clearjoint"),
        ("", "relative", "/home/me/.cache/clearjoint"),
        (None, "/own", "/own/clearjoint"),
        ("here", "/own", "here"),
    ],
)
def test_cache_folder_follows_the_environment(cache, base, folder, monkeypatch):
    monkeypatch.setenv("HOME", "/home/me")
    monkeypatch.setenv("XDG_CACHE_HOME", base)
    monkeypatch.delenv("CLEARJOINT_CACHE")
    if cache is not None:
        monkeypatch.setenv("CLEARJOINT_CACHE", cache)
    assert str(runtime.default_cache()) == folder


@pytest.mark.parametrize("threads", [0, 2.5, "4"])
def test_threads_must_be_a_positive_integer(threads, monkeypatch):
    """And what is refused leaves the flags of XLA."""
    monkeypatch.setenv("XLA_FLAGS", "--xla_foo")
    with pytest.raises(ValueError, match="`threads` must be a whole number, positive"):
        runtime.configure(threads)
    assert os.environ["XLA_FLAGS"] == "--xla_foo"


def test_a_cache_that_is_a_file_is_refused_before_anything_is_set(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(ValueError, match="file' is a file, or lies in one: remove the file"):
        runtime.configure(cache=tmp_path / "file")


def test_a_cache_that_must_not_be_used_gives_a_warning(tmp_path):
    tmp_path.chmod(0o777)
    with pytest.warns(UserWarning, match="programs are not saved. Other users may write"):
        assert runtime._usable(str(tmp_path)) is None
    assert runtime._usable("gs://bucket/cache") == "gs://bucket/cache"


def test_a_tilde_in_the_cache_is_the_home_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert runtime._usable("~/own") == str(tmp_path / "own")
    assert (tmp_path / "own").is_dir()
    assert runtime._usable("gs://~/own") == "gs://~/own"


@pytest.mark.parametrize(("value", "kept"), [("", True), ("1", True), ("0", False)])
def test_a_variable_switches_saving_of_programs_off(value, kept, monkeypatch):
    monkeypatch.setenv("CLEARJOINT_KEEP_PROGRAMS", value)
    assert runtime._keep() is kept


def test_other_values_of_the_variable_are_refused(monkeypatch):
    monkeypatch.setenv("CLEARJOINT_KEEP_PROGRAMS", "no")
    with pytest.raises(ValueError, match="CLEARJOINT_KEEP_PROGRAMS is 'no': set it to 0"):
        runtime.configure()


@pytest.mark.parametrize("sent", [None, "0", "1"])
def test_adopted_settings_replace_those_of_the_process(sent, monkeypatch):
    monkeypatch.setattr(runtime, "_threads", None)
    monkeypatch.setenv("CLEARJOINT_NATIVE", "0")
    runtime.adopt(runtime.in_force() | {"CLEARJOINT_NATIVE": sent})
    assert os.environ.get("CLEARJOINT_NATIVE") == sent


CONFIGURE = """
import jax, clearjoint
from clearjoint._compilation.program_store import keeps_programs
before = jax.numpy.arange(3.0)
clearjoint.configure(threads=3, cache="FOLDER")
print(before.dtype, jax.numpy.zeros(1).dtype, clearjoint._runtime.threads_of_sweeps())
print(jax.config.jax_compilation_cache_dir, keeps_programs())
clearjoint.configure(cache="FOLDER")
print(clearjoint._runtime.threads_of_sweeps())
scene = clearjoint.Scene(bodies={"stone": clearjoint.Body(1.0, (1, 1, 1))})
state = clearjoint.State({"stone": clearjoint.body_state((0, 0, 0))})
print(clearjoint.simulate(scene, state, 1e-4).final.bodies["stone"].position.dtype)
"""


def test_configure_after_the_start_of_jax(tmp_path):
    code = CONFIGURE.replace("FOLDER", str(tmp_path))
    floats, cache, threads, result = lines_of(code, CLEARJOINT_KEEP_PROGRAMS="0")
    assert floats == "float32 float64 3"
    assert cache == f"{tmp_path} False"
    assert int(threads) == len(os.sched_getaffinity(0))
    assert result == "float64"


@pytest.mark.filterwarnings("ignore:XLA compiles this program")
def test_a_run_in_32_bit_floats_ends_at_its_end_time():
    end = 0.02  # more than the closest number in float32
    with jax.enable_x64(False):
        scene = cj.Scene(bodies={"stone": cj.Body(1.0, (1, 1, 1))}, gravity=(0, -9.81, 0))
        state = cj.State({"stone": cj.body_state(position=(0, 0, 0))})
        settings = cj.Settings(allow_float32=True)
        solution = cj.simulate(scene, state, end, settings, cj.Saving([0.0, end]), progress=False)
    assert solution.result == cj.RESULTS.successful
    height = solution.final.bodies["stone"].position[1]
    assert height.dtype == np.float32
    assert float(height) == pytest.approx(-0.5 * 9.81 * end**2, rel=1e-5)


ARCTANGENT = """
import jax, numpy as np, clearjoint
clearjoint.configure()
x = np.linspace(-3.0, 3.0, 1001)
print(float(np.abs(jax.jit(jax.numpy.arctan)(x) - np.arctan(x)).max()))
"""


@pytest.mark.slow
def test_arctangents_of_arrays_are_correct():
    """XLA's are not in vectors of 512 bits (jax issue 39352), which it doesn't take by itself."""
    (error,) = lines_of(ARCTANGENT)
    assert float(error) < 1e-15
