"""The film in a clearance joint: what it does to two bodies, the wall that takes over, and the
published stiffness, damping and threshold of the short bearing."""

import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint.extend import FilmGap, Gap, Vector, unpack
from clearjoint.testing import check_law, moving
from tests.support.motions import AT_REST

CLEARANCE = 50e-6
FILM = cj.films.CaponeFilm(0.02)
DRY = cj.ClearanceJoint(
    *("frame", "rotor"),
    bearing_point=(0.1, 0.0, 0.0),
    journal_point=(0.0, 0.2, 0.0),
    bearing_radius=25e-3,
    clearance=CLEARANCE,
    journal_length=20e-3,
    law=cj.laws.LankaraniNikravesh(0.7, 1e10),
)
JOINT = cj.LubricatedJoint(DRY, FILM, transition=1e-6)
BETWEEN = cj.LubricatedJoint(DRY, FILM, transition=2.3e-6)


def motions(offset=(0.3, -0.4), tilt=1e-4, rotor_spin=(3.0, -2.0, 80.0), frame_spin=30.0):
    """A frame and a rotor that move at random, the journal with an offset over the clearance."""
    frame = moving((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), (0.2, 0.1, 0.0), (0.0, 0.0, frame_spin))
    x, y = (CLEARANCE * part for part in offset)
    orientation = (1.0, tilt, -0.5 * tilt, 0.0)
    rotor = moving((0.1 + x, y - 0.2, 0.0), orientation, (0.0, 0.0, 0.0), rotor_spin)
    gap = rotor.velocity_at(Vector(0.0, 0.2, 0.0)) - frame.velocity_at(Vector(0.1, 0.0, 0.0))
    return {"frame": frame, "rotor": replace(rotor, velocity=Vector(2e-3, -3e-3, 1e-3) - gap)}


def row(vector):
    return np.array([float(part) for part in vector])


def test_parallel_axes_have_the_whole_film_and_the_sum_of_the_spins():
    """A turning bearing drags as much as a turning journal: seen from axes that don't turn."""
    offset, spins = np.array([0.3, -0.4]), (80.0, 30.0)
    here = motions(offset, tilt=0.0, rotor_spin=(0.0, 0.0, spins[0]), frame_spin=spins[1])
    force = row(unpack(JOINT).film_wrenches(here)["rotor"].force)
    velocity = np.array([2e-3, -3e-3]) / CLEARANCE
    rate = velocity - 0.5 * sum(spins) * np.array([-offset[1], offset[0]])
    x, u, axis = Vector(*offset, 0.0), Vector(*rate, 0.0), Vector(0.0, 0.0, 1.0)
    expected = FILM.force(FilmGap(axis, x, u, 50.0, 25e-3, CLEARANCE, 20e-3))
    np.testing.assert_allclose(force, row(expected), rtol=1e-7, atol=1e-9)


def size_of_film(ratio):
    force = unpack(JOINT).film_wrenches(motions((ratio, 0.0), tilt=0.0))["rotor"].force
    return np.linalg.norm(row(force))


def test_the_wall_takes_over_smoothly():
    assert size_of_film(1.0) > 0.0
    assert size_of_film(1.0 + 0.5e-6 / CLEARANCE) == pytest.approx(0.5 * size_of_film(1.0), rel=0.1)
    assert size_of_film(1.0 + 1.01e-6 / CLEARANCE) == 0.0
    law, deep = BETWEEN.laws()["V"], Gap(3e-6, 0.0)
    assert law.force(deep, 0.1) == DRY.law.force(deep, 0.1)
    slopes = jax.jit(jax.vmap(jax.grad(lambda depth: law.stored_energy(Gap(depth, 0.0)))))
    depths = jnp.asarray([-1e-7, 0.0, 0.3e-6, 2e-6, 4e-6])
    np.testing.assert_allclose(slopes(depths), law.elastic_force(Gap(depths, 0.0)), rtol=1e-12)


@pytest.mark.slow
def test_the_wall_that_takes_over_conforms():
    check_law(BETWEEN.laws()["V"], bearing_radius=25e-3, clearance=CLEARANCE)


def test_derivatives_are_finite_centred_and_at_the_wall():
    joint = unpack(JOINT)

    def force(x, y):
        rotor = replace(AT_REST, position=Vector(0.1 + x, y - 0.2, 0.0))
        return joint.film_wrenches({"frame": AT_REST, "rotor": rotor})["rotor"].force.x

    slopes = jax.jit(jax.vmap(jax.grad(force, argnums=(0, 1))))
    places = jnp.asarray([0.0, 1e-12, CLEARANCE, CLEARANCE + 0.5e-6, CLEARANCE + 1e-6])
    assert np.isfinite(np.stack(slopes(places, 0.0 * places))).all()


def scale(speed, length=20e-3):
    return 0.02 * speed * 25e-3 * length**3 / (4.0 * CLEARANCE**2)


def load_at(ratio, speed):
    """N, closed form of the short bearing."""
    square = ratio * ratio
    root = math.sqrt(math.pi**2 * (1 - square) + 16 * square)
    return scale(speed) * ratio / (1 - square) ** 2 * root


