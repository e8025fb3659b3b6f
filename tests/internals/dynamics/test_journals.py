"""Penetrations of journals, and what is checked and computed before a run."""

import warnings

import jax
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._dynamics.journals import depths, slid_out, warn_of_journals_outside
from clearjoint._simulation.run.host_run import segment_compiled
from clearjoint._simulation.run.run_checks import check_structure
from clearjoint._sweeps.axes import lanes_of
from tests.dynamics.test_journals import CLEARANCE, end_of, rocker, sliding, start
from tests.support.programs import made_by


def test_a_journal_left_at_its_guess_is_refused_before_anything_is_compiled():
    programs = made_by(segment_compiled)
    with pytest.raises(ValueError, match=r"contact 'V' of joint 'pin' at most 0.0095 m.*0.0295.*"):
        cj.simulate(rocker(), start(0.03), 0.1)
    assert made_by(segment_compiled) == programs


def test_a_journal_far_inside_the_wall_causes_a_warning():
    """5 mm off with a clearance of 0.5 mm; no warning for a usual penetration."""
    coordinates = cj.AbsoluteCoordinates()
    with pytest.warns(cj.UnusualValueWarning, match=r"0.0045 m deep in the wall at .*'V'.*'pin'"):
        check_structure(rocker(), start(0.005), 0.0, coordinates)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_structure(rocker(), start(CLEARANCE + 2e-5), 0.0, coordinates)


@pytest.mark.parametrize(
    ("first", "gravity", "towards"),
    [
        ("ground", (0.0, -9.81, 0.0), (0.0, -1.0)),
        ("rod", (0.0, -9.81, 0.0), (0.0, -1.0)),
        ("ground", (3.0, 0.0, 8.0), (1.0, 0.0)),
    ],
)
def test_a_resting_journal_lies_along_the_wall_where_gravity_presses_it(first, gravity, towards):
    """The rod's end is displaced in the direction of gravity, whether it is journal or bearing."""
    scene = rocker(first, gravity=gravity)
    state = cj.assemble(scene, start(2e-4), resting=["pin"])
    # The load turns slightly as the rod moves to the wall, which it penetrates to carry the load.
    np.testing.assert_allclose(end_of(state)[0][:2], CLEARANCE * np.array(towards), atol=4e-6)
    found = np.array([*depths(scene, state)["pin"].values()])
    assert (found > 1e-9).all() and (found < 1e-6).all()
    np.testing.assert_allclose(end_of(state)[1][:2], 0.0, atol=1e-3)


def test_a_run_warns_of_a_journal_that_has_left_its_bearing():
    """It leaves after 50 ms; the warning names the first saved state after that."""
    scene, state = sliding()
    with pytest.warns(cj.LeftBearingWarning) as caught:
        solution = cj.simulate(scene, state, 0.2, save=cj.Saving([0.02, 0.04, 0.06, 0.2]))
    assert solution.result == cj.RESULTS.successful
    (warning,) = caught
    message = str(warning.message)
    parts = "'pin'", "t = 0.06 s it is 0.004 m beyond", "EndPlay(...)", "LeftBearingWarning"
    assert [part for part in parts if part not in message] == [], message
    assert warning.filename == __file__
    with pytest.warns(cj.LeftBearingWarning, match=r"t = 0.2 s it is 0.06 m beyond"):
        warn_of_journals_outside(scene, solution.time, solution.final, [])


def test_lanes_of_other_lengths_and_points_have_their_own_ends():
    """The rod's end is at z = -0.04 m, relative to the bearing of each lane; journals of 20 mm."""
    scene, state = sliding()
    axes = {"point": cj.Axis(lambda s: s.joints["pin"].bearing_point[2], [0.0, -0.03])}
    lanes = lanes_of(scene, state, axes, {"point": axes["point"].values})
    final = cj.BodyState(*(np.asarray(part)[None] for part in jax.tree.leaves(start(z=-0.04))))
    excess = slid_out(lanes.contact_joints(), {"rod": final})
    np.testing.assert_allclose(excess["pin"], [0.02, -0.01], rtol=0.0, atol=1e-15)
