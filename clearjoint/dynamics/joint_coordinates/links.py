"""The bodies of a tree in one frame: where they are, and how they may move.

All vectors of a tree are in the axes of its root body and from a point that the root carries along:
the joint on the ground, or, of a free body, its centre of mass. So the root's inertia is constant,
constant vectors keep their structural zeros, and the mass matrix holds total mass times identity
where the root's velocity is an unknown.
"""

from dataclasses import dataclass

from ...math.vectors import (
    IDENTITY,
    NOTHING,
    UNIT_X,
    UNIT_Y,
    UNIT_Z,
    ZERO,
    Matrix,
    Vector,
    add,
    multiply,
    subtract,
)
from ...model.joints.motion_subspaces import AbstractMotionSubspace, JointState, Twist


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


def free_link(spin: Vector) -> Link:
    """A free body: three velocities of its centre of mass, and its spin."""
    axes = UNIT_X, UNIT_Y, UNIT_Z
    columns = [Twist(ZERO, axis) for axis in axes] + [Twist(axis, ZERO) for axis in axes]
    return Link(IDENTITY, ZERO, spin, ZERO, ZERO, _spread(spin, ZERO), tuple(columns))


def jointed_link(
    parent: Link | None, motion_subspace: AbstractMotionSubspace, state: JointState
) -> Link:
    """A body carried by a joint: on its parent, or as the root of a tree on the ground."""
    if parent is None:
        return _carried(IDENTITY, ZERO, GROUND_LINK, ZERO, motion_subspace, state)
    rotation = parent.rotation @ motion_subspace.rotation(state.position)
    arm = parent.rotation @ motion_subspace.point_parent
    bias = parent.bias + parent.spread @ arm
    return _carried(rotation, parent.place + arm, parent, bias, motion_subspace, state)


def _carried(
    rotation: Matrix,
    point: Vector,
    parent: Link,
    bias: Vector,
    motion_subspace: AbstractMotionSubspace,
    state: JointState,
) -> Link:
    """A body whose joint is at `point` of its parent, which has the given bias acceleration."""
    twist, own = motion_subspace.twist(state), motion_subspace.bias(state)
    turn, slide = rotation @ twist.angular, rotation @ twist.linear
    spin = parent.spin + turn
    turn_bias = parent.turn_bias + parent.spin.cross(turn) + rotation @ own.angular
    spread = _spread(spin, turn_bias)
    displacement = motion_subspace.displacement(state.position)
    arm = rotation @ (displacement - motion_subspace.point_child)
    sliding = (spin * 2.0).cross(slide) + rotation @ own.linear
    columns = tuple(
        _at_origin(Twist(rotation @ column.angular, rotation @ column.linear), point)
        for column in motion_subspace.columns(state.position)
    )
    return Link(
        rotation, point + arm, spin, turn_bias, bias + sliding + spread @ arm, spread, columns
    )


def _at_origin(twist: Twist, place: Vector) -> Twist:
    """The twist at the tree's origin of a body with the given one at a place."""
    return Twist(twist.angular, twist.linear + place.cross(twist.angular))


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
