"""Growth of the worn depths of a joint over many cycles, with the contacts of a run held fixed.

Wear is stiff: the material that carries the load wears off first, and after a change of depth by
the elastic penetration, other material carries it. An explicit step is therefore unstable if the
depth changes by more than the penetration. But forces, sliding speeds and directions of the
contacts change little meanwhile. Here they are held fixed, the journal follows the wall, and an
implicit method computes how the depths grow.
"""

from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._math.vectors import Scalar
from .._model.clearance_joints.clearance import ClearanceJoint
from .._model.clearance_joints.journal_bases import BASES
from .._model.profiles import AbstractProfile, JournalInBearing, PeriodicSpline, PlanarAxes
from .wear_depths import Signals, shares, wall_angles
from .wear_rates import PROFILES

if TYPE_CHECKING:
    from scipy.integrate import OdeSolution

INSTANTS_PER_SAMPLE = 4
"""Number of instants of a half of the measured cycles, divided by the number of angles: a contact
that circles the wall once moves by a quarter of their spacing."""
NUMBERS = ("x", "y", "angle", *PlanarAxes._fields, "work")
"""What a `History` has of each instant: position of the base's centre in an unworn bearing, m,
angle of the contact from the bearing's x axis, rad, the four numbers of `PlanarAxes`, and friction
work without the coefficient of friction (normal force times sliding distance) per cycle, N m."""

History = Float[np.ndarray, "bases numbers instants"]
"""Contacts of the two bases of a journal, at instants between which equal work is done."""
Rows = Float[jax.Array | np.ndarray, "rows 2 samples"]
"""Depths of bearing and journal, or depths per cycle, m, and their derivatives by parameters."""


def contact_history(
    joint: ClearanceJoint,
    depths: Float[np.ndarray, "2 samples"],
    times: Float[np.ndarray, " T"],
    signals: Signals,
    cycles: float,
) -> History:
    """Return the contacts of a joint in a number of cycles, from their `times` and signals, after
    `depths` had worn off the joint."""
    count = INSTANTS_PER_SAMPLE * depths.shape[1]
    bases = []
    for base in BASES:
        power = np.asarray(signals[f"{base} power"])
        # Simpson's rule, as for the depths.
        work = np.diff(times)[::2] / 3.0 * (power[:-2:2] + 4.0 * power[1:-1:2] + power[2::2])
        done = np.append(0.0, np.cumsum(work))
        at = np.interp((np.arange(count) + 0.5) / count * done[-1], done, times[::2])
        rows = [f"{base} x", f"{base} y", *PlanarAxes._fields]
        x, y, *axes = (np.interp(at, times, np.asarray(signals[name])) for name in rows)
        angles, x, y = _unworn(joint, jnp.asarray(depths), x, y, PlanarAxes(*axes))
        share = np.full(count, done[-1] / (count * cycles))
        bases.append(np.stack([x, y, angles, *axes, share]))
    return np.stack(bases)


