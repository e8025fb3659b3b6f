"""States inside of steps: Hermite interpolation of polynomials and rotations."""

import numpy as np
import pytest

import clearjoint as cj
from clearjoint._simulation.results.solution import instants_of_smooth_curves, states_between

CUBIC = np.array([[0.3, -0.2, 0.1], [1.0, 2.0, -1.0], [0.5, -4.9, 0.2], [-2.0, 0.7, 1.1]])
"""Coefficients of the powers 0 to 3 of time, for each component of a position."""
RATE = 1.3
TIMES = np.array([1.0, 1.1, 1.25, 1.4])


def positions(times):
    return np.vander(times, 4, increasing=True) @ CUBIC


def velocities(times):
    return np.vander(times, 3, increasing=True) @ (CUBIC[1:] * np.array([[1.0], [2.0], [3.0]]))


def orientations(times):
    half, zero = 0.5 * RATE * times, 0.0 * times
    return np.stack([np.cos(half), zero, zero, np.sin(half)], axis=1)


def body(times):
    """A body that moves along a cubic, and turns about z with constant speed."""
    spin = np.broadcast_to([0.0, 0.0, RATE], (len(times), 3))
    return cj.BodyState(positions(times), orientations(times), velocities(times), spin)


def test_cubic_motions_are_exact_and_rotations_accurate():
    states = cj.State({"body": body(TIMES)})
    # Both signs of Euler parameters are the same orientation.
    states.bodies["body"].orientation[1] *= -1.0
    wanted = np.array([1.0, 1.03, 1.1, 1.2, 1.3, 1.4])
    found = states_between(TIMES, states, wanted).bodies["body"]
    np.testing.assert_allclose(found.position, positions(wanted), rtol=1e-14)
    np.testing.assert_allclose(found.velocity, velocities(wanted), rtol=1e-13)
    sign = np.sign(found.orientation[:, :1])
    # h^4/384 times the fourth derivative, (RATE/2)^4, and h^3 sqrt(3)/216 for the rate.
    np.testing.assert_allclose(sign * found.orientation, orientations(wanted), rtol=0.0, atol=3e-7)
    np.testing.assert_allclose(np.linalg.norm(found.orientation, axis=1), 1.0, rtol=1e-15)
    np.testing.assert_allclose(found.spin, [[0.0, 0.0, RATE]] * 6, atol=2e-5)


def test_the_spin_between_steps_is_about_the_axis_of_the_rotation():
    axis, half = np.array([2.0, 1.0, -2.0]) / 3.0, 0.5 * RATE * TIMES[:, None]
    turning = body(TIMES)
    turning.orientation[:] = np.hstack([np.cos(half), np.sin(half) * axis])
    turning = cj.BodyState(
        turning.position, turning.orientation, turning.velocity, RATE * axis + np.zeros((4, 3))
    )
    spins = (
        states_between(TIMES, cj.State({"body": turning}), TIMES[:-1] + 0.03).bodies["body"].spin
    )
    np.testing.assert_allclose(spins, RATE * axis + np.zeros((3, 3)), atol=2e-5)


def test_integrals_are_linear_and_entry_speeds_those_of_the_steps_start():
    rows = np.array([1.0, 2.0, 4.0, 3.0])
    vectors = rows[:, None] * [1.0, -1.0, 2.0]
    states = cj.State(
        {"body": body(TIMES)}, {"pin": {"V": rows}}, {"friction": rows}, {"pin": {"V": vectors}}
    )
    found = states_between(TIMES, states, np.array([1.05, 1.1, 1.175, 1.4]))
    np.testing.assert_allclose(found.work["friction"], [1.5, 2.0, 3.0, 3.0], rtol=1e-14)
    expected = np.array([1.5, 2.0, 3.0, 3.0])[:, None] * [1.0, -1.0, 2.0]
    np.testing.assert_allclose(found.bristles["pin"]["V"], expected, rtol=1e-14)
    np.testing.assert_array_equal(found.entry_speeds["pin"]["V"], [1.0, 2.0, 2.0, 3.0])


def test_a_step_of_no_length_has_the_state_at_its_end():
    times = np.array([1.0, 1.1, 1.1])
    rows, ends = np.arange(3.0), positions(times)
    states = cj.State({"body": body(times)}, {"pin": {"V": rows}}, {"friction": rows})
    # The last state differs from the one before in all parts.
    changed = states.bodies["body"]
    changed.velocity[2], changed.position[2] = -changed.velocity[2], 2.0 * ends[2]
    found = states_between(times, states, np.array([1.05, 1.1]))
    last = found.bodies["body"]
    np.testing.assert_allclose(last.position[1], 2.0 * ends[2], rtol=1e-14)
    np.testing.assert_allclose(last.velocity[1], -velocities(times[2:])[0], rtol=1e-14)
    assert found.entry_speeds["pin"]["V"].tolist() == [0.0, 2.0]
    assert found.work["friction"][1] == 2.0


def flying(accelerations, spins, times):
    """Bodies with constant accelerations along x, m/s^2, and spins about z, rad/s."""
    rest = np.zeros((len(times), 3))
    bodies = {}
    for k, (acceleration, spin) in enumerate(zip(accelerations, spins, strict=True)):
        velocity, turning = rest.copy(), rest.copy()
        velocity[:, 0], turning[:, 2] = acceleration * times, spin
        turned = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (len(times), 4))
        bodies[str(k)] = cj.BodyState(0.5 * velocity * times[:, None], turned, velocity, turning)
    return cj.State(bodies)


@pytest.mark.parametrize(
    ("accelerations", "spins", "parts"),
    [
        # The distance of a parabola from its chord, a h^2/8, falls to 1/256 in 16 parts.
        ((0.0,), (0.0,), (1, 1)),
        ((2.0,), (0.0,), (16, 8)),
        ((2.0, 0.0), (0.0, 0.0), (16, 8)),
        ((0.0, 2.0), (0.0, 0.0), (16, 8)),
        # A part has at most 0.05 rad, and a step at most 64 parts.
        ((0.0,), (3.01,), (13, 7)),
        ((0.0, 0.0), (3.01, -1.0), (13, 7)),
        ((0.0,), (100.0,), (64, 64)),
    ],
)
def test_curved_steps_are_divided(accelerations, spins, parts):
    times = np.array([0.0, 0.2, 0.3])
    found = instants_of_smooth_curves(times, flying(accelerations, spins, times))
    steps = [
        np.linspace(a, b, n, endpoint=False)
        for a, b, n in zip(times[:-1], times[1:], parts, strict=True)
    ]
    np.testing.assert_allclose(found, [*np.concatenate(steps), 0.3], rtol=0.0, atol=1e-15)
