"""What decides the numbers of a sweep, as texts by which a store knows its own."""

import hashlib
import inspect
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from importlib.metadata import version
from types import FunctionType
from typing import Any

import jax
import numpy as np

from ..parameters import parameters

LONGEST = 200


def describe(value: Any) -> str:
    """A text that is equal for equal values, in every process."""
    if isinstance(value, FunctionType):
        return f"{value.__qualname__} {_digest(_source(value))}{_captured(value)}"
    if isinstance(value, np.ndarray | jax.Array | np.generic):
        return _shortened(repr(np.asarray(value).tolist()))
    if is_dataclass(value) and not isinstance(value, type):
        parts = [f"{f.name}={describe(getattr(value, f.name))}" for f in fields(value)]
        return f"{type(value).__name__}({', '.join(parts)})"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k}: {describe(v)}" for k, v in sorted(value.items())) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(describe(part) for part in value) + "]"
    if isinstance(value, str | int | float | bool | None):
        return repr(value)
    return getattr(value, "__qualname__", type(value).__qualname__)


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
    return {f"version of {name}": version(name) for name in ("clearjoint", "jax", "diffrax")}


def _captured(function: FunctionType) -> str:
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    values = [*cells, *(function.__defaults__ or ())]
    return f" with {describe(values)}" if values else ""


def _source(function: FunctionType) -> str:
    try:
        return inspect.getsource(function).strip()
    except (OSError, TypeError):
        return repr((function.__code__.co_code, function.__code__.co_consts))


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def _shortened(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}... {_digest(text)}"
