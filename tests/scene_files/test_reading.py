"""Hand-written files: defaults, numbers with units, and error messages."""

import json

import numpy as np
import pytest

import clearjoint as cj

PIN = """
[bodies.arm]
mass = 7.02
inertia = [0.001, 0.5855, 0.5855]

[joints.pin]
kind = "ClearanceJoint"
bearing_body = "ground"
journal_body = "arm"
journal_point = [-0.5, 0, 0]
bearing_radius = "10 mm"
journal_radius = "9.5 mm"
journal_length = "20 mm"
law = { kind = "LankaraniNikravesh", restitution = 0.9, stiffness = 1e9 }

[state.bodies.arm]
position = [0.5, 0, 0]
"""


@pytest.fixture
def read(tmp_path):
    """Read a text, with changes to it, from a file."""

    def read(text=PIN, *changes, classes=(), name="pin.toml"):
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / name).write_text(text, encoding="utf-8")
        return cj.load(tmp_path / name, classes)

    return read


def test_a_file_is_as_short_as_the_python(read):
    scene, state = read()
    stiffness = scene.joints["pin"].law.stiffness
    assert isinstance(stiffness, cj.laws.GivenStiffness) and stiffness.stiffness == 1e9
    assert scene.joints["pin"].clearance == 0.01 - 0.0095
    assert state.bodies["arm"].orientation.tolist() == [1.0, 0.0, 0.0, 0.0]
    assert scene.gravity is None and scene.forces == {} and state.entry_speeds == {}


@pytest.mark.parametrize(
    ("written", "number"),
    [
        ("0.3 mm", 3e-4),
        ("0.9 mm", 0.0009),
        (" 5e-1mm ", 5e-4),
        ("0.03 inch", 0.000762),
        (".025 cm", 0.00025),
        ("0.0001", 1e-4),
    ],
)
def test_converted_numbers_are_rounded_once(read, written, number):
    scene, _ = read(PIN, ('journal_radius = "9.5 mm"', f'clearance = "{written}"'))
    assert float(scene.joints["pin"].clearance) == number


