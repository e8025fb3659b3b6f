"""Docstrings of this package as the pages show them."""

import dataclasses
import functools
import importlib
import inspect
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path

import griffe
from typing_extensions import override

SITE = tomllib.loads(Path(__file__).with_name("site.toml").read_text(encoding="utf-8"))
"""Settings, order and names of the pages."""
MODULES = {page["module"] for page in SITE["api"].values()}
PATHS = {
    f"{page['module']}.{name}"
    for page in SITE["api"].values()
    for names in page.get("names", {}).values()
    for name in names.split()
}
"""Where public names are imported from: "clearjoint.laws.Hertz"."""
PLAIN_WORDS = SITE["plain_words"].split()
FENCED = re.compile(r"(^ *```.*?^ *```$)", re.MULTILINE | re.DOTALL)
SESSION = re.compile(r"^( *)>>> .*(?:\n.*\S.*)*", re.MULTILINE)
CODE = re.compile(
    r"(?<![`\[])`(?:(?:cj|clearjoint)(?=\.))?"  # the dot belongs to the name
    r"(\.?[A-Za-z_][\w.]*)(?:\(.*?\))?`(?![`\]])"
)


@functools.cache
def public_path(name: str, module: str = "") -> str | None:
    """Where the public name that backticks enclose is described, nothing for another word.

    The name may go on to an attribute or a method. One that begins with a dot is that of the
    package; another is first looked for in the given module, and must be that of one object.
    """
    if f"{module}.{name}" in PATHS or f"clearjoint{name}" in MODULES:
        return f"{module}.{name}" if f"{module}.{name}" in PATHS else f"clearjoint{name}"
    parts = name.removeprefix(".").split(".")
    for last in range(len(parts), 0, -1):
        head = ".".join(parts[:last])
        found = [path for path in PATHS if path.endswith(f".{head}")]
        own = [path for path in found if path == f"clearjoint.{head}"]
        if own and (name.startswith(".") or head not in PLAIN_WORDS):
            return own[0]
        if len(found) == 1 and not own and head not in PLAIN_WORDS:
            return found[0] if last > 1 or "_" in head or not head.islower() else None
    return None


def with_links(text: str, module: str = "") -> str:
    """Make backticked public names outside of code blocks links."""

    def linked(match: re.Match) -> str:
        path = public_path(match[1], module)
        return f"[{match[0]}][{path}]" if path else match[0]

    parts = FENCED.split(text)
    return "".join(p if FENCED.match(p) else CODE.sub(linked, p) for p in parts)


def _walk(parent: griffe.Module | griffe.Class) -> Iterator[griffe.Object]:
    yield parent
    for member in parent.members.values():
        if isinstance(member, griffe.Module | griffe.Class):
            yield from _walk(member)
        elif isinstance(member, griffe.Object):
            yield member


def _constructor(cls: griffe.Class, of: type) -> griffe.Function:
    """The constructor that a class with fields gets, with their annotations in the source."""
    parameters = [griffe.Parameter("self", kind=griffe.ParameterKind.positional_only)]
    for name, parameter in inspect.signature(of).parameters.items():
        default = None if parameter.default is parameter.empty else repr(parameter.default)
        parameters.append(
            griffe.Parameter(
                name,
                kind=griffe.ParameterKind(parameter.kind.description),
                annotation=getattr(cls.all_members.get(name), "annotation", None),
                default=default if default is None or len(default) < 40 else "...",
            )
        )
    return griffe.Function("__init__", parameters=griffe.Parameters(*parameters))


class HouseStyle(griffe.Extension):
    """Makes sessions code blocks and public names links, and gives classes with fields the
    signature of their constructors."""

    @override
    def on_package(self, *, pkg: griffe.Module, **kwargs: object) -> None:
        """Change all docstrings and the public classes of a package."""
        for item in _walk(pkg):
            if item.docstring:
                text = SESSION.sub(r"\n\1```pycon\n\g<0>\n\1```", item.docstring.value)
                item.docstring.value = with_links(text, item.path if item.is_module else "")
        for path in PATHS:
            module, name = path.rsplit(".", 1)
            of = getattr(importlib.import_module(module), name)
            is_built_by_users = inspect.isclass(of) and module != "clearjoint.results"
            if is_built_by_users and dataclasses.is_dataclass(of) and not inspect.isabstract(of):
                item = pkg[path.removeprefix("clearjoint.")].final_target
                if "__init__" not in item.members:
                    item.set_member("__init__", _constructor(item, of))
