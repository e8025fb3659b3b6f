"""Times that making native programs has taken, and their optimisation."""

import gc

from .._native.machine_code import Code


def native_seconds() -> dict[str, float]:
    """Return the processor time, s, that making this process's native programs has taken, by stage.

    The stages are "tracing" by JAX, "lowering" of the jaxpr to operations on numbers, "writing" of
    these as LLVM code, and "compiling" of this code, or reading its machine code from disk;
    "optimising" is for programs that have run so long that LLVM has compiled them again. Deleted
    programs do not count. A program that was loaded as a whole from disk counts with the times that
    its stages took when it was made.

    >>> sorted(testing.native_seconds())
    ['compiling', 'lowering', 'optimising', 'tracing', 'writing']
    """
    stages = ("tracing", "lowering", "writing", "compiling", "optimising")
    times = [program.seconds for program in _programs()]
    return {stage: sum(seconds.get(stage, 0.0) for seconds in times) for stage in stages}


def optimise_programs() -> None:
    """Optimise the native programs of this process now.

    Otherwise, a program is optimised when it has run for about as long as optimising takes. With
    an optimised program, a step takes two thirds of its former time, with equal bits. Call this
    function before timing steps of long runs.

    >>> testing.optimise_programs()
    """
    for program in _programs():
        program.optimise()


def _programs() -> list[Code]:
    # There is no list of all programs, but the garbage collector knows all objects.
    return [program for program in gc.get_objects() if isinstance(program, Code)]
