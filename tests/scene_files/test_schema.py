"""The JSON Schema: saved files satisfy it, files with mistakes don't."""

import json
import tomllib
from functools import reduce
from operator import getitem
from typing import Any, Literal

import equinox as eqx
import jsonschema
import pytest

import clearjoint as cj
from tests.scene_files.test_round_trips import Way


class Motor(cj.extend.AbstractDriveTorque):
    """A user-defined motor."""

    first: str
    second: str
    axis: tuple[float, float, float]
    stall_torque: Any = cj.extend.quantity("N m", shape=())
    orientation: Any = cj.extend.quantity("1", default=(1.0, 0.0, 0.0, 0.0))

    def torque_at(self, angle, speed, t):
        return self.stall_torque


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with a scene as TOML and JSON, and their schemas."""
    folder = tmp_path_factory.mktemp("files")
    scene, state = cj.mechanisms.slider_crank(motor=Motor("ground", "crank", (0, 0, 1), 2.0))
    for suffix in (".toml", ".json"):
        (folder / suffix[1:]).mkdir()
        cj.save(scene, state, folder / suffix[1:] / f"crank{suffix}", schema=True)
    return folder


@pytest.fixture(scope="module")
def schema(files):
    return json.loads((files / "toml" / "crank.schema.json").read_text())


@pytest.fixture(scope="module")
def validator(schema):
    """Checks the schema once, unlike `jsonschema.validate`, which does so at each call."""
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def test_editors_find_the_schema_and_the_file_satisfies_it(files, schema, validator):
    text = (files / "toml" / "crank.toml").read_text()
    assert text.startswith("#:schema ./crank.schema.json\n")
    validator.validate(tomllib.loads(text))
    other = json.loads((files / "json" / "crank.json").read_text())
    assert other["$schema"] == "crank.schema.json"
    validator.validate(other)
    assert schema == cj.scene_schema([Motor])


def test_a_table_needs_its_kind_only_where_several_classes_are_allowed(tmp_path):
    cj.save(*cj.mechanisms.rotor_in_bearing(film=cj.films.CaponeFilm(0.02)), tmp_path / "a.json")
    document = json.loads((tmp_path / "a.json").read_text())
    bearing = document["joints"]["bearing"]
    assert bearing["kind"] == "LubricatedJoint" and "kind" not in bearing["dry"]
    schema = jsonschema.Draft202012Validator(cj.scene_schema())
    schema.validate(document)
    del bearing["kind"]
    assert not schema.is_valid(document)
    document["joints"]["bearing"] = bearing["dry"]
    assert not schema.is_valid(document)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("bodies", "rod", "mas"), 1.0),
        (("bodies", "rod", "mass"), [1.0]),
        (("bodies", "rod", "inertia"), [1.0, 2.0]),
        (("joints", "slider pin", "kind"), "Clearance"),
        (("joints", "slider pin", "law", "kind"), "Ambrosio"),
        (("joints", "slider pin", "bearing_body"), 3),
        (("forces", "motor", "stall_torque"), [1, 2]),
        (("format",), "one"),
    ],
)
def test_mistakes_are_found(files, validator, path, value):
    document = json.loads((files / "json" / "crank.json").read_text())
    *parents, last = path
    reduce(getitem, parents, document)[last] = value
    with pytest.raises(jsonschema.ValidationError):
        validator.validate(document)


def test_the_schema_has_units_and_summaries(schema):
    definitions = schema["$defs"]
    assert definitions["ClearanceJoint"]["properties"]["clearance"]["description"] == "unit: m"
    assert definitions["Hertz"]["description"].startswith("Purely elastic contact")
    assert f"{__name__}:Motor" in definitions and "RevoluteJoint" in definitions
    assert not [name for name in definitions if name.startswith("Abstract")]


class Pad(eqx.Module):
    width: float


class Brake(Motor):
    """A motor with options, alone and beside None, numbers and objects."""

    way: Way | None = eqx.field(default=Way.SOFT, static=True)
    name: Literal["brake"] | str = eqx.field(default="brake", static=True)
    force: Literal["auto"] | float = "auto"
    pad: Literal["wide"] | Pad = "wide"


@pytest.mark.parametrize(
    "given", [{}, {"way": None, "name": "left", "force": 2.0, "pad": Pad(0.1)}]
)
def test_options_may_stand_beside_other_values(tmp_path, given):
    scene, state = cj.mechanisms.double_pendulum()
    motor = Brake("ground", "arm 2", (0, 0, 1), 2.0, **given)
    forced = cj.Scene(scene.bodies, scene.joints, {"motor": motor})  # without gravity
    cj.save(forced, state, tmp_path / "brake.json")
    document = json.loads((tmp_path / "brake.json").read_text()) | {"gravity": "none"}
    schema = jsonschema.Draft202012Validator(cj.scene_schema([Brake, Pad]))
    schema.validate(document)
    document["forces"]["motor"]["way"] = "MEDIUM"
    assert not schema.is_valid(document)
