"""Make objects from the tables of a file, whose entries are the arguments of constructors."""

import math
import re
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, is_dataclass
from decimal import Decimal
from typing import Annotated

import numpy as np
from jaxtyping import Float, PyTree

from .._fields.checks import as_number, nearest
from .._measurements.series import to_si
from .._model.bodies import rotation
from .classes import (
    ANYTHING,
    CHECKED,
    REQUIRED,
    Classes,
    Expectation,
    Maker,
    arguments,
    family_names,
    find_maker,
    is_abstract,
)
from .documents import FileLocation, existing, listed, split

KIND = "kind"
"""Key under which a table names its class."""
EULER_PARAMETERS = (4,)
ABSENT = "none"
"""Text that stands for ``None``, which TOML does not have."""
NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?inf)(?:\s+|(?=\D)|$)(.*)")
"""Pattern of a number and the unit after it, which may be empty."""


def axis_and_angle(
    axis: Annotated[Float[np.ndarray, "3"], "1"], angle: Annotated[float, "rad"]
) -> tuple:
    """Return the Euler parameters, scalar first, of a rotation about an axis. In a file, a table
    with the keys `axis` and `angle` may stand for them."""
    return tuple(rotation(axis, angle).tolist())


@dataclass(frozen=True)
class Reader:
    """Makes objects from the content of a file, which may name the user-defined `classes`."""

    classes: Classes

    def value(self, content: object, expected: Expectation, location: FileLocation) -> object:
        value = self._item(content, expected, location)
        # A tuple of objects stays a tuple; other tuples are rows of numbers and become arrays.
        rows = value if isinstance(value, tuple) else ()
        is_number = isinstance(value, int | float | tuple) and not any(map(is_dataclass, rows))
        if not expected.is_array or not is_number:
            return value
        with location.in_errors():
            return as_number(value)

    def _item(self, content: object, expected: Expectation, location: FileLocation) -> object:
        """Convert the `content` of an entry of a file to a Python value: lists to tuples, texts
        with units to floats, and tables to objects."""
        # A table of entries by name, such as `bodies`, may be allowed beside the options.
        if isinstance(content, Mapping) and expected.by_name is not None:
            return self._table(content, expected, location)
        # Arguments that may also be numbers or objects are not limited to their options.
        options = None if expected.shapes or expected.classes else expected.options
        if options is not None and not (content is None or isinstance(content, str)):
            location.refuse(content, f"one of {listed(options)}", "write one of these")
        if isinstance(content, Mapping):
            return self._table(content, expected, location)
        if isinstance(content, list):
            # Finite numbers need no conversion: fast for long tables, without a location for each.
            if all(type(v) in (int, float) and abs(v) <= sys.float_info.max for v in content):
                return tuple(content)
            # Without `item` the list is an array: its entries are numbers, or rows of them.
            of_entry = expected.item or expected
            return tuple(self._item(v, of_entry, location.at(k)) for k, v in enumerate(content))
        if isinstance(content, str):
            return _text(content, expected, location)
        if isinstance(content, float) and math.isnan(content):
            location.refuse(content, "a number", "replace it: no value may be NaN")
        if isinstance(content, bool) and not expected.is_flag:
            # Where an object is expected, its class decides on true and false.
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
        # A table of entries by name may have one that is called "kind".
        if expected.by_name is None:
            families = expected.classes
            if KIND in content:
                make = find_maker(content[KIND], families, self.classes, location.at(KIND))
                return self.instance(make, content, location)
            # Without a class in the file, only one class must be possible.
            if len(families) == 1 and not is_abstract(families[0]):
                return self.instance(families[0], content, location)
            if families:
                remedy = f"add it: a subclass of {family_names(families)}"
                location.refuse(dict(content), f"a table whose `{KIND}` names a class", remedy)
            # Where no object is expected, a table may stand for Euler parameters.
            if EULER_PARAMETERS in expected.shapes:
                return self.instance(axis_and_angle, content, location)
            if not expected.allows_anything:
                simple = "a text" if expected.is_text else "a number"
                location.refuse(dict(content), simple, "replace the table by one")
        of_entry = expected.by_name or ANYTHING
        return {key: self.value(item, of_entry, location.at(key)) for key, item in content.items()}

    def instance(
        self, make: Maker, content: Mapping, location: FileLocation, other_keys: Sequence[str] = ()
    ) -> PyTree:
        """Make an object by calling a class or static method with the entries of a table.
        `other_keys`: keys of the table that the caller reads, for messages about unknown keys."""
        signature = arguments(make)
        values = {}  # arguments as Python values
        for name, item in content.items():
            if name == KIND:
                continue
            if name not in signature:
                keys = [KIND, *signature, *other_keys]
                remedy = nearest(name, keys, "leave it out")
                location.at(name).refuse(item, f"one of the keys {listed(keys)}", remedy)
            values[name] = self.value(item, signature[name], location.at(name))
        # Classes with the arguments `quantity` and `unit` are reductions: results that are updated
        # at every step, such as the peak of a quantity. The unit may be omitted: it is then that of
        # the quantity.
        unit = getattr(values.get("quantity"), "unit", None)
        is_required = "unit" in signature and signature["unit"].default is REQUIRED
        if is_required and "unit" not in values and unit is not None:
            values["unit"] = unit
        missing = {n: e for n, e in signature.items() if e.default is REQUIRED and n not in values}
        if missing:
            names = ", ".join(f"{n} ({e.unit})" if e.unit else n for n, e in missing.items())
            raise ValueError(f"{location}: a {make.__qualname__} also needs {names}: add them.")
        try:
            # A function in `CHECKED` replaces a constructor that does not check its arguments.
            made = CHECKED.get(make, make)(**values)
        except (ValueError, TypeError) as error:
            # The message names an argument as "Argument `joints['pin'].first` must be ...". These
            # keys lead from the table to the location of the wrong value.
            named = re.match(r"Argument `([^`]+)`", str(error))
            keys = existing(content, split(named[1] if named else ""))
            raise ValueError(f"{location.at(*keys)}: {error}") from error
        # Not every constructor checks the classes of its arguments. Some convert them, so what is
        # stored is checked. Where objects are allowed, ``None``, tables of entries by name, numbers
        # or options may be allowed too; these are no objects of the classes.
        for name, item in values.items():
            allowed, stored = signature[name], getattr(made, name, None)
            is_no_object = (
                stored is None
                or isinstance(item, Mapping)
                or (bool(allowed.shapes) and isinstance(stored, int | float | tuple | np.ndarray))
                or any(item is option for option in (allowed.options or {}).values())
            )
            if allowed.classes and not (is_no_object or isinstance(stored, allowed.classes)):
                expected = f"a table whose `{KIND}` is a {family_names(allowed.classes)}"
                location.at(name).refuse(item, expected, "write one")
            if allowed.by_name is not None and not is_no_object:
                location.at(name).refuse(item, "a table of entries by name", "write one")
        return made


