"""Views: positions and sizes of parts, legends and pages."""

import dataclasses
import re
import shutil
import sys

import jax
import numpy as np
import pytest
import trimesh
from PIL import Image

import clearjoint as cj
from clearjoint.extend import Formulation
from tests.support import recorded_journal as recorded
from tests.support.elements import SECOND, case, elements
from tests.support.tumbling_bearing import solution_of

Z = (0.0, 0.0, 1.0)
ORIGIN = (0.0, 0.0, 0.0)
BALL = cj.Body(1.0, (1e-3, 1e-3, 1e-3))


@pytest.fixture(scope="module")
def seen():
    return cj.view(recorded.arm_in_bearing(), recorded.motion(), observation=recorded.observed())


def journal_of(view):
    return next(part for part in view.parts if part.is_journal)


def part_of(view, name):
    """The first part of a body or an element."""
    return next(part for part in view.parts if part.name == name)


def spread(part, axis):
    """Largest distance of a part's vertices from its z axis, m."""
    return np.linalg.norm(np.delete(part.mesh.vertices, axis, axis=1), axis=1).max()


def test_the_eccentricity_of_a_journal_is_scaled(seen):
    journal = journal_of(seen)
    drawn = journal.poses[:, :3, 3]
    np.testing.assert_allclose(
        drawn, seen.clearance_scale * recorded.eccentricities(), rtol=0.0, atol=1e-12
    )
    bore = recorded.RADIUS * seen.bearing_scale
    reach = np.linalg.norm(drawn, axis=1) + spread(journal, 2)
    np.testing.assert_allclose(reach[recorded.TOUCHING], bore, rtol=1e-9)
    assert (reach[~recorded.TOUCHING] < 0.95 * bore).all()
    assert 0.2 * bore < seen.clearance_scale * recorded.CLEARANCE <= 0.3 * bore


def test_profiles_are_drawn_with_the_scale_of_clearances():
    """Of lobes, the drawn radii at their highest and lowest points."""
    scene, lobe = recorded.arm_in_bearing(), 0.1e-3
    pin = dataclasses.replace(
        scene.joints["pin"],
        bearing_profile=cj.profiles.Harmonics([0.0, lobe]),
        journal_profile=cj.profiles.Harmonics([0.0, 0.0, 0.2 * lobe]),
    )
    view = cj.view(dataclasses.replace(scene, joints={"pin": pin}), recorded.motion())
    bored, turned = part_of(view, "ground").mesh.vertices, journal_of(view).mesh.vertices
    bore, high = recorded.RADIUS * view.bearing_scale, view.clearance_scale * lobe
    inner = bore - view.clearance_scale * recorded.CLEARANCE
    for vertices, angle, expected in (
        (bored, 0.0, bore + high),
        (bored, 0.5 * np.pi, bore - high),
        (bored, np.pi, bore + high),
        (turned, 0.0, inner + 0.2 * high),
        (turned, np.pi / 3.0, inner - 0.2 * high),
        (turned, np.pi, inner - 0.2 * high),
    ):
        near = np.abs(vertices[:, :2] - expected * np.array([np.cos(angle), np.sin(angle)])) < 1e-9
        assert near.all(axis=1).any()


def test_arrows_between_the_bases_end_on_the_drawn_journal(seen):
    observed, touching = recorded.observed(), recorded.TOUCHING
    ends = observed.contacts["pin"]
    contacts = {"pin": {**ends, "point 2": ends["W"]}}
    observed = dataclasses.replace(observed, contacts=contacts)
    view = cj.view(recorded.arm_in_bearing(), recorded.motion(), observation=observed)
    tips = {part.name: part.poses[:, :3, 3] + part.poses[:, :3, 2] for part in view.parts}
    middle = 0.5 * (tips["pin V"] + tips["pin W"])
    np.testing.assert_allclose(
        tips["pin point 2"][touching], middle[touching], rtol=0.0, atol=1e-12
    )


def test_impacts_between_the_frames_are_noted():
    saved, rows = recorded.motion(), [("pin", "V", 0.01, 0.011, 1e-3, 0.1, 0.1, 9e3, 0.01, 1e-6)]
    solution = solution_of(saved, cj.results.Impacts.of_rows(rows))
    view = cj.view(recorded.arm_in_bearing(), solution, observation=recorded.observed())
    assert view.legend.notes[-1] == "largest contact force, between frames: 9 kN"


def test_a_run_with_steps_only_is_shown_at_equal_intervals():
    states = jax.tree.map(lambda rows: rows[[0, 1, 2, -1]], recorded.motion().states)
    steps = cj.results.Trajectory(np.r_[0.0, 1e-6, 2e-6, 0.02], states)
    solution = dataclasses.replace(solution_of(steps), saved=None, steps=steps)
    view = cj.view(recorded.arm_in_bearing(), solution, forces=False, frames=5)
    np.testing.assert_allclose(view.times, np.linspace(0.0, 0.02, 5))


def test_the_legend_has_the_scales(seen):
    assert f"clearances enlarged {seen.clearance_scale:g} " in seen.legend.notes[0]
    assert seen.legend.notes[-1].startswith("arrows: ")
    assert all(note.split("×")[0] in seen.html for note in seen.legend.notes)


