"""The JSON Schema of scene files, by which editors complete and check them."""

from dataclasses import dataclass, field
from typing import TypeAlias

from ..model.bodies import State
from ..model.scene import Scene
from .expectations import Argument, Expectation, arguments, ways_to_make
from .formats import SCHEMA
from .kinds import Classes, is_abstract, known_kinds, name_of, require_classes
from .reading import EULER_PARAMETERS, KIND, ROTATION

Schema: TypeAlias = dict[str, object]
DIALECT = "https://json-schema.org/draft/2020-12/schema"
NUMBER: Schema = {"type": ["number", "string"]}
ROWS = "numbers"
"""The name of what describes rows of rows of numbers."""


def scene_schema(classes: Classes = ()) -> Schema:
    """The JSON Schema (2020-12) of scene files, made of the classes' arguments and units.

    Editors complete and check TOML and JSON by it: `save(..., schema=True)` writes it beside a file
    and names it there.

    **Arguments:** `classes`: those of your own that files may name.

    **Returns:** a dictionary for `json.dump`.

    >>> schema = cj.scene_schema()
    >>> schema["$schema"]
    'https://json-schema.org/draft/2020-12/schema'
    """
    require_classes(classes)
    catalogue = Catalogue(classes)
    return catalogue.document("scene", scene_properties(catalogue), ["bodies"])


def scene_properties(catalogue: "Catalogue") -> Schema:
    """What may stand at the top of a scene file."""
    return {
        "format": {"type": "integer", "minimum": 1, "description": "version of the file's form"},
        **catalogue.properties(Scene),
        "state": _table(catalogue.properties(State), []),
    }


@dataclass(frozen=True)
class Catalogue:
    """Descriptions of classes by name, each made where it is first referred to."""

    classes: Classes
    definitions: Schema = field(
        default_factory=lambda: {ROWS: {"anyOf": [NUMBER, _list_of(_reference(ROWS))]}}
    )

    def document(self, title: str, properties: Schema, required: list[str]) -> Schema:
        """The schema of a whole file with these keys."""
        whole = _table({SCHEMA: {"type": "string"}, **properties}, required)
        return {SCHEMA: DIALECT, "title": title, **whole, "$defs": self.definitions}

    def properties(self, kind: type, way: str = "") -> Schema:
        """Of each argument of a class, or of another way to make it, what may stand there."""
        known = arguments(kind, way).items()
        return {name: self._argument(argument) for name, argument in known}

    def _argument(self, argument: Argument) -> Schema:
        unit = argument.expected.unit
        described = self._value(argument.expected)
        return described if unit is None else {**described, "description": f"unit: {unit}"}

    def _value(self, expected: Expectation) -> Schema:
        """What may stand at a place."""
        if expected.is_anything:
            return {}
        if expected.options is not None:
            return {"enum": list(expected.options.__members__)}
        if expected.by_name is not None:
            return {"type": "object", "additionalProperties": self._value(expected.by_name)}
        if expected.item is not None:
            row = _list_of(self._value(expected.item))
            return {"anyOf": [{"type": "string"}, row]} if expected.is_text else row
        if expected.classes:
            return {"anyOf": [*self._references(expected.classes), NUMBER]}
        if expected.is_text:
            return {"type": "string"}
        return _numbers(expected.shapes)

    def _references(self, families: tuple[type, ...]) -> list[Schema]:
        implied = len(families) == 1 and not is_abstract(families[0])
        kinds = {kind: name_of(kind) for kind in known_kinds(families, self.classes).values()}
        names = []
        for kind, own in kinds.items():
            for way in ("", *ways_to_make(kind)):
                names.append(f"{own}.{way}" if way else own)
                if names[-1] not in self.definitions:
                    self.definitions[names[-1]] = {}  # known from here: it may refer to itself
                    self.definitions[names[-1]] = self._definition(kind, own, way, implied)
        return [_reference(name) for name in names]

    def _definition(self, kind: type, name: str, way: str, implied: bool) -> Schema:
        end = f".{way}" if way else ""
        properties: Schema = {KIND: {"enum": sorted({name + end, kind.__name__ + end})}}
        properties |= self.properties(kind, way)
        needed = [key for key, argument in arguments(kind, way).items() if argument.is_required]
        table = _table(properties, needed if implied and not way else [KIND, *needed])
        described = ways_to_make(kind)[way] if way else kind
        summary = (described.__doc__ or "").strip().split("\n")[0]
        return {**table, "description": summary}


def _table(properties: Schema, required: list[str]) -> Schema:
    return {
        "type": "object",
        "properties": properties,
        "required": required,
        "additionalProperties": False,
    }


def _list_of(item: Schema, length: int | None = None) -> Schema:
    size = {} if length is None else {"minItems": length, "maxItems": length}
    return {"type": "array", "items": item, **size}


def _reference(name: str) -> Schema:
    return {"$ref": f"#/$defs/{name}"}


def _numbers(shapes: tuple[tuple[int, ...], ...]) -> Schema:
    """Numbers, or texts with units, of one of the shapes; of any where none is known."""
    if not shapes:
        return {"anyOf": [{"type": "boolean"}, _reference(ROWS)]}
    described = []
    for shape in shapes:
        one = NUMBER
        for size in reversed(shape):
            one = _list_of(one, size)
        described.append(one)
        if shape == EULER_PARAMETERS:
            turn: Schema = {name: _numbers(argument.shapes) for name, argument in ROTATION.items()}
            described.append(_table(turn, list(turn)))
    return described[0] if len(described) == 1 else {"anyOf": described}
