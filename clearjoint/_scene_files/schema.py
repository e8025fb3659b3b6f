"""JSON Schema of scene files. Each class has a definition, to which others refer."""

from dataclasses import dataclass, field
from typing import TypeAlias

from .._model.bodies import State
from .._model.scene import Scene
from .classes import REQUIRED, Classes, Expectation, Maker, arguments, is_abstract, makers
from .documents import SCHEMA
from .reading import ABSENT, EULER_PARAMETERS, KIND, axis_and_angle

Schema: TypeAlias = dict[str, object]
NUMBER: Schema = {"type": ["number", "string"]}
"""Schema of a number, which may be a text with a unit."""
ROWS = "numbers"
"""Name of the definition of a number or of nested lists of numbers."""


def scene_schema(classes: Classes = ()) -> Schema:
    """Return the JSON Schema (2020-12) of scene files, as a dictionary for `json.dump`.

    With it, editors complete and check TOML and JSON files. `save(..., schema=True)` writes the
    schema to the folder of a scene file, and a reference to it into the scene file.

    **Arguments:** `classes`: user-defined classes that files may name.

    >>> schema = cj.scene_schema()
    >>> schema["$schema"]
    'https://json-schema.org/draft/2020-12/schema'
    """
    catalogue = Catalogue(classes)
    return catalogue.document("scene", scene_properties(catalogue), ["bodies"])


def scene_properties(catalogue: "Catalogue") -> Schema:
    version = {"type": "integer", "minimum": 1, "description": "version of the file format"}
    state = _table(catalogue.properties(State), [])
    return {"format": version, **catalogue.properties(Scene), "state": state}


@dataclass(frozen=True)
class Catalogue:
    """Makes the schema of a file that may name the user-defined `classes`. `definitions`: schemas
    to which others refer, by name: one for each maker (a class or static method that files may
    name), added when first needed, and `ROWS`, for a number or nested lists of numbers."""

    classes: Classes
    definitions: Schema = field(
        default_factory=lambda: {ROWS: {"anyOf": [NUMBER, _list_of(_reference(ROWS))]}}
    )

    def document(self, title: str, properties: Schema, required: list[str]) -> Schema:
        table = _table({SCHEMA: {"type": "string"}, **properties}, required)
        dialect = "https://json-schema.org/draft/2020-12/schema"
        return {SCHEMA: dialect, "title": title, **table, "$defs": self.definitions}

    def properties(self, make: Maker) -> Schema:
        """Return the schemas of a maker's arguments by name, with their units as descriptions."""
        return {
            name: self._value(expected)
            | ({} if expected.unit is None else {"description": f"unit: {expected.unit}"})
            for name, expected in arguments(make).items()
        }

    def _value(self, expected: Expectation) -> Schema:
        if expected.allows_anything:
            return {}
        ways: list[Schema] = []  # schemas of which a value must match one
        if expected.options is not None:
            ways.append({"enum": list(expected.options)})
        if expected.by_name is not None:
            ways.append({"type": "object", "additionalProperties": self._value(expected.by_name)})
        if expected.item is not None:
            ways.append(_list_of(self._value(expected.item)))
        if expected.classes:  # a number in place of an object is checked by the constructor
            ways += [*self._references(expected.classes), NUMBER]
        elif expected.is_text:
            ways.append(NUMBER if expected.shapes else {"type": "string"})  # `NUMBER` allows texts
        elif expected.shapes or not ways:
            ways += _numbers(expected.shapes)
        # Where texts are allowed, as in a `NUMBER` with a unit, "none" is allowed already.
        if expected.allows_none and not (expected.is_text or NUMBER in ways):
            ways.append({"const": ABSENT})
        return _any_of(ways)

    def _references(self, families: tuple[type, ...]) -> list[Schema]:
        """Return references to definitions, added if missing, of all makers of the `families`."""
        # A user-defined class has two names; the last one, with its module, names its definition.
        names: dict[Maker, list[str]] = {}
        for name, make in makers(families, self.classes).items():
            names.setdefault(make, []).append(name)
        for make, aliases in names.items():
            if aliases[-1] not in self.definitions:
                self.definitions[aliases[-1]] = {}  # the definition may refer to itself
                properties = {KIND: {"enum": sorted(aliases)}} | self.properties(make)
                # Classes with the arguments `quantity` and `unit` are reductions: results that are
                # updated at every step, such as the peak of a quantity. The unit may be omitted,
                # since the reader then takes that of the quantity.
                omitted = "unit" if "quantity" in properties else None
                required = [n for n, e in arguments(make).items() if e.default is REQUIRED]
                needed = [name for name in required if name != omitted]
                summary = (make.__doc__ or "").strip().split("\n")[0]
                definition = _table(properties, needed) | {"description": summary}
                self.definitions[aliases[-1]] = definition
        # The class that a table has if it does not name one. Another argument may allow further
        # classes, so that the definition itself doesn't require the name.
        implied = families[0] if len(families) == 1 and not is_abstract(families[0]) else None
        references = [(make, _reference(aliases[-1])) for make, aliases in names.items()]
        # Editors that follow older drafts ignore what stands beside "$ref", but not beside "allOf".
        return [r if m is implied else {"allOf": [r], "required": [KIND]} for m, r in references]


def _table(properties: Schema, required: list[str]) -> Schema:
    table: Schema = {"type": "object", "properties": properties, "required": required}
    return table | {"additionalProperties": False}


def _list_of(item: Schema, length: int | None = None) -> Schema:
    size = {} if length is None else {"minItems": length, "maxItems": length}
    return {"type": "array", "items": item, **size}


def _reference(name: str) -> Schema:
    return {"$ref": f"#/$defs/{name}"}


def _any_of(ways: list[Schema]) -> Schema:
    return ways[0] if len(ways) == 1 else {"anyOf": ways}


def _numbers(shapes: tuple[tuple[int, ...], ...]) -> list[Schema]:
    """Return the schemas of arrays of the given shapes, whose numbers may be texts with units.
    Without shapes, return the schemas of arrays of any shape, and of true and false, because the
    `Expectation` of a flag has no shapes, and neither has one whose shapes are unknown."""
    if not shapes:
        return [{"type": "boolean"}, _reference(ROWS)]
    schemas = []
    for shape in shapes:
        schema = NUMBER
        for size in reversed(shape):
            schema = _list_of(schema, size)
        schemas.append(schema)
        if shape == EULER_PARAMETERS:  # a table with an axis and an angle may replace them
            entries = arguments(axis_and_angle)
            properties: Schema = {n: _any_of(_numbers(e.shapes)) for n, e in entries.items()}
            schemas.append(_table(properties, list(properties)))
    return schemas
