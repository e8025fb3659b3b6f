"""Impact of a free mass on a wall: the restitution and the peak force of a contact law."""

from dataclasses import dataclass
from functools import partial

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from jaxtyping import Float

from ..._compilation.xla import Compiled
from ..._fields.checks import require, require_positive, require_type
from ..._fields.types import Single
from ..._math.interpolation import Parabola
from ..._math.vectors import Scalar
from ..._model.clearance_joints.common import require_smaller_clearance
from ..._model.contact.laws import AbstractContactLaw, Gap, contact_normal_force
from .run_checks import check_precision

TOLERANCE = 1e-11
"""Relative tolerance of each step, and of the time at which the force ends."""
STEPS_A_CONTACT = 500
"""Smallest number of steps during the contact. The peaks are found between the ends of steps by
parabolas, which are accurate if steps are short."""
LONGEST = 100.0
"""Longest duration of a contact that is simulated, s."""
INSIDE = 1e-300
"""Penetration at the start, m, counted from the onset of the law's force. It is positive, so that a
law whose force jumps at the onset has a force from the start. If the law has an `onset_offset` that
is not zero, this small number is lost to rounding."""


@dataclass(frozen=True)
class FreeImpact:
    """Result of the impact of a free mass on a wall.

    - `restitution`: rebound speed over entry speed.
    - `peak_force`: N, largest normal force.
    - `largest_penetration`: m, counted from where the surfaces touch. The force of a law with an
      `onset_offset` begins earlier.
    - `duration`: s, time from the beginning of the force to its end.

    >>> impact = cj.free_impact(cj.laws.HuntCrossley(0.8, 1e9), mass=1.0, entry_speed=0.1)
    >>> print(f"{impact.restitution:.4f}, {impact.peak_force:.1f} N")
    0.8329, 265.8 N
    """

    restitution: float
    peak_force: float
    largest_penetration: float
    duration: float


def free_impact(
    law: AbstractContactLaw,
    mass: float,
    entry_speed: float,
    bearing_radius: float | None = None,
    clearance: float | None = None,
) -> FreeImpact:
    """Simulate the impact of a free mass on a wall, with the normal force of a contact law.

    **Arguments:**

    - `mass`: kg. `entry_speed`: m/s, speed of the mass towards the wall when the contact begins.
    - `bearing_radius`, `clearance`: m, radius of the bearing and radial clearance, if the law's
      stiffness depends on them.

    **Raises:** `ValueError` if a number is not positive, if the clearance is not smaller than the
    radius, if one of these two is missing and the stiffness depends on it, if the mass does not
    leave the wall within 100 s or 16 384 steps, or if JAX computes in 32 bits.

    >>> impact = cj.free_impact(cj.laws.Hertz(1e6, exponent=1.0), mass=1.0, entry_speed=0.1)
    >>> print(f"{impact.peak_force:.2f} N in {impact.duration * 1e3:.3f} ms")
    100.00 N in 3.142 ms
    """
    check_precision(allow_float32=False)
    remedy = "pass one of clearjoint.laws, such as cj.laws.Hertz(1e9)"
    require_type("law", law, AbstractContactLaw, "a contact law", remedy)
    require_positive("mass", mass, "give kg")
    require_positive("entry_speed", entry_speed, "give m/s")
    if bearing_radius is not None:
        require_positive("bearing_radius", bearing_radius, "give m")
    if clearance is not None:
        require_positive("clearance", clearance, "give m")
        if bearing_radius is not None:
            require_smaller_clearance(clearance, bearing_radius, "the bearing's radius")
    numbers = jnp.asarray(mass, dtype=float), jnp.asarray(entry_speed, dtype=float)
    contact = partial(_contact, law, *numbers, bearing_radius, clearance)
    # The first run, with steps of any length, finds the duration.
    first_run = contact(jnp.asarray(jnp.inf))
    # diffrax fills the rows for steps that were not taken with infinity.
    times = np.asarray(first_run.ts)
    duration = float(np.max(times, where=np.isfinite(times), initial=0.0))
    rebounds = bool(first_run.result == diffrax.RESULTS.event_occurred)
    expected = f"one from which a mass rebounds at {entry_speed} m/s"
    remedy = "raise the entry speed, or the law's `entry_speed_floor`"
    require(rebounds, "law", law, expected, remedy)
    # The peaks are found from a second run with shorter steps.
    second_run = contact(jnp.asarray(duration / STEPS_A_CONTACT))
    is_step = np.isfinite(np.asarray(second_run.ts))
    times, (depth, rate) = np.asarray(second_run.ts)[is_step], np.asarray(second_run.ys)[is_step].T
    gap = Gap(depth, rate, bearing_radius, clearance)
    force = np.asarray(contact_normal_force(law, gap, np.full_like(depth, entry_speed)))
    return FreeImpact(
        # The rate of the penetration is negative when the mass leaves the wall.
        restitution=-float(rate[-1]) / float(entry_speed),
        peak_force=_crest(times, force),
        largest_penetration=_crest(times, depth),
        duration=duration,
    )


