"""A recorded run that starts late is compiled as one that starts at zero."""

import numpy as np
import pytest

from clearjoint._simulation.run.sampling import sampled_compiled
from tests.support.programs import made_by
from tests.support.recorded_rod import recorded_rod

LATE = (2.0**14, 2.0**20)
"""s: at 2^20 s the spacing of times is 1e-10 s; in that time an impacting journal moves a hundred
landing tolerances."""


@pytest.mark.slow
def test_a_run_is_the_same_whenever_it_starts():
    early, programs = recorded_rod(), made_by(sampled_compiled)
    assert early.impacts is not None
    for start in LATE:
        late = recorded_rod(start)
        assert late.impacts is not None
        assert late.attempts == early.attempts and late.time == start + early.time
        np.testing.assert_array_equal(late.outputs["time"], start + early.times)
        for name in ("height", "entry"):
            np.testing.assert_allclose(late.outputs[name], early.outputs[name], rtol=1e-9)
            np.testing.assert_allclose(late.derivatives[name], early.derivatives[name], rtol=1e-9)
        np.testing.assert_allclose(late.impacts.onset, start + early.impacts.onset, rtol=1e-15)
        later, earlier = late.outputs["deepest"], early.outputs["deepest"]
        np.testing.assert_allclose(later.times, start + earlier.times, rtol=1e-15)
        np.testing.assert_allclose(later.values["height"], earlier.values["height"], rtol=1e-9)
        assert made_by(sampled_compiled) == programs
        np.testing.assert_allclose(late.impacts.duration, early.impacts.duration, rtol=1e-9)
