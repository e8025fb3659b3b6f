"""From the tables of a file to objects, by the expectations of their classes' constructors."""

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
from .complaints import FilePlace, listed
from .expectations import ANYTHING, MAKERS, Expectation, arguments, ways_to_make
from .kinds import Classes, find_way, is_abstract
from .numbers import number_of_text

KIND = "kind"
"""The key by which a table names its class."""
EULER_PARAMETERS = (4,)
"""The shape of an orientation."""
ROTATION = {
    "axis": Expectation(unit="1", shapes=((3,),)),
    "angle": Expectation(unit="rad", shapes=((),)),
}
"""What a table in the place of Euler parameters has."""
ABSENT = "none"
"""The text that stands for ``None``, where that is not the default."""


@dataclass(frozen=True)
class Reader:
    """Reads with the package's classes, and those that the caller hands over."""

    classes: Classes

    def value(self, found: object, expected: Expectation, place: FilePlace) -> object:
        """The object, container, numbers or name that stand at a place."""
        read = self._item(found, expected, place)
        if not expected.is_array or not _may_be_numbers(read):
            return read
        try:
            return as_number(read)
        except ValueError as error:
            raise ValueError(f"{place}: {error}") from error

    def _item(self, found: object, expected: Expectation, place: FilePlace) -> object:
        if isinstance(found, Mapping):
            return self._table(found, expected, place)
        if isinstance(found, list):
            if all(map(_is_plain, found)):  # long tables, without a place for each number
                return tuple(found)
            inner = expected.item or expected
            return tuple(self._item(item, inner, place.at(k)) for k, item in enumerate(found))
        if isinstance(found, str):
            return _text(found, expected, place)
        if isinstance(found, float) and math.isnan(found):
            place.refuse(found, "a number", "replace it: no value may be NaN")
        if isinstance(found, bool) and not expected.is_flag:
            if expected.shapes or not expected.classes:
                simple = "a text" if expected.is_text else "a number"
                place.refuse(found, simple, "true and false are neither numbers nor texts")
            return found
        if isinstance(found, int) and abs(found) > sys.float_info.max:
            size, most = f"a whole number of {found.bit_length()} bits", sys.float_info.max
            place.refuse(size, f"a number below {most:.2g}", "write a smaller one")
        if found is None or isinstance(found, int | float):
            return found
        return place.refuse(found, "a number, text, list or table", "write one of these")

    def _table(self, found: Mapping, expected: Expectation, place: FilePlace) -> object:
        if expected.by_name is not None:
            inner = expected.by_name
            return {key: self.value(item, inner, place.at(key)) for key, item in found.items()}
        if expected.classes or KIND in found:
            kind, way = self._kind(found, expected, place)
            return self.instance(kind, found, place, way=way)
        if EULER_PARAMETERS in expected.shapes:
            return self._rotation(found, place)
        if not expected.is_anything:
            simple = "a text" if expected.is_text else "a number"
            place.refuse(dict(found), simple, "write it in place of the table")
        return {key: self.value(item, ANYTHING, place.at(key)) for key, item in found.items()}

    def _rotation(self, found: Mapping, place: FilePlace) -> object:
        """Euler parameters of an axis and an angle."""
        given = {}
        for name, expected in ROTATION.items():
            if name not in found:
                place.refuse(dict(found), " and ".join(ROTATION), f"add {name} ({expected.unit})")
            given[name] = self.value(found[name], expected, place.at(name))
        for name in set(found) - set(ROTATION):
            place.at(name).refuse(found[name], f"only {' and '.join(ROTATION)}", "leave it out")
        try:
            return tuple(rotation(**given).tolist())
        except ValueError as error:
            raise ValueError(f"{place}: {error}") from error

    def _kind(self, found: Mapping, expected: Expectation, place: FilePlace) -> tuple[type, str]:
        """The class that a table is of, and the way to make it, if it names another than the
        class."""
        if KIND in found:
            return find_way(found[KIND], expected.classes, self.classes, place.at(KIND))
        if len(expected.classes) == 1 and not is_abstract(expected.classes[0]):
            return expected.classes[0], ""
        family = " or ".join(kind.__name__ for kind in expected.classes)
        return place.refuse(
            dict(found), f"a table whose `{KIND}` names a class", f"add it: a subclass of {family}"
        )

    def instance(
        self,
        kind: type,
        found: Mapping,
        place: FilePlace,
        beside: tuple[str, ...] = (),
        way: str = "",
    ) -> PyTree:
        """An object of a class, made of a table of its constructor's arguments.

        **Arguments:** `beside`: other keys that the file may have there, for messages; `way`: the
        method that makes it, if it isn't the constructor.
        """
        known = arguments(kind, way)
        given = {}
        for name, item in found.items():
            if name == KIND:
                continue
            if name not in known:
                keys = [KIND, *known, *beside]
                remedy = nearest(name, keys, "leave it out")
                place.at(name).refuse(item, f"one of the keys {listed(keys)}", remedy)
            given[name] = self.value(item, known[name].expected, place.at(name))
        _require_complete(kind, way, given, place)
        try:
            made = (ways_to_make(kind)[way] if way else MAKERS.get(kind, kind))(**given)
        except (ValueError, TypeError) as error:
            raise ValueError(f"{_place_of_argument(error, found, place)}: {error}") from error
        for name, item in given.items():
            _require_kind(getattr(made, name, None), item, known[name].expected, place.at(name))
        return made


