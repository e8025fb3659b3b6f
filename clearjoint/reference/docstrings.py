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
"""Public names that become links only after "cj.", since they mostly mean something else."""
FENCED = re.compile(r"(^ *```.*?^ *```$)", re.MULTILINE | re.DOTALL)  # a block of code
SESSION = re.compile(r"^( *)>>> .*(?:\n.*\S.*)*", re.MULTILINE)  # an interactive session
# A name in backticks, perhaps with arguments in parentheses, that is not a link already.
CODE = re.compile(
    r"(?<![`\[])`(?:(?:cj|clearjoint)(?=\.))?"  # the dot belongs to the name
    r"(\.?[A-Za-z_][\w.]*)(?:\(.*?\))?`(?![`\]])"
)


@functools.cache
def public_path(name: str, module: str = "") -> str | None:
    """Return the path of the public object or module that a name in backticks means, such as
    "clearjoint.laws.Hertz" for "Hertz"; ``None`` for another word.

    For "View.save", the path is that of the class `View`. For "cj.View" or "clearjoint.View", pass
    ".View" as `name`. A name is looked up first in the `module` in whose docstring it stands.
    """
    if f"{module}.{name}" in PATHS:
        return f"{module}.{name}"
    if f"clearjoint{name}" in MODULES:
        return f"clearjoint{name}"
    parts = name.removeprefix(".").split(".")
    # The longest beginning of the name that is public; the rest is an attribute or a method.
    for last in range(len(parts), 0, -1):
        head = ".".join(parts[:last])
        paths = [path for path in PATHS if path.endswith(f".{head}")]
        top_level = [path for path in paths if path == f"clearjoint.{head}"]
        if top_level and (name.startswith(".") or head not in PLAIN_WORDS):
            return top_level[0]
        # An object of a submodule is meant only if no other has its name, and not by a single word
        # in lower case without underscores, such as "position", which is mostly an ordinary word.
        if len(paths) == 1 and not top_level and head not in PLAIN_WORDS:
            return paths[0] if last > 1 or "_" in head or not head.islower() else None
    return None


def with_links(text: str, module: str = "") -> str:
    """Turn public names in backticks, outside of code, into links, in a docstring of `module`."""

    def linked(match: re.Match) -> str:
        path = public_path(match[1], module)
        return f"[{match[0]}][{path}]" if path else match[0]

    return "".join(p if FENCED.match(p) else CODE.sub(linked, p) for p in FENCED.split(text))


def _walk(parent: griffe.Module | griffe.Class) -> Iterator[griffe.Object]:
    yield parent
    for member in parent.members.values():
        if isinstance(member, griffe.Module | griffe.Class):
            yield from _walk(member)
        elif isinstance(member, griffe.Object):
            yield member


def _constructor(cls: griffe.Class, of: type) -> griffe.Function:
    """Return the constructor of the dataclass `of`. The annotations are the source's, from `cls`,
    the class as griffe has read it."""
    parameters = [griffe.Parameter("self", kind=griffe.ParameterKind.positional_only)]
    for name, parameter in inspect.signature(of).parameters.items():
        default = None if parameter.default is parameter.empty else repr(parameter.default)
        parameters.append(
            griffe.Parameter(
                name,
                kind=griffe.ParameterKind(parameter.kind.description),
                annotation=getattr(cls.all_members.get(name), "annotation", None),
                # A long default would hide the other parameters of a signature.
                default=default if default is None or len(default) < 40 else "...",
            )
        )
    return griffe.Function("__init__", parameters=griffe.Parameters(*parameters))


class HouseStyle(griffe.Extension):
    """Turns interactive sessions into code blocks and public names into links, and gives
    dataclasses the signatures of their constructors."""

    @override
    def on_package(self, *, pkg: griffe.Module, **kwargs: object) -> None:
        """Change all docstrings and the public classes of a package."""
        for item in _walk(pkg):
            if item.docstring:
                # The fences of the code block are indented like the session.
                text = SESSION.sub(r"\n\1```pycon\n\g<0>\n\1```", item.docstring.value)
                # In a module's docstring, a name means first of all one of this module.
                item.docstring.value = with_links(text, item.path if item.is_module else "")
        # griffe reads only the source, in which dataclasses have no constructors.
        for path in PATHS:
            module, name = path.rsplit(".", 1)
            public = getattr(importlib.import_module(module), name)
            is_built_by_users = inspect.isclass(public) and module != "clearjoint.results"
            is_dataclass = is_built_by_users and dataclasses.is_dataclass(public)
            if is_dataclass and not inspect.isabstract(public):
                item = pkg[path.removeprefix("clearjoint.")].final_target
                if "__init__" not in item.members:
                    item.set_member("__init__", _constructor(item, public))
