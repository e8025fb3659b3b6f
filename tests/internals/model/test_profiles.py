"""The deepest point of a journal with a profile in a bearing with a profile."""

import numpy as np
import pytest

import clearjoint as cj
from clearjoint._model.profiles import JournalInBearing, PlanarAxes
from clearjoint.profiles import Harmonics
from tests.model.test_profiles import CLEARANCE, pin

ALIGNED = PlanarAxes(1.0, 0.0, 0.0, 1.0)


def test_of_many_waves_the_deepest_is_found():
    """The search by 48 angles finds the largest of several maxima."""
    profile = Harmonics([0.0] * 5 + [50e-6])
    rng = np.random.default_rng(5)
    t = np.linspace(0.0, 2.0 * np.pi, 20_001)
    wall = 50e-6 * np.cos(6 * t)
    for x, y in rng.normal(size=(5, 2)) * 0.4e-3:
        found = JournalInBearing(x, y, profile, None, ALIGNED).closest_approach(CLEARANCE)
        expected = (x * np.cos(t) + y * np.sin(t) - wall).max() - CLEARANCE
        assert float(found.depth) == pytest.approx(expected, abs=1e-10)


def test_a_journal_rests_where_its_load_presses_it():
    """Both bases carry half of the load there, and the wall's normal is along the load."""
    profile = Harmonics([0.0, 30e-6, -10e-6], [0.0, 20e-6, 0.0])
    load = np.array([3.0, -2.0, 0.5])
    joint = pin(profile)
    ideal = joint.resting_joint(load)
    x, y, _ = ideal.attachments()[0][2]
    found = JournalInBearing(x, y, profile, None, ALIGNED).closest_approach(CLEARANCE)
    gap = cj.extend.Gap(found.depth, 0.0, joint.bearing_radius, joint.clearance)
    push = float(joint.law.elastic_force(gap))
    assert 2.0 * push == pytest.approx(np.hypot(*load[:2]), rel=1e-9)
    np.testing.assert_allclose(
        [found.cosine, found.sine], load[:2] / np.hypot(*load[:2]), atol=1e-12
    )