def test_ten_thousand_states_make_a_small_page(tmp_path):
    count = 10_000
    still, turn = np.zeros((count, 3)), np.tile((1.0, 0.0, 0.0, 0.0), (count, 1))
    place = np.random.default_rng(0).normal(0.2, 1e-3, (count, 3))
    times = np.cumsum(np.random.default_rng(1).uniform(0.5, 1.5, count)) * 1e-4
    states = cj.State({"arm": cj.BodyState(place, turn, still, still)})
    motion = cj.results.Trajectory(times, states)
    view = cj.view(recorded.arm_in_bearing(), motion, frames=300)
    assert 290 <= len(view.times) <= 300
    assert (view.times[0], view.times[-1]) == (times[0], times[-1])
    assert np.abs(np.diff(view.times) - np.diff(view.times).mean()).max() < 3e-4
    assert view.save(tmp_path / "long.html").stat().st_size < 3e6


def test_a_page_needs_no_network(seen):
    tags = re.findall(r"<(?:script|link|img|iframe)[^>]*(?:src|href)=[^>]*>", seen.html)
    assert tags == []
    frame = seen._repr_html_()
    assert frame.startswith("<iframe srcdoc=")
    assert "<script" not in frame


def test_names_cannot_break_the_page():
    bodies = {"</script><b>'\"": BALL}
    scene = cj.Scene(bodies, {"hinge": cj.SphericalJoint("ground", *bodies, (0.1, 0, 0), ORIGIN)})
    page = cj.view(scene, cj.State({name: cj.body_state((0.1, 0, 0)) for name in bodies})).html
    assert "</script><b>" not in page


class Mystery(cj.extend.AbstractForce):
    body: str

    def body_names(self):
        return (self.body,)

    def wrenches(self, motions, t):
        return {}

    def draw(self, pen):
        pen.rod(cj.extend.Marker("ground", ORIGIN), cj.extend.Marker(self.body, ORIGIN))


AXES = (ORIGIN, ORIGIN, Z, Z)
FLAT = cj.laws.Hertz(1e9)
CASES = elements() | {"of a third party": case(Mystery(SECOND))}
UNDRAWN = {
    *("gears", "ring gear", "backlash", "motor", "servo", "torsional spring", "switched torque"),
    *("prescribed rotation", "prescribed angle"),
    *("friction of a hinge", "friction of a ball", "friction of a slider"),
}
"""Elements that act in a joint, which is drawn."""


@pytest.mark.parametrize("name", CASES)
def test_every_element_draws_itself(name):
    scene, state = CASES[name].scene, cj.State(CASES[name].state.bodies)
    joints, forces = (
        {key: one for key, one in family.items() if key != "element"}
        for family in (scene.joints, scene.forces)
    )
    bare = dataclasses.replace(scene, joints=joints, forces=forces)
    view, without = cj.view(scene, state), cj.view(bare, state)
    faces, others = (sum(len(p.mesh.faces) for p in one.parts) for one in (view, without))
    assert (faces > others) == (name not in UNDRAWN)
    for part in view.parts:
        assert np.isfinite(part.mesh.vertices).all()
        assert np.isfinite(part.poses).all()
        assert part.mesh.faces.max() < len(part.mesh.vertices)


def test_walls_that_face_the_viewer_are_drawn():
    """The axes of most joints are along the normal of the walls, but the motion is spatial."""
    slot = cj.PinInSlot(
        "ground", "ball", slot_normal=Z, slot_axis=(1, 0, 0), play=1e-3, pin_radius=5e-3, law=FLAT
    )
    across = cj.RevoluteJoint("ground", "ball", ORIGIN, ORIGIN, (0, 1, 0), (0, 1, 0))
    joints = {"slot": slot, "one": cj.RevoluteJoint("ground", "ball", *AXES), "two": across}
    view = cj.view(cj.Scene({"ball": BALL}, joints), cj.State({"ball": cj.body_state(ORIGIN)}))
    assert all(np.isfinite(part.mesh.vertices).all() for part in view.parts)


def test_teeth_mesh_in_the_gaps_of_the_other_gear():
    scene, state = cj.mechanisms.gear_pair()
    view = cj.view(scene, state)
    for name, radius, towards in (("pinion", 0.030, 0.0), ("wheel", 0.075, np.pi)):
        part = part_of(view, name)
        rim = part.mesh.moved(part.pose(0)).vertices - state.bodies[name].position
        size, angle = np.hypot(rim[:, 0], rim[:, 1]), np.arctan2(rim[:, 1], rim[:, 0])
        away = np.where(size > 0.5 * radius, np.abs(np.exp(1j * angle) - np.exp(1j * towards)), 9.0)
        assert (size[np.argmin(away)] > radius) == (name == "wheel")


