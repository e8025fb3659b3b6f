"""Linkages from IFToMM's Library of Computational Benchmark Problems for multibody dynamics."""

import math
from typing import NamedTuple

import numpy as np

from ..._fields.types import TripleLike
from ..bodies import GROUND, Body, State, body_state
from ..drives.drivers import DriveTorque
from ..forces import SpringDamper
from ..joints.ideal import InlineJoint, RevoluteJoint
from ..scene import Scene
from .common import Z_AXIS, turned_about_z

Point = tuple[float, float]
"""Coordinates in the plane of motion, m."""


class _Link(NamedTuple):
    """A body of Andrews' mechanism, which is hinged to a parent body. `inertia` is about Z through
    the centre of mass, kg m^2, and `angle` the initial rotation about Z relative to the ground,
    rad. `hinge_of_parent` and `hinge` are the point of the hinge on the parent and on the body, m
    from each body's centre of mass in its axes."""

    mass: float
    inertia: float
    angle: float
    parent: str
    hinge_of_parent: Point
    hinge: Point


BETA, GAMMA = -0.0617138900142764496, 0.455279819163070380
PHI, DELTA = 0.222668390165885885, 0.487364979543842550
OMEGA, EPSILON = -0.222668390165885885, 1.23054744454982119
"""Initial angles of Andrews' mechanism, rad, which close its loops. `andrews_squeezer` says which
bodies they belong to; a further angle, theta, is zero."""
PIVOT_A, PIVOT_B, HOOK = (-0.06934, -0.00227), (-0.03635, 0.03273), (0.014, 0.072)
"""Fixed points of Andrews' mechanism: two pivots, and the spring's end on the ground, m."""
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
"""Bodies of Andrews' mechanism by name, in an order in which each follows its parent. Coordinates
relative to the centre of mass are written as differences of distances that the source gives."""
P_OF_K2 = (0.0115 - 0.028, 0.0)
P = {"K3": (-0.01043, 0.01874 - 0.035), "K4": (0.0, -0.01421), "K6": (0.01421, 0.0)}
"""The point P at which K2, K3, K4 and K6 meet, (2,) m from each centre of mass in body axes."""
SPRING_END = (0.02 - 0.01043, 0.01874 - 0.018)
"""End of the spring on K3, (2,) m from the centre of mass of K3 in its axes."""


def andrews_squeezer() -> tuple[Scene, State]:
    """Return Andrews' squeezing mechanism, the IFToMM benchmark A03, and its initial state.

    Seven bodies move in the XY plane. A motor drives the crank K1 with a constant torque, from
    rest. A rod K2 connects the crank to the point P, where three chains meet: K3 from the pivot B,
    loaded by a spring; and K5 with K4, and K7 with K6, both from the pivot A. The crank makes two
    and a half revolutions in 30 ms. There is no gravity, and no constraint is redundant.

    Source: W. Schiehlen (ed.), Multibody Systems Handbook, 1990, and E. Hairer, G. Wanner, Solving
    Ordinary Differential Equations II, section VII.7. The initial state is that of the Test Set for
    Initial Value Problem Solvers (problem "andrews"). Its angles beta, gamma, delta and epsilon are
    the rotations about Z of K1, K3, K5 and K7; theta, phi and omega are those of K2, K4 and K6
    relative to K1, K5 and K7.

    >>> scene, state = cj.mechanisms.andrews_squeezer()
    >>> list(scene.bodies), list(scene.forces)
    (['K1', 'K2', 'K3', 'K5', 'K4', 'K7', 'K6'], ['spring', 'motor'])
    """
    bodies, joints, states = {}, {}, {}
    centres: dict[str, np.ndarray] = {GROUND: np.zeros(2)}
    for name, link in LINKS.items():
        parent_angle = LINKS[link.parent].angle if link.parent in LINKS else 0.0
        # The parent's hinge is known; the body's centre follows from its own hinge and angle.
        hinge = centres[link.parent] + _turned(link.hinge_of_parent, parent_angle)
        centres[name] = hinge - _turned(link.hinge, link.angle)
        # Only the moment about Z matters. The moments about x and y are half of it, as for a flat
        # body.
        bodies[name] = Body(link.mass, np.array([0.5, 0.5, 1.0]) * link.inertia)
        states[name] = body_state((*centres[name], 0.0), turned_about_z(link.angle))
        joints[f"{link.parent}-{name}"] = RevoluteJoint(
            link.parent, name, (*link.hinge_of_parent, 0.0), (*link.hinge, 0.0), Z_AXIS, Z_AXIS
        )
    # The revolute joints already hold all bodies in the plane. Inline joints, which only keep a
    # point on a line along Z, act as pins without repeating these constraints.
    for name, point in P.items():
        joints[f"K2-{name}"] = InlineJoint("K2", name, (*P_OF_K2, 0.0), (*point, 0.0), Z_AXIS)
    spring = SpringDamper(
        GROUND, "K3", (*HOOK, 0.0), (*SPRING_END, 0.0), stiffness=4530.0, free_length=0.07785
    )
    motor = DriveTorque(GROUND, "K1", Z_AXIS, torque=0.033)
    return Scene(bodies, joints, {"spring": spring, "motor": motor}), State(states)


