"""Forces of contacts that stay open or closed for a whole step."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._dynamics.contact_forces import LoadedContact, contact_force, contact_wrenches
from clearjoint._model.joints.base import SideForce
from clearjoint.extend import ZERO, Contact, Vector
from tests.support.motions import AT_REST
from tests.support.planes import Plane

DEPTH, RATE = 3e-14, -0.06
SPRINGS = [
    pytest.param(cj.laws.Hertz(4e8, exponent=1.0), marks=pytest.mark.slow),
    cj.laws.ExactRestitution(0.8, 4e8, exponent=1.0),
]


def forces_at(law, closed, depth):
    """Return normal force and friction along Y of a point against a plane, N."""
    plane = Plane(
        "ball", ((0, 0, 0),), (1.0, 0.0, 0.0), 0.0, law, cj.frictions.RegularisedCoulomb(0.2, 1e-2)
    )
    gap = cj.extend.Gap(depth, RATE)
    contact = Contact(gap, Vector(1.0, 0.0, 0.0), ZERO, ZERO, Vector(0.0, 0.5, 0.0))
    entry = 0.1 if law.uses_entry_speed else None
    force = contact_force(plane, "point 0", law, contact, entry, jnp.asarray(closed), {}, {})
    return jnp.stack([jnp.asarray(force.normal_force), jnp.asarray(force.friction.y)])


@pytest.mark.parametrize("law", SPRINGS)
def test_force_of_a_closed_spring_continues_past_the_wall(law):
    """Value and slope, also of friction, whose law never gets a negative normal force."""
    inside, past = (forces_at(law, True, sign * DEPTH) for sign in (1.0, -1.0))
    np.testing.assert_allclose(past, -inside, rtol=1e-14)
    assert inside[0] > 0.0
    slopes = [jax.jacfwd(lambda d: forces_at(law, True, d))(s * DEPTH) for s in (1.0, -1.0)]
    np.testing.assert_allclose(slopes[1], slopes[0], rtol=1e-14)
    assert not np.any(forces_at(law, False, DEPTH))


def test_moment_of_friction_acts_beside_a_side_force():
    """The bodies get the moment about the normal with opposite signs, and the side force too."""
    normal, moment, push = Vector(0.0, 0.6, 0.8), 0.7, Vector(0.0, 0.0, 3.0)
    side = SideForce(ZERO, ZERO, ZERO, push)
    contact = Contact(cj.extend.Gap(0.0, 0.0), normal, ZERO, ZERO, None, side=side)
    plane = cj.Stop("a", "b", normal=(1, 0, 0), law=cj.laws.Hertz(1e9))
    motions = {"a": AT_REST, "b": AT_REST}
    force = LoadedContact(contact, 0.0, 0.0, None, friction_moment=moment)
    total = {name: np.zeros(6) for name in motions}
    for name, wrench in contact_wrenches(plane, force, motions):
        total[name] += [*wrench.force, *wrench.moment]
    expected = [0.0, 0.0, 3.0, 0.0, 0.42, 0.56]
    np.testing.assert_allclose(total["b"], expected, rtol=1e-12)
    np.testing.assert_allclose(total["a"], -np.array(expected), rtol=1e-12)


class Preloaded(cj.extend.AbstractContactLaw):
    """A linear spring that begins before the surfaces touch, with a force of 3 N there."""

    ahead: Any = cj.extend.quantity("m")
    uses_entry_speed = False

    def onset_offset(self):
        return self.ahead

    def force(self, gap, entry_speed):
        return self.elastic_force(gap)

    def elastic_force(self, gap):
        depth = gap.depth + self.ahead
        return jnp.where(depth > 0.0, 3.0 + 4e8 * depth, 0.0)

    def stored_energy(self, gap):
        return 0.0


@pytest.mark.parametrize("ahead", [0.0, 1e-6])
def test_force_that_jumps_at_an_early_onset_continues_past_it(ahead):
    law = Preloaded(ahead)
    assert law.force_jumps
    for depth in (-DEPTH, DEPTH):
        found = forces_at(law, True, depth - ahead)[0]
        assert found == pytest.approx(3.0 + 4e8 * depth, rel=1e-7)


@pytest.mark.parametrize(
    "law",
    [
        cj.laws.Hertz(1e9),
        cj.laws.Tsuji(0.8, 1e9, 1.0),
        cj.laws.Hertz(1e9, exponent=1.0, smoothing=1e-6),
    ],
)
def test_a_force_with_zero_slope_at_the_wall_ends_there(law):
    assert not law.slope_jumps()
    assert not np.any(forces_at(law, True, -law.onset_offset() - DEPTH))


def test_deflections_of_all_bristles_are_demanded():
    scene, state = cj.mechanisms.double_pendulum(friction=cj.frictions.Dahl(0.1, 1e5))
    scene, state = cj.extend.unpack((scene, state))
    system = cj.extend.System(scene, cj.extend.Formulation())
    speeds = {"shoulder": {"V": 0.0, "W": 0.0}}
    with pytest.raises(ValueError, match=r"`bristles` must be those of .* also 'V', but is \[\]"):
        system.contact_forces(system.encode(state.bodies), speeds)
