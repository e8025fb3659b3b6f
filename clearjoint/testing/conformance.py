"""Check user-defined contact laws, friction laws and constraints."""

import warnings
from collections.abc import Callable, Mapping
from functools import partial
from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, PyTree

from .._fields.checks import require
from .._fields.types import ArrayLike
from .._math.vectors import Condition, Scalar, Vector, unpack
from .._model.bodies import Motion
from .._model.contact.friction import AbstractBristleFriction, AbstractFriction
from .._model.contact.laws import UNKNOWN_ENTRY_SPEED, AbstractContactLaw, Gap, require_instance
from .._model.joints.base import AbstractConstraint, AbstractElement
from .._model.joints.constraint_rows import row_rate
from .continuity import jumps, moved

DEPTHS = (-1e-3, -1e-9, 0.0, 1e-12, 1e-8, 1e-6, 1e-5)
"""Penetrations at which laws are tested, m; gaps are negative."""
RATES = (-1.0, -1e-3, 0.0, 1e-6, 1e-3, 1.0)
"""Penetration rates at which laws are tested, m/s."""
ENTRY_SPEEDS = (1e-9, 1e-4, 0.1, 10.0)
"""Entry speeds at which laws are tested, m/s."""
EDGE = 1e-9
"""A jump counts as one at the onset if its depth differs from that of the onset by at most this
fraction of the onset offset or, if the offset is below 1e-9 m, of 1e-9 m."""
SMOOTH = (
    (1.3e-6, 2e-3, 0.11),
    (1.3e-6, 0.07, 0.11),
    (1.3e-6, -3e-3, 0.11),
    (7e-6, 0.9, 10.0),
    (7e-6, -3e-3, 10.0),
    (1e-5, 1e-3, 1e-4),
)
"""Points at which usual laws are smooth: penetration, m, its rate, m/s, and entry speed, m/s.
There, derivatives are compared with finite differences."""
STEP = 1e-6
"""Relative step of central differences, whose error is about 1e-10: the step squared, plus the
rounding error divided by the step."""
TOLERANCE = 1e-5
"""Largest error of the derivative of a force by a factor with which a number is multiplied,
relative to the derivative plus a thousandth of the force; far above that of finite differences."""
SINGLE = 9
"""Number of points at which a function is also evaluated singly, which is slow."""

Points: TypeAlias = Float[jax.Array, " N"]
"""Depths in m, rates or speeds in m/s, or forces in N at N points."""


def ensure(condition: Condition, message: str) -> None:
    """Raise an `AssertionError` with `message` unless all elements of `condition` are true."""
    if not bool(jnp.all(condition)):
        raise AssertionError(message)


def motions_of(element: AbstractElement, motions: Mapping[str, Motion]) -> dict[str, Motion]:
    """Return the motions of an element's bodies; a `ValueError` if one is missing."""
    for name in element.body_names():
        expected, remedy = f"with the motion of {name!r}", "add it, from testing.moving(...)"
        require(name in motions, "motions", sorted(motions), expected, remedy)
    return {name: motions[name] for name in element.body_names()}


def evaluated(name: str, function: Callable[..., Scalar], law: PyTree, *points: Points) -> Points:
    """Return the values, (N,), of a scalar function of a law and of further numbers, the `points`.

    **Raises:** `AssertionError`, with the `name` of the function, if a value is not finite or if
    `jax.vmap` gives another value than a single evaluation.
    """
    values = jnp.asarray(jax.vmap(function, in_axes=(None, *(0 for _ in points)))(law, *points))
    ensure(jnp.isfinite(values), f"{name} is not finite everywhere.")
    few = zip(*(rows[:SINGLE] for rows in points), strict=True)  # a tuple of numbers for each point
    single = jnp.stack([jnp.asarray(function(law, *point)) for point in few])
    same = jnp.allclose(single, values[:SINGLE])
    ensure(same, f"{name} under vmap differs from a single evaluation.")
    return values


