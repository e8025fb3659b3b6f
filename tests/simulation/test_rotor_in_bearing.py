"""A rotor that floats up in its film, its threshold, and derivatives of its motion."""

import numpy as np
import pytest

import clearjoint as cj
from tests.support.difference_quotients import Places, by_differences, parameters_at

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


def test_lanes_of_a_sweep_are_single_runs():
    viscosities = np.array([0.015, 0.02, 0.03])
    scene, state = cj.mechanisms.rotor_in_bearing(film=FILM, offset=(0.0, -0.7))
    axes = {"mu": cj.Axis(lambda scene: scene.joints["bearing"].film.viscosity, viscosities)}
    force = cj.Peak(cj.quantities.FilmForce("bearing"), "N")
    settings = cj.Settings(ledger=True)
    outputs = {"force": force, "lost": cj.DissipatedEnergy()}
    lanes = cj.sweep(scene, state, 0.02, axes, outputs, settings, progress=False)
    for k, viscosity in enumerate(viscosities):
        alone, _ = cj.mechanisms.rotor_in_bearing(
            film=cj.films.CaponeFilm(viscosity), offset=(0.0, -0.7)
        )
        run = cj.simulate(alone, state, 0.02, settings, progress=False)
        lost = run.final.work["normal damping"] + run.final.work["film"]
        assert float(lanes["lost"][k]) == pytest.approx(float(lost), rel=1e-6)
        assert float(lanes["force"][k]) > 0.5 * WEIGHT


@pytest.mark.parametrize(
    "kind", [cj.films.CaponeFilm, cj.films.ButenschoenFilm, cj.films.PinkusSternlichtFilm]
)
def test_sensitivities_are_those_of_differences(kind):
    end = 0.02
    scene, state = cj.mechanisms.rotor_in_bearing(CLEARANCE, film=kind(0.02), offset=(0.1, -0.7))
    places: Places = {
        "mu": (lambda scene: scene.joints["bearing"].film.viscosity, 0.02 * 1e-4),
        "c": (lambda scene: scene.joints["bearing"].dry.clearance, CLEARANCE * 1e-4),
    }
    outputs = {name: cj.quantities.JournalOffset("bearing", name) for name in "xy"}
    found = cj.sensitivities(
        scene, state, end, parameters_at(places), outputs, [end], progress=False
    )
    fine = cj.Settings(rtol=1e-11, atol=1e-17)

    def place(scene):
        final = cj.simulate(scene, state, end, fine, progress=False).final
        return np.asarray(final.bodies["rotor"].position)[:2]

    expected = by_differences(scene, places, place)
    slopes = np.stack([found.derivatives[axis][0] for axis in "xy"])
    allowed = 1e-5 * (np.abs(expected) + np.abs(expected).max(axis=0))
    np.testing.assert_array_less(np.abs(slopes - expected), allowed)
