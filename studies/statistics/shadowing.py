"""Derivatives of a long mean by non-intrusive least-squares shadowing (NILSS).

Tangents of a chaotic motion grow exponentially, so that their mean is useless. The shadow is the
motion with the changed clearance that stays closest to the given one; NILSS (Ni and Wang, J.
Comput. Phys. 347, 2017) finds its tangent from tangents on segments short enough not to overflow.
All four directions of the state are used here, since the slider-crank has only two degrees of
freedom beside its crank. Time needs no dilation, because the crank's angle fixes the phase.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np

import clearjoint as cj
from clearjoint.extend import Scalar

PIN = "slider pin"
FORCE = cj.quantities.ContactForce(PIN, "V")
CLEARANCE = cj.Parameter(lambda scene: scene.joints[PIN].clearance)
ARM = 0.06
"""Distance from the crank pin to the rod's centre of mass, m."""
COORDINATES = {
    "slider": cj.quantities.Position("slider", "x"),
    "slider speed": cj.quantities.Velocity("slider", "x"),
    "rod": cj.quantities.Position("rod", "y"),
    "rod speed": cj.quantities.Velocity("rod", "y"),
}
SAMPLES = 400
"""Saved states per revolution, among which segments begin."""


def rod_arm(state: cj.State) -> jax.Array:
    """Return the vector from the crank pin to the rod's centre of mass, (3,) m."""
    e = state.bodies["rod"].orientation
    return ARM * jnp.array([1.0 - 2.0 * e[3] ** 2, 2.0 * e[0] * e[3], 0.0])


def change_slider(field: str) -> Callable[[cj.State, Scalar], dict[str, cj.BodyState]]:
    """Return the function that changes the slider's position, m, or velocity, m/s, along X."""

    def change(state: cj.State, amount: Scalar) -> dict[str, cj.BodyState]:
        slider = state.bodies["slider"]
        changed = getattr(slider, field) + amount * jnp.eye(3)[0]
        return {"slider": replace(slider, **{field: changed})}

    return change


def turn_rod(state: cj.State, angle: Scalar) -> dict[str, cj.BodyState]:
    """Turn the rod about the crank pin, rad, to first order, at an unchanged rate."""
    rod, about, arm = state.bodies["rod"], jnp.eye(3)[2], rod_arm(state)
    e = rod.orientation
    return {
        "rod": replace(
            rod,
            position=rod.position + angle * jnp.cross(about, arm),
            velocity=rod.velocity - angle * rod.spin[2] * arm,
            orientation=e + 0.5 * angle * jnp.array([-e[3], -e[2], e[1], e[0]]),
        )
    }


def spin_rod(state: cj.State, rate: Scalar) -> dict[str, cj.BodyState]:
    """Change the rod's rate about the crank pin, rad/s."""
    rod, about = state.bodies["rod"], jnp.eye(3)[2]
    velocity = rod.velocity + rate * jnp.cross(about, rod_arm(state))
    return {"rod": replace(rod, velocity=velocity, spin=rod.spin + rate * about)}


def change_of(direction: Callable[..., dict[str, cj.BodyState]]) -> cj.Parameter:
    """Return the parameter that changes the initial state in a direction, in SI units."""

    def change(scene: cj.Scene, state: cj.State, amount: Scalar) -> tuple[cj.Scene, cj.State]:
        return scene, replace(state, bodies=state.bodies | direction(state, amount))

    return cj.Parameter.change(change, 0.0, unit="1")


PARAMETERS = {
    "clearance": CLEARANCE,
    "slider": change_of(change_slider("position")),
    "slider speed": change_of(change_slider("velocity")),
    "rod": change_of(turn_rod),
    "rod speed": change_of(spin_rod),
}


@dataclass(frozen=True)
class Segment:
    """Tangents between two instants of free flight, affine in the tangent v at the first one.

    The state's coordinates are the slider's position, the rod's height, m, and their rates times
    the duration of a radian of the crank, m.

    - `times`: (N,) s.
    - `growth`, `change`: (N, 4, 4) and (N, 4), so that the tangent is growth v + change, where
      `change` is m per m of clearance.
    - `force_growth`, `force_change`: (N, 4) and (N,), the same of the force, N/m.
    """

    times: np.ndarray
    growth: np.ndarray
    change: np.ndarray
    force_growth: np.ndarray
    force_change: np.ndarray


