"""The study of robots: files of a folder, and fits of logs."""

import importlib.util

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

import clearjoint as cj
from studies.robots import files, logs, servo_joint
from studies.robots.__main__ import main
from studies.robots.arm import SimulatedArm
from studies.robots.geared_joint import URDF
from studies.robots.standard_joint import StandardJoint
from tests.support import urdf

ARM = URDF.format(inertia=0.01)
TIP = urdf.link("tip") + urdf.joint("wrist", "continuous", "arm", "tip") + "</robot>"
TWO = """<mujoco><worldbody><body name="a"><joint name="j"/><joint name="k" axis="1 0 0"/>
<geom size="0.1" pos="0.3 0.2 0"/></body></worldbody></mujoco>"""
TEXTS = {
    "arm.urdf": ARM,
    "light.urdf": ARM.replace("</robot>", TIP),
    "loop.urdf": ARM.replace('<parent link="base"/>', '<parent link="nowhere"/>'),
    "two.xml": TWO,
    "other.xml": "<note/>",
}


def test_files_are_loaded_as_messages_say_and_compared(tmp_path):
    (tmp_path / "deep").mkdir()
    for name, text in TEXTS.items():
        (tmp_path / "deep" / name).write_text(text)
    rows = {row.name: row for row in files.survey(tmp_path)}
    has_mujoco = importlib.util.find_spec("mujoco") is not None
    has_pinocchio = importlib.util.find_spec("pinocchio") is not None
    # Without the other program, a file is not compared and left out.
    absent = set() if has_mujoco else {"two.xml"}
    absent |= set() if has_pinocchio else {"arm.urdf"}
    assert rows.keys() == TEXTS.keys() - {"other.xml"} - absent
    for name in {"arm.urdf", "two.xml"} - absent:
        assert rows[name].difference is not None and rows[name].difference < 1e-12
    assert rows["light.urdf"].options == {"bound_mass": 1e-3, "bound_inertia": 1e-6}
    assert "nowhere" in rows["loop.urdf"].refused
    table, *_ = main(["files", "--files", str(tmp_path)])
    assert "| refused, with element and remedy | 1 |" in table


def test_logs_that_are_not_there_are_named(tmp_path, capsys):
    assert main(["logs", "--files", str(tmp_path)]) == []
    lines = capsys.readouterr().out.splitlines()
    assert all(any(name in line for line in lines) for name in logs.COLLECTIONS)


def test_mujoco_standard_joint_is_fitted():
    """To a motion by SciPy, with the offset and the lag of the log."""
    pytest.importorskip("mujoco")
    joint, times = StandardJoint(mass=0.5, length=0.1, inertia=1e-3), np.arange(0.0, 1.5, 0.01)
    goals = 0.8 * np.sin(5.0 * times)

    def rates(t, y):
        goal = goals[min(int(t / 0.01 + 1e-9), len(goals) - 1)]
        torque = 2.0 * (goal - y[0]) - 0.5 * 9.81 * 0.1 * np.sin(y[0])
        resisting = 0.05 * y[1] + 0.03 * np.tanh(y[1] / 1e-3)
        return y[1], (torque - resisting) / (0.006 + 0.003)

    options = {"method": "LSODA", "rtol": 1e-8, "atol": 1e-10, "max_step": 1e-3}
    solution = solve_ivp(rates, (0.0, 1.5), (0.0, 0.0), dense_output=True, **options)
    angles = solution.sol(np.maximum(times - 0.004, 0.0))[0] + 0.01
    table = pd.DataFrame({"t": times, "q [rad]": angles, "goal [rad]": goals})
    log = cj.RobotLog.read(table, angles={"servo": "q"}, goals={"servo": "goal"})
    names = "friction", "damping", "armature", "gain", "offset", "lag"
    starts = dict(zip(names, (0.01, 0.1, 0.002, 1.5, 0.0, 0.0), strict=True))
    truth = dict(zip(names, (0.03, 0.05, 0.003, 2.0, 0.01, 0.004), strict=True))
    assert joint.fitted(log, starts) == pytest.approx(truth, rel=0.1, abs=2e-3)


@pytest.mark.slow
def test_a_joint_of_the_arm_is_fitted():
    pytest.importorskip("pinocchio")
    draw = SimulatedArm(1, 0.4).fitted(0)
    assert draw.truth == {"pan play": np.radians(0.2), "pan friction": 4.0}
    assert all(draw.holds(name) for name in draw.truth)


@pytest.mark.slow
def test_a_short_log_of_a_servo_is_fitted():
    rows, first = servo_joint.measure(quick=True)
    assert [row[0] for row in rows[1:5]] == list(servo_joint.TRUTH)
    assert first.mean_square < 1.3
    assert all(first.holds(name) for name in servo_joint.TRUTH)
    assert len(servo_joint.figure(first).axes) == 2
