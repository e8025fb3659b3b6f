"""Parts of a view: outlines, bars, solids, arrows, colours, and what hides what."""

import dataclasses

import equinox as eqx
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._views.arrows import LONGEST
from clearjoint._views.filming import _covered, _time_text
from clearjoint._views.meshes import FORCE, LOAD, METAL, MODES, corners, outline
from clearjoint._views.poses import initial_state
from clearjoint._views.proportions import equivalent_solid
from clearjoint._views.sketching import WALL, colours
from tests.support import recorded_journal as recorded
from tests.views import test_view
from tests.views.test_view import BALL, ORIGIN, Mystery, journal_of, part_of, rigid_run, spread

seen = test_view.seen


def arrow_of(view, name="pin V", colour=FORCE):
    """The part that is the arrow of a force, and its vectors in all frames, (N, 3) m."""
    part = next(part for part in view.parts if part.name == name and part.colour == colour)
    return part, part.poses[:, :3, 2]


def test_true_proportions_by_scales_of_one():
    scene, state = cj.mechanisms.double_pendulum()
    view = cj.view(scene, state, clearance_scale=1.0, bearing_scale=1.0)
    assert spread(journal_of(view), 2) == pytest.approx(9.5e-3)
    vertices = part_of(view, "ground").mesh.vertices
    ring = vertices[np.abs(vertices[:, 2]) > 9.9e-3]
    radii = np.linalg.norm(ring[:, :2], axis=1)
    assert radii.min() == pytest.approx(10e-3)
    assert np.isclose(radii, 10e-3 * (1.0 + WALL)).any()


def test_an_arrow_ends_on_a_journal_that_is_out_of_round(seen):
    """The first harmonic of a profile shifts the circle along the journal's x axis."""
    scene, shift = recorded.arm_in_bearing(), 0.02e-3
    shifted = cj.profiles.Harmonics([shift])
    pin = dataclasses.replace(scene.joints["pin"], journal_profile=shifted)
    scene = dataclasses.replace(scene, joints={"pin": pin})
    view = cj.view(scene, recorded.motion(), observation=recorded.observed())
    tips, round_tips = (
        part.poses[recorded.TOUCHING, :3, 3] + along[recorded.TOUCHING]
        for part, along in map(arrow_of, (view, seen))
    )
    expected = np.tile((view.clearance_scale * shift, 0.0, 0.0), (len(tips), 1))
    np.testing.assert_allclose(tips - round_tips, expected, rtol=0.0, atol=1e-12)


def test_the_outline_of_a_shifted_circle_is_that_circle():
    """Its tangents are at the distances radius + shift . direction; its corners are on it."""
    angles, shift = np.arange(360) * np.pi / 180.0, np.array([0.2, -0.3])
    distances = 1.0 + shift @ [np.cos(angles), np.sin(angles)]
    corners = outline(distances)
    np.testing.assert_allclose(np.linalg.norm(corners - shift, axis=1), 1.0, atol=1e-4)
    np.testing.assert_allclose(
        np.arctan2(*corners.T[::-1]) % (2.0 * np.pi), angles, rtol=0.0, atol=1e-12
    )


def test_a_bar_reaches_from_joint_to_joint_and_moves_with_its_body():
    scene, state = cj.mechanisms.four_bar()
    view = cj.view(scene, state)
    for name in ("crank", "coupler", "rocker"):
        bar = next(part for part in view.parts if part.name == name and part.colour != METAL)
        pose = bar.pose(0)
        np.testing.assert_allclose(pose[:3, 3], state.bodies[name].position)
        drawn = pose[:3, :3] @ bar.mesh.vertices.T
        ends = [p for j in scene.joints.values() for _, b, p in j.attachments() if b == name]
        long = np.ptp(bar.mesh.vertices[:, 0])
        assert long == pytest.approx(np.linalg.norm(np.subtract(*ends)), rel=0.2)
        assert np.isfinite(drawn).all()


@pytest.mark.parametrize("sides", [(0.3, 0.1, 0.05), (0.2, 0.2, 0.2)])
def test_the_solid_of_a_box_is_that_box(sides):
    x, y, z = np.square(sides)
    body = cj.Body(2.0, (2.0 * (y + z) / 12.0, 2.0 * (x + z) / 12.0, 2.0 * (x + y) / 12.0))
    solid = equivalent_solid(body)
    np.testing.assert_allclose(solid.sides, sides)
    assert not solid.round


def test_small_moments_of_inertia_are_compared_relative_to_their_size():
    assert equivalent_solid(cj.Body(1e-5, (2e-11, 2e-11, 3e-11))).round


