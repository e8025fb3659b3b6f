"""Compile jaxprs to machine code with LLVM: scalar arithmetic and loops, without XLA.

`Native` wraps a function as `jax.jit` does. At its first call JAX traces it; `.lowering` turns the
jaxpr into operations on scalars, tangents and arrays in memory (`.operations`), by a rule
for each primitive (`.elementwise`, `.elementary`, `.primitives`); `.llvm_text` writes these in
LLVM's language, and `.machine_code` compiles them. `.lanes` runs eight lanes of a sweep side by
side.

What is compiled here, on CPUs; every scene of the catalogue is, in runs, sweeps and derivatives:

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

Programs that XLA compiles are traced again in each process. On accelerators XLA compiles
everything, and on CPUs, with a warning, what has a primitive of JAX without a rule here.
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