def ensure_finite_slopes(function: Callable[..., Scalar], law: PyTree, **points: Points) -> None:
    """Raise an `AssertionError` unless all derivatives of a scalar function are finite. Its
    arguments are a law and one number from each of the `points`, by name. The derivatives are by
    the parameters of the law and by these numbers, at each of the N points."""
    arguments = jax.tree.map(jnp.asarray, law), *points.values()
    # Derivatives by all arguments at once. The law is the same at all points.
    gradient = eqx.filter_grad(lambda arguments: function(*arguments))
    slopes = eqx.filter_vmap(gradient, in_axes=((None, *(0 for _ in points)),))(arguments)
    names = ("a parameter of the law", *(f"the {name.replace('_', ' ')}" for name in points))
    for name, slope in zip(names, slopes, strict=True):
        for leaf in jax.tree.leaves(slope):
            ensure(jnp.isfinite(leaf), f"The derivative by {name} is not finite everywhere.")


def check_law(
    law: AbstractContactLaw, bearing_radius: float = 10e-3, clearance: float = 0.5e-3
) -> None:
    """Check that a contact law for the normal force is consistent.

    The check evaluates the law for penetrations up to 10 µm, penetration rates up to 1 m/s and
    entry speeds (rates at the onset of the contact) up to 10 m/s. It demands that

    - the force is finite, not negative, and zero before the onset;
    - the stored energy is the integral of the elastic force over the penetration, and the
      difference of force and elastic force dissipates energy;
    - the derivatives of the force by penetration, rate, entry speed and each parameter of the law
      are finite, and agree with finite differences at some points where usual laws are smooth;
    - the force jumps only at the onset and at separation, where integration steps end, and only if
      the law declares it (`AbstractContactLaw.force_jumps`); such a jump causes a `UserWarning`;
    - the force is the elastic force if the entry speed is unknown.

    Stiffnesses may depend on the `bearing_radius`, m, and on the radial `clearance`, m.

    >>> testing.check_law(cj.laws.HuntCrossley(0.8, 1e9))
    """
    require_instance("law", law, AbstractContactLaw)
    wall = (jnp.asarray(bearing_radius), jnp.asarray(clearance))
    depth, rate, entry = grid(DEPTHS, RATES, ENTRY_SPEEDS)

    # As in a simulation, laws that do not use the entry speed get None.
    def force(law: AbstractContactLaw, depth: Scalar, rate: Scalar, entry: Scalar) -> jax.Array:
        force = law.force(Gap(depth, rate, *wall), entry if law.uses_entry_speed else None)
        return jnp.asarray(force)

    def elastic(depth: Scalar) -> Scalar:
        return law.elastic_force(Gap(depth, jnp.zeros_like(depth), *wall))

    def energy(depth: Scalar) -> Scalar:
        return law.stored_energy(Gap(depth, jnp.zeros_like(depth), *wall))

    forces = evaluated("The force", force, law, depth, rate, entry)
    ensure(forces >= 0.0, "The force is negative somewhere: clamp it at zero.")
    outside = depth < -jnp.asarray(law.onset_offset())
    ensure(jnp.where(outside, forces, 0.0) == 0.0, "There is a force before onset_offset().")
    # The power, W, of the force minus the elastic force; the scale is for rounding errors.
    dissipation = (forces - jax.vmap(elastic)(depth)) * rate
    scale = 1e-9 * (1.0 + jnp.abs(forces * rate))
    ensure(dissipation >= -scale, "The law creates energy: (force - elastic_force) rate < 0.")
    # The derivative of the energy by the depth is the elastic force, except for rounding errors.
    depths = jnp.asarray([-1e-3, 0.0, 1e-9, 1e-6, 1e-5])
    slopes = jax.vmap(jax.grad(energy))(depths)
    close = jnp.allclose(slopes, jax.vmap(elastic)(depths), rtol=1e-9, atol=1e-12)
    ensure(close, "stored_energy is not the integral of elastic_force over the depth.")
    ensure_finite_slopes(force, law, depth=depth, rate=rate, entry_speed=entry)
    forces_at = jax.vmap(force, in_axes=(None, 0, 0, 0))
    _check_differences(forces_at, law)
    # A contact that exists at the start of a run has no known entry speed, and no damping. A large
    # but finite speed stands for the unknown one, so that a damping of about 1e-9 of the force
    # remains.
    if law.uses_entry_speed:
        depth, rate = grid(DEPTHS, RATES)
        unknown = forces_at(law, depth, rate, jnp.full_like(depth, UNKNOWN_ENTRY_SPEED))
        ensure(
            jnp.allclose(unknown, jax.vmap(elastic)(depth), rtol=1e-6, atol=1e-12),
            "The force at an unknown entry speed, which is represented by a very large value, is "
            "not the elastic force.",
        )
    _check_jumps(forces_at, law)


