"""Mechanisms of any size, for measurements of how cost grows with the mechanism.

- `backlash_chain.chain`: n motors and links with backlash; `chain.ideal_chain`: n hinged rods.
- `humanoid`: a branched tree of 23 or 29 hinges, read from URDF.
- `four_bars`: n parallel-crank four-bars in a row; each closes a loop, with redundant constraints.
- `scissor`: a scissor lift of n stages, whose pins on the right have clearance.
"""

import math
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import clearjoint as cj
from studies.benchmark import backlash_chain
from studies.benchmark.chain import ideal_chain

Mechanism = tuple[cj.Scene, cj.State]
X, Y, Z, ORIGIN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)

# The humanoid.

HEIGHT, MASS = 1.75, 70.0
"""Height, m, and mass, kg, of the person whose dimensions the humanoid has."""
GRAVITY = (3.0, 2.0, -9.0)
"""m/s^2; not along Z, so that the hanging limbs move."""
BALL, RADIUS = 0.05, 0.04
"""A joint of several axes consists of hinges in a row. Each link between them is a solid ball with
this part of the segment's mass and this radius, m, for the housing of a motor."""
LONG_AXIS = 0.2
"""Moment of inertia of a segment about its long axis, relative to that about a transverse axis."""


@dataclass(frozen=True)
class Segment:
    """Part of a human body.

    D. A. Winter, Biomechanics and Motor Control of Human Movement, 4th edition (2009): figure 4.1
    has the lengths, table 4.1 the other numbers. `length` is relative to the height, `mass` to that
    of the body; `centre`, from the proximal end, and the radius of gyration about the centre of
    mass are relative to the segment's length.
    """

    mass: float
    length: float
    centre: float
    gyration: float


SEGMENTS = {
    "thigh": Segment(0.100, 0.245, 0.433, 0.323),
    "shank": Segment(0.0465, 0.246, 0.433, 0.302),
    "foot": Segment(0.0145, 0.152, 0.500, 0.475),
    # Thorax and abdomen; the table has no radius of gyration for both, so it is that of a rod.
    "torso": Segment(0.355, 0.288, 0.630, 0.289),
    "head": Segment(0.081, 0.182, 0.500, 0.495),
    "upper arm": Segment(0.028, 0.186, 0.436, 0.322),
    "forearm": Segment(0.016, 0.146, 0.430, 0.303),
    "hand": Segment(0.006, 0.108, 0.506, 0.297),
}
HIP, SHOULDER = 0.0955, 0.129
"""Half the distances of the hips and of the shoulders, relative to the height."""
DOWN, UP, FORWARD = (0.0, 0.0, -1.0), Z, X
FEW, MANY = 23, 29
"""Numbers of joints of the humanoids: with a waist and wrists of one axis, or of three axes."""


def humanoid_urdf(joints: int) -> str:
    """Return a humanoid that hangs by its pelvis, as URDF.

    All joints are hinges without limits. X is forward, Y to the left, Z up.

    **Arguments:** `joints`: 23 or 29.
    """
    if joints not in (FEW, MANY):
        raise ValueError(f"joints must be {FEW} or {MANY}, but is {joints!r}: a humanoid has them.")
    waist, wrist = ((Z,), (Z,)) if joints == FEW else ((Z, X, Y), (Z, Y, X))
    parts = ['<link name="pelvis"/>']  # It is the ground, so that its mass has no effect.
    parts += _segment("torso", "torso", "pelvis", ORIGIN, UP, waist)
    top = (0.0, 0.0, SEGMENTS["torso"].length * HEIGHT)
    parts += _segment("head", "head", "torso", top, UP, ())
    for side, sign in (("left", 1.0), ("right", -1.0)):
        at_hip, at_shoulder = (0.0, sign * HIP * HEIGHT, 0.0), (0.0, sign * SHOULDER * HEIGHT)
        for kind, before, start, axes, along in (
            ("thigh", "pelvis", at_hip, (Y, X, Z), DOWN),
            ("shank", f"{side} thigh", None, (Y,), DOWN),
            ("foot", f"{side} shank", None, (Y, X), FORWARD),
            ("upper arm", "torso", (*at_shoulder, top[2]), (Y, X, Z), DOWN),
            ("forearm", f"{side} upper arm", None, (Y,), DOWN),
            ("hand", f"{side} forearm", None, wrist, DOWN),
        ):
            if start is None:  # the lower end of the segment before, in its axes
                segment = SEGMENTS[before.removeprefix(f"{side} ")]
                start = (0.0, 0.0, -segment.length * HEIGHT)
            parts += _segment(f"{side} {kind}", kind, before, start, along, axes)
    return "<robot name='humanoid'>\n" + "\n".join(parts) + "\n</robot>\n"


