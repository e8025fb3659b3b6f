"""Values that consist of this package's classes, numbers, strings and arrays only.

What a program does with such a value is known from the sources of the package and from the value's
fields. `digest_of` gives a digest of such a value, which is the same in every process, and refuses
every value that holds a function, a class, or an instance of a class, of another origin.
"""

import dataclasses
import enum
import functools
import hashlib
import sys
import types
from collections import OrderedDict

import jax
import numpy as np

from .package_code import PACKAGE, is_remembered

NUMERIC = ("diffrax", "equinox", "lineax", "optimistix")
"""Packages in Python alone whose classes and functions (solvers, controllers, norms) are accepted
as those of this package are; their versions stand for their sources."""
_DATA = (type(None), bool, int, float, complex, str, bytes, type(Ellipsis))
_BASES = ("abc", "collections.abc", "enum", "typing")
"""Modules of base classes that hold no data."""


class NotPlainError(Exception):
    """A value that holds more than this package's classes, numbers, strings and arrays."""


def digest_of(value: object) -> str:
    """The digest of a value, equal in all processes for equal values.

    **Raises:** `NotPlainError` unless the value consists of numbers, strings, bytes, arrays,
    tuples, lists and dictionaries, and of functions, classes and their instances that a module of
    this package or of `NUMERIC` has under their names.

    >>> from clearjoint.compilation.plain_values import digest_of
    >>> one, same, other = (cj.Body(mass, (1.0, 1.0, 1.0)) for mass in (2.0, 2.0, 3.0))
    >>> digest_of(one) == digest_of(same), digest_of(one) == digest_of(other)
    (True, False)
    """
    try:
        text = repr(_form(value))
    except RecursionError:
        raise NotPlainError("a value that holds itself") from None
    return hashlib.blake2b(text.encode(), digest_size=20).hexdigest()


def _form(value: object) -> object:
    """Nested tuples of strings, numbers and bytes, whose `repr` differs for different values."""
    kind = type(value)
    if kind in _DATA:
        return kind.__name__, value
    if kind in (tuple, list):
        return kind.__name__, *map(_form, value)  # pyright: ignore
    if kind in (dict, OrderedDict, types.MappingProxyType):
        return kind.__name__, *((_form(k), _form(v)) for k, v in value.items())  # pyright: ignore
    if kind is np.ndarray or isinstance(value, np.generic | jax.Array):
        return _array(np.asarray(value))
    if isinstance(value, np.dtype):
        return "dtype", value.name, value.str, value.descr
    if kind is functools.partial:
        return "partial", *map(_form, (value.func, value.args, value.keywords))  # pyright: ignore
    if kind is types.MethodType:
        return "method", *map(_form, (value.__func__, value.__self__))  # pyright: ignore
    if kind is jax.ShapeDtypeStruct:
        return "shape", value.shape, str(value.dtype)  # pyright: ignore
    if isinstance(getattr(value, "__qualname__", None), str):
        return _named(value)
    return _instance(value)


def _array(array: np.ndarray) -> object:
    if array.dtype.hasobject:
        raise NotPlainError("an array of objects")
    return "array", array.dtype.name, array.dtype.descr, array.shape, array.tobytes()


def _named(value: object) -> object:
    """The name of a function or a class, if a module of the packages has it under that name, or a
    wrapper of it."""
    module, name = getattr(value, "__module__", None), getattr(value, "__qualname__", "")
    package = str(module).split(".")[0]
    accepted = is_remembered(str(module)) if package == PACKAGE else package in NUMERIC
    found = sys.modules.get(str(module)) if accepted else None
    for part in name.split("."):
        found = getattr(found, part, None)
    if found is not value and getattr(found, "__wrapped__", None) is not value:
        raise NotPlainError(f"{module}.{name}")
    return "named", module, name


def _instance(value: object) -> object:
    """The class of an instance, and all its attributes, of which those beyond the fields of a
    dataclass are part too."""
    cls = type(value)
    named = _named(cls)
    items = tuple(value) if isinstance(value, tuple | str) else ()
    described_here = (object, tuple, str, int if isinstance(value, enum.Enum) else object)
    for base in cls.__mro__[1:]:
        if base not in described_here and base.__module__ not in _BASES:
            _named(base)
    attributes = dict(getattr(value, "__dict__", {}))
    if dataclasses.is_dataclass(value):
        names = [field.name for field in dataclasses.fields(value)]
        attributes |= {name: getattr(value, name) for name in names if hasattr(value, name)}
    elif not (items or hasattr(value, "__dict__")):
        raise NotPlainError(f"an instance of {cls.__qualname__}, whose data can't be seen")
    return "instance", named, _form(items), _form(attributes)
