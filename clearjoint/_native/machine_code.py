"""Machine code of native programs, and the files that save it for other processes.

LLVM compiles the text of a program for the processor of this machine. Two kinds of files are saved
in JAX's compilation cache. A file with machine code is named by a digest of the LLVM text. A file
with a whole program also has the layout of arguments and results. It is named by a digest of the
function, the form of the arguments, versions and settings, so that a process that reads it need
neither trace the function nor make the text.
"""

import ctypes
import functools
import pickle
import sys
import threading
import time
import zlib
from collections import OrderedDict
from collections.abc import Callable, Hashable
from contextlib import suppress
from importlib import metadata
from math import inf, isfinite
from typing import TypeVar, cast

import equinox as eqx
import jax
import llvmlite
import llvmlite.binding as llvm
from jaxtyping import PyTree
from typing_extensions import override

from .._compilation.digests import LONG, digest
from .._compilation.package_code import ChangedCodeError, source_digest
from .._compilation.plain_values import VERSIONED, NotPlainError, digest_of
from .._compilation.program_store import (
    ProgramStore,
    cache_in_use,
    keeps_programs,
    system_errors_suppressed,
)
from .._compilation.xla import USUAL_ERRORS
from .cells import Memory, Region
from .llvm_text import llvm_text
from .lowering import Lowering, UnsupportedPrimitiveError

Program = TypeVar("Program")
QUICK, OPTIMISED = 0, 2
"""LLVM's levels of optimisation (0 to 3) at which a program is compiled first, and again after it
has run for a while. For a chain of 30 joints with backlash, LLVM takes 1.0 s and 5.3 s, and a step
then 78 µs and 39 µs; for the double pendulum, 0.1 s and 0.9 s, and 2.2 µs and 1.9 µs. Results do
not depend on the level, because `.llvm_text` decides which products are fused, and LLVM gets no
permission to rearrange operations on floats."""
SECONDS_A_CHARACTER = 3e-6
"""Running time, s, per character of a program's text, after which the program is optimised.
Optimising takes about as long: it at most doubles the time of a run that ends soon after."""
_IRRELEVANT = ("cache_dir", "persistent_cache", "compilation_cache", "log", "traceback", "dump")
"""Programs do not depend on settings of JAX whose names contain one of these texts."""


_NOT_PICKLED = (*USUAL_ERRORS, EOFError, ImportError, RecursionError, pickle.PickleError)
"""Errors of `pickle` for a program that cannot be pickled, or a file of another version."""
_NOT_DESCRIBED = (*USUAL_ERRORS, ChangedCodeError, NotPlainError, RecursionError)
MOST_PROGRAMS = 256
"""Largest number of programs that `RecentPrograms` holds."""


class RecentPrograms(OrderedDict[Hashable, Program]):
    """Programs of a process by their keys, at most `MOST_PROGRAMS`, for use by several threads.

    A program occupies about 1 MB, and 4 of the 65 530 mappings of memory that a process may have.
    Beyond the limit, the least recently used program is removed. Its machine code is freed after
    its last call, because a call holds the program.
    """

    def recent(self, key: Hashable) -> Program | None:
        program = self.get(key)
        if program is not None:
            # Another thread may have removed it.
            with suppress(KeyError):
                self.move_to_end(key)
        return program

    def add(self, key: Hashable, program: Program) -> None:
        self[key] = program
        while len(self) > MOST_PROGRAMS:
            # Another thread may have emptied it.
            with suppress(KeyError):
                self.popitem(last=False)


