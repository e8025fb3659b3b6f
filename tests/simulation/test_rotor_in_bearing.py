"""A rotor that floats up in its film, and its threshold."""

import numpy as np
import pytest

import clearjoint as cj

pytestmark = pytest.mark.slow
CLEARANCE, MASS, WEIGHT = 50e-6, 20.0, 20.0 * 9.81
FILM = cj.films.CaponeFilm(0.02)


def carried(speed):
    """The journal at rest, and where it is over the clearance."""
    scene, _ = cj.mechanisms.rotor_in_bearing(film=FILM)
    found = cj.carried_journal(scene.joints["bearing"], (0.0, -WEIGHT), speed)
    return found, np.asarray(found.offset) / CLEARANCE


def offsets(solution):
    """(N, 2) over the clearance, at the saved times."""
    return np.asarray(solution.saved.states.bodies["rotor"].position)[:, :2] / CLEARANCE


@pytest.fixture(scope="module")
def floating():
    """From rest on the wall, with the energy ledger."""
    scene, state = cj.mechanisms.rotor_in_bearing(film=FILM)
    save = cj.Saving(np.linspace(0.0, 0.3, 61))
    settings = cj.Settings(rtol=1e-8, ledger=True)
    return scene, cj.simulate(scene, state, 0.3, settings, save, progress=False)


def test_a_rotor_floats_up_to_where_the_film_carries_it(floating):
    _, solution = floating
    found, place = carried(200.0)
    assert np.hypot(*offsets(solution)[0]) == pytest.approx(1.0)
    np.testing.assert_allclose(offsets(solution)[-1], place, atol=1e-6)
    slowest = found.growth(MASS).real.max()
    late = np.linalg.norm(offsets(solution)[[-21, -1]] - place, axis=1)
    assert late[1] < late[0] * np.exp(0.8 * slowest * 0.1)


def test_the_film_books_what_it_takes(floating):
    scene, solution = floating
    seen = cj.observe(scene, solution)
    taken = seen.energies["film"]
    assert (np.diff(taken) > 0.0).all()
    assert abs(seen.ledger_residual()[-1]) < 1e-8 * taken[-1]


@pytest.mark.parametrize(("speed", "is_stable"), [(1150.0, True), (1300.0, False)])
def test_a_rotor_spirals_in_below_its_threshold_and_out_above(speed, is_stable):
    """At the rate of the eigenvalue, in whirls at half the speed."""
    found, place = carried(speed)
    modes = np.asarray(found.growth(MASS))
    growth = modes[np.argmax(modes.real)]
    assert (growth.real < 0.0) == is_stable
    start = place + (1e-3, 0.0)
    scene, state = cj.mechanisms.rotor_in_bearing(film=FILM, speed=speed, offset=tuple(start))
    end = 0.1
    times = np.linspace(0.25 * end, end, 800)
    solution = cj.simulate(
        scene, state, end, cj.Settings(rtol=1e-8), cj.Saving(times), progress=False
    )
    away = offsets(solution) - place
    rate = 0.5 * np.polyfit(times, np.log((away**2).sum(axis=1)), 1)[0]
    assert rate == pytest.approx(growth.real, rel=0.03, abs=0.2)
    whirl = np.polyfit(times, np.unwrap(np.arctan2(away[:, 1], away[:, 0])), 1)[0]
    assert whirl == pytest.approx(abs(growth.imag), rel=0.01)