def _check_differences(forces: Callable[..., Points], law: AbstractContactLaw) -> None:
    # Checks the derivatives of the force by depth, rate, entry speed and each parameter of the law.
    # One of these numbers at a time is multiplied by a factor.
    arguments = *jnp.asarray(SMOOTH).T, jax.tree.map(jnp.asarray, law)
    numbers, constants = eqx.partition(arguments, eqx.is_inexact_array)
    leaves, structure = jax.tree.flatten(numbers)
    names = ["the depth", "the rate", "the entry speed"]
    for path, _ in jax.tree_util.tree_leaves_with_path(numbers[-1]):
        names.append(f"`{jax.tree_util.keystr(path).lstrip('.')}`")

    def forces_with(k: int, factor: Scalar) -> Points:
        # The forces at the points `SMOOTH`, with the k-th number multiplied by `factor`.
        leaf = leaves[k]
        # Zero times a factor would stay zero: such a parameter grows with the factor instead.
        leaf = jnp.where(jnp.any(leaf != 0.0), leaf * factor, leaf + (factor - 1.0))
        changed = jax.tree.unflatten(structure, [*leaves[:k], leaf, *leaves[k + 1 :]])
        *points, law = eqx.combine(changed, constants)
        return forces(law, *points)

    for k, name in enumerate(names):
        forces_of = partial(forces_with, k)
        # The derivative by the factor at 1 is the derivative by the number times the number.
        _, exact = jax.jvp(forces_of, (1.0,), (1.0,))
        numeric = (forces_of(1.0 + STEP) - forces_of(1.0 - STEP)) / (2.0 * STEP)
        allowed = TOLERANCE * (jnp.abs(exact) + 1e-3 * jnp.abs(forces_of(1.0)))
        wrong = ~(jnp.abs(exact - numeric) <= allowed)  # also for NaN
        at = SMOOTH[int(jnp.argmax(wrong))]  # the first point with a wrong derivative
        ensure(
            ~wrong,
            f"The derivative by {name} does not agree with finite differences of the force, at a "
            f"depth of {at[0]} m, a rate of {at[1]} m/s and an entry speed of {at[2]} m/s.",
        )


def _check_jumps(forces: Callable[..., Points], law: AbstractContactLaw) -> None:
    # Jumps are searched between successive depths, at all rates and entry speeds.
    left, rate, entry = grid(DEPTHS[:-1], RATES, ENTRY_SPEEDS)
    right = grid(DEPTHS[1:], RATES, ENTRY_SPEEDS)[0]
    sizes, depths = jumps(lambda depth: forces(law, depth, rate, entry), left, right)
    offset = jnp.asarray(law.onset_offset(), float)
    # The onset is at the depth -offset: the force may begin before the surfaces touch. `EDGE` is a
    # fraction of the offset, and also the length, m, that stands for a smaller offset.
    at_edge = jnp.abs(depths + offset) <= EDGE * jnp.maximum(offset, EDGE)
    inside = jnp.where(at_edge, 0.0, sizes)
    k = int(jnp.argmax(jnp.abs(inside)))
    ensure(
        inside[k] == 0.0,
        f"The force jumps by {inside[k]:.3g} N inside the contact, at a depth of {depths[k]:.3g} m "
        f"and a rate of {rate[k]:.3g} m/s, where no integration step ends: smooth it.",
    )
    # Jumps are also searched between successive rates, at all depths and entry speeds.
    depth, slow, entry_of_rate = grid(DEPTHS, RATES[:-1], ENTRY_SPEEDS)
    fast = grid(DEPTHS, RATES[1:], ENTRY_SPEEDS)[1]
    by_rate, rates = jumps(lambda rate: forces(law, depth, rate, entry_of_rate), slow, fast)
    k = int(jnp.argmax(jnp.abs(by_rate)))
    ensure(
        by_rate[k] == 0.0,
        f"The force jumps by {by_rate[k]:.3g} N with the rate, at {rates[k]:.3g} m/s and a depth "
        f"of {depth[k]:.3g} m, where no integration step ends: smooth it.",
    )
    # A jump at the onset or at separation is allowed if it is declared, with a warning.
    at_onset = jnp.where(at_edge, sizes, 0.0)
    k = int(jnp.argmax(jnp.abs(at_onset)))
    if at_onset[k] == 0.0:
        return
    statement = (
        f"The force jumps by {at_onset[k]:.3g} N where contact begins or ends, at a rate of "
        f"{rate[k]:.3g} m/s"
    )
    ensure(law.force_jumps, f"{statement}, but the law declares `force_jumps = False`.")
    warnings.warn(
        f"{statement}. Integration steps end there and `sensitivities` includes the effect of the "
        "jump, but direct differentiation of `simulate` does not. If the jump is unintended, let "
        "the damping grow with the depth.",
        stacklevel=3,  # the line that calls `check_law`
    )


