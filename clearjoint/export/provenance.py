"""Texts about how results were computed: the settings of a run, and the versions of the
programs."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache, partial
from importlib.metadata import version

import jax
import numpy as np

LONGEST = 200
"""Largest number of characters by which an array is described."""
Notes = tuple[tuple[str, str | int | float], ...]
"""Pairs (name, text or number) that become attributes of a dataset and of its netCDF file."""


def describe(value: object) -> str:
    """Return a text that describes a value, such as "Tsit5(scan_kind=None)".

    Objects are described by the name of their class and by their fields, functions by their names.
    Arrays are cut off after `LONGEST` characters.
    """
    if isinstance(value, partial):
        return f"partial({describe([value.func, value.args, value.keywords])})"
    # Numbers are shown as in Python, since the `repr` of an array depends on NumPy's print options.
    if isinstance(value, np.ndarray | jax.Array | np.generic):
        text = repr(np.asarray(value).tolist())
        return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."
    if is_dataclass(value) and not isinstance(value, type):
        parts = [f"{f.name}={describe(getattr(value, f.name))}" for f in fields(value)]
        return f"{type(value).__name__}({', '.join(parts)})"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k}: {describe(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(describe(part) for part in value) + "]"
    if isinstance(value, str | int | float | bool | None):
        return repr(value)
    # A function has a name; of any other object only the class is known.
    return getattr(value, "__qualname__", type(value).__name__)


def described(values: Mapping[str, object]) -> dict[str, str]:
    """Return the text of each value by name, from `describe`."""
    return {name: describe(value) for name, value in values.items()}


def setting_notes(values: object) -> Notes:
    """Return the fields of a dataclass as notes: a pair ("setting_<field>", value) for each field.

    Numbers stay as they are; other values are described by texts.
    """
    by_name = {f.name: getattr(values, f.name) for f in fields(values)}  # pyright: ignore
    return tuple((f"setting_{name}", _note(value)) for name, value in by_name.items())


def _note(value: object) -> str | int | float:
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    return value if plain else describe(value)  # pyright: ignore


@cache
def versions() -> dict[str, str]:
    """Return the versions of clearjoint, JAX and diffrax as texts, under "version of <name>"."""
    return {f"version of {name}": version(name) for name in ("clearjoint", "jax", "diffrax")}
