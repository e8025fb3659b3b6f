"""One of each ideal joint and drive in one scene."""

import math
from typing import Any

import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

import clearjoint as cj

X, Y, Z = np.eye(3)
ORIGIN = (0.0, 0.0, 0.0)


def hooke(angle: Any, tilt: float) -> tuple[Any, Any]:
    """Return angle and speed ratio of the second shaft of a universal joint, for an angle of the
    first from the plane of the shafts.
    """
    turned = np.arctan2(np.sin(angle) / np.cos(tilt), np.cos(angle))
    return turned, np.cos(tilt) / (1.0 - (np.sin(tilt) * np.cos(angle)) ** 2)


TILT, LEAD, GRAVITY, END = 0.5, 0.02, 9.81, 10.0
NUT, NUT_INERTIA = 0.4, 3e-4
SHAFT = Rotation.from_rotvec(TILT * Y)
DRIVE = (0.2, 5.0, 1.5)
"""Coefficients of the driving shaft's angle."""
PINION, WHEEL, TORQUE = 2e-3, 5e-2, 0.03
SLOPE = Rotation.from_rotvec([0.3, 0.2, 0.1])
CART, STROKE, PACE = 0.7, 0.1, 4.0
ROTOR, STIFFNESS, DAMPING, RELEASED, REST = 0.02, 5.0, 0.01, 0.9, 0.2
CUSHIONED, SOFTNESS, SOFTENING, SHIFT = 2.0, 800.0, 3.0, 0.01
GAIN, DAMPER, LIMIT, TARGET = 3.0, 0.4, 0.5, 2.0
AIM = cj.Polynomial([TARGET])
"""The motor's constant target, rad."""


def machines(target: cj.extend.AbstractFunctionOfTime = AIM) -> tuple[cj.Scene, cj.State]:
    """Return one of each, in the same gravity along -Y; the motor follows a target."""
    scene = cj.Scene(_bodies(), _joints(), _forces(target), (0.0, -GRAVITY, 0.0))
    return scene, cj.State(_states())


def _bodies() -> dict[str, cj.Body]:
    disc = (1e-3, 1e-3, 2e-3)
    return {
        "shaft": cj.Body(1.0, disc),
        "tilted": cj.Body(1.0, disc),
        "nut": cj.Body(NUT, (2e-4, NUT_INERTIA, 2e-4)),
        "pinion": cj.Body(1.0, (1e-3, 1e-3, PINION)),
        "wheel": cj.Body(3.0, (3e-2, 3e-2, WHEEL)),
        "plate": cj.Body(2.0, (1e-2, 2e-2, 3e-2)),
        "ball": cj.Body(1.0, (1.0, 1.0, 1.0)),
        "cart": cj.Body(CART, (1e-3, 1e-3, 1e-3)),
        "sprung": cj.Body(1.0, (1e-2, 1e-2, ROTOR)),
        "driven": cj.Body(1.0, (1e-2, 1e-2, ROTOR)),
        "cushioned": cj.Body(CUSHIONED, (1e-2, 1e-2, 1e-2)),
    }


def _joints() -> dict[str, cj.extend.AbstractConstraint]:
    far, normal = SHAFT.apply(Z), SLOPE.apply(Z)
    bearings: dict[str, cj.extend.AbstractConstraint] = {
        f"{name} bearing": cj.RevoluteJoint("ground", name, ORIGIN, ORIGIN, Z, Z)
        for name in ("shaft", "pinion", "wheel", "sprung", "driven")
    }
    return bearings | {
        "drive": cj.PrescribedAngle("ground", "shaft", Z, cj.Polynomial(DRIVE)),
        "cardan": cj.UniversalJoint("shaft", "tilted", ORIGIN, ORIGIN, X, Y),
        "tilted bearing": cj.InlineJoint("ground", "tilted", far, Z, far),
        "screw": cj.ScrewJoint("ground", "nut", ORIGIN, ORIGIN, Y, Y, LEAD),
        "gears": cj.GearJoint("ground", "pinion", "wheel", Z, Z, 17, 51),
        "table": cj.PlanarJoint("ground", "plate", ORIGIN, ORIGIN, normal, Z),
        "rod": cj.DistanceJoint("ground", "ball", ORIGIN, ORIGIN, 1.0),
        "rail": cj.PrismaticJoint("ground", "cart", ORIGIN, ORIGIN, X),
        "pusher": cj.PrescribedTranslation(
            "ground", "cart", ORIGIN, ORIGIN, X, lambda t: STROKE * jnp.cos(PACE * t)
        ),
    }


def _forces(target: cj.extend.AbstractFunctionOfTime) -> dict[str, cj.extend.AbstractForce]:
    return {
        "torque": cj.DriveTorque("ground", "pinion", Z, TORQUE),
        "spring": cj.TorsionalSpring("ground", "sprung", Z, STIFFNESS, DAMPING, REST),
        "liner": cj.Bushing(
            "ground",
            "cushioned",
            ORIGIN,
            ORIGIN,
            stiffness=(SOFTNESS, 1e3, 1e3),
            damping=(SOFTENING, 0.0, 0.0),
            rotational_stiffness=(1.0, 1.0, 1.0),
            rotational_damping=(0.0, 0.0, 0.0),
        ),
        "motor": cj.Motor(
            "ground",
            "driven",
            Z,
            target=target,
            proportional=GAIN,
            derivative=DAMPER,
            torque_limit=LIMIT,
        ),
    }


def _states() -> dict[str, cj.BodyState]:
    angle, speed = DRIVE[0], DRIVE[1]
    second, ratio = hooke(angle, TILT)
    about = Rotation.from_rotvec(second * SHAFT.apply(Z)) * SHAFT
    states = {name: cj.body_state(ORIGIN) for name in ("nut", "pinion", "wheel", "driven")}
    return states | {
        "shaft": cj.body_state(ORIGIN, quaternion(angle), spin=speed * Z),
        "tilted": cj.body_state(ORIGIN, about.as_quat(scalar_first=True), spin=speed * ratio * Z),
        "plate": cj.body_state(
            ORIGIN, SLOPE.as_quat(scalar_first=True), SLOPE.apply((1.0, 2.0, 0.0)), (0.0, 0.0, 3.0)
        ),
        "ball": cj.body_state((-1.0, 0.0, 0.0)),
        "cushioned": cj.body_state((SHIFT, 0.0, 0.0)),
        "cart": cj.body_state((STROKE, 0.0, 0.0)),
        "sprung": cj.body_state(ORIGIN, quaternion(REST + RELEASED)),
    }


def quaternion(angle: float) -> np.ndarray:
    """Return the Euler parameters of a rotation about Z."""
    return np.array([math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)])
