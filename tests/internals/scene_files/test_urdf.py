"""Joints with play of a robot lie inside their bearings."""

import numpy as np

import clearjoint as cj
from clearjoint._dynamics.journals import outside
from tests.scene_files import test_urdf
from tests.scene_files.test_urdf import PLAY

read = test_urdf.read


def test_play_replaces_a_hinge(read):
    loaded, (plain, _) = read(play={"elbow": PLAY})[0], read()
    elbow, ideal = loaded.scene.joints["elbow"], plain.scene.joints["elbow"]
    assert isinstance(elbow, cj.ClearanceJoint) and isinstance(elbow.axial, cj.FixedAxially)
    assert (elbow.bearing_body, elbow.journal_body) == ("upper", "lower")
    assert np.array_equal(elbow.bearing_point, ideal.point_first)
    assert np.array_equal(elbow.journal_axis, ideal.axis_second)
    assert outside(loaded.scene, loaded.state()) == set()