def published(ratio):
    """Stiffness in loads over clearances and damping in loads over clearances and speed: along the
    load and then across, in the sense of the rotation (M. I. Friswell et al. 2010, section 5.5)."""
    e2, pi2 = ratio * ratio, math.pi**2
    h = 1.0 / (pi2 * (1 - e2) + 16 * e2) ** 1.5
    root = math.sqrt(1 - e2)
    along = 4 * (pi2 * (1 + 2 * e2) + 32 * e2 * (1 + e2) / (1 - e2))
    by_across = math.pi * (pi2 * (1 - e2) * (1 + 2 * e2) + 32 * e2 * (1 + e2)) / (ratio * root)
    by_along = -math.pi * (pi2 * (1 - e2) ** 2 - 16 * e2**2) / (ratio * root)
    across = 4 * (pi2 * (2 - e2) + 16 * e2)
    stiffness = np.array([[along, by_across], [by_along, across]])
    along = 2 * math.pi * (pi2 * (1 - e2) ** 2 + 48 * e2) / (ratio * root)
    crossed = 8 * (pi2 * (1 + 2 * e2) - 16 * e2)
    across = 2 * math.pi * root * (pi2 * (1 + 2 * e2) - 16 * e2) / ratio
    return h * stiffness, h * np.array([[along, crossed], [crossed, across]])


def carried(ratio, speed=200.0):
    """Carried along x, so that the load has the published frame."""
    return cj.carried_journal(JOINT, (load_at(ratio, speed), 0.0), speed)


@pytest.mark.parametrize("ratio", [0.1, 0.5, 0.85])
def test_equilibrium_stiffness_and_damping_are_published(ratio):
    speed, load, found = 200.0, load_at(ratio, 200.0), carried(ratio)
    stiffness, damping = published(ratio)
    attitude = math.atan2(math.pi * math.sqrt(1 - ratio**2), 4 * ratio)
    expected = ratio * np.array([math.cos(attitude), math.sin(attitude)])
    np.testing.assert_allclose(found.offset / CLEARANCE, expected, rtol=1e-9)
    np.testing.assert_allclose(found.stiffness * CLEARANCE / load, stiffness, rtol=1e-8)
    np.testing.assert_allclose(found.damping * CLEARANCE * speed / load, damping, rtol=1e-8)


def test_the_moment_of_a_carried_journal_is_that_in_a_run():
    """The film's wrench on a rotor in the same position, about the journal's axis."""
    found, speed = carried(0.5), 200.0
    x, y = map(float, found.offset)
    # The rotor turns about its journal, whose centre is at rest.
    velocity = (0.2 * speed, 0.0, 0.0)
    rotor = moving((0.1 + x, y - 0.2, 0.0), (1.0, 0.0, 0.0, 0.0), velocity, (0.0, 0.0, speed))
    wrench = unpack(JOINT).film_wrenches({"frame": AT_REST, "rotor": rotor})["rotor"]
    about_journal = row(wrench.moment) - np.cross((0.0, 0.2, 0.0), row(wrench.force))
    assert float(found.moment) == pytest.approx(about_journal[2], rel=1e-9)


def critical_mass(ratio, speed):
    """By Routh and Hurwitz from the published coefficients, kg; and the whirl's speed over that of
    the rotor, squared."""
    (a, b), (c, d) = published(ratio)[0]
    (e, f), (g, h) = published(ratio)[1]
    mean = (a * h + d * e - b * g - c * f) / (e + h)
    whirl = ((a - mean) * (d - mean) - b * c) / (e * h - f * g)
    return mean / whirl * load_at(ratio, speed) / (CLEARANCE * speed**2), whirl


@pytest.mark.parametrize("ratio", [0.05, 0.3, 0.6])
def test_threshold_of_stability_is_that_of_the_published_coefficients(ratio):
    mass, whirl = critical_mass(ratio, 200.0)
    film = carried(ratio)
    below, above = (film.growth(part * mass).real.max() for part in (1 - 1e-6, 1 + 1e-6))
    assert below < 0.0 < above
    fastest = film.growth(mass)[np.argmax(film.growth(mass).real)]
    assert abs(fastest.imag) / 200.0 == pytest.approx(math.sqrt(whirl), rel=1e-6)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: cj.LubricatedJoint(DRY, 0.02, 1e-6), "`film` must be an AbstractFilm"),
        (lambda: cj.LubricatedJoint(JOINT, FILM, 1e-6), "`dry` must be a ClearanceJoint"),
        (lambda: cj.LubricatedJoint(DRY, FILM, 1e-6, largest_ratio=1.0), "`largest_ratio` must be"),
        (lambda: cj.carried_journal(JOINT, (1.0, 2.0, 3.0), 200.0), "`load` must be"),
        (lambda: cj.carried_journal(JOINT, (1.0, 2.0), -200.0), "`speed` must be positive"),
    ],
)
def test_wrong_arguments_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_a_bearing_beyond_the_films_range_is_warned_of():
    wide = replace(DRY, bearing_radius=0.01, journal_length=0.03)
    with pytest.warns(cj.LawRangeWarning, match="`ButenschoenFilm` holds for a width over diam"):
        cj.LubricatedJoint(wide, cj.films.ButenschoenFilm(0.02), 1e-6)


def test_a_scene_provides_its_journal_and_film():
    scene, state = cj.mechanisms.rotor_in_bearing(film=FILM, offset=(0.4, 0.0))
    assert isinstance(scene.joints["bearing"], cj.LubricatedJoint)
    cj.quantities.FilmForce("bearing").check(scene)
    cj.quantities.Eccentricity("bearing").check(scene)
    with pytest.raises(ValueError, match="`joint` must be one of the scene's"):
        cj.quantities.FilmForce("bearing").check(cj.mechanisms.rotor_in_bearing()[0])
    assert state.bodies["rotor"].position[0] == pytest.approx(0.4 * CLEARANCE)
