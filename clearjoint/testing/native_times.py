"""Sum the times that making native programs has taken."""

import gc

from .._native.machine_code import Code


def native_seconds() -> dict[str, float]:
    """Return the processor time that making the native programs of this process has taken, by
    stage.

    The stages are "tracing" by JAX, "lowering" of the jaxpr to operations on numbers, "writing" of
    these as LLVM code, and "compiling" of this code, or reading its machine code from disk.
    Programs that have been deleted do not count. A program that was loaded as a whole from disk
    counts with the times that its stages took when it was made.

    >>> sorted(testing.native_seconds())
    ['compiling', 'lowering', 'tracing', 'writing']
    """
    # There is no list of all programs, but the garbage collector knows all objects.
    programs = [each for each in gc.get_objects() if isinstance(each, Code)]
    stages = ("tracing", "lowering", "writing", "compiling")
    return {stage: sum(program.seconds[stage] for program in programs) for stage in stages}
