"""Depths that the contacts of a run remove around a bearing and its journal."""

from collections.abc import Mapping
from functools import partial
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._math.vectors import Scalar
from .._model.clearance_joints.clearance import ClearanceJoint
from .._model.clearance_joints.journal_bases import BASES
from .._model.profiles import JournalInBearing, PlanarAxes
from .._model.scene import Scene
from .._simulation.reductions.joints import sliding_speed
from .._simulation.results.observe import values_along
from .._simulation.results.solution import Solution
from ..quantities.base import Instant

OF_BASE = "force", "power", "x", "y", "penetration"
SIGNALS = (*(f"{base} {kind}" for base in BASES for kind in OF_BASE), *PlanarAxes._fields)
"""Names of the numbers from which the wear of a joint follows at an instant.

They are, for each of the bases V and W (here with the names for V): the normal force, N ("V
force"), its product with the sliding speed, W ("V power"), the base's eccentricity in the bearing's
frame, m ("V x", "V y"), and the penetration, m ("V penetration"). The last four are the fields of
`PlanarAxes`: components of the journal's x and y axes along the bearing's x and y axes.
"""
TIMES_IN_PROGRAM = 4096
"""The number of times of the quadrature, less one, is rounded up to a multiple of this number, so
that few programs are compiled."""

Signals = Mapping[str, Float[jax.Array | np.ndarray, " T"]]
"""Values of `SIGNALS` at T times, by name."""


class Signal(eqx.Module):
    """Quantity: the number `name` of `SIGNALS`, such as "V force", for the wear of `joint`."""

    joint: str = eqx.field(static=True)
    name: str = eqx.field(static=True)

    def __call__(self, now: Instant) -> Scalar:
        element = now.scene.joints[self.joint]
        assert isinstance(element, ClearanceJoint)
        if self.name in PlanarAxes._fields:
            bodies = now.motions[element.bearing_body], now.motions[element.journal_body]
            return getattr(element.planar_axes(*bodies), self.name)
        base, kind = self.name.split()
        if kind in ("force", "power"):
            force = now.contacts[self.joint][base].normal_force
            return force if kind == "force" else force * sliding_speed(now, self.joint, base)
        if kind == "penetration":
            return now.contacts[self.joint][base].contact.gap.depth
        return getattr(element.journal_offset(now.motions, base), kind)


class AllSignals(eqx.Module):
    """Quantity: the signals of a joint, an array in the order of `SIGNALS`."""

    is_array: ClassVar[bool] = True
    joint: str = eqx.field(static=True)

    def __call__(self, now: Instant) -> jax.Array:
        return jnp.stack([jnp.asarray(Signal(self.joint, name)(now)) for name in SIGNALS])


def quadrature_times(
    solution: Solution, start: float, end: float, longest: float
) -> Float[np.ndarray, " T"]:
    """Return the ends and middles of intervals from `start` to `end`, s, for Simpson's rule: the
    saved steps of the run, divided into equal parts of at most `longest`, s."""
    assert solution.steps is not None, "`wear` saves all steps"
    ends = np.asarray(solution.steps.times)
    ends = np.unique([start, *ends[(ends > start) & (ends < end)], end])
    # Number of parts of each step. It is even, because each interval of Simpson's rule consists of
    # two parts: from an end to the middle, and on to the other end.
    parts = 2 * np.ceil(np.diff(ends) / longest).astype(int)
    # The k-th of n parts of a step begins at k/n of the step; k is the index of a part among all
    # parts, less the number of parts of the steps before.
    k = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    begins = np.repeat(ends[:-1], parts) + np.repeat(np.diff(ends) / parts, parts) * k
    return np.append(begins, end)


def wear_depths(
    scene: Scene,
    solution: Solution,
    joint: str,
    rates: tuple[float, float],
    times: Float[np.ndarray, " T"],
    samples: int,
) -> tuple[Float[np.ndarray, "2 samples"], Float[np.ndarray, "2"], Signals]:
    """Return the wear of a joint in the run `solution`, with the wear `rates` of bearing and
    journal, m^2/N, during the `times` from `quadrature_times`, s.

    **Returns:** the depths that wear off the wall and off the journal at `samples` evenly spaced
    angles, (2, samples) m; the largest penetration at an end of the journal, m, and the largest sum
    of the normal forces at both ends, N, (2,); and the numbers from which the wear follows, such as
    normal forces, at each of the times, by the names `SIGNALS`.
    """
    assert solution.steps is not None, "`wear` saves all steps"
    values = values_along(scene, solution, AllSignals(joint), solution.steps.between(times))
    signals = dict(zip(SIGNALS, values.T, strict=True))
    element = scene.joints[joint]
    assert isinstance(element, ClearanceJoint)
    depths = np.asarray(depths_from_signals(element, np.asarray(rates), times, signals, samples))
    deepest = max(signals[f"{base} penetration"].max() for base in BASES)
    forces = np.sum([signals[f"{base} force"] for base in BASES], axis=0)
    return depths, np.array([deepest, forces.max()]), signals


