"""Mechanisms of the literature, each with the state that it starts from."""

import math

import numpy as np

from ..fields.types import TripleLike
from ..math.vectors import Scalar
from .bodies import GROUND, Body, BodyState, State, body_state
from .contact.bristles import AbstractBristleFriction
from .contact.damping_factors import LankaraniNikravesh
from .contact.friction import AbstractFriction
from .contact.laws import AbstractContactLaw
from .contact.stiffness import RavnStiffness
from .joints.axial import AbstractAxialPolicy
from .joints.base import AbstractConstraint, AbstractContactJoint, AbstractForce
from .joints.clearance import ClearanceJoint
from .joints.drives import PrescribedRotation
from .joints.ideal import InlineJoint, PrismaticJoint, RevoluteJoint
from .scene import Scene

ORIGIN, X_AXIS, Z_AXIS = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
STEEL = RavnStiffness(207e9, 0.3)
"""Ravn's stiffness for the paper's steel (Table 2)."""


def double_pendulum(
    clearance: Scalar | None = 0.5e-3,
    restitution: Scalar = 0.9,
    *,
    bearing_radius: Scalar = 10e-3,
    journal_length: Scalar = 20e-3,
    law: AbstractContactLaw | None = None,
    friction: AbstractFriction | AbstractBristleFriction | None = None,
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
            law=_steel(restitution) if law is None else law,
            friction=friction,
            axial=axial,
        )
    scene = Scene(bodies, {"shoulder": shoulder, "elbow": elbow}, gravity=(0.0, 9.81, 0.0))
    state = State({"arm 2": body_state((0.5, 0.0, 0.0)), "arm 3": body_state((1.0, 0.0, 0.5))})
    return scene, state


def _steel(restitution: Scalar) -> LankaraniNikravesh:
    """The paper's law for its steel, with a requested restitution."""
    return LankaraniNikravesh(restitution=restitution, stiffness=STEEL)


CRANK_LENGTH, ROD_LENGTH = 0.05, 0.12
"""Of the slider-crank, m."""
SMALL_END = (0.5 * ROD_LENGTH, 0.0, 0.0)
"""The rod's end at the slider, m in its axes."""


def slider_crank(
    clearance: Scalar | None = 0.5e-3,
    restitution: Scalar = 0.9,
    *,
    speed: Scalar = 5000.0 * math.pi / 30.0,
    angle: float = 0.0,
    motor: AbstractConstraint | AbstractForce | None = None,
    bearing_radius: Scalar = 10e-3,
    journal_length: Scalar = 20e-3,
    law: AbstractContactLaw | None = None,
    friction: AbstractFriction | AbstractBristleFriction | None = None,
    gravity: TripleLike | None = None,
) -> tuple[Scene, State]:
    """The slider-crank of the clearance literature, and its state in the ideal joint's motion.

    A crank of 50 mm, 0.30 kg and 1e-5 kg m^2 turns about Z in the origin; a rod of 120 mm, 0.21 kg
    and 2.5e-4 kg m^2 drives a slider of 0.14 kg along X. The slider's bearing holds the rod's
    journal, the "slider pin", with clearance. Centres of mass are half-way. The other moments of
    inertia are those of bars 10 mm and a cube 30 mm wide, and don't enter the planar motion.

    The crank's and the rod's revolute joints and the slider's guide hold the bodies in the plane,
    so the clearance joint is axially free and no constraint redundant; likewise with
    `clearance=None`, which makes the pin an ideal `InlineJoint`.

    **Arguments:**

    - `clearance`: radial, m; or ``None``.
    - `speed`, `angle`: of the crank at the start, rad/s and rad; at angle 0 the slider is farthest
      out. The journal starts centred.
    - `motor`: what drives "crank" against "ground" in place of a `PrescribedRotation` at constant
      speed, such as a `DriveTorque` about (0, 0, 1).
    - `bearing_radius`, `journal_length`: m. `gravity`: (3,) m/s^2.
    - `law` replaces Lankarani-Nikravesh with the given restitution.
    """
    if clearance is None:
        pin = InlineJoint("slider", "rod", ORIGIN, SMALL_END, Z_AXIS)
    else:
        pin = ClearanceJoint(
            "slider",
            "rod",
            journal_point=SMALL_END,
            bearing_radius=bearing_radius,
            clearance=clearance,
            journal_length=journal_length,
            law=_steel(restitution) if law is None else law,
            friction=friction,
        )
    if motor is None:
        motor = PrescribedRotation(GROUND, "crank", Z_AXIS, speed, angle)
    joints = _slider_crank_joints(pin)
    forces: dict[str, AbstractForce] = {}
    if isinstance(motor, AbstractForce):
        forces["motor"] = motor
    else:
        joints["motor"] = motor
    scene = Scene(_slider_crank_bodies(), joints, forces, gravity)
    return scene, _slider_crank_state(speed, angle)


def _slider_crank_bodies() -> dict[str, Body]:
    return {
        "crank": Body(0.30, (5e-6, 1e-5, 1e-5)),
        "rod": Body(0.21, (3.5e-6, 2.5e-4, 2.5e-4)),
        "slider": Body(0.14, (2.1e-5, 2.1e-5, 2.1e-5)),
    }


def _slider_crank_joints(
    pin: InlineJoint | ClearanceJoint,
) -> dict[str, AbstractConstraint | AbstractContactJoint]:
    """The joints around the slider's pin, but for what drives the crank."""
    foot, tip = (-0.5 * CRANK_LENGTH, 0.0, 0.0), (0.5 * CRANK_LENGTH, 0.0, 0.0)
    big_end = (-0.5 * ROD_LENGTH, 0.0, 0.0)
    return {
        "crank bearing": RevoluteJoint(GROUND, "crank", ORIGIN, foot, Z_AXIS, Z_AXIS),
        "crank pin": RevoluteJoint("crank", "rod", tip, big_end, Z_AXIS, Z_AXIS),
        "slider pin": pin,
        "guide": PrismaticJoint(GROUND, "slider", ORIGIN, ORIGIN, X_AXIS),
    }


def _slider_crank_state(speed: Scalar, angle: float) -> State:
    """The ideal motion at a crank angle, rad, and speed, rad/s."""
    tip = CRANK_LENGTH * np.array([math.cos(angle), math.sin(angle), 0.0])
    rod_angle = -math.asin(tip[1] / ROD_LENGTH)
    rod = ROD_LENGTH * np.array([math.cos(rod_angle), math.sin(rod_angle), 0.0])
    rod_turn = -tip[0] / rod[0]  # a radian of the crank
    tip_shift = np.array([-tip[1], tip[0], 0.0])
    rod_shift = tip_shift + 0.5 * rod_turn * np.array([-rod[1], rod[0], 0.0])
    slider_shift = np.array([-tip[1] - rod_turn * rod[1], 0.0, 0.0])

    def body(position: TripleLike, turned: float, shift: np.ndarray, turn: float) -> BodyState:
        orientation = (math.cos(0.5 * turned), 0.0, 0.0, math.sin(0.5 * turned))
        spin = np.array([0.0, 0.0, turn])
        return body_state(position, orientation, shift * speed, spin * speed)

    return State(
        {
            "crank": body(0.5 * tip, angle, 0.5 * tip_shift, 1.0),
            "rod": body(tip + 0.5 * rod, rod_angle, rod_shift, rod_turn),
            "slider": body(np.array([tip[0] + rod[0], 0.0, 0.0]), 0.0, slider_shift, 0.0),
        }
    )


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

    def hinge(name: str, first: str, second: str, here: TripleLike, there: TripleLike) -> None:
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
