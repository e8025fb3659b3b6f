"""Normal contact laws against closed forms, quadrature and published numbers."""

import jax
import numpy as np
import pytest
from scipy.integrate import quad

import clearjoint as cj
from clearjoint.extend import Gap

RADII = {"bearing_radius": 10e-3, "clearance": 0.5e-3}
K = 6.6e10
DAMPED = (cj.laws.LankaraniNikravesh, cj.laws.HuntCrossley, cj.laws.Flores2011)
CHI = {
    cj.laws.LankaraniNikravesh: lambda c: 3 * (1 - c**2) / 4,
    cj.laws.HuntCrossley: lambda c: 3 * (1 - c) / 2,
    cj.laws.Flores2011: lambda c: 8 * (1 - c) / (5 * c),
}
DEPTH = np.array([-1e-3, -1e-9, 0.0, 1e-9, 8e-6, 1e-3])[:, None]
RATE = np.array([-0.5, -0.09, 0.0, 0.09, 0.5])


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.2])
@pytest.mark.parametrize("law", DAMPED)
def test_damped_force_is_the_closed_form(law, exponent):
    c, entry = 0.7, 0.1
    force = law(c, K, exponent).force(Gap(DEPTH, RATE), entry)
    hysteresis = 1 + CHI[law](c) * RATE / entry
    expected = K * np.maximum(DEPTH, 0.0) ** exponent * np.maximum(hysteresis, 0.0)
    np.testing.assert_allclose(force, expected, rtol=1e-13)


def test_hertz_force_depends_on_the_depth_only():
    law = cj.laws.Hertz(K)
    force = law.force(Gap(DEPTH, RATE), None)
    expected = np.broadcast_to(K * np.maximum(DEPTH, 0.0) ** 1.5, force.shape)
    np.testing.assert_allclose(force, expected, rtol=1e-13)
    assert not law.uses_entry_speed and all(law.uses_entry_speed for law in DAMPED)


def test_a_law_without_memory_is_hunt_crossley_at_its_design_speed():
    law, gap = cj.laws.MemorylessHuntCrossley(0.7, K, 0.1), Gap(DEPTH, RATE)
    with_memory = cj.laws.HuntCrossley(0.7, K).force(gap, 0.1)
    np.testing.assert_allclose(law.force(gap, None), with_memory, rtol=1e-14)
    assert not law.uses_entry_speed
    with pytest.raises(ValueError, match=r"`design_speed`.*0\.0"):
        cj.laws.MemorylessHuntCrossley(0.7, K, 0.0)


@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_smooth_force_is_the_closed_form(exponent):
    """Depth and clamp become parabolas of half widths w and w/(w + depth)."""

    def parabola(x, w):
        return np.where(x > w, x, np.where(x > -w, (x + w) ** 2 / (4 * w), 0.0))

    w, c, entry = 1e-5, 0.7, 0.1
    law = cj.laws.LankaraniNikravesh(c, K, exponent, smoothing=w)
    depth = np.array([-2e-5, -1e-5, -4e-6, 0.0, 4e-6, 1e-5, 3e-5, 1e-3])[:, None]
    rate = np.array([-0.5, -0.265, -0.1, 0.0, 0.1])
    factor = parabola(1 + CHI[type(law)](c) * rate / entry, w / (w + np.maximum(depth, 0.0)))
    expected = K * parabola(depth, w) ** exponent * factor
    np.testing.assert_allclose(law.force(Gap(depth, rate), entry), expected, rtol=1e-12, atol=1e-9)
    assert law.onset_offset() == w and cj.laws.Hertz(K).onset_offset() == 0.0


@pytest.mark.parametrize("smoothing", [None, 4e-6])
@pytest.mark.parametrize("exponent", [1.0, 1.5])
@pytest.mark.parametrize("depth", [-1e-6, 2e-6, 4e-6, 3e-5])
def test_stored_energy_is_the_integral_of_the_elastic_force(depth, exponent, smoothing):
    law = cj.laws.LankaraniNikravesh(0.5, K, exponent, smoothing=smoothing)
    work, _ = quad(
        lambda x: float(law.elastic_force(Gap(x, 0.0))),
        -1e-5,
        depth,
        points=[x for x in (-4e-6, 0.0, 4e-6) if x < depth],
        epsabs=0.0,
        epsrel=1e-10,
    )
    np.testing.assert_allclose(law.stored_energy(Gap(depth, 0.0)), work, rtol=1e-9, atol=1e-15)


def test_entry_speed_is_floored():
    law = cj.laws.LankaraniNikravesh(0.5, K, entry_speed_floor=1e-3)
    gap = Gap(1e-6, 2e-3)
    expected = K * 1e-9 * (1 + 0.5625 * 2.0)
    for entry in (0.0, -0.3, 1e-12, 1e-3):
        assert law.force(gap, entry) == pytest.approx(expected, rel=1e-12)
    assert law.force(gap, 2e-3) == pytest.approx(K * 1e-9 * 1.5625, rel=1e-12)
    assert np.isfinite(jax.grad(lambda entry: law.force(gap, entry))(0.0))


def test_ravn_stiffness_of_two_materials():
    """Steel on bronze; the compliances (1 - nu^2)/E add."""
    mixed = cj.laws.RavnStiffness(207e9, 0.3, 110e9, 0.34).value(Gap(0.0, 0.0, **RADII))
    compliance = 0.91 / 207e9 + (1 - 0.34**2) / 110e9
    expected = 4 / (3 * compliance) * (10e-3 * 9.5e-3 / 0.5e-3) ** 0.5
    assert mixed == pytest.approx(expected, rel=1e-13)
    twice = cj.laws.RavnStiffness(207e9, 0.3, 207e9, 0.3).value(Gap(0.0, 0.0, **RADII))
    assert twice == pytest.approx(6.610198e10, rel=1e-7)
