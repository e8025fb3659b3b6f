"""How much a program's compilation may cost.

What is computed once a run takes no time to run, but all of it to compile: in small kernels at
LLVM's lowest level it is compiled in a quarter of that.
"""

from typing import Literal

Effort = Literal["full", "least"]
"""Of compiling: "least" is for programs that run once or twice a run."""
CompilerOptions = dict[str, str | bool]

_LEAST: CompilerOptions = {
    "xla_backend_optimization_level": "0",
    "xla_cpu_use_fusion_emitters": False,
    "xla_cpu_parallel_codegen_split_count": "1",
}


def compiler_options(effort: Effort) -> CompilerOptions:
    """The options of XLA for a program, beside those of the process."""
    return {} if effort == "full" else _LEAST
