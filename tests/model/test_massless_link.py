"""Clearance as a massless link: rows, a pendulum of its length, and errors."""

import numpy as np
import pytest

import clearjoint as cj

LENGTH, GRAVITY, START = 0.02, 9.81, 2.0


def period(angle: float) -> float:
    """Of a pendulum that swings up to an angle, by the arithmetic-geometric mean, s."""
    a, b = 1.0, np.cos(0.5 * angle)
    for _ in range(10):
        a, b = 0.5 * (a + b), np.sqrt(a * b)
    return 2 * np.pi * np.sqrt(LENGTH / GRAVITY) / a


def test_a_journal_swings_like_a_pendulum_of_the_clearance():
    """A body whose centre is the journal's: no moment turns it, and the link is the pendulum."""
    link = cj.MasslessLink(cj.GROUND, "body", LENGTH, 0.1, axial=cj.FixedAxially())
    body = cj.Body(1.5, (0.1, 0.1, 0.1))
    scene = cj.Scene({"body": body}, {"link": link}, gravity=(GRAVITY, 0, 0))
    place = (LENGTH * np.cos(START), LENGTH * np.sin(START), 0.0)
    state = cj.State({"body": cj.body_state(place)})
    time = period(START)
    save = cj.Saving([0.5 * time, 2 * time])
    solution = cj.simulate(scene, state, 2 * time, cj.Settings(rtol=1e-10), save=save)
    half, whole = solution.states.bodies["body"].position
    np.testing.assert_allclose(half, np.array(place) * (1, -1, 1), rtol=0, atol=1e-8)
    np.testing.assert_allclose(whole, place, rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"axial": cj.EndPlay(1e-3, cj.laws.Hertz(1e9))}, r"`axial`.*EndPlay"),
        ({"clearance": 0.0}, r"`clearance`.*0\.0"),
        *(
            ({"axial": axial}, "`axial` must be an AbstractAxialPolicy")
            for axial in (cj.FreeAxially, None, "free")
        ),
    ],
)
def test_unsuitable_links_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        cj.MasslessLink("a", "b", **({"clearance": 1e-3, "journal_length": 0.1} | options))
