"""Events of bodies that rotate evenly, or fly freely, without integration errors."""

from functools import cache

import diffrax
import numpy as np
import pytest

import clearjoint as cj
from tests.support.one_body import Z, hinge, one_body
from tests.support.rotating_mechanisms import KINDS, rotating

X = cj.quantities.Position("rotor", "x")
ABSOLUTE = cj.Settings(coordinates=cj.AbsoluteCoordinates())
SHORT = cj.Settings(controller=diffrax.PIDController(rtol=1e-8, atol=1e-12, dtmax=1e-5))
RADIUS, SPEED, TURNS = 0.1, 100.0, 20
DURATION = TURNS * 2.0 * np.pi / SPEED


def impacts(kind: str, seed: int, settings: cj.Settings) -> int:
    scene, state, end_time = rotating(kind, seed)
    solution = cj.simulate(scene, state, end_time, settings, save=cj.Saving(impacts=True))
    assert solution.result == cj.RESULTS.successful
    return len(solution.impacts)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_impacts_in_all_coordinates_and_in_short_steps(kind):
    """25 mechanisms of each kind, 200 in all."""
    total = 0
    for seed in range(25):
        found = [impacts(kind, seed, settings) for settings in (cj.Settings(), ABSOLUTE, SHORT)]
        assert len(set(found)) == 1, f"{kind}, seed {seed}: joint, absolute, short steps {found}"
        total += found[0]
    assert total > 25


def rotor(forces=None, joints=None, **motion) -> tuple[cj.Scene, cj.State]:
    """A body whose centre of mass is `RADIUS` away from its axle, on the x axis."""
    axle = hinge("ground", "rotor", point_second=(-RADIUS, 0, 0))
    body = {"mass": 5.0, "inertia": (0.02,) * 3, "position": (RADIUS, 0.0, 0.0)}
    return one_body("rotor", {"axle": axle, **(joints or {})}, forces, **body, **motion)


def free_rotor() -> tuple[cj.Scene, cj.State]:
    return rotor(velocity=(0.0, RADIUS * SPEED, 0.0), spin=(0.0, 0.0, SPEED))


OUTPUTS = {
    "up": cj.Section(X, {"x": (X, "m")}, count=99),
    "x": cj.Statistics(X, "m"),
    "peak": cj.Peak(X, "m", after=0.1, until=0.11),
}


@cache
def free_run() -> cj.results.Solution:
    return cj.simulate(*free_rotor(), DURATION, outputs=OUTPUTS)


def test_sections_of_a_free_rotor():
    """x = cos(angle) rises through zero at 3/4 of each revolution."""
    times = free_run().outputs["up"].times
    assert times == pytest.approx((np.arange(TURNS) + 0.75) * DURATION / TURNS, abs=1e-12)


def test_statistics_of_a_free_rotor():
    found = free_run().outputs
    assert found["x_mean"] == pytest.approx(0.0, abs=1e-6 * RADIUS)
    assert found["x_rms"] == pytest.approx(RADIUS / np.sqrt(2.0), rel=1e-4)
    extremes = found["x_smallest"], found["x_largest"]
    assert extremes == pytest.approx((-RADIUS, RADIUS), rel=1e-4)
    # From 10 to 11 rad: two quarters after a multiple of pi, the largest value is at the end.
    assert found["peak"] == pytest.approx(RADIUS * np.cos(11.0), rel=1e-6)


def test_only_rotations_that_outputs_depend_on_limit_steps():
    still = cj.Statistics(cj.quantities.Position("rotor", "z"), "m")
    found = cj.simulate(*free_rotor(), DURATION, outputs={"z": still})
    assert found.attempts < 10 < TURNS * 2 * np.pi < free_run().attempts


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_angle_that_jumps_by_a_revolution_does_not_cross_zero(sign):
    angle = cj.quantities.JointAngle("axle")
    motion = {"velocity": (0.0, sign * RADIUS * SPEED, 0.0), "spin": (0.0, 0.0, sign * SPEED)}
    up, each = cj.Section(angle, {"angle": angle}, count=99), cj.Statistics(angle, "rad")
    outputs = {"up": up, "angle": each}
    found = cj.simulate(*rotor(**motion), 0.99 * DURATION, outputs=outputs).outputs
    exact = np.arange(1, TURNS) * DURATION / TURNS if sign > 0 else []
    assert found["up"].times == pytest.approx(exact, abs=1e-12)
    extremes = found["angle_smallest"], found["angle_largest"]
    assert extremes == pytest.approx((-np.pi, np.pi), rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("driven", [False, True])
def test_sections_of_a_rotor_that_starts_from_rest(sign, driven):
    """A torque, or a drive, rotates it by a t^2 / 2."""
    rate = sign * SPEED**2 / 20.0
    forces, joints = {}, {}
    if driven:
        growth = cj.Polynomial((0.0, 0.0, 0.5 * rate))
        joints["drive"] = cj.PrescribedAngle("ground", "rotor", Z, growth)
    else:
        torque = rate * (0.02 + 5.0 * RADIUS**2)
        forces["drive"] = cj.DriveTorque("ground", "rotor", Z, torque)
    times = cj.simulate(*rotor(forces, joints), DURATION, outputs=OUTPUTS).outputs["up"].times
    exact = np.sqrt(2.0 * (np.arange(99) + 0.75) * 2.0 * np.pi / abs(rate))
    assert times == pytest.approx(exact[exact < DURATION], abs=1e-8)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_sections_of_a_flight_without_errors(seed, sign):
    """A ball passes a height twice in one step; in a field that points upwards, it dips below a
    height."""
    generator = np.random.default_rng(seed)
    height, speed, gravity = generator.uniform((-2.0, 8.0, 5.0), (-0.5, 9.0, 10.0))
    motion = {"position": (0, 0, sign * height), "velocity": (0, 0, sign * speed)}
    thrown = one_body("ball", gravity=(0, 0, -sign * gravity), **motion)
    z = cj.quantities.Position("ball", "z")
    outputs = {"up": cj.Section(z, {"z": (z, "m")}, count=9)}
    end_time = generator.uniform(2.0, 4.0) * speed / gravity
    found = cj.simulate(*thrown, end_time, outputs=outputs).outputs["up"]
    first, last = np.sort(np.roots([-0.5 * gravity, speed, height]).real)
    expected = first if sign > 0 else last
    assert found.times == pytest.approx([expected] if expected < end_time else [], abs=1e-12)
