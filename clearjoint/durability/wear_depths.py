"""Depths that the contacts of a run remove around a bearing and its journal.

A base of a journal is one of the two ends of its axis, where it touches the wall.
"""

from collections.abc import Mapping
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..math.vectors import Scalar
from ..model.clearance_joints.clearance import ClearanceJoint
from ..model.clearance_joints.journal_bases import BASES
from ..model.profiles import PlanarAxes, overlaps
from ..model.scene import Scene
from ..quantities.instant import Instant
from ..simulation.reductions.joints import sliding_speed
from ..simulation.results.quantity_values import values_along
from ..simulation.results.solution import Solution

OF_BASES = tuple((base, kind) for base in BASES for kind in ("power", "x", "y", "penetration"))
SIGNALS = tuple(f"{base} {kind}" for base, kind in OF_BASES) + PlanarAxes._fields
"""Names of the numbers from which the wear of a joint follows at an instant.

They are, for each base, the product of normal force and sliding speed, W, the base's eccentricity
in the bearing's frame, m, and the penetration, m; and the four components of `PlanarAxes`.
"""
TIMES_IN_PROGRAM = 4096
"""The number of steps is rounded up to a multiple of half of this, so that few programs are
compiled."""

Signals = Mapping[str, Float[jax.Array | np.ndarray, " T"]]


class Signal(eqx.Module):
    """One of `SIGNALS`, by its name, of the joint of a given name, as a quantity."""

    joint: str = eqx.field(static=True)
    name: str = eqx.field(static=True)

    def __call__(self, now: Instant) -> Scalar:
        """Return the signal at an instant."""
        element = now.scene.joints[self.joint]
        assert isinstance(element, ClearanceJoint)
        if self.name in PlanarAxes._fields:
            bodies = now.motions[element.bearing_body], now.motions[element.journal_body]
            return getattr(element.planar_axes(*bodies), self.name)
        base, kind = self.name.split()
        if kind == "power":
            force = now.contacts[self.joint][base].normal_force
            return force * sliding_speed(now, self.joint, base)
        if kind == "penetration":
            return now.contacts[self.joint][base].contact.gap.depth
        return getattr(element.journal_offset(now.motions, base), kind)


class AllSignals(eqx.Module):
    """All `SIGNALS` of the joint of a given name, as one quantity with an array of values."""

    joint: str = eqx.field(static=True)

    def __call__(self, now: Instant) -> jax.Array:
        """Return the signals at an instant, in the order of `SIGNALS`."""
        return jnp.stack([jnp.asarray(Signal(self.joint, name)(now)) for name in SIGNALS])


def quadrature_times(
    solution: Solution, start: float, end: float, longest: float
) -> Float[np.ndarray, " T"]:
    """Return times from `start` to `end`, s, for Simpson's rule: ends and middles of intervals.

    The intervals are the steps of the run, divided into equal parts of at most `longest`, s.
    """
    assert solution.steps is not None, "`wear` saves all steps"
    ends = np.asarray(solution.steps.times)
    ends = np.unique([start, *ends[(ends > start) & (ends < end)], end])
    parts = 2 * np.ceil(np.diff(ends) / longest).astype(int)
    # The k-th of n parts of a step begins at k/n of it.
    within = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    inner = np.repeat(ends[:-1], parts) + np.repeat(np.diff(ends) / parts, parts) * within
    return np.append(inner, end)


def wear_depths(
    scene: Scene,
    solution: Solution,
    joint: str,
    rates: tuple[float, float],
    times: Float[np.ndarray, " T"],
    samples: int,
) -> tuple[Float[np.ndarray, "2 samples"], float]:
    """Return the depths that wear off the wall and off the journal of a joint in a part of a run.

    **Arguments:**

    - `solution`: of `simulate`, with all steps saved.
    - `joint`: name of a `ClearanceJoint`.
    - `rates`: specific wear rates of the bearing and of the journal, m^2/N.
    - `times`: of `quadrature_times`, s.
    - `samples`: number of evenly spaced angles from the x axis of each part's frame.

    **Returns:** the depths, (2, samples) m, and the largest penetration, m.
    """
    assert solution.steps is not None, "`wear` saves all steps"
    values = values_along(scene, solution, AllSignals(joint), solution.steps.between(times))
    signals = dict(zip(SIGNALS, values.T, strict=True))
    element = scene.joints[joint]
    assert isinstance(element, ClearanceJoint)
    depths = np.asarray(depths_from_signals(element, np.asarray(rates), times, signals, samples))
    return depths, max(float(signals[f"{base} penetration"].max()) for base in BASES)


