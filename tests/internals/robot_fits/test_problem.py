"""The problem of a fit of a robot to its log."""

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

import clearjoint as cj
from clearjoint._robot_fits.fit_robot import _windows
from clearjoint._robot_fits.problem import robot_problem
from studies.robots.geared_joint import URDF
from tests.support.rig import rig


def logged(times, angles, torques, noise=2e-4, **options):
    """The log of the elbow: angles, rad, with their noise, and torques, N m."""
    table = pd.DataFrame({"t": times, "q [rad]": angles, "tau [N m]": torques})
    columns = {"elbow": cj.LogColumn("q", noise=noise)}, {"elbow": cj.LogColumn("tau", noise=0.1)}
    return cj.RobotLog.read(table, angles=columns[0], torques=columns[1], **options)


def test_a_joint_that_follows_its_log_starts_with_the_rate_of_the_log(tmp_path):
    """Also if its first positions differ by less than their noise, so that it counts as at rest."""
    robot, times = rig(tmp_path), np.arange(100) / 200.0
    log = logged(times, 0.01 * times, 0.0 * times)
    problem = robot_problem(robot, log, {}, {"elbow": "angle"})
    assert abs(problem.robot.speeds(problem.state)["elbow"] - 0.01) < 1e-9
    cj.simulate(problem.scene, problem.state, 0.1, progress=False)  # refuses other speeds
    free = robot_problem(robot, log, {}, {"elbow": "torque"})
    assert free.robot.speeds(free.state)["elbow"] == 0.0


@pytest.mark.parametrize(("first", "last"), [(1, 2), (2, 0), (3, 0), (0, 4)])
@pytest.mark.parametrize("mode", ["angle", "torque", "held torque"])
def test_what_drives_is_logged_at_times_of_its_own(mode, first, last, tmp_path):
    """It may miss two samples at the start and at the end; more are refused."""
    robot, times = rig(tmp_path), 3.0 + np.arange(100) / 200.0
    tables = {"angle": 0.1 * times**3, "torque": 2.0 * times}
    driven = mode.removeprefix("held ")
    tables[driven] = np.where(np.arange(100) < first, np.nan, tables[driven])
    tables[driven] = np.where(np.arange(100) >= 100 - last, np.nan, tables[driven])
    log = logged(times, *tables.values(), missing="drop")
    if max(first, last) > 2:
        part = "angles" if mode == "angle" else "torques"
        message = rf"`log.{part}\['elbow'\]` must be from 0 to 0.495 s, since it drives 'elbow'"
        with pytest.raises(ValueError, match=message) as refused:
            robot_problem(robot, log, {}, {"elbow": mode})
        advice = re.search(r"log\.between\((.+), (.+)\)", str(refused.value))
        log = log.between(*map(float, advice.groups()))
    problem = robot_problem(robot, log, {}, {"elbow": mode})
    if mode == "angle":  # From its start, the run has the motion that was logged.
        outputs = {"q": cj.quantities.JointAngle("elbow")}
        times = log.start + np.linspace(0.0, 0.1, 7)
        options = {"start_time": log.start, "outputs": outputs, "progress": False}
        scene, save = problem.scene, cj.Saving(times)
        solution = cj.simulate(scene, problem.state, times[-1], save=save, **options)
        np.testing.assert_allclose(solution.outputs["q"], 0.1 * (3.0 + times) ** 3, atol=1e-3)


@pytest.mark.parametrize("low", [-np.pi, 0.0, None])
def test_loops_of_hysteresis_go_on_over_revolutions(low, tmp_path):
    """Whether or not the log's angles are within a revolution from `low` on."""
    times = np.arange(100) / 20.0
    angles = 2.0 + 7.0 * np.sin(times)
    jumping = angles if low is None else (angles - low) % (2.0 * np.pi) + low
    log = logged(times, jumping, np.cos(times), noise=2e-3)
    problem = robot_problem(rig(tmp_path), log, {}, {"elbow": "torque"})
    fit: Any = SimpleNamespace(
        measurements=problem.measurements, residuals={"elbow position": 3.0 * np.cos(5.0 * times)}
    )
    found = cj.results.RobotFit(fit, problem.robot, log, {"elbow": "torque"}, {}, {}, {})
    loop = found.hysteresis()["elbow"]
    turns = np.round((loop.position - angles) / (2.0 * np.pi))
    assert len(set(turns.tolist())) == 1
    difference = loop.predicted_position - loop.position
    np.testing.assert_allclose(difference, 6e-3 * np.cos(5.0 * times), atol=1e-12)


