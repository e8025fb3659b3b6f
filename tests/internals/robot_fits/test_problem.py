"""The problem of a fit of a robot to its log."""

import numpy as np
import pandas as pd

import clearjoint as cj
from clearjoint._robot_fits.problem import robot_problem
from studies.robots.geared_joint import URDF


def test_a_joint_that_follows_its_log_starts_with_the_rate_of_the_log(tmp_path):
    """Also if its first positions differ by less than their noise, so that it counts as at rest."""
    (tmp_path / "rig.urdf").write_text(URDF.format(inertia=0.01))
    robot, times = cj.load_robot(tmp_path / "rig.urdf"), np.arange(100) / 200.0
    table = pd.DataFrame({"t": times, "q [rad]": 0.01 * times, "tau [N m]": 0.0 * times})
    columns = {"elbow": cj.LogColumn("q", noise=2e-4)}, {"elbow": cj.LogColumn("tau", noise=0.1)}
    log = cj.RobotLog.read(table, angles=columns[0], torques=columns[1])
    problem = robot_problem(robot, log, {}, {"elbow": "angle"})
    assert abs(problem.robot.speeds(problem.state)["elbow"] - 0.01) < 1e-9
    cj.simulate(problem.scene, problem.state, 0.1, progress=False)  # refuses other speeds
    free = robot_problem(robot, log, {}, {"elbow": "torque"})
    assert free.robot.speeds(free.state)["elbow"] == 0.0
