"""Euler parameters, rotation matrices, rotation vectors, angles, and frames about an axis."""

import math
from typing import NamedTuple

import jax.numpy as jnp

from .smoothing import where
from .vectors import EulerParameters, Matrix, Scalar, Vector, multiply, square_root, subtract


def squared_norm(p: EulerParameters) -> Scalar:
    """Return the sum of the squared Euler parameters, which is 1 for a rotation."""
    return p.e0 * p.e0 + p.e1 * p.e1 + p.e2 * p.e2 + p.e3 * p.e3


def rotation_matrix(p: EulerParameters) -> Matrix:
    """Return the matrix that transforms body components to global ones.

    The Euler parameters are divided by their norm, so that the matrix is orthogonal although
    rounding and integration errors change the norm.

    >>> half = 0.5**0.5  # a quarter of a revolution about z
    >>> matrix = extend.rotation_matrix(extend.EulerParameters(half, 0.0, 0.0, half))
    >>> print(f"{(matrix @ extend.UNIT_X).y:.3f}")
    1.000
    """
    # For example, xs is 2 e1/|p|^2, and wx is 2 e0 e1/|p|^2.
    s = 2.0 / squared_norm(p)
    xs, ys, zs = p.e1 * s, p.e2 * s, p.e3 * s
    wx, wy, wz = p.e0 * xs, p.e0 * ys, p.e0 * zs
    xx, xy, xz = p.e1 * xs, p.e1 * ys, p.e1 * zs
    yy, yz, zz = p.e2 * ys, p.e2 * zs, p.e3 * zs
    return Matrix(
        Vector(1.0 - (yy + zz), xy - wz, xz + wy),
        Vector(xy + wz, 1.0 - (xx + zz), yz - wx),
        Vector(xz - wy, yz + wx, 1.0 - (xx + yy)),
    )


def euler_parameter_rates(p: EulerParameters, spin: Vector) -> EulerParameters:
    """Return the time derivatives of Euler parameters for a spin in body axes, rad/s."""
    a, b, c = 0.5 * spin.x, 0.5 * spin.y, 0.5 * spin.z
    return EulerParameters(
        -(p.e1 * a + p.e2 * b + p.e3 * c),
        p.e0 * a - p.e3 * b + p.e2 * c,
        p.e3 * a + p.e0 * b - p.e1 * c,
        p.e1 * b - p.e2 * a + p.e0 * c,
    )


def turned(p: EulerParameters, angle: Vector) -> EulerParameters:
    """Return the normalised Euler parameters after a further rotation by `angle`, a small rotation
    vector in body axes, rad, correct to first order in this vector.

    >>> start = extend.EulerParameters(1.0, 0.0, 0.0, 0.0)
    >>> p = extend.turned(start, extend.Vector(0.0, 0.0, 1e-3))
    >>> print(f"{p.e3:.2e}")  # half of the angle
    5.00e-04
    """
    rate = euler_parameter_rates(p, angle)
    q = EulerParameters(p.e0 + rate.e0, p.e1 + rate.e1, p.e2 + rate.e2, p.e3 + rate.e3)
    return normalised(q)


def composed(p: EulerParameters, q: EulerParameters) -> EulerParameters:
    """Return the Euler parameters of the rotation q followed by p: the quaternion product p q."""
    v, w = Vector(p.e1, p.e2, p.e3), Vector(q.e1, q.e2, q.e3)
    u = w * p.e0 + v * q.e0 + v.cross(w)
    return EulerParameters(subtract(multiply(p.e0, q.e0), v.dot(w)), u.x, u.y, u.z)


def conjugate(p: EulerParameters) -> EulerParameters:
    """Return the Euler parameters of the inverse rotation, if `p` has unit norm."""
    v = -Vector(p.e1, p.e2, p.e3)
    return EulerParameters(p.e0, v.x, v.y, v.z)


def normalised(p: EulerParameters) -> EulerParameters:
    """Return Euler parameters divided by their norm, which must not be zero.

    >>> p = extend.normalised(extend.EulerParameters(2.0, 0.0, 0.0, 0.0))
    >>> print(f"{p.e0:.1f}")
    1.0
    """
    scale = 1.0 / square_root(squared_norm(p))
    return EulerParameters(p.e0 * scale, p.e1 * scale, p.e2 * scale, p.e3 * scale)


NORM_DRIFT = 1e-6
"""Error of the squared norm up to which `kept_unit` leaves Euler parameters unchanged. Its
correction, which is exact to first order, reduces an error of this size to 2.5e-13."""


def kept_unit(p: EulerParameters) -> EulerParameters:
    """Return Euler parameters with norm corrected to 1 if its square's error is above `NORM_DRIFT`.

    The rotation does not depend on the norm, but the error control of a step does. Each step
    changes the norm slightly in the same direction: for a spinning top, the norm is 1.6 after 24 h
    at a relative tolerance of 1e-4, and 1e40 at 1e-3.
    """
    squared = squared_norm(p)
    drifted = jnp.abs(squared - 1.0) > NORM_DRIFT
    # 2/(1 + n^2) is 1/n to first order in the error of the norm n.
    scale = jnp.where(drifted, 2.0 / (1.0 + squared), 1.0)
    return EulerParameters(p.e0 * scale, p.e1 * scale, p.e2 * scale, p.e3 * scale)


