"""What values are, in words that another process would use too: their data, and their code.

A value that holds a class or a function, of a notebook say, is described by all that this can
reach: its code, bases, defaults, closures, and globals of its module that it uses, helpers in other
files among them. Code of this package and of trusted ones is described by its name. What can't be
described raises `UndescribedError`.
"""

import dis
import enum
import functools
import hashlib
import sys
import types
from collections import OrderedDict, deque, namedtuple
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import Field

import jax
import numpy as np
from jax.sharding import Mesh, PartitionSpec

from .trusted_code import (
    HIDDEN_ATTRIBUTES,
    holds,
    is_builtin,
    is_trusted,
    reaches_out,
    wrote,
)

Words = Iterable[object]
"""Strings, bytes, and `Part`s."""
DATA = (type(None), bool, int, float, complex, str, bytes, type(Ellipsis), type(NotImplemented))
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
_JITTED = type(jax.jit(len))
_TUPLE_GETTER = type(namedtuple("_Pair", "first").first)  # pyright: ignore
_HEAP_TYPE = 1 << 9
"""Flag of classes that are made while Python runs."""


class UndescribedError(Exception):
    """A value that is more than what can be seen in it."""


class Part:
    """A value inside another, to be described on its own."""

    def __init__(self, value: object):
        self.value = value


class Description:
    """The digest of values and of all that they can reach.

    Each value is described once, and where it occurs again by its number, so that values may hold
    one another.
    """

    def __init__(self) -> None:
        self._hash = hashlib.blake2b(digest_size=20)
        self._numbers: dict[int, int] = {}
        self._waiting: deque[object] = deque()
        self._kept: list[object] = []
        self.packages: set[str] = set()
        """Modules of trusted classes and functions that occur."""

    def add(self, value: object) -> None:
        """Describe a value."""
        self._write([Part(value)])
        while self._waiting:
            self._write(self._words(self._waiting.popleft()))

    def digest(self) -> str:
        """Of all that has been described."""
        return self._hash.hexdigest()

    def _write(self, words: Words) -> None:
        for word in words:
            content = self._reference(word.value) if isinstance(word, Part) else word
            content = content if isinstance(content, bytes) else str(content).encode()
            self._hash.update(b"%d:" % len(content))
            self._hash.update(content)
        self._hash.update(b";")

    def _reference(self, value: object) -> str:
        """Data itself; for anything else its number, and it is described later."""
        if type(value) in DATA:
            return f"{type(value).__name__} {value!r}"
        if (name := _trusted_name(value)) is not None:
            self.packages.add(name.split(" ")[0])
            return name
        if id(value) not in self._numbers:
            self._numbers[id(value)] = len(self._numbers)
            self._kept.append(value)
            self._waiting.append(value)
        return f"#{self._numbers[id(value)]}"

    def _words(self, value: object) -> Words:
        if type(value) in _EXACT:
            return _EXACT[type(value)](value)
        for kinds, describe in _INHERITED:
            if isinstance(value, kinds):
                return describe(value)
        return _instance(value)


def _trusted_name(value: object) -> str | None:
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
    if isinstance(inner, type) and not inner.__flags__ & _HEAP_TYPE:
        return f"{inner.__module__} {inner.__qualname__}"
    if isinstance(inner, type | types.BuiltinFunctionType):
        module, name = getattr(inner, "__module__", None), inner.__qualname__
        known = isinstance(module, str) and holds(module, name, inner) and not reaches_out(name)
        return f"{module} {name}" if known else None
    return None


def _defaults(function: types.FunctionType) -> list[object]:
    return [*(function.__defaults__ or ()), *(function.__kwdefaults__ or {}).values()]


def _parts(kind: str, values: Iterable[object]) -> Words:
    return [kind, *map(Part, values)]


def _mapping(value: Mapping[object, object]) -> Words:
    return [type(value).__name__, *(Part(x) for item in value.items() for x in item)]


def _sequence(value: Iterable[object]) -> Words:
    return [Part(type(value)), *map(Part, value)]


