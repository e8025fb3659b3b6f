"""Make the tables of a file from a scene, a state and other objects."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum

import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree

from .class_names import class_name, is_from_package
from .expectations import ANYTHING, Argument, Expectation, arguments
from .locations import FileLocation, Keys
from .reading import ABSENT, KIND


@dataclass(frozen=True)
class Writer:
    """Converts objects to tables.

    - `units`: units of the converted numbers, by the keys that lead to them.
    - `user_classes`: user-defined classes of the converted objects.
    """

    units: dict[Keys, str] = field(default_factory=dict)
    user_classes: set[type] = field(default_factory=set)

    def table(self, instance: PyTree, location: FileLocation) -> dict[str, object]:
        """Return the table of the arguments with which the constructor makes the object again;
        defaults that are None or empty are left out.

        **Raises:** `ValueError` for arguments that the object does not store, and for values that a
        file can't hold.
        """
        if not is_from_package(type(instance)):
            self.user_classes.add(type(instance))
        entries: dict[str, object] = {}
        if KIND in arguments(type(instance)):
            location.at(KIND).refuse(
                KIND, "another name of the argument", "rename it: `kind` names classes"
            )
        stored = {entry.name: getattr(instance, entry.name) for entry in fields(instance)}
        for name, argument in arguments(type(instance)).items():
            if name not in stored and argument.is_required:
                remedy = "store it in a field of the same name, or give it a default"
                location.at(name).refuse("no field of this name", "one for each argument", remedy)
            value = stored.get(name)
            if name in stored and not _is_default(value, argument):
                entries[name] = self._value(value, argument.expected, location.at(name))
        return entries

    def _value(self, value: object, expected: Expectation, location: FileLocation) -> object:
        """Return a value as number, text, list or table, and note its unit."""
        if isinstance(value, Tracer):
            location.refuse(value, "a number", "call `save` outside functions that JAX transforms")
        if expected.unit is not None:
            self.units[location.keys] = expected.unit
        if isinstance(value, np.ndarray | np.generic | jax.Array):
            return self._value(np.asarray(value).tolist(), expected, location)
        if isinstance(value, Enum):
            return value.name
        if isinstance(value, Mapping):
            inner = expected.by_name or ANYTHING
            return {
                _name(key, location): self._value(item, inner, location.at(key))
                for key, item in value.items()
            }
        if isinstance(value, tuple | list):
            inner = expected.item or expected
            return [self._value(item, inner, location.at(k)) for k, item in enumerate(value)]
        if is_dataclass(value) and not isinstance(value, type):
            kind = {} if expected.classes == (type(value),) else {KIND: class_name(type(value))}
            return kind | self.table(value, location)
        return _atom(value, location)


def _is_default(value: object, argument: Argument) -> bool:
    """Return whether a value is an argument's default and can be left out: ``None``, or an empty
    table."""
    if argument.is_required:
        return False
    if value is None:
        return argument.default is None
    return isinstance(value, Mapping) and not value and not argument.default


def _name(key: object, location: FileLocation) -> str:
    if not isinstance(key, str):
        location.refuse(key, "a name", "use text for the keys of dictionaries")
    return key


def _atom(value: object, location: FileLocation) -> object:
    if value is None:
        return ABSENT
    if isinstance(value, bool | int | str):
        return value
    if not isinstance(value, float):
        name = "a function" if callable(value) else f"a {type(value).__name__}"
        location.refuse(
            value,
            "numbers, names, or objects of classes with fields",
            f"{name} can't be saved; make a class whose fields hold its numbers and whose method "
            "(`__call__`, say) computes its result, and pass the class to `load`",
        )
    if math.isnan(value):
        location.refuse(value, "a number", "replace it: NaN is not saved")
    return value if math.isfinite(value) else str(value)