def test_units_of_components(read):
    scene, _ = read(
        PIN,
        ("[-0.5, 0, 0]", '["-50 cm", 0, "0 in"]'),
        ("[0.001, 0.5855, 0.5855]", '["10 kg cm^2", 0.5855, 0.5855]'),
        ("stiffness = 1e9", 'stiffness = {kind = "RavnStiffness", young_modulus = "207 GPa", '
         "poisson_ratio = 0.3}"),
    )  # fmt: skip
    assert scene.joints["pin"].journal_point.tolist() == [-0.5, 0.0, 0.0]
    assert scene.bodies["arm"].inertia[0] == 0.001
    assert scene.joints["pin"].law.stiffness.young_modulus == 207e9


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mass", "mas", r"pin.toml, line 3, `bodies.arm.mas`: .* did you mean 'mass'\?"),
        ("[joints.pin]", "[joint.pin]", r"`joint`: .* did you mean 'joints'\?"),
        ('"ClearanceJoint"', '"ClearenceJoint"', r"`joints.pin.kind`.* mean 'ClearanceJoint'\?"),
        ('kind = "ClearanceJoint"', "", r"`joints.pin`.*a table whose `kind` names a class"),
        ('"LankaraniNikravesh"', '"Ambrosio"', r"`joints.pin.law.kind`.*AbstractContactLaw"),
        ('"LankaraniNikravesh"', "3", r"`joints.pin.law.kind`: found 3, expected the name of"),
        ('"10 mm"', '"10 kg"', r"`joints.pin.bearing_radius`: found '10 kg', expected a number in"),
        ('"9.5 mm"', '"9.5 kg"', r"`joints.pin.journal_radius`: found '9.5 kg', expected .* in m"),
        ('"10 mm"', '"10 mn"', r"`joints.pin.bearing_radius`: found '10 mn', expected a number in"),
        ('"10 mm"', '"wide"', r"`joints.pin.bearing_radius`: found 'wide', expected a number in m"),
        ('"10 mm"', "nan", r"`joints.pin.bearing_radius`: found nan"),
        ('"10 mm"', "-1", r"`joints.pin.journal_radius`: Argument `journal_radius` must"),
        ('"10 mm"', "2021-01-01", r"`joints.pin.bearing_radius`: found datetime.date"),
        ('"10 mm"', "{x = 1}", r"`joints.pin.bearing_radius`: found a table .* expected a num"),
        ("mass = 7.02", "mass = -1", r"line 3, `bodies.arm.mass`: Argument `mass` must be posit"),
        ("mass = 7.02", "", r"line 2, `bodies.arm`: a Body also needs mass \(kg\): add them"),
        ("law = {", "law = 3 #", r"`joints.pin.law`: Argument `law` must be an AbstractContactLaw"),
        ("[state.bodies.arm]", "[state.bodies.arn]", r"`state.bodies`: found 'arn', .* 'arm'\?"),
        ("position", "position =", r"pin.toml: .*line 17"),
        ("[0.5, 0, 0]", "[0.5, 0]", r"line 17, `state.bodies.arm.position`: Argument `pos"),
        ('"arm"', '"arn"', r"line 9, `joints.pin.journal_body`: Argument `joints\['pin'\].jour"),
        ("\n[bodies", "format = 2\n[bodies", r"`format`: found 2, .*newer clearjoint.* update"),
        ("\n[bodies", 'format = "a"\n[bodies', r"`format`: found 'a', expected a whole number"),
        ("\n[bodies", "forces = 3\n[bodies", r"Argument `forces` must be a dictionary"),
        ("[state.bodies.arm]\nposition", "[s]\nposition", r"`s`: found .*one of the keys"),
        ("mass = 7.02", "mass = true", r"line 3, `bodies.arm.mass`: found True, expected a number"),
        ("mass = 7.02", f"mass = {'1' * 400}", r"line 3, `bodies.arm.mass`: found .* of 1326 bits"),
        ("mass = 7.02", f"mass = '{'1' * 400} kg'", r"`bodies.arm.mass`: found '1+\.\.\.1+ kg'"),
        ("mass = 7.02", "mass = '1e400 kg'", r"`bodies.arm.mass`: .*expected a number below 1.8e"),
        ('"10 mm"', "'1e308 km'", r"`joints.pin.bearing_radius`: .*a number below 1.8e.* m"),
        ("mass = 7.02", f"mass = {'[' * 50}{']' * 50}", r"pin.toml: .*at most 32 levels"),
        ("mass = 7.02", f"mass = {'[' * 9999}{']' * 9999}", r"pin.toml: .*at most 32 levels"),
        ("mass = 7.02", f"mass{'.a' * 9999} = 1", r"pin.toml: .*at most 32 levels"),
        ('"10 mm"', "'10 m**9**9**9**9'", r"`joints.pin.bearing_radius`: found '10 m\*\*9"),
        ('"10 mm"', "'10 m**(9**9**9)'", r"`joints.pin.bearing_radius`: found '10 m\*\*\("),
        ('"10 mm"', "'10 m⁹⁹⁹⁹⁹⁹⁹⁹'", r"`joints.pin.bearing_radius`: found '10 m⁹"),
        ('"10 mm"', "'10 yottameter**90'", r"`joints.pin.bearing_radius`: found '10 yot"),
        (
            "[-0.5, 0, 0]",
            "[\n  # the pin\n  -0.5,\n  'x',\n]",
            r"line 10, `joints.pin.journal_point\[1\]`: found 'x'",
        ),
    ],
)
def test_errors_have_location_and_remedy(read, old, new, message):
    with pytest.raises(ValueError, match=message):
        read(PIN, (old, new))


def test_a_file_in_another_encoding_is_named(tmp_path):
    (tmp_path / "pin.toml").write_bytes(b"\xef\xbb\xbfa = \xff")  # after a byte order mark
    with pytest.raises(ValueError, match="found 'byte 0xff at position 7'"):
        cj.load(tmp_path / "pin.toml")
    (tmp_path / "pin.toml").write_text(PIN, encoding="utf-16")
    with pytest.raises(ValueError, match=r"pin.toml: found 'byte 0xff .*expected UTF-8 text"):
        cj.load(tmp_path / "pin.toml")


@pytest.mark.slow
def test_many_bodies_need_states_and_long_tables_are_read(read):
    body = "[bodies.b{}]\nmass = 1.0\ninertia = [1, 1, 1]\n"
    with pytest.raises(ValueError, match="no state of 3000 bodies.*give .state.bodies"):
        read("".join(map(body.format, range(3000))))
    numbers = ", ".join(map(str, range(100_000)))
    with pytest.raises(ValueError, match=r"gravity.*but is an array of shape \(100000,\)"):
        read(f"gravity = [{numbers}]\n{PIN}")