def _set(value: Iterable[object]) -> Words:
    return ["set", type(value).__name__, *sorted(map(described, value))]


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


def _code(code: types.CodeType) -> Words:
    """A function's code, but for where it stands."""
    counts = code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags
    names = code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars, code.co_name
    table = getattr(code, "co_exceptiontable", b"")
    return ["code", code.co_code, table, *counts, *map(str, names), *map(Part, code.co_consts)]


def _function(function: types.FunctionType) -> Words:
    """A function's code, and what it uses beside its arguments."""
    yield from ("function", function.__qualname__, Part(function.__code__))
    yield from map(Part, (function.__defaults__, function.__kwdefaults__, vars(function)))
    for cell in function.__closure__ or ():
        try:
            yield Part(cell.cell_contents)
        except ValueError:
            yield "empty"
    if not wrote(function.__code__):
        yield from _used(function.__code__, function.__globals__)


def _used(code: types.CodeType, names: Mapping[str, object]) -> Iterator[object]:
    """The globals that code uses, and of modules among them what it may take out of them."""
    read, attributes = _globals_of(code), sorted(_attributes_of(code))
    if hidden := [*filter(reaches_out, read), *HIDDEN_ATTRIBUTES.intersection(attributes)]:
        raise UndescribedError(hidden)
    for name in read:
        value = names.get(name)
        if name not in names:
            yield from ("builtin" if is_builtin(name) else "missing", name)
        elif isinstance(value, types.ModuleType):
            yield from (name, *_used_of(value, attributes, "getattr" in read))
        else:
            yield from (name, Part(value))


def _used_of(
    module: types.ModuleType, attributes: Iterable[str], by_any_name: bool
) -> Iterator[object]:
    """What code that has such names in it may take out of a module, and of modules in it."""
    yield f"module {module.__name__}"
    held, trusted = vars(module), _trusted_name(module) is not None
    found = [name for name in attributes if name in held]
    if trusted and (by_any_name or any(map(reaches_out, found))):
        raise UndescribedError(module)
    standard = module.__name__.split(".")[0] in sys.stdlib_module_names
    if not trusted and (standard or "__getattr__" in held or by_any_name):
        raise UndescribedError(module)
    for name in found:
        value = held[name]
        if not isinstance(value, types.ModuleType):
            yield from (name, () if trusted else Part(value))
        elif trusted and not is_trusted(value.__name__):
            raise UndescribedError(value)
        else:
            rest = [other for other in attributes if other != name]
            yield from (name, *_used_of(value, rest, by_any_name))


def _globals_of(code: types.CodeType) -> list[str]:
    """Names of globals, in the order in which code uses them, inner functions included.

    Modules that it imports on its own are none of them, so that they are refused.
    """
    found: dict[str, None] = {}
    for line in dis.get_instructions(code):
        if line.opname in ("LOAD_GLOBAL", "LOAD_NAME", "LOAD_FROM_DICT_OR_GLOBALS"):
            found[str(line.argval)] = None
        elif line.opname in ("IMPORT_NAME", "STORE_GLOBAL", "DELETE_GLOBAL"):
            raise UndescribedError(f"{line.opname} {line.argval}")
    inner = [name for part in _inner(code) for name in _globals_of(part)]
    return list(dict.fromkeys([*found, *inner]))


def _attributes_of(code: types.CodeType) -> set[str]:
    names = set(code.co_names)
    return names.union(*(_attributes_of(part) for part in _inner(code)))


def _inner(code: types.CodeType) -> list[types.CodeType]:
    return [part for part in code.co_consts if isinstance(part, types.CodeType)]


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
    if "__getstate__" in vars(cls) and _trusted_name(cls):
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
    heap = bool(cls.__flags__ & _HEAP_TYPE)
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
        types.FunctionType: _function,
        types.CodeType: _code,
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


def described(value: object) -> str:
    """The digest of one value."""
    description = Description()
    description.add(value)
    return description.digest()
