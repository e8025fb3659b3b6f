"""Runtime settings that speed and accuracy need, set by one call before JAX starts.

Nothing here happens at import. Runs refuse JAX's 32-bit floats, which it has unless told otherwise.
Without the other settings everything works, up to twenty times slower: XLA's CPU compiler then
starts one kernel for each fusion of a step instead of compiling the stepping loop to one native
function.

``python -m clearjoint`` prints the same settings as shell variables.
"""

import os
import time
import warnings
from pathlib import Path
from typing import Any

import jax

from .fields import require_count

_BACKEND_OPTIONS = (
    ("xla_cpu_use_multi_output_fusion", "true"),
    ("xla_cpu_small_while_loop_byte_threshold", "10000000"),
)
_VECTOR_WIDTH = "--xla_cpu_prefer_vector_width=512"
_EXTRA = "--xla_backend_extra_options="
SLOW_AFTER = 10.0
"""Seconds of stepping after which a run says what settings are missing."""

_SHARED = (
    "jax_enable_x64",
    "jax_compilation_cache_dir",
    "jax_persistent_cache_min_compile_time_secs",
)
_said = False


def default_cache() -> Path:
    """Folder of the compilation cache: ``CLEARJOINT_CACHE``, or one in the user's cache folder.

    A variable that is empty is as none, and so is an ``XDG_CACHE_HOME`` that is no absolute path
    (XDG Base Directory Specification).
    """
    if own := os.environ.get("CLEARJOINT_CACHE"):
        return Path(own)
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (base if base.is_absolute() else Path.home() / ".cache") / "clearjoint"


def xla_flags(present: str = "") -> str:
    """The value of ``XLA_FLAGS`` with the two compiler options added to what is present."""
    words = present.split()
    extra = [word for word in words if word.startswith(_EXTRA)]
    others = [word for word in words if not word.startswith(_EXTRA)]
    options = [option for word in extra for option in word[len(_EXTRA) :].split(",") if option]
    for name, value in _BACKEND_OPTIONS:
        if not any(option.split("=")[0] == name for option in options):
            options.append(f"{name}={value}")
    if not any(word.startswith("--xla_cpu_prefer_vector_width") for word in others):
        others.append(_VECTOR_WIDTH)
    return " ".join([*others, _EXTRA + ",".join(options)])


def settings(devices: int | None = None, cache: str | os.PathLike | None = None) -> dict[str, str]:
    """The settings as environment variables."""
    return {
        "JAX_ENABLE_X64": "1",
        "XLA_FLAGS": xla_flags(os.environ.get("XLA_FLAGS", "")),
        "JAX_NUM_CPU_DEVICES": str(os.cpu_count() or 1 if devices is None else devices),
        "JAX_COMPILATION_CACHE_DIR": str(cache or default_cache()),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.2",
    }


def configure(devices: int | None = None, cache: str | os.PathLike | None = None) -> None:
    """Set 64-bit floats, the compiler options, one device a core, and the compilation cache.

    Call it once, after the imports and before anything is computed with JAX.

    **Arguments:**

    - `devices`: CPU devices that JAX shows; one a core unless given.
    - `cache`: folder of the persistent compilation cache; `default_cache()` unless given.

    **Raises:** `RuntimeError` if JAX has already started.
    """
    if devices is not None:
        require_count("devices", devices, "give a number of CPU devices, or None")
    variables = settings(devices, cache)
    devices = int(variables["JAX_NUM_CPU_DEVICES"])
    late = os.environ.get("XLA_FLAGS") != variables["XLA_FLAGS"]
    if late or jax.config.jax_num_cpu_devices != devices:  # pyright: ignore
        if _started():
            raise RuntimeError(
                "configure() must be called before JAX computes anything: move the call to the top "
                "of the program, or set the variables that `python -m clearjoint` prints."
            )
        jax.config.update("jax_num_cpu_devices", devices)
    os.environ["XLA_FLAGS"] = variables["XLA_FLAGS"]
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_compilation_cache_dir", variables["JAX_COMPILATION_CACHE_DIR"])
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)


def in_force() -> dict[str, Any]:
    """The settings of this process that its results and its speed depend on, for `adopt`."""
    shared = {name: getattr(jax.config, name) for name in _SHARED}
    return {"XLA_FLAGS": os.environ.get("XLA_FLAGS", ""), **shared}


def adopt(values: dict[str, Any]) -> None:
    """Set what is in force in another process, unless JAX has already started in this one.

    **Raises:** `RuntimeError` if JAX has started with floats of other length.
    """
    if not _started():
        os.environ["XLA_FLAGS"] = values["XLA_FLAGS"]
        for name in _SHARED:
            jax.config.update(name, values[name])
    elif jax.config.jax_enable_x64 != values["jax_enable_x64"]:  # pyright: ignore
        raise RuntimeError(
            "JAX has already started in this worker process with `jax_enable_x64` "
            f"{jax.config.jax_enable_x64}, but the sweep needs {values['jax_enable_x64']}: "  # pyright: ignore
            "take fresh workers, or start these with the variables that `python -m clearjoint` "
            "prints."
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
    absent = [name for name, _ in _BACKEND_OPTIONS if name not in flags]
    if not jax.config.jax_compilation_cache_dir:  # pyright: ignore
        absent.append("jax_compilation_cache_dir")
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
