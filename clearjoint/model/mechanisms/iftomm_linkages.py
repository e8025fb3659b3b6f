"""Linkages of the IFToMM multibody benchmarks."""

import math

import numpy as np

from ...fields.types import TripleLike
from ..bodies import GROUND, Body, State, body_state
from ..joints.ideal import RevoluteJoint
from ..scene import Scene


def bricard() -> tuple[Scene, State]:
    """Return Bricard's mechanism, the IFToMM benchmark A04: five rods of 1 m, 1 kg in a loop.

    Six revolute joints, each perpendicular to the next, impose 30 constraints on 30 velocities. One
    constraint is redundant, which leaves one degree of freedom. The mechanism starts at rest;
    gravity is 9.81 m/s^2 along -Y.

    **Returns:** the scene and the initial state.

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
    # All body frames are parallel to the global frame, so that each rod's axis is a global axis.
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


def double_four_bar() -> tuple[Scene, State]:
    """Return two four-bar linkages in a row, the IFToMM benchmark A02: five rods of 1 m, 1 kg.

    Rods 1, 3 and 5 are hinged to the ground, rods 2 and 4 connect their tips. Gravity is 9.81 m/s^2
    along -Y, and the tips start at 1 m/s along +X. In this planar mechanism of seven spatial
    revolute joints 6 of 35 constraints are redundant; it passes singular positions where the rods
    are in one line.

    **Returns:** the scene and the initial state.

    >>> scene, state = cj.mechanisms.double_four_bar()
    >>> list(scene.joints)
    ['foot 1', 'foot 2', 'foot 3', 'left 1', 'right 1', 'left 2', 'right 2']
    """
    names = [f"rod {k}" for k in range(1, 6)]
    bodies = {name: Body(1.0, (1e-3, 1.0 / 12, 1.0 / 12)) for name in names}
    joints, states = {}, {}
    upright = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
    near, far, axis = (-0.5, 0.0, 0.0), (0.5, 0.0, 0.0), (0.0, 0.0, 1.0)

    def hinge(name: str, first: str, second: str, a: TripleLike, b: TripleLike) -> None:
        joints[name] = RevoluteJoint(first, second, a, b, axis, axis)

    for k in (0, 1, 2):
        post = names[2 * k]
        states[post] = body_state((k, 0.5, 0.0), upright, (0.5, 0.0, 0.0), (0.0, 0.0, -1.0))
        hinge(f"foot {k + 1}", GROUND, post, (float(k), 0.0, 0.0), near)
    for k in (0, 1):
        beam = names[2 * k + 1]
        states[beam] = body_state((k + 0.5, 1.0, 0.0), velocity=(1.0, 0.0, 0.0))
        hinge(f"left {k + 1}", names[2 * k], beam, far, near)
        hinge(f"right {k + 1}", beam, names[2 * k + 2], far, far)
    return Scene(bodies, joints, gravity=(0.0, -9.81, 0.0)), State(states)
