"""Which joints begin at rest, and states of robots at the start."""

import jax
import numpy as np
import pandas as pd
import pytest

import clearjoint as cj
from clearjoint._measurements.robot_logs import Logged
from clearjoint._parametrisation.variations import changed
from clearjoint._robot_fits.problem import MovedRobot, StartInPlay, StartOfJoint, _begins_at_rest
from clearjoint._simulation.run.sampling import first_compiled, sampled_compiled
from tests.support.programs import made_by
from tests.support.rig import rig

TIMES = np.sort(np.random.default_rng(1).uniform(3.0, 3.05, 10))
NOISE = 2e-3
"""Noise, rad."""


def share_at_rest(speed, start=0.4):
    """Return the share of logs from an angle with a speed, rad/s, of which the joint counts as at
    rest; angles are from -pi to pi."""
    noise = NOISE * np.random.default_rng(0).standard_normal((2000, len(TIMES)))
    angles = (start + speed * TIMES + noise + np.pi) % (2.0 * np.pi) - np.pi
    return np.mean([_begins_at_rest(Logged(TIMES, row, NOISE, "rad"), True) for row in angles])


@pytest.mark.parametrize("start", [0.4, np.pi])
def test_noise_alone_is_no_speed(start):
    # Of a normal slope, 0.999 is within 3.3 standard errors.
    assert share_at_rest(0.0, start) > 0.996


def test_a_speed_is_found_where_least_squares_determines_it():
    slopes = [np.polyfit(TIMES, row, 1)[0] for row in np.eye(len(TIMES))]
    error = NOISE * np.linalg.norm(slopes)  # of the speed
    for speed, shares in {2.0: (0.85, 0.95), 3.3: (0.45, 0.55), 6.6: (0.0, 0.005)}.items():
        low, high = shares
        assert low <= share_at_rest(-speed * error) <= high


def test_unknown_noise_leaves_the_speed_open():
    assert not _begins_at_rest(Logged(TIMES, np.zeros(10), None, "rad"), True)


def geared(folder, play="0.5 deg", axis="0 1 0"):
    drive = cj.Drive(armature=0.02, play=play, stiffness=2000.0, damping=0.2)
    return rig(folder, axis=axis).with_drive("elbow", drive)


def test_starts_of_several_joints(tmp_path):
    robot = geared(tmp_path)
    moved, half = MovedRobot(robot), np.radians(0.25)
    names = "elbow motor", False, "elbow"
    speed = StartOfJoint(moved, "elbow motor", True, "elbow", np.asarray(4.0))
    for load, place, angle in ((4.0, None, -half - 4.0 / 2000.0), (0.0, -0.3, -0.3 * half)):
        pairs = [(StartOfJoint(moved, *names, np.asarray(load)), 0.5), (speed, 1.5)]
        if place is not None:
            pairs.append((StartInPlay(moved, "elbow motor", "elbow", "elbow backlash"), place))
        _, state = changed(robot.scene, robot.state({"elbow": 0.3}), pairs)
        expected = {"elbow motor": 0.5, "elbow": 0.5 + angle}
        assert robot.angles(state) == pytest.approx(expected, abs=1e-12)
        assert robot.speeds(state) == pytest.approx(dict.fromkeys(expected, 1.5), abs=1e-12)


def test_robots_that_move_alike_share_programs(tmp_path):
    """Also with other numbers in their scenes, and under other loads."""

    def structure(robot, load):
        change = StartOfJoint(MovedRobot(robot), "elbow", False, None, np.asarray(load))
        return jax.tree.structure(change)

    first = structure(geared(tmp_path), 1.0)
    assert first == structure(geared(tmp_path, play="1 deg"), -2.0)
    assert first != structure(geared(tmp_path, axis="1 0 0"), 1.0)


@pytest.mark.filterwarnings("ignore::clearjoint.PoorFitWarning")
def test_a_second_log_compiles_nothing(tmp_path):
    robot, times, counts = geared(tmp_path), np.arange(40) / 200.0, []
    for seed in range(2):
        noise = 1e-4 * np.random.default_rng(seed).standard_normal(40)
        values = {"t": times, "q [rad]": 0.9 + 30.0 * times**3 + noise, "tau [N m]": 3.0 + times}
        log = cj.RobotLog.read(
            pd.DataFrame(values),
            angles={"elbow motor": cj.LogColumn("q", noise=1e-4)},
            torques={"elbow": "tau"},
        )
        options = {"grow": (), "max_iterations": 2, "progress": False}
        found = cj.fit_robot(robot, log, {"elbow": ["armature"]}, {"elbow": "torque"}, **options)
        robot = found.robot
        counts.append((made_by(sampled_compiled), made_by(first_compiled)))
    assert counts[0] == counts[1]
