"""The command `clearjoint fit-robot` and its file."""

import pytest
from click.testing import CliRunner

from clearjoint._command_line.program import clearjoint
from clearjoint._command_line.robot_fitting import read_robot_fit
from studies.robots.geared_joint import URDF, GearedJoint, log_table, swinging

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


def test_the_file_of_a_fit_says_what_the_call_says(tmp_path):
    (tmp_path / "rig.urdf").write_text(URDF.format(inertia=JOINT.inertia))
    (tmp_path / "fit.toml").write_text(FILE)
    log_table(JOINT, *swinging(0, 0.1)).to_csv(tmp_path / "log.csv", index=False)
    paths = [tmp_path / name for name in ("rig.urdf", "log.csv", "fit.toml")]
    study = read_robot_fit(*paths)
    backlash, motor = (study.robot.scene.joints[f"elbow {n}"] for n in ("backlash", "motor"))
    assert float(backlash.play) == pytest.approx(JOINT.play)
    assert float(motor.armature) == pytest.approx(JOINT.armature)
    assert study.log.torques["elbow"].values == pytest.approx(swinging(0, 0.1)[1])
    (tmp_path / "fit.toml").write_text(FILE.replace('play = "0.5 deg"', 'plays = "0.5 deg"'))
    with pytest.raises(ValueError, match=r"fit.toml, line 13, `drives.elbow.plays`: found '0.5"):
        read_robot_fit(*paths)


@pytest.mark.slow
def test_the_command_writes_a_page(tmp_path):
    (tmp_path / "rig.urdf").write_text(URDF.format(inertia=JOINT.inertia))
    (tmp_path / "fit.toml").write_text(FILE)
    log_table(JOINT, *swinging(0, 1.0)).to_csv(tmp_path / "log.csv", index=False)
    paths = [str(tmp_path / name) for name in ("rig.urdf", "log.csv", "fit.toml")]
    outcome = CliRunner().invoke(clearjoint, ["fit-robot", *paths, "--out", str(tmp_path / "out")])
    assert outcome.exit_code == 0, outcome.output
    names = {path.name for path in (tmp_path / "out").rglob("*")}
    assert {"index.html", "report.txt", "estimates.csv", "fitted.toml", "hysteresis.png"} <= names
