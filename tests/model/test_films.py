"""Film laws against Reynolds' equation, published tables and closed forms."""

import math
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint.extend import FilmGap, Vector
from clearjoint.testing import check_film
from tests.support.reynolds import finite_bearing_force, short_bearing_force

RADIUS, CLEARANCE, LENGTH, VISCOSITY = 25e-3, 50e-6, 20e-3, 0.03
SHORT = VISCOSITY * RADIUS * LENGTH**3 / CLEARANCE**2
LONG = VISCOSITY * LENGTH * RADIUS**3 / CLEARANCE**2
Z = Vector(0.0, 0.0, 1.0)


def gap(offset, rate, length=LENGTH, spin=0.0):
    x, u = Vector(*offset, 0.0), Vector(*rate, 0.0)
    return FilmGap(Z, x, u, spin, RADIUS, CLEARANCE, length)


def forces(film, offsets, rates, length=LENGTH):
    """(N, 2) N of offsets and rates (N, 2)."""

    def of(offset, rate):
        force = film.force(gap(offset, rate, length))
        return jnp.stack([force.x, force.y])

    return np.asarray(jax.vmap(of)(jnp.asarray(offsets), jnp.asarray(rates)))


def steady(ratio, speed=2.0):
    """An offset along x, and its rate under spins of a sum."""
    return np.array([ratio, 0.0]), np.array([0.0, -0.5 * speed * ratio])


def test_short_bearing_is_reynolds_equation():
    draws = np.random.default_rng(3)
    angles = draws.uniform(0.0, 2 * np.pi, 60)
    offsets = draws.uniform(0.0, 0.95, 60) * np.stack([np.cos(angles), np.sin(angles)])
    rates = draws.normal(size=(60, 2)) * 10.0 ** draws.uniform(-3, 3, (60, 1))
    expected = [short_bearing_force(*pair) for pair in zip(offsets.T, rates, strict=True)]
    errors = forces(cj.films.CaponeFilm(VISCOSITY), offsets.T, rates) / SHORT - expected
    sizes = np.linalg.norm(expected, axis=1)
    assert (np.linalg.norm(errors, axis=1) < 1e-10 * sizes).all()


@pytest.mark.parametrize("width", [0.5, 1.0])
def test_finite_width_against_reynolds_equation(width):
    """The load and its angle in rotation, and squeeze to either side."""
    film, length = cj.films.ButenschoenFilm(VISCOSITY), 2.0 * RADIUS * width
    unit = 2.0 * RADIUS * length * VISCOSITY * (RADIUS / CLEARANCE) ** 2
    offsets = np.array([[0.5, 0.0]] * 3 + [[0.8, 0.0]] * 3)
    rates = np.array([[0.0, -0.25], [1.0, 0.0], [-1.0, 0.0], [0.0, -0.4], [1.0, 0.0], [-1.0, 0.0]])
    ours = forces(film, offsets, rates, length) / unit
    solved = [finite_bearing_force(width, *pair) for pair in zip(offsets, rates, strict=True)]
    sizes, expected = np.linalg.norm(ours, axis=1), np.linalg.norm(solved, axis=1)
    np.testing.assert_allclose(sizes, expected, rtol=0.04)
    angles = np.arctan2(*ours.T) - np.arctan2(*np.transpose(solved))
    np.testing.assert_allclose(angles, 0.0, atol=np.radians(3.0))


def test_solved_equation_is_the_table():
    for width, ratio, expected in ((1.0, 0.5, 0.8903), (0.5, 0.5, 0.3124)):
        load = np.linalg.norm(finite_bearing_force(width, *steady(ratio)))
        assert load / 2.0 == pytest.approx(expected, rel=0.01)


