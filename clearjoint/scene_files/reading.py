"""Make objects from the tables of a file, whose entries are the arguments of constructors."""

import math
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, is_dataclass

import numpy as np
from jaxtyping import PyTree

from ..fields.checks import as_number
from ..fields.suggestions import nearest
from ..model.orientations import rotation
from .class_names import Classes, family_names, find_factory, is_abstract
from .expectations import ANYTHING, Expectation, arguments, constructor
from .locations import FileLocation, listed
from .numbers import number_of_text

KIND = "kind"
"""The key under which a table names its class."""
EULER_PARAMETERS = (4,)
"""The shape of an orientation."""
ROTATION = {
    "axis": Expectation(unit="1", shapes=((3,),)),
    "angle": Expectation(unit="rad", shapes=((),)),
}
"""Entries of a table that may replace Euler parameters."""
ABSENT = "none"
"""Text that stands for ``None``, which TOML does not have."""


@dataclass(frozen=True)
class Reader:
    """Makes objects from the content of a file.

    - `classes`: user-defined classes that the file may name, besides those of the package.
    """

    classes: Classes

    def value(self, content: object, expected: Expectation, location: FileLocation) -> object:
        """Return the Python value of the content of a file at a location: an object, a tuple, a
        dictionary, a number or a text.

        **Raises:** `ValueError` if the content is not as expected.
        """
        value = self._item(content, expected, location)
        rows = value if isinstance(value, tuple) else ()
        is_number = isinstance(value, int | float | tuple) and not any(map(is_dataclass, rows))
        if not expected.is_array or not is_number:
            return value
        try:
            return as_number(value)
        except ValueError as error:
            raise ValueError(f"{location}: {error}") from error

    def _item(self, content: object, expected: Expectation, location: FileLocation) -> object:
        if isinstance(content, Mapping):
            return self._table(content, expected, location)
        if isinstance(content, list):
            if all(map(_is_plain, content)):  # fast for long tables: no location for each number
                return tuple(content)
            inner = expected.item or expected
            return tuple(self._item(v, inner, location.at(k)) for k, v in enumerate(content))
        if isinstance(content, str):
            return _text(content, expected, location)
        if isinstance(content, float) and math.isnan(content):
            location.refuse(content, "a number", "replace it: no value may be NaN")
        if isinstance(content, bool) and not expected.is_flag:
            if expected.shapes or not expected.classes:
                simple = "a text" if expected.is_text else "a number"
                location.refuse(content, simple, "true and false are neither numbers nor texts")
            return content
        if isinstance(content, int) and abs(content) > sys.float_info.max:
            size, largest = f"a whole number of {content.bit_length()} bits", sys.float_info.max
            location.refuse(size, f"a number below {largest:.2g}", "write a smaller one")
        if content is None or isinstance(content, int | float):
            return content
        return location.refuse(content, "a number, text, list or table", "write one of these")

    def _table(self, content: Mapping, expected: Expectation, location: FileLocation) -> object:
        if expected.by_name is None:
            if expected.classes or KIND in content:
                kind, factory = self._class(content, expected, location)
                return self.instance(kind, content, location, factory=factory)
            if EULER_PARAMETERS in expected.shapes:
                return self._rotation(content, location)
            if not expected.is_anything:
                simple = "a text" if expected.is_text else "a number"
                location.refuse(dict(content), simple, "replace the table by one")
        inner = expected.by_name or ANYTHING
        return {key: self.value(item, inner, location.at(key)) for key, item in content.items()}

    def _rotation(self, content: Mapping, location: FileLocation) -> object:
        """Return the Euler parameters, four numbers, of a table with `axis` and `angle`."""
        given = {}
        for name, expected in ROTATION.items():
            if name not in content:
                remedy = f"add {name} ({expected.unit})"
                location.refuse(dict(content), " and ".join(ROTATION), remedy)
            given[name] = self.value(content[name], expected, location.at(name))
        for name in set(content) - set(ROTATION):
            expected = f"only {' and '.join(ROTATION)}"
            location.at(name).refuse(content[name], expected, "leave it out")
        try:
            return tuple(rotation(**given).tolist())
        except ValueError as error:
            raise ValueError(f"{location}: {error}") from error

    def _class(
        self, content: Mapping, expected: Expectation, location: FileLocation
    ) -> tuple[type, str]:
        """Return the class of which a table describes an object, and the name of the static method
        that makes it, "" for the constructor."""
        if KIND in content:
            kind_location = location.at(KIND)
            return find_factory(content[KIND], expected.classes, self.classes, kind_location)
        if len(expected.classes) == 1 and not is_abstract(expected.classes[0]):
            return expected.classes[0], ""
        remedy = f"add it: a subclass of {family_names(expected.classes)}"
        return location.refuse(dict(content), f"a table whose `{KIND}` names a class", remedy)

    def instance(
        self,
        kind: type,
        content: Mapping,
        location: FileLocation,
        other_keys: tuple[str, ...] = (),
        factory: str = "",
    ) -> PyTree:
        """Make an object of a class from the table of its constructor's arguments.

        **Arguments:**

        - `kind`: the class.
        - `content`: arguments by name, as read from the file.
        - `location`: location of the table.
        - `other_keys`: keys that the table of the file has had besides `content`, for messages.
        - `factory`: name of a static method to call instead of the constructor.

        **Raises:** `ValueError` for unknown and missing arguments, and for wrong values.
        """
        known = arguments(kind, factory)
        given = {}
        for name, item in content.items():
            if name == KIND:
                continue
            if name not in known:
                keys = [KIND, *known, *other_keys]
                remedy = nearest(name, keys, "leave it out")
                location.at(name).refuse(item, f"one of the keys {listed(keys)}", remedy)
            given[name] = self.value(item, known[name].expected, location.at(name))
        needed = {name: one.expected.unit for name, one in known.items() if one.is_required}
        missing = {name: unit for name, unit in needed.items() if name not in given}
        if missing:
            named = [f"{name} ({unit})" if unit else name for name, unit in missing.items()]
            names = ", ".join(named)
            raise ValueError(f"{location}: a {kind.__name__} also needs {names}: add them.")
        try:
            made = constructor(kind, factory)(**given)
        except (ValueError, TypeError) as error:
            raise ValueError(f"{_argument_location(error, content, location)}: {error}") from error
        for name, item in given.items():
            stored = getattr(made, name, None)
            _require_class(stored, item, known[name].expected, location.at(name))
        return made


