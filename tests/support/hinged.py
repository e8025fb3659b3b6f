"""A small mechanism of general numbers, as arrays: a link on a hinge of the ground, and a journal
thrown about in the link's bearing. No component is zero or one, so all of them share a program."""

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

import clearjoint as cj

NAMES = {"link": "link", "arm": "arm", "hinge": "hinge", "pin": "pin"}


class Outcome(NamedTuple):
    """Of both bodies: positions (2, 3) m, rotations (2, 3, 3) from body to global axes, velocities
    (2, 3) m/s and spins (2, 3) rad/s in body axes."""

    position: Any
    rotation: Any
    velocity: Any
    spin: Any


class Hinged(NamedTuple):
    """All numbers: of the link first, then of the arm, which carries the journal.

    `hinge` and `hinge_axis` are on the ground, `hinge_own` and `hinge_axis_own` on the link;
    `bearing` and its axis on the link; `journal` and its axis on the arm.
    """

    mass: Any
    inertia: Any
    hinge: Any
    hinge_axis: Any
    hinge_own: Any
    hinge_axis_own: Any
    bearing: Any
    bearing_axis: Any
    journal: Any
    journal_axis: Any
    radius: float
    clearance: float
    length: float
    stiffness: float
    restitution: float
    floor: float
    friction: float
    regularisation: float
    gravity: Any
    start: Outcome
    end_time: float
    landing: float


def drawn(seed: int) -> Hinged:
    """A mechanism in motion, whose journal meets the wall once or more."""
    generator = np.random.default_rng(seed)

    def direction() -> np.ndarray:
        vector = generator.uniform(0.3, 1.0, 3) * generator.choice((-1.0, 1.0), 3)
        return vector / np.linalg.norm(vector)

    frames = Rotation.random(2, rng=generator).as_matrix()
    link, arm = Rotation.random(2, rng=generator).as_matrix()
    hinge, hinge_own, bearing, journal = generator.uniform(0.05, 0.2, (4, 3))
    hinge_axis_own, bearing_axis, clearance = direction(), direction(), 0.5e-3
    moments = generator.uniform(2e-3, 3e-3, (2, 3))
    inertia = np.stack([f @ np.diag(m) @ f.T for f, m in zip(frames, moments, strict=True)])
    spin = 3.0 * hinge_axis_own, generator.uniform(-2.0, 2.0, 3)
    position = hinge - link @ hinge_own
    velocity = link @ np.cross(spin[0], -hinge_own)
    across = np.cross(bearing_axis, direction())
    across /= np.linalg.norm(across)
    offset, throw = 0.4 * clearance * across, 0.4 * np.cross(bearing_axis, across) + 0.3 * across
    arm_velocity = velocity + link @ (np.cross(spin[0], bearing + offset) + throw)
    return Hinged(
        generator.uniform(0.5, 2.0, 2),
        inertia,
        hinge,
        link @ hinge_axis_own,
        hinge_own,
        hinge_axis_own,
        bearing,
        bearing_axis,
        journal,
        arm.T @ link @ bearing_axis,
        10e-3,
        clearance,
        20e-3,
        generator.uniform(1e9, 2e9),
        generator.uniform(0.6, 0.9),
        1e-6,
        0.05,
        1e-3,
        9.81 * direction(),
        Outcome(
            np.stack([position, position + link @ (bearing + offset) - arm @ journal]),
            np.stack([link, arm]),
            np.stack([velocity, arm_velocity - arm @ np.cross(spin[1], journal)]),
            np.stack(spin),
        ),
        5e-3,
        1e-12,
    )


def scene(numbers: Hinged, names: dict[str, str] = NAMES) -> cj.Scene:
    """The mechanism, its elements called as told."""
    n = numbers
    bodies = {
        names[name]: cj.Body(mass, inertia)
        for name, mass, inertia in zip(("link", "arm"), n.mass, n.inertia, strict=True)
    }
    hinge = cj.RevoluteJoint(
        "ground", names["link"], n.hinge, n.hinge_own, n.hinge_axis, n.hinge_axis_own
    )
    pin = cj.ClearanceJoint(
        names["link"],
        names["arm"],
        bearing_point=n.bearing,
        bearing_axis=n.bearing_axis,
        journal_point=n.journal,
        journal_axis=n.journal_axis,
        bearing_radius=n.radius,
        clearance=n.clearance,
        journal_length=n.length,
        law=cj.laws.LankaraniNikravesh(n.restitution, n.stiffness, entry_speed_floor=n.floor),
        friction=cj.frictions.RegularisedCoulomb(n.friction, n.regularisation),
    )
    return cj.Scene(bodies, {names["hinge"]: hinge, names["pin"]: pin}, gravity=n.gravity)


def state(numbers: Hinged, names: dict[str, str] = NAMES) -> cj.State:
    """Where it starts, in flight."""
    euler = np.roll(Rotation.from_matrix(numbers.start.rotation).as_quat(), 1, axis=1)
    return cj.State(
        {
            names[name]: cj.body_state(
                numbers.start.position[k],
                euler[k],
                numbers.start.velocity[k],
                numbers.start.spin[k],
            )
            for k, name in enumerate(("link", "arm"))
        },
        {names["pin"]: {"V": np.zeros(()), "W": np.zeros(())}},
    )


def outcome(found: cj.State, names: dict[str, str] = NAMES) -> Outcome:
    """What a run ends with."""
    bodies = [found.bodies[names[name]] for name in ("link", "arm")]
    euler = np.stack([np.roll(np.asarray(body.orientation), -1) for body in bodies])
    position, velocity, spin = (
        np.stack([np.asarray(getattr(body, part)) for body in bodies])
        for part in ("position", "velocity", "spin")
    )
    return Outcome(position, Rotation.from_quat(euler).as_matrix(), velocity, spin)
