"""Every joint, law, friction, film, force and drive, looked at otherwise: as in
`test_symmetries.py`, whose mechanism has one of each only. All of a family is in one scene."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import clearjoint as cj
from tests.simulation.test_symmetries import directions, factors, few, mirror, vectors
from tests.support import families, seen_otherwise
from tests.support.families import FAMILIES
from tests.support.hinged import Outcome

CLOSE = 1e-6
every = pytest.mark.parametrize("family", FAMILIES)
turns = st.tuples(directions, directions)


def simulated(scene: cj.Scene, state: cj.State, end: float, metre: float = 1.0) -> cj.State:
    return cj.simulate(
        scene,
        state,
        end,
        cj.Settings(rtol=1e-10, first_step=1e-3 * end, landing_tolerance=1e-12 * metre),
        progress=False,
    ).final


def outcome(found: cj.State, names) -> Outcome:
    bodies = [found.bodies[name] for name in names]
    rotation = np.stack([seen_otherwise.matrix(body.orientation) for body in bodies])
    parts = ("position", "velocity", "spin")
    position, velocity, spin = (np.stack([np.asarray(getattr(b, p)) for b in bodies]) for p in parts)
    return Outcome(position, rotation, velocity, spin)


def apart(found: cj.State, expected: cj.State) -> dict[str, float]:
    """By body, the largest difference of a part over the size of this part of all bodies."""
    a, b = (outcome(state, expected.bodies) for state in (found, expected))
    off = [np.abs(x - y).reshape(len(x), -1).max(1) / np.abs(y).max() for x, y in zip(a, b)]
    return dict(zip(expected.bodies, np.max(off, axis=0), strict=True))


def far(found: cj.State, expected: cj.State, close: float = CLOSE) -> dict[str, float]:
    """The bodies that differ, and by how much."""
    return {name: off for name, off in apart(found, expected).items() if not off < close}


def maps_of(scene: cj.Scene, turn, own, mirrored=None):
    """A turn of the ground, and others of each body's frame, that all mirror or none does."""
    flip = np.eye(3) if mirrored is None else mirror(mirrored)
    maps = {
        name: Rotation.from_rotvec((k + 1.0) * own).as_matrix() @ flip
        for k, name in enumerate(scene.bodies)
    }
    return maps | {"ground": Rotation.from_rotvec(2.0 * turn).as_matrix() @ flip}


@cache
def general(family: str, lossless: bool = False) -> tuple[cj.Scene, cj.State, float]:
    """A family's scene in which no component is zero or one, so that all views share a program."""
    make, end = FAMILIES[family]
    scene, state = make(lossless)
    maps, moved = maps_of(scene, np.array([0.3, 0.5, -0.4]), np.array([0.2, 0.3, 0.1])), np.array(
        [0.3, -0.2, 0.4]
    )
    return (
        seen_otherwise.turned(scene, maps, moved),
        seen_otherwise.turned_state(state, maps, moved),
        end,
    )


@cache
def ended(family: str) -> cj.State:
    return simulated(*general(family))


@every
@few
@given(turn=directions, own=directions, moved=vectors)
def test_turned_and_moved(family, turn, own, moved):
    scene, state, end = general(family)
    maps = maps_of(scene, turn, own)
    found = simulated(
        seen_otherwise.turned(scene, maps, moved),
        seen_otherwise.turned_state(state, maps, moved),
        end,
    )
    assert not far(found, seen_otherwise.turned_state(ended(family), maps, moved))
