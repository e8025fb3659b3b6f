"""Make motions of bodies for checks, and advance them by a short time."""

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
    """Return the motion of a body, for `check_constraint`, `check_force` and `check_contact_joint`.

    **Arguments:**

    - `position`: (3,) m, of the centre of mass, in global axes.
    - `orientation`: (4,) Euler parameters, scalar first, of any length except zero.
    - `velocity`: (3,) m/s, of the centre of mass, in global axes.
    - `spin`: (3,) rad/s, angular velocity in body axes.

    >>> arm = testing.moving((0.5, 0, 0), (1, 0, 0, 0), velocity=(0, 1, 0), spin=(0, 0, 2))
    >>> arm.spin.z
    2
    """
    parameters = normalised(EulerParameters(*orientation))
    return Motion(Vector(*position), rotation_matrix(parameters), Vector(*velocity), Vector(*spin))


def moved(motions: Mapping[str, Motion], time: float) -> dict[str, Motion]:
    """Return the motions of bodies, by name, `time` seconds later, if their velocities in global
    axes and their angular velocities (spins) in body axes stay constant. Checks compare time
    derivatives with differences of such motions."""
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
    """Return the Euler parameters of a rotation given by its rotation vector `angle`, rad: its
    direction is the axis, its length the angle."""
    size = jnp.sqrt(angle.dot(angle)) + 1e-300  # no division by zero without rotation
    scale = jnp.sin(0.5 * size) / size
    return EulerParameters(jnp.cos(0.5 * size), angle.x * scale, angle.y * scale, angle.z * scale)
