"""A shaft in a bearing of the ground about Z, on which drives and friction act."""

from typing import Any

import numpy as np

import clearjoint as cj

Z, ORIGIN = (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
INERTIA = 0.02
"""About Z, kg m^2."""
SHAFT = cj.Body(1.0, (0.03, 0.03, INERTIA))
ON_SHAFT = "ground", "shaft", Z
"""Bodies and axis of an element that acts on the shaft."""


def shaft(gravity: Any = None, body: cj.Body = SHAFT, **elements: Any) -> cj.Scene:
    """The shaft, whose centre of mass is on the axis, with joints and forces by name."""
    joints: dict[str, Any] = {"bearing": cj.RevoluteJoint("ground", "shaft", ORIGIN, ORIGIN, Z, Z)}
    forces = {}
    for name, element in elements.items():
        family = forces if isinstance(element, cj.extend.AbstractForce) else joints
        family[name] = element
    return cj.Scene({"shaft": body}, joints, forces, gravity)


def turned(angle: float = 0.0, speed: float = 0.0) -> cj.State:
    """The shaft at an angle, rad, and a speed, rad/s."""
    return cj.State({"shaft": cj.body_state(ORIGIN, cj.rotation(Z, angle), spin=(0.0, 0.0, speed))})


def angle_about(body: Any, axis: int = 3) -> np.ndarray:
    """Angles, rad, of a body that turns about one axis only; `axis`: 1, 2 or 3 for X, Y or Z."""
    orientation = np.asarray(body.orientation)
    return 2.0 * np.arctan2(orientation[..., axis], orientation[..., 0])
