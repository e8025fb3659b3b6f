"""Check user-defined force elements, which act on bodies with wrenches: forces and moments."""

from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp

from .._fields.objects import on_device
from .._math.vectors import Scalar, Vector, pack, unpack
from .._model.bodies import Motion, Wrench
from .._model.contact.laws import require_instance
from .._model.joints.base import AbstractForce
from .conformance import ensure, motions_of
from .continuity import at_rest, moved

STEP = 1e-5
"""Step, s, of central differences of the stored energy; errors are well below the tolerance."""
Wrenches = dict[str, Wrench]
"""Force, N in global axes, and moment, N m in body axes, on each body, by the body's name."""


def check_force(
    force: AbstractForce, motions: Mapping[str, Motion], time: float = 0.0, tolerance: float = 1e-6
) -> None:
    """Check that a force element is consistent at given motions.

    The check demands that

    - the wrenches are finite and act on bodies named by `body_names` only;
    - forces and moments on the bodies add up to zero, if the element has several bodies and returns
      a wrench for each. This is not checked where a reaction is unknown: for an element with one
      body, such as a load from outside, and for one that leaves out the wrench on a body, such as
      the ground, on which simulations need no wrench;
    - the power by which the element changes the scene's total energy (`supplied_power`) is the
      power of its forces on the bodies plus the rate of its stored energy;
    - derivatives by motions and parameters are finite, even at rest.

    **Arguments:**

    - `time`: time of evaluation. It must not be a breakpoint of the element, at which the force
      jumps or has a kink.
    - `tolerance`: largest accepted error of the balances: of forces, relative to the largest force;
      of moments, to the largest moment about the global origin or, if larger, to the largest force
      times the largest distance of a body from this origin; of energy, to 1 W plus the magnitudes
      of the power of the wrenches and of `supplied_power`.

    >>> motions = {
    ...     "ground": testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0)),
    ...     "arm": testing.moving((0.1, 0.2, 0.3), (1, 0.1, 0.2, 0.3), (1, 2, 3), (3, 2, 1)),
    ... }
    >>> spring = cj.SpringDamper("ground", "arm", (0, 0, 0), (0, 0.5, 0), stiffness=100.0)
    >>> testing.check_force(spring, motions)
    """
    # Derivatives and `jax.vmap` need arrays of JAX.
    require_instance("force", force, AbstractForce)
    motions = jax.tree.map(on_device, motions_of(force, motions))
    wrenches = _wrenches(force, motions, time)
    ensure(wrenches.keys() <= motions.keys(), "There is a wrench on a body not in body_names().")
    for leaf in jax.tree.leaves(wrenches):
        ensure(jnp.isfinite(leaf), "The force is not finite.")
    # With one body, or without the wrench on one of several bodies, a reaction is unknown, and the
    # sum cannot be checked.
    if len(motions) > 1 and wrenches.keys() == motions.keys():
        _check_balance(wrenches, motions, tolerance)
    _check_power(force, motions, time, tolerance)
    _check_derivatives(force, motions, time)
    _check_lanes(force, motions, time)


def _wrenches(force: AbstractForce, motions: Mapping[str, Motion], time: Scalar) -> Wrenches:
    return jax.tree.map(on_device, unpack(force).wrenches(motions, on_device(time)))


def _check_balance(wrenches: Wrenches, motions: Mapping[str, Motion], tolerance: float) -> None:
    forces = [wrench.force for wrench in wrenches.values()]
    moments = [
        motions[name].direction(wrench.moment) + motions[name].position.cross(wrench.force)
        for name, wrench in wrenches.items()
    ]
    levers = [_size(motions[name].position) for name in wrenches]
    for parts, lever, unit in ((forces, 0.0, "N"), (moments, max(levers), "N m")):
        left = _size(sum(parts[1:], parts[0]))
        # Moments may be small differences of large moments, and have the rounding errors of these:
        # a force times a lever. For the sum of the forces, the scale of levers is zero.
        scale = lever * max(_size(force) for force in forces)
        ensure(
            left <= tolerance * max(scale, *(_size(part) for part in parts)),
            f"The force is not equal and opposite: the sum is {left:.3g} {unit}.",
        )


def _size(vector: Vector) -> float:
    return float(jnp.linalg.norm(pack(vector)))


def _check_power(
    force: AbstractForce, motions: Mapping[str, Motion], time: float, tolerance: float
) -> None:
    element = unpack(force)

    def stored(step: float) -> float:
        # The stored energy, J, after a short time `step`, s.
        return float(element.stored_energy(moved(motions, step), on_device(time + step)))

    rate = (stored(STEP) - stored(-STEP)) / (2.0 * STEP)
    wrenches = _wrenches(force, motions, time)
    power = sum(float(motions[name].power(wrench)) for name, wrench in wrenches.items())
    # The supplied power is the rate at which the element changes the total energy of the scene:
    # positive for a motor, negative for a damper.
    supplied = float(element.supplied_power(motions, on_device(time)))
    imbalance = supplied - power - rate
    ensure(
        abs(imbalance) < tolerance * (1.0 + abs(power) + abs(supplied)),
        f"The energy does not balance: {imbalance:.3g} W of the supplied power are neither stored "
        "nor transferred to the bodies.",
    )


def _check_derivatives(force: AbstractForce, motions: Mapping[str, Motion], time: float) -> None:
    numbers, constants = eqx.partition(jax.tree.map(on_device, force), eqx.is_inexact_array)

    def wrenches(numbers: AbstractForce, motions: Mapping[str, Motion]) -> Wrenches:
        return _wrenches(eqx.combine(numbers, constants), motions, time)

    for tested in (motions, at_rest(motions)):
        point = numbers, tested
        # The derivative if all numbers change at once is not finite if one derivative is not.
        slopes = jax.jvp(wrenches, point, jax.tree.map(jnp.ones_like, point))[1]
        for slope in jax.tree.leaves(slopes):
            ensure(jnp.isfinite(slope), "A derivative of the force is not finite.")


def _check_lanes(force: AbstractForce, motions: Mapping[str, Motion], time: float) -> None:
    # A lane is one element of the axis over which `jax.vmap` maps. The second lane differs from the
    # first: it has the motions of the same bodies 0.1 s later.
    lanes = [motions, moved(motions, 0.1)]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *lanes)
    together = jax.vmap(lambda lane: _wrenches(force, lane, time))(stacked)
    single = [_wrenches(force, lane, time) for lane in lanes]
    expected = jax.tree.map(lambda *leaves: jnp.stack(leaves), *single)
    # Compiled code may round differently: 1e-9 is far above rounding errors.
    same = jax.tree.map(lambda a, b: jnp.allclose(a, b, rtol=1e-9, atol=1e-9), together, expected)
    ensure(all(jax.tree.leaves(same)), "The force under vmap differs from a single evaluation.")
