"""Hertz's closed forms, by free impacts."""

import numpy as np
import pytest

import clearjoint as cj
from clearjoint import free_impact

MASS, SPEED, STIFFNESS = 2.0, 0.1, 6.6e10


def test_a_smoothed_elastic_contact_stores_the_energy_of_the_impact_and_returns_it():
    """Its force begins before the surfaces touch."""
    law = cj.laws.Hertz(STIFFNESS, smoothing=4e-6)
    found = free_impact(law, MASS, SPEED)
    assert found.restitution == pytest.approx(1.0, abs=1e-8)
    stored = float(law.stored_energy(cj.extend.Gap(found.largest_penetration, 0.0)))
    assert stored == pytest.approx(0.5 * MASS * SPEED**2, rel=1e-6)


def test_a_strongly_damped_contact_is_loaded_most_when_it_begins():
    """By D v0, if the damping ratio is above 0.5."""
    damping = 1.6 * np.sqrt(STIFFNESS * MASS)
    found = free_impact(cj.laws.SpringDashpot(STIFFNESS, damping), MASS, SPEED)
    assert found.peak_force == pytest.approx(damping * SPEED, rel=1e-9)
    assert found.restitution == pytest.approx(float(cj.laws.clamped_restitution(0.8)), rel=1e-7)


@pytest.mark.parametrize(
    ("radii", "message"),
    [
        ((), "`bearing_radius` .*is None"),
        ((0.01,), "`clearance` .*is None"),
        ((-0.01, 1e-4), "`bearing_radius` must be positive"),
        ((0.01, 0.0), "`clearance` must be positive"),
        ((0.01, 0.02), "`clearance` must be smaller than"),
    ],
)
def test_radii_that_a_stiffness_needs_are_checked(radii, message):
    law = cj.laws.Hertz(cj.laws.RavnStiffness(207e9, 0.3))
    with pytest.raises(ValueError, match=message):
        free_impact(law, MASS, SPEED, *radii)


@pytest.mark.parametrize("law", [None, cj.laws.Hertz])
def test_what_is_no_contact_law_is_named(law):
    with pytest.raises(ValueError, match="`law` must be a contact law.*cj.laws.Hertz"):
        free_impact(law, MASS, SPEED)