def within_two_turns(angle: Scalar) -> Scalar:
    """Return an angle, rad, minus the nearest multiple of 4 pi, the period of Euler parameters.

    An angle that grew with every revolution would lose digits, and the errors that relative
    tolerances allow would grow with it.

    >>> print(f"{extend.within_two_turns(5.0 * np.pi) / np.pi:.1f}")  # half a revolution
    1.0
    """
    return angle - 4.0 * math.pi * jnp.round(angle / (4.0 * math.pi))


def unit(vector: Vector) -> Vector:
    """Return a vector, which must not be zero, scaled to length one.

    >>> direction = extend.unit(extend.Vector(3.0, 4.0, 0.0))
    >>> print(f"{direction.x:.1f}, {direction.y:.1f}")
    0.6, 0.8
    """
    return vector * (1.0 / square_root(vector.dot(vector)))


def transverse_axes(axis: Vector) -> tuple[Vector, Vector]:
    """Return two unit vectors that, followed by the unit vector `axis`, form a right-handed frame
    (T. Duff et al., Building an orthonormal basis, revisited, 2017); x and y for the z axis."""
    sign = where(axis.z >= 0.0, 1.0, -1.0)
    a = -1.0 / (sign + axis.z)
    b = axis.x * axis.y * a
    first = Vector(1.0 + sign * axis.x * axis.x * a, sign * b, -sign * axis.x)
    second = Vector(b, sign + axis.y * axis.y * a, -axis.y)
    return first, second


SMALL = 1e-4
"""Squared sine of an acute angle below which `_angle_over_sine` uses a series; `_curvature` uses a
series for squared angles below 100 times this number. Both errors are below rounding errors."""
TINY = 1e-200
"""Squared sine up to which the sine counts as zero."""


class RotationVector(NamedTuple):
    """Rotation vector of a frame relative to a fixed frame.

    - `vector`: axis times angle, rad, with an angle from 0 to pi.
    - `factor`: (1 - (angle/2) cot(angle/2))/angle^2, the factor of the double vector product in
      `rate` and `torque`.
    """

    vector: Vector
    factor: Scalar

    def rate(self, spin: Vector) -> Vector:
        """Return the time derivative of the rotation vector, rad/s, for the spin of the rotated
        frame relative to the fixed one, rad/s, in axes of the fixed frame: the inverse left
        Jacobian of the exponential map (J. Solà et al., A micro Lie theory for state estimation in
        robotics, 2018) times the spin."""
        product = self.vector.cross(spin)
        return spin - product * 0.5 + self.vector.cross(product) * self.factor

    def torque(self, moment: Vector) -> Vector:
        """Return the torque on the rotated frame, N m, in axes of the fixed frame, for the moment
        that is work-conjugate to the rotation vector: the power is moment . rate = torque . spin,
        so the matrix of this map is the transpose of the matrix in `rate`."""
        product = self.vector.cross(moment)
        return moment + product * 0.5 + self.vector.cross(product) * self.factor


def rotation_vector(rotation: Matrix) -> RotationVector:
    """Return the rotation vector of a matrix that transforms components in the rotated frame to
    those in the fixed frame. At exactly half a revolution, where two opposite vectors describe the
    same rotation, `vector` is zero instead."""
    x, y, z = rotation.rows
    # The antisymmetric part of the matrix is the cross-product matrix of sine times axis, and the
    # trace is 1 + 2 cosine.
    sine_vector = Vector(z.y - y.z, x.z - z.x, y.x - x.y) * 0.5
    cosine = 0.5 * (x.x + y.y + z.z - 1.0)
    squared_sine = sine_vector.dot(sine_vector)
    stretch = _angle_over_sine(squared_sine, cosine)
    curvature = _curvature(squared_sine * stretch * stretch, stretch, cosine)
    return RotationVector(sine_vector * stretch, curvature)


def _angle_over_sine(squared_sine: Scalar, cosine: Scalar) -> Scalar:
    """Return an angle from 0 to pi divided by its sine, from the squared sine and the cosine. At
    exactly pi it is some finite number, since the sine vector that it multiplies is zero."""
    # Both alternatives of each `where` are finite with finite derivatives, since the derivative of
    # the unused one is multiplied by zero.
    near = (squared_sine < SMALL) & (cosine > 0.0)
    sine = jnp.sqrt(jnp.where(near | (squared_sine <= TINY), 1.0, squared_sine))
    s = jnp.where(near, squared_sine, 0.0)
    series = 1.0 + s * (1.0 / 6.0 + s * (3.0 / 40.0 + s * (15.0 / 336.0)))
    return jnp.where(near, series, jnp.arctan2(sine, cosine) / sine)


def _curvature(squared_angle: Scalar, stretch: Scalar, cosine: Scalar) -> Scalar:
    """Return (1 - (angle/2) cot(angle/2))/angle^2, the `factor` of a `RotationVector`. `stretch`:
    the angle divided by its sine."""
    # cot(angle/2) is (1 + cosine)/sine. Near zero the difference would cancel, so a series is used.
    near = squared_angle < 100.0 * SMALL
    a = jnp.where(near, squared_angle, 0.0)
    series = 1.0 / 12.0 + a * (1.0 / 720.0 + a * (1.0 / 30240.0 + a / 1209600.0))
    full = (1.0 - 0.5 * stretch * (1.0 + cosine)) / jnp.where(near, 1.0, squared_angle)
    return jnp.where(near, series, full)
