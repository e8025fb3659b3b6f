"""Runtime settings: what they are, that one call sets them, and what is said without them."""

import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint import runtime

FUSION = "xla_cpu_use_multi_output_fusion"
FOR_COMPILING = {"xla_cpu_disable_loop_unrolling": "true", "-pre-RA-sched": "fast"}
WIDTH = "--xla_cpu_prefer_vector_width"
THRESHOLD = "xla_cpu_small_while_loop_byte_threshold"
SETTINGS = {
    "JAX_ENABLE_X64",
    "XLA_FLAGS",
    "JAX_NUM_CPU_DEVICES",
    "JAX_COMPILATION_CACHE_DIR",
    "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS",
}


def completed(*command, **variables):
    """A process with none of the settings in its environment but those given."""
    kept = {name: value for name, value in os.environ.items() if name not in SETTINGS}
    return subprocess.run(
        command, env=kept | variables, capture_output=True, text=True, check=False
    )


def python(code, **variables):
    done = completed(sys.executable, "-c", code, **variables)
    assert done.returncode == 0, done.stderr
    return done.stdout.split("\n")[:-1]


def options(flags):
    """The backend options among XLA's flags, by name."""
    prefix = "--xla_backend_extra_options="
    words = [word.removeprefix(prefix) for word in flags.split() if word.startswith(prefix)]
    assert len(words) == 1
    return dict(option.split("=") for option in words[0].split(","))


@pytest.mark.parametrize("base", ["", "cache"])
def test_a_cache_folder_that_is_empty_or_relative_is_as_none(base, monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("CLEARJOINT_CACHE", "")
    monkeypatch.setenv("XDG_CACHE_HOME", base)
    assert runtime.default_cache() == tmp_path / ".cache" / "clearjoint"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "own"))
    assert runtime.default_cache() == tmp_path / "own" / "clearjoint"
    monkeypatch.setenv("CLEARJOINT_CACHE", "here")
    assert str(runtime.default_cache()) == "here"


@pytest.mark.parametrize("devices", [0, 2.5, "4"])
def test_devices_are_a_whole_number(devices):
    with pytest.raises(ValueError, match="`devices` must be a whole number, positive"):
        runtime.configure(devices)


