"""Onsets and ends of contacts, and entry speeds, of given gaps."""

import numpy as np
import pytest

import clearjoint as cj
from clearjoint._dynamics import contact_events
from clearjoint._dynamics.contact_events import SLOWEST, TOUCHING, ContactGap
from clearjoint._model.contact.laws import UNKNOWN_ENTRY_SPEED
from clearjoint.extend import unpack

SCENE = unpack(cj.mechanisms.double_pendulum()[0])
OPEN = ContactGap(-1e-4, 0.3)


def gaps(depth, rate, other=OPEN):
    """The gaps of both bases."""
    return {"shoulder": {"V": ContactGap(depth, rate), "W": other}}


@pytest.mark.parametrize(
    ("depth", "rate", "expected"),
    [
        (-1e-4, 0.3, 0.0),
        (0.0, 0.3, 0.0),
        (0.5 * TOUCHING, 0.3, 0.3),
        (0.5 * TOUCHING, -0.3, SLOWEST),
        (1e-17, 0.0, SLOWEST),
        (1e-17, 1e-18, SLOWEST),
        (2.0 * TOUCHING, 0.3, UNKNOWN_ENTRY_SPEED),
    ],
)
def test_entry_speeds_at_the_start(depth, rate, expected):
    found = contact_events.initial_entry_speeds(SCENE, gaps(depth, rate))["shoulder"]
    assert float(found["V"]) == expected and float(found["W"]) == 0.0


def updated(before, end, second_rate):
    speeds = {"shoulder": {"V": 0.7, "W": 0.0}}
    seconds = {"shoulder": {"V": second_rate, "W": 0.0}}
    after = {"shoulder": {"V": end, "W": OPEN}}
    found = contact_events.updated_entry_speeds(SCENE, speeds, before, after, seconds)
    assert float(found["shoulder"]["W"]) == 0.0
    return float(found["shoulder"]["V"])


def test_the_entry_speed_is_that_at_the_onset():
    """With a constant second rate; one Newton step errs by second order in time."""
    speed, change, time = 0.5, -300.0, 1e-6
    end = ContactGap(speed * time + 0.5 * change * time**2, speed + change * time)
    assert updated(gaps(-1e-9, 0.5), end, change) == pytest.approx(speed, rel=2e-6)
    assert updated(gaps(-1e-9, 0.5), end, 0.0) == end.rate
    assert updated(gaps(1e-9, 0.5), end, change) == 0.7
    assert updated(gaps(1e-9, 0.5), ContactGap(-1e-9, -0.5), change) == 0.0


@pytest.mark.parametrize("change", [1.0, 2.0])
def test_a_grazing_contact_keeps_its_rate(change):
    """The correction, depth over rate times the second rate, is as large as the rate, or larger."""
    assert updated(gaps(-1e-9, 1.0), ContactGap(1.0, 1.0), change) == 1.0


def test_a_contact_is_too_deep_beyond_the_limit_of_its_joint():
    limit = float(SCENE.joints["shoulder"].deepest()["V"])
    assert not contact_events.too_deep(SCENE, gaps(limit, 0.0))
    assert contact_events.too_deep(SCENE, gaps(np.nextafter(limit, 1.0), 0.0))


@pytest.mark.parametrize(
    ("before", "after", "begins", "changes"),
    [
        (-1.0, -1.0, False, False),
        (0.0, 0.0, False, False),
        (0.0, 1.0, True, True),
        (-1.0, 1.0, True, True),
        (1.0, 0.0, False, True),
        (1.0, 2.0, False, False),
    ],
)
def test_events_between_two_instants(before, after, begins, changes):
    start, end = gaps(before, 1.0), gaps(after, 4.0)
    assert bool(contact_events.begins(start, end)) == begins
    assert bool(contact_events.changes(start, end)) == changes
    assert bool(contact_events.touches(end)) == (after > 0.0)
    assert bool(contact_events.closed(end)["shoulder"]["V"]) == (after > 0.0)
    expected = after / 4.0 if begins else np.inf
    assert float(contact_events.time_since_onset(start, end)) == expected


def test_the_latest_onset_counts():
    start, end = gaps(-1.0, 1.0), gaps(2.0, 4.0, ContactGap(1.0, 5.0))
    assert float(contact_events.time_since_onset(start, end)) == 0.2
    assert bool(contact_events.begins_at_start(gaps(0.5 * TOUCHING, 1.0)))
    assert not contact_events.begins_at_start(gaps(0.0, 1.0))
    assert not contact_events.begins_at_start(gaps(2.0 * TOUCHING, 1.0))
