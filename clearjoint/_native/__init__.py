"""Compile jaxprs to machine code with LLVM, without XLA.

`Native` wraps a function as `jax.jit` does. README.md beside this file describes the stages, the
parts of JAX on which they rely, and which calls of the package are compiled in this way.
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
