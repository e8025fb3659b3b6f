"""Accelerations of scenes and robots, and the same in MuJoCo."""

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
from scipy.spatial.transform import Rotation

import clearjoint as cj
from tests.support.many_states import system_of

JOINT = cj.JointCoordinates()
Numbers = Mapping[str, Any]
"""A number, or an array, by name."""


def turned(euler: Any) -> Rotation:
    """The rotation by Euler parameters, scalar first."""
    return Rotation.from_quat(np.asarray(euler), scalar_first=True)


def accelerations(
    scene: cj.Scene, state: cj.State, coordinates: Any = JOINT
) -> dict[str, np.ndarray]:
    """Of each body, (6,): angular, rad/s^2, and of the centre of mass, m/s^2, in global axes."""
    system = system_of(scene, coordinates, 0.0)
    speeds = {name: dict.fromkeys(laws, 0.1) for name, laws in scene.laws().items()}
    dynamics = system.dynamics(system.encode(cj.extend.unpack(state).bodies), speeds, 0.0)
    found = {}
    for name, body in dynamics.accelerations.items():
        angular = turned(state.bodies[name].orientation).apply(jax.tree.leaves(body.angular))
        found[name] = np.concatenate([angular, jax.tree.leaves(body.linear)])
    return found


def accelerations_in_mujoco(model: Any, data: Any, body: str, kind: str = "BODY") -> np.ndarray:
    """The same of one body, or of the origin of its frame (`kind` "XBODY")."""
    import mujoco

    mujoco.mj_rnePostConstraint(model, data)
    found, index = np.zeros(6), model.body(body).id
    mujoco.mj_objectAcceleration(
        model, data, getattr(mujoco.mjtObj, f"mjOBJ_{kind}"), index, found, 0
    )
    return found + [0.0, 0.0, 0.0, *model.opt.gravity]


def joint_accelerations(robot: cj.results.Robot, state: cj.State) -> dict[str, float]:
    """Second time derivatives of the joints' positions, and of rotors relative to links, by name
    of the joint."""
    system, joints = system_of(robot.scene, JOINT), robot.scene.joints
    variables = system.encode(cj.extend.unpack(state).bodies)
    rates = system.dynamics(variables, {}, 0.0).variable_rates
    names = [*robot.joints, *(f"{name} motor" for name in robot.drives)]
    return {name: float(rates[joints[name].second].speeds[0]) for name in names if name in joints}


def require_close(found: Numbers, expected: Numbers, tolerance: float) -> None:
    """Numbers by name that differ by less than a tolerance, relative to the largest of them."""
    assert found.keys() == expected.keys()
    scale = max(np.abs(value).max() for value in expected.values())
    for name, value in expected.items():
        assert np.abs(found[name] - value).max() < tolerance * scale, name
