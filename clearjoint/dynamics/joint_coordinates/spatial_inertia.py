"""Inertia of bodies that hang together, seen from the one that carries them."""

from collections.abc import Callable
from dataclasses import dataclass

from ...math.vectors import Matrix, Scalar, Vector, add, multiply, subtract
from ...model.bodies import Body
from ...model.joints.motion_subspaces import Twist


@dataclass(frozen=True, slots=True)
class Inertia:
    """Angular momentum I w + C v and momentum C^T w + m v for a spin w and a velocity v.

    Both about the tree's origin and in its axes; `angular` is I, `coupling` C, `mass` m.
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
        """Angular momentum, and momentum."""
        return Twist(
            self.angular @ twist.angular + self.coupling @ twist.linear,
            self.coupling.transposed_times(twist.angular) + twist.linear * self.mass,
        )

    def without(self, axis: Vector, whole: Twist, rest: Twist) -> "Inertia":
        """Less axis . (the momentum `whole`) and its transpose, of which the former took a part."""
        return Inertia(
            self.mass,
            self.coupling.minus_outer(axis, whole.linear),
            self.angular.minus_outer(axis, whole.angular).minus_outer(rest.angular, axis),
        )


def central_inertia(body: Body, rotation: Matrix) -> Matrix:
    """The inertia about the centre of mass in the tree's axes."""
    rows = (rotation.row_x, rotation.row_y, rotation.row_z)
    images = [
        body.inertia @ row
        if isinstance(body.inertia, Matrix)
        else row.componentwise_product(body.inertia)
        for row in rows
    ]
    return _symmetric(lambda i, j: rows[i].dot(images[j]))


def inertia(body: Body, place: Vector, central: Matrix) -> Inertia:
    """The inertia of a body about the tree's origin."""
    h, r = place * body.mass, tuple(place)
    first = tuple(h)

    def shift(i: int, j: int) -> Scalar:
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
