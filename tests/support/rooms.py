"""The rooms of the package, and who imports whom.

A room is a package in `clearjoint/` or a module that lies beside them; an underscore marks those
that users do not open.
"""

import ast
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / "clearjoint"
DOORS = (
    *("__init__", "__main__", "extend", "films", "frictions", "laws", "mechanisms"),
    *("presets", "profiles", "results"),
)
"""Modules through which users come in: they import from everywhere, and nobody imports them."""


@cache
def module_paths() -> dict[str, Path]:
    """Every module of the package by its dotted name; packages by their `__init__`."""
    return {
        ".".join(path.relative_to(PACKAGE).with_suffix("").parts): path
        for path in sorted(PACKAGE.rglob("*.py"))
    }


@cache
def syntax_tree(module: str) -> ast.Module:
    """The syntax tree of a module."""
    return ast.parse(module_paths()[module].read_text())


@cache
def imports(module: str) -> list[str]:
    """Dotted names of all modules that a module imports, wherever in its text."""
    paths = module_paths()
    parts = ("clearjoint", *module.split("."))
    found = []
    for node in ast.walk(syntax_tree(module)):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = parts[: -node.level] if node.level else ()
            source = ".".join([*above, *([node.module] if node.module else [])])
            names = [f"{source}.{alias.name}" for alias in node.names]
            found += [n if n.removeprefix("clearjoint.") in paths else source for n in names]
    return found


def room_of(module: str) -> str:
    """The room that a module, by its dotted name in the package, lies in, without underscore."""
    return module.split(".")[0].removeprefix("_")


@cache
def neighbours() -> dict[str, set[str]]:
    """The rooms that each room imports from."""
    found: dict[str, set[str]] = {room_of(m): set() for m in module_paths() if m not in DOORS}
    for module in module_paths():
        if module in DOORS:
            continue
        own = [name for name in imports(module) if name.startswith("clearjoint.")]
        targets = {room_of(name.removeprefix("clearjoint.")) for name in own}
        found[room_of(module)] |= targets - {room_of(module)}
    return found