@Compiled
def _contact(
    law: AbstractContactLaw,
    mass: Scalar,
    entry_speed: Scalar,
    bearing_radius: float | None,
    clearance: float | None,
    longest_step: Scalar,
) -> diffrax.Solution:
    """Simulate the motion of a mass, kg, that meets a wall at the entry speed, m/s, until the force
    ends, in steps of at most `longest_step`, s. In the solution, rows of `ys`, (N, 2), have the
    penetration, m, and its rate, m/s, at `ts`; those of steps that were not taken are infinite."""

    def rates(t: Single, y: Float[jax.Array, "2"], args: None) -> Float[jax.Array, "2"]:
        del t, args
        gap = Gap(y[0], y[1], bearing_radius, clearance)
        return jnp.stack([y[1], -contact_normal_force(law, gap, entry_speed) / mass])

    # The force begins and ends at a penetration of minus `offset`. With `direction=False`, only the
    # passage from larger to smaller penetrations ends the motion.
    offset = jnp.asarray(law.onset_offset(), dtype=float)
    leaving = diffrax.Event(
        lambda t, y, args, **_: y[0] + offset, optimistix.Newton(TOLERANCE, 1e-16), direction=False
    )
    # The absolute tolerances, 1e-16 s and 1e-18 (m and m/s), are far below the times and
    # penetrations of impacts, so that the relative ones decide. The first step, 1e-9 s, is far
    # shorter than an impact of usual stiffness. The limit of steps is many times larger than
    # `STEPS_A_CONTACT`.
    return diffrax.diffeqsolve(
        diffrax.ODETerm(rates),
        diffrax.Dopri8(),
        0.0,
        LONGEST,
        1e-9,
        jnp.stack([INSIDE - offset, entry_speed]),
        event=leaving,
        throw=False,
        max_steps=16384,
        saveat=diffrax.SaveAt(t0=True, steps=True, t1=True),
        stepsize_controller=diffrax.PIDController(TOLERANCE, 1e-18, dtmax=longest_step),
    )


def _crest(times: np.ndarray, values: np.ndarray) -> float:
    """Return the peak of a curve from N >= 3 values at rising times: that of a parabola through the
    largest value and its two neighbours, or through the three values at an end."""
    k = int(np.clip(np.argmax(values), 1, len(values) - 2))
    start, middle, end = values[k - 1 : k + 2]
    # The position of the middle value on the way from the first time, 0, to the last one, 1.
    x = (times[k] - times[k - 1]) / (times[k + 1] - times[k - 1])
    # The coefficient of x^2: the chords from the first value to the last and to the middle one
    # differ in slope by this coefficient times 1 - x.
    bend = ((end - start) - (middle - start) / x) / (1.0 - x)
    return float(Parabola(start, end - start - bend, bend).extremes(0.0, 1.0)[1])