def _segment(
    name: str,
    kind: str,
    before: str,
    start: tuple[float, ...],
    along: tuple[float, float, float],
    axes: tuple[tuple[float, float, float], ...],
) -> Iterator[str]:
    """Yield the links and joints of a segment: one joint for each axis, or a fixed one.

    **Arguments:** `before`: the link that carries it; `start`: m, its proximal end there; `along`:
    direction of its long axis.
    """
    segment = SEGMENTS[kind]
    balls = max(len(axes) - 1, 0)
    ball = BALL * segment.mass * MASS
    for k in range(max(len(axes), 1)):
        is_last = k >= len(axes) - 1
        link = name if is_last else f"{name} ball {k + 1}"
        if is_last:
            length = segment.length * HEIGHT
            mass = segment.mass * MASS - balls * ball
            across = mass * (segment.gyration * length) ** 2
            moments = tuple(LONG_AXIS * across if part else across for part in along)
            yield _link(
                link, mass, tuple(segment.centre * length * part for part in along), moments
            )
        else:
            moment = 0.4 * ball * RADIUS**2
            yield _link(link, ball, ORIGIN, (moment, moment, moment))
        kind_of_joint = "continuous" if axes else "fixed"
        axis = f'<axis xyz="{_text(axes[k])}"/>' if axes else ""
        yield (
            f'<joint name="{name} joint {k + 1}" type="{kind_of_joint}"><parent link="{before}"/>'
            f'<child link="{link}"/><origin xyz="{_text(start)}"/>{axis}</joint>'
        )
        before, start = link, ORIGIN


