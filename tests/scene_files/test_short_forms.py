"""Short forms in files: bodies by dimensions, orientations by axis and angle, loads by tables."""

import tomllib

import jsonschema
import numpy as np
import pytest

import clearjoint as cj

TEXT = """
gravity = [0, -9.81, 0]

[bodies.arm]
kind = "Body.rod"
length = "400 mm"
diameter = "2 cm"
density = "7.85 g/cm^3"

[bodies.disc]
kind = "Body.cylinder"
diameter = 0.1
length = "20 mm"
mass = 1.0

[joints.swing]
kind = "PrescribedAngle"
first = "ground"
second = "arm"
axis = [0, 0, 1]
function = { kind = "Spline.through", times = [0, "100 ms", 0.3], values = [0, 1, 0.5] }

[forces.push]
kind = "AppliedLoad"
body = "disc"
force = ["5 N", { kind = "PiecewiseConstant", times = [0, "100 ms"], values = [0, 10] }, 0]

[forces.motor]
kind = "DriveTorque"
first = "arm"
second = "disc"
axis = [0, 0, 1]
torque = "2 N mm"
orientation = { axis = [0, 0, 1], angle = "-90 deg" }

[state.bodies.arm]
position = [0.1, 0, 0]
orientation = { axis = [0, 0, 1], angle = "30 deg" }

[state.bodies.disc]
position = [1, 0, 0]
"""


@pytest.fixture
def read(tmp_path):
    def read(text):
        (tmp_path / "scene.toml").write_text(text)
        return cj.load(tmp_path / "scene.toml")

    return read


def test_files_have_the_short_forms_of_python(read, tmp_path):
    scene, state = read(TEXT)
    rod = cj.Body.rod(0.4, density=7850.0, diameter=0.02)
    np.testing.assert_allclose(scene.bodies["arm"].inertia, rod.inertia, rtol=1e-15)
    disc = cj.Body.cylinder(0.1, 0.02, mass=1.0)
    np.testing.assert_array_equal(scene.bodies["disc"].inertia, disc.inertia)
    spline = cj.Spline.through([0.0, 0.1, 0.3], [0.0, 1.0, 0.5])
    np.testing.assert_array_equal(scene.joints["swing"].function.rates, spline.rates)
    first, second, third = scene.forces["push"].force
    assert (float(first), float(third)) == (5.0, 0.0)
    assert isinstance(second, cj.PiecewiseConstant)
    assert float(scene.forces["motor"].torque) == 2e-3
    turns = state.bodies["arm"].orientation, scene.forces["motor"].orientation
    for found, degrees in zip(turns, (30.0, -90.0), strict=True):
        np.testing.assert_allclose(
            found, cj.rotation((0, 0, 1), np.radians(degrees)), rtol=0.0, atol=1e-16
        )
    cj.save(scene, state, tmp_path / "again.json")
    again, _ = cj.load(tmp_path / "again.json")
    np.testing.assert_array_equal(again.forces["push"].force[1].times, second.times)


def test_the_schema_has_them_too():
    schema = cj.scene_schema()
    assert jsonschema.Draft202012Validator(schema).is_valid(tomllib.loads(TEXT))
    rod = jsonschema.Draft202012Validator({**schema, **schema["$defs"]["Body.rod"]})
    arm = tomllib.loads(TEXT)["bodies"]["arm"]
    assert rod.is_valid(arm)
    for wrong in (arm | {"kind": "Body.rot"}, arm | {"size": 1.0}, {"kind": "Body.rod"}):
        assert not rod.is_valid(wrong)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"Body.rod"', '"Body.rot"', r"bodies.arm.kind`.*Body.sphere: did you mean 'Body.rod'"),
        ('"Body.rod"', '"Spline.through"', "bodies.arm.kind`.*expected one of Body"),
        ('length = "400 mm"', "", r"bodies.arm`: a Body.rod also needs length \(m\)"),
        ('diameter = "2 cm"', "diametr = 1", "bodies.arm.diametr`.*did you mean 'diameter'"),
        ('"7.85 g/cm^3"', '"7.85 g"', r"bodies.arm.density`.*kg/m\^3"),
        ('angle = "30 deg"', "angel = 3", "orientation.angel`.*did you mean 'angle'"),
        ('angle = "30 deg"', 'angle = "30 mm"', "orientation.angle`.*number in rad"),
        ('"30 deg" }', '"30 deg", of = 1 }', "orientation.of`.*leave it out"),
        ('], angle = "30 deg"', "]", r"orientation`: a.*also needs angle \(rad\): add them"),
        ("axis = [0, 0, 1], angle =", "axis = [0, 0, 0], angle =", "`axis`.*non-zero length"),
        ('["5 N", {', '["5 m", {', r"forces.push.force\[0\]`.*number in N"),
    ],
)
def test_errors_have_locations(read, old, new, message):
    with pytest.raises(ValueError, match=message):
        read(TEXT.replace(old, new))
