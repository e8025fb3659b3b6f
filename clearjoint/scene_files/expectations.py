"""Arguments of a class's constructor: the values that each may have, from annotations and units."""

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
"""Functions that make and check an instance of a class whose constructor does not check."""


@dataclass(frozen=True)
class Expectation:
    """Values that an argument or an entry may have.

    - `unit`: unit of its numbers, if it is declared.
    - `shapes`: known shapes of its numbers.
    - `is_array`: whether its numbers become an array, also a single one.
    - `classes`: base classes of the objects that it may be.
    - `options`: the enumeration of its values.
    - `is_text`: whether it may be a text.
    - `is_flag`: whether it may be true or false.
    - `is_anything`: whether nothing is known about it.
    - `by_name`, `item`: the expected entries of a table or of a list.
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
    """An argument of a constructor: the expected value, and the default if it has one."""

    expected: Expectation
    is_required: bool
    default: object = None


@cache
def factories(kind: type) -> dict[str, Callable[..., object]]:
    """Public static methods of a class that return an instance of it, by name."""
    methods = {
        name: member.__func__
        for name, member in vars(kind).items()
        if isinstance(member, staticmethod) and not name.startswith("_")
    }
    return {
        name: method for name, method in methods.items() if _hints(method).get("return") is kind
    }


def constructor(kind: type, factory: str = "") -> Callable[..., object]:
    """The function that makes an instance of a class, or its factory method of a name."""
    return factories(kind)[factory] if factory else CONSTRUCTORS.get(kind, kind)


@cache
def arguments(kind: type, factory: str = "") -> dict[str, Argument]:
    """Arguments of a class's constructor, or of one of its factory methods, by name."""
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
    """The expectation with the unit and the shape that a field's metadata declares."""
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
    """Annotations of a class or function; unresolved texts where one names an unknown type."""
    try:
        return get_type_hints(owner, include_extras=True)
    except NameError:
        return dict(getattr(owner, "__annotations__", {}))


def expectation(annotation: object) -> Expectation:
    """The values that an annotation allows; a text in `Annotated` is their unit."""
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
    """The values that an annotation other than a union allows."""
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
    """The shape of a number, or of an array whose annotation fixes all sizes."""
    if annotation in (int, float):
        return ((),)
    sizes = [getattr(size, "size", None) for size in getattr(annotation, "dims", (None,))]
    known = tuple(size for size in sizes if isinstance(size, int))
    return (known,) if len(known) == len(sizes) else ()
