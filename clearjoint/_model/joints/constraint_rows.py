"""Constraint rows of which the ideal joints are composed, and their combinations.

`names` are those of the first and the second body, `first` and `second` their motions. In a row
that describes a quantity, such as an angle, the quantity takes the place of Phi.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import reduce

import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ..._fields.checks import require
from ..._math.rotations import rotation_matrix, transverse_axes, unit
from ..._math.smoothing import polar_angle, value_and_slope, where
from ..._math.vectors import (
    UNIT_X,
    UNIT_Y,
    UNIT_Z,
    ZERO,
    EulerParameters,
    Matrix,
    Scalar,
    Vector,
    add,
    multiply,
)
from ..bodies import NO_WRENCH, Motion, Wrench
from .base import Motions, Row

Pair = tuple[str, str]
"""Names of the first and the second body of a joint."""
NEARLY_OPPOSITE = math.cos(math.radians(170.0))
"""Scalar product of unit vectors below which `reversed_if_opposite` takes them as opposite."""


def _along(motion: Motion, local: Vector, direction: Vector) -> tuple[Wrench, Scalar]:
    """Return a body's parts of `Row.jacobian` and `Row.bias` for the coordinate of its point
    `local`, m in body axes, along the global unit vector `direction`."""
    body_direction = motion.rotation.transposed_times(direction)
    centripetal = motion.spin.cross(motion.spin.cross(local))
    return Wrench(direction, local.cross(body_direction)), body_direction.dot(centripetal)


def coincident_points(
    names: Pair, first: Motion, second: Motion, local_first: Vector, local_second: Vector
) -> dict[str, Row]:
    """Return three constraint rows that keep a point of the first body at a point of the second.

    Their values are the global components of the vector from the second point to the first, m.

    **Arguments:** `local_first`, `local_second`: point of each body, m from its centre of mass in
    its axes.

    >>> names, ground = ("ground", "ball"), still
    >>> ball = testing.moving((0.1, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> rows = extend.coincident_points(names, ground, ball, extend.ZERO, extend.ZERO)
    >>> print(f"{rows['translation x'].value:.1f} m")
    -0.1 m
    """
    # One row for each global axis: the difference of the points' coordinates along it.
    separation = first.point(local_first) - second.point(local_second)
    rows = {}
    for label, axis in (("x", UNIT_X), ("y", UNIT_Y), ("z", UNIT_Z)):
        wrench_first, bias_first = _along(first, local_first, axis)
        wrench_second, bias_second = _along(second, local_second, axis)
        negative_second = Wrench(-wrench_second.force, -wrench_second.moment)
        jacobian = {names[0]: wrench_first, names[1]: negative_second}
        rows[f"translation {label}"] = Row(axis.dot(separation), jacobian, bias_first - bias_second)
    return rows


def perpendicular(
    names: Pair, first: Motion, second: Motion, axis_first: Vector, axis_second: Vector
) -> Row:
    """Return the constraint row that keeps directions of two bodies perpendicular.

    Its value is the scalar product of `axis_first` and `axis_second`, unit vectors in body axes.

    >>> names, ground = ("ground", "ball"), still
    >>> ball = testing.moving((0.1, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> extend.perpendicular(names, ground, ball, extend.UNIT_X, extend.UNIT_Y).value
    0.0
    """
    a, b = first.direction(axis_first), second.direction(axis_second)
    b_in_first = first.rotation.transposed_times(b)
    a_in_second = second.rotation.transposed_times(a)
    rate_first, rate_second = first.spin.cross(axis_first), second.spin.cross(axis_second)
    # Second derivative of a . b: centripetal terms of both directions, and twice the product of
    # their rates.
    bias = (
        first.spin.cross(rate_first).dot(b_in_first)
        + second.spin.cross(rate_second).dot(a_in_second)
        + 2.0 * first.direction(rate_first).dot(second.direction(rate_second))
    )
    # The first body's part of the rate of a . b is (spin x a) . b = spin . (a x b), and likewise
    # for the second body.
    jacobian = {
        names[0]: Wrench(ZERO, axis_first.cross(b_in_first)),
        names[1]: Wrench(ZERO, axis_second.cross(a_in_second)),
    }
    return Row(a.dot(b), jacobian, bias)


def point_in_plane(
    names: Pair, first: Motion, second: Motion, origin: Vector, axis: Vector, local: Vector
) -> Row:
    """Return the constraint row that keeps a point of the second body in a plane of the first.

    Its value is the point's distance from the plane, m, positive on the side of the normal.

    **Arguments:** `origin`, `axis`: a point of the plane, m, and its unit normal, in the first
    body's axes. `local`: the point of the second body, m in its axes.

    >>> names, ground = ("ground", "ball"), still
    >>> ball = testing.moving((0.1, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> row = extend.point_in_plane(names, ground, ball, extend.ZERO, extend.UNIT_X, extend.ZERO)
    >>> print(f"{row.value:.1f} m")
    0.1 m
    """
    normal = first.direction(axis)
    arm = first.components(second.point(local) - first.position)
    along, bias_second = _along(second, local, normal)
    # `arm` has components in the axes of the first body, in which the plane is at rest, and
    # `relative` is their rate. These axes rotate. The second derivative of `arm` is therefore the
    # acceleration of the point minus the centripetal and Coriolis terms, of which `bias_first` is
    # the component along the normal.
    velocity = first.components(second.velocity_at(local) - first.velocity)
    relative = velocity - first.spin.cross(arm)
    spin = first.spin
    bias_first = axis.dot(spin.cross(spin.cross(arm))) + 2.0 * axis.dot(spin.cross(relative))
    jacobian = {names[0]: Wrench(-normal, axis.cross(arm)), names[1]: along}
    return Row(axis.dot(arm - origin), jacobian, bias_second - bias_first)


def turning_angle(
    names: Pair, first: Motion, second: Motion, axis: Vector, direction: Vector
) -> Row:
    """Return the angle of a direction of the second body about an axis of the first, as a `Row`.

    Its value is in rad in [-pi, pi], right-handed about the axis, from a fixed direction across the
    axis (x for the axis z) to the projection of the direction. Jacobian and bias are exact even if
    the direction is not perpendicular to the axis, but the two must not be parallel. `axis` is a
    unit vector in the first body's axes, `direction` a unit vector in the second's.

    >>> names, ground = ("ground", "ball"), still
    >>> ball = testing.moving((0.1, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> row = extend.turning_angle(names, ground, ball, extend.UNIT_Z, extend.UNIT_X)
    >>> sorted(row.jacobian)
    ['ball', 'ground']
    """
    start, quarter = transverse_axes(axis)
    cosine = perpendicular(names, first, second, start, direction)
    sine = perpendicular(names, first, second, quarter, direction)
    # c and s are the components of the direction along the transverse axes. The angle is
    # atan2(s, c), and its derivatives are valid for any length of the projected direction.
    c, s = cosine.value, sine.value
    inverse = 1.0 / (c * c + s * s)
    # The angle depends only on orientations, so that its Jacobian has moments but no forces.
    jacobian = {}
    for name in names:
        moment = sine.jacobian[name].moment * c - cosine.jacobian[name].moment * s
        jacobian[name] = Wrench(ZERO, moment * inverse)
    motions = dict(zip(names, (first, second), strict=True))
    c_rate, s_rate = row_rate(cosine, motions), row_rate(sine, motions)
    rate = (c * s_rate - s * c_rate) * inverse
    # The derivative of the rate by time, before multiplication by `inverse`. The last term comes
    # from the derivative of `inverse`.
    bias = c * sine.bias - s * cosine.bias - 2.0 * rate * (c * c_rate + s * s_rate)
    return Row(polar_angle(s, c), jacobian, bias * inverse)


def row_rate(row: Row, motions: Motions) -> Scalar:
    """Return the time derivative of a row's value for given motions of the bodies."""
    # `Motion.power` multiplies a wrench, here a part of the Jacobian, by velocity and spin.
    parts = (motions[name].power(part) for name, part in row.jacobian.items())
    return reduce(add, parts, row.time_rate)


def reversed_if_opposite(a: Vector, b: Vector) -> Vector:
    """Return the unit vector b, or -b if it is nearly opposite to the unit vector a.

    An axis and its opposite define the same joint, but opposite vectors have no shortest rotation.
    The limit, 170 degrees, is far from 90 degrees, where rounding errors would decide the sign.
    """
    return b * where(a.dot(b) < NEARLY_OPPOSITE, -1.0, 1.0)


def relative_angle_row(
    names: Pair, first: Motion, second: Motion, axis_first: Vector, axis_second: Vector
) -> Row:
    """Return the angle of the second body relative to the first about a common axis, rad in [-pi,
    pi], as a row. It is right-handed about the first body's axis. It is zero while the two frames
    differ by the shortest rotation that makes the axes parallel, or antiparallel if the components
    of `axis_first` and `axis_second` are nearly opposite."""
    a, b = unit(axis_first), unit(axis_second)
    start, _ = transverse_axes(a)
    # `direction` is `start`, which is perpendicular to a, after the shortest rotation from a to b:
    # at angle zero, it is `start` in the second body's axes.
    b = reversed_if_opposite(a, b)
    direction = start - (a + b) * (start.dot(b) / (1.0 + a.dot(b)))
    return turning_angle(names, first, second, a, direction)


def angle_about(
    names: Pair, first: Motion, second: Motion, axis: Vector, orientation: EulerParameters
) -> Row:
    """Return the second body's angle about an axis of the first, rad in [-pi, pi], as a row.
    `orientation` transforms components in the second body's axes to the first's at angle zero."""
    axis = unit(axis)
    start, _ = transverse_axes(axis)
    direction = rotation_matrix(orientation).transposed_times(start)
    return turning_angle(names, first, second, axis, direction)


Pose = tuple[Vector, Matrix]
"""Position of a body's centre of mass, m in global axes, and matrix from body to global axes."""
Velocities = tuple[Vector, Vector]
"""Velocity of a body's centre of mass, m/s in global axes, and its spin, rad/s in body axes."""


def _pose_rate(pose: Pose, velocities: Velocities) -> Pose:
    """Return the time derivative of a pose: velocity, m/s, and rate of the rotation matrix, 1/s."""
    _, rotation = pose
    velocity, spin = velocities
    # The rate of the matrix A, times any vector v, is A (spin x v). A row r of the matrix thus has
    # the rate r x spin, since r . (spin x v) = (r x spin) . v.
    rows = (rotation.row_x, rotation.row_y, rotation.row_z)
    return velocity, Matrix(*(row.cross(spin) for row in rows))


def rows_from_residual(
    names: Pair,
    labels: Sequence[str],
    residual: Callable[[Pose, Pose], Sequence[Scalar]],
    first: Motion,
    second: Motion,
) -> dict[str, Row]:
    """Return constraint rows by label, whose derivatives are found by automatic differentiation.

    A joint that calls this function defines only its constraint equations. Hand-written Jacobians
    and biases are faster.

    **Arguments:**

    - `labels`: of the rows, in the order of the residual's values.
    - `residual`: function of the poses of the first and the second body that returns a scalar for
      each label, zero if the constraint is satisfied. A pose is the position of the body's centre
      of mass, m in global axes, and the rotation matrix from body to global axes. The function
      must not depend explicitly on time.

    **Raises:** `ValueError` if the residual has another number of values than there are labels.

    >>> names, ground = ("ground", "ball"), still
    >>> ball = testing.moving((0.1, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
    >>> def residual(first, second):
    ...     return ((second[0] - first[0]).x,)
    >>> rows = extend.rows_from_residual(names, ("x",), residual, ground, ball)
    >>> print(f"{rows['x'].value:.1f} m")
    0.1 m
    """
    pair = first, second
    # JAX needs values and tangents of one type, but some components may be Python numbers.
    poses = _as_arrays(tuple((motion.position, motion.rotation) for motion in pair))
    velocities = _as_arrays(tuple((motion.velocity, motion.spin) for motion in pair))

    # The time derivatives of the residual's values, from poses and velocities of both bodies.
    def rate(
        poses: tuple[Pose, Pose], velocities: tuple[Velocities, Velocities]
    ) -> tuple[Scalar, ...]:
        pose_rates = tuple(_pose_rate(p, v) for p, v in zip(poses, velocities, strict=True))
        return jax.jvp(lambda pair: tuple(residual(*pair)), (poses,), (pose_rates,))[1]

    # The bias is the second time derivative at constant velocities and spins. `rate` is linear in
    # velocities and spins, so that its values for unit velocities and spins are the Jacobian.
    pose_rates = tuple(_pose_rate(p, v) for p, v in zip(poses, velocities, strict=True))
    biases = jax.jvp(lambda pair: rate(pair, velocities), (poses,), (pose_rates,))[1]
    values = residual(*poses)
    expected = f"{len(values)}, as many as the residual has values"
    require(len(labels) == len(values), "labels", labels, expected, "give each row a label")
    columns = [rate(poses, unit_velocity) for unit_velocity in _unit_velocities()]
    rows = {}
    for k, label in enumerate(labels):
        # Twelve derivatives in the order of `_unit_velocities`: by velocity and spin of the first
        # body, then of the second.
        derivatives = [column[k] for column in columns]
        vectors = [Vector(*derivatives[j : j + 3]) for j in range(0, 12, 3)]
        wrench_first, wrench_second = Wrench(*vectors[:2]), Wrench(*vectors[2:])
        jacobian = {names[0]: wrench_first, names[1]: wrench_second}
        rows[label] = Row(values[k], jacobian, biases[k])
    return rows


def _as_arrays(tree: PyTree) -> PyTree:
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=float), tree)


def _unit_velocities() -> list[tuple[Velocities, Velocities]]:
    zero = _as_arrays(ZERO)
    units = [_as_arrays(axis) for axis in (UNIT_X, UNIT_Y, UNIT_Z)]
    pairs = [(axis, zero) for axis in units] + [(zero, axis) for axis in units]
    rest = (zero, zero)
    return [(pair, rest) for pair in pairs] + [(rest, pair) for pair in pairs]


def distance_row(components: Iterable[Row], length: Scalar, motions: Motions) -> Row:
    """Return the row (x^2 + y^2 + ... - length^2)/(2 length), m, which holds a vector at a length.
    The values of `components` are x, y, ..., m; these rows must not have a `time_rate`."""
    # The squared length is differentiable everywhere. Dividing by 2 length gives a row in m, whose
    # derivative along the vector is 1, so that the multiplier is the force in N.
    value, bias = -0.5 * length, 0.0
    jacobian: dict[str, Wrench] = {}
    for row in components:
        slope, rate = row.value / length, row_rate(row, motions)
        for name, wrench in row.jacobian.items():
            jacobian[name] = jacobian.get(name, NO_WRENCH) + wrench * slope
        # The second derivative of x^2/(2 length) is (x'^2 + x x'')/length.
        value = value + 0.5 * slope * row.value
        bias = bias + rate * rate / length + slope * row.bias
    return Row(value, jacobian, bias)


def slope_and_curvature(function: Callable[[Scalar], Scalar], x: Scalar) -> tuple[Scalar, Scalar]:
    return value_and_slope(lambda x: value_and_slope(function, x)[1], x)


def row_following(row: Row, function: Callable[[Scalar], Scalar], t: Scalar) -> Row:
    """Return the row that makes the value of `row` follow a function of the time t, s."""

    t = jnp.asarray(t, dtype=float)
    prescribed, acceleration = slope_and_curvature(function, t)
    time_rate = add(row.time_rate, -prescribed)
    return Row(row.value - function(t), row.jacobian, row.bias - acceleration, time_rate)


def plus_multiple(first: Row, second: Row, factor: Scalar) -> Row:
    """Return a row that is `first` plus a constant `factor` times `second`."""
    jacobian = dict(first.jacobian)
    for name, wrench in second.jacobian.items():
        jacobian[name] = jacobian.get(name, NO_WRENCH) + wrench * factor
    value = add(first.value, multiply(second.value, factor))
    bias = add(first.bias, multiply(second.bias, factor))
    return Row(value, jacobian, bias, add(first.time_rate, multiply(second.time_rate, factor)))
