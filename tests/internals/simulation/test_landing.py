"""Landing of steps on contact events, including contacts shorter than a step."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._dynamics.contact_events import ContactGap, initial_entry_speeds
from clearjoint._model.contact.laws import UNKNOWN_ENTRY_SPEED
from clearjoint._simulation.step.landing import Landing

LANDING = Landing(1e-12)


def _reaches(depth, rate):
    return {"pin": {"V": ContactGap(jnp.asarray(depth), jnp.asarray(rate))}}


def _parabola(top, at, bend, t):
    """Return depth and rate of a parabola with its maximum at a given time."""
    return _reaches(top - 0.5 * bend * (t - at) ** 2, -bend * (t - at))


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["grazes the wall", "parts for a moment"])
def test_a_contact_within_a_step_is_landed_on(sign):
    """The landing is near the wall on the side of the start; the next steps predict the event."""
    top, at, bend, h = sign * 1e-9, 0.4e-3, sign * 9.81, 1e-3
    before, after = (_parabola(top, at, bend, t) for t in (0.0, h))
    retries, t = LANDING.retry(before, after, jnp.zeros(()), jnp.asarray(h))
    enters = at - (2.0 * (abs(top) - 0.5e-12) / 9.81) ** 0.5
    assert bool(retries)
    assert 0.95 * enters < float(t) < enters * (1.0 + 1e-9)


@pytest.mark.parametrize("top", [-1e-9, 0.5e-12], ids=["misses", "within the tolerance"])
def test_a_gap_that_stays_open_is_not_landed_on(top):
    before, after = (_parabola(top, 0.4e-3, 9.81, t) for t in (0.0, 1e-3))
    retries, _ = LANDING.retry(before, after, jnp.zeros(()), jnp.asarray(1e-3))
    assert not bool(retries)


def test_a_crossing_is_landed_on_half_the_tolerance_past_the_wall():
    before, after = _reaches(-1e-4, 0.1), _reaches(1e-4, 0.1)
    retries, t = LANDING.retry(before, after, jnp.zeros(()), jnp.asarray(2e-3))
    assert bool(retries)
    assert 0.0 < 0.1 * float(t) - 1e-4 <= 1e-12


@pytest.mark.parametrize("rate, depth", [(1.0, 1e-12), (1e-3, 1e-14), (1e-9, 1e-16)])
def test_slow_contacts_are_landed_on_closer(rate, depth):
    """Within 1e-11 s of the event, but not closer than a ten-thousandth of the tolerance."""
    h = 2e-9 / rate
    retries, t = LANDING.retry(
        _reaches(-1e-9, rate), _reaches(1e-9, rate), jnp.zeros(()), jnp.asarray(h)
    )
    assert bool(retries)
    assert 0.0 < rate * float(t) - 1e-9 <= depth
    within = _reaches(0.9 * depth, rate)
    assert not bool(LANDING.retry(_reaches(-1e-9, rate), within, 0.0, jnp.asarray(h))[0])


CLEARANCE, LAW = 5e-4, cj.laws.LankaraniNikravesh(restitution=0.5, stiffness=1e9)
SCENE = cj.Scene(
    {"rod": cj.Body(1.0, (1e-3, 1e-3, 1e-3))},
    {
        "pin": cj.ClearanceJoint(
            "ground",
            "rod",
            bearing_radius=0.01,
            clearance=CLEARANCE,
            journal_length=0.02,
            law=LAW,
        )
    },
)


@pytest.fixture(scope="module")
def rebounds():
    """Restitutions of a journal that starts at the wall, shape (sides, directions).

    The start is before the wall by a rounding, at it, and past it.
    """
    speed = 0.1
    at_rest = cj.State({"rod": cj.body_state(np.zeros(3))})

    def rebound(side, angle):
        way = np.array([np.cos(angle), np.sin(angle), 0.0])
        state = eqx.tree_at(
            lambda s: (s.bodies["rod"].position, s.bodies["rod"].velocity),
            at_rest,
            (CLEARANCE * side * way, speed * way),
        )
        final = cj.simulate(SCENE, state, 1e-3, progress=False).final
        return -(final.bodies["rod"].velocity @ way) / speed

    angles, sides = np.linspace(0.0, 5.0, 6), 1.0 + 4e-16 * np.array([-1.0, 0.0, 1.0])
    result = [[rebound(side, angle) for angle in angles] for side in sides]
    return np.array(result), LAW.delivered_restitution()


def test_a_start_at_the_wall_is_an_onset_on_either_side(rebounds):
    result, delivered = rebounds
    np.testing.assert_allclose(result, delivered, rtol=2e-4)


def test_a_start_at_the_wall_at_rest_is_an_onset_too():
    """Its speed is also due to rounding: the law applies its floor."""
    for rate in (0.0, 1e-18, -1e-18):
        result = {"pin": {base: ContactGap(jnp.asarray(1e-17), jnp.asarray(rate)) for base in "VW"}}
        entry_speeds = initial_entry_speeds(SCENE, result)["pin"]
        assert entry_speeds["V"] == entry_speeds["W"] == 1e-12


def test_a_contact_well_inside_at_the_start_counts_as_elastic():
    result = {"pin": {base: ContactGap(jnp.asarray(1e-9), jnp.asarray(0.1)) for base in "VW"}}
    assert initial_entry_speeds(SCENE, result)["pin"]["V"] == UNKNOWN_ENTRY_SPEED