def depths_from_signals(
    joint: ClearanceJoint,
    rates: Float[jax.Array | np.ndarray, "2"],
    times: Float[np.ndarray, " T"],
    signals: Signals,
    samples: int,
) -> Float[jax.Array, "2 samples"]:
    """Return the depths, m, that wear off the wall and off the journal; JAX can differentiate it.

    The volume that wears off in a time dt is k F v dt, with the specific wear rate k of a part, the
    normal force F of a base and the sliding speed v (J. F. Archard 1953). It is distributed in
    proportion to the overlap of the two profiles, as if the wall were an elastic foundation, over
    the whole length of the journal. Both bases count together.

    **Arguments:** `rates`: k of the bearing and of the journal, m^2/N. `times`: of
    `quadrature_times`, s. `signals`: by the names of `SIGNALS`. `samples`: number of angles.
    """
    # Steps of no length are added at the end. The number of times stays odd.
    more = -(len(times) - 1) % TIMES_IN_PROGRAM
    times, signals = jax.tree.map(
        lambda row: jnp.concatenate([row, jnp.broadcast_to(row[-1], more)]), (times, dict(signals))
    )
    return _depths(joint, jnp.asarray(rates), times, signals, samples)


@partial(jax.jit, static_argnames="samples")
def _depths(
    joint: ClearanceJoint,
    rates: Float[jax.Array, "2"],
    times: Float[jax.Array, " T"],
    signals: Mapping[str, Float[jax.Array, " T"]],
    samples: int,
) -> Float[jax.Array, "2 samples"]:
    axes = PlanarAxes(*(signals[name][:, None] for name in PlanarAxes._fields))
    radii = joint.bearing_radius, joint.journal_radius
    depths = []
    for angles, radius, rate in zip(_wall_angles(axes, samples), radii, rates, strict=True):
        density = jnp.zeros((len(times), samples))
        for base in BASES:
            x, y, power = (signals[f"{base} {kind}"][:, None] for kind in ("x", "y", "power"))
            density = density + power * _shares(joint, x, y, angles, axes)
        area = radius * 2.0 * np.pi / samples * joint.journal_length
        depths.append(rate / area * _integral(times, density))
    return jnp.stack(depths)


def _integral(
    times: Float[jax.Array, " T"], values: Float[jax.Array, "T n"]
) -> Float[jax.Array, " n"]:
    """Return integrals over time by Simpson's rule; every second time is a middle."""
    sixths = (times[2::2] - times[:-2:2])[:, None] / 6.0
    return (sixths * (values[:-2:2] + 4.0 * values[1:-1:2] + values[2::2])).sum(axis=0)


def _wall_angles(axes: PlanarAxes, samples: int) -> tuple[np.ndarray, jax.Array]:
    """Return the angles in the bearing's cross-section of evenly spaced angles of both parts.

    The first array is (samples,), the second (T, samples), since the journal rotates.
    """
    angles = np.arange(samples) * 2.0 * np.pi / samples
    along_x = axes.x_along_x * np.cos(angles) + axes.y_along_x * np.sin(angles)
    along_y = axes.x_along_y * np.cos(angles) + axes.y_along_y * np.sin(angles)
    return angles, jnp.arctan2(along_y, along_x)


def _shares(
    joint: ClearanceJoint,
    x: Float[jax.Array, "T 1"],
    y: Float[jax.Array, "T 1"],
    angles: Float[jax.Array | np.ndarray, "... samples"],
    axes: PlanarAxes,
) -> Float[jax.Array, "T samples"]:
    """Return the share of the wear at each angle in the bearing's cross-section.

    The sagitta of one spacing is added to the overlap, so that two angles at least share the wear
    of a contact that is narrower than their distance.
    """
    spacing = 2.0 * np.pi / np.shape(angles)[-1]
    excess = 0.5 * joint.clearance * spacing**2 - joint.clearance
    overlap = overlaps(x, y, angles, joint.bearing_profile, joint.journal_profile, axes)
    part = jnp.maximum(overlap + excess, 0.0)
    total = part.sum(axis=1, keepdims=True)
    return part / jnp.where(total > 0.0, total, 1.0)
