"""Conformance checks for laws and joints of one's own. Each raises an ``AssertionError`` that says
what is wrong; call them from a test."""

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
RATES = (-1.0, -1e-3, 0.0, 1e-6, 1e-3, 1.0)
ENTRY_SPEEDS = (1e-9, 1e-4, 0.1, 10.0)
EDGE = 1e-9
"""How near to where the force begins, m and as a part of the reach, a jump is that of the onset."""


Places: TypeAlias = Float[jax.Array, " N"]
"""Depths in m, rates or speeds in m/s at N places; or forces in N there."""


def _require(condition: Condition, message: str) -> None:
    if not bool(jnp.all(condition)):
        raise AssertionError(message)


def check_law(
    law: AbstractContactLaw, bearing_radius: float = 10e-3, clearance: float = 0.5e-3
) -> None:
    """Check a normal law: sign, onset, energy, dissipation, derivatives, jumps, behaviour under
    vmap, sensitivities to rate, entry speed and each of its numbers against differences, and that
    an unknown entry speed means elastic contact.

    A force may jump where contact begins or ends, as that of a parallel damper does, unless the law
    declares that it does not (`AbstractContactLaw.force_jumps`); a `UserWarning` tells of it. It
    must not jump elsewhere, where no step lands.

    **Arguments:** `bearing_radius` and radial `clearance` in m, for stiffnesses that need them.

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
    _require(jnp.isfinite(forces), "The force is not finite everywhere.")
    _require(forces >= 0.0, "The force is negative somewhere: clamp it at zero.")
    outside = depth < -jnp.asarray(law.onset_offset())
    _require(jnp.where(outside, forces, 0.0) == 0.0, "There is a force beyond the law's reach().")
    one = jnp.stack([force(d, r, e, law) for d, r, e in zip(depth[:9], rate, entry, strict=False)])
    _require(jnp.allclose(one, forces[:9]), "The force under vmap differs from that of one lane.")
    dissipation = (forces - jax.vmap(elastic)(depth)) * rate
    scale = 1e-9 * (1.0 + jnp.abs(forces * rate))
    _require(dissipation >= -scale, "The law creates energy: (force - elastic_force) rate < 0.")
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
    _require(
        jnp.allclose(forces, jax.vmap(elastic)(depth), rtol=1e-6, atol=1e-12),
        "The force of a contact whose impact was not seen, for which a vast entry speed stands, is "
        "not the elastic one.",
    )


def _check_jumps(force: Callable[..., Places], law: AbstractContactLaw) -> None:
    left, rate, entry = _grid(DEPTHS[:-1], RATES, ENTRY_SPEEDS)
    right = _grid(DEPTHS[1:], RATES, ENTRY_SPEEDS)[0]
    sizes, places = jumps(lambda depth: force(depth, rate, entry, law), left, right)
    reach = jnp.asarray(law.onset_offset(), float)
    at_edge = jnp.abs(places + reach) <= EDGE * jnp.maximum(reach, EDGE)
    inside = jnp.where(at_edge, 0.0, sizes)
    k = int(jnp.argmax(jnp.abs(inside)))
    _require(
        inside[k] == 0.0,
        f"The force jumps by {inside[k]:.3g} N inside of the contact, at a depth of "
        f"{places[k]:.3g} m and a rate of {rate[k]:.3g} m/s: no step lands there; smooth it.",
    )
    depth, slow, entry_of_rate = _grid(DEPTHS, RATES[:-1], ENTRY_SPEEDS)
    fast = _grid(DEPTHS, RATES[1:], ENTRY_SPEEDS)[1]
    by_rate, rates = jumps(lambda rate: force(depth, rate, entry_of_rate, law), slow, fast)
    k = int(jnp.argmax(jnp.abs(by_rate)))
    _require(
        by_rate[k] == 0.0,
        f"The force jumps by {by_rate[k]:.3g} N with the rate, at {rates[k]:.3g} m/s and a depth "
        f"of {depth[k]:.3g} m: no step lands there; smooth it.",
    )
    _tell_of_edge(law, jnp.where(at_edge, sizes, 0.0), rate)


def _tell_of_edge(law: AbstractContactLaw, sizes: Places, rate: Places) -> None:
    """Say what the force does where contact begins and ends, from its jumps there at some rates."""
    k = int(jnp.argmax(jnp.abs(sizes)))
    if sizes[k] == 0.0:
        return
    statement = (
        f"The force jumps by {sizes[k]:.3g} N where contact begins or ends, at a rate of "
        f"{rate[k]:.3g} m/s"
    )
    _require(law.force_jumps, f"{statement}, but the law declares `force_jumps = False`.")
    warnings.warn(
        f"{statement}. Steps land there and sensitivities have the jump's own term, but plain "
        "differentiation of `simulate` has not. If it is not meant, let the damping grow with the "
        "depth.",
        stacklevel=4,
    )


def _grid(*rows: tuple[float, ...]) -> list[Places]:
    """All combinations of the rows' values, a flat array for each row."""
    return [jnp.asarray(axis.ravel()) for axis in np.meshgrid(*rows, indexing="ij")]


