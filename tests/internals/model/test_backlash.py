"""Couples of backlash, and the motions at which a joint with couples is checked."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from clearjoint._dynamics.contact_forces import contact_wrenches
from clearjoint.extend import unpack
from clearjoint.testing.contact_joints import _positions
from tests.model.test_backlash import MOTIONS, backlash, depths, spinning


def test_joints_with_couples_are_checked_at_the_onset_and_deeper():
    """At the given motions, no flank is near its onset."""
    joint = jax.tree.map(jnp.asarray, backlash(axis_first=(1, 2, 0.5), axis_second=(0.3, 1, -1)))
    motions = jax.tree.map(jnp.asarray, MOTIONS)
    lower, upper = np.array([depths(joint, m) for m in _positions(joint, motions, False)]).T
    assert abs(lower[0]) > 1e-3 and abs(upper[0]) > 1e-3
    np.testing.assert_allclose(lower[[1, 2, 6, 7]], [0.0, 1e-6, 0.0, 1e-6], atol=1e-12)
    np.testing.assert_allclose(upper[[3, 4, 8, 9]], [0.0, 1e-6, 0.0, 1e-6], atol=1e-12)


def test_backlash_acts_by_couples_only():
    joint = unpack(backlash())
    turned = {"a": spinning(0.0, 0.0), "b": spinning(3e-3, 0.0)}
    upper = joint.contacts(turned)["upper flank"]
    assert float(upper.gap.depth) == pytest.approx(0.05 * (3e-3 - 1e-3), rel=1e-12)
    wrenches = dict(contact_wrenches(joint, upper, 100.0, None, turned))
    for name, moment in (("a", 5.0), ("b", -5.0)):
        assert tuple(wrenches[name].force) == (0.0, 0.0, 0.0)
        assert [float(part) for part in wrenches[name].moment] == pytest.approx([0, 0, moment])