def _is_plain(item: object) -> bool:
    """Return whether an entry of a list is a finite number, which needs no conversion."""
    return type(item) in (int, float) and abs(item) <= sys.float_info.max  # pyright: ignore


def _argument_location(error: Exception, content: object, location: FileLocation) -> FileLocation:
    """Return the location of the argument that the message of a constructor's error names.

    This is `joints.pin.first` for "Argument `joints['pin'].first` must be ...", or the closest
    table around it that the file has.
    """
    named = re.match(r"Argument `([^`]+)`", str(error))
    for quoted, bare in re.findall(r"\['([^']*)'\]|(\w+)", named[1] if named else ""):
        if not isinstance(content, Mapping) or (quoted or bare) not in content:
            break
        content, location = content[quoted or bare], location.at(quoted or bare)
    return location


def _require_class(
    stored: object, given: object, expected: Expectation, location: FileLocation
) -> None:
    """Raise `ValueError` unless `stored`, which a constructor has made of `given`, is an object of
    an expected class, or numbers where these are allowed: not every constructor checks."""
    is_number = bool(expected.shapes) and isinstance(stored, np.ndarray | tuple)
    if not expected.classes or stored is None or is_number:
        return
    if not isinstance(stored, expected.classes):
        family = family_names(expected.classes)
        location.refuse(given, f"a table whose `{KIND}` is a {family}", "write one")


def _text(content: str, expected: Expectation, location: FileLocation) -> object:
    """Return the member of an enumeration, the text, the number or the None for which a text
    stands."""
    if expected.options is not None:
        names = list(expected.options.__members__)
        if content not in names:
            remedy = nearest(content, names, "write one of these")
            location.refuse(content, f"one of {listed(names)}", remedy)
        return expected.options[content]
    if expected.is_text:
        return content
    return None if content == ABSENT else number_of_text(content, expected.unit, location)
