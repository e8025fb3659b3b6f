"""What the package is in this process: its source, and what its modules hold.

Constants and functions that were put into a module in the place of its own are not in its source.
"""

import contextvars
import functools
import hashlib
import os
import sys
import threading
import types
from collections.abc import Iterable, Iterator
from functools import cache

from .description import Description
from .trusted_code import PACKAGE, wrote
from .value_words import OF_NO_MATTER

_SETTINGS = (f"{PACKAGE}.runtime", f"{PACKAGE}.compilation")
"""Modules whose variables are those of the process; nothing in them is traced."""
_SEALED = (type(threading.Lock()), contextvars.ContextVar, set)
"""What changes while a process runs, and is no constant."""


@cache
def source() -> str:
    """The digest of all source files."""
    folder = os.path.dirname(sys.modules[PACKAGE].__file__ or "")
    whole = hashlib.blake2b(digest_size=20)
    for parent, folders, files in os.walk(folder):
        folders.sort()
        for name in sorted(name for name in files if name.endswith(".py")):
            path = os.path.join(parent, name)
            with open(path, "rb") as file:
                content = file.read()
            whole.update(f"{os.path.relpath(path, folder)} {len(content)} ".encode() + content)
    return whole.hexdigest()


def held(modules: Iterable[str]) -> list[str]:
    """Digests of what modules of the package hold, and of what those hold that they use.

    **Raises:** `UndescribedError` if something in them can't be described.
    """
    seen: dict[str, str] = {}
    waiting = {name for name in modules if _is_own(name)}
    while waiting:
        name = waiting.pop()
        seen[name], used = _module_state(name)
        waiting |= used - set(seen)
    return [f"{name} {digest}" for name, digest in sorted(seen.items())]


_states: dict[str, tuple[list[object], tuple[str, set[str]]]] = {}
"""By module what it held when it was last described, and the description."""


def _module_state(name: str) -> tuple[str, set[str]]:
    """The digest of what a module holds, and the names of the package's modules that it uses."""
    things = list(_things(sys.modules[name]))
    known = _states.get(name)
    if known is None or not _same(known[0], things):
        whole, used = Description(), set()
        for label, thing in zip(things[::2], things[1::2], strict=True):
            description = Description()
            _describe(description, thing)
            used |= set(filter(_is_own, description.packages))
            whole.add(label)
            whole.add(description.digest())
        known = _states[name] = things, (whole.digest(), used)
    return known[1]


def _same(before: list[object], now: list[object]) -> bool:
    return len(before) == len(now) and all(map(_is, before, now))


def _is(one: object, other: object) -> bool:
    return one is other or (type(one) is str and one == other)


def _things(module: types.ModuleType) -> Iterator[object]:
    """Names and values in a module and in its classes, in turn."""
    for name, value in list(vars(module).items()):
        if name.startswith("__"):
            continue
        yield from (name, value)
        if isinstance(value, type) and value.__module__ == module.__name__:
            for attribute, inner in vars(value).items():
                if attribute not in _IN_SOURCE and not isinstance(inner, _UNTOUCHED):
                    yield from (attribute, inner)


_IN_SOURCE = {*OF_NO_MATTER, "__dataclass_fields__", "__dataclass_params__"}
_UNTOUCHED = (
    types.GetSetDescriptorType,
    types.MemberDescriptorType,
    types.WrapperDescriptorType,
    types.NoneType,
    str,
)


def _describe(description: Description, thing: object) -> None:
    """Describe what a module or a class of the package holds."""
    if isinstance(thing, staticmethod | classmethod):
        thing = thing.__func__
    if isinstance(thing, functools.cached_property):
        thing = thing.func
    if isinstance(thing, types.FunctionType) and thing.__code__.co_filename == "<string>":
        # Made by `dataclass` of what stands in the class.
        description.add(("made", thing.__qualname__, thing.__code__.co_code))
    elif isinstance(thing, types.FunctionType) and wrote(thing.__code__):
        line = thing.__code__.co_firstlineno
        description.add((thing.__module__, thing.__qualname__, line))
        description.packages.add(thing.__module__)
    elif isinstance(thing, types.ModuleType):
        description.add(("module", thing.__name__))
        description.packages.add(thing.__name__)
    elif isinstance(thing, _NAMED) and _is_importable(thing):
        description.add((thing.__module__, thing.__qualname__))
        description.packages.add(thing.__module__)
    elif isinstance(thing, _SEALED):
        description.add(type(thing).__name__)
    elif isinstance(thing, functools._lru_cache_wrapper):
        _describe(description, thing.__wrapped__)
    else:
        description.add(thing)


_NAMED = (type, types.FunctionType, types.BuiltinFunctionType)


def _is_importable(thing: type | types.FunctionType | types.BuiltinFunctionType) -> bool:
    """Whether a class or a function is what a module has under the name that it goes by."""
    module = sys.modules.get(thing.__module__ or "")
    return getattr(module, thing.__qualname__, None) is thing


def _is_own(module: str) -> bool:
    own = module.split(".")[0] == PACKAGE and not module.startswith(_SETTINGS)
    return own and module in sys.modules