def _check_energy(elastic: Callable[[Scalar], Scalar], energy: Callable[[Scalar], Scalar]) -> None:
    depths = jnp.asarray([-1e-3, 0.0, 1e-9, 1e-6, 1e-5])
    slope = jax.vmap(jax.grad(energy))(depths)
    expected = jax.vmap(elastic)(depths)
    close = jnp.allclose(slope, expected, rtol=1e-9, atol=1e-12)
    _require(close, "stored_energy is not the integral of elastic_force over the depth.")


def _check_derivatives(
    force: Callable[..., Scalar],
    law: AbstractContactLaw,
    depth: Places,
    rate: Places,
    entry: Places,
) -> None:
    slopes = jax.vmap(jax.grad(force, argnums=(0, 1, 2)), in_axes=(0, 0, 0, None))
    for name, slope in zip(
        ("depth", "rate", "entry speed"), slopes(depth, rate, entry, law), strict=True
    ):
        _require(jnp.isfinite(slope), f"The derivative by the {name} is not finite everywhere.")
    by_law = eqx.filter_vmap(
        eqx.filter_grad(lambda law, d, r, e: force(d, r, e, law)), in_axes=(None, 0, 0, 0)
    )(jax.tree.map(jnp.asarray, law), depth, rate, entry)
    for leaf in jax.tree.leaves(by_law):
        _require(jnp.isfinite(leaf), "The derivative by a parameter of the law is not finite.")
    step = 1e-9
    inside = (depth > 1e-7) & (rate > 0.0)
    difference = [
        jax.vmap(force, in_axes=(0, 0, 0, None))(depth + s * step, rate, entry, law)
        for s in (0.5, -0.5)
    ]
    numeric = (difference[0] - difference[1]) / step
    exact = slopes(depth, rate, entry, law)[0]
    near = jnp.abs(numeric - exact) <= 1e-4 * jnp.abs(exact) + 1e-3
    _require(~inside | near, "The derivative by the depth is not that of the force.")


def check_friction(friction: AbstractFriction) -> None:
    """Check a friction law: against the slip, zero without it, finite derivatives at rest, by its
    parameters too, and behaviour under vmap.

    >>> testing.check_friction(cj.frictions.RegularisedCoulomb(0.1))
    """
    speeds = jnp.asarray([0.0, 1e-9, 1e-4, 1e-3, 1e-2, 1.0])
    ratio = jax.vmap(lambda speed: jnp.asarray(friction.ratio(speed)))
    ratios = ratio(speeds)
    _require(ratios >= 0.0, "ratio() is negative somewhere: friction would drive the slip.")
    _require(ratios[0] == 0.0, "ratio(0) is not zero: the force would jump at rest.")
    sizes, places = jumps(ratio, speeds[:-1], speeds[1:])
    k = int(jnp.argmax(jnp.abs(sizes)))
    _require(sizes[k] == 0.0, f"ratio() jumps by {sizes[k]:.3g} at {places[k]:.3g} m/s: smooth it.")
    one = jnp.stack([jnp.asarray(friction.ratio(speed)) for speed in speeds])
    _require(jnp.allclose(one, ratios), "ratio() under vmap differs from that of one lane.")
    by_friction = eqx.filter_vmap(
        eqx.filter_grad(lambda law, speed: law.force(1.0, Vector(speed, 0.0, 0.0)).x),
        in_axes=(None, 0),
    )(jax.tree.map(jnp.asarray, friction), speeds)
    for leaf in jax.tree.leaves(by_friction):
        _require(jnp.isfinite(leaf), "The derivative by a parameter of the law is not finite.")

    def force(slip: jax.Array) -> Scalar:
        return friction.force(1.0, Vector(slip[0], slip[1], slip[2])).x

    for slip in ([0.0, 0.0, 0.0], [1e-4, 0.0, 0.0], [0.3, -0.2, 0.1]):
        slope = jax.jacfwd(force)(jnp.asarray(slip))
        _require(jnp.isfinite(slope), f"The force's derivative is not finite at slip {slip} m/s.")


