"""The clearance joint: geometry of the paper, and modes of motion."""

import equinox as eqx
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint.extend import Vector, pack, unpack
from tests.support.many_states import in_scalars
from tests.support.observations import observed

RANDOM = np.random.default_rng(8)
N = 30
BEARING, CLEARANCE, LENGTH = 1.0, 0.2, 0.9
COORDINATES = cj.AbsoluteCoordinates()
POINTS = {name: RANDOM.normal(size=(N, 3)) for name in ("bearing_point", "journal_point")}
AXES = {name: RANDOM.normal(size=(N, 3)) for name in ("bearing_axis", "journal_axis")}
AXES["bearing_axis"][:6] = [*np.eye(3), *-np.eye(3)]
AXES["journal_axis"][3:9] = [*np.eye(3), *-np.eye(3)]
POSITION, VELOCITY, SPIN = RANDOM.normal(size=(3, 2, N, 3))
ROTATION = Rotation.random(2 * N, rng=8)


def vector(rows):
    return Vector(*np.moveaxis(rows, -1, 0))


def random_states():
    """Both bodies in N poses with N twists, all at once."""
    euler = ROTATION.as_quat(scalar_first=True).reshape(2, N, 4)
    parts = zip("ab", POSITION, euler, VELOCITY, SPIN, strict=True)
    return in_scalars(cj.State({name: cj.BodyState(*part) for name, *part in parts}))


MATRICES = ROTATION.as_matrix().reshape(2, N, 3, 3)


def random_scene():
    """Two free bodies and a joint between them; points and axes differ from state to state."""
    sizes = {"bearing_radius": BEARING, "clearance": CLEARANCE, "journal_length": LENGTH}
    joint = cj.ClearanceJoint("a", "b", **sizes, law=cj.laws.LankaraniNikravesh(0.6, 50.0))
    scene = unpack(cj.Scene(dict.fromkeys("ab", cj.Body(1.0, (1.0, 1.0, 1.0))), {"pin": joint}))
    places = [vector(rows) for rows in (*POINTS.values(), *AXES.values())]
    names = [*POINTS, *AXES]
    return eqx.tree_at(lambda s: [getattr(s.joints["pin"], name) for name in names], scene, places)


def turned(body, rows):
    return np.einsum("nij,nj->ni", MATRICES[body], rows)


def dot(a, b):
    return np.sum(a * b, axis=-1)


def unit(rows):
    return rows / np.linalg.norm(rows, axis=-1, keepdims=True)


def paper_geometry(sign):
    """Equations (1)-(21) at base V (sign -1) or W (sign 1) with matrices, misprints corrected.

    The frame's columns are unit vectors (eqs 3 and 4), and eq. (10) takes both components of a base
    from that base. Returns penetration, its rate, normal, and the contact points on i and j.
    """
    z_r = unit(AXES["bearing_axis"])  # (1)
    other = np.where(np.abs(z_r[:, 2:]) > 0.9, [[1.0, 0, 0]], [[0, 0, 1.0]])
    x_r = unit(np.cross(z_r, other))  # (3)
    frame = MATRICES[0] @ np.stack([x_r, np.cross(z_r, x_r), z_r], axis=-1)  # (4) and (5)
    bearing = POSITION[0] + turned(0, POINTS["bearing_point"])  # (6)
    base_local = POINTS["journal_point"] + sign * LENGTH / 2 * unit(AXES["journal_axis"])
    base = POSITION[1] + turned(1, base_local)  # (7)
    s = np.einsum("nji,nj->ni", frame, base - bearing)  # (8) and (9)
    e = s * [1.0, 1.0, 0.0]  # (10)
    n = unit(e)  # (12)
    depth = np.linalg.norm(e, axis=1) - CLEARANCE  # (11) and (13)
    on_bearing = s * [0.0, 0.0, 1.0] + BEARING * n  # (15)
    on_journal = s + (BEARING - CLEARANCE) * n
    points = [bearing + np.einsum("nij,nj->ni", frame, p) for p in (on_bearing, on_journal)]
    velocities = [velocity(k, points[k]) for k in (0, 1)]  # (14), (17) and (19)
    normal = np.einsum("nij,nj->ni", frame, n)
    rate = dot(velocities[1] - velocities[0], normal)  # (20) and (21)
    return depth, rate, normal, *points


def velocity(body, point):
    """Of the material point of a body that is at a global point."""
    return VELOCITY[body] + np.cross(turned(body, SPIN[body]), point - POSITION[body])


def contact_points(scene, motions, contact):
    """Global contact points on the bearing and the journal."""
    first, second = scene.joints["pin"].pair()
    return motions[first].point(contact.arm_first), motions[second].point(contact.arm_second)


