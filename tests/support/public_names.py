"""What users may import, and what is said of it."""

import ast
import importlib
import importlib.util
import inspect
import types
from dataclasses import dataclass
from functools import cache

PARTS = "extend films frictions laws mechanisms plot presets profiles quantities results testing"
MODULES = "clearjoint", *(f"clearjoint.{part}" for part in PARTS.split())
"""Where public names are imported from."""


@dataclass(frozen=True)
class PublicName:
    """A name that users import.

    - `source`: the module that they import it from; `origin`: the one that defines it.
    - `docstring`: of values that can't have one, the text below their definition.
    """

    name: str
    source: str
    origin: str
    value: object
    docstring: str


def public_names() -> list[PublicName]:
    """All public names, module by module; one that several modules export is there for each."""
    found = []
    for source in MODULES:
        module = importlib.import_module(source)
        for name, value in vars(module).items():
            if not name.startswith("_") and not isinstance(value, types.ModuleType):
                origin = _origin(source, name)
                found.append(PublicName(name, source, origin[0], value, _docstring(value, *origin)))
    return found


def concrete_classes(*bases: type) -> set[str]:
    """The names of all public classes that derive from one of the base classes and can be made."""
    return {
        public.name
        for public in public_names()
        if inspect.isclass(public.value)
        and issubclass(public.value, bases)
        and not public.name.startswith("Abstract")
    }


def _docstring(value: object, origin: str, name: str) -> str:
    if inspect.isclass(value) or inspect.isroutine(value):
        return inspect.cleandoc(value.__doc__ or "")
    return _texts_below_values(origin).get(name, "")


@cache
def _tree(module: str) -> ast.Module:
    return ast.parse(inspect.getsource(importlib.import_module(module)))


def _origin(module: str, name: str) -> tuple[str, str]:
    """The module that defines a name, and its name there."""
    for node in _tree(module).body:
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                if name == (alias.asname or alias.name):
                    package = importlib.import_module(module).__package__
                    target = "." * node.level + (node.module or "")
                    above = importlib.util.resolve_name(target, package)
                    if above.partition(".")[0] == "clearjoint":
                        return _origin(above, alias.name)
    return module, name


@cache
def _texts_below_values(module: str) -> dict[str, str]:
    """The string below each assignment of a module, by the name that is assigned."""
    body = _tree(module).body
    texts = {}
    for node, below in zip(body, body[1:], strict=False):
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        text = getattr(getattr(below, "value", None), "value", None)
        if isinstance(below, ast.Expr) and isinstance(text, str):
            assigned = [name for target in targets if target for name in ast.walk(target)]
            texts |= {n.id: inspect.cleandoc(text) for n in assigned if isinstance(n, ast.Name)}
    return texts
