"""Check user-defined contact laws, friction laws and constraints.

Each function raises an `AssertionError` that states the first problem. Call it in a test.
"""

import warnings
from collections.abc import Callable
from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..dynamics.multipliers import row_rate
from ..math.vectors import Condition, Scalar, Vector, unpack
from ..model.bodies import Motion
from ..model.contact.bristles import AbstractBristleFriction
from ..model.contact.friction import AbstractFriction
from ..model.contact.gap import Gap
from ..model.contact.laws import UNKNOWN_ENTRY_SPEED, AbstractContactLaw
from ..model.joints.base import AbstractConstraint, Row
from .continuity import jumps
from .law_sensitivities import complaints_of_sensitivities
from .moving_bodies import moved

DEPTHS = (-1e-3, -1e-9, 0.0, 1e-12, 1e-8, 1e-6, 1e-5)
"""Penetrations at which laws are tested, m; gaps are negative."""
RATES = (-1.0, -1e-3, 0.0, 1e-6, 1e-3, 1.0)
"""Penetration rates at which laws are tested, m/s."""
ENTRY_SPEEDS = (1e-9, 1e-4, 0.1, 10.0)
"""Entry speeds at which laws are tested, m/s."""
EDGE = 1e-9
"""A jump of the force counts as one at the onset if its depth differs from that of the onset by at
most this fraction of the onset offset, or of 1e-9 m if the offset is smaller."""


Points: TypeAlias = Float[jax.Array, " N"]
"""Depths in m, rates or speeds in m/s, or forces in N at N points."""


def ensure(condition: Condition, message: str) -> None:
    """Raise an `AssertionError` with `message` unless all elements of `condition` are true."""
    if not bool(jnp.all(condition)):
        raise AssertionError(message)


def check_law(
    law: AbstractContactLaw, bearing_radius: float = 10e-3, clearance: float = 0.5e-3
) -> None:
    """Check that a contact law for the normal force is consistent.

    The check evaluates the law for penetrations up to 10 µm, penetration rates up to 1 m/s and
    entry speeds up to 10 m/s. It demands that

    - the force is finite, not negative, and zero before the onset;
    - the stored energy is the integral of the elastic force over the penetration, and the
      difference of force and elastic force dissipates energy;
    - the derivatives of the force by penetration, rate, entry speed and each parameter of the law
      are finite, and agree with finite differences;
    - the force jumps only at the onset and at separation, where integration steps end. The law must
      declare such a jump (`AbstractContactLaw.force_jumps`), and the check warns of it;
    - the force is the elastic force if the entry speed is unknown;
    - `jax.vmap` gives the same result as a single evaluation.

    **Arguments:** `law`: the contact law; `bearing_radius`, `clearance`: radius of the bearing and
    radial clearance, m, for stiffnesses that depend on them.

    **Raises:** `AssertionError` that states the first problem.

    **Warns:** `UserWarning` for a declared jump at the onset or at separation.

    >>> testing.check_law(cj.laws.HuntCrossley(0.8, 1e9))
    """
    wall = (jnp.asarray(bearing_radius), jnp.asarray(clearance))
    depth, rate, entry = _grid(DEPTHS, RATES, ENTRY_SPEEDS)

    def force(depth: Scalar, rate: Scalar, entry: Scalar, law: AbstractContactLaw) -> jax.Array:
        force = law.force(Gap(depth, rate, *wall), entry if law.uses_entry_speed else None)
        return jnp.asarray(force)

    def elastic(depth: Scalar) -> Scalar:
        return law.elastic_force(Gap(depth, jnp.zeros_like(depth), *wall))

    def energy(depth: Scalar) -> Scalar:
        return law.stored_energy(Gap(depth, jnp.zeros_like(depth), *wall))

    forces = jax.vmap(force, in_axes=(0, 0, 0, None))(depth, rate, entry, law)
    ensure(jnp.isfinite(forces), "The force is not finite everywhere.")
    ensure(forces >= 0.0, "The force is negative somewhere: clamp it at zero.")
    outside = depth < -jnp.asarray(law.onset_offset())
    ensure(jnp.where(outside, forces, 0.0) == 0.0, "There is a force before onset_offset().")
    lanes = zip(depth[:9], rate, entry, strict=False)
    single = jnp.stack([force(d, r, e, law) for d, r, e in lanes])
    same = jnp.allclose(single, forces[:9])
    ensure(same, "The force under vmap differs from a single evaluation.")
    dissipation = (forces - jax.vmap(elastic)(depth)) * rate
    scale = 1e-9 * (1.0 + jnp.abs(forces * rate))
    ensure(dissipation >= -scale, "The law creates energy: (force - elastic_force) rate < 0.")
    _check_energy(elastic, energy)
    _check_derivatives(force, law, depth, rate, entry)
    for complaint in complaints_of_sensitivities(force, law):
        raise AssertionError(complaint)
    if law.uses_entry_speed:
        _check_unknown_entry(force, elastic, law)
    _check_jumps(jax.vmap(force, in_axes=(0, 0, 0, None)), law)