def _is_plain(item: object) -> bool:
    """Whether an entry of a list is a finite number, which stands for itself."""
    return type(item) in (int, float) and abs(item) <= sys.float_info.max  # pyright: ignore


def _place_of_argument(error: Exception, found: object, place: FilePlace) -> FilePlace:
    """The place of the argument that an error of a constructor names first, as far as the file has
    it: "Argument `joints['pin'].first` must be ..." is about `joints.pin.first`."""
    named = re.match(r"Argument `([^`]+)`", str(error))
    for quoted, bare in re.findall(r"\['([^']*)'\]|(\w+)", named[1] if named else ""):
        if not isinstance(found, Mapping) or (quoted or bare) not in found:
            break
        found, place = found[quoted or bare], place.at(quoted or bare)
    return place


def _may_be_numbers(read: object) -> bool:
    """Whether what was read is a number, or a row without objects."""
    if isinstance(read, tuple):
        return not any(is_dataclass(part) for part in read)
    return isinstance(read, int | float)


def _require_complete(kind: type, way: str, given: dict[str, object], place: FilePlace) -> None:
    """Check that nothing is missing that the constructor, or another way to make it, needs."""
    known = arguments(kind, way)
    missing = [name for name, argument in known.items() if argument.is_required]
    missing = [name for name in missing if name not in given]
    if missing:
        units = {name: known[name].expected.unit for name in missing}
        named = [f"{name} ({units[name]})" if units[name] else name for name in missing]
        raise ValueError(f"{place}: a {kind.__name__} also needs {', '.join(named)}: add them.")


def _require_kind(stored: object, given: object, expected: Expectation, place: FilePlace) -> None:
    """Check that an element is one, whatever the constructor made of what was given; or numbers,
    where they may stand in its place."""
    numbers = bool(expected.shapes) and isinstance(stored, np.ndarray | tuple)
    if not expected.classes or stored is None or numbers:
        return
    if not isinstance(stored, expected.classes):
        family = " or ".join(kind.__name__ for kind in expected.classes)
        place.refuse(given, f"a table whose `{KIND}` is a {family}", "write one")


def _text(found: str, expected: Expectation, place: FilePlace) -> object:
    if expected.options is not None:
        names = list(expected.options.__members__)
        if found not in names:
            remedy = nearest(found, names, "write one of these")
            place.refuse(found, f"one of {listed(names)}", remedy)
        return expected.options[found]
    if expected.is_text:
        return found
    return None if found == ABSENT else number_of_text(found, expected.unit, place)
