"""Joints with play of a robot lie inside their bearings."""

import numpy as np

import clearjoint as cj
from clearjoint._dynamics.journals import outside
from tests.scene_files import test_urdf
from tests.scene_files.test_urdf import PLAY

robot = test_urdf.robot


def test_play_replaces_a_hinge(robot):
    scene, state, _ = robot(play={"elbow": PLAY})
    elbow, ideal = scene.joints["elbow"], robot()[0].joints["elbow"]
    assert isinstance(elbow, cj.ClearanceJoint) and isinstance(elbow.axial, cj.FixedAxially)
    assert (elbow.bearing_body, elbow.journal_body) == ("upper", "lower")
    assert np.array_equal(elbow.bearing_point, ideal.point_first)
    assert np.array_equal(elbow.journal_axis, ideal.axis_second)
    assert outside(scene, state) == set()
