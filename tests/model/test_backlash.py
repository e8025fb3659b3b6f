"""Backlash about an axis and between gears: geometry against closed forms, and errors."""

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest

import clearjoint as cj
from clearjoint.extend import AbstractContactJoint, Motion, Vector, unpack
from clearjoint.testing import check_constraint, check_contact_joint, moving
from tests.support import many_states
from tests.support.motions import AT_REST

LAW, STEEL = cj.laws.HuntCrossley(0.5, 1e8), cj.laws.RavnStiffness(2e11, 0.3)
MODULE, PLAY, ALPHA = 3e-3, 1e-4, math.radians(20.0)
MOTIONS = {
    "a": moving((0.1, 0.2, 0.3), (1.0, 0.3, 0.2, 0.3), (1.0, 2.0, 3.0), (0.3, 0.2, 5.0)),
    "b": moving((0.0, 0.2, 0.1), (0.4, 0.2, -0.2, 0.7), (1.0, 0.0, 3.0), (-0.3, 0.2, 3.0)),
}


def backlash(**options) -> cj.Backlash:
    return cj.Backlash("a", "b", **({"play": 2e-3, "radius": 0.05, "law": LAW} | options))


def gears(teeth_first=18, teeth_second=41, **options) -> cj.GearBacklash:
    centres, axes = ((0.0, 0.01, 0.005), (0.001, 0.0, 0.0)), ((0, 0, 1), (0, 0, 1))
    teeth = teeth_first, teeth_second
    return cj.GearBacklash("a", "b", *centres, *axes, *teeth, MODULE, PLAY, LAW, **options)


def spinning(angle: float, spin: float, velocity=(0.0, 0.0, 0.0)) -> Motion:
    """At the origin, turned about z."""
    turn = math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)
    return moving((0.0, 0.0, 0.0), turn, velocity, (0.0, 0.0, spin))


def meshing(joint: cj.GearBacklash, wider=0.0, angles=(1.1, -2.3)) -> dict[str, Motion]:
    """Gears with parallel axes that turn and move, so much farther apart than their distance."""
    teeth = float(joint.teeth_first + joint.teeth_second)
    apart = 0.5 * MODULE * abs(teeth) + wider
    bodies = [spinning(angles[0], 5.0, (1, 2, 3)), spinning(angles[1], -3.0, (-1, 0.5, 2))]
    away = Vector(apart * math.cos(0.7), apart * math.sin(0.7), 0.01)
    away = bodies[0].point(Vector(*joint.point_first)) + away
    away = away - bodies[1].direction(Vector(*joint.point_second))
    second = Motion(away, bodies[1].rotation, bodies[1].velocity, bodies[1].spin)
    return {"a": bodies[0], "b": second}


def depths(joint: AbstractContactJoint, motions: dict[str, Motion]) -> np.ndarray:
    """Penetrations of the lower and the upper flank, m."""
    contacts = unpack(joint).contacts(motions)
    return np.array([float(contact.gap.depth) for contact in contacts.values()])


def test_a_contact_whose_force_does_other_work_than_its_gap_is_refused():
    class Doubled(cj.Backlash):
        def contacts(self, motions):
            return {
                label: replace(contact, turning=tuple(2.0 * part for part in contact.turning))
                for label, contact in super().contacts(motions).items()
            }

    with pytest.raises(AssertionError, match="power of the couples"):
        check_contact_joint(Doubled("a", "b", play=2e-3, radius=0.05, law=LAW), MOTIONS)


def test_backlash_acts_by_couples_only():
    joint, turn = backlash(), cj.rotation((0, 0, 1), 3e-3)
    scene = cj.Scene({name: cj.Body(1.0, (1.0, 1.0, 1.0)) for name in "ab"}, {"play": joint})
    still, places = np.zeros((1, 3)), {"a": np.array([1.0, 0.0, 0.0, 0.0]), "b": turn}
    bodies = {
        name: cj.BodyState(still, euler[None], still, still) for name, euler in places.items()
    }
    loads = many_states.loads(scene, cj.State(bodies))
    moment = 0.05 * float(LAW.elastic_force(cj.extend.Gap(0.05 * (3e-3 - 1e-3), 0.0)))
    for name, sign in (("a", 1.0), ("b", -1.0)):
        np.testing.assert_allclose(loads[name], [[0, 0, 0, 0, 0, sign * moment]], rtol=1e-9)


