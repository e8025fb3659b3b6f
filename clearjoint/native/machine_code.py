"""LLVM's language to functions of this process, which are kept on disk."""

import ctypes
import functools
import hashlib
import sys
from collections.abc import Callable
from pathlib import Path

import jax
import llvmlite
import llvmlite.binding as llvm

NativeCall = Callable[[int], int]
"""A compiled function of the address of its memory."""
OPTIMISATION = 2


@functools.cache
def _target_machine() -> llvm.TargetMachine:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    if sys.platform == "linux":
        llvm.load_library_permanently("libm.so.6")
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(),
        features=llvm.get_host_cpu_features().flatten(),
        opt=OPTIMISATION,
    )


def vector_bits() -> int:
    """The length of the machine's vectors, in bits."""
    features = llvm.get_host_cpu_features()
    return 512 if features.get("avx512f") else 256 if features.get("avx") else 128


def _digest(text: str) -> str:
    parts = (
        text,
        llvmlite.__version__,
        llvm.get_host_cpu_name(),
        llvm.get_host_cpu_features().flatten(),
    )
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def compiled(text: str, name: str, folder: Path | None = None) -> NativeCall:
    """The function of a module in LLVM's language.

    **Arguments:** `name`: of the function; `folder`: where machine code is kept, if it is.
    """
    path = None if folder is None else folder / _digest(text)
    code = None if path is None else _read(path)
    if code is None:
        code = _machine_code(text)
        if path is not None:
            _write(path, code)
    return _loaded(code, name)


def _machine_code(text: str) -> bytes:
    machine = _target_machine()
    module = llvm.parse_assembly(text)
    options = llvm.create_pipeline_tuning_options(speed_level=OPTIMISATION)
    options.loop_vectorization = options.slp_vectorization = options.loop_unrolling = False
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    return machine.emit_object(module)


def _loaded(code: bytes, name: str) -> NativeCall:
    empty = llvm.parse_assembly("")
    _target_machine()
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten()
    )
    engine = llvm.create_mcjit_compiler(empty, machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    call = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p)(engine.get_function_address(name))
    call.engine = engine  # pyright: ignore  # The code lives as long as its engine.
    return call


def _read(path: Path) -> bytes | None:
    """The machine code in a file, or ``None`` if there is none or it was damaged."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    checksum, code = content[:32], content[32:]
    return code if hashlib.sha256(code).digest() == checksum else None


def _write(path: Path, code: bytes) -> None:
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    part = path.with_suffix(f".{id(code)}")
    part.write_bytes(hashlib.sha256(code).digest() + code)
    part.replace(path)


def code_folder() -> Path | None:
    """The folder of kept machine code, inside JAX's compilation cache; ``None`` without one."""
    cache = jax.config.jax_compilation_cache_dir  # pyright: ignore
    return Path(cache) / "native" if cache else None
