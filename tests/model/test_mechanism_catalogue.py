"""Mechanisms with their first states, against published values and independent equations."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import clearjoint as cj
from tests.support.observations import observed, penetrations
from tests.support.shaft import angle_about


def squeezed(bodies):
    """The seven angles of the literature."""
    own = np.array([angle_about(bodies[f"K{k}"]) for k in range(1, 8)])
    return own - [0, own[0], 0, own[4], 0, own[6], 0]


START = (
    -0.0617138900142764496358948458001,
    0.0,
    0.455279819163070380255912382449,
    0.222668390165885884674473185609,
    0.487364979543842550225598953530,
    -0.222668390165885884674473185609,
    1.23054744454982119249735015568,
)
"""The same angles at the start, rad (E. Hairer, G. Wanner, Solving Ordinary Differential Equations
II, section VII.7)."""


def violation(scene, state):
    """The largest value of a constraint, and the largest rate of one."""
    report = cj.constraint_report(scene, state)
    return np.abs(report.values).max(), np.abs(report.rates).max()


def test_the_squeezer_starts_closed():
    scene, state = cj.mechanisms.andrews_squeezer()
    np.testing.assert_allclose(squeezed(state.bodies), START, rtol=0.0, atol=1e-15)
    value, rate = violation(scene, state)
    assert value < 1e-16 and rate == 0.0


LENGTHS = 0.1, 0.3, 0.25, 0.3
"""Of the four-bar, m."""
PINS = {
    "crank foot": ("ground", "crank"),
    "crank pin": ("crank", "coupler"),
    "rocker pin": ("coupler", "rocker"),
    "rocker foot": ("ground", "rocker"),
}


def freudenstein(crank, lengths=LENGTHS):
    """Angle of the rocker by R1 cos(rocker) - R2 cos(crank) + R3 = cos(crank - rocker)
    (F. Freudenstein 1954), above the feet."""
    a, b, c, d = lengths
    r1, r2, r3 = d / a, d / c, (a * a - b * b + c * c + d * d) / (2.0 * a * c)

    def equation(rocker):
        return r1 * math.cos(rocker) - r2 * math.cos(crank) + r3 - math.cos(crank - rocker)

    rocker = np.linspace(0.0, math.pi, 181)
    signs = np.sign([equation(angle) for angle in rocker])
    k = np.flatnonzero(signs[:-1] * signs[1:] <= 0.0)[-1]
    return brentq(equation, rocker[k], rocker[k + 1], xtol=1e-15)


@pytest.mark.parametrize("angle", [0.9, 2.5, -1.2])
def test_the_four_bar_starts_on_freudensteins_equation(angle):
    speed, step = 8.0, 1e-5
    scene, state = cj.mechanisms.four_bar(angle=angle, speed=speed)
    assert angle_about(state.bodies["rocker"]) == pytest.approx(freudenstein(angle), abs=1e-12)
    around = freudenstein(angle + step) - freudenstein(angle - step)
    assert state.bodies["rocker"].spin[2] == pytest.approx(speed * around / (2 * step), rel=1e-7)
    value, rate = violation(scene, state)
    assert value < 1e-15 and rate < 1e-14
    assert cj.constraint_report(scene, state).degrees_of_freedom() == 1


@pytest.mark.parametrize("pins", [["crank foot"], ["crank pin", "rocker foot"], list(PINS)])
def test_any_pins_of_the_four_bar_may_have_clearance(pins):
    scene, state = cj.mechanisms.four_bar(dict.fromkeys(pins, 1e-4), speed=3.0)
    assert set(scene.contact_joints()) == set(pins)
    for pin, joint in scene.joints.items():
        assert joint.body_names() == PINS[pin]
    assert not cj.constraint_report(scene, state).redundant
    if set(pins) != set(PINS):
        value, rate = violation(scene, state)
        assert value < 1e-15 and rate < 1e-14


PLAY = 1e-4


STARTS = {
    "double pendulum": (cj.mechanisms.double_pendulum, PLAY),
    "slider-crank": (lambda play: cj.mechanisms.slider_crank(play, angle=0.7, speed=30.0), PLAY),
    "guided": (lambda play: cj.mechanisms.guided_slider_crank(play, speed=20.0), PLAY),
    "guided, pin": (lambda play: cj.mechanisms.guided_slider_crank(None, play, speed=20.0), PLAY),
    "quick return": (lambda play: cj.mechanisms.quick_return(play, angle=0.3), PLAY / 2),
    "spatial four-bar": (lambda play: cj.mechanisms.spatial_four_bar(play, speed=40.0), PLAY),
    "robot arm": (
        lambda play: cj.mechanisms.robot_arm(play, angles=(0.3, -0.2, 0.5), speeds=(2, -1, 3)),
        0.05 * PLAY / 2,
    ),
}
"""Mechanisms by their play, ``None`` for none, and the distance from the middle to the wall, m."""


@pytest.mark.parametrize(("mechanism", "distance"), STARTS.values(), ids=STARTS)
def test_mechanisms_start_in_the_motion_of_the_ideal_one_with_centred_journals(mechanism, distance):
    (ideal, state), (scene, start) = mechanism(None), mechanism(PLAY)
    for made in ((ideal, state), (scene, start)):
        value, rate = violation(*made)
        assert value < 1e-14 and rate < 1e-13
    for name in ideal.bodies:
        for part in ("position", "velocity", "orientation", "spin"):
            same = getattr(start.bodies[name], part), getattr(state.bodies[name], part)
            np.testing.assert_array_equal(*same)
    for family in penetrations(scene, start).values():
        assert max(family.values()) == pytest.approx(-distance, rel=1e-9)


@pytest.mark.parametrize(("name", "redundant"), [("bricard", 1), ("double_four_bar", 6)])
def test_benchmarks_start_closed_with_one_degree_of_freedom(name, redundant):
    scene, state = getattr(cj.mechanisms, name)()
    value, rate = violation(scene, state)
    assert value < 1e-15 and rate < 1e-15
    report = cj.constraint_report(scene, state)
    assert len(report.redundant) == redundant and report.degrees_of_freedom() == 1
    if name == "double_four_bar":
        tips = [state.bodies[f"rod {k}"] for k in (2, 4)]
        np.testing.assert_array_equal([tip.velocity for tip in tips], [(1.0, 0.0, 0.0)] * 2)


def test_gears_start_in_the_middle_of_the_play():
    """Half the backlash along the pitch circle, along the line of action at 20 degrees."""
    scene, state = cj.mechanisms.gear_pair(PLAY, speeds=(3.0, 4.0))
    (flanks,) = penetrations(scene, state).values()
    half = 0.5 * PLAY * np.cos(np.radians(20.0))
    np.testing.assert_allclose([*flanks.values()], -half, rtol=1e-9)
    assert violation(scene, state) == (0.0, 0.0)
    radii = 0.5 * 3e-3 * np.array([20, 50])
    np.testing.assert_allclose(state.bodies["wheel"].position, (radii.sum(), 0, 0), rtol=1e-15)
    for body, radius in zip(scene.bodies.values(), radii, strict=True):
        disc = cj.Body.cylinder(2.0 * radius, 20e-3, density=7850.0)
        assert float(body.mass) == pytest.approx(float(disc.mass), rel=1e-14)
        np.testing.assert_allclose(body.inertia, disc.inertia, rtol=1e-14)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"clearance": {"crank": 1e-4}}, "`clearance`.*'crank foot'.*is 'crank'"),
        ({"lengths": (0.1, 0.05, 0.05, 0.3)}, "`lengths`.*rods that span.*another angle"),
        ({"lengths": (0.1, 0.3, 0.25, 0.1), "angle": 0.0}, "`lengths`.*rods that span the 0 m"),
    ],
)
def test_an_impossible_four_bar_is_refused(arguments, complaint):
    with pytest.raises(ValueError, match=complaint):
        cj.mechanisms.four_bar(**arguments)


RODS = {
    "four_bar": {"crank": 0.1, "coupler": 0.3, "rocker": 0.25},
    "quick_return": {"crank": 0.05, "lever": 0.25},
    "double_four_bar": {f"rod {k}": 1.0 for k in range(1, 6)},
}


@pytest.mark.parametrize("name", RODS)
def test_rods_are_slender(name):
    scene, _ = getattr(cj.mechanisms, name)()
    for rod, length in RODS[name].items():
        body = scene.bodies[rod]
        across = float(body.mass) * length**2 / 12.0
        np.testing.assert_allclose(body.inertia[1:], across, rtol=1e-14)


def test_bars_of_the_spatial_four_bar_are_cylinders():
    bodies = cj.mechanisms.spatial_four_bar()[0].bodies
    bars = {"crank": (0.02, 0.1960, "y"), "coupler": (0.122, 1.4158, "x")}
    for name, (length, mass, axis) in (bars | {"rocker": (0.074, 0.3157, "y")}).items():
        bar = cj.Body.cylinder(20e-3, length, mass=mass, axis=axis)
        assert float(bodies[name].mass) == mass
        np.testing.assert_allclose(bodies[name].inertia, bar.inertia, rtol=1e-14)


def test_gravity_loads_the_robot_s_nominal_pose_as_published():
    """Moments of the motors that hold it, N m (P. Corke, Robotics, Vision and Control, the
    toolbox's `gravload(qn)`)."""
    reactions = observed(*cj.mechanisms.robot_arm(None)).reactions
    moments = [reactions[f"motor {k}"][f"link {k}"].moment[0] for k in (1, 2, 3)]
    np.testing.assert_allclose(np.linalg.norm(moments, axis=1), [0.0, 31.6399, 6.0351], atol=1e-4)


@pytest.mark.parametrize(
    ("options", "pins"), [({}, 6), ({"pins": 4, "lobes": 7, "angle": 0.4, "speed": -20.0}, 4)]
)
def test_a_cycloid_stage_starts_with_its_play_around_all_pins(options, pins):
    """The disc's centre turns with the shaft, and the disc backwards by a lobe in a turn."""
    play, eccentricity, z = 2e-5, 1e-3, (0.0, 0.0, 1.0)
    scene, state = cj.mechanisms.cycloid_stage(play, **options)
    assert [name for name in scene.joints if name.startswith("pin")] == [
        f"pin {k}" for k in range(1, pins + 1)
    ]
    angle, speed = options.get("angle", 0.0), options.get("speed", 10.0)
    ratio = -1.0 / options.get("lobes", 10)
    for name, share in (("shaft", 1.0), ("disc", ratio), ("output", ratio)):
        body = state.bodies[name]
        np.testing.assert_allclose(
            body.orientation, cj.rotation(z, share * angle), rtol=0.0, atol=1e-15
        )
        np.testing.assert_allclose(body.spin, (0.0, 0.0, share * speed), rtol=1e-15)
    disc = state.bodies["disc"]
    outwards = np.array([np.cos(angle), np.sin(angle), 0.0])
    np.testing.assert_allclose(disc.position, eccentricity * outwards, rtol=1e-15)
    np.testing.assert_allclose(
        disc.velocity, np.cross(z, outwards) * eccentricity * speed, rtol=1e-15
    )
    axes = Rotation.from_quat(disc.orientation, scalar_first=True)
    for k in range(pins):
        joint = scene.joints[f"pin {k + 1}"]
        hole = disc.position + axes.apply(joint.bearing_point)
        distance = np.linalg.norm(axes.apply(joint.journal_point) - hole)
        assert float(joint.clearance) - distance == pytest.approx(play, rel=1e-10)


def first_contact(shaft: float, play: float, sense: float) -> float:
    """Angle of the output from the disc, rad, at which one of six pins reaches the wall of its
    hole: the distance of their centres is the eccentricity plus the play."""
    eccentricity, radius, disc = 1e-3, 25e-3, -shaft / 10
    found = []
    for around in disc + 2.0 * np.pi * np.arange(6) / 6:

        def distance(turn: float, around=around) -> float:
            pin = radius * np.exp(1j * (around + turn))
            hole = radius * np.exp(1j * around) + eccentricity * np.exp(1j * shaft)
            return abs(pin - hole) - eccentricity - play

        if distance(sense * 0.01) > 0.0:
            found.append(brentq(distance, 0.0, sense * 0.01, xtol=1e-16))
    return min(found, key=abs)


@pytest.mark.slow
def test_a_cycloid_stage_transmits_with_the_ratio_of_its_lobes():
    """The torque keeps the output ahead of the disc by the backlash, at every angle of the
    shaft, and the disc rotates backwards by a tenth of it."""
    play, speed = 0.02e-3, 20.0
    scene, state = cj.mechanisms.cycloid_stage(play, speed=speed, torque=0.1)
    times = np.linspace(0.04, 0.1, 31)
    bodies = cj.simulate(
        scene, state, 0.1, cj.Settings(rtol=1e-10, atol=1e-12), cj.Saving(times), progress=False
    ).states.bodies
    disc = angle_about(bodies["disc"])
    np.testing.assert_allclose(disc, -speed * times / 10, rtol=0.0, atol=1e-9)
    ahead = angle_about(bodies["output"]) - disc
    expected = [first_contact(speed * t, play, 1.0) for t in times]
    np.testing.assert_allclose(ahead, expected, rtol=1e-2)
    assert np.ptp(expected) > 0.1 * np.mean(expected)
