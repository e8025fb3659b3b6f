"""The catalogue of laws: delivered restitution by closed forms and quadrature, and by Exudyn."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from studies.catalogue.laws import REQUESTED as FIVE

K, MASS, SPEED = 6.6e10, 2.0, 0.1
UNUSABLE = cj.laws.PantWijeyewickrema
CYLINDER = cj.laws.JohnsonCylinder(207e9, 0.3, length=20e-3)
REQUESTED = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0)
EXACT = (9.99816, 4.91917, 3.08708, 2.08250, 1.43275, 0.97487, 0.63483, 0.37315, 0.16648, 0.07893)
REFUSE_ZERO = (
    cj.laws.Flores2011,
    cj.laws.Gonthier,
    cj.laws.GharibHurmuzlu,
    cj.laws.HuGuo,
    cj.laws.ExactRestitution,
)


@pytest.mark.parametrize("law", REFUSE_ZERO)
def test_infinite_damping_is_refused(law):
    with pytest.raises(ValueError, match=r"`restitution` must be positive"):
        law(0.0, K)


def test_an_unusable_law_warns():
    with pytest.warns(cj.LawRangeWarning, match="PantWijeyewickrema.*restitution of 0.5"):
        law = UNUSABLE(0.5, 1e8)
    assert float(law.damping_factor()) == pytest.approx(1.5 * (1 - 0.5**2) / 0.5**2, rel=1e-14)


FACTORS = jax.jit(jax.vmap(cj.laws.exact_damping_factor))
SLOPES = jax.jit(jax.vmap(jax.grad(cj.laws.exact_damping_factor)))


def test_the_exact_factor():
    np.testing.assert_allclose(FACTORS(np.array(REQUESTED[1:-1])), EXACT, atol=6e-6)
    asked = np.concatenate([np.logspace(-6, -1, 40), np.linspace(0.1, 1.0, 91)])
    delivered = cj.laws.delivered_restitution(FACTORS(asked))
    np.testing.assert_allclose(delivered, asked, rtol=0.0, atol=1e-13)


@pytest.mark.slow
def test_the_exact_factor_in_its_limits():
    """chi = 3 (1 - e)/2 + ... at e = 1 and 1/e at e = 0, with derivatives -3/2 and -1/e^2."""
    near = np.array([1.0, 1.0 - 1e-15, 1.0 - 1e-9, 1.0 - 1e-6])
    np.testing.assert_allclose(FACTORS(near), 1.5 * (1 - near), rtol=2e-6)
    np.testing.assert_allclose(SLOPES(near), -1.5, rtol=1e-5)
    small = np.array([1e-6, 1e-3, 0.01])
    np.testing.assert_allclose(FACTORS(small) * small, 1.0, rtol=1e-12)
    np.testing.assert_allclose(SLOPES(small) * small**2, -1.0, rtol=1e-12)


def test_the_exact_factor_s_derivative():
    asked, step = np.linspace(0.05, 0.99, 48), 1e-6
    numeric = (FACTORS(asked + step) - FACTORS(asked - step)) / (2 * step)
    np.testing.assert_allclose(SLOPES(asked), numeric, rtol=1e-7)


CLAMPED = (0.253, 0.397, 0.550, 0.718, 0.902)
JANKOWSKI = (0.093, 0.292, 0.495, 0.698, 0.900)


@pytest.mark.parametrize("law", [cj.laws.KelvinVoigt, cj.laws.Tsuji])
def test_clamped_dashpots_deliver_the_closed_form(law):
    found = [float(law(c, K, MASS).delivered_restitution()) for c in FIVE]
    assert found == pytest.approx(CLAMPED, abs=6e-4)


IMPACTS = [
    (cj.laws.Tsuji(0.5, 1e9, MASS), 0.550, 6e-4),
    *((cj.laws.Jankowski(c, 1e9, MASS), e, 6e-4) for c, e in zip(FIVE, JANKOWSKI, strict=True)),
    (cj.laws.FloresKelvinVoigt(0.5, 1e9, 1e-4), 0.5**0.5, 1e-5),
    # The relation of the damped laws holds for every elastic force.
    (cj.laws.ExactRestitution(0.7, CYLINDER), 0.7, 1e-6),
    *(
        (
            cj.laws.SpringDashpot(1e6, 2.0 * ratio * np.sqrt(1e6 * MASS)),
            float(cj.laws.clamped_restitution(ratio)),
            1e-7,
        )
        for ratio in (0.05, 0.5, 0.95)
    ),
]
"""Laws with their delivered restitution, and its error."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "expected", "within"), IMPACTS, ids=[type(law).__name__ for law, *_ in IMPACTS]
)
def test_integrated_impacts(law, expected, within):
    found = cj.free_impact(law, MASS, SPEED, 10e-3, 0.5e-3).restitution
    assert found == pytest.approx(expected, abs=within)


@pytest.mark.slow
def test_viscous_spheres_lose_more_at_speed():
    law = cj.laws.KuwabaraKono(K, 1e6)
    slow, fast = (cj.free_impact(law, MASS, speed).restitution for speed in (0.01, 1.0))
    assert 1.0 > slow > fast > 0.0


def test_kelvin_voigt_is_the_closed_form():
    """D = 2 z sqrt(K m); the force jumps to D times the entry speed, and never pulls."""
    ratio = -np.log(0.6) / np.hypot(np.pi, np.log(0.6))
    damping = 2 * ratio * np.sqrt(1e8 * 2.0)
    depths, rates = [-1e-9, 0.0, 1e-300, 1e-6, 1e-6], [0.1, 0.1, 0.1, 0.1, -1.0]
    gap = cj.extend.Gap(jnp.array(depths), jnp.array(rates))
    expected = [0.0, 0.0, damping * 0.1, 100.0 + damping * 0.1, 0.0]
    found = cj.laws.KelvinVoigt(0.6, 1e8, 2.0).force(gap, None)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_dashpots_tuned_to_a_stiffness_need_one():
    with pytest.raises(ValueError, match=r"`stiffness` must be a number.*JohnsonCylinder"):
        cj.laws.Tsuji(0.6, CYLINDER, 2.0)
    with pytest.raises(ValueError, match=r"`smoothing` must be None with JohnsonCylinder"):
        cj.laws.LankaraniNikravesh(0.6, CYLINDER, smoothing=1e-7)


@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_flores_variant_is_weaker_in_the_rebound(exponent):
    """By the factor c; at rest the mean of both acts, whose integral is the stored energy."""
    c, depth, slow = 0.36, 2e-5, 1e-3
    law = cj.laws.FloresKelvinVoigt(c, 1e9, exponent=exponent)
    full = 1e9 * depth**exponent
    gap = cj.extend.Gap(depth, np.array([0.1, slow, 0.0, -slow, -0.1]))
    blend = 0.5 * (1.0 + np.array([1.0, np.tanh(1.0), 0.0, -np.tanh(1.0), -1.0]))
    expected = full * (blend + c * (1.0 - blend))
    np.testing.assert_allclose(law.force(gap, None), expected, rtol=1e-12)
    assert float(law.elastic_force(gap)) == pytest.approx(expected[2], rel=1e-14)
    energy = expected[2] * depth / (exponent + 1.0)
    assert float(law.stored_energy(gap)) == pytest.approx(energy, rel=1e-14)