@jax.jit
def _unworn(
    joint: ClearanceJoint, depths: jax.Array, x: jax.Array, y: jax.Array, axes: PlanarAxes
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Return the contact's angle, and the journal's position if the depths had not worn off."""

    def angle_at(x: Scalar, y: Scalar, axes: PlanarAxes) -> Scalar:
        profiles = joint.bearing_profile, joint.journal_profile
        approach = JournalInBearing(x, y, *profiles, axes).closest_approach(joint.clearance)
        return jnp.arctan2(approach.sine, approach.cosine)

    angles = jnp.asarray(jax.vmap(angle_at)(x, y, axes))
    along_x, along_y = _shift(depths, angles, axes)
    return angles, x - along_x, y - along_y


def _shift(depths: jax.Array, angles: jax.Array, axes: PlanarAxes) -> tuple[jax.Array, jax.Array]:
    """Return by how much the journal's centre moves, m, along the bearing's axes x and y, if depths
    wear off while the penetration and the angle of the contact stay."""
    wall, journal = PeriodicSpline.through(depths[0]), PeriodicSpline.through(-depths[1])
    worn = JournalInBearing(0.0, 0.0, wall, journal, axes)
    # The overlap of the two parts at the contact remains, and remains the largest one.
    value, slope = jax.jvp(worn.overlap, (angles,), (jnp.ones_like(angles),))
    cosine, sine = jnp.cos(angles), jnp.sin(angles)
    return slope * sine - value * cosine, -slope * cosine - value * sine


def _wear(
    joint: ClearanceJoint,
    rates: tuple[float, float],
    history: Float[jax.Array, "bases numbers instants"],
    depths: Float[jax.Array, "2 samples"],
) -> Float[jax.Array, "2 samples"]:
    """Return the depths per cycle that wear off a joint after `depths` have worn off."""
    # Each of the `NUMBERS`, (bases * instants,): the wear of both bases is added.
    x, y, contact, *axes, work = history.swapaxes(0, 1).reshape(len(NUMBERS), -1)
    axes = PlanarAxes(*axes)
    along_x, along_y = _shift(depths, contact, axes)
    x, y = jnp.asarray(x + along_x)[:, None], jnp.asarray(y + along_y)[:, None]
    for field, removed in zip(PROFILES, (depths[0], -depths[1]), strict=True):
        joint = _moved(joint, field, removed)
    samples = depths.shape[1]
    columns = jax.tree.map(lambda row: row[:, None], axes)
    radii = joint.bearing_radius, joint.journal_radius
    per_cycle = []
    for angles, radius, rate in zip(wall_angles(columns, samples), radii, rates, strict=True):
        if rate > 0.0:
            area = radius * 2.0 * np.pi / samples * joint.journal_length
            per_cycle.append(rate / area * (work @ shares(joint, x, y, angles, columns)))
        else:
            per_cycle.append(jnp.zeros(samples))
    return jnp.stack(per_cycle)


def _moved(joint: ClearanceJoint, field: str, change: jax.Array) -> ClearanceJoint:
    """Return the joint with `change`, m at each angle, added to a profile if this is such a
    spline."""
    profile: AbstractProfile | None = getattr(joint, field)
    coefficients = getattr(profile, "coefficients", None)
    if coefficients is None or np.shape(coefficients) != change.shape:
        return joint  # a part that does not wear
    moved = jnp.asarray(coefficients) + PeriodicSpline.through(change).coefficients
    return eqx.tree_at(lambda j: getattr(j, field).coefficients, joint, moved)


@partial(jax.jit, static_argnames="rates")
def _wear_rows(
    joint: ClearanceJoint, rates: tuple[float, float], history: jax.Array, rows: jax.Array
) -> jax.Array:
    """Return `rows` of the depths per cycle and their derivatives, from those of the depths."""

    def wear(depths: jax.Array) -> jax.Array:
        return _wear(joint, rates, history, depths)

    if len(rows) == 1:
        return wear(rows[0])[None]
    value, along = jax.linearize(wear, rows[0])
    return jnp.concatenate([value[None], jax.vmap(along)(rows[1:])])


@partial(jax.jit, static_argnames="rates")
def _jacobian(
    joint: ClearanceJoint, rates: tuple[float, float], history: jax.Array, depths: jax.Array
) -> jax.Array:
    """Return the derivatives (m, m) of the m depths per cycle of the parts that wear with respect
    to their depths. Other arguments are those of `_wear`."""
    wearing = np.flatnonzero(rates)

    def wear(values: jax.Array) -> jax.Array:
        return _wear(joint, rates, history, depths.at[wearing].set(values))[wearing]

    size = len(wearing) * depths.shape[1]
    return jax.jacfwd(wear)(depths[wearing]).reshape(size, size)


class JointWear(NamedTuple):
    """Wear of one joint per cycle as a function of the depths that have worn off it.

    - `joint`: the joint, unworn, with a spline for each part that wears.
    - `rates`: wear rates of bearing and journal, m^2/N.
    - `history`: its contacts.
    - `direct`: (p, 2, samples) m per cycle, derivatives of the depths per cycle by the parameters,
      at fixed depths.
    """

    joint: ClearanceJoint
    rates: tuple[float, float]
    history: History
    direct: Float[np.ndarray, "p 2 samples"]

    def per_cycle(self, rows: Rows) -> Rows:
        """Return rows of the depths per cycle and their derivatives, from those of the depths."""
        per_cycle = np.array(_wear_rows(self.joint, self.rates, self.history, rows))
        per_cycle[1:] += self.direct
        return per_cycle

    def jacobian(self, depths: Float[np.ndarray, "2 samples"]) -> Float[np.ndarray, "m m"]:
        """Return approximate derivatives of the wear per cycle, of the parts that wear, with
        respect to their depths, from a part of the contacts."""
        some = self.history[:, :, ::INSTANTS_PER_SAMPLE].copy()
        some[:, -1] *= INSTANTS_PER_SAMPLE  # each of them does the work of those left out
        return np.asarray(_jacobian(self.joint, self.rates, some, depths))

    @property
    def wearing(self) -> tuple[int, ...]:
        """Indices of the parts that wear."""
        return tuple(np.flatnonzero(self.rates).tolist())

    def blended(self, other: "JointWear", share: float) -> "JointWear":
        """Return the wear by the contacts of this one and a share, from 0 to 1, of the other."""
        histories = [self.history.copy(), other.history.copy()]
        for history, weight in zip(histories, (1.0 - share, share), strict=True):
            history[:, -1] *= weight  # wear is proportional to the work
        direct = (1.0 - share) * self.direct + share * other.direct
        return self._replace(history=np.concatenate(histories, axis=2), direct=direct)


def grow(
    start: JointWear,
    end: JointWear | None,
    rows: Rows,
    length: float,
    rtol: float,
    atol: Float[np.ndarray, " rows"],
    depth: float | None = None,
) -> "OdeSolution":
    """Return the depths and their derivatives, flat, as a function of the number of cycles.

    The contacts are those of `start` throughout, or change evenly from those of `start` to those of
    `end`. The depths are integrated by backward differentiation formulas, with a relative tolerance
    and an absolute one of each row, m, until the deepest point reaches `depth`, m. `RuntimeError`:
    the integration failed.
    """
    from scipy.integrate import solve_ivp

    wearing = np.array(start.wearing)
    shape = len(rows), len(wearing), rows.shape[-1]

    def at(cycles: float, flat: np.ndarray) -> tuple[JointWear, np.ndarray]:
        full = np.zeros(rows.shape)
        full[:, wearing] = flat.reshape(shape)
        return start if end is None else start.blended(end, cycles / length), full

    def per_cycle(cycles: float, flat: np.ndarray) -> np.ndarray:
        wear, full = at(cycles, flat)
        return np.asarray(wear.per_cycle(full))[:, wearing].ravel()

    def jacobian(cycles: float, flat: np.ndarray) -> np.ndarray:
        # The derivatives grow by the Jacobian of the depths. How the Jacobian itself changes with
        # the depths is left out, which only adds an iteration to the solver's.
        wear, full = at(cycles, flat)
        return np.kron(np.eye(len(rows)), wear.jacobian(full[0]))

    def below(_: float, flat: np.ndarray) -> float:
        return flat[: shape[1] * shape[2]].max() - (np.inf if depth is None else depth)

    below.terminal = True
    # SciPy subtracts numbers of memory that it has not set, and never uses the differences.
    with np.errstate(all="ignore"):
        solution = solve_ivp(
            per_cycle,
            (0.0, length),
            rows[:, wearing].ravel(),
            "BDF",
            dense_output=True,
            events=None if depth is None else below,
            jac=jacobian,
            rtol=rtol,
            atol=np.repeat(atol, shape[1] * shape[2]),
        )
    if solution.status < 0:
        raise RuntimeError(solution.message)
    return solution.sol
