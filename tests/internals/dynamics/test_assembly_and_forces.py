"""Rows of a start: those that depend on others, and how a start is checked."""

from functools import partial

import jax
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint._dynamics.constraint_report import start_rows
from clearjoint._simulation.run.run_checks import BY_NUMPY, flat_start, starts
from tests.support.one_body import hinge, one_body


def test_redundant_constraints_are_found_from_rows_of_unit_norm():
    """The rows of a hinge far from the centre of mass are long."""
    point = (3.0, 0, -2.0)
    scene, state = one_body("rotor", {"hinge": hinge("ground", "rotor", point, point)})
    rows = start_rows(scene, cj.AbsoluteCoordinates(), state, 0.0, with_jacobian=True)
    lengths = np.linalg.norm(rows.jacobian, axis=1)
    assert lengths.max() > 3.0
    np.testing.assert_allclose(rows.reduced * lengths[:, None], rows.jacobian, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("turn", [((1, 0, 0), 180), ((0, 0, 1), 180), ((1, 1, 1), 120)])
@pytest.mark.parametrize("kind", [cj.FixedJoint, partial(cj.PrismaticJoint, axis=(1, 0, 0))])
def test_joints_refuse_orientations_other_than_their_own(kind, turn):
    """The rows vanish there too."""
    origin, declared = (0, 0, 0), Rotation.from_rotvec((0.4, 0.2, -0.3))
    joint = kind("ground", "block", origin, origin, orientation=declared.as_quat(scalar_first=True))
    scene = cj.Scene({"block": cj.Body(1.0, (0.1, 0.1, 0.1))}, {"weld": joint})
    settings = cj.Settings(coordinates=cj.AbsoluteCoordinates())
    axis, angle = turn
    wrong = Rotation.from_rotvec(np.radians(angle) * np.asarray(axis) / np.linalg.norm(axis))

    def state(rotation):
        return cj.State({"block": cj.body_state(origin, rotation.as_quat(scalar_first=True))})

    message = f"joint 'weld', but is {angle}"
    with pytest.raises(ValueError, match=message):
        cj.assemble(scene, state(wrong * declared))
    # The first starts are checked by NumPy, and the last one by native code.
    for _ in range(BY_NUMPY + 1):
        with pytest.raises(ValueError, match=message):
            cj.simulate(scene, state(wrong * declared), 1e-3, settings, progress=False)
    right = cj.assemble(scene, state(Rotation.from_rotvec((0.1, 0, 0.1)) * declared))
    found = starts.redundant(flat_start(scene, right, 0.0, cj.AbsoluteCoordinates()))
    assert found == ()


@pytest.mark.slow
def test_assembly_needs_no_jacobian_of_all_rows(monkeypatch):
    """Its rank takes time that grows with the cube of the number of bodies."""
    scene, guess = cj.mechanisms.slider_crank()
    expected = cj.assemble(scene, guess, centred=True)

    def refuse(*_):
        raise AssertionError

    monkeypatch.setattr("clearjoint._dynamics.constraint_report.dependent", refuse)
    found = cj.assemble(scene, guess, centred=True)
    jax.tree.map(np.testing.assert_array_equal, found, expected)