def _text(content: str, expected: Expectation, location: FileLocation) -> object:
    options = expected.options or {}
    if content in options:
        return options[content]
    if options and not (expected.is_text or content == ABSENT):
        remedy = nearest(content, options, "write one of these")
        location.refuse(content, f"one of {listed(options)}", remedy)
    if expected.is_text:
        return content
    return None if content == ABSENT else number_of_text(content, expected.unit, location)


def number_of_text(text: str, unit: str | None, location: FileLocation) -> float:
    """Return the number in a text, in the SI unit `unit`, rounded only once, so that "0.3 mm" gives
    the same float as 3e-4. If `unit` is ``None``, a text with a unit is refused."""
    expected = "a number" if unit is None else f"a number in {unit}"
    # Longer texts are no numbers that a user means, and exact computation with them may be slow.
    matched = NUMBER.fullmatch(text) if len(text) <= 200 else None
    if matched is None:
        location.refuse(text, expected, "write a number, in quotes only if it has a unit")
    digits, written = matched[1], matched[2].strip()
    number = converted = float(digits)
    if written:
        if unit is None:
            remedy = "write a plain number in SI units; fields made by `quantity` convert units"
            location.refuse(text, "a number without a unit, since none is declared", remedy)
        try:
            factor, _ = to_si(written, unit)
        except ValueError:
            remedy = f"write a unit of this dimension, or a plain number in {unit}"
            location.refuse(text, expected, remedy)
        # Decimal numbers have 28 digits in products, a float 17: only float() rounds noticeably.
        # The exponent may be too low for Decimal, below -1e18: the float is zero.
        with suppress(ArithmeticError):
            converted = float(Decimal(digits) * Decimal(repr(factor)))
    if "inf" not in digits and (math.isinf(number) or math.isinf(converted)):  # 1e999, say
        largest = f"a number below {sys.float_info.max:.2g} {unit if written else ''}".strip()
        location.refuse(text, largest, "write a smaller one")
    return converted
