"""States inside accepted steps of a run, by cubic Hermite interpolation between the steps' ends.

The state at the end of a step contains positions and velocities, so that the interpolation needs
neither the solver nor the equations of motion. In a step of length h, the error of a position is
h^4/384 times its fourth derivative, far below the clearances. Free flight under gravity is exact.
"""

# Hermite's polynomials are declared for scalars; they are elementwise in arrays.
# pyright: reportArgumentType=false, reportCallIssue=false

import jax
import numpy as np
from jaxtyping import Float, Int

from ...math.interpolation import Slope, hermite_rate, hermite_value
from ...model.bodies import BodyState, State
from ..step.spans import checked_times

FINEST = 16
"""Number of parts into which the most curved step is divided for drawing. Dividing a step into n
parts reduces the distance between a path and its chords to 1/n^2 of its value, here to 1/256."""
LARGEST_ROTATION = 0.05
"""Largest rotation of a body within one part of a step, rad. The chord of an arc of this angle is
nowhere farther from the arc than 3e-4 of its radius."""
MOST = 64
"""Largest number of parts into which a step is divided, so that a body that spins fast in a long
step does not make the result arbitrarily long."""

Times = Float[np.ndarray, " N"]
Wanted = Float[np.ndarray, " M"]
Rows = Int[np.ndarray, " M"]


def instants_of_smooth_curves(times: Times, states: State) -> Wanted:
    """Choose times in s such that the states at these times, joined by straight lines, look like a
    smooth curve.

    The result contains the ends of all steps, and equidistant times inside each step in which a
    body moves along a curve or rotates.

    **Arguments:** `times`: (N,) s, not decreasing, the ends of the steps; `states`: the N states at
    these times.

    **Returns:** (M,) s, not decreasing.
    """
    lengths = np.diff(times)
    # `bend`, m, is the length of a step times the change of a velocity in it. For a parabola, it is
    # 8 times the largest distance between curve and chord.
    bend, rotation = np.zeros(len(lengths)), np.zeros(len(lengths))
    for body in states.bodies.values():
        change = np.linalg.norm(np.diff(body.velocity, axis=0), axis=1)
        bend = np.maximum(bend, lengths * change)
        # The angle by which the body rotates in the step, rad, at the spin of the step's start.
        rotation = np.maximum(rotation, lengths * np.linalg.norm(body.spin[:-1], axis=1))
    # If all bodies move along straight lines, the tiny number avoids a division by zero.
    largest = max(bend.max(initial=0.0), np.finfo(float).tiny)
    # n parts reduce the distance from the chord by n^2, so the number of parts grows with its root.
    parts = np.maximum(FINEST * np.sqrt(bend / largest), rotation / LARGEST_ROTATION)
    parts = np.clip(np.ceil(parts), 1, MOST).astype(int)
    # `part` counts the parts of each step from 0, in one array for all steps.
    step = np.repeat(np.arange(len(parts)), parts)
    part = np.arange(len(step)) - (np.cumsum(parts) - parts)[step]
    inside = times[step] + part / parts[step] * lengths[step]
    return np.append(inside, times[-1:])


def states_between(times: Times, states: State, wanted: Wanted) -> State:
    """Interpolate the states at M times `wanted` from those at the ends of the steps.

    Motions of bodies are interpolated by cubic Hermite polynomials. Deflections of bristles and
    integrals of the energy ledger (energies dissipated and supplied) are interpolated linearly.
    Entry speeds of contacts keep their values at the start of the step up to its end.

    **Arguments:** `times`: (N,) s, not decreasing, N ≥ 2, the ends of the steps; `states`: the N
    states at these times; `wanted`: (M,) s, not decreasing, between the first and the last of
    `times`.

    If a time occurs several times in `times`, the last state there counts.

    **Returns:** a state whose arrays have a first axis of length M.

    **Raises:** `ValueError` if `wanted` is empty, decreases, or has times that are not finite or
    outside this range.
    """
    wanted = checked_times(times[0], times[-1], wanted, "times")
    # The step of a wanted time begins at the last row whose time is not later. The last row of all
    # begins no step: there, `left` is the start of the last step, and x is 1, also if the last time
    # is repeated, so that this step has no length.
    left = np.clip(np.searchsorted(times, wanted, "right") - 1, 0, len(times) - 2)
    h = (times[left + 1] - times[left])[:, None]
    x = np.where(h > 0.0, (wanted - times[left])[:, None] / np.where(h > 0.0, h, 1.0), 1.0)
    bodies = {name: _body(body, left, x, h) for name, body in states.bodies.items()}
    ends = np.where(x[:, 0] == 1.0, left + 1, left)

    def linear(rows: np.ndarray) -> np.ndarray:
        y = x.reshape(-1, *[1] * (rows.ndim - 1))
        return (1.0 - y) * rows[left] + y * rows[left + 1]

    entry_speeds = jax.tree.map(lambda rows: np.asarray(rows)[ends], states.entry_speeds)
    work, bristles = jax.tree.map(
        lambda rows: linear(np.asarray(rows)), (states.work, states.bristles)
    )
    return State(bodies, entry_speeds, work, bristles)


def _body(body: BodyState, left: Rows, x: np.ndarray, h: np.ndarray) -> BodyState:
    """Return the states of one body at M instants inside steps.

    **Arguments:** `body`: the states at the ends of all steps; `left`: (M,), for each instant the
    row of `body` at which its step begins; `x`: (M, 1), the part of the step's time before the
    instant, 0 to 1; `h`: (M, 1) s, the length of the step.
    """
    positions, velocities = np.asarray(body.position), np.asarray(body.velocity)
    ends = (Slope(positions[row], velocities[row]) for row in (left, left + 1))
    position, velocity = _along(*ends, x, h)
    orientations, spins = np.asarray(body.orientation), np.asarray(body.spin)
    first, second = orientations[left], orientations[left + 1]
    # Both signs of Euler parameters are the same orientation: take the nearer one.
    sign = np.where(np.sum(first * second, axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    # The rate of the Euler parameters p is the quaternion product p (0, w)/2, where w is the spin.
    rates = 0.5 * _product(orientations, np.pad(spins, ((0, 0), (1, 0))))
    ends = Slope(first, rates[left]), Slope(sign * second, sign * rates[left + 1])
    orientation, rate = _along(*ends, x, h)
    size = np.linalg.norm(orientation, axis=1, keepdims=True)
    conjugate = orientation * (1.0, -1.0, -1.0, -1.0) / size**2
    return BodyState(position, orientation / size, velocity, 2.0 * _product(conjugate, rate)[:, 1:])


def _along(start: Slope, end: Slope, x: np.ndarray, h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the cubic Hermite interpolants and their time derivatives, (M, components) each.

    For a step of length zero they are the value and the rate at its start.

    **Arguments:** `start`, `end`: values and rates at the ends of M steps, (M, components) each;
    `x`, `h`: as of `_body`.
    """
    there, length = h > 0.0, np.where(h > 0.0, h, 1.0)
    value, rate = hermite_value(x, start, end, length), hermite_rate(x, start, end, length)
    return np.where(there, value, start.value), np.where(there, rate, start.rate)


def _product(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the products, (N, 4), of two arrays of quaternions, (N, 4) each, scalar part first."""
    a, u, b, v = first[:, :1], first[:, 1:], second[:, :1], second[:, 1:]
    scalar = a * b - np.sum(u * v, axis=1, keepdims=True)
    return np.concatenate([scalar, a * v + b * u + np.cross(u, v)], axis=1)
