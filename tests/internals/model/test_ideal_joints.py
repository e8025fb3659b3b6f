"""Constraint rows of ideal joints: values against NumPy, in random poses, and what they hold.

Jacobians and biases are compared with differences of the values in tests/test_conformance.py.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import clearjoint as cj
from clearjoint._math.rotations import transverse_axes
from clearjoint._model.joints import ideal
from clearjoint._model.joints.constraint_rows import row_following
from clearjoint.extend import Matrix, Motion, Row, Vector, pack, unpack

RANDOM = np.random.default_rng(6)
N = 12
P1, P2, A1, A2 = RANDOM.normal(size=(4, 3))
TURN = Rotation.from_rotvec([0.3, -1.2, 0.8])
QUATERNION = TURN.as_quat(scalar_first=True)
compare = functools.partial(np.testing.assert_allclose, rtol=1e-11, atol=1e-12)


class Bodies:
    """Two bodies in `n` poses with `n` twists, random unless set."""

    def __init__(self, n=N):
        self.position, self.velocity, self.spin = RANDOM.normal(size=(3, 2, n, 3))
        self.rotation = Rotation.random(2 * n, rng=RANDOM).as_matrix().reshape(2, n, 3, 3)

    def motion(self, body):
        return Motion(
            vector(self.position[body]),
            matrix(self.rotation[body]),
            vector(self.velocity[body]),
            vector(self.spin[body]),
        )

    def motions(self):
        return {"a": self.motion(0), "b": self.motion(1)}


def vector(rows):
    return Vector(*np.moveaxis(rows, -1, 0))


def matrix(batch):
    return Matrix(*(vector(batch[..., i, :]) for i in range(3)))


def spherical(r, a):
    return np.moveaxis(r[0] + a[0] @ P1 - r[1] - a[1] @ P2, -1, 0)


def right_angles(a, pairs):
    return [np.sum((a[0] @ u) * (a[1] @ v), axis=-1) for u, v in pairs]


def across(axis):
    return [pack(v) for v in transverse_axes(Vector(*axis / np.linalg.norm(axis)))]


def tilts(a):
    """For eq. (26): the first axis at right angles to two directions across the second."""
    axis = A1 / np.linalg.norm(A1)
    return right_angles(a, [(axis, v) for v in across(A2)])


def rotations(a):
    x, y, z = np.eye(3)
    to_second = TURN.inv().apply
    return right_angles(a, [(y, to_second(z)), (z, to_second(x)), (x, to_second(y))])


def inline(r, a):
    gap = r[1] + a[1] @ P2 - r[0] - a[0] @ P1
    return [np.sum((a[0] @ v) * gap, axis=-1) for v in across(A1)]


def revolute(r, a):
    return [*spherical(r, a), *tilts(a)]


def cylindrical(r, a):
    return [*inline(r, a), *tilts(a)]


def fixed(r, a):
    return [*spherical(r, a), *rotations(a)]


def prismatic(r, a):
    return [*inline(r, a), *rotations(a)]


def universal(r, a):
    axes = [axis / np.linalg.norm(axis) for axis in (A1, A2)]
    return [*spherical(r, a), *right_angles(a, [axes])]


def plane(r, a):
    height = np.sum((a[0] @ A1) * (r[1] + a[1] @ P2 - r[0]), axis=-1) - A1 @ P1
    return [height / np.linalg.norm(A1)]


REVOLUTE = cj.RevoluteJoint("a", "b", P1, P2, A1, A2)
CASES = {
    "spherical": (cj.SphericalJoint("a", "b", P1, P2), spherical),
    "revolute": (REVOLUTE, revolute),
    "fixed": (cj.FixedJoint("a", "b", P1, P2, QUATERNION), fixed),
    "inline": (cj.InlineJoint("a", "b", P1, P2, A1), inline),
    "cylindrical": (cj.CylindricalJoint("a", "b", P1, P2, A1, A2), cylindrical),
    "prismatic": (cj.PrismaticJoint("a", "b", P1, P2, A1, QUATERNION), prismatic),
    "universal": (cj.UniversalJoint("a", "b", P1, P2, A1, A2), universal),
    "point in plane": (cj.PointInPlaneJoint("a", "b", P1, P2, A1), plane),
}


@pytest.mark.parametrize("case", CASES)
def test_rows_of_a_joint_are_its_residual(case):
    joint, residual = CASES[case]
    bodies = Bodies()
    rows = unpack(joint).rows(bodies.motions(), 0.0).values()
    compare([row.value for row in rows], residual(bodies.position, bodies.rotation))


def test_rows_from_a_residual_have_a_label_each():
    def residual(first, second):
        return tuple(first[0] - second[0])

    motions = Bodies().motions().values()
    with pytest.raises(ValueError, match="`labels` must be 3, as many as the residual has values"):
        cj.extend.rows_from_residual(("a", "b"), ["x", "y"], residual, *motions)


def test_a_row_follows_two_functions_of_time():
    row = Row(jnp.asarray(2.0), {}, jnp.asarray(0.5))
    twice = row_following(row_following(row, jnp.sin, 0.3), lambda t: t**3, 0.3)
    once = row_following(row, lambda t: jnp.sin(t) + t**3, 0.3)
    jax.tree.map(compare, twice, once)


def spread(wrench):
    """Force and moment as arrays of shape (n, 3)."""
    return [np.broadcast_to(pack(v), (N, 3)) for v in (wrench.force, wrench.moment)]


AXES = [
    *np.eye(3),
    *-np.eye(3),
    *RANDOM.normal(size=(6, 3)),
    np.array([1e-9, 0.0, -1.0]),
    np.array([0.0, 1e-5, -1.0]),
    np.array([0.0, -1e-12, 1.0]),
]


def jacobian(joint, bodies):
    """Of the rows at the first pose, with respect to (velocity, spin) of both bodies."""
    rows = unpack(joint).rows(bodies.motions(), 0.0).values()
    np.testing.assert_allclose([np.ravel(row.value)[0] for row in rows], 0.0, atol=1e-14)
    parts = [spread(row.jacobian["a"]) + spread(row.jacobian["b"]) for row in rows]
    return np.array([np.concatenate([part[0] for part in four]) for four in parts])


def joined(joint, turn):
    """Bodies with coincident points, whose second is turned against the first."""
    bodies = Bodies()
    bodies.rotation[1] = bodies.rotation[0] @ turn
    first = bodies.position[0] + bodies.rotation[0] @ joint.point_first
    bodies.position[1] = first - bodies.rotation[1] @ joint.point_second
    return bodies


def free_rank(matrix):
    """Rank with a gap: no singular value is small."""
    return np.linalg.matrix_rank(matrix, tol=0.1)


STILL = np.zeros(3)


def check_freedom(joint, turn, count, shift=STILL, about=STILL):
    """Assert that the joint has so many independent rows, which leave the second body free to move
    along `shift`, in the first body's axes, and about `about`, in its own."""
    bodies = joined(joint, turn)
    first, second = bodies.rotation
    bodies.position[1] += 2.5 * first @ shift
    j = jacobian(joint, bodies)
    assert j.shape == (count, 12) and free_rank(j) == count
    velocity = first[0] @ shift - second[0] @ np.cross(about, P2)
    np.testing.assert_allclose(j @ np.concatenate([np.zeros(6), velocity, about]), 0.0, atol=1e-13)


