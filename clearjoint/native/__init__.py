"""Compile jaxprs to machine code with LLVM: scalar arithmetic and loops, without XLA.

`Native` wraps a function as `jax.jit` does. At its first call

1. JAX traces the function to a jaxpr (`.functions`);
2. `.lowering` converts the jaxpr to operations on scalars, vectors of tangents and arrays in memory
   (`.operations`). It has a rule for each JAX primitive; the rules are in `.elementwise`,
   `.elementary`, `.structure`, `.indexing`, `.reductions` and `.control`;
3. `.llvm_text` writes these in LLVM's language;
4. `.machine_code` compiles them. `.disk_cache` saves the program for other processes.

`.lanes` is a loop that computes eight lanes of a sweep at once.

On CPUs, calls of the package are compiled by LLVM or by XLA:

| call | compiled by |
|---|---|
| `simulate` with joint or absolute coordinates, any stabilisation, the energy ledger | LLVM |
| `simulate` with states, steps, impacts and sections saved | LLVM |
| `simulate` with an explicit solver, or a controller of diffrax | LLVM |
| `simulate` with an implicit solver | XLA |
| `sweep` | LLVM |
| `sensitivities` | LLVM |
| `simulate_nonsmooth` | XLA |
| `observe` | LLVM |
| `free_impact` | XLA |
| calls inside of `jax.jit`, `jax.vmap` or `jax.grad` | XLA |

If a program contains a JAX primitive for which `.lowering` has no rule, XLA compiles the program,
and a `NativeFallbackWarning` says so. On accelerators XLA compiles every call. Programs that XLA
compiles are traced again in each process.
"""

from .compiled import Native, NativeFallbackWarning, is_native, over_rows
from .functions import NativeFunction, evaluated
from .lowering import UnsupportedPrimitiveError

__all__ = [
    "Native",
    "NativeFallbackWarning",
    "NativeFunction",
    "UnsupportedPrimitiveError",
    "evaluated",
    "is_native",
    "over_rows",
]
