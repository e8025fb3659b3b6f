"""What functions are: their code, and what that uses beside its arguments."""

import dis
import sys
import types
from collections.abc import Iterable, Iterator, Mapping

from .trusted_code import HIDDEN_ATTRIBUTES, is_builtin, is_trusted, reaches_out, wrote
from .trusted_names import trusted_name
from .words import Part, UndescribedError, Words


def code_words(code: types.CodeType) -> Words:
    """A function's code, but for where it stands."""
    counts = code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags
    names = code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars, code.co_name
    table = getattr(code, "co_exceptiontable", b"")
    return ["code", code.co_code, table, *counts, *map(str, names), *map(Part, code.co_consts)]


def function_words(function: types.FunctionType) -> Words:
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
    held, trusted = vars(module), trusted_name(module) is not None
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