def test_a_play_length_is_the_angle_at_the_radius():
    assert float(backlash(play=None, play_length=1e-4).play) == pytest.approx(2e-3, rel=1e-15)


@pytest.mark.parametrize("turns", [0, 1, -7])
def test_angles_are_taken_modulo_a_revolution_from_the_middle_of_the_play(turns):
    joint = backlash(middle=math.pi - 1e-4)
    for beyond, expected in ((0.0, (-5e-5, -5e-5)), (2e-3, (-1.5e-4, 5e-5))):
        angle = math.pi - 1e-4 + beyond + math.tau * turns
        motions = {"a": spinning(0.3, 0.0), "b": spinning(0.3 + angle, 0.0)}
        assert depths(joint, motions) == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("teeth_second", [41, -57])
def test_gears_mesh_alike_after_any_number_of_teeth(teeth_second):
    joint = gears(18, teeth_second)
    start = depths(joint, meshing(joint))
    pitch = math.tau / 18, math.tau / teeth_second
    for first, second in ((1, 0), (0, 1), (7, -7), (1800, 41 * 11), (5, 3)):
        angles = 1.1 + first * pitch[0], -2.3 + second * pitch[1]
        assert depths(joint, meshing(joint, angles=angles)) == pytest.approx(start, abs=1e-13)
    rolled = meshing(joint, angles=(1.1 + 0.01, -2.3 - 0.01 * 18 / teeth_second))
    assert depths(joint, rolled) == pytest.approx(start, abs=1e-15)


@pytest.mark.parametrize("wider", [-5e-4, 0.0, 1e-4, 1e-3])
@pytest.mark.parametrize("teeth_second", [41, -57])
def test_gear_backlash_changes_with_the_centre_distance(wider, teeth_second):
    """The play on the working pitch circles is the pitch less both teeth, whose thickness on a
    circle of radius y is y (s/r + 2 (inv(alpha) - inv(alpha_y))) (ISO 21771); of an internal gear
    it is the space that is filled, in the other sense."""
    joint = gears(18, teeth_second)
    distance = 0.5 * MODULE * abs(18 + teeth_second)
    working = math.acos(distance * math.cos(ALPHA) / (distance + wider))
    involutes = math.tan(ALPHA) - ALPHA - math.tan(working) + working
    stretched = math.cos(ALPHA) / math.cos(working)
    thicknesses = 0.0
    for teeth in (18, teeth_second):
        radius, thickness = 0.5 * MODULE * abs(teeth), 0.5 * (math.pi * MODULE - PLAY)
        narrower = 2.0 * involutes * math.copysign(1.0, teeth)
        thicknesses += radius * stretched * (thickness / radius + narrower)
    expected = math.pi * MODULE * stretched - thicknesses
    found = -depths(joint, meshing(joint, wider)).sum() / math.cos(working)
    assert found == pytest.approx(expected, rel=1e-9)
    if abs(wider) <= 1e-4:
        sense = math.copysign(2.0, teeth_second)
        assert found == pytest.approx(PLAY + sense * wider * math.tan(ALPHA), rel=2e-2)


@pytest.mark.parametrize("teeth_second", [41, -57])
def test_a_run_ends_where_half_a_tooth_is_penetrated(teeth_second):
    """Tooth and space of the pitch pi m differ by the backlash; along the line of action, both are
    shorter by cos(alpha)."""
    tooth = 0.5 * (math.pi * MODULE - PLAY) * math.cos(ALPHA)
    deepest = [float(limit) for limit in gears(18, teeth_second).deepest().values()]
    assert deepest == pytest.approx([0.5 * tooth] * 2, rel=1e-14)


@pytest.mark.slow
def test_centred_joints_conform_and_hold_the_middle():
    play = backlash(middle=0.4)
    check_constraint(play.centred_joint(), MOTIONS)
    joint = gears(18, -57, phase=0.3)
    check_constraint(joint.centred_joint(), meshing(joint))
    row = unpack(joint).centred_joint().rows(meshing(joint), 0.0)["mesh"]
    lower, upper = depths(joint, meshing(joint))
    assert float(row.value) == pytest.approx(0.5 * (upper - lower), rel=1e-12)


