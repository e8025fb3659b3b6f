"""The peak of a curve that is known at few times."""

import numpy as np
import pytest

from clearjoint._simulation.run.wall_impact import _crest


@pytest.mark.parametrize("top", [0.3, 0.9, -0.2, 1.4])
def test_the_peak_of_a_parabola_is_exact_inside_and_at_either_end(top):
    times = np.array([0.0, 0.1, 0.35, 0.6, 1.0])
    peak = 5.0 - (np.clip(top, 0.0, 1.0) - top) ** 2
    assert _crest(times, 5.0 - (times - top) ** 2) == pytest.approx(peak, rel=1e-14)
