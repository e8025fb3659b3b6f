"""Energy, momentum and penetration of a state, implemented again from the paper's definitions.

The functions use NumPy's extended precision and only data of clearjoint, so that results are not
checked by the code that computed them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import clearjoint as cj

LONG = np.longdouble
BASES = {"V": -1.0, "W": 1.0}


@dataclass(frozen=True)
class Pose:
    """Position, m, Euler parameters, velocity, m/s, and spin in body axes, rad/s, of a body in
    extended precision.
    """

    position: np.ndarray
    orientation: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray

    @property
    def rotation(self) -> np.ndarray:
        """Return the rotation matrix from body to global axes (eq. 5), (3, 3)."""
        w, x, y, z = self.orientation
        return np.array(
            [
                [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
            ],
            dtype=LONG,
        )

    def point(self, local: np.ndarray) -> np.ndarray:
        """Return the global position of a point given in body axes, m."""
        return self.position + self.rotation @ local


GROUND_POSE = Pose(np.zeros(3, LONG), np.array([1, 0, 0, 0], LONG), *np.zeros((2, 3), LONG))

Poses = Mapping[str, Pose]


def poses(state: cj.State) -> dict[str, Pose]:
    """Return the poses of all bodies and of the ground."""
    found = {"ground": GROUND_POSE}
    for name, body in state.bodies.items():
        parts = (body.position, body.orientation, body.velocity, body.spin)
        found[name] = Pose(*(np.asarray(part, dtype=LONG) for part in parts))
    return found


def kinetic_energy(scene: cj.Scene, at: Poses) -> Any:
    """Return the kinetic energy, J."""
    total = LONG(0)
    for name, body in scene.bodies.items():
        pose = at[name]
        inertia = np.asarray(body.inertia, LONG)
        turning = inertia * pose.spin if inertia.ndim == 1 else inertia @ pose.spin
        total += LONG(0.5) * (LONG(body.mass) * pose.velocity @ pose.velocity + pose.spin @ turning)
    return total


def work_of_gravity(scene: cj.Scene, start: Poses, end: Poses) -> Any:
    """Return the work of gravity from one state to another, J."""
    if scene.gravity is None:
        return LONG(0)
    gravity = np.asarray(scene.gravity, LONG)
    return sum(
        LONG(body.mass) * gravity @ (end[name].position - start[name].position)
        for name, body in scene.bodies.items()
    )


def contact_energy(scene: cj.Scene, at: Poses) -> Any:
    """Return the elastic energy K delta^(n + 1)/(n + 1) of all contacts, J."""
    total = LONG(0)
    for joint in clearance_joints(scene):
        laws = joint.laws()
        for label, depth in depths(joint, at).items():
            law = laws[label]
            if depth > 0 and isinstance(law, cj.extend.AbstractHertzianLaw):
                power = LONG(law.exponent) + 1
                total += stiffness(law, joint) * depth**power / power
    return total


def clearance_joints(scene: cj.Scene) -> list[cj.ClearanceJoint]:
    """Return all joints with clearance."""
    return [joint for joint in scene.joints.values() if isinstance(joint, cj.ClearanceJoint)]


def deepest(scene: cj.Scene, at: Poses) -> Any:
    """Return the largest penetration of a base, in journal radii."""
    return max(
        depths(joint, at)[base] / (LONG(joint.bearing_radius) - LONG(joint.clearance))
        for joint in clearance_joints(scene)
        for base in BASES
    )


def depths(joint: cj.ClearanceJoint, at: Poses) -> dict[str, Any]:
    """Return the penetration of each contact of a clearance joint, m (eqs 8-13)."""
    bearing, journal = at[joint.bearing_body], at[joint.journal_body]
    axis = bearing.rotation @ _unit(joint.bearing_axis)
    centre = bearing.point(np.asarray(joint.bearing_point, LONG))
    half = _unit(joint.journal_axis) * LONG(joint.journal_length) / 2
    found, heights = {}, []
    for base, sign in BASES.items():
        offset = journal.point(np.asarray(joint.journal_point, LONG) + sign * half) - centre
        height = offset @ axis
        found[base] = np.sqrt(np.sum((offset - axis * height) ** 2)) - LONG(joint.clearance)
        heights.append(height)
    if isinstance(joint.axial, cj.EndPlay):
        # A journal that has turned over, as very short ones do, faces each shoulder with the other
        # base. So the base that is closest to a shoulder counts.
        reach = LONG(joint.journal_length) / 2 + LONG(joint.axial.play) / 2
        found["lower shoulder"] = max(-height for height in heights) - reach
        found["upper shoulder"] = max(heights) - reach
    return found


def stiffness(law: Any, joint: cj.ClearanceJoint) -> Any:
    """Return the stiffness, N/m^n: given, or Ravn's for two bodies of one material."""
    if isinstance(law.stiffness, cj.laws.GivenStiffness):
        return LONG(law.stiffness.stiffness)
    modulus, ratio = LONG(law.stiffness.young_modulus), LONG(law.stiffness.poisson_ratio)
    outer, clearance = LONG(joint.bearing_radius), LONG(joint.clearance)
    radii = outer * (outer - clearance) / clearance
    return 4 / (3 * 2 * (1 - ratio**2) / modulus) * np.sqrt(radii)


def momentum(scene: cj.Scene, at: Poses) -> tuple[np.ndarray, np.ndarray]:
    """Return the linear momentum, kg m/s, and the angular momentum about the origin, kg m^2/s."""
    linear, angular = np.zeros(3, LONG), np.zeros(3, LONG)
    for name, body in scene.bodies.items():
        pose = at[name]
        push = LONG(body.mass) * pose.velocity
        inertia = np.asarray(body.inertia, LONG)
        linear += push
        angular += np.cross(pose.position, push) + pose.rotation @ (inertia * pose.spin)
    return linear, angular


def drift(scene: cj.Scene, at: Poses) -> Any:
    """Return the largest residual of the revolute joints, m or rad, and of journals fixed axially,
    m.
    """
    worst = LONG(0)
    for joint in scene.joints.values():
        if isinstance(joint, cj.RevoluteJoint):
            first, second = at[joint.first], at[joint.second]
            points = first.point(np.asarray(joint.point_first, LONG)) - second.point(
                np.asarray(joint.point_second, LONG)
            )
            axes = np.cross(
                first.rotation @ _unit(joint.axis_first), second.rotation @ _unit(joint.axis_second)
            )
            worst = max(worst, np.abs(points).max(), np.abs(axes).max())
        elif isinstance(joint, cj.ClearanceJoint) and isinstance(joint.axial, cj.FixedAxially):
            worst = max(worst, abs(_height(joint, at)))
    return worst


def _height(joint: cj.ClearanceJoint, at: Poses) -> Any:
    """Return the axial position of the journal's centre relative to the bearing, m."""
    bearing, journal = at[joint.bearing_body], at[joint.journal_body]
    centre = bearing.point(np.asarray(joint.bearing_point, LONG))
    offset = journal.point(np.asarray(joint.journal_point, LONG)) - centre
    return offset @ (bearing.rotation @ _unit(joint.bearing_axis))


def norm_error(at: Poses) -> Any:
    """Return the largest deviation of the norm of Euler parameters from one."""
    return max(abs(np.sqrt(np.sum(pose.orientation**2)) - 1) for pose in at.values())


def _unit(vector: Any) -> np.ndarray:
    long = np.asarray(vector, LONG)
    return long / np.sqrt(np.sum(long**2))