class Stopwatch:
    """Measures the processor time, s, of this thread in each stage of making a program."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.thread_time()

    def end(self, stage: str) -> None:
        """Record the time since the last call of `end`, or since the start, as that of `stage`."""
        now = time.thread_time()
        self.seconds[stage] = now - self._last
        self._last = now


class Code:
    """Machine code of a program. The object can be pickled.

    The code is compiled, or read from disk, when the object is made, and loaded into the process
    when it is first run. It is compiled quickly, and optimised once it has run for long, unless
    the optimised code is on disk.

    - `seconds`: processor time, s, of each stage of making the code, by name.

    **Arguments:** `lowering`: has built the program; `stopwatch`: has the times of earlier stages.

    **Raises:** `UnsupportedPrimitiveError` if LLVM rejects the program.
    """

    def __init__(self, lowering: Lowering, stopwatch: Stopwatch):
        operations = lowering.ops
        text = llvm_text(operations)
        stopwatch.end("writing")
        self._text = zlib.compress(text.encode(), 1)
        self._digest = digest(text, digits=LONG)
        # Running time until the code is optimised; infinite once it is.
        self._seconds_left = len(text) * SECONDS_A_CHARACTER
        self._object_file = b""
        if not self._read_optimised():
            self._object_file = _saved_object_file(text, self._digest, QUICK)
        stopwatch.end("compiling")
        self.seconds = stopwatch.seconds
        self._constants, self._lanes = lowering.constants, operations.width
        self._cells = operations.cells

    @property
    def text(self) -> str:
        return zlib.decompress(self._text).decode()

    @override
    def __getstate__(self) -> dict[str, object]:
        state = vars(self).copy()
        state.pop("_loaded", None)
        return state

    def __setstate__(self, state: dict[str, object]) -> None:
        vars(self).update(state)
        # Since it was saved, another process may have optimised it.
        self._read_optimised()

    def memory(self) -> Memory:
        """Return new memory with the program's constants, and zeros in all other cells."""
        memory = Memory(self._cells, self._lanes)
        for start, array in self._constants.items():
            memory.write(Region.of(array, start), array)
        return memory

    def run(self, memory: Memory) -> None:
        engine, function = self._loaded  # The engine owns the code; it must live during the call.
        began = time.perf_counter()
        function(memory.address)
        self._seconds_left -= time.perf_counter() - began
        # Other threads go on with the code that they have while one optimises it.
        if self._seconds_left < 0.0 and _OPTIMISING.acquire(blocking=False):
            try:
                self.optimise()
            finally:
                _OPTIMISING.release()

    def optimise(self) -> None:
        if isfinite(self._seconds_left):
            stopwatch = Stopwatch()
            self._use_optimised(_saved_object_file(self.text, self._digest, OPTIMISED))
            stopwatch.end("optimising")
            self.seconds = {**self.seconds, **stopwatch.seconds}

    def _read_optimised(self) -> bool:
        code = _read(self._digest, OPTIMISED) if isfinite(self._seconds_left) else None
        if code is not None:
            self._use_optimised(code)
        return code is not None

    def _use_optimised(self, code: bytes) -> None:
        self._object_file, self._seconds_left = code, inf
        vars(self).pop("_loaded", None)

    @functools.cached_property
    def _loaded(self) -> tuple[llvm.ExecutionEngine, Callable[[int], None]]:
        # Each object has its own engine, which takes over the target machine given to it. From
        # Python 3.12 on `cached_property` has no lock, so that concurrent first calls make an
        # engine each, which does no harm.
        machine = _new_target_machine(QUICK)  # The level matters only to a compilation.
        engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
        engine.add_object_file(llvm.ObjectFileRef.from_data(self._object_file))
        engine.finalize_object()
        address = engine.get_function_address("program")
        return engine, ctypes.CFUNCTYPE(None, ctypes.c_void_p)(address)


_OPTIMISING = threading.Lock()


def _new_target_machine(optimisation: int) -> llvm.TargetMachine:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    if sys.platform == "linux":
        # With glibc, mathematical functions are in a library of their own, which the process may
        # not have loaded. Other C libraries contain them.
        with suppress(RuntimeError):
            llvm.load_library_permanently("libm.so.6")
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(),
        features=llvm.get_host_cpu_features().flatten(),
        opt=optimisation,
    )


_target_machine = functools.cache(_new_target_machine)


def _saved_object_file(text: str, text_digest: str, level: int) -> bytes:
    code = _read(text_digest, level)
    if code is None:
        code = _object_file(text, level)
        store = _store()
        if store is not None:
            # The program can be used even if it cannot be saved.
            with system_errors_suppressed():
                store.write(_object_key(text_digest, level), code)
    return code


def _read(text_digest: str, level: int) -> bytes | None:
    store = _store()
    return None if store is None else store.read(_object_key(text_digest, level))


