"""JSON Schemas of scene files and of study files."""

from ..scene_files.schema import Catalogue, Schema, scene_properties, scene_schema
from ..simulation.step.settings import Settings
from .study_parts import (
    AxisPart,
    ColumnPart,
    FitPart,
    ParameterPart,
    RunPart,
    SectionPart,
    StudyParts,
    SweepPart,
)
from .vocabulary import CLASSES

TABLES = (AxisPart, ColumnPart, FitPart, ParameterPart, RunPart, SectionPart, Settings, SweepPart)


def schema_of(kind: str) -> Schema:
    """The JSON Schema (2020-12) of "scene" files or of "study" files."""
    return scene_schema() if kind == "scene" else study_schema()


def study_schema() -> Schema:
    """The JSON Schema of study files, of which a scene is a part or beside them."""
    catalogue = Catalogue((*CLASSES, *TABLES))
    scene = {"type": "object", "properties": scene_properties(catalogue), "required": ["bodies"]}
    properties = {"scene": {"anyOf": [{"type": "string"}, scene]}}
    properties |= catalogue.properties(StudyParts)
    for definition in catalogue.definitions.values():
        _leave_unit_to_quantity(definition)
    return catalogue.document("study", properties, ["scene"])


def _leave_unit_to_quantity(definition: object) -> None:
    """What has a quantity need not repeat its unit."""
    table = definition if isinstance(definition, dict) else {}
    if "quantity" in table.get("properties", {}):
        table["required"] = [name for name in table["required"] if name != "unit"]
