"""The slider-crank: ideal against Newton and Euler by hand, with clearance against its limits."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import clearjoint as cj

CRANK, ROD = 0.05, 0.12
ROD_MASS, ROD_INERTIA, SLIDER_MASS = 0.21, 2.5e-4, 0.14
SPEED = 5000.0 * np.pi / 30.0
REVOLUTION = 2.0 * np.pi / SPEED


def turned(v):
    """A quarter turn of planar vectors, (..., 2)."""
    return np.stack([-v[..., 1], v[..., 0]], axis=-1)


def crossed(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


class Ideal:
    """The planar slider-crank at constant speed, by hand; fields over the crank angles (n,).

    `position`, `velocity`, `acceleration` of the slider along X; `force` (n, 2) on the rod at the
    slider pin; `torque` on the crank. SI units.
    """

    def __init__(self, angle, speed=SPEED):
        tip = CRANK * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        tilt = -np.arcsin(tip[:, 1] / ROD)
        rod = ROD * np.stack([np.cos(tilt), np.sin(tilt)], axis=-1)
        rate = -speed * tip[:, 0] / rod[:, 0]
        growth = (rod[:, 1] * rate**2 + tip[:, 1] * speed**2) / rod[:, 0]
        self.position = (tip + rod)[:, 0]
        self.velocity = (speed * turned(tip) + rate[:, None] * turned(rod))[:, 0]
        tip_acceleration = -(speed**2) * tip
        swing = growth[:, None] * turned(rod) - rate[:, None] ** 2 * rod
        self.acceleration = (tip_acceleration + swing)[:, 0]
        inertial = ROD_MASS * (tip_acceleration + 0.5 * swing)
        along = -SLIDER_MASS * self.acceleration
        moment = ROD_INERTIA * growth + 0.5 * crossed(rod, inertial)
        across = (moment + rod[:, 1] * along) / rod[:, 0]
        self.force = np.stack([along, across], axis=-1)
        self.torque = crossed(tip, inertial - self.force)


def revolution(count=361):
    return np.linspace(0.0, REVOLUTION, count)


@pytest.fixture(scope="module")
def ideal_run() -> tuple[cj.results.Solution, cj.results.Observation]:
    scene, state = cj.mechanisms.slider_crank(clearance=None)
    settings, save = cj.Settings(rtol=1e-9, ledger=True), cj.Saving(revolution())
    solution = cj.simulate(scene, state, REVOLUTION, settings, save)
    return solution, cj.observe(scene, solution)


def test_ideal_mechanism_follows_newton_and_euler(ideal_run):
    """Motion, pin force, driving moment and its work, over a revolution."""
    solution, observed = ideal_run
    ideal = Ideal(SPEED * solution.times)
    slider = solution.states.bodies["slider"]
    np.testing.assert_allclose(slider.position[:, 0], ideal.position, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(slider.velocity[:, 0], ideal.velocity, atol=1e-6)
    found = observed.accelerations["slider"].linear[:, 0]
    np.testing.assert_allclose(found, ideal.acceleration, atol=2e-3)
    reactions = observed.reactions
    force = reactions["slider pin"]["rod"].force
    np.testing.assert_allclose(force[:, :2], ideal.force, atol=1e-3)
    moment = reactions["motor"]["crank"].moment
    np.testing.assert_allclose(moment[:, 2], ideal.torque, atol=1e-4)
    np.testing.assert_allclose(moment[:, :2], 0.0, atol=1e-9)
    assert observed.reactions_unique
    work = observed.energies["supplied"]
    kinetic = observed.energies["kinetic"]
    np.testing.assert_allclose(work, kinetic - kinetic[0], atol=1e-6)
    assert np.ptp(work) > 50.0


@pytest.fixture(scope="module")
def clearance_runs() -> dict[float, Any]:
    """One revolution with 0.5, 0.05 and 0.005 mm; they share a compiled program."""
    runs, settings = {}, cj.Settings(ledger=True)
    save = cj.Saving(revolution(), impacts=True)
    for clearance in (5e-4, 5e-5, 5e-6):
        scene, state = cj.mechanisms.slider_crank(clearance)
        solution = cj.simulate(scene, state, REVOLUTION, settings, save)
        runs[clearance] = (solution, cj.observe(scene, solution))
    return runs


@pytest.mark.slow
def test_motion_tends_to_the_ideal_with_the_clearance(clearance_runs):
    """Linearly: an eccentricity shifts the slider by at most 1/cos of the rod's largest tilt, and
    it is the clearance plus a penetration."""
    expected = Ideal(SPEED * revolution()).position
    leverage = 1.0 / np.sqrt(1.0 - (CRANK / ROD) ** 2)
    for clearance, (solution, observed) in clearance_runs.items():
        error = np.abs(solution.states.bodies["slider"].position[:, 0] - expected)
        eccentricity = observed.contacts["slider pin"]["V"].eccentricity
        assert (error <= 1.02 * leverage * eccentricity + 1e-9).all()
        penetration = solution.impacts.largest_penetration.max()
        assert eccentricity.max() < clearance + penetration < 2.0 * clearance
        assert error.max() > 0.9 * clearance


def test_invariants_with_clearance(clearance_runs):
    for solution, observed in clearance_runs.values():
        pin = observed.contacts["slider pin"]
        for base in pin.values():
            assert (base.normal_force >= 0.0).all()
        assert np.abs(pin["V"].normal_force - pin["W"].normal_force).max() == 0.0
        dissipated = observed.energies["normal damping"]
        assert dissipated[-1] > 0.01
        assert (np.diff(dissipated) >= -1e-4 * dissipated[-1]).all()
        exchanged = np.ptp(observed.energies["kinetic"])
        assert np.abs(observed.ledger_residual()).max() < 1e-5 * exchanged
        for joint, drift in observed.drift.items():
            assert drift.max() < 1e-6, joint
        for body in solution.states.bodies.values():
            np.testing.assert_array_equal(body.position[:, 2], 0.0)


def free_flight(clearance):
    """Time and approach speed of the first touch, by the rod's pendulum on the turning crank pin.

    At angle 0 the slider is at rest, and stays there until the journal meets the wall.
    """

    def offset(t, y):
        tip = CRANK * np.array([np.cos(SPEED * t), np.sin(SPEED * t)])
        journal = tip + ROD * np.array([np.cos(y[0]), np.sin(y[0])])
        return journal - np.array([CRANK + ROD, 0.0])

    def rates(t, y):
        lever = 0.5 * ROD * np.array([np.cos(y[0]), np.sin(y[0])])
        pull = CRANK * SPEED**2 * np.array([np.cos(SPEED * t), np.sin(SPEED * t)])
        return y[1], ROD_MASS * crossed(lever, pull) / (ROD_INERTIA + ROD_MASS * (0.5 * ROD) ** 2)

    def touch(t, y):
        return np.linalg.norm(offset(t, y)) - clearance

    touch.terminal = True
    start = (0.0, -SPEED * CRANK / ROD)
    run = solve_ivp(rates, (0.0, REVOLUTION), start, "DOP853", events=touch, rtol=1e-12, atol=1e-14)
    t, y = run.t_events[0][0], run.y_events[0][0]
    tip_speed = CRANK * SPEED * np.array([-np.sin(SPEED * t), np.cos(SPEED * t)])
    speed = tip_speed + ROD * y[1] * np.array([-np.sin(y[0]), np.cos(y[0])])
    normal = offset(t, y) / clearance
    return t, normal @ speed


@pytest.mark.parametrize("clearance", [5e-4, 5e-5])
def test_first_touch_ends_the_rods_free_flight(clearance_runs, clearance):
    solution, _ = clearance_runs[clearance]
    onset, speed = free_flight(clearance)
    for base in "VW":
        impacts = solution.impacts.of("slider pin", base)
        assert impacts.onset[0] == pytest.approx(onset, rel=1e-6)
        assert impacts.entry_speed[0] == pytest.approx(speed, rel=1e-5)
