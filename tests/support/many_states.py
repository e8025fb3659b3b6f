"""States of a case at random, many at a time, in NumPy, for which nothing is compiled."""

from typing import Any

import jax
import numpy as np
from scipy.spatial.transform import Rotation

import clearjoint as cj
from tests.support.elements import FIRST, Case

COUNT = 5
"""Number of states."""
TIME = 0.13
"""s: time at which the states satisfy the constraints."""
FEEDBACK = 5.0
"""Both coefficients of Baumgarte's stabilisation, 1/s."""


def system_of(
    scene: cj.Scene, coordinates: Any, feedback: float = FEEDBACK, redundant: bool = False
) -> cj.extend.System:
    """The equations of motion of a scene; `feedback`: as `FEEDBACK`; `redundant`: whether some
    constraints are."""
    stabilisation = cj.Baumgarte(feedback, feedback)
    formulation = cj.extend.Formulation(coordinates, stabilisation, redundant)
    scalars = (jax.tree.map(np.asarray, part) for part in (scene, formulation))
    return cj.extend.System(*map(cj.extend.unpack, scalars))


def in_scalars(state: cj.State) -> dict[str, cj.BodyState]:
    """States of the bodies in scalar form, with an array of all states in place of each number."""
    vector, parameters = cj.extend.Vector, cj.extend.EulerParameters
    return {
        name: cj.BodyState(
            vector(*body.position.T),
            parameters(*body.orientation.T),
            vector(*body.velocity.T),
            vector(*body.spin.T),
        )
        for name, body in state.bodies.items()
    }


def columns(parts: cj.extend.Vector | cj.extend.EulerParameters) -> np.ndarray:
    """The components, which are numbers or arrays (COUNT,), as columns of an array."""
    return np.stack([np.broadcast_to(part, (COUNT,)) for part in jax.tree.leaves(parts)], axis=-1)


def states(case: Case, generator: np.random.Generator, held: str | None = None) -> cj.State:
    """States with all velocities at random, in which the whole case is turned and moved, and the
    bodies then are moved relative to the first as far as the constraints allow.

    A body that is `held` stays where it is in the case, at rest; it must be heavy.
    """

    def uniform(largest: float, body: str) -> np.ndarray:
        return generator.uniform(-largest, largest, (COUNT, 3)) * (body != held)

    turn, moved = Rotation.random(COUNT, rng=generator), generator.uniform(-0.3, 0.3, (COUNT, 3))
    if held is not None:
        turn, moved = Rotation.identity(COUNT), np.zeros((COUNT, 3))
    bodies = {}
    for name, body in case.state.bodies.items():
        rotation, shift = (0.0, 0.0) if name == FIRST else (case.rotation, case.shift)
        own = Rotation.from_quat(np.tile(body.orientation, (COUNT, 1)), scalar_first=True)
        own = turn * own * Rotation.from_rotvec(uniform(rotation, name))
        place = turn.apply(np.asarray(body.position) + uniform(shift, name)) + moved
        motion = uniform(0.3, name), uniform(2.0, name)
        bodies[name] = cj.BodyState(place, own.as_quat(scalar_first=True), *motion)
    system = system_of(case.scene, cj.AbsoluteCoordinates())
    variables = system.encode(in_scalars(cj.State(bodies)))
    for _ in range(6):
        variables = system.project_positions(variables, TIME)
    for _ in range(2):
        variables = system.project_velocities(variables, TIME)
    return cj.State(
        {
            name: cj.BodyState(*map(columns, (b.position, b.orientation, b.velocity, b.spin)))
            for name, b in system.decode(variables).items()
        }
    )


def loads(scene: cj.Scene, state: cj.State, gravity: Any = 0.0) -> dict[str, np.ndarray]:
    """Forces, N, and moments about the centre of mass, N m, (N, 6), global, beside gravity, on each
    body in states (N, ...), from its accelerations; all contacts began at 1 m/s."""
    system = system_of(scene, cj.AbsoluteCoordinates())
    entry_speeds = {
        name: dict.fromkeys(joint.laws(), 1.0) for name, joint in scene.contact_joints().items()
    }
    accelerations = system.dynamics(in_scalars(state), entry_speeds, 0.0).accelerations
    by_body = {}
    for name, body in scene.bodies.items():
        there, rates = state.bodies[name], accelerations[name]
        size, inertia = np.zeros(len(there.spin)), np.diag(body.inertia)
        linear, angular = (
            np.transpose(np.broadcast_arrays(*v, size)[:3]) for v in (rates.linear, rates.angular)
        )
        moment = angular @ inertia + np.cross(there.spin, there.spin @ inertia)
        turn = Rotation.from_quat(there.orientation, scalar_first=True)
        by_body[name] = np.hstack([body.mass * (linear - gravity), turn.apply(moment)])
    return by_body
