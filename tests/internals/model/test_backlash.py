"""The motions at which a joint with couples is checked."""

import jax
import jax.numpy as jnp
import numpy as np

from clearjoint.testing.contact_joints import _positions
from tests.model.test_backlash import MOTIONS, backlash, depths


def test_joints_with_couples_are_checked_at_the_onset_and_deeper():
    """At the given motions, no flank is near its onset."""
    joint = jax.tree.map(jnp.asarray, backlash(axis_first=(1, 2, 0.5), axis_second=(0.3, 1, -1)))
    motions = jax.tree.map(jnp.asarray, MOTIONS)
    lower, upper = np.array([depths(joint, m) for m in _positions(joint, motions, False)]).T
    assert abs(lower[0]) > 1e-3 and abs(upper[0]) > 1e-3
    np.testing.assert_allclose(lower[[1, 2, 6, 7]], [0.0, 1e-6, 0.0, 1e-6], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(upper[[3, 4, 8, 9]], [0.0, 1e-6, 0.0, 1e-6], rtol=0.0, atol=1e-12)
