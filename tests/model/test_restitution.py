"""Delivered restitution: limits, derivatives, integration. Tables are in test_law_catalogue.py."""

import jax
import jax.numpy as jnp
import numpy as np

from clearjoint.laws import Hertz
from clearjoint.laws import delivered_restitution as delivered


def test_elastic_contact_delivers_one():
    assert Hertz(1e9).delivered_restitution() == 1.0 == delivered(0.0)


def test_small_factors():
    """The relation's expansion is e = 1 - 2 chi/3 + 4 chi^2/9 - ...; no seam shows at 1e-5."""
    chi = np.array([1e-12, 1e-7, 0.9999e-5, 1.0001e-5, 1e-4, 1e-3])
    e = np.asarray(delivered(chi))
    np.testing.assert_allclose(e, 1 - 2 * chi / 3 + 4 * chi**2 / 9, rtol=0.0, atol=5e-10)
    second = (e[4:] - (1 - 2 * chi[4:] / 3)) / chi[4:] ** 2
    np.testing.assert_allclose(second, 4 / 9, rtol=2e-3)


def test_large_factors():
    """e tends to 1/chi from below: 1 - chi e is exponentially small."""
    chi = np.array([30.0, 50.0, 158.4, 1e4, 1e8])
    np.testing.assert_allclose(delivered(chi) * chi, 1.0, rtol=1e-11)
    assert (np.asarray(delivered(chi)) * chi <= 1.0).all()


def test_relation_holds_between_the_limits():
    chi = np.logspace(-3, 1, 50)
    e = np.asarray(delivered(chi))
    residual = chi * (1 + e) - np.log((1 + chi) / (1 - chi * e))
    np.testing.assert_allclose(residual, 0.0, atol=1e-11)
    assert (np.diff(e) < 0).all()


def slopes(chi):
    return jax.jvp(delivered, (jnp.asarray(chi),), (jnp.ones(len(chi)),))[1]


def test_derivative_is_finite_and_negative_everywhere():
    found = np.asarray(slopes(np.logspace(-9, 8, 5001)))
    assert np.isfinite(found).all() and (found < 0).all()
    chi, step = np.logspace(-2, 2, 50), 1e-5
    numeric = (delivered(chi * (1 + step)) - delivered(chi * (1 - step))) / (2 * step * chi)
    np.testing.assert_allclose(slopes(chi), numeric, rtol=1e-6)
