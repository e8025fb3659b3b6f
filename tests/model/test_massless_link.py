"""Clearance as a massless link: rows, a pendulum of its length, and errors."""

import numpy as np
import pytest

import clearjoint as cj
from clearjoint.testing import check_constraint, moving

LENGTH, GRAVITY, START = 0.02, 9.81, 2.0


def test_rows_conform():
    link = cj.MasslessLink(
        "a",
        "b",
        clearance=0.3,
        journal_length=0.5,
        bearing_point=(0.1, -0.2, 0.3),
        bearing_axis=(0.2, 0.1, 1.0),
        journal_point=(-0.3, 0.1, 0.2),
        journal_axis=(0.0, 0.3, 1.0),
        axial=cj.FixedAxially(),
    )
    motions = {
        "a": moving((0.1, 0.2, 0.3), (1.0, 0.1, -0.2, 0.3), (0.3, -0.1, 0.2), (0.5, 0.2, -0.4)),
        "b": moving((0.5, -0.2, 0.4), (1.0, 0.3, 0.1, -0.1), (-0.2, 0.4, 0.1), (-0.3, 0.6, 0.2)),
    }
    check_constraint(link, motions)


def period(angle: float) -> float:
    """Of a pendulum that swings up to an angle, by the arithmetic-geometric mean, s."""
    a, b = 1.0, np.cos(0.5 * angle)
    for _ in range(10):
        a, b = 0.5 * (a + b), np.sqrt(a * b)
    return 2 * np.pi * np.sqrt(LENGTH / GRAVITY) / a


def test_a_journal_swings_like_a_pendulum_of_the_clearance():
    """A body whose centre is the journal's: no moment turns it, and the link is the pendulum."""
    link = cj.MasslessLink(
        cj.GROUND, "body", clearance=LENGTH, journal_length=0.1, axial=cj.FixedAxially()
    )
    scene = cj.Scene(
        {"body": cj.Body(1.5, (0.1, 0.1, 0.1))}, {"link": link}, gravity=(GRAVITY, 0, 0)
    )
    place = (LENGTH * np.cos(START), LENGTH * np.sin(START), 0.0)
    state = cj.State({"body": cj.body_state(place)})
    time = period(START)
    solution = cj.simulate(
        scene, state, 2 * time, cj.Settings(rtol=1e-10), save=cj.Saving([0.5 * time, 2 * time])
    )
    half, whole = solution.states.bodies["body"].position
    np.testing.assert_allclose(half, np.array(place) * (1, -1, 1), rtol=0, atol=1e-8)
    np.testing.assert_allclose(whole, place, rtol=0, atol=1e-8)


def test_shoulders_are_refused():
    law = cj.laws.Hertz(1e9)
    with pytest.raises(ValueError, match=r"`axial`.*EndPlay"):
        cj.MasslessLink("a", "b", clearance=1e-3, journal_length=0.1, axial=cj.EndPlay(1e-3, law))
    with pytest.raises(ValueError, match=r"`clearance`.*0\.0"):
        cj.MasslessLink("a", "b", clearance=0.0, journal_length=0.1)
    for axial in (cj.FreeAxially, None, "free"):
        with pytest.raises(ValueError, match="`axial` must be an AbstractAxialPolicy"):
            cj.MasslessLink("a", "b", clearance=1e-3, journal_length=0.1, axial=axial)