@pytest.mark.parametrize(("base", "sign"), [("V", -1.0), ("W", 1.0)])
def test_geometry_is_that_of_the_paper(base, sign):
    scene = random_scene()
    motions = COORDINATES.motions(scene, random_states())
    contact = scene.joints["pin"].contacts(motions)[base]
    gap, points = contact.gap, contact_points(scene, motions, contact)
    found = gap.depth, gap.rate, contact.normal, *points
    for ours, papers in zip(found, paper_geometry(sign), strict=True):
        np.testing.assert_allclose(pack(ours), papers, rtol=1e-11, atol=1e-12)
    assert contact.slip is None
    assert (gap.bearing_radius, gap.journal_radius) == (1.0, 0.8)


def test_journal_offset_is_in_the_frame_of_the_bearing():
    scene = random_scene()
    motions = COORDINATES.motions(scene, random_states())
    centre, *bases = (
        pack(scene.joints["pin"].journal_offset(motions, base)) for base in (None, "V", "W")
    )
    np.testing.assert_allclose(centre, np.mean(bases, axis=0), rtol=1e-12, atol=1e-13)
    for sign, offset in zip((-1.0, 1.0), bases, strict=True):
        depth, *_ = paper_geometry(sign)
        np.testing.assert_allclose(np.hypot(*offset.T[:2]), depth + CLEARANCE, rtol=1e-11)
    along_zeta = 2
    assert (AXES["bearing_axis"][along_zeta] == [0, 0, 1]).all()
    bearing = POSITION[0] + turned(0, POINTS["bearing_point"])
    journal = POSITION[1] + turned(1, POINTS["journal_point"])
    body_axes = np.einsum("nji,nj->ni", MATRICES[0], journal - bearing)
    np.testing.assert_allclose(centre[along_zeta], body_axes[along_zeta], rtol=1e-12)
    z_r = unit(AXES["bearing_axis"])
    np.testing.assert_allclose(centre[:, 2], dot(body_axes, z_r), rtol=1e-9, atol=1e-12)
    with pytest.raises(ValueError, match=r"`base` must be one of \['V', 'W'\], but is 'U'"):
        scene.joints["pin"].journal_offset(motions, "U")


PIN = {"bearing_radius": 10e-3, "clearance": 0.5e-3, "journal_length": 20e-3}
MODE = cj.results.MotionMode


def pin_scene(law, **options):
    """A journal on a body, its axis Z, in a bearing of the ground."""
    joint = cj.ClearanceJoint(cj.GROUND, "journal", **PIN, law=law, **options)
    return cj.Scene({"journal": cj.Body(2.0, (0.1, 0.1, 0.1))}, {"pin": joint})


MODES = {
    "free flight": (0.3, 0.0, MODE.FREE_FLIGHT),
    "V alone": (0.3, -0.3, MODE.ONE_BASE),
    "W alone": (0.3, 0.3, MODE.ONE_BASE),
    "line": (0.6, 0.0, MODE.LINE_CONTACT),
    "opposite sides": (0.0, 0.6, MODE.OPPOSITE_SIDES),
}
"""Shift of the journal's centre and further shift of base W against it along X, mm; the mode."""


def tilted(shift, tilt):
    turn = Rotation.from_rotvec([0.0, np.arcsin(tilt / 10.0), 0.0])
    body = cj.body_state((shift * 1e-3, 0, 0), turn.as_quat(scalar_first=True))
    return cj.State({"journal": body})


def test_motion_modes_and_eccentricities_of_constructed_states():
    states = [tilted(shift, tilt) for shift, tilt, _ in MODES.values()]
    found = observed(pin_scene(cj.laws.Hertz(1e9)), *states)
    expected = [mode for _, _, mode in MODES.values()]
    np.testing.assert_array_equal(found.modes["pin"], expected)
    for base, sign in (("V", -1), ("W", 1)):
        e = [1e-3 * abs(shift + sign * tilt) for shift, tilt, _ in MODES.values()]
        contact = found.contacts["pin"][base]
        np.testing.assert_allclose(contact.eccentricity, e, rtol=0.0, atol=1e-15)
        np.testing.assert_allclose(contact.penetration, np.array(e) - 0.5e-3, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
def test_a_load_of_any_size_presses_a_journal_if_a_part_is_across_the_axis(size):
    scene, _ = cj.mechanisms.double_pendulum()
    journal = scene.joints["shoulder"]
    along, across = np.asarray(journal.bearing_axis), np.array([0.6, 0.8, 0.0])
    assert along @ across == 0.0
    assert journal.resting_joint(size * (along + 1e-3 * across)) is not None
    assert journal.resting_joint(size * along) is None