def test_a_slider_does_not_return_after_six_metres(tmp_path):
    """As an angle does: this one seemed at rest, since it moves by 2 pi m from sample to sample."""
    limit = '<limit lower="-99" upper="99" effort="1" velocity="9"/></joint>'
    text = URDF.format(inertia=0.01).replace("continuous", "prismatic").replace("</joint>", limit)
    (tmp_path / "crane.urdf").write_text(text)
    table = pd.DataFrame({"t": np.arange(9.0), "q [m]": 2.0 * np.pi * np.arange(9.0)})
    log = cj.RobotLog.read(table, angles={"elbow": cj.LogColumn("q", noise=1e-3)})
    problem = robot_problem(cj.load_robot(tmp_path / "crane.urdf"), log, {}, {})
    assert problem.robot.speeds(problem.state)["elbow"] == pytest.approx(2.0 * np.pi)


@pytest.mark.parametrize("kinds", [["friction", "damping"], ["damping", "friction"]])
@pytest.mark.parametrize("present", [{}, {"friction": 0.0}, {"friction": 0.0, "viscosity": 0.0}])
def test_resistances_of_zero_start_as_those_that_are_missing(present, kinds, tmp_path):
    """In any order: a damping that the robot lacks is added with a friction of zero."""
    law, times = cj.frictions.RegularisedCoulomb(1.0, 1e-4), np.arange(100) / 200.0
    robot = rig(tmp_path).with_drive("elbow", cj.Drive(armature=0.02, law=law, **present))
    log = logged(times, 0.4 * times, 10.0 * times)
    parameters = robot_problem(robot, log, {"elbow": kinds}, {"elbow": "torque"}).parameters
    # A tenth of the largest torque, and this over the largest speed.
    assert parameters["elbow friction"].value == pytest.approx(0.1 * 4.95)
    assert parameters["elbow damping"].value == pytest.approx(0.1 * 4.95 / 0.4, rel=1e-3)


@pytest.mark.parametrize("mode", ["torque", "angle"])
def test_links_start_with_their_logged_motors(mode, tmp_path):
    """Also those of joints before, on which the load of a joint depends."""
    tip = """<link name="tip"><inertial><origin xyz="0 0 -0.1"/><mass value="0.5"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="wrist" type="continuous"><parent link="arm"/><child link="tip"/>
<origin xyz="0 0 -0.5"/><axis xyz="0 1 0"/></joint></robot>"""
    text = URDF.format(inertia=0.01).replace("</robot>", tip)
    (tmp_path / "two.urdf").write_text(text)
    robot, start = cj.load_robot(tmp_path / "two.urdf"), {"elbow": 0.9, "wrist": -0.4}
    gear = cj.Drive(armature=0.02, play="0.5 deg", stiffness=2000.0)
    table = pd.DataFrame({"t": np.arange(20) / 200.0})
    for name, angle in start.items():
        robot = robot.with_drive(name, gear)
        table[f"{name} [rad]"], table[f"{name} tau [N m]"] = angle, 1.0
    log = cj.RobotLog.read(
        table,
        angles={f"{name} motor": cj.LogColumn(name, noise=1e-4) for name in start},
        torques={name: cj.LogColumn(f"{name} tau", noise=0.1) for name in start},
    )
    problem = robot_problem(robot, log, {}, dict.fromkeys(start, mode))
    assert robot.angles(problem.state) == pytest.approx(
        {**start, "elbow motor": 0.9, "wrist motor": -0.4}, abs=1e-9
    )
    if mode == "torque":
        held = robot.torques(start)
        for name in start:
            change = problem.parameters[f"{name} motor start position"].variation.make
            assert change.load == pytest.approx(float(held[name]))


def test_windows_without_a_parameter_of_the_run_begin_with_a_sixteenth_of_the_log():
    times = SimpleNamespace(times=lambda: np.array([1.0, 1.2, 2.0]))
    problem: Any = SimpleNamespace(log=SimpleNamespace(start=1.0), measurements=times)
    fit: Any = None
    delay = {"delay": cj.Parameter.delay("elbow position")}
    windows = _windows(fit, delay, problem, cj.presets.identification)
    np.testing.assert_allclose(windows, [1.0625, 1.125, 1.25, 1.5])
