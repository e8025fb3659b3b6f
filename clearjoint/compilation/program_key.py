"""Keys of compiled programs: equal for arguments for which the same program would be compiled.

- `signature` knows programs within a process, as `jax.jit` does.
- `program_key` knows them in every process: beside the arguments' structure, shapes and types it
  holds the sources of this package, versions, flags, JAX's settings, and the processor.
"""

import os
import platform
import sys
from collections.abc import Callable, Hashable, Sequence
from functools import cache
from importlib import metadata

import equinox as eqx
import jax
import numpy as np
from jax._src import compiler, config
from jax.core import Tracer
from jax.sharding import NamedSharding, SingleDeviceSharding
from jaxtyping import PyTree

from .package_code import source_digest
from .plain_values import NUMERIC, NotPlainError, described
from .program import Options, Positional

_VERSIONED = (*NUMERIC, "beartype", "jax", "jaxlib", "jaxtyping", "ml_dtypes", "numpy")
"""Packages whose versions programs depend on."""
_OF_NO_MATTER = ("cache_dir", "persistent_cache", "compilation_cache", "log", "traceback", "dump")
"""Parts of names of settings that no program depends on."""


def signature(leaves: Sequence[PyTree], structure: Hashable) -> Hashable:
    """What JAX compiles anew for within a process, by leaves and structure of arguments and
    options; ``None`` while JAX traces."""
    if any(isinstance(leaf, Tracer) for leaf in leaves):
        return None
    kinds = tuple(map(_kind, leaves))
    return structure, kinds, config.trace_context(), jax.config.values["jax_default_device"]


def _kind(leaf: PyTree) -> Hashable:
    """Of an array shape, type and place; a value itself of anything else."""
    if isinstance(leaf, jax.Array):
        placed = leaf.sharding if leaf.committed else None
        return jax.Array, leaf.shape, leaf.dtype, leaf.weak_type, placed
    if isinstance(leaf, np.ndarray | np.generic):
        return np.ndarray, leaf.shape, leaf.dtype
    return type(leaf), leaf


def program_key(function: Callable[..., PyTree], arguments: Positional, options: Options) -> str:
    """The key of a program on disk.

    **Raises:** `NotPlainError` if function or arguments hold code from outside of the package
    (see `plain_values`), and `ChangedCodeError` if the package's own was changed.
    """
    leaves, structure = jax.tree.flatten((arguments, options))
    kinds = [_array_kind(leaf) if eqx.is_array(leaf) else (leaf,) for leaf in leaves]
    return described([function, structure, kinds, source_digest(), *_versions(), *_settings()])


def _array_kind(leaf: jax.Array | np.ndarray | np.generic) -> str:
    kind = f"{leaf.shape} {leaf.dtype}"
    if not isinstance(leaf, jax.Array):
        return kind
    if not leaf.committed:
        return f"{kind} {leaf.weak_type}"
    if not isinstance(leaf.sharding, SingleDeviceSharding | NamedSharding):
        raise NotPlainError(leaf.sharding)
    by_device = leaf.sharding.devices_indices_map(leaf.shape)
    places = sorted((device.id, str(index)) for device, index in by_device.items())
    return f"{kind} {leaf.weak_type} {leaf.sharding.memory_kind} {places}"


def _settings() -> list[str]:
    """What is set and present in this process that compiled programs depend on."""
    values = {
        name: value
        for name, value in sorted(jax.config.values.items())
        if not any(part in name for part in _OF_NO_MATTER)
    }
    context = [value for value in config.trace_context() if " at 0x" not in repr(value)]
    devices = [(d.id, d.platform, d.device_kind, d.process_index) for d in jax.devices()]
    client = jax.devices()[0].client
    options = compiler.get_compile_options(num_replicas=1, num_partitions=1)
    debug = options.executable_build_options.debug_options
    debug.xla_gpu_per_fusion_autotune_cache_dir = ""
    flags = options.SerializeAsString().hex()
    variables = [os.environ.get(name, "") for name in ("XLA_FLAGS", "LIBTPU_INIT_ARGS")]
    machine = [client.platform, client.platform_version, _processor()]
    return [*map(repr, (values, context, devices, machine, variables)), flags]


@cache
def _versions() -> tuple[str, ...]:
    """Versions of Python and of the packages whose code programs come from, loaded or not."""
    return (sys.version, *(f"{name} {_version(name)}" for name in _VERSIONED))


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "none"


@cache
def _processor() -> str:
    """The processor's kind and features."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            lines = file.read(16_384).split("\n\n")[0].splitlines()
    except OSError:
        return repr(platform.uname())
    kinds = ("vendor_id", "model name", "cpu family", "model\t", "flags", "Features", "CPU part")
    return repr([platform.machine(), *(line for line in lines if line.startswith(kinds))])