def check_bristles(friction: AbstractBristleFriction) -> None:
    """Check a bristle law: it sticks without slip, sliding bounds the deflection, it stores no
    negative energy, derivatives are finite at rest, by its parameters too, and vmap gives what one
    lane does.

    >>> testing.check_bristles(cj.frictions.LuGre(breakaway=0.2, kinetic=0.1, stribeck_speed=0.01))
    """
    full = jnp.asarray(friction.full_deflection(), float)
    _require(full > 0.0, "full_deflection() is not positive.")
    shares = jnp.asarray([0.0, 1e-6, 0.1, 0.5, 0.9, 1.0, 10.0])
    speeds = jnp.asarray([0.0, 1e-9, 1e-4, 1e-2, 1.0])
    deflection, speed = (
        axis.ravel() for axis in jnp.meshgrid(shares * full, speeds, indexing="ij")
    )

    def along(law: AbstractBristleFriction, z: Scalar, v: Scalar) -> tuple[Scalar, Scalar]:
        bristles, slip = Vector(z * 0.6, z * 0.8, 0.0), Vector(v, 0.0, 0.0)
        rate = law.rate(bristles, slip)
        return rate.dot(bristles), law.ratio(bristles, rate, slip).x

    growth, ratio = jax.vmap(along, in_axes=(None, 0, 0))(friction, deflection, speed)
    _require(jnp.isfinite(ratio), "The friction is not finite everywhere.")
    sticks = speed == 0.0
    _require(jnp.where(sticks, growth, 0.0) == 0.0, "rate() without slip is not zero: it creeps.")
    slides = (deflection > 5.0 * full) & ~sticks
    _require(~slides | (growth < 0.0), "Ten full deflections do not shrink as it slides.")
    none = Vector(0.0, 0.0, 0.0)
    at_rest = friction.ratio(none, none, none)
    _require(jnp.asarray(list(at_rest)) == 0.0, "There is friction without deflection and slip.")
    held = jnp.stack(
        [jnp.asarray(friction.stored_energy(Vector(0.0, z, 0.0))) for z in shares * full]
    )
    _require(
        (held[0] == 0.0) & (held >= 0.0),
        "stored_energy() is negative, or not zero without deflection: nothing is stored there.",
    )
    _require(
        jax.vmap(friction.sliding_ratio)(speeds) * jnp.ones_like(speeds) >= 0.0,
        "sliding_ratio() is negative somewhere: friction would drive the slip.",
    )
    one = jnp.stack([along(friction, z, v)[1] for z, v in zip(deflection, speed, strict=True)])
    _require(jnp.allclose(one, ratio), "The friction under vmap differs from that of one lane.")
    _check_bristle_derivatives(along, friction, deflection, speed)


def _check_bristle_derivatives(
    along: Callable[..., tuple[Scalar, Scalar]],
    friction: AbstractBristleFriction,
    deflection: Places,
    speed: Places,
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
            _require(jnp.isfinite(leaf), f"A derivative of {name}() is not finite everywhere.")


def check_constraint(
    constraint: AbstractConstraint, motions: dict[str, Motion], tolerance: float = 1e-6
) -> None:
    """Check a joint's rows at given motions: the rate of each value against its Jacobian, and the
    bias against the rate's own rate, by central differences along the motion.

    **Arguments:** `motions` of the joint's bodies; moving and turning ones test most.

    >>> motions = {
    ...     "ground": testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0)),
    ...     "arm": testing.moving((0.1, 0.2, 0.3), (1, 0.1, 0.2, 0.3), (1, 2, 3), (3, 2, 1)),
    ... }
    >>> joint = cj.SphericalJoint("ground", "arm", (0, 0, 0), (-0.5, 0, 0))
    >>> testing.check_constraint(joint, motions)
    """
    step = 1e-5
    constraint = unpack(constraint)
    here = constraint.rows(motions, 0.0)
    ahead = constraint.rows(moved(motions, step), step)
    behind = constraint.rows(moved(motions, -step), -step)
    _require(here.keys() == ahead.keys(), "The names of the rows change with the motion.")
    for label, row in here.items():
        rate = (ahead[label].value - behind[label].value) / (2 * step)
        expected = row_rate(row, motions)
        size = 1.0 + abs(float(expected))
        _require(
            abs(float(rate - expected)) < tolerance * size,
            f"Row {label!r}: the Jacobian times the velocities, plus the time rate, is not the "
            "rate of the value.",
        )
        _check_bias(label, row, motions, (behind[label], ahead[label]), step, tolerance)


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
    _require(
        abs(bias - float(row.bias)) < 10 * tolerance * (1.0 + abs(bias)),
        f"Row {label!r}: the bias is not the rate of (Jacobian times velocities, plus time rate) "
        "at constant velocities and body spins.",
    )
