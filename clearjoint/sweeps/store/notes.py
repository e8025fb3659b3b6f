"""What was run, as texts for a reader. They decide nothing: see `.identity`."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache, partial
from importlib.metadata import version

import jax
import numpy as np
from jaxtyping import PyTree

from ...model.scene import Scene
from ...parametrisation.places import parameters

LONGEST = 200
_VERSIONED = ("clearjoint", "jax", "diffrax")


def describe(value: object) -> str:
    """A text with the names of classes and functions and the numbers that they hold."""
    if isinstance(value, partial):
        return f"partial({describe([value.func, value.args, value.keywords])})"
    if isinstance(value, np.ndarray | jax.Array | np.generic):
        return _shortened(repr(np.asarray(value).tolist()))
    if is_dataclass(value) and not isinstance(value, type):
        parts = [f"{f.name}={describe(getattr(value, f.name))}" for f in fields(value)]
        return f"{type(value).__name__}({', '.join(parts)})"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k}: {describe(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(describe(part) for part in value) + "]"
    if isinstance(value, str | int | float | bool | None):
        return repr(value)
    return getattr(value, "__qualname__", type(value).__name__)


def described(values: Mapping[str, object]) -> dict[str, str]:
    """The text of each value, by name."""
    return {name: describe(value) for name, value in values.items()}


def number_notes(tree: PyTree, varied: PyTree[bool], name: str) -> dict[str, str]:
    """The numbers of a scene or state by name, without those of which a tree of booleans says that
    they vary."""
    varies = {key: any(jax.tree.leaves(flags)) for key, (flags, _) in parameters(varied).items()}
    return {
        f"{name}.{key}": describe(value)
        for key, (value, _) in parameters(tree).items()
        if not varies[key]
    }


def structure_note(scene: Scene) -> str:
    """Names, kinds and choices of a scene, without its numbers."""
    return describe(jax.tree.map(lambda _: 0, scene))


@cache
def versions() -> dict[str, str]:
    """Versions of what computes."""
    return {f"version of {name}": version(name) for name in _VERSIONED}


def _shortened(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."
