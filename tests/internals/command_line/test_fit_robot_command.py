"""The command `clearjoint fit-robot` and its file."""

import math
import tomllib

import jax
import jsonschema
import numpy as np
import pytest
from click.testing import CliRunner

import clearjoint as cj
from clearjoint._command_line.program import clearjoint
from clearjoint._command_line.robot_fitting import TEMPLATE, read_robot_fit, robot_fit_schema
from studies.robots.geared_joint import GearedJoint, log_table, swinging
from tests.support.rig import rig

JOINT = GearedJoint()

FILE = """
time = "t"
[find.elbow]
play = "1 deg"
[driven_by]
elbow = "torque"
[angles]
elbow = { kind = "LogColumn.encoder", column = "counts", counts = 4096, zero = 2048 }
[torques]
elbow = { kind = "LogColumn.current", column = "i", torque_constant = "50 mN m/A", ratio = 100 }
[drives.elbow]
armature = "200 kg cm^2"
play = "0.5 deg"
stiffness = 2000.0
damping = 5.0
friction = "250 mN m"
viscosity = 0.05
law = { kind = "RegularisedCoulomb", coefficient = 1.0, regularisation_speed = 1e-4 }
"""


@pytest.fixture
def paths(tmp_path):
    """Of the robot, its log and the file of the fit."""
    rig(tmp_path)
    log_table(JOINT, *swinging(0, 0.1)).to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "fit.toml").write_text(FILE)
    return [tmp_path / name for name in ("rig.urdf", "log.csv", "fit.toml")]


def test_the_file_of_a_fit_says_what_the_call_says(paths):
    study = read_robot_fit(*paths)
    backlash, motor = (study.robot.scene.joints[f"elbow {n}"] for n in ("backlash", "motor"))
    assert float(backlash.play) == pytest.approx(JOINT.play)
    assert float(motor.armature) == pytest.approx(JOINT.armature)
    assert study.log.torques["elbow"].values == pytest.approx(swinging(0, 0.1)[1])
    paths[2].write_text(FILE.replace('play = "0.5 deg"', 'plays = "0.5 deg"'))
    with pytest.raises(ValueError, match=r"fit.toml, line 13, `drives.elbow.plays`: found '0.5"):
        read_robot_fit(*paths)


SERVO = (
    'elbow = { kind = "Servo", target = "30 deg", rate = 200, proportional = "2 N cm/deg", '
    'encoder = { first = "ground", second = "arm", axis = [0, 1, 0] } }'
)
WITH_SERVO = FILE.replace('elbow = "torque"', SERVO)
WITH_SERVO += '[goals]\nelbow = { column = "counts", unit = "deg" }'


def test_a_servo_of_the_file_is_that_of_the_joints_motor(paths):
    """Its goals come from the log; its encoder may be elsewhere, on the link."""
    paths[2].write_text(WITH_SERVO)
    study = read_robot_fit(*paths)
    expected = cj.Servo(
        *study.robot.motor_side("elbow"),
        target=math.radians(30.0),
        rate=200.0,
        proportional=0.02 * 180.0 / math.pi,
        encoder=cj.Encoder("ground", "arm", (0, 1, 0)),
    )
    made = study.driven_by["elbow"]
    assert type(made) is cj.Servo
    assert made.body_names() == expected.body_names()
    assert made.second == "elbow rotor"
    for one, other in zip(jax.tree.leaves(made), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-15)
    assert study.log.goals["elbow"].unit == "rad"


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("rate", "rates", r"fit.toml, line 6, `driven_by.elbow.rates`: found 200"),
        ('"Servo"', '"Drive"', r"`driven_by.elbow.kind`: found 'Drive'"),
        ('elbow = { kind = "Servo"', 'knee = { kind = "Servo"', "`driven_by.knee`: Argument `join"),
        (SERVO, "elbow = 3", "found 3, expected one of angle"),
    ],
)
def test_errors_in_a_servo_have_locations(before, after, message, paths):
    paths[2].write_text(WITH_SERVO.replace(before, after))
    with pytest.raises(ValueError, match=message):
        read_robot_fit(*paths)


def test_the_schema_admits_the_example():
    schema, example = robot_fit_schema(), tomllib.loads(TEMPLATE.read_text())
    jsonschema.validate(example, schema)
    example["driven_by"]["elbow"] = {"kind": "Servo", "target": 0, "rate": 200}
    jsonschema.validate(example, schema)
    for section, entry in (("driven_by", 3), ("driven_by", "torques"), ("drives", {"plays": 1})):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(example | {section: {"elbow": entry}}, schema)


@pytest.mark.slow
def test_the_command_writes_a_page(paths, tmp_path):
    log_table(JOINT, *swinging(0, 1.0)).to_csv(paths[1], index=False)
    words = ["fit-robot", *paths, "--out", tmp_path / "out"]
    outcome = CliRunner().invoke(clearjoint, list(map(str, words)))
    assert outcome.exit_code == 0, outcome.output
    names = {path.name for path in (tmp_path / "out").rglob("*")}
    assert {"index.html", "report.txt", "estimates.csv", "fitted.toml", "hysteresis.png"} <= names
