"""Spatial inertia of a rigid composite of bodies, about the origin of its tree and in its axes."""

from collections.abc import Callable
from dataclasses import dataclass

from ...math.vectors import Matrix, Scalar, Vector, add, multiply, subtract
from ...model.bodies import Body
from ...model.joints.motion_subspaces import Twist


@dataclass(frozen=True, slots=True)
class Inertia:
    """Spatial inertia about the tree's origin, in the tree's axes.

    It maps spin w and velocity v to the angular momentum I w + C v and the momentum C^T w + m v,
    with I = `angular` (kg m^2), C = `coupling` (kg m) and m = `mass` (kg).
    """

    mass: Scalar
    coupling: Matrix
    angular: Matrix

    def __add__(self, other: "Inertia") -> "Inertia":
        return Inertia(
            add(self.mass, other.mass),
            self.coupling + other.coupling,
            self.angular + other.angular,
        )

    def momentum(self, twist: Twist) -> Twist:
        """Return angular momentum (kg m^2/s) and momentum (kg m/s) for a twist."""
        return Twist(
            self.angular @ twist.angular + self.coupling @ twist.linear,
            self.coupling.transposed_times(twist.angular) + twist.linear * self.mass,
        )

    def without(self, axis: Vector, whole: Twist, rest: Twist) -> "Inertia":
        """Return the inertia without the part that belongs to rotation about `axis`.

        The part subtracted is the outer product of `axis` with the momentum `whole`, plus the
        transposed product of `axis` with `rest`, so that the result stays symmetric.

        **Arguments:**

        - `axis`: unit vector of the rotation, or zero for a translation.
        - `whole`: momentum for a unit of the joint's speed.
        - `rest`: `whole` without its components about the axes of the joint.
        """
        return Inertia(
            self.mass,
            self.coupling.minus_outer(axis, whole.linear),
            self.angular.minus_outer(axis, whole.angular).minus_outer(rest.angular, axis),
        )


def central_inertia(body: Body, rotation: Matrix) -> Matrix:
    """Return a body's inertia about its centre of mass in the tree's axes, kg m^2.

    `rotation` maps body components to the tree's axes.
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
    lower = {(i, j): entry(i, j) for i in range(3) for j in range(i + 1)}
    return Matrix(*(Vector(*(lower[max(i, j), min(i, j)] for j in range(3))) for i in range(3)))
