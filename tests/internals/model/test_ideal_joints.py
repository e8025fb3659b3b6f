"""Constraint rows of ideal joints: values against NumPy, in random poses.

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


def test_assembly_knows_every_joint_that_holds_an_orientation():
    """Rows of such a joint also vanish half a revolution off, which assembly must refuse."""
    values = [value for value in vars(ideal).values() if isinstance(value, type)]
    classes = [value for value in values if issubclass(value, ideal.AbstractPairJoint)]
    oriented = [c for c in classes if "orientation" in getattr(c, "__dataclass_fields__", {})]
    assert len(oriented) >= 2
    assert all(issubclass(c, ideal.AbstractOrientedJoint) for c in oriented)