def _object_key(text_digest: str, level: int) -> str:
    return digest(text_digest, str(level), *_target(), digits=LONG)


def _object_file(text: str, level: int) -> bytes:
    machine = _target_machine(level)
    try:
        module = llvm.parse_assembly(text)
    except RuntimeError as error:
        raise UnsupportedPrimitiveError(f"a program that LLVM rejects ({error})") from error
    options = llvm.create_pipeline_tuning_options(speed_level=level)
    # Programs are mostly straight code with few loops, on which these passes only take time.
    options.loop_vectorization = options.slp_vectorization = options.loop_unrolling = False
    # The builder keeps results of analyses of the module, and must be freed before it. After an
    # interrupt, Python would free both in the order in which the error's traceback holds them.
    with module, options, llvm.create_pass_builder(machine, options) as builder:
        with builder.getModulePassManager() as passes:
            passes.run(module, builder)
        return machine.emit_object(module)


def _target() -> tuple[str, ...]:
    features = llvm.get_host_cpu_features().flatten()
    return llvmlite.__version__, llvm.get_host_cpu_name(), features


def _store() -> ProgramStore | None:
    folder = cache_in_use()
    return None if folder is None else ProgramStore(folder / "native")


def load_or_make(
    function: Callable[..., PyTree], arguments: tuple[PyTree, ...], make: Callable[[], Program]
) -> Program:
    """Load the program of a function from disk, or make and save it.

    The program is made and not saved

    - unless `keep_programs` has switched saving on and JAX's compilation cache is in use;
    - if the package's code has changed since its import;
    - if the function or its arguments contain values that `digest_of` refuses, such as functions of
      a user, since a change of their code would not be noticed;
    - if the program cannot be pickled or written.
    """
    place = _place(function, arguments)
    kept = _read_program(place)
    if kept is not None:
        return cast(Program, kept)
    program = make()
    # A program is not saved if the package's code has changed while it was made.
    if place is not None and _is_unchanged():
        store, key = place
        with suppress(*_NOT_PICKLED), system_errors_suppressed():
            store.write(key, pickle.dumps(program))
    return program


def load(function: Callable[..., PyTree], arguments: tuple[PyTree, ...]) -> object:
    """Load the program that `load_or_make` has saved; ``None`` if no saved one can be read."""
    return _read_program(_place(function, arguments))


def _read_program(place: tuple[ProgramStore, str] | None) -> object:
    if place is None:
        return None
    store, key = place
    content = store.read(key)
    with suppress(*_NOT_PICKLED):
        return None if content is None else pickle.loads(content)
    return None


def _is_unchanged() -> bool:
    with suppress(ChangedCodeError):
        return bool(source_digest())
    return False


def _place(
    function: Callable[..., PyTree], arguments: tuple[PyTree, ...]
) -> tuple[ProgramStore, str] | None:
    store = _store() if keeps_programs() else None
    if store is None:
        return None
    # A value that cannot be described has no key.
    with suppress(*_NOT_DESCRIBED), system_errors_suppressed():
        return store, _key(function, arguments)
    return None


def _key(function: Callable[..., PyTree], arguments: tuple[PyTree, ...]) -> str:
    """Return the key of a function's program, the same in all processes and for all numbers in the
    arrays of the arguments."""
    forms = jax.tree.map(_form, arguments)
    settings = {
        name: repr(value)
        for name, value in sorted(jax.config.values.items())
        if not any(part in name for part in _IRRELEVANT)
    }
    return digest_of([function, forms, source_digest(), _versions(), settings, _target()])


def _form(leaf: PyTree) -> PyTree:
    if not eqx.is_array(leaf):
        return leaf
    # `digest_of` would take a `jax.ShapeDtypeStruct` apart: a second for a hundred joints. The form
    # is bytes, as no other leaf is, so that it cannot be mistaken for a leaf with this text.
    return f"{leaf.dtype.name} {leaf.shape} {getattr(leaf, 'weak_type', False)}".encode()


@functools.cache
def _versions() -> tuple[str, ...]:
    return (sys.version, *(f"{name} {_version(name)}" for name in VERSIONED))


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "none"
