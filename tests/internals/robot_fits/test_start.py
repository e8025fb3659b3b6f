"""Which joints begin at rest."""

import numpy as np
import pytest

from clearjoint._measurements.robot_logs import Logged
from clearjoint._robot_fits.problem import _begins_at_rest

TIMES = np.sort(np.random.default_rng(1).uniform(3.0, 3.05, 10))
NOISE = 2e-3
"""Noise, rad."""


def share_at_rest(speed, draws=2000):
    """Return the share of logs with a speed, rad/s, of which the joint counts as at rest."""
    generator = np.random.default_rng(0)
    angles = 0.4 + speed * TIMES + NOISE * generator.standard_normal((draws, len(TIMES)))
    return np.mean([_begins_at_rest(Logged(TIMES, row, NOISE, "rad")) for row in angles])


@pytest.mark.parametrize("offset", [0.0, np.pi - 0.4])
def test_noise_alone_is_no_speed(offset):
    generator = np.random.default_rng(0)
    angles = 0.4 + offset + NOISE * generator.standard_normal((2000, len(TIMES)))
    wrapped = (angles + np.pi) % (2.0 * np.pi) - np.pi
    rest = [_begins_at_rest(Logged(TIMES, row, NOISE, "rad")) for row in wrapped]
    assert np.mean(rest) > 0.996  # of a normal slope, 0.999 is within 3.3 standard errors


def test_a_speed_is_found_where_least_squares_determines_it():
    slopes = [np.polyfit(TIMES, row, 1)[0] for row in np.eye(len(TIMES))]
    error = NOISE * np.linalg.norm(slopes)  # of the speed
    for speed, shares in {2.0: (0.85, 0.95), 3.3: (0.45, 0.55), 6.6: (0.0, 0.005)}.items():
        low, high = shares
        assert low <= share_at_rest(-speed * error) <= high


def test_unknown_noise_leaves_the_speed_open():
    assert not _begins_at_rest(Logged(TIMES, np.zeros(10), None, "rad"))
