"""Joint coordinates satisfy the rows of the joint, and are found again from the bodies."""

import numpy as np
import pytest

from clearjoint._model.joints.constraint_rows import row_rate
from clearjoint.extend import Motion, Relative, normalised, pack, rotation_matrix, unpack
from clearjoint.testing import moving
from tests.model.test_motion_subspaces import JOINTS, both, each, numbers, subspace_and_state


@each
@both
def test_encoding_is_the_inverse_and_the_joint_is_satisfied(name, parent):
    subspace, state = subspace_and_state(name, parent)
    orientation = normalised(subspace.orientation(state.position))
    apart, twist = subspace.displacement(state.position), subspace.twist(state)
    found = subspace.encode(Relative(orientation, apart, twist))
    np.testing.assert_allclose(numbers(found.position), numbers(state.position), atol=1e-14)
    np.testing.assert_allclose(numbers(found.speeds), state.speeds, atol=1e-14)
    rotation = subspace.rotation(state.position)
    np.testing.assert_allclose(pack(rotation), pack(rotation_matrix(orientation)), atol=1e-14)
    # The parent rests in the origin; the child's point is `apart` from the parent's.
    here = moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    at = subspace.point_parent + rotation @ (apart - subspace.point_child)
    rate = twist.linear + twist.angular.cross(apart - subspace.point_child)
    there = Motion(at, rotation, rotation @ rate, twist.angular)
    motions = dict(zip(("a", "b") if parent == "a" else ("b", "a"), (here, there), strict=True))
    for row in unpack(JOINTS[name]).rows(motions, 0.0).values():
        assert float(row.value) == pytest.approx(0.0, abs=1e-14)
        assert float(row_rate(row, motions)) == pytest.approx(0.0, abs=1e-13)
