"""Rotation vectors (axis times angle) of rotations by less than half a revolution, and rates."""

from typing import NamedTuple

import jax.numpy as jnp

from .vectors import Matrix, Scalar, Vector

SMALL = 1e-4
"""Squared sine up to which `_angle_over_sine` uses a series. `_curvature` uses one up to a squared
angle of 100 times this number. The errors of both series are below rounding errors."""
TINY = 1e-200
"""Squared sine that counts as zero."""


class RotationVector(NamedTuple):
    """Rotation vector of a frame relative to a fixed frame.

    - `vector`: axis times angle, rad, with an angle from 0 to pi.
    - `factor`: (1 - (angle/2) cot(angle/2))/angle^2, the factor of the double vector product in
      `rate` and `torque`.
    """

    vector: Vector
    factor: Scalar

    def rate(self, spin: Vector) -> Vector:
        """Return the time derivative of the rotation vector, rad/s.

        It is the product of the inverse left Jacobian of the exponential map and the spin.

        **Arguments:** `spin`: angular velocity of the rotated frame relative to the fixed frame,
        rad/s, in axes of the fixed frame.
        """
        product = self.vector.cross(spin)
        return spin - product * 0.5 + self.vector.cross(product) * self.factor

    def torque(self, moment: Vector) -> Vector:
        """Return the torque on the rotated frame, N m, in axes of the fixed frame.

        Torque and moment have the same power, ``moment . rate = torque . spin``, so the matrix of
        this map is the transpose of that in `rate`.

        **Arguments:** `moment`: N m, moment that is conjugate to the rotation vector.
        """
        product = self.vector.cross(moment)
        return moment + product * 0.5 + self.vector.cross(product) * self.factor


def rotation_vector(rotation: Matrix) -> RotationVector:
    """Return the rotation vector of a rotation matrix that maps rotated axes to fixed ones.

    At exactly half a revolution, the direction of the vector is not defined, and the result is
    zero.
    """
    x, y, z = rotation.rows
    # The antisymmetric part of the matrix is that of sine times axis, and the trace is
    # 1 + 2 cosine.
    sine_vector = Vector(z.y - y.z, x.z - z.x, y.x - x.y) * 0.5
    cosine = 0.5 * (x.x + y.y + z.z - 1.0)
    squared_sine = sine_vector.dot(sine_vector)
    stretch = _angle_over_sine(squared_sine, cosine)
    curvature = _curvature(squared_sine * stretch * stretch, stretch, cosine)
    return RotationVector(sine_vector * stretch, curvature)


def _angle_over_sine(squared_sine: Scalar, cosine: Scalar) -> Scalar:
    """Return an angle from 0 to pi divided by its sine, given the squared sine and the cosine.

    The result is 1 at an angle of zero. At exactly pi, where the quotient is infinite, it is an
    arbitrary finite number; the vector that it multiplies is zero there.
    """
    # Both alternatives of each `where` are finite with finite derivatives, since the derivative of
    # the unused one is multiplied by zero.
    near = (squared_sine < SMALL) & (cosine > 0.0)
    sine = jnp.sqrt(jnp.where(near | (squared_sine <= TINY), 1.0, squared_sine))
    s = jnp.where(near, squared_sine, 0.0)
    series = 1.0 + s * (1.0 / 6.0 + s * (3.0 / 40.0 + s * (15.0 / 336.0)))
    return jnp.where(near, series, jnp.arctan2(sine, cosine) / sine)


def _curvature(squared_angle: Scalar, stretch: Scalar, cosine: Scalar) -> Scalar:
    """Return (1 - (angle/2) cot(angle/2))/angle^2, the `factor` of a `RotationVector`.

    **Arguments:** `squared_angle`: rad^2; `stretch`: the angle divided by its sine; `cosine`: of
    the angle.
    """
    # cot(angle/2) is (1 + cosine)/sine. Near zero the difference would cancel, so a series is used.
    near = squared_angle < 100.0 * SMALL
    a = jnp.where(near, squared_angle, 0.0)
    series = 1.0 / 12.0 + a * (1.0 / 720.0 + a * (1.0 / 30240.0 + a / 1209600.0))
    full = (1.0 - 0.5 * stretch * (1.0 + cosine)) / jnp.where(near, 1.0, squared_angle)
    return jnp.where(near, series, full)