def test_mistakes_in_json_and_suffixes(read):
    with pytest.raises(ValueError, match=r"'bodies' occurs twice"):
        read('{"bodies": {}, "bodies": {}}', name="a.json")
    text = '{"bodies": {"}": {}, "a": {},\n "a": {}},\n "joints": {}}'
    with pytest.raises(ValueError, match=r"'a' occurs twice .*: line 2 column 9"):
        read(text, name="a.json")
    with pytest.raises(ValueError, match=r"found \[1\], expected an object"):
        read("[1]", name="a.json")
    with pytest.raises(ValueError, match=r"the suffix .toml or .json"):
        read(name="a.yaml")


class Doubled(cj.extend.AbstractDampedLaw):
    """A user-defined law."""

    depth: float = 1.0

    def damping_factor(self):
        return 2.0


@pytest.mark.parametrize("name", ["Doubled", f"{__name__}:Doubled", "__main__:Doubled"])
def test_a_class_is_named_with_or_without_its_module(read, name):
    scene, _ = read(PIN, ("LankaraniNikravesh", name), classes=[Doubled])
    assert type(scene.joints["pin"].law) is Doubled


@pytest.mark.parametrize("classes", [Doubled, "Doubled", ["Doubled"], None, 5, iter([Doubled])])
def test_classes_are_passed_as_a_list(read, classes):
    with pytest.raises(ValueError, match=r"Argument `classes` must be a list of classes"):
        read(classes=classes)


def test_a_unit_that_is_not_declared_is_refused(read):
    change = ('"LankaraniNikravesh"', '"Doubled", depth = "1 mm"')
    with pytest.raises(ValueError, match=r"`joints.pin.law.depth`.*plain number in SI units"):
        read(PIN, change, classes=[Doubled])


HINGE = """
[joints.{}]
kind = "RevoluteJoint"
first = "{}"
second = "{}"
point_first = {}
point_second = [-0.5, 0, 0]
axis_first = [0, 0, 1]
axis_second = [0, 0, 1]
"""
CHAIN = """
gravity = [0, 9.81, 0]
bodies.upper = { mass = 1, inertia = [1e-3, 0.1, 0.1] }
bodies.lower = { mass = 1, inertia = [1e-3, 0.1, 0.1] }
"""
CHAIN += HINGE.format("elbow", "upper", "lower", [0.5, 0, 0])
CHAIN += HINGE.format("shoulder", "ground", "upper", [0, 1, 0])


def test_a_missing_state_is_computed(read):
    _, state = read(CHAIN)
    for name, x in (("upper", 0.5), ("lower", 1.5)):
        assert np.allclose(state.bodies[name].position, (x, 1.0, 0.0), rtol=0.0, atol=1e-9)


def test_missing_bodies_follow_the_given_ones(read):
    turned = "orientation = [0.7071067811865476, 0, 0, 0.7071067811865476]"
    _, state = read(f"{CHAIN}\n[state.bodies.upper]\nposition = [0, 1.5, 0]\n{turned}")
    assert np.allclose(state.bodies["lower"].position, (0.0, 2.5, 0.0), rtol=0.0, atol=1e-9)


def test_a_state_that_cannot_be_computed_is_asked_for(read):
    apart = CHAIN + HINGE.format("held", "upper", "lower", [9, 0, 0])
    with pytest.raises(ValueError, match=r"`state`: found no state of lower, upper.*give \[state"):
        read(apart)


def test_a_scene_in_json(read):
    body = {"mass": "1 kg", "inertia": [1, 1, 1]}
    text = {"$schema": "x", "bodies": {"b": body}, "gravity": None, "state": {"bodies": {"b": {}}}}
    with pytest.raises(ValueError, match=r"`state.bodies.b`: .* also needs position \(m\)"):
        read(json.dumps(text), name="a.json")
    text["state"]["bodies"]["b"]["position"] = [0, 0, 1]
    scene, _ = read(json.dumps(text), name="a.json")
    assert scene.gravity is None and scene.bodies["b"].mass == 1.0
