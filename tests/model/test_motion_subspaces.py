"""Joint coordinates of each ideal joint: kinematics of the child, by differences and by the joint's
own rows."""

import jax
import numpy as np
import pytest

import clearjoint as cj
from clearjoint.extend import EulerParameters, JointState, Vector, normalised, pack, unpack

POINTS, AXES = ((0.1, 0.2, -0.3), (-0.2, 0.4, 0.1)), ((1.0, 2.0, 2.0), (0.5, -1.0, 0.3))
UNIT = np.array([0.5, -0.1, 0.7, 0.5])
JOINTS = {
    "revolute": cj.RevoluteJoint("a", "b", *POINTS, *AXES),
    "spherical": cj.SphericalJoint("a", "b", *POINTS),
    "fixed": cj.FixedJoint("a", "b", *POINTS, UNIT),
    "prismatic": cj.PrismaticJoint("a", "b", *POINTS, AXES[0], UNIT),
    "planar": cj.PlanarJoint("a", "b", *POINTS, *AXES),
    "screw": cj.ScrewJoint("a", "b", *POINTS, *AXES, lead=-0.7),
    "opposite screw": cj.ScrewJoint("a", "b", *POINTS, AXES[0], (-1.0, -2.0, -2.0), lead=0.4),
    "universal": cj.UniversalJoint("a", "b", *POINTS, *AXES),
}
POSITIONS = {
    "revolute": 0.4,
    "spherical": EulerParameters(*UNIT / np.linalg.norm(UNIT)),
    "fixed": (),
    "prismatic": 0.4,
    "planar": (0.4, -0.3, 0.7),
    "screw": 0.4,
    "opposite screw": 0.4,
    "universal": (0.4, -0.3),
}
SPEEDS = (1.5, -0.8, 0.6)
STEP = 1e-5
each = pytest.mark.parametrize("name", JOINTS)
both = pytest.mark.parametrize("parent", ["a", "b"])


def subspace_and_state(name, parent):
    """The motion subspace of a joint, and a state of it with all speeds."""
    subspace = unpack(JOINTS[name]).motion_subspace(parent)
    position = POSITIONS[name]
    return subspace, JointState(position, SPEEDS[: len(subspace.columns(position))])


def numbers(tree):
    return np.array([float(leaf) for leaf in jax.tree.leaves(tree)])


def later(subspace, state, time):
    """The state after a short time at constant speeds, to first order, and its rotation matrix."""
    rates = subspace.rates(state)
    position = jax.tree.map(lambda value, rate: value + time * rate, state.position, rates)
    turned = cj.extend.rotation_matrix(normalised(subspace.orientation(position)))
    return JointState(position, state.speeds), np.asarray(pack(turned))


@each
@both
def test_the_twist_is_the_rate_of_the_pose(name, parent):
    subspace, state = subspace_and_state(name, parent)
    twist = subspace.twist(state)
    (before, first), (after, second) = (later(subspace, state, t) for t in (-STEP, STEP))
    middle = later(subspace, state, 0.0)[1]
    spin = middle.T @ (second - first) / (2.0 * STEP)
    expected = np.cross(numbers(twist.angular), np.eye(3)).T
    np.testing.assert_allclose(spin, expected, rtol=0.0, atol=1e-9)
    ends = [numbers(subspace.displacement(one.position)) for one in (before, after)]
    rate = (ends[1] - ends[0]) / (2.0 * STEP)
    np.testing.assert_allclose(rate, numbers(twist.linear), rtol=0.0, atol=1e-9)
    twists = [numbers((one.angular, one.linear)) for one in map(subspace.twist, (before, after))]
    bias = subspace.bias(state)
    rates = (twists[1] - twists[0]) / (2.0 * STEP)
    np.testing.assert_allclose(numbers((bias.angular, bias.linear)), rates, rtol=0.0, atol=1e-9)


@each
@both
def test_encoding_is_the_inverse_and_the_joint_is_satisfied(name, parent):
    subspace, state = subspace_and_state(name, parent)
    orientation = normalised(subspace.orientation(state.position))
    apart, twist = subspace.displacement(state.position), subspace.twist(state)
    found = subspace.encode(cj.extend.Relative(orientation, apart, twist))
    np.testing.assert_allclose(
        numbers(found.position), numbers(state.position), rtol=0.0, atol=1e-14
    )
    np.testing.assert_allclose(numbers(found.speeds), state.speeds, rtol=0.0, atol=1e-14)
    rotation = subspace.rotation(state.position)
    np.testing.assert_allclose(
        pack(rotation), pack(cj.extend.rotation_matrix(orientation)), rtol=0.0, atol=1e-14
    )
    # The parent rests in the origin; the child's point is `apart` from the parent's.
    here = cj.body_state((0.0, 0.0, 0.0))
    at = subspace.point_parent + rotation @ (apart - subspace.point_child)
    rate = twist.linear + twist.angular.cross(apart - subspace.point_child)
    parts = at, orientation, rotation @ rate, twist.angular
    there = cj.body_state(*map(numbers, parts))
    states = dict(zip(("a", "b") if parent == "a" else ("b", "a"), (here, there), strict=True))
    bodies = {name: cj.Body(1.0, (1.0, 1.0, 1.0)) for name in states}
    scene = cj.Scene(bodies, {"joint": JOINTS[name]})
    report = cj.constraint_report(scene, cj.State(states))
    np.testing.assert_allclose(report.values, 0.0, atol=1e-14)
    np.testing.assert_allclose(report.rates, 0.0, atol=1e-13)


@pytest.mark.parametrize("turns", [-3, 0, 5])
def test_a_screw_s_advance_tells_its_revolutions(turns):
    subspace, _ = subspace_and_state("screw", "a")
    angle = 2.0 * np.pi * turns + 0.4
    advance = subspace.axis * (-0.7 / (2.0 * np.pi) * angle)
    still = cj.extend.Twist(Vector(0.0, 0.0, 0.0), Vector(0.0, 0.0, 0.0))
    found = subspace.encode(cj.extend.Relative(subspace.orientation(angle), advance, still))
    assert float(found.position) == pytest.approx(angle, rel=1e-13)
