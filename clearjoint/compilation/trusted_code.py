"""Code that is known by where it is from: of this package, and of packages known by a version.

Of these it is known that tracing depends on nothing but arguments, unlike of what reads files, the
clock or random numbers.
"""

import builtins
import os
import sys
import sysconfig
from functools import cache
from importlib import metadata
from types import CodeType, ModuleType

PACKAGE = "clearjoint"
NUMERIC = (
    "beartype",
    "diffrax",
    "equinox",
    "jax",
    "jaxlib",
    "jaxtyping",
    "lineax",
    "ml_dtypes",
    "numpy",
    "optimistix",
    "typing_extensions",
)
"""Packages known by their versions."""
STANDARD = frozenset(
    {
        "_abc",
        "_collections_abc",
        "_functools",
        "_operator",
        "abc",
        "builtins",
        "cmath",
        "collections",
        "contextlib",
        "copy",
        "dataclasses",
        "enum",
        "functools",
        "inspect",
        "itertools",
        "math",
        "numbers",
        "operator",
        "re",
        "string",
        "types",
        "typing",
        "warnings",
    }
)
"""Modules of Python that compute from their arguments alone."""
_HIDDEN = frozenset(
    {
        "__import__",
        "breakpoint",
        "compile",
        "delattr",
        "eval",
        "exec",
        "globals",
        "input",
        "locals",
        "open",
        "print",
        "setattr",
        "vars",
        "attrgetter",
        "methodcaller",
        "currentframe",
        "getmodule",
        "getsource",
        "fromfile",
        "fromregex",
        "genfromtxt",
        "load",
        "loadtxt",
        "memmap",
    }
)
"""Functions that reach for what can't be seen in their arguments, or do more than compute."""
HIDDEN_ATTRIBUTES = frozenset(
    {"__builtins__", "__dict__", "__globals__", "io_callback", "pure_callback"}
)
"""Attributes by which a function comes to more than what can be seen in it, whatever has them."""
_UNTRUSTED = ("numpy.random", "jax.debug")


def reaches_out(name: str) -> bool:
    """Whether a function that uses a function of such a name, of Python or of a trusted module, may
    depend on more than can be seen in it."""
    return name in _HIDDEN


def is_builtin(name: str) -> bool:
    """Whether Python knows a name everywhere."""
    return hasattr(builtins, name)


def is_trusted(module: str) -> bool:
    """Whether a module, by its name, is of this package, or known by its version."""
    if module in _UNTRUSTED:
        return False
    top = module.split(".")[0]
    return top == PACKAGE or top in NUMERIC or module in STANDARD or top == "collections"


def holds(module: str, name: str, value: object) -> bool:
    """Whether a trusted module has a value by a (dotted) name."""
    found: object = sys.modules.get(module) if is_trusted(module) else None
    if found is None or not _is_own_file(module):
        return False
    for part in name.split("."):
        found = getattr(found, part, None) if isinstance(found, type) else _entry(found, part)
    return found is value


def wrote(code: CodeType) -> bool:
    """Whether a function's code stands in a file of a trusted package."""
    return code.co_filename.startswith(_roots())


@cache
def versions() -> tuple[str, ...]:
    """Names and versions of Python and of the packages known by them, loaded or not."""
    return (sys.version, *(f"{name} {_version(name)}" for name in NUMERIC))


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "none"


def _entry(found: object, name: str) -> object:
    return vars(found).get(name) if isinstance(found, ModuleType) else None


def _is_own_file(module: str) -> bool:
    """Whether the module is what its name says, and none of a user's of the same name."""
    file = getattr(sys.modules[module], "__file__", None)
    return file is None or file.startswith(_roots())


@cache
def _roots() -> tuple[str, ...]:
    """Folders and files of the trusted packages."""
    modules = [sys.modules.get(name) for name in (PACKAGE, *NUMERIC)]
    files = [module.__file__ for module in modules if module is not None and module.__file__]
    packages = [os.path.dirname(f) + os.sep if f.endswith("__init__.py") else f for f in files]
    paths = sysconfig.get_paths()
    library = paths["stdlib"] + os.sep
    standard = [f"{library}{name}.py" for name in STANDARD]
    inner = [f"{library}{name}{os.sep}" for name in ("collections", "re")]
    return (*packages, *standard, *inner, "<frozen ")
