"""Compile jaxprs to machine code with LLVM, without XLA.

`Native` wraps a function as `jax.jit` does. README.md beside this file describes the stages, the
parts of JAX on which they rely, and which calls of the package are compiled in this way.
"""

from .compiled import Native as Native
from .compiled import NativeFallbackWarning as NativeFallbackWarning
from .compiled import is_native as is_native
from .compiled import over_rows as over_rows
from .functions import NativeFunction as NativeFunction
from .functions import evaluated as evaluated
from .lowering import UnsupportedPrimitiveError as UnsupportedPrimitiveError
