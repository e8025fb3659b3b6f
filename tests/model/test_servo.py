"""Servos against discrete linear systems, SciPy from sample to sample, and exact invariants."""

import math
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

import clearjoint as cj
from tests.support.servo_reference import SampledPid

Z, ORIGIN = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
INERTIA = 0.02
TIGHT = cj.Settings(rtol=1e-10)
QUIET = {"progress": False}
ABOUT = "ground", "arm", Z


def one_inertia(servo, inertia=INERTIA, damping=None, **forces):
    hinge = cj.RevoluteJoint("ground", "arm", ORIGIN, ORIGIN, Z, Z)
    if damping is not None:
        forces["oil"] = cj.TorsionalSpring(*ABOUT, 0.0, damping)
    bodies = {"arm": cj.Body(1.0, (0.03, 0.03, inertia))}
    return cj.Scene(bodies, {"hinge": hinge}, {"servo": servo, **forces})


def turned(angle=0.0, speed=0.0):
    orientation = (math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle))
    return cj.body_state(ORIGIN, orientation, spin=(0.0, 0.0, speed))


def at(angle=0.0, speed=0.0):
    return cj.State({"arm": turned(angle, speed)})


def motion(scene, state, end, times, settings=TIGHT, **options):
    """Angle and speed of the arm at times, and the solution."""
    outputs = {
        "angle": cj.quantities.JointAngle("hinge"),
        "speed": cj.quantities.JointAngularVelocity("hinge"),
        "torque": cj.quantities.MotorTorque("servo"),
    }
    save = cj.Saving(times, states=False)
    return cj.simulate(scene, state, end, settings, save, outputs=outputs, **options, **QUIET)


@pytest.mark.parametrize("delayed", [False, True])
def test_a_step_response_is_that_of_the_discrete_linear_system(delayed):
    """A double integrator with zero-order hold, exactly discretised: x(k+1) = A x(k) + B u(k)."""
    rate, p, d, goal = 200.0, 20.0, 0.3, 0.5
    servo = cj.Servo(
        *(*ABOUT, goal, rate, p, d), delay=1.0 / rate if delayed else None, speed_from="sensor"
    )
    count = 60
    times = np.arange(count) / rate
    outputs = motion(one_inertia(servo), at(), times[-1], times).outputs
    exact = expm(np.array([[0, 1, 0], [0, 0, 1 / INERTIA], [0, 0, 0]]) / rate)
    a, b = exact[:2, :2], exact[:2, 2]
    x, states, held = np.zeros(2), [], p * goal
    for _ in range(count):
        states.append(x)
        command = p * (goal - x[0]) - d * x[1]
        u, held = (held, command) if delayed else (command, command)
        x = a @ x + b * u
    angles, speeds = np.transpose(states)
    np.testing.assert_allclose(outputs["angle"], angles, atol=1e-9)
    np.testing.assert_allclose(outputs["speed"], speeds, atol=1e-9 * np.abs(speeds).max())


CASES = {
    "difference": {},
    "sensor": {"speed_from": "sensor"},
    "less than a period": {"delay": 0.0031},
    "one period": {"delay": 0.005},
    "almost three periods": {"delay": 0.0149, "delay_periods": 3},
    "integral": {"integral": 150.0, "delay": 0.002},
    "saturated": {"integral": 400.0, "torque_limit": 1.1},
    "limited speed": {"speed_limit": 1.7, "torque_limit": 3.0},
}


@pytest.mark.parametrize("name", CASES)
def test_it_moves_as_scipy_says_from_sample_to_sample(name):
    """PD and PID of a damped inertia, with a goal that changes between samples."""
    options = CASES[name]
    target = cj.Polynomial([0.5, 0.6, -1.0])
    goal = target.coefficients
    servo = cj.Servo(*ABOUT, target, 200.0, 18.0, derivative=0.25, **options)
    times = np.sort(np.random.default_rng(3).uniform(0.0, 0.4, 12))
    scene = one_inertia(servo, damping=0.03)
    found = motion(scene, at(0.1, 0.7), 0.4, times).outputs
    law = SampledPid(
        200.0,
        18.0,
        0.25,
        options.get("integral", 0.0),
        options.get("delay", 0.0),
        options.get("torque_limit", np.inf),
        lambda t: goal[0] + goal[1] * t + goal[2] * t**2,
        lambda t: goal[1] + 2.0 * goal[2] * t,
        options.get("speed_limit", np.inf) / 200.0,
        by_difference=options.get("speed_from") != "sensor",
    )

    def rates(t, y, u):
        return [y[1], (u - 0.03 * y[1]) / INERTIA]

    states, torques = law.run(rates, [0.1, 0.7], 0.4, lambda y: (y[0], y[1]), times)
    np.testing.assert_allclose(found["angle"], states[:, 0], atol=1e-9)
    np.testing.assert_allclose(found["speed"], states[:, 1], atol=1e-8)
    np.testing.assert_allclose(found["torque"], torques, atol=1e-8)
    if name == "saturated":
        assert (np.abs(torques) == 1.1).sum() > 3 and (np.abs(torques) < 1.0).sum() > 3