def test_the_solid_of_a_turned_cylinder_is_that_cylinder():
    radius, length, axis = 0.1, 0.3, np.array([1.0, 2.0, 2.0]) / 3.0
    across, along = radius**2 / 4.0 + length**2 / 12.0, radius**2 / 2.0
    inertia = across * np.eye(3) + (along - across) * np.outer(axis, axis)
    solid = equivalent_solid(cj.Body(3.0, 3.0 * inertia))
    assert solid.round
    np.testing.assert_allclose(solid.sides, (2 * radius, 2 * radius, length))
    np.testing.assert_allclose(abs(solid.axes[:, 2] @ axis), 1.0)


def test_arrows_end_at_contact_points(seen):
    touching, bore = recorded.TOUCHING, recorded.RADIUS * seen.bearing_scale
    normal = recorded.observed().contacts["pin"]["V"].normal
    assert {part.name for part in seen.parts if part.colour == FORCE} == {"pin V", "pin W"}
    for part, along in (arrow_of(seen, "pin V"), arrow_of(seen, "pin W")):
        lengths = np.linalg.norm(along, axis=1)
        length = recorded.FORCE * seen.force_scale
        np.testing.assert_allclose(lengths[touching], length, rtol=1e-9)
        assert (lengths[~touching] < 1e-6).all()
        across = ((part.poses[:, :3, 3] + along) * normal).sum(axis=1)[touching]
        np.testing.assert_allclose(across, bore, rtol=1e-9)


def test_long_arrows_are_cut_for_a_given_scale():
    shown = recorded.arm_in_bearing(), recorded.motion()
    long = cj.view(*shown, observation=recorded.observed(), force_scale=1.0)
    longest = np.linalg.norm(arrow_of(long)[1], axis=1).max()
    assert longest == pytest.approx(LONGEST * 0.4, rel=0.1)
    assert "cut at" in long.legend.notes[-1]


def pressed(peak: float) -> cj.results.Observation:
    """The observation with a far larger force, N, at one instant."""
    observed = recorded.observed()
    force = observed.contacts["pin"]["V"].normal_force.copy()
    force[-1] = peak
    return eqx.tree_at(lambda seen: seen.contacts["pin"]["V"].normal_force, observed, force)


@pytest.mark.parametrize(("peak", "exponent"), [(800.0, 1.0), (80.0 * recorded.FORCE, 0.5)])
def test_the_largest_force_has_the_longest_arrow_and_others_are_visible(peak, exponent):
    scene, motion = recorded.arm_in_bearing(), recorded.motion()
    view = cj.view(scene, motion, observation=pressed(peak))
    lengths = np.linalg.norm(arrow_of(view)[1], axis=1)[recorded.TOUCHING]
    assert lengths[-1] == pytest.approx(LONGEST * 0.4, rel=0.1)
    assert lengths[0] / lengths[-1] == pytest.approx((recorded.FORCE / peak) ** exponent)
    note = view.legend.notes[-1]
    assert "cut" not in note and ("square root" in note) == (exponent == 0.5)
    assert view.force_scale * peak == pytest.approx(lengths[-1])


def test_the_motion_is_in_the_middle_of_the_picture(seen):
    for view in (
        seen,
        cj.view(*cj.mechanisms.slider_crank()[:2]),
        cj.view(*cj.mechanisms.robot_arm()[:2]),
    ):
        camera = view._camera
        bodies = [part for part in view.parts if part.colour not in (FORCE, LOAD)]
        count = 1 if view.times is None else len(view.times)
        places = (corners(bodies, range(count)) - camera.target) @ camera.axes().T
        distance = np.linalg.norm(camera.eye - camera.target)
        # As a camera sees it: the farther away, the smaller.
        across = places[:, :2] / (distance - places[:, 2:]) / np.tan(np.radians(15.0))
        low, high = across.min(axis=0), across.max(axis=0)
        np.testing.assert_allclose(low, -high, atol=0.03)
        assert high[1] < 1.0 and high[0] < 1.25
        assert max(high[1], high[0] / 1.25) > 0.6


def test_modes_colour_the_journal_and_are_in_the_legend(seen):
    journal = journal_of(seen)
    assert journal.colour_at(0) == MODES[0]
    assert journal.colour_at(recorded.COUNT - 1) == MODES[2]
    label_of_colour = dict(seen.legend.entries)
    assert label_of_colour[MODES[0]] == "journal: free flight"
    assert label_of_colour[MODES[2]] == "journal: contact along a line"
    assert label_of_colour[FORCE] == "contact force"


def test_forces_can_be_omitted():
    view = cj.view(recorded.arm_in_bearing(), recorded.motion(), forces=False)
    assert all(part.colour != FORCE and part.modes is None for part in view.parts)


