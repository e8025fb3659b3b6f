"""Find which values each argument of a class's constructor may have, from annotations and units."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from enum import Enum
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import jax
import numpy as np

from ..model.bodies import BodyState, body_state
from ..quantities.base import AbstractQuantity, Quantity

CONSTRUCTORS: dict[type, Callable[..., object]] = {BodyState: body_state}
"""Functions that check arguments and make an instance, by the class, for classes whose constructors
do not check."""


@dataclass(frozen=True)
class Expectation:
    """Values that an argument of a constructor, or an entry of a table or list, may have.

    - `unit`: SI unit of its numbers; None if no unit is declared.
    - `shapes`: shapes that its numbers may have, () for a single number; empty if unknown.
    - `is_array`: whether numbers, also a single one, are converted to an array.
    - `classes`: base classes of the objects that are allowed.
    - `options`: enumeration whose members are the only allowed values.
    - `is_text`: whether a text is allowed.
    - `is_flag`: whether true and false are allowed.
    - `is_anything`: whether any value is allowed, since the annotation says nothing.
    - `by_name`: expected entries of a table of arbitrary names.
    - `item`: expected entries of a list.
    """

    unit: str | None = None
    shapes: tuple[tuple[int, ...], ...] = ()
    is_array: bool = False
    classes: tuple[type, ...] = ()
    options: type[Enum] | None = None
    is_text: bool = False
    is_flag: bool = False
    is_anything: bool = False
    by_name: "Expectation | None" = None
    item: "Expectation | None" = None


ANYTHING = Expectation(is_text=True, is_flag=True, is_anything=True)


@dataclass(frozen=True)
class Argument:
    """An argument of a constructor.

    - `expected`: values that it may have.
    - `is_required`: whether it has no default.
    - `default`: its default value; None for a required argument.
    """

    expected: Expectation
    is_required: bool
    default: object = None


@cache
def factories(kind: type) -> dict[str, Callable[..., object]]:
    """Return the public static methods of a class that are annotated to return an instance of it,
    by name."""
    methods = {
        name: member.__func__
        for name, member in vars(kind).items()
        if isinstance(member, staticmethod) and not name.startswith("_")
    }
    return {
        name: method for name, method in methods.items() if _hints(method).get("return") is kind
    }


def constructor(kind: type, factory: str = "") -> Callable[..., object]:
    """Return the function that makes an instance of a class: its static method named `factory`, or,
    for an empty name, its constructor."""
    return factories(kind)[factory] if factory else CONSTRUCTORS.get(kind, kind)


@cache
def arguments(kind: type, factory: str = "") -> dict[str, Argument]:
    """Return the arguments of a class's constructor, or of its static method named `factory`, by
    name."""
    make = constructor(kind, factory)
    make = kind.__init__ if make is kind else make
    hints = _hints(make) | _hints(kind)
    declared = {f.name: f.metadata for f in fields(kind)} if is_dataclass(kind) else {}
    result = {}
    for name, parameter in inspect.signature(make).parameters.items():
        if name == "self" or parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            continue
        required = parameter.default is parameter.empty
        expected = _with_unit(expectation(hints.get(name, Any)), declared.get(name, {}))
        result[name] = Argument(expected, required, None if required else parameter.default)
    return result


def _with_unit(expected: Expectation, metadata: Mapping) -> Expectation:
    """Return the expectation with the unit and shape that a field's metadata declare."""
    if "unit" not in metadata:
        return expected
    shape = getattr(metadata.get("declared"), "shape", None)
    return replace(
        expected,
        unit=metadata["unit"],
        shapes=expected.shapes if shape is None else (shape,),
        by_name=expected.by_name and _with_unit(expected.by_name, metadata),
        item=expected.item and _with_unit(expected.item, {"unit": metadata["unit"]}),
        is_text=expected.is_text and not expected.is_anything,
        is_flag=expected.is_flag and not expected.is_anything,
        is_anything=False,
    )


def _hints(owner: object) -> dict[str, object]:
    """Return the annotations of a class or function by name; as texts if one of them names a type
    that is unknown at run time."""
    try:
        return get_type_hints(owner, include_extras=True)
    except NameError:
        return dict(getattr(owner, "__annotations__", {}))


def expectation(annotation: object) -> Expectation:
    """Return the values that an annotation allows; a text in ``Annotated[float, "s"]`` is their
    unit."""
    if get_origin(annotation) is Annotated:
        inner, *notes = get_args(annotation)
        unit = next((note for note in notes if isinstance(note, str)), None)
        return replace(expectation(inner), unit=unit)
    is_union = get_origin(annotation) in (Union, UnionType)
    kinds = get_args(annotation) if is_union else (annotation,)
    parts = [_of_one(kind) for kind in kinds if kind is not NoneType]
    # Members of a union: their shapes and classes add up, of all else the first that is given.
    merged: dict[str, Any] = {}
    for entry in fields(Expectation):
        given = [value for part in parts if (value := getattr(part, entry.name))]
        is_tuple = isinstance(entry.default, tuple)
        merged[entry.name] = sum(given, ()) if is_tuple else next(iter(given), entry.default)
    return Expectation(**merged)


def _of_one(annotation: object) -> Expectation:
    """Return the values that an annotation other than a union allows."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return expectation(annotation)
    if annotation == Quantity:
        return Expectation(classes=(AbstractQuantity,))
    if origin is Literal:
        return Expectation(is_text=True)
    if inspect.isclass(origin) and issubclass(origin, Mapping) and len(inner) == 2:
        return Expectation(by_name=expectation(inner[1]))
    if inspect.isclass(origin) and issubclass(origin, Sequence) and inner:
        return Expectation(item=expectation(inner[0]))
    if inspect.isclass(annotation) and issubclass(annotation, Enum):
        return Expectation(options=annotation)
    if inspect.isclass(annotation) and is_dataclass(annotation):
        return Expectation(classes=(annotation,))
    if annotation is Any or isinstance(annotation, str | TypeVar):
        return ANYTHING
    return Expectation(
        shapes=_shapes(annotation),
        is_array=hasattr(annotation, "dims") or annotation in (np.ndarray, jax.Array),
        is_text=annotation is str,
        is_flag=annotation is bool,
    )


def _shapes(annotation: object) -> tuple[tuple[int, ...], ...]:
    """Return the shape of a number, or of an array whose annotation fixes all sizes, in a tuple;
    an empty tuple if the shape is not known."""
    if annotation in (int, float):
        return ((),)
    sizes = [getattr(size, "size", None) for size in getattr(annotation, "dims", (None,))]
    known = tuple(size for size in sizes if isinstance(size, int))
    return (known,) if len(known) == len(sizes) else ()
