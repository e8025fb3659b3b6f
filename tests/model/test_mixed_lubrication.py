"""Asperities beside a film: their pressure and force by quadrature, and Stribeck's curve."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import quad

import clearjoint as cj
from clearjoint.extend import Gap
from studies.catalogue.films import CLEARANCE, RADIUS, ROUGH, mixed

LENGTH, MU, VISCOSITY = 20e-3, 0.1, 0.005
DRY = mixed().dry
LAW = DRY.law
JOINT = cj.LubricatedJoint(DRY, cj.films.CaponeFilm(VISCOSITY), transition=None)
LOAD = 1000.0


def test_the_pressure_is_that_of_normally_distributed_heights():
    sigma = 0.5e-6
    for ratio in (0.0, 0.5, 1.0, 1.5, 2.0):

        def density(s, ratio=ratio):
            return (s - ratio) ** 2.5 * math.exp(-0.5 * s * s) / math.sqrt(2.0 * math.pi)

        integral = quad(density, ratio, ratio + 12.0)[0]
        factor = 16.0 * math.sqrt(2.0) * math.pi / 15.0 * 0.04**2 * math.sqrt(1e-3) * 1.14e11
        assert float(ROUGH.pressure(ratio * sigma)) == pytest.approx(factor * integral, rel=0.11)


def test_the_force_begins_where_the_asperities_reach():
    gap = Gap(-float(ROUGH.reach), 0.0, RADIUS, CLEARANCE)
    assert float(LAW.elastic_force(gap)) == 0.0


def test_a_smoothed_law_begins_before_the_asperities():
    wide = cj.laws.RoughCylinders(ROUGH, LENGTH, cj.laws.Hertz(1e10, smoothing=1e-5))
    assert float(wide.onset_offset()) == 1e-5 > float(ROUGH.reach)


def coefficient(carried):
    """Friction coefficient of the bearing."""
    return abs(float(carried.moment)) / (LOAD * RADIUS)


@pytest.mark.slow
def test_friction_over_speed_is_stribecks_curve():
    speeds = np.geomspace(1e-3, 3e3, 14)
    found = [cj.carried_journal(JOINT, (0.0, -LOAD), speed) for speed in speeds]
    friction = np.array([coefficient(carried) for carried in found])
    # At low speed the asperities carry the load, at high speed the film does.
    assert friction[0] == pytest.approx(MU, rel=5e-2)
    lowest = friction.argmin()
    assert friction[lowest] < 0.01 * MU and 4 < lowest < 11
    assert (np.diff(friction[: lowest + 1]) < 0.0).all()
    assert (np.diff(friction[lowest:]) > 0.0).all()
    eccentricity = float(np.linalg.norm(found[-1].offset)) / CLEARANCE
    shear = VISCOSITY * speeds[-1] * RADIUS / CLEARANCE
    sommerfeld = 2.0 * math.pi * RADIUS * LENGTH * shear / math.sqrt(1.0 - eccentricity**2)
    # The mean of the moments on journal and bearing, which differ by the moment of the load.
    half = 0.5 * abs(float(found[-1].offset[0])) / RADIUS
    assert friction[-1] == pytest.approx(sommerfeld / LOAD + half, rel=1e-6)


@pytest.mark.slow
def test_an_equilibrium_at_a_wall_with_a_profile_is_refused():
    """A run computes the contact with the profile. A film is that of circles in both."""
    oval = cj.profiles.Harmonics([0.0, 1e-6])
    dry = dataclasses.replace(DRY, bearing_profile=oval)
    with pytest.raises(ValueError, match="`joint` must be .*, but is 'with bearing_profile': "):
        cj.carried_journal(cj.LubricatedJoint(dry, JOINT.film), (0.0, -LOAD), 0.5)
    blended = cj.LubricatedJoint(dry, JOINT.film, transition=1e-6)
    circular = cj.LubricatedJoint(DRY, JOINT.film, transition=1e-6)
    found, expected = (cj.carried_journal(one, (0.0, -1.0), 50.0) for one in (blended, circular))
    np.testing.assert_allclose(found.offset, expected.offset, rtol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: cj.laws.RoughCylinders(ROUGH, LENGTH, cj.laws.Hertz(1e10, exponent=1.0)),
            "law.*zero slope",
        ),
        (lambda: cj.laws.RoughCylinders(0.5e-6, LENGTH, cj.laws.Hertz(1e10)), "asperities"),
        (lambda: cj.laws.GreenwoodTripp(roughness=-1e-6, modulus=1e11), "roughness"),
    ],
)
def test_unsuitable_asperities_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
