"""Runtime settings that speed and accuracy need, set by one call before JAX starts.

Nothing here happens at import. Runs refuse JAX's 32-bit floats, which it has unless told otherwise.
Without the other settings everything works, up to twenty times slower: XLA's CPU compiler then
starts one kernel for each fusion of a step instead of compiling the stepping loop to one native
function.

``python -m clearjoint`` prints the settings as shell variables, with vectors of 256 instead of 512
bits: sweeps take some 15 % longer, single runs no longer. Wide ones need a cure that only
`configure` brings.
"""

import math
import os
import time
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import jax
from jax.interpreters import mlir

from .compilation import keep_programs, keeps_programs, prepare_folder
from .fields.checks import require_count

_FOR_SPEED = (
    ("xla_cpu_use_multi_output_fusion", "true"),
    ("xla_cpu_small_while_loop_byte_threshold", "10000000"),
)
_FOR_COMPILING = (
    ("xla_cpu_disable_loop_unrolling", "true"),
    ("-pre-RA-sched", "fast"),
)
"""LLVM unrolls loops and orders instructions in a time that grows with the square of a program's
length. Without either, a sweep compiles in two thirds of the time, and runs take 1 % longer."""
_LEVEL = ("--xla_backend_optimization_level", "1")
"""Shortens compiling, and no run takes longer."""
_KEEP = "CLEARJOINT_KEEP_PROGRAMS"
_CACHE = "jax_compilation_cache_dir"
_LEAST_KEPT = "jax_persistent_cache_min_compile_time_secs"
_WIDTH = "--xla_cpu_prefer_vector_width"
WIDE, NARROW = 512, 256
"""Bits of the vectors that XLA computes with: in wide ones its arctangents are wrong until they are
mended, which an environment variable can't do."""
_EXTRA = "--xla_backend_extra_options="
LEAST_DEVICES = 2
"""CPU devices that JAX shows at least. XLA compiles what runs on one device by other passes than
what runs on several, and the last bits of results then depend on the number of devices."""
SLOW_AFTER = 10.0
"""Seconds of stepping after which a run says what settings are missing."""
_SHARED = ("jax_enable_x64", _CACHE, _LEAST_KEPT)
Setting = bool | float | str | None
"""The value of a setting of a process."""
_said = False
_mended = False
"""Whether arctangents are right in wide vectors too."""
_idle = 0
"""How many of the devices that JAX shows are there for its programs only, and compute nothing."""


class Device(Protocol):
    """A device of JAX, as `jax.devices()` lists them: what is asked of it."""

    @property
    def platform(self) -> str:
        """The kind of device: "cpu", "gpu" or "tpu"."""
        ...


def default_cache() -> Path:
    """Folder of the compilation cache: ``CLEARJOINT_CACHE``, or one in the user's cache folder.

    A variable that is empty is as none, and so is an ``XDG_CACHE_HOME`` that is no absolute path
    (XDG Base Directory Specification).
    """
    if own := os.environ.get("CLEARJOINT_CACHE"):
        return Path(own)
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (base if base.is_absolute() else Path.home() / ".cache") / "clearjoint"


def xla_flags(present: str = "", vector_width: int = NARROW) -> str:
    """The value of ``XLA_FLAGS`` with the compiler's flags and options added to what is present;
    vectors have the width that is present, but none above `vector_width`.

    >>> "--xla" in testing.xla_flags()
    True
    """
    words = [word for word in present.split() if _width(word) <= vector_width]
    extra = [word for word in words if word.startswith(_EXTRA)]
    others = [word for word in words if not word.startswith(_EXTRA)]
    options = [option for word in extra for option in word[len(_EXTRA) :].split(",") if option]
    for name, value in (*_FOR_SPEED, *_FOR_COMPILING):
        if not any(option.split("=")[0] == name for option in options):
            options.append(f"{name}={value}")
    given = {word.split("=")[0] for word in others}
    added = ((_WIDTH, str(vector_width)), _LEVEL)
    flags = [f"{name}={value}" for name, value in added if name not in given]
    return " ".join([*others, *flags, _EXTRA + ",".join(options)])


def _width(flag: str) -> int:
    """The vectors' width in bits that a flag sets; 0 if it sets another thing."""
    name, _, value = flag.partition("=")
    return int(value) if name == _WIDTH and value.isdecimal() else 0


