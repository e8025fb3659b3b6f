"""Whether two trees of objects are the same to the last bit."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass

import jax
import numpy as np

from .complaints import FilePlace

ARRAYS = np.ndarray | np.generic | jax.Array


def first_difference(one: object, other: object, place: FilePlace) -> FilePlace | None:
    """Where two trees differ first; ``None`` if they are the same. Arrays of numpy and of JAX are
    the same if type and bits of their numbers are."""
    if isinstance(one, ARRAYS) and isinstance(other, ARRAYS):
        return None if _bits(one) == _bits(other) else place
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return _first(dict(one), dict(other), place)
    if type(one) is not type(other):
        return place
    if is_dataclass(one) and not isinstance(one, type):
        names = [field.name for field in fields(one)]
        values = [{name: getattr(node, name, None) for name in names} for node in (one, other)]
        return _first(values[0], values[1], place)
    if isinstance(one, tuple | list) and isinstance(other, tuple | list):
        return _first(dict(enumerate(one)), dict(enumerate(other)), place)
    if isinstance(one, float):
        return None if _bits(one) == _bits(other) else place
    return None if one == other else place


def _first(ones: dict, others: dict, place: FilePlace) -> FilePlace | None:
    if set(ones) != set(others):
        return place
    for key in ones:
        found = first_difference(ones[key], others[key], place.at(key))
        if found is not None:
            return found
    return None


def _bits(value: object) -> tuple[object, ...]:
    array = np.asarray(value)
    return array.shape, array.dtype, array.tobytes()
