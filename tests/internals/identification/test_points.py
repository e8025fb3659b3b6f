"""Level sets of misfits, on curves and points whose sets are known."""

import numpy as np
import pytest

from clearjoint._identification.points import drawn_among, far_apart, reached

RANDOM = np.random.default_rng(2)


def test_the_reach_of_straight_curves_is_where_their_spread_is_the_excess():
    """Point k has a chi squared k a time: the third of them is 2 s above the best after s."""
    curves = np.arange(5.0)[:, None] * np.arange(11.0)
    assert reached(curves, 3, 7.4) == pytest.approx(3.7)
    assert reached(curves, 5, 3.0) == pytest.approx(0.75)
    assert reached(curves, 1, 0.0) == 10.0 and reached(curves, 3, 21.0) == 10.0


def test_distances_do_not_depend_on_units():
    corners = np.array([[0.0, 0.0], [0.1, 0.1], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])
    expected = {0, 2, 3, 4}
    for units in ([1.0, 1.0], [1e-6, 1e3]):
        chosen = far_apart(corners * units, 4)
        assert chosen[0] == 0 and set(chosen) == expected
    assert len(far_apart(corners, 9)) == 5
    assert len(far_apart(np.zeros((3, 2)), 2)) == 2


def test_new_points_follow_a_set_in_two_thin_pieces():
    """Of two needles a unit apart, a normal distribution of all points would fill the middle."""
    along = np.linspace(-0.1, 0.1, 20)
    needle = np.column_stack([along, 1e-3 * RANDOM.standard_normal(20)])
    both = np.concatenate([needle, needle + [0.0, 1.0]])
    bounds = np.array([-2.0, -2.0]), np.array([2.0, 2.0])
    drawn = drawn_among(both, 500, bounds, RANDOM)
    near = np.abs(drawn[:, 1] - np.round(drawn[:, 1]))
    assert near.max() < 0.02 and set(np.round(drawn[:, 1])) == {0.0, 1.0}
    assert 0.05 < drawn[:, 0].std() < 0.12


def test_new_points_keep_inside_the_bounds():
    points = RANDOM.uniform(-1.0, 1.0, (40, 2)) * [1.0, 0.0]
    low, high = np.array([-1.0, 0.0]), np.array([1.0, 0.0])
    drawn = drawn_among(points, 300, (low, high), RANDOM)
    assert (drawn >= low).all() and (drawn <= high).all() and (drawn[:, 1] == 0.0).all()
    assert np.mean(np.abs(drawn[:, 0]) == 1.0) < 0.02