def settings(devices: int | None = None, cache: str | os.PathLike | None = None) -> dict[str, str]:
    """The settings as environment variables, for processes that don't call `configure`.

    >>> testing.runtime_settings(devices=2)["JAX_ENABLE_X64"]
    '1'
    """
    return {
        "JAX_ENABLE_X64": "1",
        "XLA_FLAGS": xla_flags(os.environ.get("XLA_FLAGS", "")),
        "JAX_NUM_CPU_DEVICES": str(max(devices or os.cpu_count() or 1, LEAST_DEVICES)),
        "JAX_COMPILATION_CACHE_DIR": str(cache or default_cache()),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.2",
    }


def configure(devices: int | None = None, cache: str | os.PathLike | None = None) -> None:
    """Set 64-bit floats, the compiler options, one device a core, and the compilation cache.

    Call it once, after the imports and before anything is computed with JAX.

    From then on the compiled programs of calls whose arguments consist of this package's classes,
    numbers, strings and arrays alone are kept in the cache's folder, so that the next process
    neither traces nor compiles them. A call with a class or a function of your own is traced in
    each process, so that a change of your code always counts; its machine code comes from JAX's
    compilation cache, in the same folder. The environment variable ``CLEARJOINT_KEEP_PROGRAMS=0``
    switches the former off, and ``JAX_ENABLE_COMPILATION_CACHE=0`` both: do so if you replace
    private functions in the packages that this one computes with (JAX, Diffrax, Equinox, ...).
    Replaced functions and constants of this package are noticed, and so is an upgrade of it while
    a process runs.

    What is read from the folder is executed: it is made for you alone, and one to which others may
    write is not used, with a warning. Of a folder that may only be read, what it holds is used.

    **Arguments:**

    - `devices`: CPU devices that share the lanes of sweeps; one a core, and two at least, unless
      given. JAX shows so many, and two if it is one, the second of which stays idle.
    - `cache`: folder of the persistent compilation cache; the variable ``CLEARJOINT_CACHE``, or
      ``clearjoint`` in the user's cache folder, unless given.

    **Raises:** `RuntimeError` if JAX has already started, and `ValueError` if `cache` is a file.

    Once, at the top of a program:

    >>> cj.configure()
    >>> jnp.asarray(1.0).dtype
    dtype('float64')
    """
    global _idle
    if devices is not None:
        require_count("devices", devices, "give a number of CPU devices, or None")
    keep = _keep()
    variables = settings(devices, cache)
    folder = _usable(variables["JAX_COMPILATION_CACHE_DIR"])
    flags = xla_flags(os.environ.get("XLA_FLAGS", ""), WIDE)
    shown = int(variables["JAX_NUM_CPU_DEVICES"])
    late = os.environ.get("XLA_FLAGS") != flags
    if late or jax.config.jax_num_cpu_devices != shown:  # pyright: ignore
        if _started():
            raise RuntimeError(
                "configure() must be called before JAX computes anything: move the call to the top "
                "of the program, or set the variables that `python -m clearjoint` prints."
            )
        jax.config.update("jax_num_cpu_devices", shown)
    _idle = shown - (devices or shown)
    os.environ["XLA_FLAGS"] = flags
    jax.config.update("jax_enable_x64", True)
    jax.config.update(_CACHE, folder)
    read_only = folder is not None and os.path.isdir(folder) and not os.access(folder, os.W_OK)
    jax.config.update(_LEAST_KEPT, math.inf if read_only else 0.2)
    _mend_arctan()
    keep_programs(keep)


def _keep() -> bool:
    """What the environment variable says, if it is set, of whether programs are kept."""
    value = os.environ.get(_KEEP) or "1"
    if value not in ("0", "1"):
        raise ValueError(
            f"The environment variable {_KEEP} is {value!r}: set it to 0, and no compiled programs "
            "are kept, or to 1."
        )
    return value == "1"


def _usable(cache: str) -> str | None:
    """The folder of the cache, or ``None``, with a warning, if it must not be used."""
    problem = None if "://" in cache else prepare_folder(Path(cache))
    if problem is None:
        return cache
    warnings.warn(f"Compiled programs are not kept. {problem}", stacklevel=3)
    return None


def _mend_arctan() -> None:
    """Have arctangents compiled as those of two arguments: with vectors of 512 bits, XLA's own is
    zero for nearly all of an array of doubles (jax issue 39352). A second argument of one it would
    turn back into that."""
    global _mended

    def by_two_arguments(x: jax.Array, **options: object) -> jax.Array:
        del options
        half = jax.numpy.full_like(x, 0.5)
        return jax.lax.atan2(half * x, half)

    lowering = mlir.lower_fun(by_two_arguments, multiple_results=False)
    mlir.register_lowering(jax.lax.atan_p, lowering, platform="cpu")
    _mended = True


