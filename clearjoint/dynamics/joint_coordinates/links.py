"""Kinematics and inertia of the bodies of a tree, in a frame common to the tree.

The axes of the frame are those of the tree's root body. Its origin is a point of the root: the
joint on the ground or, for a free root, the centre of mass. So the root's inertia is constant,
constant vectors keep their exact zeros, and for a free root the mass matrix contains the total mass
times the identity. A twist is the angular velocity of a body with the velocity of its point at the
origin. "At constant speeds" means: the part of an acceleration that remains if the time derivatives
of all joint speeds are zero.
"""

from collections.abc import Callable
from dataclasses import dataclass

from ...math.vectors import (
    IDENTITY,
    NOTHING,
    UNIT_X,
    UNIT_Y,
    UNIT_Z,
    ZERO,
    Matrix,
    Scalar,
    Vector,
    add,
    multiply,
    subtract,
)
from ...model.bodies import Body
from ...model.joints.motion_subspaces import AbstractMotionSubspace, JointState, Twist


@dataclass(frozen=True, slots=True)
class Link:
    """A body of a tree at one instant; all vectors are in the tree's axes.

    - `rotation`: matrix that maps components in body axes to components in the tree's axes.
    - `centre`: m, from the tree's origin to the centre of mass.
    - `spin`: rad/s, angular velocity.
    - `angular_bias`: rad/s^2, angular acceleration at constant speeds.
    - `bias`: m/s^2, acceleration of the centre of mass at constant speeds.
    - `gradient`: 1/s^2, matrix that maps the vector between two points of the body to the
      difference of their accelerations at constant speeds.
    - `columns`: for each speed of the link's joint, the twist that a unit of this speed causes.
    """

    rotation: Matrix
    centre: Vector
    spin: Vector
    angular_bias: Vector
    bias: Vector
    gradient: Matrix
    columns: tuple[Twist, ...]


GROUND_LINK = Link(IDENTITY, ZERO, ZERO, ZERO, ZERO, NOTHING, ())
"""The ground, as the parent of links."""


def free_link(spin: Vector) -> Link:
    """Return the link of a free body with a given spin, rad/s, in body axes.

    Its six speeds are the velocity of the centre of mass and the spin.
    """
    axes = UNIT_X, UNIT_Y, UNIT_Z
    columns = [Twist(ZERO, axis) for axis in axes] + [Twist(axis, ZERO) for axis in axes]
    return Link(IDENTITY, ZERO, spin, ZERO, ZERO, _gradient(spin, ZERO), tuple(columns))


def jointed_link(
    parent: Link | None, motion_subspace: AbstractMotionSubspace, state: JointState
) -> Link:
    """Return the link of a body that a joint carries on its parent.

    **Arguments:** `parent`: link of the parent; ``None`` for the ground. `motion_subspace`: the
    relative motions that the joint allows. `state`: coordinates and speeds of the joint.
    """
    # Rotation from the body's axes to the tree's, position of the joint's point on the parent, m,
    # and acceleration of this point at constant speeds, m/s^2. The tree's axes are those of its
    # root, and on the ground its origin is the joint's point.
    rotation, point, bias = IDENTITY, ZERO, ZERO
    if parent is None:
        parent = GROUND_LINK
    else:
        rotation = parent.rotation @ motion_subspace.rotation(state.position)
        to_joint = parent.rotation @ motion_subspace.point_parent
        point, bias = parent.centre + to_joint, parent.bias + parent.gradient @ to_joint
    # Relative motion in the joint, and its acceleration at constant speeds. Both are given in the
    # axes of the carried body, so its own rotation leads to the tree's axes.
    twist, joint_bias = motion_subspace.twist(state), motion_subspace.bias(state)
    angular, linear = rotation @ twist.angular, rotation @ twist.linear
    spin = parent.spin + angular
    angular_bias = parent.angular_bias + parent.spin.cross(angular) + rotation @ joint_bias.angular
    gradient = _gradient(spin, angular_bias)
    # From the joint's point on the parent to the body's centre of mass: over the joint's point on
    # the body. The displacement is fixed in the axes of the carried body, so that the Coriolis
    # acceleration has the spin of this body, and `gradient` acts on the whole arm.
    displacement = motion_subspace.displacement(state.position)
    arm = rotation @ (displacement - motion_subspace.point_child)
    coriolis = (spin * 2.0).cross(linear) + rotation @ joint_bias.linear
    columns = []
    for column in motion_subspace.columns(state.position):
        # The velocity of the joint's point becomes that of the body's point at the origin.
        axis, velocity = rotation @ column.angular, rotation @ column.linear
        columns.append(Twist(axis, velocity + point.cross(axis)))
    bias = bias + coriolis + gradient @ arm
    return Link(rotation, point + arm, spin, angular_bias, bias, gradient, tuple(columns))


