"""Classes that a file may name, and what the arguments of their constructors may be. No module is
imported because a file names it."""

import inspect
import typing
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import Enum
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeAlias, TypeVar, Union

import jax
import numpy as np
from jaxtyping import PyTree

from .._fields.checks import is_of_package, nearest, require
from .._fields.objects import AbstractReadable
from .._model.bodies import BodyState, body_state
from ..quantities.base import AbstractQuantity, Quantity
from .documents import FileLocation, listed

REQUIRED = inspect.Parameter.empty
Classes: TypeAlias = Collection[type]
Maker: TypeAlias = Callable[..., PyTree]
"""A class, or a static method that returns an object of its class, such as `Body.rod`."""
CHECKED: dict[Maker, Maker] = {BodyState: body_state}
"""For each class whose constructor does not check its arguments, a function that checks them and
returns an object."""


@dataclass(frozen=True)
class Expectation:
    """Values that an argument of a constructor, or an entry of a table or list, may have in a file.

    The reader refuses a number only if there are `options` but neither `shapes` nor `classes`; in
    all other cases the constructor checks it.

    - `unit`: SI unit of numbers; None if none is declared.
    - `shapes`: shapes that arrays of numbers may have, () for a single number; empty if unknown.
    - `is_array`: whether numbers, also a single one, are converted to an array.
    - `classes`: base classes of the objects that are allowed.
    - `options`: for an argument with a fixed set of texts, the value of each text.
    - `is_text`, `is_flag`: whether any text is allowed; whether true and false are.
    - `by_name`: expectation for the entries of a table whose keys are names, such as `bodies`.
    - `item`: expectation for the entries of a list.
    """

    unit: str | None = None
    shapes: tuple[tuple[int, ...], ...] = ()
    is_array: bool = False
    classes: tuple[type, ...] = ()
    options: Mapping[str, object] | None = None
    is_text: bool = False
    is_flag: bool = False
    allows_none: bool = False
    allows_anything: bool = False
    by_name: "Expectation | None" = None
    item: "Expectation | None" = None
    default: object = REQUIRED


ANYTHING = Expectation(is_text=True, is_flag=True, allows_anything=True)


def class_name(kind: type) -> str:
    """Return the name of a class in files: "Class" in the package, else "module:Class"."""
    return kind.__name__ if is_of_package(kind) else f"{kind.__module__}:{kind.__qualname__}"


def is_abstract(kind: type) -> bool:
    """Return whether no file may name a class, since it is abstract or private."""
    return inspect.isabstract(kind) or kind.__name__.startswith(("Abstract", "_"))


def makers(families: tuple[type, ...], classes: Classes) -> dict[str, Maker]:
    """Return the classes and static methods, such as "Body.rod", for `kind` in a file, by name.

    Only classes that derive from one of the `families` are returned, or all if `families` is empty.
    User-defined `classes` have two names, "Class" and "module:Class". If a class of this package
    is also called "Class", this name means the class of the package.
    """
    # An iterator is no collection: it could be read only once. A class may be one, such as an enum.
    is_collection = isinstance(classes, Collection) and not isinstance(classes, type)
    is_valid = is_collection and all(isinstance(kind, type) for kind in classes)
    require(is_valid, "classes", classes, "a list of classes", "pass for example classes=[MyLaw]")
    # Most classes of the package that files name derive from `AbstractReadable`; any other must be
    # one of the `families` itself.
    included = filter(is_of_package, (*families, *_subclasses(AbstractReadable)))
    # For equal names, the class of this package has priority.
    named = {kind.__name__: kind for kind in (*classes, *included)}
    named |= {class_name(kind): kind for kind in classes}
    by_name: dict[str, Maker] = {}
    for name, kind in named.items():
        if issubclass(kind, families or (object,)) and not is_abstract(kind):
            by_name[name] = kind
            by_name |= {f"{name}.{method}": make for method, make in _static_methods(kind).items()}
    return by_name


def _subclasses(kind: type) -> Iterator[type]:
    for subclass in kind.__subclasses__():
        yield subclass
        yield from _subclasses(subclass)


@cache
def _static_methods(kind: type) -> dict[str, Maker]:
    # Of public static methods, only those that return an object of the class.
    methods = {n: m.__func__ for n, m in vars(kind).items() if isinstance(m, staticmethod)}
    public = {name: make for name, make in methods.items() if not name.startswith("_")}
    return {name: make for name, make in public.items() if _hints(make).get("return") is kind}


def family_names(families: tuple[type, ...]) -> str:
    return " or ".join(kind.__name__ for kind in families)


