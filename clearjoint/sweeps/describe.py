"""What decides the numbers of a sweep, as texts by which a store knows its own."""

import hashlib
import inspect
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import partial
from importlib.metadata import version
from types import CodeType, FunctionType, MethodType
from typing import Any

import jax
import numpy as np

from ..parameters import parameters

LONGEST = 200
_VERSIONED = ("clearjoint", "jax", "diffrax")
"""Packages whose versions are settings, so that the code of their classes need not be."""


def describe(value: Any) -> str:
    """A text that is equal for equal values, in every process."""
    if isinstance(value, FunctionType):
        return f"{value.__qualname__} {_digest(_source(value))}{_captured(value)}"
    if isinstance(value, partial):
        return f"partial({describe([value.func, value.args, value.keywords])})"
    if isinstance(value, MethodType):
        return f"{describe(value.__func__)} of {describe(value.__self__)}"
    if hasattr(value, "__wrapped__"):
        return describe(value.__wrapped__)
    if isinstance(value, np.ndarray | jax.Array | np.generic):
        return _shortened(repr(np.asarray(value).tolist()))
    if is_dataclass(value) and not isinstance(value, type):
        parts = [f"{f.name}={describe(getattr(value, f.name))}" for f in fields(value)]
        return f"{_class(type(value))}({', '.join(parts)})"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k}: {describe(v)}" for k, v in sorted(value.items())) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(describe(part) for part in value) + "]"
    if isinstance(value, str | int | float | bool | None):
        return repr(value)
    if hasattr(value, "__qualname__"):
        return value.__qualname__
    return f"{_class(type(value))}{describe(getattr(value, '__dict__', {}))}"


def scene_settings(scene: Any, state: Any) -> dict[str, str]:
    """The numbers of scene and state, by name."""
    named = {f"scene.{name}": value for name, (value, _) in parameters(scene).items()}
    named |= {f"state.{name}": value for name, (value, _) in parameters(state).items()}
    return {name: describe(value) for name, value in named.items()}


def structure_setting(scene: Any) -> str:
    """Names, kinds and choices of a scene, without its numbers."""
    return _digest(describe(jax.tree.map(lambda _: 0, scene)))


def versions() -> dict[str, str]:
    """Versions of what computes."""
    return {f"version of {name}": version(name) for name in _VERSIONED}


def _captured(function: FunctionType) -> str:
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    values = [*cells, *(function.__defaults__ or ())]
    return f" with {describe(values)}" if values else ""


def _class(of: type) -> str:
    """Its name, and for one of the user's own what its code says."""
    if of.__module__.partition(".")[0] in _VERSIONED:
        return of.__name__
    return f"{of.__name__} {_digest(_source(of))}"


def _source(of: type | FunctionType) -> str:
    try:
        return inspect.getsource(of).strip()
    except (OSError, TypeError):
        if isinstance(of, FunctionType):
            return _compiled(of.__code__)
        return "".join(_source(f) for f in vars(of).values() if isinstance(f, FunctionType))


def _compiled(code: CodeType) -> str:
    """What a function does, from its code alone; addresses and line numbers left out."""
    constants = [_compiled(c) if isinstance(c, CodeType) else repr(c) for c in code.co_consts]
    return repr((code.co_code, code.co_names, code.co_varnames, constants))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def _shortened(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}... {_digest(text)}"