def test_a_cache_that_is_a_file_is_refused_before_anything_is_set(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(ValueError, match="file' is a file, or lies in one: remove the file"):
        runtime.configure(cache=tmp_path / "file")


def test_a_cache_that_must_not_be_used_is_warned_of(tmp_path):
    tmp_path.chmod(0o777)
    with pytest.warns(UserWarning, match="programs are not kept. Others than you may write"):
        assert runtime._usable(str(tmp_path)) is None
    assert runtime._usable("gs://bucket/cache") == "gs://bucket/cache"


@pytest.mark.parametrize(("value", "kept"), [("", True), ("1", True), ("0", False)])
def test_a_variable_switches_off_that_programs_are_kept(value, kept, monkeypatch):
    monkeypatch.setenv("CLEARJOINT_KEEP_PROGRAMS", value)
    assert runtime._keep() is kept


def test_a_variable_of_another_value_is_refused(monkeypatch):
    monkeypatch.setenv("CLEARJOINT_KEEP_PROGRAMS", "no")
    with pytest.raises(ValueError, match="CLEARJOINT_KEEP_PROGRAMS is 'no': set it to 0"):
        runtime.configure()


def test_flags_turn_all_options_on():
    flags = runtime.xla_flags(vector_width=runtime.WIDE)
    assert options(flags) == {FUSION: "true", THRESHOLD: "10000000"} | FOR_COMPILING
    assert f"{WIDTH}=512" in flags.split()


@pytest.mark.parametrize("present", ["", f"{WIDTH}=512", f"--some=1 {WIDTH}=1024"])
def test_flags_of_the_environment_have_no_wide_vectors(present, monkeypatch):
    """In which arctangents are wrong where `configure` isn't called."""
    monkeypatch.setenv("XLA_FLAGS", present)
    flags = runtime.settings()["XLA_FLAGS"].split()
    assert [flag for flag in flags if flag.startswith(WIDTH)] == [f"{WIDTH}=256"]
    assert set(flags) >= {flag for flag in present.split() if not flag.startswith(WIDTH)}


def test_flags_keep_what_is_present():
    present = (
        f"--xla_dump_to=/tmp/x --xla_backend_extra_options={THRESHOLD}=7,some=1 "
        "--xla_backend_extra_options=other=2 --xla_cpu_prefer_vector_width=256"
    )
    flags = runtime.xla_flags(present)
    assert options(flags) == {THRESHOLD: "7", "some": "1", "other": "2", FUSION: "true"} | (
        FOR_COMPILING
    )
    kept = ["--xla_dump_to=/tmp/x", "--xla_cpu_prefer_vector_width=256"]
    assert flags.split()[:2] == kept
    assert sum(word.startswith("--xla_cpu_prefer_vector_width") for word in flags.split()) == 1


def test_flags_do_not_grow_when_added_twice():
    flags = runtime.xla_flags("--xla_dump_to=/tmp/x")
    assert runtime.xla_flags(flags) == flags


def test_cache_folder_follows_the_environment(monkeypatch):
    monkeypatch.setenv("CLEARJOINT_CACHE", "/a")
    assert str(runtime.default_cache()) == "/a"
    monkeypatch.delenv("CLEARJOINT_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", "/b")
    assert str(runtime.default_cache()) == "/b/clearjoint"


SHELL = (
    'eval "$("$0" -m clearjoint)" && "$0" -c "import os; '
    "print(*(os.environ.get(name) for name in '{names}'.split()), sep='\\n')\""
)


@pytest.fixture(scope="module")
def printed():
    """What a shell has, and is told, after evaluating what the module prints."""
    return completed(
        "bash",
        "-c",
        SHELL.format(names=" ".join(sorted(SETTINGS))),
        sys.executable,
        XLA_FLAGS="--xla_dump_to=/tmp/x",
        CLEARJOINT_CACHE="/tmp/a cache",
    )


def test_module_prints_exports_that_a_shell_understands(printed):
    assert printed.returncode == 0, printed.stderr
    assert dict(zip(sorted(SETTINGS), printed.stdout.split("\n"), strict=False)) == {
        "JAX_ENABLE_X64": "1",
        "XLA_FLAGS": runtime.xla_flags("--xla_dump_to=/tmp/x"),
        "JAX_NUM_CPU_DEVICES": str(max(os.cpu_count() or 1, runtime.LEAST_DEVICES)),
        "JAX_COMPILATION_CACHE_DIR": "/tmp/a cache",
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.2",
    }


def test_printing_the_settings_warns_of_nothing(printed):
    assert printed.stderr == ""


CONFIGURE = """
import os, jax, clearjoint
from clearjoint.runtime import missing
print(*missing())
clearjoint.configure(devices=3, cache="FOLDER")
print(missing(), jax.numpy.zeros(1).dtype, jax.device_count())
print(jax.config.jax_compilation_cache_dir)
from clearjoint.compilation import keeps_programs
print(keeps_programs())
print(os.environ["XLA_FLAGS"])
clearjoint.configure(devices=3, cache="FOLDER")
try:
    clearjoint.configure(devices=2)
except RuntimeError as error:
    print(error)
"""


def test_configure_before_anything_is_computed_sets_all_and_afterwards_refuses(tmp_path):
    code = CONFIGURE.replace("FOLDER", str(tmp_path))
    absent, state, cache, keeps, flags, refusal = python(code, CLEARJOINT_KEEP_PROGRAMS="0")
    assert absent.split() == [FUSION, THRESHOLD, "jax_compilation_cache_dir"]
    assert state == "[] float64 3"
    assert cache == str(tmp_path) and keeps == "False"
    assert flags == runtime.xla_flags(vector_width=runtime.WIDE)
    assert "before JAX computes" in refusal and "python -m clearjoint" in refusal


ALONE = """
import clearjoint, jax
from clearjoint.runtime import busy_devices, mesh_devices, program_kind
clearjoint.configure(devices=1)
print(len(jax.devices()), len(busy_devices()), len(mesh_devices(busy_devices())))
print(program_kind(busy_devices()))
"""


def test_one_device_has_an_idle_one_beside_it():
    """So that its program is that of several."""
    assert python(ALONE) == ["2 1 2", "cpu, as for several"]
    said = python(ALONE.replace("clearjoint.configure(devices=1)", ""))
    assert said == ["1 1 1", "cpu, as for one"]


TOO_LATE = """
import os, jax, clearjoint
jax.numpy.zeros(1)
try:
    clearjoint.configure(devices=1)
except RuntimeError as error:
    print("refused", clearjoint.runtime.missing(), jax.config.jax_enable_x64)
"""


def test_configure_after_jax_has_started_with_as_many_devices_is_refused_too():
    """The flags would come too late in silence, since `missing` reads the environment."""
    assert python(TOO_LATE, JAX_NUM_CPU_DEVICES="1") == [
        f"refused ['{FUSION}', '{THRESHOLD}', 'jax_compilation_cache_dir'] False"
    ]


@pytest.mark.parametrize("absent", [FUSION, THRESHOLD])
def test_missing_names_what_is_missing(monkeypatch, absent):
    monkeypatch.setenv("XLA_FLAGS", runtime.xla_flags())
    assert runtime.missing() == []
    monkeypatch.setenv("XLA_FLAGS", runtime.xla_flags().replace(absent, "something_else"))
    assert runtime.missing() == [absent]


def test_missing_names_the_cache(monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", runtime.xla_flags())
    folder = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", None)
    try:
        assert runtime.missing() == ["jax_compilation_cache_dir"]
    finally:
        jax.config.update("jax_compilation_cache_dir", folder)


@pytest.fixture
def slow_run(monkeypatch):
    monkeypatch.setattr(runtime, "SLOW_AFTER", 0.0)
    monkeypatch.setattr(runtime, "_said", False)
    return runtime.SlowRunNotice()


def test_slow_run_names_missing_settings_once(slow_run, monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", "")
    with pytest.warns(UserWarning, match=rf"{FUSION}.*clearjoint\.configure\(\)") as said:
        slow_run.check()
        slow_run.check()
    assert len(said) == 1


def test_slow_run_with_all_settings_says_nothing(slow_run, monkeypatch, recwarn):
    monkeypatch.setenv("XLA_FLAGS", runtime.xla_flags())
    slow_run.check()
    assert not recwarn


def test_short_run_says_nothing(slow_run, monkeypatch, recwarn):
    monkeypatch.setattr(runtime, "SLOW_AFTER", 10.0)
    monkeypatch.setenv("XLA_FLAGS", "")
    slow_run.check()
    assert not recwarn


@pytest.mark.optimised
def test_arctangents_of_arrays_are_right():
    """Programs as users have them: vectors of 512 bits."""
    x = np.linspace(-3.0, 3.0, 1001)
    found = jax.jit(jnp.arctan)(x)  # noqa: TID251
    np.testing.assert_allclose(found, np.arctan(x), rtol=1e-15)


@pytest.mark.parametrize("width", ["512", "1024"])
def test_runs_refuse_wide_vectors_whose_arctangents_are_wrong(width, monkeypatch):
    """A process may have them from its shell, or from one that began it."""
    monkeypatch.setattr(runtime, "_mended", False)
    monkeypatch.setenv("XLA_FLAGS", f"--some=1 {WIDTH}={width}")
    expected = rf"vectors of {width} bits.*clearjoint\.configure\(\).*`python -m clearjoint`"
    with pytest.raises(RuntimeError, match=expected):
        cj.simulate(*cj.double_pendulum(), 1e-3)
    for fine in ("", f"{WIDTH}=256", runtime.settings()["XLA_FLAGS"]):
        monkeypatch.setenv("XLA_FLAGS", fine)
        runtime.check_arctangents()


ARCTANGENT = """
import jax, numpy as np
from clearjoint.runtime import adopt, check_arctangents, in_force
if {started}:
    jax.numpy.zeros(1)
adopt(in_force())
check_arctangents()
x = np.linspace(-3.0, 3.0, 1001)
print(float(np.abs(jax.jit(jax.numpy.arctan)(x) - np.arctan(x)).max()) < 1e-15)
"""


@pytest.mark.slow
@pytest.mark.parametrize("started", [False, True])
def test_workers_with_wide_vectors_are_mended(started):
    """Those where JAX has started before the settings came, too."""
    wide = runtime.xla_flags(vector_width=runtime.WIDE)
    code = ARCTANGENT.replace("{started}", str(started))
    assert python(code, XLA_FLAGS=wide, JAX_ENABLE_X64="1") == ["True"]
