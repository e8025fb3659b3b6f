"""Ready scenes."""

import math
from typing import Any

import numpy as np

from .bodies import GROUND, Body, State, body_state
from .contact import AbstractContactLaw, LankaraniNikravesh, RavnStiffness
from .friction import AbstractFriction
from .joints.axial import AbstractAxialPolicy
from .joints.clearance import ClearanceJoint
from .joints.ideal import RevoluteJoint
from .scene import Scene

STEEL = RavnStiffness(207e9, 0.3)
"""Ravn's stiffness for the paper's steel (Table 2)."""


def double_pendulum(
    clearance: Any = 0.5e-3,
    restitution: Any = 0.9,
    *,
    bearing_radius: Any = 10e-3,
    journal_length: Any = 20e-3,
    law: AbstractContactLaw | None = None,
    friction: AbstractFriction | None = None,
    axial: AbstractAxialPolicy | None = None,
) -> tuple[Scene, State]:
    """The paper's double pendulum (section 6, Tables 1 and 2), and its state at rest.

    Arm 2 hangs on the ground by a joint with clearance whose axis is Z; arm 3 on arm 2 by an ideal
    revolute joint about X, the only axis that reproduces the paper's statements. Gravity acts
    along +Y and both arms start at rest in the XZ plane, the journal centred.

    **Arguments:** radial clearance, bearing radius and journal length in m; `clearance=None` makes
    the ground joint ideal. `law` replaces Lankarani-Nikravesh with the given restitution.
    """
    bodies = {
        "arm 2": Body(7.02, (0.0010, 0.5855, 0.5855)),
        "arm 3": Body(7.02, (0.5855, 0.5855, 0.0010)),
    }
    elbow = RevoluteJoint(
        "arm 2", "arm 3", (0.5, 0.0, 0.0), (0.0, 0.0, -0.5), (1.0, 0.0, 0.0), (1.0, 0.0, 0.0)
    )
    if clearance is None:
        origin, near_end, axis = (0.0, 0.0, 0.0), (-0.5, 0.0, 0.0), (0.0, 0.0, 1.0)
        shoulder = RevoluteJoint("ground", "arm 2", origin, near_end, axis, axis)
    else:
        shoulder = ClearanceJoint(
            "ground",
            "arm 2",
            journal_point=(-0.5, 0.0, 0.0),
            bearing_radius=bearing_radius,
            clearance=clearance,
            journal_length=journal_length,
            law=LankaraniNikravesh(restitution, STEEL) if law is None else law,
            friction=friction,
            axial=axial,
        )
    scene = Scene(bodies, {"shoulder": shoulder, "elbow": elbow}, gravity=(0.0, 9.81, 0.0))
    state = State({"arm 2": body_state((0.5, 0.0, 0.0)), "arm 3": body_state((1.0, 0.0, 0.5))})
    return scene, state


def double_four_bar() -> tuple[Scene, State]:
    """Two four-bar linkages in a row, the IFToMM benchmark A02 with five rods of 1 m and 1 kg.

    Rods 1, 3 and 5 stand on the ground, 2 and 4 join their tips; gravity 9.81 along -Y, and the
    tips start at 1 m/s along +X. A planar mechanism of seven spatial revolute joints, so that 6 of
    35 constraints are redundant; with the rods in one line it passes singular positions.
    """
    names = [f"rod {k}" for k in range(1, 6)]
    bodies = {name: Body(1.0, (1e-3, 1.0 / 12, 1.0 / 12)) for name in names}
    joints, states = {}, {}
    turned = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
    near, far, axis = (-0.5, 0.0, 0.0), (0.5, 0.0, 0.0), (0.0, 0.0, 1.0)

    def hinge(name: str, first: str, second: str, here: Any, there: Any) -> None:
        joints[name] = RevoluteJoint(first, second, here, there, axis, axis)

    for k in (0, 1, 2):
        post = names[2 * k]
        states[post] = body_state((k, 0.5, 0.0), turned, (0.5, 0.0, 0.0), (0.0, 0.0, -1.0))
        hinge(f"foot {k + 1}", GROUND, post, (float(k), 0.0, 0.0), near)
    for k in (0, 1):
        beam = names[2 * k + 1]
        states[beam] = body_state((k + 0.5, 1.0, 0.0), velocity=(1.0, 0.0, 0.0))
        hinge(f"left {k + 1}", names[2 * k], beam, far, near)
        hinge(f"right {k + 1}", beam, names[2 * k + 2], far, far)
    return Scene(bodies, joints, gravity=(0.0, -9.81, 0.0)), State(states)


def bricard() -> tuple[Scene, State]:
    """Bricard's mechanism, the IFToMM benchmark A04: five rods of 1 m and 1 kg in a closed chain.

    Six revolute joints, each at a right angle to the next: 30 constraints on 30 velocities of which
    one is redundant, which leaves one degree of freedom. Starts at rest; gravity 9.81 along -Y.
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
