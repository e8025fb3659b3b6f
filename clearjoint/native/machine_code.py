"""Compile LLVM's language to functions of this process, with a cache on disk."""

import ctypes
import functools
import hashlib
import sys
from collections.abc import Callable
from contextlib import suppress

import llvmlite
import llvmlite.binding as llvm

from ..compilation.program_store import ProgramStore, cache_in_use
from .lowering import UnsupportedPrimitiveError

OPTIMISATION = 2


def _new_target_machine() -> llvm.TargetMachine:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    if sys.platform == "linux":
        # Other C libraries than glibc contain the mathematical functions themselves.
        with suppress(RuntimeError):
            llvm.load_library_permanently("libm.so.6")
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(),
        features=llvm.get_host_cpu_features().flatten(),
        opt=OPTIMISATION,
    )


@functools.cache
def _target_machine() -> llvm.TargetMachine:
    return _new_target_machine()


class MachineCode:
    """A compiled function of an address in memory, which can be pickled.

    **Arguments:** `code`: content of an object file with a function "program".
    """

    def __init__(self, code: bytes):
        self._code = code

    def __call__(self, address: int) -> int:
        """Call the function with the address of the program's memory; return its integer result."""
        engine, function = self._loaded  # The engine owns the code; it must live during the call.
        return function(address)

    def __getstate__(self) -> dict[str, object]:
        return {"_code": self._code}

    @functools.cached_property
    def _loaded(self) -> tuple[llvm.ExecutionEngine, Callable[[int], int]]:
        # From Python 3.12 on there is no lock: concurrent first calls make an engine each.
        engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _new_target_machine())
        engine.add_object_file(llvm.ObjectFileRef.from_data(self._code))
        engine.finalize_object()
        address = engine.get_function_address("program")
        return engine, ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p)(address)


def compiled(text: str) -> MachineCode:
    """Compile the function "program" of a module in LLVM's language, or load it from disk if it has
    been compiled before for this processor."""
    key = hashlib.sha256("\n".join((text, *target())).encode()).hexdigest()
    store = store_of_code()
    code = None if store is None else store.read(key)
    if code is None:
        code = _object_file(text)
        if store is not None:
            with suppress(OSError):
                store.write(key, code)
    return MachineCode(code)


def target() -> tuple[str, ...]:
    """Return the versions of LLVM and of the processor, on which machine code depends."""
    features = llvm.get_host_cpu_features().flatten()
    return llvmlite.__version__, llvm.get_host_cpu_name(), features


def store_of_code() -> ProgramStore | None:
    """Return the store of machine code in JAX's compilation cache, or ``None`` without a cache."""
    folder = cache_in_use()
    return None if folder is None else ProgramStore(folder / "native")


def _object_file(text: str) -> bytes:
    machine = _target_machine()
    try:
        module = llvm.parse_assembly(text)
    except RuntimeError as error:
        raise UnsupportedPrimitiveError(f"a program that LLVM rejects ({error})") from error
    options = llvm.create_pipeline_tuning_options(speed_level=OPTIMISATION)
    # Programs are mostly straight code with few loops, on which these passes only take time.
    options.loop_vectorization = options.slp_vectorization = options.loop_unrolling = False
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    return machine.emit_object(module)