def _check_unknown_entry(
    force: Callable[..., Scalar], elastic: Callable[[Scalar], Scalar], law: AbstractContactLaw
) -> None:
    depth, rate = _grid(DEPTHS, RATES)
    unknown = jnp.full_like(depth, UNKNOWN_ENTRY_SPEED)
    forces = jax.vmap(force, in_axes=(0, 0, 0, None))(depth, rate, unknown, law)
    ensure(
        jnp.allclose(forces, jax.vmap(elastic)(depth), rtol=1e-6, atol=1e-12),
        "The force at an unknown entry speed, which is represented by a very large value, is not "
        "the elastic force.",
    )


def _check_jumps(force: Callable[..., Points], law: AbstractContactLaw) -> None:
    left, rate, entry = _grid(DEPTHS[:-1], RATES, ENTRY_SPEEDS)
    right = _grid(DEPTHS[1:], RATES, ENTRY_SPEEDS)[0]
    sizes, depths = jumps(lambda depth: force(depth, rate, entry, law), left, right)
    offset = jnp.asarray(law.onset_offset(), float)
    at_edge = jnp.abs(depths + offset) <= EDGE * jnp.maximum(offset, EDGE)
    inside = jnp.where(at_edge, 0.0, sizes)
    k = int(jnp.argmax(jnp.abs(inside)))
    ensure(
        inside[k] == 0.0,
        f"The force jumps by {inside[k]:.3g} N inside the contact, at a depth of {depths[k]:.3g} m "
        f"and a rate of {rate[k]:.3g} m/s, where no integration step ends: smooth it.",
    )
    depth, slow, entry_of_rate = _grid(DEPTHS, RATES[:-1], ENTRY_SPEEDS)
    fast = _grid(DEPTHS, RATES[1:], ENTRY_SPEEDS)[1]
    by_rate, rates = jumps(lambda rate: force(depth, rate, entry_of_rate, law), slow, fast)
    k = int(jnp.argmax(jnp.abs(by_rate)))
    ensure(
        by_rate[k] == 0.0,
        f"The force jumps by {by_rate[k]:.3g} N with the rate, at {rates[k]:.3g} m/s and a depth "
        f"of {depth[k]:.3g} m, where no integration step ends: smooth it.",
    )
    _warn_of_edge(law, jnp.where(at_edge, sizes, 0.0), rate)