def find_maker(
    name: object, families: tuple[type, ...], classes: Classes, location: FileLocation
) -> Maker:
    """Return the class or static method with the `name` that a file has at `location`, which makes
    an object of one of the classes `families`. Raise a `ValueError` unless `makers` has this name.

    A script saves its own class as "__main__:Class". Such a name means a class "Class" of this
    package or else of `classes`, whatever its module.
    """
    allowed = makers(families, classes)
    expected = f"one of {listed(allowed)}"
    # The errors below distinguish the mistakes, since each has a different remedy.
    if not isinstance(name, str):
        location.refuse(name, "the name of a class", f"write {expected}")
    module, _, short = name.rpartition(":")
    make = allowed.get(short if module == "__main__" else name)
    if make is not None:
        return make
    if name in makers((), classes):  # a class, but not one for this argument
        location.refuse(name, expected, f"take a subclass of {family_names(families)}")
    if module:  # a user-defined class that was not passed
        expected = f"one of the classes passed to the call, {listed(map(class_name, classes))}"
        remedy = f"import it and pass classes=[{short.split('.')[-1]}]; a file imports nothing"
        location.refuse(name, expected, remedy)
    otherwise = "write module:Class for a user-defined class, and pass the class"
    return location.refuse(name, expected, nearest(name, allowed, otherwise))


@cache
def arguments(make: Maker) -> dict[str, Expectation]:
    """Return what a file may give for each argument of a class or static method, by name."""
    # For some classes, the reader calls a function in place of the constructor (see `CHECKED`).
    make = CHECKED.get(make, make)
    kind = make if isinstance(make, type) else _hints(make)["return"]  # class of the made object
    # For a field and an argument of the same name, the annotation of the field counts.
    hints = _hints(kind.__init__ if make is kind else make) | _hints(kind)
    metadata_of = {f.name: f.metadata for f in fields(kind)} if is_dataclass(kind) else {}
    expectations = {}
    for name, parameter in inspect.signature(make).parameters.items():
        if parameter.kind not in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            # The metadata of a field made by `quantity` have the unit and the shape of its values.
            metadata = metadata_of.get(name, {})
            expected = expectation(hints.get(name, Any), metadata.get("unit"))
            shape = getattr(metadata.get("declared"), "shape", None)
            shapes = expected.shapes if shape is None else (shape,)
            expectations[name] = replace(expected, shapes=shapes, default=parameter.default)
    return expectations


def _hints(owner: object) -> dict[str, Any]:
    """Return the annotations of a class or function by name. If one of them names a type that is
    unknown at run time, all are returned as they are in the source, some of them as texts."""
    try:
        return typing.get_type_hints(owner, include_extras=True)
    except NameError:
        return dict(getattr(owner, "__annotations__", {}))


def expectation(annotation: object, unit: str | None = None) -> Expectation:
    """Return the `Expectation` of an annotation. The unit of numbers is that in ``Annotated[float,
    "s"]``, or by default `unit`."""
    origin, inner = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is Annotated:
        kind, *notes = inner
        return expectation(kind, next((note for note in notes if isinstance(note, str)), unit))
    # A `Quantity` is any function of an instant. A file can contain only objects of the package's
    # class of such functions.
    if annotation == Quantity:
        return Expectation(classes=(AbstractQuantity,))
    if origin in (Union, UnionType):
        parts = [expectation(kind, unit) for kind in inner if kind is not NoneType]
        # The expectations of all types but None are merged; for None, the reader accepts the text
        # "none" unless texts are allowed. Shapes and classes, which are tuples, are joined. Of
        # every other attribute, the first value that is neither None nor False is taken, so that a
        # flag is true if it is true for any of the types.
        merged: dict[str, Any] = {}
        for attribute in fields(Expectation):
            name, default = attribute.name, attribute.default
            values = [value for part in parts if (value := getattr(part, name))]
            is_tuple = isinstance(default, tuple)
            merged[name] = sum(values, ()) if is_tuple else next(iter(values), default)
        merged["allows_none"] = NoneType in inner
        return Expectation(**merged)
    if origin is Literal:
        return Expectation(options={str(text): text for text in inner})
    # The keys of a table are names; the second type is that of its values.
    if inspect.isclass(origin) and issubclass(origin, Mapping) and len(inner) == 2:
        return Expectation(unit, by_name=expectation(inner[1], unit))
    if inspect.isclass(origin) and issubclass(origin, Sequence) and inner:
        return Expectation(unit, item=expectation(inner[0], unit))
    if inspect.isclass(annotation) and issubclass(annotation, Enum):
        return Expectation(options=annotation.__members__)
    if inspect.isclass(annotation) and is_dataclass(annotation):
        return Expectation(classes=(annotation,))
    if annotation is Any or isinstance(annotation, str | TypeVar):  # a text that was not resolved
        return ANYTHING if unit is None else Expectation(unit)  # a unit: numbers only
    # The other annotations are of numbers, texts, flags, and arrays of jaxtyping, which have
    # `dims`. The shape is known for a number, and for an array whose annotation fixes all sizes. An
    # annotation without `dims` gets the size None, so that its shape counts as unknown.
    sizes = [getattr(size, "size", None) for size in getattr(annotation, "dims", (None,))]
    fixed = tuple(size for size in sizes if isinstance(size, int))
    return Expectation(
        unit,
        shapes=(fixed,) if annotation in (int, float) or len(fixed) == len(sizes) else (),
        is_array=hasattr(annotation, "dims") or annotation in (np.ndarray, jax.Array),
        is_text=annotation is str,
        is_flag=annotation is bool,
    )
