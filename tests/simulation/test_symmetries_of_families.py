"""Symmetries of films, links, and every law and friction, like those of `test_symmetries.py`, whose
mechanism has one law and one friction."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import clearjoint as cj
from tests.simulation.test_symmetries import directions, factors, few, mirror, vectors
from tests.support import families
from tests.support import symmetry_transformations as symmetries
from tests.support.families import FAMILIES
from tests.support.hinged import Outcome

CLOSE = 1e-6
pytestmark = pytest.mark.filterwarnings("ignore::clearjoint.UnusualValueWarning")
every = pytest.mark.parametrize("family", FAMILIES)


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
    rotation = np.stack([symmetries.matrix(body.orientation) for body in bodies])
    parts = ("position", "velocity", "spin")
    position, velocity, spin = (
        np.stack([np.asarray(getattr(b, p)) for b in bodies]) for p in parts
    )
    return Outcome(position, rotation, velocity, spin)


def apart(found: cj.State, expected: cj.State) -> dict[str, float]:
    """By body, the largest difference of a part over the size of this part of all bodies."""
    a, b = (outcome(state, expected.bodies) for state in (found, expected))
    off = [
        np.abs(x - y).reshape(len(x), -1).max(1) / np.abs(y).max()
        for x, y in zip(a, b, strict=True)
    ]
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
def general(family: str) -> tuple[cj.Scene, cj.State, float]:
    """A family's scene in which no component is zero or one, so that all views share a program."""
    make, end = FAMILIES[family]
    scene, state = make()
    maps, moved = (
        maps_of(scene, np.array([0.3, 0.5, -0.4]), np.array([0.2, 0.3, 0.1])),
        np.array([0.3, -0.2, 0.4]),
    )
    return (
        symmetries.turned(scene, maps, moved),
        symmetries.turned_state(state, maps, moved),
        end,
    )


@cache
def ended(family: str) -> cj.State:
    return simulated(*general(family))


@every
@few
@given(turn=directions, own=directions, moved=vectors, normal=st.none() | directions)
def test_turned_moved_and_mirrored(family, turn, own, moved, normal):
    scene, state, end = general(family)
    maps = maps_of(scene, turn, own, normal)
    found = simulated(
        symmetries.turned(scene, maps, moved),
        symmetries.turned_state(state, maps, moved),
        end,
    )
    assert not far(found, symmetries.turned_state(ended(family), maps, moved))


@every
@few
@given(scale=st.tuples(factors, factors, factors))
def test_in_other_units(family, scale):
    scene, state, end = general(family)
    found = simulated(
        symmetries.in_units(scene, scale),
        symmetries.state_in_units(state, scale),
        end * scale[2],
        scale[0],
    )
    assert not far(found, symmetries.state_in_units(ended(family), scale))


@every
@pytest.mark.parametrize("choice", [1, 2, 3])
def test_axes_reversed(family, choice):
    """Reversed axes exchange the bases of a journal."""
    scene, state, end = general(family)
    changed = symmetries.scene_with(scene, lambda e: symmetries.reversed_axes(e, choice))
    assert not far(simulated(changed, state, end), ended(family))


GAPS = st.builds(
    lambda depth, rate: cj.extend.Gap(depth, rate, 10e-3, 0.1e-3),
    st.floats(1e-6, 8e-5),
    st.floats(-0.3, 0.3),
)


def force(law: cj.extend.AbstractContactLaw, gap: cj.extend.Gap, entry: float) -> float:
    law = cj.extend.unpack(law)
    return float(law.force(gap, entry if law.uses_entry_speed else None))


def gap_in_units(gap: cj.extend.Gap, scale) -> cj.extend.Gap:
    metre, _, second = scale
    lengths = (metre * x for x in (gap.bearing_radius, gap.clearance))
    return cj.extend.Gap(metre * gap.depth, metre / second * gap.rate, *lengths)


@few
@given(gap=GAPS, scale=st.tuples(factors, factors, factors))
def test_every_law_in_other_units(gap, scale):
    laws = [*families.contact_laws(), *map(cj.laws.Hertz, families.cylinders())]
    newton, speed = symmetries.factor("N", scale, {}), scale[0] / scale[2]
    for law in laws:
        found = force(
            symmetries.in_other_units(law, scale),
            gap_in_units(gap, scale),
            0.25 * speed,
        )
        expected = newton * force(law, gap, 0.25)
        assert np.isclose(found, expected, rtol=1e-9), law


NOT_LOSSLESS_AT_ONE = {"GharibHurmuzlu"}
"""Laws whose published formula damps even at a restitution of one."""


@few
@given(gap=GAPS)
def test_every_law_backwards_at_restitution_one(gap):
    back = cj.extend.Gap(gap.depth, -gap.rate, gap.bearing_radius, gap.clearance)
    for law in families.contact_laws(lossless=True):
        if type(law).__name__ not in NOT_LOSSLESS_AT_ONE:
            assert np.isclose(force(law, back, 0.25), force(law, gap, 0.25), rtol=1e-12), law


@few
@given(speed=st.floats(1e-5, 0.3), scale=st.tuples(factors, factors, factors))
def test_every_friction_in_other_units(speed, scale):
    for name, law in families.friction_laws().items():
        if isinstance(law, cj.extend.AbstractFriction):
            other = symmetries.in_other_units(law, scale)
            found = other.ratio(np.asarray(scale[0] / scale[2] * speed))
            assert np.isclose(found, law.ratio(np.asarray(speed)), rtol=1e-9), name