def _warn_of_edge(law: AbstractContactLaw, sizes: Points, rate: Points) -> None:
    """Warn of the largest jump of the force at the onset or at separation, if there is a jump.

    **Arguments:** `law`: the law, which must declare such jumps by `force_jumps`; `sizes`: (N,) N,
    of the jumps, zero for none; `rate`: (N,) m/s, their penetration rates.

    **Raises:** `AssertionError` for a jump that the law does not declare.
    """
    k = int(jnp.argmax(jnp.abs(sizes)))
    if sizes[k] == 0.0:
        return
    statement = (
        f"The force jumps by {sizes[k]:.3g} N where contact begins or ends, at a rate of "
        f"{rate[k]:.3g} m/s"
    )
    ensure(law.force_jumps, f"{statement}, but the law declares `force_jumps = False`.")
    warnings.warn(
        f"{statement}. Integration steps end there and `sensitivities` includes the effect of the "
        "jump, but direct differentiation of `simulate` does not. If the jump is unintended, let "
        "the damping grow with the depth.",
        stacklevel=4,
    )


def _grid(*rows: tuple[float, ...]) -> list[Points]:
    """Return all N combinations of one value of each row, as one array (N,) for each row."""
    return [jnp.asarray(axis.ravel()) for axis in np.meshgrid(*rows, indexing="ij")]


def _check_energy(elastic: Callable[[Scalar], Scalar], energy: Callable[[Scalar], Scalar]) -> None:
    depths = jnp.asarray([-1e-3, 0.0, 1e-9, 1e-6, 1e-5])
    slope = jax.vmap(jax.grad(energy))(depths)
    expected = jax.vmap(elastic)(depths)
    close = jnp.allclose(slope, expected, rtol=1e-9, atol=1e-12)
    ensure(close, "stored_energy is not the integral of elastic_force over the depth.")


def _check_derivatives(
    force: Callable[..., Scalar],
    law: AbstractContactLaw,
    depth: Points,
    rate: Points,
    entry: Points,
) -> None:
    slopes = jax.vmap(jax.grad(force, argnums=(0, 1, 2)), in_axes=(0, 0, 0, None))
    for name, slope in zip(
        ("depth", "rate", "entry speed"), slopes(depth, rate, entry, law), strict=True
    ):
        ensure(jnp.isfinite(slope), f"The derivative by the {name} is not finite everywhere.")
    by_law = eqx.filter_vmap(
        eqx.filter_grad(lambda law, d, r, e: force(d, r, e, law)), in_axes=(None, 0, 0, 0)
    )(jax.tree.map(jnp.asarray, law), depth, rate, entry)
    for leaf in jax.tree.leaves(by_law):
        ensure(jnp.isfinite(leaf), "The derivative by a parameter of the law is not finite.")
    step = 1e-9
    inside = (depth > 1e-7) & (rate > 0.0)
    difference = [
        jax.vmap(force, in_axes=(0, 0, 0, None))(depth + s * step, rate, entry, law)
        for s in (0.5, -0.5)
    ]
    numeric = (difference[0] - difference[1]) / step
    exact = slopes(depth, rate, entry, law)[0]
    near = jnp.abs(numeric - exact) <= 1e-4 * jnp.abs(exact) + 1e-3
    ensure(~inside | near, "The derivative by the depth does not agree with finite differences.")