@pytest.mark.parametrize("antiparallel", [False, True])
def test_revolute_joint_has_five_independent_rows_for_every_axis(antiparallel):
    """And leaves the second body free to turn about the axis, frames antiparallel or not."""
    for axis in AXES:
        axis = axis / np.linalg.norm(axis)
        turn = Rotation.from_rotvec(0.7 * axis)
        if antiparallel:
            across = np.cross(axis, [0.6, 0.0, 0.8] if abs(axis[1]) < 0.9 else [1.0, 0.0, 0.0])
            turn = turn * Rotation.from_rotvec(np.pi * across / np.linalg.norm(across))
        axis_second = turn.inv().apply(axis)
        joint = cj.RevoluteJoint("a", "b", P1, P2, 3.0 * axis, 0.2 * axis_second)
        check_freedom(joint, turn.as_matrix(), 5, about=axis_second)


@pytest.mark.parametrize(
    ("joint", "turn", "count"),
    [
        (cj.RevoluteJoint("a", "b", P1, P2, A1, -A1), np.eye(3), 5),
        (CASES["spherical"][0], Rotation.random(rng=RANDOM).as_matrix(), 3),
        (CASES["fixed"][0], TURN.as_matrix(), 6),
    ],
    ids=["revolute with axes that point against each other", "spherical", "fixed"],
)
def test_joints_have_independent_rows(joint, turn, count):
    check_freedom(joint, turn, count)


def test_sliding_joints_have_independent_rows_and_leave_the_slide_free():
    """Along every axis, at every offset along it: turned by TURN, and about the axis or not."""
    for axis in AXES:
        axis = axis / np.linalg.norm(axis)
        prismatic = cj.PrismaticJoint("a", "b", P1, P2, 3.0 * axis, QUATERNION)
        cylindrical = cj.CylindricalJoint("a", "b", P1, P2, axis, TURN.inv().apply(axis))
        about = Rotation.from_rotvec(0.7 * axis) * TURN
        check_freedom(prismatic, TURN.as_matrix(), 5, axis)
        check_freedom(cylindrical, about.as_matrix(), 4, axis)
        inline = cj.InlineJoint("a", "b", P1, P2, axis)
        check_freedom(inline, Rotation.random(rng=RANDOM).as_matrix(), 2, axis)


@pytest.mark.parametrize("case", ["revolute", "fixed", "cylindrical", "prismatic"])
def test_a_tilted_joint_violates_its_rows(case):
    """A turn by 1e-3 about each axis that the joint holds shows as 1e-3 in its rows."""
    joint = CASES[case][0]
    turned = case in ("fixed", "prismatic")
    start = TURN if turned else Rotation.align_vectors(A1, A2)[0]
    held = np.eye(3) if turned else np.cross(A1, np.eye(3)[:2])
    for axis in held:
        tilt = Rotation.from_rotvec(1e-3 * axis / np.linalg.norm(axis))
        rows = unpack(joint).rows(joined(joint, (tilt * start).as_matrix()).motions(), 0.0)
        size = np.linalg.norm([np.ravel(row.value)[0] for row in rows.values()])
        assert size == pytest.approx(1e-3, rel=1e-2)


def test_assembly_knows_every_joint_that_holds_an_orientation():
    """Rows of such a joint also vanish half a revolution off, which assembly must refuse."""
    values = [value for value in vars(ideal).values() if isinstance(value, type)]
    classes = [value for value in values if issubclass(value, ideal.AbstractPairJoint)]
    oriented = [c for c in classes if "orientation" in getattr(c, "__dataclass_fields__", {})]
    assert len(oriented) >= 2
    assert all(issubclass(c, ideal.AbstractOrientedJoint) for c in oriented)
