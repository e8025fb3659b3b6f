"""Random mechanisms in which contacts begin and end as bodies rotate evenly, or as they are driven.

In joint coordinates such a rotation has no integration error, so that nothing but the limit of the
rotation in a step keeps the steps short. The inertias are so large that the number of impacts
hardly depends on their details.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

import clearjoint as cj

LAW = cj.laws.LankaraniNikravesh(restitution=0.8, stiffness=1e8)
FLAT = cj.laws.ExactRestitution(0.8, 1e7)
O = (0.0, 0.0, 0.0)
KINDS = (
    "seal on a free rotor",
    "arm that meets a wall",
    "arm that orbits without rotating",
    "arm on a rotor, seal on the ground",
    "seal on a driven rotor",
    "seal on a rotor whose drive accelerates",
    "seal on a rotor that a torque accelerates",
    "arm on a rotor, seal on the rotor",
)


class Rotating(NamedTuple):
    """A scene with its initial state and the end time of its run, s."""

    scene: cj.Scene
    state: cj.State
    end_time: float


def rotating(kind: str, seed: int) -> Rotating:
    """Return a mechanism of random orientation, sizes and speeds."""
    g = np.random.default_rng([KINDS.index(kind), seed])
    # The names are the same for all seeds, so that all mechanisms of a kind share a program.
    rotor, arm, axle, hinge, seal = "rotor", "arm", "axle", "hinge", "seal"
    # All vectors are turned by one random rotation, which changes nothing but numbers.
    frame = Rotation.random(rng=g)

    def turned(x: float, y: float, z: float = 0.0) -> tuple[float, ...]:
        return tuple(frame.apply((x, y, z)))

    axis = turned(0.0, 0.0, 1.0)
    speed = g.uniform(50.0, 200.0) * g.choice((-1.0, 1.0))
    offset = g.uniform(1e-4, 4e-4)
    clearance = offset * g.uniform(0.9, 1.9)
    phase, inertia = g.uniform(0.0, 2.0 * math.pi), g.uniform(0.5, 3.0)
    end_time = g.uniform(3.0, 8.0) * 2.0 * math.pi / abs(speed)
    body = cj.Body(5.0, (inertia,) * 3)
    off = turned(offset * math.cos(phase), offset * math.sin(phase))
    # Here the seal's journal is opposite to the centre of its bearing's offset.
    far = math.pi - phase

    def oriented(angle: float) -> tuple[float, ...]:
        vector = math.sin(0.5 * angle) * np.asarray(axis)
        return (math.cos(0.5 * angle), *vector)

    def at(x=0.0, y=0.0, velocity=O, rate=0.0, angle=0.0):
        spin = tuple(rate * np.asarray(axis))
        return cj.body_state(turned(x, y), oriented(angle), velocity, spin)

    def hinged(first, second, point=O):
        return cj.RevoluteJoint(first, second, O, point, axis, axis)

    def sealed(first, second, bearing, journal, clearance=clearance):
        return cj.ClearanceJoint(
            first,
            second,
            bearing_point=bearing,
            journal_point=journal,
            bearing_axis=axis,
            journal_axis=axis,
            bearing_radius=0.05,
            clearance=clearance,
            journal_length=0.02,
            law=LAW,
        )

    bodies, forces = {rotor: body}, {}
    joints = {
        seal: sealed("ground", rotor, turned(offset, 0.0), off),
        axle: hinged("ground", rotor),
    }
    states = {rotor: at(rate=speed, angle=far)}
    if kind == "seal on a driven rotor":
        joints["drive"] = cj.PrescribedRotation("ground", rotor, axis, speed, far)
    elif kind == "seal on a rotor whose drive accelerates":
        states = {rotor: at(angle=far)}
        growth = cj.Polynomial((far, 0.0, speed**2 / 60.0, speed**3 / 3000.0))
        joints["drive"] = cj.PrescribedAngle("ground", rotor, axis, growth)
    elif kind == "seal on a rotor that a torque accelerates":
        states = {rotor: at(angle=far)}
        forces["drive"] = cj.DriveTorque("ground", rotor, axis, torque=inertia * speed**2 / 40.0)
    elif kind == "arm that meets a wall":
        reach = g.uniform(0.1, 0.4)
        half = reach - g.uniform(1e-4, 5e-3) if g.random() < 0.7 else reach * g.uniform(0.3, 0.9)
        pin, along, across = (turned(reach, 0.0), turned(1.0, 0.0), turned(0.0, 1.0))
        joints[seal] = cj.PinInSlot(
            "ground",
            rotor,
            play=2.0 * half,
            pin_radius=2.0 * reach,
            pin_point=pin,
            slot_axis=along,
            slot_normal=across,
            law=FLAT,
        )
        states = {rotor: at(rate=speed)}
    elif kind == "arm that orbits without rotating":
        radius, bodies[arm] = 0.7 * offset, cj.Body(2.0, (inertia,) * 3)
        joints[axle] = hinged("ground", rotor, turned(radius, 0.0))
        joints[hinge] = hinged(rotor, arm)
        room = offset * g.uniform(0.5, 1.1)
        joints[seal] = sealed("ground", arm, turned(0.5 * offset, 0.0), O, room)
        velocity = turned(0.0, -radius * speed)
        states = {
            rotor: at(-radius, velocity=velocity, rate=speed),
            arm: at(-radius, velocity=velocity),
        }
    elif kind != "seal on a free rotor":
        first = "ground" if kind.endswith("ground") else rotor
        bodies[arm] = cj.Body(2.0, (inertia,) * 3)
        joints[hinge] = hinged(rotor, arm)
        joints[seal] = sealed(first, arm, turned(offset, 0.0), off)
        relative = speed * g.uniform(-2.0, 2.0)
        angle = g.uniform(0.0, 6.0) if first == "ground" else 0.0
        states = {rotor: at(rate=speed, angle=angle), arm: at(rate=speed + relative, angle=far)}
    return Rotating(cj.Scene(bodies, joints, forces=forces), cj.State(states), end_time)
