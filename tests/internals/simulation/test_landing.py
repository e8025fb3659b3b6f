"""Landing of steps on contact events, including contacts shorter than a step."""

import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._dynamics.contact_events import ContactGap
from clearjoint._simulation.step.landing import Landing
from tests.support.one_body import bearing, one_body

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
SCENE, _ = one_body("rod", {"pin": bearing(LAW, "rod", clearance=CLEARANCE)}, inertia=(1e-3,) * 3)


@pytest.mark.parametrize("side", [-1.0, 0.0, 1.0])
def test_a_start_at_the_wall_is_an_onset_on_either_side(side):
    """The start is before the wall by a rounding, at it, or past it; the journal moves in any
    direction."""
    speed, place = 0.1, CLEARANCE * (1.0 + 4e-16 * side)
    for angle in np.linspace(0.0, 5.0, 6):
        way = np.array([np.cos(angle), np.sin(angle), 0.0])
        start = cj.State({"rod": cj.body_state(place * way, velocity=speed * way)})
        final = cj.simulate(SCENE, start, 1e-3, progress=False).final
        restitution = -float(final.bodies["rod"].velocity @ way) / speed
        assert restitution == pytest.approx(float(LAW.delivered_restitution()), rel=2e-4)
