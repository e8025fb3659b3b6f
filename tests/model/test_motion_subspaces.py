"""Joint coordinates of a screw; those of all joints are in the test of large trees."""

import numpy as np
import pytest

import clearjoint as cj
from clearjoint.extend import Relative, Twist, unpack
from tests.support.motions import AT_REST


@pytest.mark.parametrize("turns", [-3, 0, 5])
def test_a_screw_s_advance_tells_its_revolutions(turns):
    points, axes = ((0.1, 0.2, -0.3), (-0.2, 0.4, 0.1)), ((1.0, 2.0, 2.0), (0.5, -1.0, 0.3))
    subspace = unpack(cj.ScrewJoint("a", "b", *points, *axes, lead=-0.7)).motion_subspace("a")
    angle = 2.0 * np.pi * turns + 0.4
    advance = subspace.axis * (-0.7 / (2.0 * np.pi) * angle)
    still = Twist(AT_REST.spin, AT_REST.velocity)
    found = subspace.encode(Relative(subspace.orientation(angle), advance, still))
    assert float(found.position) == pytest.approx(angle, rel=1e-13)
