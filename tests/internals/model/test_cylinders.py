"""The inverse of the load of a line contact, and its derivative."""

import jax
import numpy as np

from clearjoint._model.contact.cylinders import inverse_of_load


def test_the_inversion_and_its_derivative():
    parts = np.array([1e-300, 1e-12, 1e-3, 0.5, 0.9, 0.99])
    u = np.asarray(inverse_of_load(parts))
    np.testing.assert_allclose(u * np.exp(1 - u), parts, rtol=1e-12)
    slopes = jax.vmap(jax.grad(inverse_of_load))(parts[2:])
    step = 1e-6 * parts[2:]
    ahead, behind = inverse_of_load(parts[2:] + step), inverse_of_load(parts[2:] - step)
    np.testing.assert_allclose(slopes, (ahead - behind) / (2 * step), rtol=1e-6)
