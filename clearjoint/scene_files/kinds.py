"""Names of classes in a file. Nothing is imported for a name: a class is one of the package's own,
or one that the caller hands over."""

import inspect
from collections.abc import Collection, Iterator
from typing import TypeAlias

from ..fields.checks import require
from ..fields.readable import AbstractReadable
from ..fields.suggestions import nearest
from .complaints import FilePlace, listed
from .expectations import ways_to_make

PACKAGE = __name__.split(".")[0]
MAIN = "__main__"
Classes: TypeAlias = Collection[type]


def require_classes(given: Classes) -> None:
    """Check that classes are handed over as such."""
    remedy = "pass for example classes=[MyLaw]"
    require(not isinstance(given, type | str), "classes", given, "a list of classes", remedy)
    for kind in given:
        require(isinstance(kind, type), "classes", kind, "a list of classes", remedy)


def name_of(kind: type) -> str:
    """What a file calls a class: its name if it is the package's, else module and name."""
    if is_of_the_package(kind):
        return kind.__name__
    return f"{kind.__module__}:{kind.__qualname__}"


def known_kinds(families: tuple[type, ...], given: Classes) -> dict[str, type]:
    """Classes that can be made, of these families, by all names that a file may use."""
    families = families or (object,)
    own = {kind.__name__: kind for kind in _subclasses(AbstractReadable) if is_of_the_package(kind)}
    named = {kind.__name__: kind for kind in given} | own
    named |= {name_of(kind): kind for kind in given}
    return {
        name: kind
        for name, kind in named.items()
        if issubclass(kind, families) and not is_abstract(kind)
    }


def is_abstract(kind: type) -> bool:
    """Whether a class only stands for others."""
    return inspect.isabstract(kind) or kind.__name__.startswith(("Abstract", "_"))


def find_kind(name: object, families: tuple[type, ...], given: Classes, place: FilePlace) -> type:
    """The class that a file names.

    **Raises:** `ValueError` for a class of another family, or one that nobody handed over.
    """
    known = known_kinds(families, given)
    if not isinstance(name, str):
        place.refuse(name, "the name of a class", f"write one of {listed(known)}")
    module, _, short = name.rpartition(":")
    found = known.get(short if module == MAIN else name)
    if found is not None:
        return found
    if name in known_kinds((), given):
        family = " or ".join(kind.__name__ for kind in families)
        place.refuse(name, f"one of {listed(known)}", f"take a subclass of {family}")
    if module:
        place.refuse(
            name,
            f"one of the classes that are handed over, {listed(map(name_of, given))}",
            f"pass classes=[{short.split('.')[-1]}], imported by yourself; a file imports nothing",
        )
    return place.refuse(
        name,
        f"one of {listed(known)}",
        nearest(name, known, "a class of your own is named module:Class, and handed over"),
    )


def find_way(
    name: object, families: tuple[type, ...], given: Classes, place: FilePlace
) -> tuple[type, str]:
    """The class that a file names, and which of its `ways_to_make` if it names one: "Body.rod".

    **Raises:** `ValueError` as `find_kind`, and for a class that isn't made that way.
    """
    short, _, way = name.rpartition(".") if isinstance(name, str) else ("", "", "")
    if ":" in way or short not in known_kinds((), given):
        return find_kind(name, families, given, place), ""
    kind = find_kind(short, families, given, place)
    known = [f"{short}.{one}" for one in ways_to_make(kind)]
    if way not in ways_to_make(kind):
        place.refuse(name, f"one of {listed([short, *known])}", nearest(str(name), known, short))
    return kind, way


def is_of_the_package(kind: type) -> bool:
    """Whether a class comes with the package."""
    return kind.__module__.split(".")[0] == PACKAGE


def _subclasses(kind: type) -> Iterator[type]:
    for subclass in kind.__subclasses__():
        yield subclass
        yield from _subclasses(subclass)
