"""Names of classes in a file. A name imports nothing: the class belongs to the package, or the
caller passes it."""

import inspect
from collections.abc import Collection, Iterator
from typing import TypeAlias

from ..fields.checks import require
from ..fields.readable import AbstractReadable
from ..fields.suggestions import nearest
from .expectations import factories
from .locations import FileLocation, listed

PACKAGE = __name__.split(".")[0]
MAIN = "__main__"
Classes: TypeAlias = Collection[type]


def require_classes(given: Classes) -> None:
    """Raise `ValueError` unless the argument `classes` is a collection of classes."""
    remedy = "pass for example classes=[MyLaw]"
    require(not isinstance(given, type | str), "classes", given, "a list of classes", remedy)
    for kind in given:
        require(isinstance(kind, type), "classes", kind, "a list of classes", remedy)


def class_name(kind: type) -> str:
    """Return the name of a class in files: "Class" if it belongs to the package, else
    "module:Class"."""
    if is_from_package(kind):
        return kind.__name__
    return f"{kind.__module__}:{kind.__qualname__}"


def known_classes(families: tuple[type, ...], given: Classes) -> dict[str, type]:
    """Return the classes that a file may name, by name.

    A class that the caller passes may have two names, with and without its module.

    **Arguments:** `families`: base classes, one of which a class must have, or none for any class;
    `given`: user-defined classes that the caller passes.
    """
    families = families or (object,)
    included = filter(is_from_package, _subclasses(AbstractReadable))
    named = {kind.__name__: kind for kind in (*given, *included)}
    named |= {class_name(kind): kind for kind in given}
    return {
        name: kind
        for name, kind in named.items()
        if issubclass(kind, families) and not is_abstract(kind)
    }


def is_abstract(kind: type) -> bool:
    """Return whether a class is only a base of others."""
    return inspect.isabstract(kind) or kind.__name__.startswith(("Abstract", "_"))


def family_names(families: tuple[type, ...]) -> str:
    """Return the names of base classes for a message, such as "AbstractForce or AbstractFilm"."""
    return " or ".join(kind.__name__ for kind in families)


def find_class(
    name: object, families: tuple[type, ...], given: Classes, location: FileLocation
) -> type:
    """Return the class that a file names.

    **Arguments:**

    - `name`: the name in the file. For "__main__:Class", which a script has saved, a class "Class"
      of any module is found.
    - `families`: base classes, one of which the class must have, or none for any class.
    - `given`: user-defined classes that the caller passes.
    - `location`: place of the name in the file, for error messages.

    **Raises:** `ValueError` if the name is no text or no known class, if the class has none of the
    base classes, or if the caller has not passed a user-defined class.
    """
    known = known_classes(families, given)
    if not isinstance(name, str):
        location.refuse(name, "the name of a class", f"write one of {listed(known)}")
    module, _, short = name.rpartition(":")
    kind = known.get(short if module == MAIN else name)
    if kind is not None:
        return kind
    if name in known_classes((), given):
        remedy = f"take a subclass of {family_names(families)}"
        location.refuse(name, f"one of {listed(known)}", remedy)
    if module:
        location.refuse(
            name,
            f"one of the classes passed to the call, {listed(map(class_name, given))}",
            f"import it and pass classes=[{short.split('.')[-1]}]; a file imports nothing",
        )
    return location.refuse(
        name,
        f"one of {listed(known)}",
        nearest(name, known, "write module:Class for a user-defined class, and pass the class"),
    )


def find_factory(
    name: object, families: tuple[type, ...], given: Classes, location: FileLocation
) -> tuple[type, str]:
    """Return the class that a file names, and the name of its factory method.

    The file may name a method, as in "Body.rod"; otherwise the second result is "".

    **Arguments:** as for `find_class`.

    **Raises:** `ValueError` as `find_class`, and for an unknown factory method.
    """
    short, _, factory = name.rpartition(".") if isinstance(name, str) else ("", "", "")
    if ":" in factory or short not in known_classes((), given):
        return find_class(name, families, given, location), ""
    kind = find_class(short, families, given, location)
    if factory not in factories(kind):
        known = [short, *(f"{short}.{method}" for method in factories(kind))]
        location.refuse(name, f"one of {listed(known)}", nearest(str(name), known[1:], short))
    return kind, factory


def is_from_package(kind: type) -> bool:
    """Return whether a class belongs to the package."""
    return kind.__module__.split(".")[0] == PACKAGE


def _subclasses(kind: type) -> Iterator[type]:
    for subclass in kind.__subclasses__():
        yield subclass
        yield from _subclasses(subclass)
