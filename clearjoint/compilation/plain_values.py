"""Digests of values that consist only of numbers, texts, arrays, and code of known packages.

A digest is part of the key under which a compiled program is saved. The content of such a value and
the sources of these packages determine the program. Values that contain functions, classes or
instances of classes from other packages are refused, since a change of the sources of these would
not be noticed.
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
from jax.core import Tracer

from .package_code import PACKAGE, is_remembered

NUMERIC = ("diffrax", "equinox", "lineax", "optimistix")
"""Packages whose classes and functions, such as solvers and norms, are accepted like those of this
package. Their versions identify their sources."""
_DATA = (type(None), bool, int, float, complex, str, bytes, type(Ellipsis))
"""Types whose values are identified by their `repr`."""
_BASES = ("abc", "collections.abc", "enum", "typing")
"""Modules whose base classes are accepted, since they add no data of their own to an instance."""


class NotPlainError(Exception):
    """Raised for a value that `digest_of` cannot identify."""


def digest_of(value: object) -> str:
    """Return the digest of a value, 40 hexadecimal digits, which is the same in all processes.

    Values of the same types and content have the same digest. The types of numbers matter: 1 and
    1.0 have different digests. The order of the items of a dictionary matters, too. Arrays of NumPy
    and JAX with the same numbers, dtype and shape have the same digest.

    **Arguments:** `value`: may consist of

    - numbers, strings, bytes, ``None``, ``...``, arrays, dtypes and `jax.ShapeDtypeStruct`;
    - tuples, lists, dictionaries, frozen sets and `functools.partial`;
    - functions and classes that are members of a module of this package or of `NUMERIC`, instances
      of such classes, and their methods.

    **Raises:** `NotPlainError` for a value that contains anything else, an array that JAX traces,
    an array of objects, or itself, and for a value that is nested too deeply.

    >>> from clearjoint.compilation.plain_values import digest_of
    >>> one, same, other = (cj.Body(mass, (1.0, 1.0, 1.0)) for mass in (2.0, 2.0, 3.0))
    >>> digest_of(one) == digest_of(same), digest_of(one) == digest_of(other)
    (True, False)
    """
    try:
        text = repr(_nested(value))
    except RecursionError:
        raise NotPlainError("a value that contains itself") from None
    return hashlib.blake2b(text.encode(), digest_size=20).hexdigest()


def _nested(value: object) -> object:
    """Return nested tuples of plain Python values whose `repr` identifies the value.

    **Raises:** `RecursionError` for a value that contains itself or is nested too deeply;
    `NotPlainError` for other values that `digest_of` refuses.
    """
    # Exact types: an instance of a subclass could hold further data, and is handled last.
    kind = type(value)
    if kind in _DATA:
        return kind.__name__, value
    if kind in (tuple, list):
        return kind.__name__, *map(_nested, value)  # pyright: ignore
    if kind is frozenset:
        # Its order depends on the process.
        return kind.__name__, *sorted(repr(_nested(member)) for member in value)  # pyright: ignore
    if kind in (dict, OrderedDict, types.MappingProxyType):
        return kind.__name__, *((_nested(k), _nested(v)) for k, v in value.items())  # pyright: ignore
    if isinstance(value, Tracer):
        raise NotPlainError("an array that JAX traces, whose numbers are unknown")
    if kind is np.ndarray or isinstance(value, np.generic | jax.Array):
        return _array(np.asarray(value))
    if isinstance(value, np.dtype):
        return "dtype", value.name, value.str, value.descr
    if kind is functools.partial:
        return "partial", *map(_nested, (value.func, value.args, value.keywords))  # pyright: ignore
    if kind is types.MethodType:
        return "method", *map(_nested, (value.__func__, value.__self__))  # pyright: ignore
    if kind is jax.ShapeDtypeStruct:
        return "shape", value.shape, str(value.dtype), value.weak_type  # pyright: ignore
    # Functions and classes have a qualified name.
    if isinstance(getattr(value, "__qualname__", None), str):
        return _named(value)
    return _instance(value)


def _array(array: np.ndarray) -> object:
    if array.dtype.hasobject:
        raise NotPlainError("an array of objects")
    return "array", array.dtype.name, array.dtype.descr, array.shape, array.tobytes()


def _named(value: object) -> object:
    """Return a tuple with module and qualified name of a function or class.

    **Raises:** `NotPlainError` if the module does not belong to `NUMERIC` and is no module of this
    package whose objects are recorded (`is_remembered`), or if that name in the module refers
    neither to the value nor to a wrapper of it.
    """
    module, name = getattr(value, "__module__", None), getattr(value, "__qualname__", "")
    package = str(module).split(".")[0]
    accepted = is_remembered(str(module)) if package == PACKAGE else package in NUMERIC
    member = sys.modules.get(str(module)) if accepted else None
    for part in name.split("."):
        member = getattr(member, part, None)
    if member is not value and getattr(member, "__wrapped__", None) is not value:
        raise NotPlainError(f"{module}.{name}")
    return "named", module, name


def _instance(value: object) -> object:
    """Return a tuple with the class, the items and all attributes of an instance, including
    attributes that are not fields.

    **Raises:** `NotPlainError` if `digest_of` refuses the class, one of its base classes or an
    attribute, or if the instance has no attributes, fields or items that can be read.
    """
    cls = type(value)
    named = _named(cls)
    # Named tuples and enumerations of strings hold data as items.
    items = tuple(value) if isinstance(value, tuple | str) else ()
    # Data of these bases are part of `items` or of the attributes. Any other base class must be
    # that of an accepted package, since it might hold data that are not seen here.
    covered = (object, tuple, str, int if isinstance(value, enum.Enum) else object)
    for base in cls.__mro__[1:]:
        if base not in covered and base.__module__ not in _BASES:
            _named(base)
    attributes = dict(getattr(value, "__dict__", {}))
    if dataclasses.is_dataclass(value):
        names = [field.name for field in dataclasses.fields(value)]
        attributes |= {name: getattr(value, name) for name in names if hasattr(value, name)}
    elif not (items or hasattr(value, "__dict__")):
        raise NotPlainError(f"an instance of {cls.__qualname__}, whose data cannot be read")
    return "instance", named, _nested(items), _nested(attributes)
