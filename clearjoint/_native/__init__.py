"""Compile jaxprs to machine code with LLVM, without XLA.

`Native` wraps a function as `jax.jit` does. When the function is first called,

1. JAX traces it to a jaxpr (`.functions`);
2. `.lowering` converts the jaxpr to operations on scalars, vectors of tangents (derivatives by
   parameters) and arrays in memory (`.operations`), by a rule for each JAX primitive. The rules are
   in `.elementwise`, `.elementary`, `.structure`, `.indexing`, `.linear_algebra` and `.control`;
3. `.llvm_text` writes the operations in LLVM's language; `.pieces` divides long programs;
4. `.machine_code` compiles this text to machine code, and saves it on disk for other processes.

The machine code works on memory, in which `.cells` lays out the arrays. `.lanes` is a loop that
computes eight lanes, the runs of a sweep, at once.

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

If a program contains a JAX primitive, or a use of one, without a rule, XLA compiles the whole
program. `simulate`, `sweep` and `sensitivities` then issue a `NativeFallbackWarning`, once in a
process for each reason. On accelerators XLA compiles every call. JAX saves XLA's machine code on
disk, but each process has to trace again the programs that XLA compiles.
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
