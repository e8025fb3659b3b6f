"""Make the tables of a file from a scene, a state and other objects."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum

import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree

from .classes import ANYTHING, REQUIRED, Expectation, arguments, class_name, is_from_package
from .locations import FileLocation, Keys
from .reading import ABSENT, KIND


@dataclass(frozen=True)
class Writer:
    """Converts a scene, a state and the objects in them to tables.

    - `units`: units of the converted values, by the keys that lead to them; "1" for a value without
      unit.
    - `user_classes`: user-defined classes among those of the converted objects.
    """

    units: dict[Keys, str] = field(default_factory=dict)
    user_classes: set[type] = field(default_factory=set)

    def table(self, instance: PyTree, location: FileLocation) -> dict[str, object]:
        """Return the table of an object: the arguments with which its constructor makes the object
        again. Arguments whose default and value are None or empty are left out.

        **Raises:** `ValueError` for arguments that the object does not store in a field of the same
        name, and for values that a file can't hold.
        """
        kind = type(instance)
        if not is_from_package(kind):
            self.user_classes.add(kind)
        if KIND in arguments(kind):  # the key of a table that names its class
            remedy = "rename it: `kind` names classes"
            location.at(KIND).refuse(KIND, "another name of the argument", remedy)
        stored = {entry.name: getattr(instance, entry.name) for entry in fields(instance)}
        entries: dict[str, object] = {}
        for name, expected in arguments(kind).items():
            if name in stored:
                value, default = stored[name], expected.default
                is_none = value is None and default is None
                is_empty = isinstance(value, Mapping) and not value and not default
                if not (is_none or is_empty):
                    entries[name] = self._value(value, expected, location.at(name))
            elif expected.default is REQUIRED:
                remedy = "store it in a field of the same name, or give it a default"
                missing = "no field of this name"
                location.at(name).refuse(missing, "one for each argument", remedy)
        return entries

    def _value(self, value: object, expected: Expectation, location: FileLocation) -> object:
        """Return a value as a number, text, list or table, and add its unit to `units`.

        **Raises:** `ValueError` for a value that a file can't hold, such as a function or NaN.
        """
        if isinstance(value, Tracer):
            location.refuse(value, "a number", "call `save` outside functions that JAX transforms")
        self.units[location.keys] = expected.unit or "1"
        if isinstance(value, np.ndarray | np.generic | jax.Array):
            return self._value(np.asarray(value).tolist(), expected, location)
        if isinstance(value, Enum):
            return value.name
        if isinstance(value, Mapping):
            inner = expected.by_name or ANYTHING
            for key in value:
                if not isinstance(key, str):
                    location.refuse(key, "a name", "use text for the keys of dictionaries")
            return {key: self._value(one, inner, location.at(key)) for key, one in value.items()}
        if isinstance(value, tuple | list):
            inner = expected.item or expected
            return [self._value(item, inner, location.at(k)) for k, item in enumerate(value)]
        # The table need not name the class that the reader takes for this argument by default.
        if is_dataclass(value) and not isinstance(value, type):
            kind = {} if expected.classes == (type(value),) else {KIND: class_name(type(value))}
            return kind | self.table(value, location)
        if value is None:
            return ABSENT
        if isinstance(value, bool | int | str):
            return value
        if not isinstance(value, float):
            name = "a function" if callable(value) else f"a {type(value).__name__}"
            location.refuse(
                value,
                "numbers, names, or objects of classes with fields",
                f"{name} can't be saved; make a class whose fields hold its numbers and whose "
                "method (`__call__`, say) computes its result, and pass the class to `load`",
            )
        if math.isnan(value):
            location.refuse(value, "a number", "replace it: NaN is not saved")
        return value if math.isfinite(value) else str(value)  # JSON has no infinity