def check_friction(friction: AbstractFriction) -> None:
    """Check that a friction law without bristles is consistent.

    The check evaluates the law for slips up to 1 m/s. It demands that

    - the friction opposes the slip, is zero without slip, and doesn't jump;
    - the derivatives by the slip and by the parameters of the law are finite, even without slip;
    - `jax.vmap` gives the same result as a single evaluation.

    **Raises:** `AssertionError` that states the first problem.

    >>> testing.check_friction(cj.frictions.RegularisedCoulomb(0.1))
    """
    speeds = jnp.asarray([0.0, 1e-9, 1e-4, 1e-3, 1e-2, 1.0])
    ratio = jax.vmap(lambda speed: jnp.asarray(friction.ratio(speed)))
    ratios = ratio(speeds)
    ensure(ratios >= 0.0, "ratio() is negative somewhere: friction would drive the slip.")
    ensure(ratios[0] == 0.0, "ratio(0) is not zero: the force would jump at rest.")
    sizes, at = jumps(ratio, speeds[:-1], speeds[1:])
    k = int(jnp.argmax(jnp.abs(sizes)))
    ensure(sizes[k] == 0.0, f"ratio() jumps by {sizes[k]:.3g} at {at[k]:.3g} m/s: smooth it.")
    single = jnp.stack([jnp.asarray(friction.ratio(speed)) for speed in speeds])
    same = jnp.allclose(single, ratios)
    ensure(same, "ratio() under vmap differs from a single evaluation.")
    by_friction = eqx.filter_vmap(
        eqx.filter_grad(lambda law, speed: law.force(1.0, Vector(speed, 0.0, 0.0)).x),
        in_axes=(None, 0),
    )(jax.tree.map(jnp.asarray, friction), speeds)
    for leaf in jax.tree.leaves(by_friction):
        ensure(jnp.isfinite(leaf), "The derivative by a parameter of the law is not finite.")

    def force(slip: jax.Array) -> Scalar:
        return friction.force(1.0, Vector(slip[0], slip[1], slip[2])).x

    for slip in ([0.0, 0.0, 0.0], [1e-4, 0.0, 0.0], [0.3, -0.2, 0.1]):
        slope = jax.jacfwd(force)(jnp.asarray(slip))
        ensure(jnp.isfinite(slope), f"The force's derivative is not finite at slip {slip} m/s.")


def check_bristles(friction: AbstractBristleFriction) -> None:
    """Check that a friction law with bristles is consistent.

    The check evaluates the law for bristle deflections up to ten times the full deflection and
    slips up to 1 m/s. It demands that

    - the deflection is constant without slip, and shrinks in sliding if it is too large;
    - the stored energy is zero without deflection and never negative;
    - the derivatives by the deflection, the slip and the parameters of the law are finite, even
      without slip;
    - `jax.vmap` gives the same result as a single evaluation.

    **Raises:** `AssertionError` that states the first problem.

    >>> testing.check_bristles(cj.frictions.LuGre(breakaway=0.2, kinetic=0.1, stribeck_speed=0.01))
    """
    full = jnp.asarray(friction.full_deflection(), float)
    ensure(full > 0.0, "full_deflection() is not positive.")
    ratios = jnp.asarray([0.0, 1e-6, 0.1, 0.5, 0.9, 1.0, 10.0])
    speeds = jnp.asarray([0.0, 1e-9, 1e-4, 1e-2, 1.0])
    deflection, speed = (
        axis.ravel() for axis in jnp.meshgrid(ratios * full, speeds, indexing="ij")
    )

    def along(law: AbstractBristleFriction, z: Scalar, v: Scalar) -> tuple[Scalar, Scalar]:
        bristles, slip = Vector(z * 0.6, z * 0.8, 0.0), Vector(v, 0.0, 0.0)
        rate = law.rate(bristles, slip)
        return rate.dot(bristles), law.ratio(bristles, rate, slip).x

    growth, ratio = jax.vmap(along, in_axes=(None, 0, 0))(friction, deflection, speed)
    ensure(jnp.isfinite(ratio), "The friction is not finite everywhere.")
    sticks = speed == 0.0
    ensure(jnp.where(sticks, growth, 0.0) == 0.0, "rate() without slip is not zero: it creeps.")
    slides = (deflection > 5.0 * full) & ~sticks
    message = "A deflection of ten times full_deflection() does not shrink in sliding."
    ensure(~slides | (growth < 0.0), message)
    none = Vector(0.0, 0.0, 0.0)
    at_rest = friction.ratio(none, none, none)
    ensure(jnp.asarray(list(at_rest)) == 0.0, "There is friction without deflection and slip.")
    stored = jnp.stack(
        [jnp.asarray(friction.stored_energy(Vector(0.0, z, 0.0))) for z in ratios * full]
    )
    ensure(
        (stored[0] == 0.0) & (stored >= 0.0),
        "stored_energy() is negative, or not zero without deflection.",
    )
    ensure(
        jax.vmap(friction.sliding_ratio)(speeds) * jnp.ones_like(speeds) >= 0.0,
        "sliding_ratio() is negative somewhere: friction would drive the slip.",
    )
    single = jnp.stack([along(friction, z, v)[1] for z, v in zip(deflection, speed, strict=True)])
    same = jnp.allclose(single, ratio)
    ensure(same, "The friction under vmap differs from a single evaluation.")
    _check_bristle_derivatives(along, friction, deflection, speed)