def _turned(point: Point, angle: float) -> np.ndarray:
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[cosine, -sine], [sine, cosine]]) @ point


def bricard() -> tuple[Scene, State]:
    """Return Bricard's mechanism, the IFToMM benchmark A04, and its initial state.

    Five homogeneous square bars of 1 kg, 1 m long and 0.1 m wide, form a loop with the ground. The
    axis of each of the six revolute joints is perpendicular to the next. One of their 30
    constraints is redundant, which leaves one degree of freedom. The mechanism starts at rest along
    the edges of a cube; gravity is 9.81 m/s^2 along -Y.

    Source: M. Gonzalez, D. Dopico, U. Lugris, J. Cuadrado, Multibody System Dynamics 16, 2006.

    >>> scene, state = cj.mechanisms.bricard()
    >>> list(scene.joints)
    ['hinge 1', 'hinge 2', 'hinge 3', 'hinge 4', 'hinge 5', 'hinge 6']
    """
    corners = ((0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -1, 1), (0, -1, 1), (0, 0, 1))
    axes = ((0, 1, 0), (0, 0, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 0))
    corners = [np.array(corner, dtype=float) for corner in corners]
    # Moments of a bar of the mass m, length l and width w: m (l^2 + w^2)/12 across its axis and
    # m (w^2 + w^2)/12 along it, kg m^2.
    across, along = 1.01 / 12, 0.02 / 12
    names = [GROUND, *(f"rod {k}" for k in range(1, 6)), GROUND]
    centres: dict[str, np.ndarray] = {GROUND: np.zeros(3)}
    bodies, states, joints = {}, {}, {}
    # All body frames start parallel to the global frame, in which each rod lies along one axis: the
    # moment about this axis is `along`. The sixth edge of the loop, from the last corner to the
    # first, is the ground.
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
    """Return two four-bar linkages in a row, the IFToMM benchmark A02, and their initial state.

    Five slender rods of 1 m and 1 kg move in the XY plane. Rods 1, 3 and 5 start upright and are
    hinged to the ground, rods 2 and 4 connect their tips. Gravity is 9.81 m/s^2 along -Y, and the
    tips start at 1 m/s along +X. The seven revolute joints are spatial: 6 of their 35 constraints
    are redundant. The mechanism passes singular positions where the rods are in one line.

    Source: M. Gonzalez, D. Dopico, U. Lugris, J. Cuadrado, Multibody System Dynamics 16, 2006.

    >>> scene, state = cj.mechanisms.double_four_bar()
    >>> list(scene.joints)
    ['foot 1', 'foot 2', 'foot 3', 'left 1', 'right 1', 'left 2', 'right 2']
    """
    names = [f"rod {k}" for k in range(1, 6)]
    # The moment about the rod's own axis has no effect on the planar motion.
    bodies = {name: Body(1.0, (1e-3, 1.0 / 12, 1.0 / 12)) for name in names}
    joints, states = {}, {}
    # Each rod lies along its own x axis; a quarter of a revolution about Z makes it upright.
    upright = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
    near, far, axis = (-0.5, 0.0, 0.0), (0.5, 0.0, 0.0), (0.0, 0.0, 1.0)

    def hinge(
        name: str, first: str, second: str, on_first: TripleLike, on_second: TripleLike
    ) -> None:
        joints[name] = RevoluteJoint(first, second, on_first, on_second, axis, axis)

    # Posts are rods 1, 3 and 5, and rotate clockwise at 1 rad/s, so that their centres move at half
    # the speed of their tips. Beams are rods 2 and 4, between the posts before and after them.
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