@pytest.mark.parametrize(
    ("mechanism", "error"),
    [
        (cj.mechanisms.double_pendulum, 1e-12),
        pytest.param(cj.mechanisms.four_bar, 1e-9, marks=pytest.mark.slow),
    ],
    ids=["chain", "loop"],
)
def test_bodies_without_a_state_follow_the_joints(mechanism, error):
    scene, _ = mechanism()
    state, fits = initial_state(scene)
    assert fits
    assert np.abs(cj.constraint_report(scene, state).values).max() < error
    assert "state found from the joints" in cj.view(scene).legend.notes[0]


def test_the_arrow_of_a_load_shows_its_force_at_the_time_of_each_frame():
    def push(t):
        return 100.0 * t, 0.0, 1.0

    steps = cj.PiecewiseConstant([0.0, 0.01], [0.0, 20.0])
    loads = {"push": cj.AppliedLoad("arm", push), "kick": cj.AppliedLoad("arm", (0.0, steps, 0.0))}
    scene = dataclasses.replace(recorded.arm_in_bearing(), forces=loads)
    view = cj.view(scene, recorded.motion(), force_scale=1e-3)
    pushed, kicked = (arrow_of(view, name, LOAD)[1] for name in loads)
    expected = np.stack([100.0 * recorded.TIMES, 0.0 * recorded.TIMES, np.ones(recorded.COUNT)], 1)
    np.testing.assert_allclose(pushed, 1e-3 * expected, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(kicked[:, 1], 0.02 * (recorded.TIMES >= 0.01), rtol=0.0, atol=1e-8)
    standing = cj.view(scene, cj.State({"arm": cj.body_state((0.2, 0.0, 0.0))}), force_scale=1e-3)
    arrows = [part.poses[:, :3, 2] for part in standing.parts if part.colour == LOAD]
    np.testing.assert_allclose(arrows, [[[0.0, 0.0, 1e-3]]], rtol=0.0, atol=1e-12)


class Couple(Mystery):
    """Two opposite loads."""

    def draw(self, pen):
        for sign in (-1.0, 1.0):
            pen.load(cj.extend.Marker(self.body, (0.1 * sign, 0.0, 0.0)), (0.0, 5.0 * sign, 0.0))


def test_all_loads_of_an_element_have_arrows():
    scene = cj.Scene({"ball": BALL}, forces={"couple": Couple("ball")})
    view = cj.view(scene, cj.State({"ball": cj.body_state(ORIGIN)}), force_scale=0.01)
    arrows = [part.poses[0, :3] for part in view.parts if part.colour == LOAD]
    np.testing.assert_allclose([arrow[0, 3] for arrow in arrows], [-0.1, 0.1])
    np.testing.assert_allclose([arrow[1, 2] for arrow in arrows], [-0.05, 0.05])


def test_rigid_contacts_have_no_arrows_of_forces():
    """But the journal has the colours of its motion modes."""
    scene, solution = recorded.arm_in_bearing(), rigid_run(recorded.motion())
    view = cj.view(scene, solution, observation=recorded.observed())
    assert all(part.colour != FORCE for part in view.parts)
    assert journal_of(view).colour_at(recorded.COUNT - 1) == MODES[2]


@pytest.mark.parametrize(
    ("time", "whole", "text"),
    [
        (5.0, 0.0, "t = 5.00 s"),
        (2e-4, 0.0, "t = 200 µs"),
        (0.0, 0.0, "t = 0.00 s"),
        (5.0, 0.02, "t = 5000.0 ms"),
    ],
)
def test_the_time_of_a_frame_has_the_unit_of_the_run(time, whole, text):
    """If the run has a single frame, the unit is that of the time itself."""
    assert _time_text(time, whole) == text


def test_sixty_bodies_have_different_colours():
    given = colours([f"body {k}" for k in range(60)])
    assert len(set(given.values())) == 61  # with the ground


def test_the_nearest_of_crossing_triangles_is_seen_at_each_point():
    """Random triangles, against the depths of all of them at all points."""
    random = np.random.default_rng(7)
    corners, closeness = random.uniform(-5.0, 45.0, (30, 3, 2)), random.uniform(0.1, 1.0, (30, 3))
    seen = np.zeros(40 * 40)
    for point, _, near in _covered(corners, closeness, 40, 40):
        np.maximum.at(seen, point, near)
    y, x = np.divmod(np.arange(1600), 40)
    exact = np.zeros(1600)
    for (a, b, c), values in zip(corners, closeness, strict=True):
        around = np.array([[*a, 1.0], [*b, 1.0], [*c, 1.0]]).T
        weights = np.linalg.solve(around, np.array([x + 0.5, y + 0.5, 1.0 + 0 * x]))
        inside = (weights >= 0.0).all(axis=0)
        exact[inside] = np.maximum(exact, values @ weights)[inside]
    np.testing.assert_allclose(seen, exact, rtol=0.0, atol=1e-9)
