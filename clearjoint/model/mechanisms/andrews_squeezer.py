"""Andrews' squeezing mechanism."""

import math
from typing import NamedTuple

import numpy as np

from ..bodies import GROUND, Body, State, body_state
from ..drives.rotation import DriveTorque
from ..forces.springs_and_loads import SpringDamper
from ..joints.ideal import InlineJoint, RevoluteJoint
from ..scene import Scene
from .common import Z_AXIS, turned_about_z

Point = tuple[float, float]


class _Link(NamedTuple):
    """A body that hangs on another by a hinge: mass in kg, moment of inertia about the centre of
    mass in kg m^2, own angle in rad, and the hinge on both, m in their axes."""

    mass: float
    inertia: float
    angle: float
    parent: str
    hinge_of_parent: Point
    hinge: Point


BETA, GAMMA = -0.0617138900142764496, 0.455279819163070380
PHI, DELTA = 0.222668390165885885, 0.487364979543842550
OMEGA, EPSILON = -0.222668390165885885, 1.23054744454982119
"""The start of the test set, rad, which closes the loops."""
PIVOT_A, PIVOT_B, HOOK = (-0.06934, -0.00227), (-0.03635, 0.03273), (0.014, 0.072)
"""Points of the ground: two pivots, and where the spring hangs, m."""
LINKS = {
    "K1": _Link(0.04325, 2.194e-6, BETA, GROUND, (0.0, 0.0), (-0.00092, 0.0)),
    "K2": _Link(0.00365, 4.410e-7, BETA, "K1", (0.007 - 0.00092, 0.0), (0.0115, 0.0)),
    "K3": _Link(0.02373, 5.255e-6, GAMMA, GROUND, PIVOT_B, (-0.01043, 0.01874)),
    "K5": _Link(0.07050, 1.169e-5, DELTA, GROUND, PIVOT_A, (-0.02308, -0.00916)),
    "K4": _Link(
        0.00706, 5.667e-7, PHI + DELTA, "K5", (0.04 - 0.02308, -0.00916), (0.0, 0.02 - 0.01421)
    ),
    "K7": _Link(0.05498, 1.912e-5, EPSILON, GROUND, PIVOT_A, (0.00449, 0.01228)),
    "K6": _Link(
        0.00706, 5.667e-7, OMEGA + EPSILON, "K7", (0.00449, 0.01228 - 0.04), (0.01421 - 0.02, 0.0)
    ),
}
"""Each after the one that it hangs on."""
P_OF_K2 = (0.0115 - 0.028, 0.0)
P = {"K3": (-0.01043, 0.01874 - 0.035), "K4": (0.0, -0.01421), "K6": (0.01421, 0.0)}
"""The point at which four bodies meet, m in the axes of each."""
SPRING_END = (0.02 - 0.01043, 0.01874 - 0.018)
"""Of the spring on K3, m."""
TORQUE, STIFFNESS, FREE_LENGTH = 0.033, 4530.0, 0.07785
"""N m, N/m and m."""


def andrews_squeezer() -> tuple[Scene, State]:
    """Andrews' squeezing mechanism, the IFToMM benchmark A03: seven planar bodies, a spring and a
    motor of constant torque, at rest.

    A crank K1 turns in the origin and moves by a rod K2 the point P, at which three chains meet: K3
    from the pivot B, which a spring pulls, and K4 with K5 and K6 with K7 from the pivot A. Within
    30 ms the crank turns two and a half times. No gravity. The joints hold all bodies in the plane,
    and no constraint is redundant.

    Data of W. Schiehlen (ed.), Multibody Systems Handbook, 1990, and E. Hairer, G. Wanner, Solving
    Ordinary Differential Equations II, section VII.7; the first state is that of the Test Set for
    Initial Value Problem Solvers (problem "andrews"), whose angles beta, gamma, delta and epsilon
    are the turns about Z of K1, K3, K5 and K7 here, and theta, phi and omega those of K2, K4 and K6
    against K1, K5 and K7.

    >>> scene, state = cj.mechanisms.andrews_squeezer()
    >>> list(scene.bodies), list(scene.forces)
    (['K1', 'K2', 'K3', 'K5', 'K4', 'K7', 'K6'], ['spring', 'motor'])
    """
    bodies, joints, states = {}, {}, {}
    centres: dict[str, np.ndarray] = {GROUND: np.zeros(2)}
    for name, link in LINKS.items():
        parent_angle = LINKS[link.parent].angle if link.parent in LINKS else 0.0
        hinge = centres[link.parent] + _turned(link.hinge_of_parent, parent_angle)
        centres[name] = hinge - _turned(link.hinge, link.angle)
        bodies[name] = Body(link.mass, np.array([0.5, 0.5, 1.0]) * link.inertia)
        states[name] = body_state((*centres[name], 0.0), turned_about_z(link.angle))
        joints[f"{link.parent}-{name}"] = RevoluteJoint(
            link.parent, name, (*link.hinge_of_parent, 0.0), (*link.hinge, 0.0), Z_AXIS, Z_AXIS
        )
    for name, point in P.items():
        joints[f"K2-{name}"] = InlineJoint("K2", name, (*P_OF_K2, 0.0), (*point, 0.0), Z_AXIS)
    ends = (*HOOK, 0.0), (*SPRING_END, 0.0)
    spring = SpringDamper(GROUND, "K3", *ends, STIFFNESS, free_length=FREE_LENGTH)
    motor = DriveTorque(GROUND, "K1", Z_AXIS, TORQUE)
    return Scene(bodies, joints, {"spring": spring, "motor": motor}), State(states)


def _turned(point: Point, angle: float) -> np.ndarray:
    """A point of a body, from its centre of mass, in axes of the plane."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[cosine, -sine], [sine, cosine]]) @ point
