"""Settings of a process: 64-bit floats, the cache of compiled programs, threads of sweeps.

Nothing here happens at import. Runs refuse JAX's 32-bit floats, which it has unless told otherwise.
"""

import math
import os
import warnings
from pathlib import Path

import jax

from .compilation import keep_programs, keeps_programs, prepare_folder
from .fields.checks import require_count

XLA_FLAGS = (
    "--xla_backend_extra_options=xla_cpu_use_multi_output_fusion=true,"
    "xla_cpu_small_while_loop_byte_threshold=10000000,"
    "xla_cpu_disable_loop_unrolling=true,-pre-RA-sched=fast --xla_backend_optimization_level=1"
)
"""Value of the environment variable ``XLA_FLAGS`` for calls of `simulate` inside of `jax.jit`,
`jax.vmap` or `jax.grad` on CPUs.

XLA's CPU compiler then makes one function of a run's loop, instead of a kernel for each fusion of
operations: an attempt of the double pendulum took 1.3 instead of 82 µs under `jax.jit`, and the
program compiled in 2.4 instead of 58 s. XLA reads the variable when JAX first computes something,
so that `configure` sets it in time if it is called before. These options can't be passed to
`jax.jit`. Calls of `simulate`, `sweep` and `sensitivities` outside of transformations don't need
them.

>>> "xla_cpu_small_while_loop_byte_threshold" in cj.XLA_FLAGS
True
"""
_EXTRA = "--xla_backend_extra_options"
_KEEP = "CLEARJOINT_KEEP_PROGRAMS"
_CACHE = "jax_compilation_cache_dir"
_LEAST_KEPT = "jax_persistent_cache_min_compile_time_secs"
_SHARED = ("jax_enable_x64", _CACHE, _LEAST_KEPT)
_NATIVE = "CLEARJOINT_NATIVE"
Setting = bool | float | str | None
"""The value of a setting of a process."""
_threads: int | None = None
"""Number of threads of sweeps, if set by `configure` or by the process that this one works for."""


def default_cache() -> Path:
    """Folder of the compilation cache: ``CLEARJOINT_CACHE``, or one in the user's cache folder.

    A variable that is empty is as none, and so is an ``XDG_CACHE_HOME`` that is no absolute path
    (XDG Base Directory Specification).
    """
    if own := os.environ.get("CLEARJOINT_CACHE"):
        return Path(own)
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (base if base.is_absolute() else Path.home() / ".cache") / "clearjoint"


def configure(threads: int | None = None, cache: str | os.PathLike | None = None) -> None:
    """Switch 64-bit floats on, and name the folder of compiled programs.

    It may be called at any time. JAX's arrays that exist before keep their precision, and only if
    JAX has computed nothing before do calls inside of `jax.jit`, `jax.vmap` or `jax.grad` run at
    full speed on CPUs (see `XLA_FLAGS`).

    From then on machine code is kept in the cache's folder, under a digest of the code it is
    compiled from. Calls whose arguments consist of this package's classes, numbers, strings and
    arrays alone are kept whole, so that the next process does not trace them. A call with a class
    or a function of your own is traced in each process, so that a change of your code always
    counts. The environment variable ``CLEARJOINT_KEEP_PROGRAMS=0`` switches off that programs are
    kept whole, and ``JAX_ENABLE_COMPILATION_CACHE=0`` all of it: set the former if you replace
    private functions in the packages that this one computes with (JAX, Diffrax, Equinox, ...).
    Replaced functions and constants of this package are noticed, and so is an upgrade of it while
    a process runs.

    What is read from the folder is executed: it is made for you alone, and one to which others may
    write is not used, with a warning. Of a folder that may only be read, what it holds is used.

    **Arguments:**

    - `threads`: that share the lanes of sweeps: one for each core that the process may use, or for
      each accelerator, unless given.
    - `cache`: folder of the persistent compilation cache; the variable ``CLEARJOINT_CACHE``, or
      ``clearjoint`` in the user's cache folder, unless given.

    **Raises:** `ValueError` if `threads` is not a positive whole number, or `cache` is a file.

    >>> cj.configure()
    >>> jnp.asarray(1.0).dtype
    dtype('float64')
    """
    global _threads
    flags = os.environ.get("XLA_FLAGS", "")
    if _EXTRA not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} {XLA_FLAGS}".strip()
    if threads is not None:
        require_count("threads", threads, "give a number of threads, or None")
    keep = _keep()
    folder = _usable(str(cache or default_cache()))
    _threads = threads
    jax.config.update("jax_enable_x64", True)
    jax.config.update(_CACHE, folder)
    read_only = folder is not None and os.path.isdir(folder) and not os.access(folder, os.W_OK)
    jax.config.update(_LEAST_KEPT, math.inf if read_only else 0.2)
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


def threads_of_sweeps() -> int:
    """Threads that share the lanes of sweeps."""
    if _threads is not None:
        return _threads
    if jax.default_backend() != "cpu":
        return jax.local_device_count()
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def in_force() -> dict[str, Setting]:
    """The settings of this process that its results and its speed depend on, for `adopt`."""
    shared = {name: getattr(jax.config, name) for name in _SHARED}
    return {**shared, _NATIVE: os.environ.get(_NATIVE), _KEEP: keeps_programs()}


def adopt(values: dict[str, Setting]) -> None:
    """Set what is in force in another process, for which this one computes; on CPUs in a thread."""
    global _threads
    for name in _SHARED:
        jax.config.update(name, values[name])
    if values[_NATIVE] is not None:
        os.environ[_NATIVE] = str(values[_NATIVE])
    keep_programs(bool(values[_KEEP]))
    if jax.default_backend() == "cpu":
        _threads = _threads or 1
