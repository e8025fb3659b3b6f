"""The bushing: forces and moments in closed form, and errors."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint.extend import unpack
from clearjoint.testing import moving
from tests.support.motions import AT_REST
from tests.support.shaft import ORIGIN
from tests.support.symmetry_transformations import euler


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"stiffness": (1.0, -1.0, 1.0)}, "`stiffness` must be zero or positive"),
        ({"damping": 3.0}, "`damping` must be an array of shape"),
        ({"orientation_first": (1.0, 1.0, 0.0, 0.0)}, "`orientation_first` must be Euler"),
    ],
)
def test_invalid_bushings_are_refused(change, complaint):
    given: dict[str, Any] = {"stiffness": (1.0, 1.0, 1.0)}
    with pytest.raises(ValueError, match=complaint):
        cj.Bushing("a", "b", (0, 0, 0), (0, 0, 0), **(given | change))


def test_each_axis_is_a_spring_and_a_damper():
    """Along an axis and, by more than a right angle, about it; the axes have any orientation."""
    shift, speed, angle, spin = 0.01, -0.3, 2.5, 4.0
    turn, axes = Rotation.from_rotvec([0.3, -1.2, 0.8]), Rotation.from_rotvec([0.5, 0.2, -0.4])
    liner = cj.Bushing(
        *("ground", "b", ORIGIN, ORIGIN),
        stiffness=(500.0, 600.0, 700.0),
        damping=(3.0, 4.0, 5.0),
        rotational_stiffness=(1.0, 2.0, 3.0),
        rotational_damping=(0.1, 0.2, 0.3),
        orientation_first=euler(axes.as_matrix()),
        orientation_second=euler((turn.inv() * axes).as_matrix()),
    )
    for k, axis in enumerate(axes.as_matrix().T):
        second = Rotation.from_rotvec(angle * axis) * turn
        turning = second.inv().apply(spin * axis)
        body = moving(shift * axis, euler(second.as_matrix()), speed * axis, turning)
        wrench = unpack(liner).wrenches({"ground": AT_REST, "b": body}, 0.0)["b"]
        force = -(500.0 + 100.0 * k) * shift - (3.0 + k) * speed
        moment = -(1.0 + k) * angle - 0.1 * (1.0 + k) * spin
        np.testing.assert_allclose([*wrench.force], force * axis, rtol=0.0, atol=1e-12)
        found = second.apply([*wrench.moment])
        np.testing.assert_allclose(found, moment * axis, rtol=0.0, atol=1e-12)
