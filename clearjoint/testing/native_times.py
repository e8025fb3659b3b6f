"""Sum the times that making native programs has taken.

Native programs are machine code that is generated from JAX programs by way of LLVM.
"""

import gc

from .._native.machine_code import Code


def native_seconds() -> dict[str, float]:
    """Return the processor time, s, that making the native programs of this process has taken.

    Programs that have been deleted do not count. A program that was loaded as a whole from disk
    counts with the times that its stages took when it was made. If the process has traced, lowered
    and written a program and only its machine code was read from disk, "compiling" is the time that
    reading took.

    **Returns:** seconds by stage: "tracing" by JAX, "lowering" of the jaxpr to operations on
    numbers, "writing" of these as LLVM code, and "compiling" of this code.

    >>> sorted(testing.native_seconds())
    ['compiling', 'lowering', 'tracing', 'writing']
    """
    # There is no list of all programs, but the garbage collector knows all objects.
    programs = [each for each in gc.get_objects() if isinstance(each, Code)]
    stages = ("tracing", "lowering", "writing", "compiling")
    return {stage: sum(program.seconds[stage] for program in programs) for stage in stages}