def test_a_given_mesh_replaces_the_bar(tmp_path):
    scene, state = cj.mechanisms.double_pendulum()
    box = trimesh.creation.box((1.0, 0.1, 0.1))
    box.export(tmp_path / "arm.stl")
    for given in (box, (box.vertices, box.faces), tmp_path / "arm.stl"):
        view = cj.view(scene, state, meshes={"arm 2": given})
        drawn = [p for p in view.parts if p.name == "arm 2" and p.colour == "#0072B2"]
        assert len(drawn) == 1
        assert len(drawn[0].mesh.faces) == 12
        np.testing.assert_allclose(np.ptp(drawn[0].mesh.vertices, axis=0), (1.0, 0.1, 0.1))


WRONG = {
    "unknown body": ({"meshes": {"leg": "leg.stl"}}, "meshes.*names of bodies.*leg"),
    "no file": ({"meshes": {"arm 2": "none.stl"}}, "meshes.*an existing file"),
    "millimetres": ({"meshes": {"arm 2": (1e6 * np.eye(3), [[0, 1, 2]])}}, "apply_scale"),
    "faces": ({"meshes": {"arm 2": (np.eye(3), [[0, 1, 3]])}}, "faces.*from 0 to 2.*but is 3:"),
    "negative face": ({"meshes": {"arm 2": (np.eye(3), [[0, 1, -7]])}}, "faces.*but is -7:"),
    "half a face": ({"meshes": {"arm 2": (np.eye(3), [[0, 1, 0.5]])}}, "whole.*but is 0.5:"),
    "frames": ({"frames": 0}, "frames"),
    "clearance": ({"clearance_scale": 1e4}, "clearance_scale.*at most"),
    "negative": ({"bearing_scale": -1.0}, "bearing_scale"),
    "force": ({"force_scale": 0.0}, "force_scale"),
}


@pytest.mark.parametrize("options, message", WRONG.values(), ids=WRONG)
def test_invalid_arguments_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        cj.view(*cj.mechanisms.double_pendulum(), **options)


def rigid_run(saved):
    """The result of a run with rigid contacts, which has a number of steps instead of states."""
    return cj.results.NonsmoothSolution(
        time=np.asarray(0.02),
        final=recorded.motion().states,
        result=cj.RESULTS.successful,
        steps=np.asarray(200),
        saved=saved,
        history=None,
        saved_count=None,
        contacts={},
        residual=np.asarray(0.0),
        formulation=Formulation(cj.AbsoluteCoordinates()),
        redundant_constraints=(),
    )


MOTION, SEEN = recorded.motion(), recorded.observed()
PLACE = cj.State({"arm": cj.body_state((0.2, 0.0, 0.0))})
UNFIT = {
    "a text": ("solution", None, "motion.*a state or a solution"),
    "other bodies": (cj.mechanisms.double_pendulum()[1], None, "motion.*scene's bodies"),
    "one state": (cj.results.Trajectory(MOTION.times, PLACE), None, "one row for each time"),
    "nothing saved": (rigid_run(None), None, r"saved states.*simulate_nonsmooth\(\)"),
    "fewer times": (jax.tree.map(lambda rows: rows[::2], MOTION), SEEN, "observation"),
    "other times": (
        MOTION,
        dataclasses.replace(SEEN, times=SEEN.times + 0.1),
        "`observation` must be of the motion's",
    ),
    "seen at a state": (PLACE, SEEN, "`observation` must be None for a single state"),
    "seen at no state": (None, SEEN, "`observation` must be None for a single state"),
}


@pytest.mark.parametrize("motion, observation, message", UNFIT.values(), ids=UNFIT)
def test_motions_and_observations_that_do_not_fit_are_refused(motion, observation, message):
    with pytest.raises(ValueError, match=message):
        cj.view(recorded.arm_in_bearing(), motion, observation=observation)


def test_pictures_and_animations_are_written(seen, tmp_path):
    picture = np.asarray(Image.open(seen.save(tmp_path / "arm.png", time=0.015)).convert("RGB"))
    assert (picture < 200).any(axis=2).mean() > 0.01
    few = cj.view(recorded.arm_in_bearing(), recorded.motion(), forces=False, frames=3)
    assert Image.open(few.save(tmp_path / "arm.gif")).n_frames == 3


def test_files_that_cannot_be_written_are_refused(seen, tmp_path, monkeypatch):
    with pytest.raises(ValueError, match="file.*one of"):
        seen.save(tmp_path / "arm.step")
    with pytest.raises(ValueError, match="`time` must be finite, but is nan"):
        seen.save(tmp_path / "arm.png", time=np.nan)
    with pytest.raises(ValueError, match="`scene` must be a Scene, but is 'NoneType'"):
        cj.view(None)
    standing = cj.view(*cj.mechanisms.double_pendulum())
    with pytest.raises(ValueError, match="pass a solution"):
        standing.save(tmp_path / "arm.gif")
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(ValueError, match="ffmpeg.*GIF"):
        seen.save(tmp_path / "arm.mp4")


def test_missing_packages_are_named_with_their_extra(seen, monkeypatch):
    monkeypatch.setitem(sys.modules, "k3d", None)
    again = cj.view(recorded.arm_in_bearing(), recorded.motion(), forces=False)
    with pytest.raises(ImportError, match=r"clearjoint\[view\]"):
        again._repr_html_()
