"""A planar four-bar with play and friction at both ends of its coupler."""

import math

import numpy as np

import clearjoint as cj


def four_bar() -> tuple[cj.Scene, cj.State]:
    """A four-bar of 0.1, 0.3 and 0.25 m on feet 0.3 m apart, whose coupler has play at both ends,
    with friction; and its state at rest."""
    foot, crank = np.array([0.3, 0.0, 0.0]), 0.1 * np.array([math.cos(0.9), math.sin(0.9), 0.0])
    across = foot - crank
    reach = float(np.linalg.norm(across))
    along = (0.3**2 - 0.25**2 + reach**2) / (2.0 * reach)
    normal = np.array([-across[1], across[0], 0.0]) / reach
    tip = crank + along * across / reach + math.sqrt(0.3**2 - along**2) * normal
    bodies = {
        name: cj.Body(mass, (1e-5, mass * length**2 / 12, mass * length**2 / 12))
        for name, mass, length in (
            ("crank", 0.2, 0.1),
            ("coupler", 0.4, 0.3),
            ("rocker", 0.35, 0.25),
        )
    }
    origin, axis = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)

    def play(bearing: str, journal: str, here: float, there: float) -> cj.ClearanceJoint:
        return cj.ClearanceJoint(
            bearing,
            journal,
            bearing_point=(here, 0.0, 0.0),
            journal_point=(there, 0.0, 0.0),
            bearing_radius=10e-3,
            clearance=0.2e-3,
            journal_length=20e-3,
            law=cj.LankaraniNikravesh(restitution=0.8, stiffness=cj.RavnStiffness(207e9, 0.3)),
            friction=cj.RegularisedCoulomb(0.1),
        )

    def hinge(body: str, here: tuple[float, ...], there: float) -> cj.RevoluteJoint:
        return cj.RevoluteJoint("ground", body, here, (there, 0.0, 0.0), axis, axis)

    joints = {
        "crank foot": hinge("crank", origin, -0.05),
        "crank pin": play("crank", "coupler", 0.05, -0.15),
        "rocker pin": play("coupler", "rocker", 0.15, 0.125),
        "rocker foot": hinge("rocker", (0.3, 0.0, 0.0), -0.125),
    }

    def between(start: np.ndarray, end: np.ndarray) -> cj.BodyState:
        half = 0.5 * math.atan2(end[1] - start[1], end[0] - start[0])
        return cj.body_state(0.5 * (start + end), (math.cos(half), 0.0, 0.0, math.sin(half)))

    ends = {"crank": (np.zeros(3), crank), "coupler": (crank, tip), "rocker": (foot, tip)}
    state = cj.State({name: between(*points) for name, points in ends.items()})
    return cj.Scene(bodies, joints, gravity=(0.0, -9.81, 0.0)), state