def grid(*rows: ArrayLike) -> list[Points]:
    """All N combinations of one value from each of the `rows`, as an array (N,) for each row."""
    return [jnp.asarray(axis.ravel()) for axis in np.meshgrid(*rows, indexing="ij")]


def check_friction(friction: AbstractFriction) -> None:
    """Check that a friction law without bristles is consistent.

    The check evaluates the law for slips up to 1 m/s. It demands that the friction opposes the
    slip, is zero without slip, and doesn't jump; and that the derivatives by the slip and by the
    parameters of the law are finite, even without slip.

    >>> testing.check_friction(cj.frictions.RegularisedCoulomb(0.1))
    """
    require_instance("friction", friction, AbstractFriction)
    speeds = jnp.asarray([0.0, 1e-9, 1e-4, 1e-3, 1e-2, 1.0])
    # `ratio()` is the ratio of friction to normal force at a slip speed.
    ratios = evaluated("ratio()", lambda law, speed: law.ratio(speed), friction, speeds)
    ensure(ratios >= 0.0, "ratio() is negative somewhere: friction would drive the slip.")
    ensure(ratios[0] == 0.0, "ratio(0) is not zero: the force would jump at rest.")
    ratio = jax.vmap(lambda speed: jnp.asarray(friction.ratio(speed)))
    sizes, at = jumps(ratio, speeds[:-1], speeds[1:])
    k = int(jnp.argmax(jnp.abs(sizes)))
    ensure(sizes[k] == 0.0, f"ratio() jumps by {sizes[k]:.3g} at {at[k]:.3g} m/s: smooth it.")

    # For a normal force of 1 N. The x component stands for the others.
    def force(law: AbstractFriction, x: Scalar, y: Scalar, z: Scalar) -> Scalar:
        return law.force(1.0, Vector(x, y, z)).x

    zeros = jnp.zeros_like(speeds)  # slips along x, and one in a general direction
    x, y, z = jnp.append(speeds, 0.3), jnp.append(zeros, -0.2), jnp.append(zeros, 0.1)
    ensure_finite_slopes(force, friction, slip_along_x=x, slip_along_y=y, slip_along_z=z)


