"""Rotation vectors: an axis times an angle, of turns by less than half a revolution."""

from typing import NamedTuple

import jax.numpy as jnp

from .vectors import Matrix, Scalar, Vector

SMALL = 1e-4
"""Squared sine up to which its angle over it is a series, to rounding; and hundredth of the squared
angle up to which `_curvature` is."""
TINY = 1e-200
"""Squared sine that is zero."""


class RotationVector(NamedTuple):
    """The `vector`, rad, of a rotation: an axis times an angle of 0 to pi; and the factor of the
    squared vector product with it in the matrix that maps angular velocities to its rate."""

    vector: Vector
    factor: Scalar

    def rate(self, spin: Vector) -> Vector:
        """Its rate, rad/s, for an angular velocity of the turned frame against the fixed one, rad/s
        in the fixed one's axes: the inverse of the left Jacobian of the exponential map."""
        turning = self.vector.cross(spin)
        return spin - turning * 0.5 + self.vector.cross(turning) * self.factor

    def torque(self, moment: Vector) -> Vector:
        """The torque, N m in the fixed axes, that does the work of a moment conjugate to the
        vector's rate: the transpose of what `rate` multiplies with."""
        turning = self.vector.cross(moment)
        return moment + turning * 0.5 + self.vector.cross(turning) * self.factor


def rotation_vector(rotation: Matrix) -> RotationVector:
    """The rotation vector of a rotation matrix, which turns the fixed frame's axes into the turned
    one's. It has no direction at half a revolution, where it jumps to its opposite; there
    it is zero, between both."""
    x, y, z = rotation.row_x, rotation.row_y, rotation.row_z
    sine_vector = Vector(z.y - y.z, x.z - z.x, y.x - x.y) * 0.5
    cosine = 0.5 * (x.x + y.y + z.z - 1.0)
    squared_sine = sine_vector.dot(sine_vector)
    stretch = _angle_over_sine(squared_sine, cosine)
    return RotationVector(
        sine_vector * stretch, _curvature(squared_sine * stretch * stretch, stretch, cosine)
    )


def _angle_over_sine(squared_sine: Scalar, cosine: Scalar) -> Scalar:
    """An angle of 0 to pi, over its sine; one at zero, and finite at pi."""
    near = (squared_sine < SMALL) & (cosine > 0.0)
    sine = jnp.sqrt(jnp.where(near | (squared_sine <= TINY), 1.0, squared_sine))
    s = jnp.where(near, squared_sine, 0.0)
    series = 1.0 + s * (1.0 / 6.0 + s * (3.0 / 40.0 + s * (15.0 / 336.0)))
    return jnp.where(near, series, jnp.arctan2(sine, cosine) / sine)


def _curvature(squared_angle: Scalar, stretch: Scalar, cosine: Scalar) -> Scalar:
    """(1 - (angle/2) cot(angle/2))/angle^2, of which the angle over the sine is the `stretch`."""
    near = squared_angle < 100.0 * SMALL
    a = jnp.where(near, squared_angle, 0.0)
    series = 1.0 / 12.0 + a * (1.0 / 720.0 + a * (1.0 / 30240.0 + a / 1209600.0))
    full = (1.0 - 0.5 * stretch * (1.0 + cosine)) / jnp.where(near, 1.0, squared_angle)
    return jnp.where(near, series, full)
