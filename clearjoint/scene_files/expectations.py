"""What the constructor of a class takes: by the annotations of its fields and their units."""

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

MAKERS: dict[type, Callable[..., object]] = {BodyState: body_state}
"""Functions that make what a class alone would not check."""


@dataclass(frozen=True)
class Expectation:
    """What may stand at a place.

    - `unit`: of its numbers, if it is declared.
    - `shapes`: of its numbers, those known.
    - `is_array`: whether its numbers are an array, also where there is but one.
    - `classes`: of which it is an instance, if of any.
    - `options`: an enumeration that it is a member of.
    - `is_text`: whether it may be a text that stands for itself.
    - `is_flag`: whether it may be true or false.
    - `is_anything`: whether nothing is known of it.
    - `by_name`, `item`: what the entries of a table, or of a list, are.
    - `is_optional`: whether it may be ``None``.
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
    is_optional: bool = False


ANYTHING = Expectation(is_text=True, is_flag=True, is_anything=True)


@dataclass(frozen=True)
class Argument:
    """An argument of a constructor: what it expects, and its default, if it has one."""

    expected: Expectation
    is_required: bool
    default: object = None


@cache
def ways_to_make(kind: type) -> dict[str, Callable[..., object]]:
    """Public static methods of a class that return one of it, by their names."""
    methods = {
        name: member.__func__
        for name, member in vars(kind).items()
        if isinstance(member, staticmethod) and not name.startswith("_")
    }
    return {name: way for name, way in methods.items() if _hints(way).get("return") is kind}


@cache
def arguments(kind: type, way: str = "") -> dict[str, Argument]:
    """What the constructor of a class takes, or another way to make it, by name."""
    maker = ways_to_make(kind)[way] if way else MAKERS.get(kind, kind.__init__)
    hints = _hints(maker) | _hints(kind)
    declared = {f.name: f.metadata for f in fields(kind)} if is_dataclass(kind) else {}
    found = {}
    for name, parameter in inspect.signature(maker).parameters.items():
        if name == "self" or parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            continue
        required = parameter.default is parameter.empty
        expected = _declared(expectation(hints.get(name, Any)), declared.get(name, {}))
        found[name] = Argument(expected, required, None if required else parameter.default)
    return found


def _declared(expected: Expectation, metadata: Mapping) -> Expectation:
    """What is expected of a field that declares a unit, and perhaps a shape."""
    if "unit" not in metadata:
        return expected
    shape = getattr(metadata.get("declared"), "shape", None)
    shapes = expected.shapes if shape is None else (shape,)
    return replace(
        expected,
        unit=metadata["unit"],
        shapes=shapes,
        by_name=expected.by_name and _declared(expected.by_name, metadata),
        item=expected.item and _declared(expected.item, {"unit": metadata["unit"]}),
        is_text=expected.is_text and not expected.is_anything,
        is_flag=expected.is_flag and not expected.is_anything,
        is_anything=False,
    )


def _hints(owner: object) -> dict[str, object]:
    """Annotations of a class or of a function; as they are written where a name is unknown."""
    try:
        return get_type_hints(owner, include_extras=True)
    except NameError:
        return dict(getattr(owner, "__annotations__", {}))


def expectation(annotation: object) -> Expectation:
    """What an annotation says of the values there; a text in `Annotated` is their unit."""
    if get_origin(annotation) is Annotated:
        inner, *notes = get_args(annotation)
        unit = next((note for note in notes if isinstance(note, str)), None)
        return replace(expectation(inner), unit=unit)
    joined = get_origin(annotation) in (Union, UnionType)
    kinds = get_args(annotation) if joined else (annotation,)
    parts = [_of_one(kind) for kind in kinds if kind is not NoneType]
    return Expectation(
        unit=next((part.unit for part in parts if part.unit), None),
        shapes=tuple(shape for part in parts for shape in part.shapes),
        is_array=any(part.is_array for part in parts),
        classes=tuple(kind for part in parts for kind in part.classes),
        options=next((part.options for part in parts if part.options), None),
        is_text=any(part.is_text for part in parts),
        is_flag=any(part.is_flag for part in parts),
        is_anything=any(part.is_anything for part in parts),
        by_name=next((part.by_name for part in parts if part.by_name), None),
        item=next((part.item for part in parts if part.item), None),
        is_optional=NoneType in kinds,
    )


def _of_one(annotation: object) -> Expectation:
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
    """The shape that an array's annotation gives, if its sizes are fixed."""
    if annotation in (int, float):
        return ((),)
    sizes = [getattr(size, "size", None) for size in getattr(annotation, "dims", (None,))]
    known = tuple(size for size in sizes if isinstance(size, int))
    return (known,) if len(known) == len(sizes) else ()