def printed(ratio, opening, turning):
    """Radial and tangential force as printed, but with the right sign for an opening film."""
    k = math.sqrt((1 - ratio**2) * ((turning / (2 * opening)) ** 2 + 1 / ratio**2))
    sign, part = (1, (k + 3) / (k + 1.5)) if opening > 0 else (-1, k / (k + 1.5))
    common = part / ((2 + ratio**2) * (1 - ratio**2) ** 0.5)
    bracket = 4 * k * ratio**2 + sign * (2 + ratio**2) * math.pi
    radial = -sign * 6 * opening * bracket / (1 - ratio**2) * common
    return radial, 6 * math.pi * ratio * turning * common


@pytest.mark.parametrize("ratio", [0.05, 0.4, 0.9])
@pytest.mark.parametrize("opening", [3.0, -3.0, 1e-3])
@pytest.mark.parametrize("turning", [-40.0, 0.2, 15.0])
def test_endless_bearing_as_printed(ratio, opening, turning):
    rate = opening, -0.5 * ratio * turning
    force = forces(cj.films.PinkusSternlichtFilm(VISCOSITY), [[ratio, 0.0]], [rate])[0] / LONG
    np.testing.assert_allclose(force, printed(ratio, opening, turning), rtol=1e-12)


def test_drag_is_petroffs_and_grows_with_the_eccentricity():
    film = cj.films.CaponeFilm(VISCOSITY)
    petroff = 2 * math.pi * VISCOSITY * RADIUS**3 * LENGTH / CLEARANCE * 50.0
    assert film.drag(gap((0.0, 0.0), (0.0, 0.0), spin=50.0)) == pytest.approx(-petroff)
    assert film.drag(gap((0.0, 0.6), (0.0, 0.0), spin=-50.0)) == pytest.approx(petroff / 0.8)


@pytest.mark.slow
@pytest.mark.parametrize("film", [cj.films.CaponeFilm, cj.films.PinkusSternlichtFilm])
def test_films_conform(film):
    check_film(film(VISCOSITY))


@pytest.mark.slow
def test_finite_width_conforms_but_for_its_power():
    """Rotation and squeeze solved apart: next to the wall, an opening film may supply power, which
    is checked last."""
    with pytest.raises(AssertionError, match="The film supplies power: force . rate > 0"):
        check_film(cj.films.ButenschoenFilm(0.02), RADIUS, CLEARANCE, LENGTH)


class Faulty(cj.extend.AbstractFilm):
    """A film with a force of its own, as a factor of the rate and of the spin."""

    viscosity: float
    per_rate: Callable = eqx.field(static=True)
    per_spin: float = -1.0

    def force(self, gap):
        return gap.rate * (self.viscosity * self.per_rate(gap))

    def drag(self, gap):
        return gap.spin * self.per_spin


def cosine(gap):
    """Of the angle between the offset and its rate; zero where one of them has no direction."""
    sizes = jnp.sqrt(gap.rate.dot(gap.rate) * gap.offset.dot(gap.offset))
    return gap.rate.dot(gap.offset) / jnp.where(sizes > 0.0, sizes, 1.0)


FAULTS = {
    "force is not finite": lambda gap: 1.0 / jnp.sqrt(gap.rate.dot(gap.rate)),
    "supplies power": lambda gap: 1.0,
    "does not rotate": lambda gap: -jnp.cosh(gap.offset.x),
    "derivative by offset or rate is not finite": lambda gap: -jnp.sqrt(gap.rate.dot(gap.rate)),
    "force jumps by": lambda gap: -jnp.where(cosine(gap) > 0.3, 1.0, 2.0),
}


@pytest.mark.parametrize("message", FAULTS)
def test_a_fault_of_a_film_is_named(message):
    with pytest.raises(AssertionError, match=message):
        check_film(Faulty(1.0, FAULTS[message]))


def test_a_drag_that_drives_the_spin_is_named():
    with pytest.raises(AssertionError, match="drives the spin"):
        check_film(Faulty(1.0, lambda gap: -1.0, 1.0))


def test_negative_viscosity_is_refused():
    with pytest.raises(ValueError, match=r"`viscosity` must be positive, but is -0\.1"):
        cj.films.CaponeFilm(-0.1)
