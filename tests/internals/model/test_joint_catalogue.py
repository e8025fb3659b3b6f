"""Couplings: motions of the closed form satisfy the rows and their rates."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint._model.joints.constraint_rows import row_rate
from clearjoint.extend import unpack
from studies.catalogue.machines import ORIGIN, X, Y, Z, hooke
from tests.model.test_joint_catalogue import turned_about
from tests.support.motions import AT_REST


def held(joint, motions, tolerance=1e-12):
    """Assert that the joint allows a motion."""
    for label, row in unpack(joint).rows(motions, 0.0).items():
        assert abs(float(row.value)) < tolerance, label
        assert abs(float(row_rate(row, motions))) < 1e-11, label


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.9, -1.3])
def test_universal_joint_turns_as_hookes(angle):
    tilt, speed = 0.6, 3.0
    second, ratio = hooke(angle, tilt)
    frame = Rotation.from_rotvec(tilt * Y)
    motions = {
        "a": turned_about(Z, angle, speed),
        "b": turned_about(frame.apply(Z), second, speed * ratio, frame),
    }
    held(cj.UniversalJoint("a", "b", ORIGIN, ORIGIN, X, Y), motions)


@pytest.mark.parametrize("turns", [0.1, 0.5, 17.3, -4000.9])
@pytest.mark.parametrize("lead", [0.004, -0.25])
def test_screw_advances_by_its_lead_in_a_turn(turns, lead):
    speed, angle = 5.0, 2.0 * math.pi * turns
    along = {"position": turns * lead * X, "velocity": speed * lead / (2.0 * math.pi) * X}
    motions = {"a": AT_REST, "b": turned_about(X, angle, speed, **along)}
    held(cj.ScrewJoint("a", "b", ORIGIN, ORIGIN, X, X, lead), motions, 1e-11)


@pytest.mark.parametrize("turns", [0.03, 12.4, -700.7])
@pytest.mark.parametrize("internal", [False, True])
def test_gears_turn_by_their_teeth(turns, internal):
    """Over many turns, on an arm that turns itself: relative to the arm 17 : 51 and 19 : 44."""
    for first, second in ((17, 51), (19, 44)):
        angle, speed = 2.0 * math.pi * turns, 7.0
        ratio = (1.0 if internal else -1.0) * first / second
        axis = np.array([0.6, 0.0, 0.8])
        arm = turned_about(axis, 0.4, 2.0)
        motions = {
            "arm": arm,
            "a": turned_about(axis, 0.4 + angle + 0.3, 2.0 + speed),
            "b": turned_about(axis, 0.4 + angle * ratio, 2.0 + speed * ratio),
        }
        held(cj.GearJoint("arm", "a", "b", axis, axis, first, second, internal, 0.3), motions)