def depths_from_signals(
    joint: ClearanceJoint,
    rates: Float[jax.Array | np.ndarray, "2"],
    times: Float[np.ndarray, " T"],
    signals: Signals,
    samples: int,
) -> Float[jax.Array, "2 samples"]:
    """Return the depths, m, that wear off the wall and off the journal at `samples` angles, from
    the joint's `signals` at the times of `quadrature_times`, s. JAX can differentiate the depths.

    The volume that wears off in a time dt is k F v dt, with the specific wear rate k of bearing or
    journal (`rates`, m^2/N), the normal force F at a base, and the sliding speed v there (J. F.
    Archard 1953). It is distributed over the angles in proportion to the overlap of the two
    profiles, as if the wall were an elastic foundation, and evenly over the length of the journal.
    The wear of both bases is added.
    """
    # The last time is repeated, so that few programs are compiled (see `TIMES_IN_PROGRAM`). The
    # added intervals have no length and add nothing to the integral. The number of times stays odd,
    # as Simpson's rule needs it.
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
    for angles, radius, rate in zip(wall_angles(axes, samples), radii, rates, strict=True):
        # Normal force times sliding speed, W, that wears the part at each angle.
        density = jnp.zeros((len(times), samples))
        for base in BASES:
            x, y, power = (signals[f"{base} {kind}"][:, None] for kind in ("x", "y", "power"))
            density = density + power * shares(joint, x, y, angles, axes)
        # The area of the surface that belongs to one angle, m^2.
        area = radius * 2.0 * np.pi / samples * joint.journal_length
        # Simpson's rule: even rows are the ends of intervals, odd rows their middles.
        sixths = (times[2::2] - times[:-2:2])[:, None] / 6.0
        terms = sixths * (density[:-2:2] + 4.0 * density[1:-1:2] + density[2::2])
        work = terms.sum(axis=0)  # normal force times sliding distance, N m
        depths.append(rate / area * work)
    return jnp.stack(depths)


def even_angles(samples: int) -> Float[np.ndarray, " samples"]:
    return np.arange(samples) * 2.0 * np.pi / samples


def wall_angles(axes: PlanarAxes, samples: int) -> tuple[np.ndarray, jax.Array]:
    """Return the directions, rad, in the bearing's frame, of `samples` evenly spaced points of the
    wall, (samples,), and of the journal, from its own x axis on, (T, samples)."""
    angles = even_angles(samples)
    along_x = axes.x_along_x * np.cos(angles) + axes.y_along_x * np.sin(angles)
    along_y = axes.x_along_y * np.cos(angles) + axes.y_along_y * np.sin(angles)
    return angles, jnp.arctan2(along_y, along_x)


def shares(
    joint: ClearanceJoint,
    x: Float[jax.Array, "T 1"],
    y: Float[jax.Array, "T 1"],
    angles: Float[jax.Array | np.ndarray, "... samples"],
    axes: PlanarAxes,
) -> Float[jax.Array, "T samples"]:
    """Return the share of the wear at one base that falls on each of the `angles`, rad, at each
    time. In the bearing's frame, `x`, `y` are the base's eccentricity, m, and `axes` the journal's.

    At each angle, max(penetration + onset + extra, 0), m, is divided by its sum over all angles.
    The penetration is positive where the surfaces overlap, and the onset is the distance of the
    surfaces at which the force begins. A contact may be so narrow that it lies between two angles.
    The extra depth therefore gives even a contact without penetration a half-width of one
    spacing s of the angles, rad. It is r s^2/2, the gap of two circles at one spacing from the
    deepest point, where the room r is the clearance changed by the profiles' mean deviations, m.
    """
    samples = np.shape(angles)[-1]
    # A deviation of the bearing enlarges the room, a deviation of the journal reduces it.
    room, spacing = joint.clearance, 2.0 * np.pi / samples
    for profile, sign in ((joint.bearing_profile, 1.0), (joint.journal_profile, -1.0)):
        if profile is not None:
            room = room + sign * jnp.mean(profile.at(np.arange(samples) * spacing).value)
    excess = 0.5 * room * spacing**2 - joint.clearance + joint.law.onset_offset()
    profiles = joint.bearing_profile, joint.journal_profile
    overlap = JournalInBearing(x, y, *profiles, axes).overlap(angles)
    part = jnp.maximum(overlap + excess, 0.0)
    total = part.sum(axis=1, keepdims=True)
    # Without contact all of `part` may be zero. The shares are then zero rather than 0/0.
    return part / jnp.where(total > 0.0, total, 1.0)
