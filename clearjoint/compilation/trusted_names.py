"""Names by which trusted code is known."""

import sys
import types

import jax
import numpy as np

from .trusted_code import holds, is_trusted, reaches_out, wrote
from .words import DATA, HEAP_TYPE

_JITTED = type(jax.jit(len))


def trusted_name(value: object) -> str | None:
    """The module and name by which trusted code is known, or ``None``."""
    if isinstance(value, types.ModuleType):
        known = sys.modules.get(value.__name__) is value and is_trusted(value.__name__)
        return f"{value.__name__} module" if known else None
    inner = value.__wrapped__ if isinstance(value, _JITTED) else value  # pyright: ignore
    if isinstance(inner, types.FunctionType):
        plain = inner.__closure__ is None and all(type(v) in DATA for v in _defaults(inner))
        if not plain or vars(inner) or not wrote(inner.__code__):
            return None
        line = inner.__code__.co_firstlineno
        return f"{inner.__module__} {inner.__qualname__} {line} {_defaults(inner)}"
    if isinstance(inner, np.ufunc):
        return f"numpy {inner.__name__}" if holds("numpy", inner.__name__, inner) else None
    if isinstance(inner, type) and not inner.__flags__ & HEAP_TYPE:
        return f"{inner.__module__} {inner.__qualname__}"
    if isinstance(inner, type | types.BuiltinFunctionType):
        module, name = getattr(inner, "__module__", None), inner.__qualname__
        known = isinstance(module, str) and holds(module, name, inner) and not reaches_out(name)
        return f"{module} {name}" if known else None
    return None


def _defaults(function: types.FunctionType) -> list[object]:
    return [*(function.__defaults__ or ()), *(function.__kwdefaults__ or {}).values()]