def check_arctangents() -> None:
    """Check that they are right in vectors of the width that ``XLA_FLAGS`` asks for.

    **Raises:** `RuntimeError` if they are not.
    """
    widths = [_width(word) for word in os.environ.get("XLA_FLAGS", "").split()]
    if not _mended and max(widths, default=0) > NARROW:
        raise RuntimeError(
            f"`XLA_FLAGS` has vectors of {max(widths)} bits, in which XLA's arctangents of arrays "
            "are zero: call clearjoint.configure() before JAX starts, which mends them, or set the "
            "variables that `python -m clearjoint` prints."
        )


def busy_devices() -> list[Device]:
    """The devices that share the lanes of sweeps, unless others are named."""
    devices = jax.devices()
    return devices if devices[0].platform != "cpu" else devices[: len(devices) - _idle]


def mesh_devices(busy: Sequence[Device]) -> list[Device]:
    """The devices that a program is compiled for: those that compute, and beside one CPU device
    alone an idle one, if JAX shows one."""
    others = [d for d in jax.local_devices(backend=busy[0].platform) if d not in busy]
    needed = LEAST_DEVICES - len(busy) if busy[0].platform == "cpu" else 0
    return [*busy, *others[: max(needed, 0)]]


def program_kind(busy: Sequence[Device]) -> str:
    """What the bits of results depend on beside all settings: the kind of device, and whether a
    program is compiled for one or for several."""
    number = "several" if len(mesh_devices(busy)) >= LEAST_DEVICES else "one"
    return f"{busy[0].platform}, as for {number}"


def in_force() -> dict[str, Setting]:
    """The settings of this process that its results and its speed depend on, for `adopt`."""
    shared = {name: getattr(jax.config, name) for name in _SHARED}
    flags = os.environ.get("XLA_FLAGS", "")
    kept = keeps_programs()
    return {"XLA_FLAGS": flags, **shared, "lonely": _lonely(), "keeps_programs": kept}


def adopt(values: dict[str, Setting]) -> None:
    """Set what is in force in another process, unless JAX has already started in this one.

    **Raises:** `RuntimeError` if JAX has started with floats of other length, or on one CPU device
    only where the other process has several.
    """
    global _idle
    _mend_arctan()
    if not _started():
        os.environ["XLA_FLAGS"] = str(values["XLA_FLAGS"])
        for name in _SHARED:
            jax.config.update(name, values[name])
        keep_programs(bool(values["keeps_programs"]))
        if not values["lonely"] and jax.config.jax_num_cpu_devices < LEAST_DEVICES:  # pyright: ignore
            jax.config.update("jax_num_cpu_devices", LEAST_DEVICES)
            _idle = 1
    elif jax.config.jax_enable_x64 != values["jax_enable_x64"]:  # pyright: ignore
        _refuse("jax_enable_x64", jax.config.jax_enable_x64, values["jax_enable_x64"])  # pyright: ignore
    elif _lonely() and not values["lonely"]:
        _refuse("jax_num_cpu_devices", 1, f"{LEAST_DEVICES} or more")


def _lonely() -> bool:
    """Whether this process computes on one CPU device and JAX shows no other."""
    busy = busy_devices()
    return busy[0].platform == "cpu" and len(mesh_devices(busy)) < LEAST_DEVICES


def _refuse(setting: str, present: object, needed: object) -> None:
    raise RuntimeError(
        f"JAX has already started in this worker process with `{setting}` {present}, but the sweep "
        f"needs {needed}: take fresh workers, or start these with the variables that "
        "`python -m clearjoint` prints."
    )


def _started() -> bool:
    """Whether JAX has started: it then refuses another number of CPU devices."""
    present = jax.config.jax_num_cpu_devices  # pyright: ignore
    try:
        for number in (abs(present) + 1, present):
            jax.config.update("jax_num_cpu_devices", number)
    except RuntimeError:
        return True
    return False


def missing() -> list[str]:
    """Names of the settings for speed that are not in force."""
    flags = os.environ.get("XLA_FLAGS", "")
    absent = [name for name, _ in _FOR_SPEED if name not in flags]
    if not getattr(jax.config, _CACHE):
        absent.append(_CACHE)
    return absent


class SlowRunNotice:
    """Tells once in a process, when a run has taken long, which settings would make it faster."""

    def __init__(self) -> None:
        self._begun = time.monotonic()

    def check(self) -> None:
        """Warn if the run is long, settings are missing and nothing has been said yet."""
        global _said
        if _said or time.monotonic() - self._begun < SLOW_AFTER:
            return
        _said = True
        if absent := missing():
            warnings.warn(
                "This run is slower than it need be: " + ", ".join(absent) + " not set. Call "
                "clearjoint.configure() before JAX starts.",
                stacklevel=3,
            )
