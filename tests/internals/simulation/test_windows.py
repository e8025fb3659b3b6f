"""Parts of a step in a window: parabolas, times and impacts."""

import jax.numpy as jnp
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._math.interpolation import Parabola
from clearjoint._simulation.reductions.base import TimeSpan


@pytest.mark.parametrize(
    ("after", "until", "part"),
    [
        (0.2, 0.5, (0.125, 0.5)),
        (None, 0.5, (0.0, 0.5)),
        (0.2, None, (0.125, 1.0)),
        (None, 0.05, (0.0, 0.0)),
        (1.0, None, (1.0, 1.0)),
    ],
)
def test_the_part_of_a_step_that_is_in_a_window(after, until, part):
    found = TimeSpan(after, until).fractions(jnp.asarray(0.1), jnp.asarray(0.9))
    assert [float(x) for x in found] == pytest.approx(part, rel=1e-15)
    assert bool(TimeSpan(after, until).holds(0.2)) == (after != 1.0 and until != 0.05)
    assert bool(TimeSpan(after, until).holds(0.5)) == (until is None and after != 1.0)


def test_part_of_a_parabola_below_a_level():
    generator = np.random.default_rng(0)
    places = np.linspace(0.0, 1.0, 20_001)
    for scale in (1.0, 1e-9, 1e7):
        for _ in range(7):
            a, b = np.sort(generator.uniform(0, 1, 2))
            arc = Parabola(*(scale * generator.normal(size=3)))
            level = scale * generator.normal()
            chosen = places[(places >= a) & (places <= b)]
            expected = (np.asarray(arc.at(chosen)) < level).mean() * (b - a)
            assert float(arc.part_below(level, a, b)) == pytest.approx(expected, abs=2e-4)
    line, constant = Parabola(1.0, -2.0, 0.0), Parabola(0.25, 0.0, 0.0)
    assert float(line.part_below(0.0, 0.0, 1.0)) == pytest.approx(0.5)
    found = [float(constant.part_below(level, 0.1, 0.6)) for level in (0.0, 0.25, 1.0)]
    assert found == pytest.approx([0.0, 0.0, 0.5])


def test_impacts_of_a_window():
    rows = [("pin", "V", t, t + 0.1, 0.1, 1.0, 0.9, 1e3 * t, t, 1e-6) for t in (0.1, 0.2, 0.3)]
    impacts = cj.results.Impacts.of_rows(rows)
    np.testing.assert_array_equal(impacts.within(0.2, 0.3).onset, [0.2])
    np.testing.assert_array_equal(impacts.within(after=0.2).peak_force, [200.0, 300.0])
    assert len(impacts.within()) == 3 and TimeSpan(None, None).is_whole