def _link(name: str, mass: float, centre: tuple[float, ...], moments: tuple[float, ...]) -> str:
    inertia = " ".join(f'{key}="{value!r}"' for key, value in zip(_MOMENTS, moments, strict=True))
    return (
        f'<link name="{name}"><inertial><origin xyz="{_text(centre)}"/><mass value="{mass!r}"/>'
        f'<inertia {inertia} ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


_MOMENTS = ("ixx", "iyy", "izz")


def _text(numbers: tuple[float, ...]) -> str:
    return " ".join(map(repr, numbers))


def humanoid(joints: int) -> Mechanism:
    """Return the humanoid at rest with its limbs along the body; `joints` as in `humanoid_urdf`."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "humanoid.urdf"
        file.write_text(humanoid_urdf(joints), encoding="utf-8")
        robot = cj.load_robot(file, gravity=GRAVITY)
        return robot.scene, robot.state()


# Closed loops.

CRANK, COUPLER = 0.2, 0.3
"""Lengths of cranks and couplers of the four-bars, m."""
TILT = 0.5
"""Angle of the cranks at the start, rad."""


def four_bars(count: int) -> Mechanism:
    """Return parallel-crank four-bars with ideal joints in a row along X, at rest in the plane XY,
    with gravity along -Y."""
    bodies, joints, states = {}, {}, {}
    high = (CRANK * math.cos(TILT), CRANK * math.sin(TILT))
    turned = math.cos(0.5 * TILT), 0.0, 0.0, math.sin(0.5 * TILT)
    for k in range(count):
        left, right = 2 * k * COUPLER, (2 * k + 1) * COUPLER
        crank, coupler, rocker = names = [
            f"{part} {k + 1}" for part in ("crank", "coupler", "rocker")
        ]
        places = [
            ((left + 0.5 * high[0], 0.5 * high[1], 0.0), turned, CRANK),
            ((left + high[0] + 0.5 * COUPLER, high[1], 0.0), (1.0, 0.0, 0.0, 0.0), COUPLER),
            ((right + 0.5 * high[0], 0.5 * high[1], 0.0), turned, CRANK),
        ]
        for name, (place, orientation, length) in zip(names, places, strict=True):
            bodies[name] = _rod(length)
            states[name] = cj.body_state(place, orientation)
        for pin, first, second, on_first, on_second in (
            ("A", "ground", crank, (left, 0.0, 0.0), (-0.5 * CRANK, 0.0, 0.0)),
            ("B", crank, coupler, (0.5 * CRANK, 0.0, 0.0), (-0.5 * COUPLER, 0.0, 0.0)),
            ("C", coupler, rocker, (0.5 * COUPLER, 0.0, 0.0), (0.5 * CRANK, 0.0, 0.0)),
            ("D", "ground", rocker, (right, 0.0, 0.0), (-0.5 * CRANK, 0.0, 0.0)),
        ):
            joints[f"{pin} {k + 1}"] = cj.RevoluteJoint(first, second, on_first, on_second, Z, Z)
    return cj.Scene(bodies, joints, gravity=(0.0, -9.81, 0.0)), cj.State(states)


def _rod(length: float) -> cj.Body:
    """Return a slender rod of 1 kg along X."""
    across = length**2 / 12.0
    return cj.Body(1.0, (1e-3 * across, across, across))


ARM, ANGLE, PLAY = 0.5, 0.6, 0.2e-3
"""Length of the arms of the scissor lift, m, their angle to the ground, rad, and the radial
clearance of its pins, m."""


def scissor(stages: int) -> Mechanism:
    """Return a scissor lift in the plane XY, at rest, with gravity along -Y.

    A stage consists of two arms that cross in a pin: "up" from the lower left to the upper right,
    "down" from the upper left to the lower right. The left foot is hinged on the ground, the right
    one slides along X. Pins between stages are ideal on the left, and have clearance on the right.
    """
    half = 0.5 * ARM
    width, height = ARM * math.cos(ANGLE), ARM * math.sin(ANGLE)
    near, far = (-half, 0.0, 0.0), (half, 0.0, 0.0)
    bodies, states = {}, {}
    joints: dict[str, Any] = {
        "foot": cj.RevoluteJoint("ground", "up 1", ORIGIN, near, Z, Z),
        "slider": cj.InlineJoint("ground", "down 1", ORIGIN, far, X),
    }
    law = cj.laws.LankaraniNikravesh(restitution=0.9, stiffness=cj.mechanisms.STEEL)
    for k in range(1, stages + 1):
        middle = (0.5 * width, (k - 0.5) * height, 0.0)
        for name, sign in ((f"up {k}", 1.0), (f"down {k}", -1.0)):
            bodies[name] = _rod(ARM)
            turned = math.cos(0.5 * ANGLE), 0.0, 0.0, sign * math.sin(0.5 * ANGLE)
            states[name] = cj.body_state(middle, turned)
        joints[f"middle {k}"] = cj.RevoluteJoint(f"up {k}", f"down {k}", ORIGIN, ORIGIN, Z, Z)
        if k > 1:
            joints[f"left {k}"] = cj.RevoluteJoint(f"down {k - 1}", f"up {k}", near, near, Z, Z)
            joints[f"right {k}"] = cj.ClearanceJoint(
                f"up {k - 1}",
                f"down {k}",
                bearing_point=far,
                journal_point=far,
                bearing_radius=10e-3,
                clearance=PLAY,
                journal_length=20e-3,
                law=law,
            )
    return cj.Scene(bodies, joints, gravity=(0.0, -9.81, 0.0)), cj.State(states)


SCENES: dict[str, Callable[[int], Mechanism]] = {
    "backlash": backlash_chain.chain,
    "ideal": ideal_chain,
    "humanoid": humanoid,
    "four-bars": four_bars,
    "scissor": scissor,
}
"""Scenes by name, as functions of their size: joints, four-bars or stages."""
