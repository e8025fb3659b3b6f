"""From objects to the tables of a file."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum

import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree

from .complaints import FilePlace, Keys
from .expectations import ANYTHING, Argument, Expectation, arguments
from .kinds import is_of_the_package, name_of
from .reading import ABSENT, KIND


@dataclass(frozen=True)
class Writer:
    """Writes objects as tables, and notes the `units` of numbers by their keys, and the classes
    that are not the package's."""

    units: dict[Keys, str] = field(default_factory=dict)
    own_classes: set[type] = field(default_factory=set)

    def table(self, instance: PyTree, place: FilePlace) -> dict[str, object]:
        """The arguments that make an object anew."""
        if not is_of_the_package(type(instance)):
            self.own_classes.add(type(instance))
        entries: dict[str, object] = {}
        if KIND in arguments(type(instance)):
            place.at(KIND).refuse(KIND, "another name of the argument", "it names classes: rename")
        stored = {entry.name: getattr(instance, entry.name) for entry in fields(instance)}
        for name, argument in arguments(type(instance)).items():
            if name not in stored and argument.is_required:
                remedy = "store it in a field of the same name, or give it a default"
                place.at(name).refuse("no such field", "one for each argument", remedy)
            value = stored.get(name)
            if name in stored and not _may_be_left_out(value, argument):
                entries[name] = self._value(value, argument.expected, place.at(name))
        return entries

    def _value(self, value: object, expected: Expectation, place: FilePlace) -> object:
        """Numbers, texts, lists and tables for a value."""
        if isinstance(value, Tracer):
            place.refuse(value, "a number", "save outside of functions that JAX transforms")
        if expected.unit is not None:
            self.units[place.keys] = expected.unit
        if isinstance(value, np.ndarray | np.generic | jax.Array):
            return self._value(np.asarray(value).tolist(), expected, place)
        if isinstance(value, Enum):
            return value.name
        if isinstance(value, Mapping):
            inner = expected.by_name or ANYTHING
            return {
                _name(key, place): self._value(item, inner, place.at(key))
                for key, item in value.items()
            }
        if isinstance(value, tuple | list):
            inner = expected.item or expected
            return [self._value(item, inner, place.at(k)) for k, item in enumerate(value)]
        if is_dataclass(value) and not isinstance(value, type):
            kind = {} if expected.classes == (type(value),) else {KIND: name_of(type(value))}
            return kind | self.table(value, place)
        return _atom(value, place)


def _may_be_left_out(value: object, argument: Argument) -> bool:
    """Whether a constructor would put the value there by itself: nothing, or no entries."""
    if argument.is_required:
        return False
    if value is None:
        return argument.default is None
    return isinstance(value, Mapping) and not value and not argument.default


def _name(key: object, place: FilePlace) -> str:
    if not isinstance(key, str):
        place.refuse(key, "a name", "use text for the keys of dictionaries")
    return key


def _atom(value: object, place: FilePlace) -> object:
    if value is None:
        return ABSENT
    if isinstance(value, bool | int | str):
        return value
    if not isinstance(value, float):
        what = "a function" if callable(value) else f"a {type(value).__name__}"
        place.refuse(
            value,
            "numbers, names, or objects of classes with fields",
            f"{what} can't be saved; make a class of your own whose fields hold its numbers, with "
            "what it computes as a method (`__call__`, say), and hand it over to `load`",
        )
    if math.isnan(value):
        place.refuse(value, "a number", "replace it: NaN is not saved")
    return value if math.isfinite(value) else str(value)
