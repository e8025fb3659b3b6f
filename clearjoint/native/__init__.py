"""Compile jaxprs to machine code with LLVM: scalar arithmetic and loops, without XLA.

`Native` wraps a function as `jax.jit` does. At its first call

1. JAX traces the function to a jaxpr (`.functions`);
2. `.lowering` converts the jaxpr to operations on scalars, vectors of tangents and arrays in memory
   (`.operations`), by a rule for each primitive: `.elementwise` and `.elementary`, `.structure`,
   `.indexing`, `.reductions` and `.control`;
3. `.llvm_text` writes these in LLVM's language;
4. `.machine_code` compiles them. `.disk_cache` saves the program for other processes.

`.lanes` is a loop that computes eight lanes of a sweep at once.

These calls are compiled as follows on CPUs, for every scene of the catalogue:

| call | compiled by |
|---|---|
| `simulate` with joint or absolute coordinates, any stabilisation, a ledger | LLVM |
| `simulate` with states, steps, impacts and sections saved | LLVM |
| `simulate` with an explicit solver, or a controller of diffrax | LLVM |
| `simulate` with an implicit solver | XLA |
| `sweep` | LLVM |
| `sensitivities` | LLVM |
| `simulate_nonsmooth` | XLA |
| `observe` | LLVM |
| `free_impact` | XLA |
| calls inside of `jax.jit`, `jax.vmap` or `jax.grad` | XLA |

XLA compiles everything on accelerators; on CPUs also programs with a primitive without a rule here,
with a warning. Programs that XLA compiles are traced again in each process.
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