def segments(clearance: float, revolutions: int, period: float) -> list[Segment]:
    """Return the tangents of a run at a clearance, m, whose crank rotates with a period, s.

    Segments begin in free flight, because a contact's entry speed is not among the coordinates.
    """
    scene, state = cj.mechanisms.slider_crank(clearance)
    # Tangents of this size must not control the steps, or runs reach their step limit.
    settings = replace(cj.presets.derivatives, derivative_tolerance=1e9)
    times = np.linspace(0.0, revolutions * period, revolutions * SAMPLES + 1)
    run = cj.simulate(scene, state, times[-1], settings, cj.Saving(times), progress=False)
    assert run.saved is not None
    free = np.flatnonzero(cj.observe(scene, run).contacts[PIN]["V"].penetration < 0.0)
    # The first instant of free flight in each quarter of a revolution.
    begins = free[np.unique(4 * free // SAMPLES, return_index=True)[1]]
    ends = [*begins[1:], len(times) - 1]
    found = []
    for begin, end in zip(begins, ends, strict=True):
        start = jax.tree.map(lambda leaf, k=begin: np.asarray(leaf)[k], run.saved.states)
        count = 16_000 * (end - begin) // SAMPLES
        inside = np.linspace(times[begin], times[end], count)
        tangents = cj.sensitivities(
            scene,
            start,
            float(times[end]),
            PARAMETERS,
            {**COORDINATES, "force": FORCE},
            inside,
            settings,
            start_time=float(times[begin]),
            progress=False,
        ).derivatives
        state_tangents = np.stack([tangents[name] for name in COORDINATES], axis=1)
        state_tangents[:, 1::2] *= period / (2.0 * np.pi)
        # From derivatives by the four directions to derivatives by the first tangent.
        basis = np.linalg.inv(state_tangents[0, :, 1:])
        found.append(
            Segment(
                inside,
                state_tangents[:, :, 1:] @ basis,
                state_tangents[:, :, 0],
                tangents["force"][:, 1:] @ basis,
                tangents["force"][:, 0],
            )
        )
    return found


def shadow(found: list[Segment]) -> np.ndarray:
    """Return the first tangents of the segments, (K, 4) m per m, of the closest motion.

    They minimise the integral of the squared tangent, under the condition that each segment begins
    with the last tangent of the one before (Lagrange's multipliers; rows are scaled to the order
    of one).
    """
    size = 4 * len(found)
    squares, linear = np.zeros((size, size)), np.zeros(size)
    conditions, last = np.zeros((size - 4, size)), np.zeros(size - 4)
    for k, one in enumerate(found):
        own, step = slice(4 * k, 4 * k + 4), one.times[1] - one.times[0]
        squares[own, own] = step * np.einsum("tij,tik->jk", one.growth, one.growth)
        linear[own] = step * np.einsum("tij,ti->j", one.growth, one.change)
        if k + 1 < len(found):
            scale = 1.0 / np.abs(one.growth[-1]).max()
            conditions[own, own] = scale * one.growth[-1]
            conditions[own, 4 * k + 4 : 4 * k + 8] = -scale * np.eye(4)
            last[own] = -scale * one.change[-1]
    largest = squares.max()
    system = np.block(
        [[squares / largest, conditions.T], [conditions, np.zeros((size - 4, size - 4))]]
    )
    solution, *_ = np.linalg.lstsq(system, np.concatenate([-linear / largest, last]))
    return solution[:size].reshape(-1, 4)


def continued(found: list[Segment]) -> np.ndarray:
    """Return the first tangents of the segments, (K, 4) m per m, without shadowing."""
    tangents = [np.zeros(4)]
    for one in found[:-1]:
        tangents.append(one.growth[-1] @ tangents[-1] + one.change[-1])
    return np.array(tangents)


def mean_force(found: list[Segment], tangents: np.ndarray, after: float) -> float:
    """Return the derivative of the mean force after a time, s, by the clearance, N/m."""
    integral = duration = 0.0
    for one, tangent in zip(found, tangents, strict=True):
        kept = one.times >= after
        if kept.sum() > 1:
            values = (one.force_growth @ tangent + one.force_change)[kept]
            integral += np.trapezoid(values, one.times[kept])
            duration += np.ptp(one.times[kept])
    return integral / duration
