"""Settings of a process: 64-bit floats, the cache of compiled programs, threads of sweeps.

Importing the package changes none: call `configure`. Runs refuse 32-bit floats, JAX's default.
"""

import math
import os
import warnings
from pathlib import Path

import jax

from ._compilation.program_store import keep_programs, keeps_programs, prepare_folder
from ._fields.checks import require_count, require_type

XLA_FLAGS = (
    "--xla_backend_extra_options=xla_cpu_use_multi_output_fusion=true,"
    "xla_cpu_small_while_loop_byte_threshold=10000000,"
    "xla_cpu_disable_loop_unrolling=true,-pre-RA-sched=fast --xla_backend_optimization_level=1"
)
"""Value of the environment variable ``XLA_FLAGS`` for calls of `simulate` inside of `jax.jit`,
`jax.vmap` or `jax.grad` on CPUs.

XLA's CPU compiler then compiles the loop of a run to one function, instead of a kernel for each
fusion of operations: an attempted time step of the double pendulum took 1.3 instead of 82 µs under
`jax.jit`, and the program compiled in 2.4 instead of 58 s. The byte threshold makes the loop of a
run count as small; multi-output fusion avoids computing shared terms repeatedly; the other options
shorten compilation. XLA reads the variable when JAX first computes something; `configure` sets it,
and must be called before that. Calls of `simulate`, `sweep` and `sensitivities` outside of
transformations do not need these options.

>>> "xla_cpu_small_while_loop_byte_threshold" in cj.XLA_FLAGS
True
"""
_EXTRA = "--xla_backend_extra_options"
_KEEP = "CLEARJOINT_KEEP_PROGRAMS"
"""Environment variable, 0 to save no whole programs; see `configure`."""
_CACHE = "jax_compilation_cache_dir"
_MIN_COMPILE_TIME = "jax_persistent_cache_min_compile_time_secs"
_SHARED = ("jax_enable_x64", _CACHE, _MIN_COMPILE_TIME)
"""JAX's settings that must be equal in all processes that share a sweep."""
_NATIVE = "CLEARJOINT_NATIVE"
"""Environment variable, 0 to let XLA compile everything, and `clearjoint._native` nothing."""
Setting = bool | float | str | None
_threads: int | None = None
"""Number of threads of sweeps; ``None`` until `configure` or `adopt` sets it."""


def default_cache() -> Path:
    """Return the default folder of compiled programs: ``CLEARJOINT_CACHE`` or, if unset or empty,
    ``clearjoint`` in ``XDG_CACHE_HOME``, if that is an absolute path, else in ``~/.cache``."""
    if folder := os.environ.get("CLEARJOINT_CACHE"):
        return Path(folder)
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (base if base.is_absolute() else Path.home() / ".cache") / "clearjoint"


