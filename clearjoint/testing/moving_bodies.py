"""Motions of bodies from plain numbers, and after a short time."""

from collections.abc import Mapping, Sequence

import jax.numpy as jnp

from ..math.rotations import normalised, rotation_matrix
from ..math.vectors import EulerParameters, Vector
from ..model.bodies import Motion


def moving(
    position: Sequence[float],
    orientation: Sequence[float],
    velocity: Sequence[float],
    spin: Sequence[float],
) -> Motion:
    """Return a motion from plain numbers, for `check_constraint` and `check_force`.

    **Arguments:**

    - `position`, `velocity`: of the centre of mass, (3,) m and m/s, global.
    - `orientation`: (4,) Euler parameters, which are normalised.
    - `spin`: (3,) rad/s, body axes.

    >>> arm = testing.moving((0.5, 0, 0), (1, 0, 0, 0), velocity=(0, 1, 0), spin=(0, 0, 2))
    >>> arm.spin.z
    2
    """
    parameters = normalised(EulerParameters(*orientation))
    return Motion(Vector(*position), rotation_matrix(parameters), Vector(*velocity), Vector(*spin))


def moved(motions: Mapping[str, Motion], time: float) -> dict[str, Motion]:
    """Return the motions a short time later, s, at constant velocities and body spins."""
    return {
        name: Motion(
            motion.position + motion.velocity * time,
            motion.rotation @ rotation_matrix(_exponential(motion.spin * time)),
            motion.velocity,
            motion.spin,
        )
        for name, motion in motions.items()
    }


def _exponential(angle: Vector) -> EulerParameters:
    """Return the Euler parameters of a rotation vector."""
    size = jnp.sqrt(angle.dot(angle)) + 1e-300
    scale = jnp.sin(0.5 * size) / size
    return EulerParameters(jnp.cos(0.5 * size), angle.x * scale, angle.y * scale, angle.z * scale)
