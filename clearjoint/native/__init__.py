"""Compile jaxprs to machine code with LLVM: scalar arithmetic and loops, without XLA.

`Native` wraps a function as `jax.jit` does. At its first call JAX traces it; `.lowering` turns the
jaxpr into operations on scalars, tangents and arrays in memory (`.operations`), by a rule
for each primitive (`.elementwise`, `.elementary`, `.primitives`); `.llvm_text` writes these in
LLVM's language, and `.machine_code` compiles them. `.lanes` runs eight lanes of a sweep side by
side.

Compiled here: `simulate` outside of transformations, with all explicit solvers, controllers, both
coordinates, records, sections and impacts; `sensitivities`, fits and horizons; lanes of sweeps.
Compiled by XLA: all of these inside of `jax.jit`, `jax.vmap` or `jax.grad`, on accelerators, and
with implicit solvers, which need linear algebra; `simulate_nonsmooth` and `observe`.
"""

from .compiled import Native, NativeFallbackWarning, is_native, over_rows
from .functions import NativeFunction
from .lowering import UnsupportedPrimitiveError

__all__ = [
    "Native",
    "NativeFallbackWarning",
    "NativeFunction",
    "UnsupportedPrimitiveError",
    "is_native",
    "over_rows",
]
