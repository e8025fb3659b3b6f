"""Compile jaxprs to machine code with LLVM: scalar arithmetic and loops, without XLA.

`NativeFunction` is to CPUs what `jax.jit` is elsewhere. A function is traced by JAX
(`.lowering`), written as operations on scalars inside loops and branches (`.operations`,
`.control`), put into LLVM's language (`.llvm_text`) and compiled (`.machine_code`).
"""

from .compiled import Native, NativeFallbackWarning, is_native
from .functions import NativeFunction
from .lowering import UnsupportedPrimitiveError

__all__ = [
    "Native",
    "NativeFallbackWarning",
    "NativeFunction",
    "UnsupportedPrimitiveError",
    "is_native",
]