def configure(threads: int | None = None, cache: str | os.PathLike | None = None) -> None:
    """Switch 64-bit floats on, and set the folder of compiled programs and the threads of sweeps.

    Call `configure` before JAX computes anything, if possible. Arrays that exist already keep their
    precision, and the options `clearjoint.XLA_FLAGS`, which `configure` appends to the environment
    variable ``XLA_FLAGS``, have no effect later. A variable that contains
    ``--xla_backend_extra_options`` is not changed, so that the user's own options hold.

    The folder stores machine code for later processes. If the arguments of a call consist only of
    this package's classes, numbers, strings and arrays, the whole program is saved, and the next
    process loads it without tracing. A call with a user-defined class or function is traced in each
    process, so that a change of the user's code always takes effect. A process in which the package
    is upgraded, or functions, classes or constants in its modules are replaced, uses and saves no
    whole programs. It does not notice if entries of this package's dictionaries and lists are
    replaced, or anything in other packages (JAX, NumPy, Diffrax, ...), which are recognised by
    their versions. If you replace these, set the environment variable
    ``CLEARJOINT_KEEP_PROGRAMS=0``: only machine code is saved then.
    ``JAX_ENABLE_COMPILATION_CACHE=0`` switches all saving off.

    Files in the folder are executed. A new folder is accessible to you alone. A read-only folder is
    read, not written.

    **Arguments:**

    - `threads`: number of threads that share the runs of a sweep. Default: one for each core that
      the process may use or, if JAX computes on accelerators, one for each of these.
    - `cache`: folder of compiled programs; "~" at the beginning stands for the home folder. A URL
      of cloud storage, which contains "://", is passed on to JAX as it is. Default: the environment
      variable ``CLEARJOINT_CACHE``, or ``clearjoint`` in the user's cache folder.

    **Raises:** `ValueError` if `threads` is not a positive whole number, if `cache` is a file or
    leads through one, or if ``CLEARJOINT_KEEP_PROGRAMS`` is neither 0 nor 1.

    **Warns:** `UserWarning` if other users may write to the folder, or if it cannot be made. No
    programs are saved then.

    >>> cj.configure()
    >>> jnp.asarray(1.0).dtype
    dtype('float64')
    """
    global _threads
    if threads is not None:
        require_count("threads", threads, "give a number of threads, or None")
    keep = _keep()
    remedy = "pass a path, or None for the default"
    require_type("cache", cache, str | os.PathLike | None, "a path", remedy)
    folder = _usable(str(cache or default_cache()))
    # All arguments are valid from here on: a call that raises an error changes no setting.
    _threads, flags = threads, os.environ.get("XLA_FLAGS", "")
    # A user who sets backend options wants exactly these: none of this package's are mixed with
    # them. The check also keeps a second call of `configure` from appending the flags again.
    if _EXTRA not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} {XLA_FLAGS}".strip()
    jax.config.update("jax_enable_x64", True)
    jax.config.update(_CACHE, folder)
    # JAX saves the programs that took at least this time, s, to compile. Its default of 1 s would
    # leave out programs of this package that take less time each, but much in sum. Saving programs
    # that compile in less than 0.2 s would gain little. With an infinite time, JAX does not try to
    # write to a read-only folder.
    read_only = folder is not None and os.path.isdir(folder) and not os.access(folder, os.W_OK)
    jax.config.update(_MIN_COMPILE_TIME, math.inf if read_only else 0.2)
    keep_programs(keep)


def _keep() -> bool:
    value = os.environ.get(_KEEP) or "1"
    if value not in ("0", "1"):
        raise ValueError(
            f"The environment variable {_KEEP} is {value!r}: set it to 0 to save no compiled "
            "programs, or to 1."
        )
    return value == "1"


def _usable(cache: str) -> str | None:
    """Make the folder `cache`, and return its path; ``None``, with a warning, if it can't be made
    or if other users may write to it. A URL of cloud storage is returned as it is.

    **Raises:** `ValueError` if the path is that of a file, or leads through one.
    """
    if "://" in cache:
        return cache
    cache = os.path.expanduser(cache)
    problem = prepare_folder(Path(cache))
    if problem is None:
        return cache
    warnings.warn(f"Compiled programs are not saved. {problem}", stacklevel=3)
    return None


def threads_of_sweeps() -> int:
    """Return the number of threads that share the runs of a sweep: the number that `configure` or
    `adopt` has set, else the number of accelerators or, without any, of usable cores."""
    if _threads is not None:
        return _threads
    if jax.default_backend() != "cpu":
        return jax.local_device_count()
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def in_force() -> dict[str, Setting]:
    """Return those settings of this process that `adopt` takes over in another one, by names of
    JAX's settings and of environment variables."""
    shared = {name: getattr(jax.config, name) for name in _SHARED}
    return {**shared, _NATIVE: os.environ.get(_NATIVE), _KEEP: keeps_programs()}


def adopt(values: dict[str, Setting]) -> None:
    """Take over another process's settings, from its `in_force`, in a worker process of a sweep.

    On CPUs, the worker then uses one thread, since the processes share the cores, unless
    `configure` has set another number in the worker.
    """
    global _threads
    for name in _SHARED:
        jax.config.update(name, values[name])
    if values[_NATIVE] is None:
        os.environ.pop(_NATIVE, None)
    else:
        os.environ[_NATIVE] = str(values[_NATIVE])
    keep_programs(bool(values[_KEEP]))
    if jax.default_backend() == "cpu":
        _threads = _threads or 1
