"""Journal positions: corrected or refused at the start of a run, checked at its end."""

import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj
from tests.support.one_body import Z, bearing

CLEARANCE, HALF = 0.5e-3, 0.25
ROD = cj.Body(1.0, (1e-3, 2e-2, 2e-2))


def rocker(first="ground", axis=Z, gravity=(0.0, -9.81, 0.0), **options):
    """A rod whose end has a journal, or a bearing, about Z at the ground's origin."""
    kind, second = ("journal", "rod") if first == "ground" else ("bearing", "ground")
    on_rod = {f"{kind}_point": (-HALF, 0.0, 0.0), f"{kind}_axis": axis, "clearance": CLEARANCE}
    pin = bearing(cj.laws.Hertz(1e10), second, first, **on_rod, **options)
    return cj.Scene({"rod": ROD}, {"pin": pin}, gravity=gravity)


def start(x=0.0, y=0.0, z=0.0):
    """The rod along X, with its end displaced from the origin."""
    return cj.State({"rod": cj.body_state((HALF + x, y, z), velocity=(0.1, 0.2, 0.3))})


def end_of(state):
    """Return position and velocity of the rod's end."""
    body, arm = state.bodies["rod"], np.array([-HALF, 0.0, 0.0])
    turn = Rotation.from_quat(body.orientation, scalar_first=True)
    velocity = np.asarray(body.velocity) + turn.apply(np.cross(body.spin, arm))
    return np.asarray(body.position) + turn.apply(arm), velocity


@pytest.mark.parametrize("first", ["ground", "rod"])
def test_assembly_centres_a_journal_that_is_outside(first):
    """It gets the velocity of an ideal joint, and keeps its axial position."""
    state = cj.assemble(rocker(first), start(0.03, -0.02, 0.004))
    position, velocity = end_of(state)
    np.testing.assert_allclose(position, (0.0, 0.0, 0.004), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(velocity, (0.0, 0.0, 0.3), rtol=0.0, atol=1e-12)


def test_assembly_does_not_move_a_journal_inside_its_bearing():
    guess = start(3e-4, -2e-4)
    state = cj.assemble(rocker(), guess)
    for part in ("position", "orientation", "velocity", "spin"):
        expected = getattr(guess.bodies["rod"], part)
        np.testing.assert_array_equal(getattr(state.bodies["rod"], part), expected)


class FilmOnly(cj.extend.AbstractContactJoint):
    """A joint that acts by its film alone, and has no contacts."""

    def pair(self):
        return "ground", "rod"

    def laws(self):
        return {}

    def contacts(self, motions):
        return {}

    def friction_force(self, name, contact, normal_force):
        return None


def test_a_joint_without_contacts_is_assembled():
    scene = rocker()
    scene = cj.Scene(scene.bodies, {**scene.joints, "film": FilmOnly()}, gravity=scene.gravity)
    position, _ = end_of(cj.assemble(scene, start(0.03)))
    np.testing.assert_allclose(position, 0.0, atol=1e-12)


def test_end_play_and_antiparallel_axes_are_assembled_too():
    axial = cj.EndPlay(1e-3, cj.laws.Hertz(1e9))
    state = cj.assemble(rocker(axis=(0.0, 0.0, -1.0), axial=axial), start(0.0, 0.02, 0.004))
    np.testing.assert_allclose(end_of(state)[0], 0.0, atol=1e-12)


def test_a_journal_without_load_cannot_rest():
    scene = rocker(gravity=(0.0, 0.0, -9.81))
    with pytest.raises(ValueError, match=r"`resting`.*pressed against 'ground' across the axis.*N"):
        cj.assemble(scene, start(), resting=["pin"])
    with pytest.raises(ValueError, match=r"`resting`.*clearance joints \['pin'\].*'hinge'"):
        cj.assemble(scene, start(), resting=["hinge"])


def sliding(**options):
    """A journal without contact, at 0.4 m/s along its bearing's axis."""
    scene = rocker(gravity=None, **options)
    return scene, cj.State({"rod": cj.body_state((HALF, 0.0, 0.0), velocity=(0.0, 0.0, -0.4))})


def test_a_journal_in_its_bearing_causes_no_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cj.simulate(*sliding(), 0.04, save=cj.Saving(np.linspace(0.0, 0.04, 5)))


@pytest.mark.parametrize("axial", [cj.FixedAxially(), cj.EndPlay(1e-3, cj.laws.Hertz(1e9))])
def test_a_journal_that_cannot_slide_does_not_leave(axial):
    joint = rocker(axial=axial).joints["pin"]
    assert joint.slid_out({}) is None


@pytest.mark.slow
def test_a_sweep_warns_with_the_number_of_lanes_whose_journal_has_left_its_bearing():
    """In 0.1 s it slides 40 mm: past the end for journals of 20 and 30 mm, not of 50 mm."""
    lengths = cj.Axis(lambda s: s.joints["pin"].journal_length, [0.02, 0.03, 0.05])
    with pytest.warns(cj.LeftBearingWarning, match=r"In 2 of 3 lanes .*'pin'.* up to 0.02 m"):
        cj.sweep(*sliding(), 0.1, axes={"length": lengths}, outputs={})
