"""A journal that runs round in its bearing, with a force: a motion made by hand, without a run."""

import numpy as np

import clearjoint as cj
from tests.support.observations import observation_of

CLEARANCE, RADIUS, COUNT = 0.5e-3, 10e-3, 40
FORCE = 200.0
"""N, while the journal touches."""
ContactObservation = cj.results.Observation.__annotations__["contacts"].__args__[1].__args__[1]
TIMES = np.linspace(0.0, 0.02, COUNT)
TOUCHING = np.arange(COUNT) >= COUNT // 2


def arm_in_bearing() -> cj.Scene:
    """An arm of 0.4 m, whose journal is in a bearing of the ground in the origin."""
    pin = cj.ClearanceJoint(
        "ground",
        "arm",
        journal_point=(-0.2, 0.0, 0.0),
        bearing_radius=RADIUS,
        clearance=CLEARANCE,
        journal_length=20e-3,
        law=cj.laws.Hertz(1e10),
    )
    inertia = 1.0 * 0.4**2 / 12.0
    return cj.Scene(
        {"arm": cj.Body(1.0, (1e-4, inertia, inertia))}, {"pin": pin}, gravity=(0.0, -9.81, 0.0)
    )


def eccentricities() -> np.ndarray:
    """From the bearing's centre to the journal's, (N, 3) m: half-way out, and then at the wall."""
    angle = 2.0 * np.pi * np.arange(COUNT) / COUNT
    size = np.where(TOUCHING, CLEARANCE, 0.5 * CLEARANCE)
    return np.stack([size * np.cos(angle), size * np.sin(angle), 0.0 * size], axis=1)


def motion() -> cj.results.Trajectory:
    """The arm, parallel to X all the time."""
    still = np.zeros((COUNT, 3))
    turn = np.tile((1.0, 0.0, 0.0, 0.0), (COUNT, 1))
    centre = eccentricities() + (0.2, 0.0, 0.0)
    return cj.results.Trajectory(TIMES, cj.State({"arm": cj.BodyState(centre, turn, still, still)}))


def observed() -> cj.results.Observation:
    """What an observation of it says: a line contact with a force at the wall."""
    offset = eccentricities()
    size = np.linalg.norm(offset, axis=1)
    normal = offset / size[:, None]
    zero = np.zeros(COUNT)
    ends = {}
    for base, side in (("V", -1.0), ("W", 1.0)):
        at_wall = RADIUS * normal + np.array([0.0, 0.0, 0.01 * side])
        ends[base] = ContactObservation(
            penetration=size - CLEARANCE + np.where(TOUCHING, 1e-9, 0.0),
            penetration_rate=zero,
            eccentricity=size,
            offset=offset,
            normal_force=np.where(TOUCHING, FORCE, 0.0),
            friction_force=None,
            normal=normal,
            point_on_bearing=at_wall,
            point_on_journal=at_wall,
        )
    kinds = cj.results.MotionMode
    modes = np.where(TOUCHING, kinds.LINE_CONTACT, kinds.FREE_FLIGHT)
    return observation_of(TIMES, contacts={"pin": ends}, modes={"pin": modes.astype(int)})
