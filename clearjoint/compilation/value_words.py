"""How values of each class are described: by their data, and by the code of their classes."""

import enum
import functools
import types
from collections import OrderedDict, namedtuple
from collections.abc import Callable, Iterable, Mapping
from dataclasses import Field

import jax
import numpy as np
from jax.sharding import Mesh, PartitionSpec

from .code_words import code_words, function_words
from .trusted_names import trusted_name
from .words import HEAP_TYPE, Part, UndescribedError, Unordered, Words

OF_NO_MATTER = frozenset(
    {
        "__abstractmethods__",
        "__annotate_func__",
        "__annotations__",
        "__dict__",
        "__doc__",
        "__firstlineno__",
        "__module__",
        "__orig_bases__",
        "__parameters__",
        "__slotnames__",
        "__static_attributes__",
        "__weakref__",
        "_abc_impl",
    }
)
"""Attributes of classes that compute nothing, or say again what others say."""
_TUPLE_GETTER = type(namedtuple("_Pair", "first").first)  # pyright: ignore


def words_of(value: object) -> Words:
    """The words for a value, in which those inside it are parts.

    **Raises:** `UndescribedError`, when they are taken, if the value is more than what can be seen
    in it.
    """
    if type(value) in _EXACT:
        return _EXACT[type(value)](value)
    for kinds, describe in _INHERITED:
        if isinstance(value, kinds):
            return describe(value)
    return _instance(value)


def _parts(kind: str, values: Iterable[object]) -> Words:
    return [kind, *map(Part, values)]


def _mapping(value: Mapping[object, object]) -> Words:
    return [type(value).__name__, *(Part(x) for item in value.items() for x in item)]


def _sequence(value: Iterable[object]) -> Words:
    return [Part(type(value)), *map(Part, value)]


def _set(value: Iterable[object]) -> Words:
    return ["set", type(value).__name__, Unordered(value)]


def _array(value: np.ndarray | np.generic | jax.Array) -> Words:
    array = np.asarray(value)
    if array.dtype.hasobject:
        raise UndescribedError(value)
    return ["array", array.dtype.str, array.shape, array.tobytes()]


def _mesh(mesh: Mesh) -> Words:
    devices = [(d.id, d.platform, d.device_kind) for d in mesh.devices.flat]
    return ["mesh", mesh.devices.shape, devices, mesh.axis_names, mesh.axis_types]


def _structure(value: jax.tree_util.PyTreeDef) -> Words:  # pyright: ignore
    places = range(value.num_leaves)
    return ["structure", value.num_leaves, Part(jax.tree.unflatten(value, places))]


def _enumerated(value: enum.Enum) -> Words:
    return ["enum", Part(type(value)), value.name]


def _module(value: types.ModuleType) -> Words:
    raise UndescribedError(f"module {value.__name__}")


def _class(cls: type) -> Words:
    """A class by its bases and by what stands in it."""
    yield from ("class", cls.__module__, cls.__qualname__, Part(type(cls)))
    yield from map(Part, cls.__bases__)
    for name, value in sorted(vars(cls).items()):
        if name not in OF_NO_MATTER:
            yield from (name, Part(value))


def _field(field: Field) -> Words:
    settings = (field.default, field.default_factory, dict(field.metadata))
    switches = (field.init, field.repr, field.hash, field.compare, field.kw_only)
    return ["field", field.name, *map(Part, settings), *map(Part, switches)]


def _wrapped(value: staticmethod | classmethod) -> Words:
    return [type(value).__name__, Part(value.__func__)]


def _property(value: property) -> Words:
    return _parts("property", (value.fget, value.fset, value.fdel))


def _cached_property(value: functools.cached_property) -> Words:
    return _parts("cached property", (value.func,))


def _method(value: types.MethodType) -> Words:
    return _parts("method", (value.__func__, value.__self__))


def _partial(value: functools.partial) -> Words:
    return _parts("partial", (value.func, value.args, value.keywords))


def _builtin(value: types.BuiltinFunctionType) -> Words:
    """A function written in C, of an object that is described with it."""
    if value.__self__ is None or isinstance(value.__self__, types.ModuleType):
        raise UndescribedError(value)
    return ["bound", value.__name__, Part(value.__self__)]


def _descriptor(value: types.MemberDescriptorType) -> Words:
    """An attribute written in C, of a class that is described with it."""
    return ["descriptor", type(value).__name__, value.__name__, Part(value.__objclass__)]


def _shown(value: object) -> Words:
    """What is known by its text."""
    return ["shown", type(value).__name__, repr(value)]


def _instance(value: object) -> Words:
    """A value of a class written in Python, by its attributes; or by its pickled state, if a
    trusted class says what that is."""
    cls = type(value)
    if cls.__module__ in ("typing", "types", "typing_extensions"):
        return _shown(value)
    if any(c is not object and not _is_written_in_python(c) for c in cls.__mro__):
        raise UndescribedError(value)
    if "__getstate__" in vars(cls) and trusted_name(cls):
        return ["instance", Part(cls), Part(value.__getstate__())]
    slots = {
        name
        for owner in cls.__mro__
        for name, place in vars(owner).items()
        if isinstance(place, types.MemberDescriptorType)
    }
    attributes = {name: getattr(value, name) for name in slots if hasattr(value, name)}
    attributes |= getattr(value, "__dict__", {})
    words: list[object] = ["instance", Part(cls)]
    for name, content in sorted(attributes.items()):
        words += [name, Part(content)]
    return words


def _is_written_in_python(cls: type) -> bool:
    heap = bool(cls.__flags__ & HEAP_TYPE)
    return heap and not type(cls).__name__.startswith("nb_type")


_EXACT: Mapping[type, Callable[..., Words]] = types.MappingProxyType(
    {
        list: _sequence,
        tuple: _sequence,
        dict: _mapping,
        OrderedDict: _mapping,
        types.MappingProxyType: _mapping,
        set: _set,
        frozenset: _set,
        types.FunctionType: function_words,
        types.CodeType: code_words,
        types.MethodType: _method,
        types.BuiltinFunctionType: _builtin,
        types.GetSetDescriptorType: _descriptor,
        types.MemberDescriptorType: _descriptor,
        types.WrapperDescriptorType: _descriptor,
        types.MethodDescriptorType: _descriptor,
        types.ClassMethodDescriptorType: _descriptor,
        functools.partial: _partial,
        functools.cached_property: _cached_property,
        property: _property,
        staticmethod: _wrapped,
        classmethod: _wrapped,
        Field: _field,
        Mesh: _mesh,
        PartitionSpec: _shown,
    }
)
"""How values of a class are described."""
_INHERITED: tuple[tuple[type | types.UnionType, Callable[..., Words]], ...] = (
    (enum.Enum, _enumerated),
    (np.ndarray | np.generic | jax.Array, _array),
    (type(jax.tree.structure(0)), _structure),
    (np.dtype | _TUPLE_GETTER | types.GenericAlias | types.UnionType, _shown),
    (type, _class),
    (tuple, _sequence),
    (types.ModuleType, _module),
)
"""And those of a class or any below it."""
