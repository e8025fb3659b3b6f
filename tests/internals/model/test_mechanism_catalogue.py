"""First states of mechanisms satisfy the rows of all joints, and touch nothing."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import clearjoint as cj
from clearjoint._dynamics.journals import contact_depths
from clearjoint._model.joints.constraint_rows import row_rate
from clearjoint._model.mechanisms.four_bars import LENGTHS, MASSES, PINS
from clearjoint.extend import unpack
from clearjoint.testing import moving
from tests.model.test_mechanism_catalogue import squeezed, turn
from tests.support.andrews_equations import START


def violation(scene, state):
    """Of all ideal joints: the largest value of a row, and the largest rate of one."""
    motions = {
        name: moving(body.position, body.orientation, body.velocity, body.spin)
        for name, body in state.bodies.items()
    }
    motions["ground"] = moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    rows = [
        row
        for joint in scene.joints.values()
        if isinstance(joint, cj.extend.AbstractConstraint)
        for row in unpack(joint).rows(motions, 0.0).values()
    ]
    rates = [abs(float(row_rate(row, motions))) for row in rows]
    return max(abs(float(row.value)) for row in rows), max(rates)


def test_the_squeezer_starts_closed():
    scene, state = cj.mechanisms.andrews_squeezer()
    np.testing.assert_allclose(squeezed(state.bodies), START, atol=1e-15)
    value, rate = violation(scene, state)
    assert value < 1e-16 and rate == 0.0


def freudenstein(crank, lengths=LENGTHS):
    """Angle of the rocker by R1 cos(rocker) - R2 cos(crank) + R3 = cos(crank - rocker)
    (F. Freudenstein 1954), above the feet."""
    a, b, c, d = lengths
    r1, r2, r3 = d / a, d / c, (a * a - b * b + c * c + d * d) / (2.0 * a * c)

    def equation(rocker):
        return r1 * math.cos(rocker) - r2 * math.cos(crank) + r3 - math.cos(crank - rocker)

    rocker = np.linspace(0.0, math.pi, 181)
    at = [equation(one) for one in rocker]
    signs = [k for k in range(180) if at[k] * at[k + 1] <= 0.0]
    return brentq(equation, rocker[signs[-1]], rocker[signs[-1] + 1], xtol=1e-15)


@pytest.mark.parametrize("angle", [0.9, 2.5, -1.2])
def test_the_four_bar_starts_on_freudensteins_equation(angle):
    speed, step = 8.0, 1e-5
    scene, state = cj.mechanisms.four_bar(angle=angle, speed=speed)
    assert turn(state.bodies["rocker"]) == pytest.approx(freudenstein(angle), abs=1e-12)
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
    report = cj.constraint_report(scene, state)
    assert not report.redundant
    if set(pins) != set(PINS):
        assert np.abs(report.values).max() < 1e-15 and np.abs(report.rates).max() < 1e-14


def reduced_four_bar(angle, speed):
    """Kinetic energy at a crank speed, and potential energy, by Freudenstein's equation."""
    step, lengths = 1e-4, np.array(LENGTHS)

    def centres(crank):
        tip = lengths[0] * np.array([math.cos(crank), math.sin(crank)])
        rocker = freudenstein(crank)
        foot = np.array([lengths[3], 0.0])
        pin = foot + lengths[2] * np.array([math.cos(rocker), math.sin(rocker)])
        coupler = math.atan2(*(pin - tip)[::-1])
        places = 0.5 * tip, 0.5 * (tip + pin), 0.5 * (foot + pin)
        return np.array(
            [
                [*place, turned]
                for place, turned in zip(places, (crank, coupler, rocker), strict=True)
            ]
        )

    at = [centres(angle + k * step) for k in (-2, -1, 1, 2)]
    slope = (at[0] - 8 * at[1] + 8 * at[2] - at[3]) / (12 * step)
    masses = np.array(MASSES)
    inertia = masses * lengths[:3] ** 2 / 12
    reduced = masses @ (slope[:, :2] ** 2).sum(1) + inertia @ slope[:, 2] ** 2
    return 0.5 * reduced * speed**2, 9.81 * masses @ centres(angle)[:, 1]


@pytest.mark.slow
def test_the_four_bar_falls_as_its_reduced_equation():
    """One degree of freedom: time = integral of the crank's angle over its speed, which the energy
    gives (an independent quadrature)."""
    begin, end, speed = 0.9, 0.0, -12.0
    scene, state = cj.mechanisms.four_bar(angle=begin, speed=speed)
    energy = sum(reduced_four_bar(begin, speed))

    def slowness(angle, t):
        reduced, potential = reduced_four_bar(angle, 1.0)
        return [-math.sqrt(reduced / (energy - potential))]

    path = solve_ivp(slowness, (begin, end), [0.0], "DOP853", rtol=1e-11, atol=1e-13)
    duration = path.y[0, -1]
    settings = cj.Settings(rtol=1e-11, atol=1e-11, stabilisation=cj.Projection())
    final = cj.simulate(scene, state, duration, settings).final
    assert turn(final.bodies["crank"]) == pytest.approx(end, abs=1e-8)
    assert turn(final.bodies["rocker"]) == pytest.approx(freudenstein(end), abs=1e-8)


@pytest.mark.slow
def test_clearance_moves_the_four_bar_by_a_similar_distance():
    """With play of 20 um in both feet and friction the driven linkage stays near the ideal one."""
    drive = cj.PrescribedRotation("ground", "crank", (0, 0, 1), 20.0, initial_angle=0.9)
    play = {"crank foot": 2e-5, "rocker foot": 2e-5}
    scene, state = cj.mechanisms.four_bar(
        play, speed=20.0, motor=drive, friction=cj.frictions.RegularisedCoulomb(0.1)
    )
    solution = cj.simulate(scene, state, 0.05, save=cj.Saving(np.linspace(0.0, 0.05, 26)))
    expected = [freudenstein(0.9 + 20.0 * t) for t in np.linspace(0.0, 0.05, 26)]
    off = np.abs(turn(solution.states.bodies["rocker"]) - expected).max()
    assert 1e-6 < off < 1e-3


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
    ideal, state = mechanism(None)
    value, rate = violation(ideal, state)
    assert value < 1e-14 and rate < 1e-13
    scene, start = mechanism(PLAY)
    value, rate = violation(scene, start)
    assert value < 1e-14 and rate < 1e-13
    for name in ideal.bodies:
        for part in ("position", "velocity", "orientation", "spin"):
            same = getattr(start.bodies[name], part), getattr(state.bodies[name], part)
            np.testing.assert_array_equal(*same)
    for family in contact_depths(scene, start.bodies).values():
        assert max(map(float, family.values())) == pytest.approx(-distance, rel=1e-9)


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
    (flanks,) = contact_depths(scene, state.bodies).values()
    half = 0.5 * PLAY * np.cos(np.radians(20.0))
    np.testing.assert_allclose([float(d) for d in flanks.values()], -half, rtol=1e-9)
    assert violation(scene, state) == (0.0, 0.0)
    radii = 0.5 * 3e-3 * np.array([20, 50])
    np.testing.assert_allclose(state.bodies["wheel"].position, (radii.sum(), 0, 0), rtol=1e-15)
    for body, radius in zip(scene.bodies.values(), radii, strict=True):
        disc = cj.Body.cylinder(2.0 * radius, 20e-3, density=7850.0)
        assert float(body.mass) == pytest.approx(float(disc.mass), rel=1e-14)
        np.testing.assert_allclose(body.inertia, disc.inertia, rtol=1e-14)
