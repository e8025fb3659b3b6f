"""Digests of values that consist only of data, and of functions and classes of known packages.

A digest is part of the key under which a compiled program is saved. Functions, classes and their
instances from elsewhere are refused, since a change of their sources would not be noticed.
"""

import sys
import types
from collections.abc import Iterator

import jax
import numpy as np
from jax.core import Tracer

from .digests import LONG, digest
from .package_code import PACKAGE

VERSIONED = (
    *("beartype", "diffrax", "equinox", "jax", "jaxlib", "jaxtyping", "lineax", "ml_dtypes"),
    *("numpy", "optimistix"),
)
"""Packages whose versions identify their sources."""
_KNOWN = {PACKAGE, *VERSIONED, "builtins", "collections", "copyreg", "functools", "types"}
"""Packages whose functions and classes are accepted. Most modules of Python's library are not,
because a user's file such as ``profile.py`` may have the name of one."""
_DATA = (type(None), bool, int, float, complex, str, bytes, type(Ellipsis))
"""Types whose values are identified by their `repr`."""


class NotPlainError(Exception):
    """Raised for a value that `digest_of` cannot identify."""


def digest_of(value: object) -> str:
    """Return the digest of a value, 40 hexadecimal digits, which is the same in all processes.

    The numbers 1 and 1.0 have different digests, as have dictionaries with their items in different
    orders. Arrays of NumPy and JAX with the same numbers, dtype and shape have the same digest. A
    value may consist of

    - numbers, strings, bytes, ``None``, ``...``, arrays, tuples, lists, dictionaries, frozen sets;
    - functions and classes of this package, of the packages `VERSIONED`, or of a few modules of
      Python, such as `functools`; and methods and instances of these that can be pickled.

    **Raises:** `NotPlainError` for a value that contains anything else, such as an array that JAX
    traces or an array of objects, that contains itself, or that is nested too deeply.
    """
    try:
        return digest(repr(_nested(value)), digits=LONG)
    except RecursionError:
        raise NotPlainError("a value that contains itself") from None


def _nested(value: object) -> object:
    """Return nested tuples of plain Python values whose `repr` identifies the value."""
    # Exact types: an instance of a subclass could hold further data, and is handled last.
    kind = type(value)
    if kind in _DATA:
        return kind.__name__, value
    if kind in (tuple, list):
        return kind.__name__, *map(_nested, value)  # pyright: ignore
    if kind is frozenset:
        # Its order depends on the process.
        return kind.__name__, *sorted(repr(_nested(member)) for member in value)  # pyright: ignore
    if kind in (dict, types.MappingProxyType):
        return kind.__name__, *((_nested(k), _nested(v)) for k, v in value.items())  # pyright: ignore
    if isinstance(value, Tracer):
        raise NotPlainError("an array that JAX traces, whose numbers are unknown")
    if kind is np.ndarray or isinstance(value, np.generic | jax.Array):
        array = np.asarray(value)
        if array.dtype.hasobject:
            raise NotPlainError("an array of objects")
        return "array", array.dtype.name, array.dtype.descr, array.shape, array.tobytes()
    if kind is types.MethodType:
        return "method", *map(_nested, (value.__func__, value.__self__))  # pyright: ignore
    # Functions and classes have a qualified name.
    if isinstance(getattr(value, "__qualname__", None), str):
        return _named(value)
    named_class = _named(kind)
    # An instance is identified by what `pickle` would save of it.
    try:
        reduced = value.__reduce_ex__(4)
    except (TypeError, ValueError):
        reduced = None
    if not isinstance(reduced, tuple):
        raise NotPlainError(f"an instance of {kind.__qualname__}, whose data cannot be read")
    # `pickle` gets the items of subclasses of lists and dictionaries by iterators.
    parts = [list(part) if isinstance(part, Iterator) else part for part in reduced]
    return "instance", named_class, *map(_nested, parts)


def _named(value: object) -> object:
    """Return module and qualified name of a function or class of a known package.

    **Raises:** `NotPlainError` for another package, or if this name in this module refers neither
    to `value` nor to a wrapper of `value`.
    """
    module, name = str(getattr(value, "__module__", None)), getattr(value, "__qualname__", "")
    # A qualified name leads from the module to the value, through classes. From a module that is
    # not known or not loaded, it leads to `None`.
    member = sys.modules.get(module) if module.split(".")[0] in _KNOWN else None
    for part in name.split("."):
        member = getattr(member, part, None)
    if member is not value and getattr(member, "__wrapped__", None) is not value:
        raise NotPlainError(f"{module}.{name}")
    return "named", module, name
