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
"""Number of instants of a `History` in a half of the measured cycles, divided by the number of
angles. From instant to instant, a contact that circles the wall once in this time moves by a
quarter of the spacing of the angles."""
NUMBERS = ("x", "y", "angle", *PlanarAxes._fields, "work")
"""What a `History` has of each instant: position of the base's centre in the bearing's frame if the
joint were unworn, m, angle of the contact from the bearing's x axis, rad, the four numbers of
`PlanarAxes`, and the instant's share of the normal force times sliding distance, N m per cycle."""

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
    """Compute the `History` of a joint from its `signals` at `times`, s. `depths`: m, what bearing
    and journal have lost. `cycles`: number of cycles in `times` or, if histories of several spans
    are to be joined, in all spans; the work done in `times` is divided by it (see `NUMBERS`)."""
    count = INSTANTS_PER_SAMPLE * depths.shape[1]
    bases = []
    for base in BASES:
        power = np.asarray(signals[f"{base} power"])
        # Simpson's rule, as for the depths: even times are the ends of intervals, odd times their
        # middles, so that a difference of neighbours is half an interval.
        work = np.diff(times)[::2] / 3.0 * (power[:-2:2] + 4.0 * power[1:-1:2] + power[2::2])
        done = np.append(0.0, np.cumsum(work))
        # Equal parts of the work, N m; each instant is where half of its part is done.
        work_at_instants = (np.arange(count) + 0.5) / count * done[-1]
        instants = np.interp(work_at_instants, done, times[::2])
        names = [f"{base} x", f"{base} y", *PlanarAxes._fields]
        x, y, *axes = (np.interp(instants, times, np.asarray(signals[name])) for name in names)
        # The angles of the contacts, and where the centre would be in them without the `depths`.
        angles, x, y = _unworn(joint, jnp.asarray(depths), x, y, PlanarAxes(*axes))
        work_per_cycle = np.full(count, done[-1] / (count * cycles))
        bases.append(np.stack([x, y, angles, *axes, work_per_cycle]))
    return np.stack(bases)


