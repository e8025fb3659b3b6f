"""Bricard's mechanism of the IFToMM benchmarks."""

import numpy as np

from ..bodies import GROUND, Body, State, body_state
from ..joints.ideal import RevoluteJoint
from ..scene import Scene


def bricard() -> tuple[Scene, State]:
    """Bricard's mechanism, the IFToMM benchmark A04: five rods of 1 m and 1 kg in a closed chain.

    Six revolute joints, each at a right angle to the next: 30 constraints on 30 velocities of which
    one is redundant, which leaves one degree of freedom. Starts at rest; gravity 9.81 along -Y.

    >>> scene, state = cj.mechanisms.bricard()
    >>> list(scene.joints)
    ['hinge 1', 'hinge 2', 'hinge 3', 'hinge 4', 'hinge 5', 'hinge 6']
    """
    corners = ((0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -1, 1), (0, -1, 1), (0, 0, 1))
    axes = ((0, 1, 0), (0, 0, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 0))
    corners = [np.array(corner, dtype=float) for corner in corners]
    across, along = 1.01 / 12, 0.02 / 12
    names = [GROUND, *(f"rod {k}" for k in range(1, 6)), GROUND]
    centres: dict[str, np.ndarray] = {GROUND: np.zeros(3)}
    bodies, states, joints = {}, {}, {}
    for k in range(5):
        direction = corners[k + 1] - corners[k]
        name, centre = names[k + 1], 0.5 * (corners[k] + corners[k + 1])
        bodies[name] = Body(1.0, np.where(direction != 0, along, across))
        centres[name], states[name] = centre, body_state(centre)
    for k, (corner, axis) in enumerate(zip(corners, axes, strict=True)):
        first, second = names[k], names[k + 1]
        joints[f"hinge {k + 1}"] = RevoluteJoint(
            first, second, corner - centres[first], corner - centres[second], axis, axis
        )
    return Scene(bodies, joints, gravity=(0.0, -9.81, 0.0)), State(states)