def check_bristles(friction: AbstractBristleFriction) -> None:
    """Check that a friction law with bristles is consistent.

    The full deflection of the bristles is their deflection in steady sliding. The check evaluates
    the law for deflections up to ten times the full one, and slips up to 1 m/s. It demands that

    - the full deflection is positive;
    - the deflection is constant without slip, and ten times the full deflection shrinks in sliding;
    - the friction is zero if deflection and slip are zero, and doesn't drive steady sliding;
    - the stored energy is zero without deflection and never negative;
    - the derivatives by deflection, slip and the law's parameters are finite, even without slip.

    >>> testing.check_bristles(cj.frictions.LuGre(breakaway=0.2, kinetic=0.1, stribeck_speed=0.01))
    """
    require_instance("friction", friction, AbstractBristleFriction)
    full = jnp.asarray(friction.full_deflection(), float)
    ensure(full > 0.0, "full_deflection() is not positive.")
    ratios = jnp.asarray([0.0, 1e-6, 0.1, 0.5, 0.9, 1.0, 10.0])
    speeds = jnp.asarray([0.0, 1e-9, 1e-4, 1e-2, 1.0])
    deflection, speed = grid(ratios * full, speeds)

    # Deflections are in a direction oblique to the slip, which is along x. `growth` is the scalar
    # product of a deflection and its rate; it is negative if the deflection shrinks.
    def growth(law: AbstractBristleFriction, z: Scalar, v: Scalar) -> Scalar:
        bristles = Vector(z * 0.6, z * 0.8, 0.0)
        return law.rate(bristles, Vector(v, 0.0, 0.0)).dot(bristles)

    # The friction along the slip over the normal force.
    def ratio(law: AbstractBristleFriction, z: Scalar, v: Scalar) -> Scalar:
        bristles, slip = Vector(z * 0.6, z * 0.8, 0.0), Vector(v, 0.0, 0.0)
        return law.ratio(bristles, law.rate(bristles, slip), slip).x

    evaluated("The friction", ratio, friction, deflection, speed)  # ensures that it is finite
    rates = evaluated("rate()", growth, friction, deflection, speed)
    sticks = speed == 0.0
    ensure(jnp.where(sticks, rates, 0.0) == 0.0, "rate() without slip is not zero: it creeps.")
    slides = (deflection > 5.0 * full) & ~sticks  # of the tested deflections, the tenfold one
    message = "A deflection of ten times full_deflection() does not shrink in sliding."
    ensure(~slides | (rates < 0.0), message)
    none = Vector(0.0, 0.0, 0.0)
    at_rest = friction.ratio(none, none, none)
    ensure(jnp.asarray(list(at_rest)) == 0.0, "There is friction without deflection and slip.")
    energies = [friction.stored_energy(Vector(0.0, z, 0.0)) for z in ratios * full]
    stored = jnp.stack([jnp.asarray(energy) for energy in energies])
    message = "stored_energy() is negative, or not zero without deflection."
    ensure((stored[0] == 0.0) & (stored >= 0.0), message)
    sliding = jax.vmap(friction.sliding_ratio)(speeds)
    ensure(sliding >= 0.0, "sliding_ratio() is negative somewhere: friction would drive the slip.")
    for function in (growth, ratio):
        ensure_finite_slopes(function, friction, deflection=deflection, slip=speed)


def check_constraint(
    constraint: AbstractConstraint, motions: dict[str, Motion], tolerance: float = 1e-6
) -> None:
    """Check that the constraint rows of an ideal joint agree with central differences in time.

    A row is a scalar equation. It has a value, which is zero if the joint is satisfied; a Jacobian
    by the velocities and spins (angular velocities) of the bodies; a time rate, the time derivative
    of the value with all bodies at rest; and a bias. The check demands that the time derivative of
    the value is the Jacobian times the velocities and spins plus the time rate, and that the bias
    is the time derivative of this sum at constant velocities and spins.

    **Arguments:** `motions`: of the joint's bodies at time 0, by name. `tolerance`: largest
    accepted error of the value's time derivative, relative to one plus its size. The bias may
    differ by ten times as much, because its rounding errors are larger.

    >>> motions = {
    ...     "ground": testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0)),
    ...     "arm": testing.moving((0.1, 0.2, 0.3), (1, 0.1, 0.2, 0.3), (1, 2, 3), (3, 2, 1)),
    ... }
    >>> joint = cj.SphericalJoint("ground", "arm", (0, 0, 0), (-0.5, 0, 0))
    >>> testing.check_constraint(joint, motions)
    """
    step = 1e-5  # s, at which the errors of central differences are well below the tolerance
    require_instance("constraint", constraint, AbstractConstraint)
    motions, constraint = motions_of(constraint, motions), unpack(constraint)
    rows = constraint.rows(motions, 0.0)
    after, before = moved(motions, step), moved(motions, -step)
    ahead, behind = constraint.rows(after, step), constraint.rows(before, -step)
    same = rows.keys() == ahead.keys() == behind.keys()
    ensure(same, "The names of the rows change with the motion.")
    for label, row in rows.items():
        rate = float(ahead[label].value - behind[label].value) / (2 * step)
        expected = float(row_rate(row, motions))
        ensure(
            abs(rate - expected) < tolerance * (1.0 + abs(expected)),
            f"Row {label!r}: the Jacobian times the velocities, plus the time rate, is not the "
            "rate of the value.",
        )
        # The bias is the rate of a row's value rate at constant velocities: the part of the second
        # time derivative that accelerations do not cause.
        change = float(row_rate(ahead[label], after) - row_rate(behind[label], before))
        bias = change / (2 * step)
        # The difference of two rates has larger rounding errors than that of two values.
        ensure(
            abs(bias - float(row.bias)) < 10 * tolerance * (1.0 + abs(bias)),
            f"Row {label!r}: the bias is not the rate of (Jacobian times velocities, plus time "
            "rate) at constant velocities and body spins.",
        )
