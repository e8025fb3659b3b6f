"""A planar four-bar with play and friction at both ends of its coupler."""

import math

import numpy as np

import clearjoint as cj

LENGTHS = {"crank": 0.1, "coupler": 0.3, "rocker": 0.25}
"""m."""
MASSES = {"crank": 0.2, "coupler": 0.4, "rocker": 0.35}
"""kg."""
FEET = 0.3
"""Distance of the feet, m."""


def four_bar() -> tuple[cj.Scene, cj.State]:
    """A four-bar of 0.1, 0.3 and 0.25 m on feet 0.3 m apart, whose coupler has play at both ends,
    with friction; and its state at rest."""
    bodies = {name: _rod(MASSES[name], length) for name, length in LENGTHS.items()}
    joints = {
        "crank foot": _hinge("crank", 0.0, -0.05),
        "crank pin": _play("crank", "coupler", 0.05, -0.15),
        "rocker pin": _play("coupler", "rocker", 0.15, 0.125),
        "rocker foot": _hinge("rocker", FEET, -0.125),
    }
    return cj.Scene(bodies, joints, gravity=(0.0, -9.81, 0.0)), _at_rest(angle=0.9)


def _rod(mass: float, length: float) -> cj.Body:
    across = mass * length**2 / 12
    return cj.Body(mass, (1e-5, across, across))


def _hinge(body: str, foot: float, there: float) -> cj.RevoluteJoint:
    """A hinge on the ground, `foot` m along x and `there` m along the body."""
    axis = (0.0, 0.0, 1.0)
    return cj.RevoluteJoint("ground", body, (foot, 0.0, 0.0), (there, 0.0, 0.0), axis, axis)


def _play(bearing: str, journal: str, here: float, there: float) -> cj.ClearanceJoint:
    """A joint with play, `here` and `there` m along its bodies."""
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


def _at_rest(angle: float) -> cj.State:
    """The closed linkage at an angle of the crank, rad."""
    foot = np.array([FEET, 0.0, 0.0])
    crank = LENGTHS["crank"] * np.array([math.cos(angle), math.sin(angle), 0.0])
    tip = _meeting(crank, foot, LENGTHS["coupler"], LENGTHS["rocker"])
    ends = {"crank": (np.zeros(3), crank), "coupler": (crank, tip), "rocker": (foot, tip)}
    return cj.State({name: _between(*points) for name, points in ends.items()})


def _meeting(one: np.ndarray, other: np.ndarray, first: float, second: float) -> np.ndarray:
    """The upper point at such distances from two points."""
    across = other - one
    reach = float(np.linalg.norm(across))
    along = (first**2 - second**2 + reach**2) / (2.0 * reach)
    normal = np.array([-across[1], across[0], 0.0]) / reach
    return one + along * across / reach + math.sqrt(first**2 - along**2) * normal


def _between(start: np.ndarray, end: np.ndarray) -> cj.BodyState:
    """The state of a rod from one point to another."""
    half = 0.5 * math.atan2(end[1] - start[1], end[0] - start[0])
    return cj.body_state(0.5 * (start + end), (math.cos(half), 0.0, 0.0, math.sin(half)))
