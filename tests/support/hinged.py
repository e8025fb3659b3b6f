"""A small mechanism of general numbers: a link on a hinge of the ground, and a journal thrown about
in the link's bearing. No component is zero or one, so all of them share a program."""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

import clearjoint as cj
from tests.support.one_body import bearing
from tests.support.symmetry_transformations import euler


class Hinged(NamedTuple):
    """The mechanism in flight, how long it moves, s, and the landing tolerance, m."""

    scene: cj.Scene
    state: cj.State
    end_time: float = 5e-3
    landing: float = 1e-12


def hinged(seed: int) -> Hinged:
    """A mechanism in motion, whose journal meets the wall once or more."""
    generator = np.random.default_rng(seed)

    def direction() -> np.ndarray:
        vector = generator.uniform(0.3, 1.0, 3) * generator.choice((-1.0, 1.0), 3)
        return vector / np.linalg.norm(vector)

    frames = Rotation.random(2, rng=generator).as_matrix()
    link, arm = Rotation.random(2, rng=generator).as_matrix()
    hinge, hinge_own, bearing_point, journal = generator.uniform(0.05, 0.2, (4, 3))
    hinge_axis, bearing_axis, clearance = direction(), direction(), 0.5e-3
    moments = generator.uniform(2e-3, 3e-3, (2, 3))
    spin = 3.0 * hinge_axis, generator.uniform(-2.0, 2.0, 3)
    position = hinge - link @ hinge_own
    velocity = link @ np.cross(spin[0], -hinge_own)
    across = np.cross(bearing_axis, direction())
    across /= np.linalg.norm(across)
    offset, throw = 0.4 * clearance * across, 0.4 * np.cross(bearing_axis, across) + 0.3 * across
    pin_velocity = velocity + link @ (np.cross(spin[0], bearing_point + offset) + throw)
    states = {
        "link": cj.body_state(position, euler(link), velocity, spin[0]),
        "arm": cj.body_state(
            position + link @ (bearing_point + offset) - arm @ journal,
            euler(arm),
            pin_velocity - arm @ np.cross(spin[1], journal),
            spin[1],
        ),
    }
    bodies = {
        name: cj.Body(mass, frame @ np.diag(moment) @ frame.T)
        for name, mass, frame, moment in zip(
            states, generator.uniform(0.5, 2.0, 2), frames, moments, strict=True
        )
    }
    stiffness, restitution = generator.uniform(1e9, 2e9), generator.uniform(0.6, 0.9)
    pin = bearing(
        cj.laws.LankaraniNikravesh(restitution, stiffness, entry_speed_floor=1e-6),
        *("arm", "link"),
        bearing_point=bearing_point,
        bearing_axis=bearing_axis,
        journal_point=journal,
        journal_axis=arm.T @ link @ bearing_axis,
        clearance=clearance,
        friction=cj.frictions.RegularisedCoulomb(0.05, 1e-3),
    )
    axle = cj.RevoluteJoint("ground", "link", hinge, hinge_own, link @ hinge_axis, hinge_axis)
    scene = cj.Scene(bodies, {"hinge": axle, "pin": pin}, gravity=9.81 * direction())
    return Hinged(scene, cj.State(states, {"pin": {"V": np.zeros(()), "W": np.zeros(())}}))