def test_the_centred_backlash_is_zero_in_the_middle():
    for angle, middle in ((0.4, 0.4), (0.4, 0.1), (-3.0, 3.0)):
        motions = {"a": AT_REST, "b": spinning(angle, 0.0)}
        row = unpack(backlash(middle=middle)).centred_joint().rows(motions, 0.0)["angle"]
        wanted = math.remainder(angle - middle, 2.0 * math.pi)
        assert float(row.value) == pytest.approx(wanted, abs=1e-12)


def test_gears_on_axes_that_point_against_each_other_turn_in_the_same_ratio():
    flipped = replace(gears(), axis_second=np.array([0.0, 0.0, -1.0]))
    before, after = (meshing(flipped, angles=(x, 0.4 - x * 18 / 41)) for x in (0.2, 0.9))
    assert depths(flipped, after) == pytest.approx(depths(flipped, before), abs=1e-15)


def stiff(**options) -> cj.Backlash:
    return cj.Backlash("ground", "link", **({"play": 1e-3} | options))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: backlash(play_length=1e-4), "`play`"),
        (lambda: backlash(play=None), "`play`"),
        (lambda: cj.Backlash("a", "b", play_length=1e-4, torsional_stiffness=2e4), "`radius` must"),
        (lambda: backlash(play=-1e-3), "`play`"),
        (lambda: backlash(play=7.0), "smaller than a full revolution"),
        (lambda: backlash(radius=0.0), "`radius`"),
        (lambda: backlash(axis_first=(0, 0, 0)), "`axis_first`"),
        (lambda: backlash(law=cj.laws.Hertz(STEEL)), "explicit stiffness"),
        (lambda: backlash(law=1e8), "AbstractContactLaw"),
        (lambda: cj.Backlash("a", "a", play=1e-3, radius=0.1, law=LAW), "another body"),
        (lambda: gears(17.5), "`teeth_first`"),
        (lambda: gears(18, -18), "internal"),
        (lambda: gears(-18, 41), "internal"),
        (lambda: gears(pressure_angle=20.0), "`pressure_angle`"),
        (lambda: gears(law=None), "law"),
        (lambda: replace(gears(), backlash=1e-2), "smaller than the pitch"),
        (lambda: stiff(), "torsional_stiffness"),
        (lambda: stiff(law=LAW, radius=0.1, torsional_stiffness=2e4), "torsional_stiffness"),
        (lambda: stiff(law=LAW), "`radius`"),
        *(
            (lambda radius=radius, options=options: stiff(radius=radius, **options), "`radius`")
            for radius in (0.0, -0.1, np.nan)
            for options in (
                {"torsional_stiffness": 2e4},
                {"play": None, "play_length": 1e-4, "law": LAW},
            )
        ),
    ],
)
@pytest.mark.filterwarnings("ignore::clearjoint.UnusualValueWarning")
def test_invalid_backlash_is_refused(wrong, said):
    with pytest.raises((ValueError, TypeError), match=said):
        wrong()


def test_a_soft_gearbox_gives_no_warning_of_a_stiffness_that_the_user_has_not_given():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cj.Backlash("a", "b", play=1e-3, torsional_stiffness=5.0)


def test_gears_closer_than_their_base_circles_are_refused():
    """The base radii add up to 83.2 mm, the pitch radii to 88.5 mm."""
    joint = gears()
    contacts = unpack(joint).contacts(meshing(joint, wider=-8e-3))
    assert all(contacts[label].gap.depth > limit for label, limit in joint.deepest().items())
    bodies = {name: cj.Body(1.0, (1e-3, 1e-3, 1e-3)) for name in ("a", "b")}
    states = {"a": cj.body_state((0, 0, 0)), "b": cj.body_state((0.08, 0.01, 0.005))}
    with pytest.raises(ValueError, match="but is inf"):
        cj.simulate(cj.Scene(bodies, {"mesh": joint}), cj.State(states), 1e-3)
