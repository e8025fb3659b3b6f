"""Line contact: published numbers, closed forms, limits and the warnings beyond them."""

import jax
import numpy as np
import pytest

import clearjoint as cj
from studies.catalogue.cylinders import (
    CLEARANCE,
    FORMULAS,
    LENGTH,
    MODULUS,
    POISSON,
    RADIUS,
    YOUNG,
)
from tests.support.laws import CYLINDERS
from tests.support.slow import slow_but

LIMITS = {
    cj.laws.JohnsonCylinder: 4 * CLEARANCE / np.e**2,
    cj.laws.EsduCylinder: 4 * CLEARANCE,
    cj.laws.RadzimovskyCylinder: 4.4784 * CLEARANCE / np.pi,
}


def cylinder(law):
    return law(YOUNG, POISSON, length=LENGTH)


def gap(depth):
    return cj.extend.Gap(depth, 0.0, RADIUS, CLEARANCE)


@pytest.mark.parametrize("law", FORMULAS)
def test_the_penetration_of_the_force_is_the_one_given(law):
    contact = cylinder(law)
    depths = np.array([1e-12, 1e-9, 1e-6, 8e-6, 1e-4, 0.98 * float(contact.deepest(gap(0.0)))])

    def load(depth):
        return contact.force(gap(depth), 1.5) / LENGTH

    _, formula = FORMULAS[law]
    np.testing.assert_allclose(formula(load(depths)), depths, rtol=1e-12)
    step = 1e-6 * depths
    numeric = (load(depths + step) - load(depths - step)) / (2 * step)
    np.testing.assert_allclose(jax.vmap(jax.grad(load))(depths), numeric, rtol=1e-6)


@pytest.mark.parametrize("law", LIMITS)
def test_the_deepest_penetration(law):
    assert float(cylinder(law).deepest(gap(0.0))) == pytest.approx(LIMITS[law], rel=1e-4)


def test_johnson_ends_at_half_a_clearance_under_the_load_of_the_fold():
    contact, end = cylinder(cj.laws.JohnsonCylinder), 0.541 * CLEARANCE
    assert float(contact.deepest(gap(0.0))) == pytest.approx(end, rel=1e-3)
    load = contact.reference_load(gap(0.0)) / np.e**2
    assert load == pytest.approx(9.67e7, rel=1e-3)


FAST = cj.laws.JohnsonCylinder, cj.laws.PerssonCylinder


@pytest.mark.parametrize("law", slow_but(FAST, CYLINDERS.values()))
def test_energy_is_the_force_s_integral_beyond_the_deepest_too(law):
    contact = cylinder(law)
    energy = jax.vmap(jax.grad(lambda depth: contact.energy(gap(depth), 1.5)))
    depths = np.array([-1e-6, 0.0, 1e-12, 1e-6, 1e-4, 3e-4, 3e-3, 2e-2])
    forces = np.asarray(contact.force(gap(depths), 1.5))
    np.testing.assert_allclose(energy(depths), forces, rtol=1e-10)
    assert np.isfinite(forces).all() and (np.diff(forces) >= 0).all()


def test_persson_s_half_angles():
    """Hertz's at small loads; two others are in the catalogue."""
    contact = cylinder(cj.laws.PerssonCylinder)
    small = 1e-4
    hertz = np.pi * MODULUS * LENGTH * CLEARANCE * small**2 / 4
    assert float(contact.load(small, CLEARANCE)) == pytest.approx(hertz, rel=1e-6)
    depth = CLEARANCE * (1 / np.cos(0.3) - 1)
    assert float(contact.half_angle(gap(depth))) == pytest.approx(0.3, rel=1e-12)
    by_depth = float(contact.force(gap(depth), 1.5))
    assert by_depth == pytest.approx(float(contact.load(0.3, CLEARANCE)), rel=1e-12)


def test_pereira_in_millimetres():
    """The printed formula, in N, mm and MPa, at clearances on both sides of 0.34954 mm."""
    for clearance in (0.01, 0.3, 1.0):
        y = 0.0151 * clearance + 1.151
        if clearance < 0.34954:
            y = 1.51 * np.log(1000 * clearance) ** -0.151
        factor = (0.965 * clearance + 0.0965) * 20.0 * MODULUS * 1e-6 / clearance
        expected = factor * 0.005 ** (y * clearance**-0.005)
        here = cj.extend.Gap(5e-6, 0.0, RADIUS, 1e-3 * clearance)
        found = cylinder(cj.laws.PereiraCylinder).force(here, 1.5)
        assert float(found) == pytest.approx(expected, rel=1e-12)


def joint(law, clearance):
    return cj.ClearanceJoint(
        "ground",
        "rod",
        bearing_radius=RADIUS,
        clearance=clearance,
        journal_length=LENGTH,
        law=cj.laws.LankaraniNikravesh(0.9, cylinder(law)),
    )


def test_a_clearance_beyond_the_range_is_warned_of_at_construction():
    with pytest.warns(cj.LawRangeWarning) as caught:
        joint(cj.laws.PereiraCylinder, 4e-6)
    message = str(caught[0].message)
    for word in ("PereiraCylinder", "clearance", "5e-06 m", "4e-06 m"):
        assert word in message
    assert caught[0].filename == __file__


def impacts(deepest):
    row = ("shoulder", "V", 0.0, 1e-4, 1e-4, 0.1, 0.09, 1e3, 5e-5)
    return cj.results.Impacts.of_rows([(*row, 1e-6), (*row, deepest)])


def test_penetrations_beyond_the_range_are_reported():
    scene = cj.Scene(
        {"rod": cj.Body(1.0, (1e-3, 1 / 12, 1 / 12))},
        {"shoulder": joint(cj.laws.JohnsonCylinder, CLEARANCE)},
    )
    (sentence,) = cj.beyond_law_ranges(scene, impacts(0.3e-3))
    for word in ("'shoulder'", "'V'", "JohnsonCylinder", "penetration", "0.0002707 m", "0.0003 m"):
        assert word in sentence
    assert cj.beyond_law_ranges(scene, impacts(0.2e-3)) == []