def _check_bristle_derivatives(
    along: Callable[..., tuple[Scalar, Scalar]],
    friction: AbstractBristleFriction,
    deflection: Points,
    speed: Points,
) -> None:
    for part, name in enumerate(("rate", "ratio")):

        def value(law: AbstractBristleFriction, z: Scalar, v: Scalar, part: int = part) -> Scalar:
            return along(law, z, v)[part]

        slopes = jax.vmap(jax.grad(value, argnums=(1, 2)), in_axes=(None, 0, 0))
        by_law = eqx.filter_vmap(eqx.filter_grad(value), in_axes=(None, 0, 0))
        packed = jax.tree.map(jnp.asarray, friction)
        for leaf in jax.tree.leaves(
            (slopes(friction, deflection, speed), by_law(packed, deflection, speed))
        ):
            ensure(jnp.isfinite(leaf), f"A derivative of {name}() is not finite everywhere.")


def check_constraint(
    constraint: AbstractConstraint, motions: dict[str, Motion], tolerance: float = 1e-6
) -> None:
    """Check the constraint rows of a joint: Jacobian, time rate and bias agree with central
    differences in time.

    **Arguments:**

    - `constraint`: the joint.
    - `motions`: motion of each body of the joint at time 0, from `moving`, by the body's name;
      include "ground" if the joint has it. Translating and rotating bodies make the strictest test.
    - `tolerance`: largest accepted difference, relative to one plus the size of the rate.

    **Raises:** `AssertionError` that states the row and the first problem.

    >>> motions = {
    ...     "ground": testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0)),
    ...     "arm": testing.moving((0.1, 0.2, 0.3), (1, 0.1, 0.2, 0.3), (1, 2, 3), (3, 2, 1)),
    ... }
    >>> joint = cj.SphericalJoint("ground", "arm", (0, 0, 0), (-0.5, 0, 0))
    >>> testing.check_constraint(joint, motions)
    """
    step = 1e-5
    constraint = unpack(constraint)
    rows = constraint.rows(motions, 0.0)
    ahead = constraint.rows(moved(motions, step), step)
    behind = constraint.rows(moved(motions, -step), -step)
    ensure(rows.keys() == ahead.keys(), "The names of the rows change with the motion.")
    for label, row in rows.items():
        rate = (ahead[label].value - behind[label].value) / (2 * step)
        expected = row_rate(row, motions)
        size = 1.0 + abs(float(expected))
        ensure(
            abs(float(rate - expected)) < tolerance * size,
            f"Row {label!r}: the Jacobian times the velocities, plus the time rate, is not the "
            "rate of the value.",
        )
        _check_bias(label, row, motions, (behind[label], ahead[label]), step, tolerance)


# The bias is the rate of a row's value rate at constant velocities: the part of the second time
# derivative that accelerations do not cause.
def _check_bias(
    label: str,
    row: Row,
    motions: dict[str, Motion],
    around: tuple[Row, Row],
    step: float,
    tolerance: float,
) -> None:
    rates = [
        float(row_rate(r, moved(motions, s))) for r, s in zip(around, (-step, step), strict=True)
    ]
    bias = (rates[1] - rates[0]) / (2 * step)
    ensure(
        abs(bias - float(row.bias)) < 10 * tolerance * (1.0 + abs(bias)),
        f"Row {label!r}: the bias is not the rate of (Jacobian times velocities, plus time rate) "
        "at constant velocities and body spins.",
    )