def _gradient(spin: Vector, angular_bias: Vector) -> Matrix:
    """Return the matrix, 1/s^2, that maps r to angular_bias x r + spin x (spin x r)."""
    w, b = spin, angular_bias
    xx, yy, zz = (multiply(part, part) for part in w)
    xy, xz, yz = multiply(w.x, w.y), multiply(w.x, w.z), multiply(w.y, w.z)
    return Matrix(
        Vector(subtract(0.0, add(yy, zz)), subtract(xy, b.z), add(xz, b.y)),
        Vector(add(xy, b.z), subtract(0.0, add(xx, zz)), subtract(yz, b.x)),
        Vector(subtract(xz, b.y), add(yz, b.x), subtract(0.0, add(xx, yy))),
    )


@dataclass(frozen=True, slots=True)
class Inertia:
    """Spatial inertia of one body or of several connected bodies, about the tree's origin and in
    its axes.

    It maps spin w and velocity v to the angular momentum I w + C v and the momentum C^T w + m v,
    with I = `angular` (kg m^2), C = `coupling` (kg m) and m = `mass` (kg).
    """

    mass: Scalar
    coupling: Matrix
    angular: Matrix

    def __add__(self, other: "Inertia") -> "Inertia":
        return Inertia(
            add(self.mass, other.mass), self.coupling + other.coupling, self.angular + other.angular
        )

    def momentum(self, twist: Twist) -> Twist:
        """Return angular momentum (kg m^2/s) and momentum (kg m/s) for a twist."""
        return Twist(
            self.angular @ twist.angular + self.coupling @ twist.linear,
            self.coupling.transposed_times(twist.angular) + twist.linear * self.mass,
        )

    def without(self, axis: Vector, whole: Twist, rest: Twist) -> "Inertia":
        """Return the inertia of carried bodies that a joint transmits to its carrier, if these
        bodies do not follow the carrier's rotation about the joint's axis.

        Let M be the 6x6 matrix of this inertia and P = 1 - column axis^T, which takes the rotation
        about the axis from a twist. The result is P^T M P = M - axis whole^T - rest axis^T, in
        which `axis` has a linear part of zero. For a joint of several axes, the method is called
        once for each of them.

        **Arguments:**

        - `axis`: unit vector of the rotation, or zero for a translation.
        - `whole`: momentum of these bodies for a unit of the joint's speed.
        - `rest`: `whole` without its components about the axes of the joint.
        """
        return Inertia(
            self.mass,
            self.coupling.minus_outer(axis, whole.linear),
            self.angular.minus_outer(axis, whole.angular).minus_outer(rest.angular, axis),
        )


def central_inertia(body: Body, rotation: Matrix) -> Matrix:
    """Return a body's inertia about its centre of mass in the tree's axes, kg m^2.

    **Arguments:** `rotation`: matrix that maps components in body axes to the tree's axes.
    """
    rows = (rotation.row_x, rotation.row_y, rotation.row_z)
    images = [
        body.inertia @ row
        if isinstance(body.inertia, Matrix)
        else row.componentwise_product(body.inertia)
        for row in rows
    ]
    return _symmetric(lambda i, j: rows[i].dot(images[j]))


def inertia(body: Body, centre: Vector, central: Matrix) -> Inertia:
    """Return the spatial inertia of a body about the tree's origin.

    **Arguments:** `centre`: m, the centre of mass from the tree's origin; `central`: kg m^2, the
    inertia about the centre of mass, in the tree's axes.
    """
    # The first moment of mass, kg m, determines the coupling, which is its cross-product matrix.
    h, r = centre * body.mass, tuple(centre)
    first = tuple(h)

    def shift(i: int, j: int) -> Scalar:  # parallel axes: m (r.r identity - r r^T)
        if i != j:
            return subtract(0.0, multiply(first[i], r[j]))
        k, m = (i + 1) % 3, (i + 2) % 3
        return add(multiply(first[k], r[k]), multiply(first[m], r[m]))

    coupling = Matrix(
        Vector(0.0, subtract(0.0, h.z), h.y),
        Vector(h.z, 0.0, subtract(0.0, h.x)),
        Vector(subtract(0.0, h.y), h.x, 0.0),
    )
    return Inertia(body.mass, coupling, central + _symmetric(shift))


def _symmetric(entry: Callable[[int, int], Scalar]) -> Matrix:
    """Return a symmetric matrix, whose lower triangle consists of the results of a function of the
    row and column numbers, 0 to 2."""
    lower = {(i, j): entry(i, j) for i in range(3) for j in range(i + 1)}
    return Matrix(*(Vector(*(lower[max(i, j), min(i, j)] for j in range(3))) for i in range(3)))
