"""The bodies of a tree in one frame: where they are, how they may move, what they weigh.

All vectors of a tree are in the axes of its root body and from a point that the root cannot leave:
the joint that carries it, or, of a free body, the point that its position variable tells. So the
root's inertia is constant, constant vectors keep their structural zeros, and the mass matrix holds
total mass times identity where the root's velocity is an unknown.
"""

from collections.abc import Callable
from dataclasses import dataclass

from .bodies import Body
from .joints.freedoms import AbstractFreedom, JointState, Twist
from .vectors import (
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


@dataclass(frozen=True, slots=True)
class Link:
    """A body of a tree at one instant.

    - `rotation` turns body components into the tree's; `place`: the centre of mass.
    - `spin`; `turn_bias`, `bias`: accelerations of body and centre of mass at constant speeds, and
      `spread`, the matrix by which the latter grows with the distance.
    - `columns`: for each speed of its own, spin, and velocity of its point at the origin.
    """

    rotation: Matrix
    place: Vector
    spin: Vector
    turn_bias: Vector
    bias: Vector
    spread: Matrix
    columns: tuple[Twist, ...]


GROUND_LINK = Link(IDENTITY, ZERO, ZERO, ZERO, ZERO, NOTHING, ())


def free_link(local: Vector, spin: Vector) -> Link:
    """A free body by its point `local`: three velocities of that, and its spin."""
    spread, axes = _spread(spin, ZERO), (UNIT_X, UNIT_Y, UNIT_Z)
    columns = [Twist(ZERO, axis) for axis in axes] + [Twist(axis, ZERO) for axis in axes]
    return Link(IDENTITY, -local, spin, ZERO, spread @ -local, spread, tuple(columns))


def jointed_link(parent: Link | None, freedom: AbstractFreedom, state: JointState) -> Link:
    """A body carried by a joint: on its parent, or as the root of a tree on the ground."""
    if parent is None:
        return _carried(IDENTITY, ZERO, GROUND_LINK, ZERO, freedom, state)
    rotation = parent.rotation.times(freedom.rotation(state.position))
    arm = parent.rotation @ freedom.point_parent
    bias = parent.bias + parent.spread @ arm
    return _carried(rotation, parent.place + arm, parent, bias, freedom, state)


def _carried(
    rotation: Matrix,
    point: Vector,
    parent: Link,
    bias: Vector,
    freedom: AbstractFreedom,
    state: JointState,
) -> Link:
    """A body whose joint is at `point` of its parent, which has the given bias acceleration."""
    twist, own = freedom.twist(state), freedom.bias(state)
    turn, slide = rotation @ twist.turn, rotation @ twist.slide
    spin = parent.spin + turn
    turn_bias = parent.turn_bias + parent.spin.cross(turn) + rotation @ own.turn
    spread = _spread(spin, turn_bias)
    displacement = freedom.displacement(state.position)
    arm = rotation @ (displacement - freedom.point_child)
    sliding = (spin * 2.0).cross(slide) + rotation @ own.slide
    joint = point + rotation @ displacement
    columns = tuple(
        _at_origin(Twist(rotation @ column.turn, rotation @ column.slide), joint)
        for column in freedom.columns(state.position)
    )
    return Link(
        rotation, point + arm, spin, turn_bias, bias + sliding + spread @ arm, spread, columns
    )


def _at_origin(twist: Twist, place: Vector) -> Twist:
    """The twist at the tree's origin of a body with the given one at a place."""
    return Twist(twist.turn, twist.slide + place.cross(twist.turn))


def _spread(spin: Vector, turn_bias: Vector) -> Matrix:
    """The matrix of r -> turn_bias x r + spin x (spin x r)."""
    w, b = spin, turn_bias
    xx, yy, zz = (multiply(part, part) for part in w)
    xy, xz, yz = multiply(w.x, w.y), multiply(w.x, w.z), multiply(w.y, w.z)
    return Matrix(
        Vector(subtract(0.0, add(yy, zz)), subtract(xy, b.z), add(xz, b.y)),
        Vector(add(xy, b.z), subtract(0.0, add(xx, zz)), subtract(yz, b.x)),
        Vector(subtract(xz, b.y), add(yz, b.x), subtract(0.0, add(xx, yy))),
    )


@dataclass(frozen=True, slots=True)
class Inertia:
    """Mass, first moment and moments of inertia about the tree's origin."""

    mass: Scalar
    first: Vector
    second: Matrix

    def __add__(self, other: "Inertia") -> "Inertia":
        return Inertia(
            add(self.mass, other.mass), self.first + other.first, self.second.plus(other.second)
        )

    def momentum(self, twist: Twist) -> Twist:
        """Angular momentum about the origin, and momentum, for a spin and a velocity there."""
        angular = self.second @ twist.turn + self.first.cross(twist.slide)
        return Twist(angular, twist.slide * self.mass + twist.turn.cross(self.first))


def central_inertia(body: Body, rotation: Matrix) -> Matrix:
    """The inertia about the centre of mass in the tree's axes."""
    rows = (rotation.row_x, rotation.row_y, rotation.row_z)
    images = [
        body.inertia @ row if isinstance(body.inertia, Matrix) else row.times(body.inertia)
        for row in rows
    ]
    return _symmetric(lambda i, j: rows[i].dot(images[j]))


def inertia(body: Body, place: Vector, central: Matrix) -> Inertia:
    """The inertia of a body about the tree's origin."""
    first = place * body.mass
    h, r = list(first), list(place)

    def shift(i: int, j: int) -> Scalar:
        if i != j:
            return subtract(0.0, multiply(h[i], r[j]))
        k, m = (i + 1) % 3, (i + 2) % 3
        return add(multiply(h[k], r[k]), multiply(h[m], r[m]))

    return Inertia(body.mass, first, central.plus(_symmetric(shift)))


def _symmetric(entry: Callable[[int, int], Scalar]) -> Matrix:
    lower = {(i, j): entry(i, j) for i in range(3) for j in range(i + 1)}
    return Matrix(*(Vector(*(lower[max(i, j), min(i, j)] for j in range(3))) for i in range(3)))