@jax.jit
def _unworn(
    joint: ClearanceJoint, depths: jax.Array, x: jax.Array, y: jax.Array, axes: PlanarAxes
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Return the angle of the contact, rad, of a journal with the centre at `x` and `y`, m, and the
    x and y, m, that the centre would have in this contact if the joint had not lost `depths`, (2,
    samples) m, of bearing and journal. `axes`: the journal's, in the bearing's cross-section."""

    def angle_at(x: Scalar, y: Scalar, axes: PlanarAxes) -> Scalar:
        profiles = joint.bearing_profile, joint.journal_profile
        approach = JournalInBearing(x, y, *profiles, axes).closest_approach(joint.clearance)
        return jnp.arctan2(approach.sine, approach.cosine)

    angles = jnp.asarray(jax.vmap(angle_at)(x, y, axes))
    along_x, along_y = _shift(depths, angles, axes)
    return angles, x - along_x, y - along_y


def _shift(depths: jax.Array, angles: jax.Array, axes: PlanarAxes) -> tuple[jax.Array, jax.Array]:
    """Return by how much the journal's centre moves, m, along the bearing's axes x and y, if the
    `depths`, (2, samples) m, of bearing and journal wear off. The penetration and the `angles` of
    the contact from the bearing's x axis, rad, remain the same."""
    wall, journal = PeriodicSpline.through(depths[0]), PeriodicSpline.through(-depths[1])
    worn = JournalInBearing(0.0, 0.0, wall, journal, axes)
    # The overlap of the two parts at the contact remains, and remains the largest one: the worn
    # depths change it by `value` and its derivative by `slope`, and the centre moves by -value in
    # the direction of the contact, and by -slope across it.
    value, slope = jax.jvp(worn.overlap, (angles,), (jnp.ones_like(angles),))
    cosine, sine = jnp.cos(angles), jnp.sin(angles)
    return slope * sine - value * cosine, -slope * cosine - value * sine


def _wear(
    joint: ClearanceJoint,
    rates: tuple[float, float],
    history: Float[jax.Array, "bases numbers instants"],
    depths: Float[jax.Array, "2 samples"],
) -> Float[jax.Array, "2 samples"]:
    """Return the depths of bearing and journal, m per cycle, that the contacts in `history`, a
    `History`, wear off a joint that has lost `depths`, m, already. `joint` is the unworn joint, and
    `rates` are the wear rates of bearing and journal, m^2/N."""
    # Each of the `NUMBERS`, (bases * instants,): the wear of both bases is added.
    x, y, contact_angle, *axes, work = history.swapaxes(0, 1).reshape(len(NUMBERS), -1)
    axes = PlanarAxes(*axes)
    # The journal follows the wall as it wears. Profiles are positive outward: wear adds its depth
    # to that of the bearing, and subtracts it from that of the journal.
    along_x, along_y = _shift(depths, contact_angle, axes)
    x, y = jnp.asarray(x + along_x)[:, None], jnp.asarray(y + along_y)[:, None]
    for field, change in zip(PROFILES, (depths[0], -depths[1]), strict=True):
        joint = _moved(joint, field, change)
    samples = depths.shape[1]
    columns = jax.tree.map(lambda row: row[:, None], axes)
    radii = joint.bearing_radius, joint.journal_radius
    per_cycle = []
    for angles, radius, rate in zip(wall_angles(columns, samples), radii, rates, strict=True):
        if rate > 0.0:
            # The area of the surface that belongs to one angle, m^2.
            area = radius * 2.0 * np.pi / samples * joint.journal_length
            per_cycle.append(rate / area * (work @ shares(joint, x, y, angles, columns)))
        else:
            per_cycle.append(jnp.zeros(samples))
    return jnp.stack(per_cycle)


def _moved(joint: ClearanceJoint, field: str, change: jax.Array) -> ClearanceJoint:
    """Return the joint with `change`, m at each angle, added to the profile in `field`; unchanged
    unless this profile is a spline with a knot at each angle."""
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
    """Return the result of `_wear`, m per cycle, for the depths `rows[0]`, and its derivative along
    each further row of `rows`. The other arguments are those of `_wear`."""

    # With derivatives, one linearisation serves the derivatives by all parameters.
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
    """Return the derivatives, (m, m), of the result of `_wear` by its argument `depths`. Both are
    flattened and have only the parts that wear: m is their number times that of the angles."""
    wearing = np.flatnonzero(rates)

    def wear(values: jax.Array) -> jax.Array:
        return _wear(joint, rates, history, depths.at[wearing].set(values))[wearing]

    size = len(wearing) * depths.shape[1]
    return jax.jacfwd(wear)(depths[wearing]).reshape(size, size)


class JointWear(NamedTuple):
    """Wear of one joint per cycle as a function of the depths that have worn off it.

    - `joint`: the joint, unworn, with a spline for each part that wears.
    - `rates`: wear rates of bearing and journal, m^2/N. `history`: contacts in measured cycles.
    - `direct`: derivatives of both parts' wear, m per cycle, by p parameters, at fixed depths.
    """

    joint: ClearanceJoint
    rates: tuple[float, float]
    history: History
    direct: Float[np.ndarray, "p 2 samples"]

    def per_cycle(self, rows: Rows) -> Rows:
        """Return the wear per cycle, m, in row 0, and its derivatives by parameters in the others.
        `rows`: the depths that have worn off, m, and their derivatives, in the same form."""
        per_cycle = np.array(_wear_rows(self.joint, self.rates, self.history, rows))
        per_cycle[1:] += self.direct
        return per_cycle

    def jacobian(self, depths: Float[np.ndarray, "2 samples"]) -> Float[np.ndarray, "m m"]:
        """Return the derivatives of the wear per cycle by `depths`, flattened as in `_jacobian`;
        approximate: only one in `INSTANTS_PER_SAMPLE` of the instants in `history` is used."""
        selected = self.history[:, :, ::INSTANTS_PER_SAMPLE].copy()
        # The work, the last of `NUMBERS`, is that of the selected contacts and of those left out.
        selected[:, -1] *= INSTANTS_PER_SAMPLE
        return np.asarray(_jacobian(self.joint, self.rates, selected, depths))

    @property
    def wearing(self) -> tuple[int, ...]:
        """Indices of the parts that wear: 0 for the bearing, 1 for the journal."""
        return tuple(np.flatnonzero(self.rates).tolist())

    def blended(self, other: "JointWear", share: float) -> "JointWear":
        """Return the wear by a mixture of contacts: those of `other` with the weight `share`, 0 to
        1, and those of this object with the weight 1 - `share`."""
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
    """Return a function of the number of cycles, 0 to `length`, that returns the depths (row 0) and
    their derivatives by parameters (other rows): (rows, parts that wear, samples) m, flattened.

    The contacts are those of `start` throughout, or change linearly from those of `start` to those
    of `end`. The initial values are `rows`. They are integrated by backward differentiation, with a
    relative tolerance and an absolute one for each row, m, until the deepest point reaches `depth`,
    m; without `depth`, over all cycles. `RuntimeError`: the integration failed.
    """
    from scipy.integrate import solve_ivp

    wearing = np.array(start.wearing)
    shape = len(rows), len(wearing), rows.shape[-1]

    # The solver's variables are the rows of the parts that wear, flat. A part that does not wear
    # has depths of zero.
    def wear_and_rows(cycles: float, flat: np.ndarray) -> tuple[JointWear, np.ndarray]:
        all_parts = np.zeros(rows.shape)
        all_parts[:, wearing] = flat.reshape(shape)
        return start if end is None else start.blended(end, cycles / length), all_parts

    def per_cycle(cycles: float, flat: np.ndarray) -> np.ndarray:
        wear, all_parts = wear_and_rows(cycles, flat)
        return np.asarray(wear.per_cycle(all_parts))[:, wearing].ravel()

    def jacobian(cycles: float, flat: np.ndarray) -> np.ndarray:
        # The derivatives grow by the Jacobian of the depths. How the Jacobian itself changes with
        # the depths is left out, which only adds an iteration to the solver's.
        wear, all_parts = wear_and_rows(cycles, flat)
        return np.kron(np.eye(len(rows)), wear.jacobian(all_parts[0]))

    # Row 0, the depths, comes first. The integration ends where this function rises to zero.
    def below(_: float, flat: np.ndarray) -> float:
        return flat[: shape[1] * shape[2]].max() - (np.inf if depth is None else depth)

    below.terminal = True
    # SciPy computes with entries of arrays that it has not set, and never uses the results.
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
