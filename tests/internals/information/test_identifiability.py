"""Fisher information of rows: correlations, roots, combinations and their text."""

import numpy as np
import pytest

import clearjoint as cj
from clearjoint._export.tables import percent
from clearjoint._information import fisher_information as information


def test_correlations_of_what_is_determined_beside_what_is_not():
    """The correlation of three parameters, beside one without effect and two that act alike."""
    known, other = np.random.default_rng(2).standard_normal((50, 3)), np.linspace(0.0, 1.0, 50)
    rows = np.column_stack([known, 0.0 * other, other, 3.0 * other])
    names = tuple("abcdef")
    report = cj.results.Identifiability(
        names, (cj.Linear(1.0),) * 6, np.ones(6), np.full(50, "probe"), other, rows, 1e-9
    )
    # The combination of the last two that the data determine is estimated too.
    inverse = np.linalg.inv(np.column_stack([known, other]).T @ np.column_stack([known, other]))
    expected = np.full((6, 6), np.nan)
    expected[:3, :3] = information.correlation(inverse)[:3, :3]
    assert report.rank == 4
    np.testing.assert_allclose(report.correlation, expected, rtol=0.0, atol=1e-12)
    assert str(report).splitlines()[5].split()[-3:] == ["-", "-", "-"]


def test_a_root_keeps_what_its_square_would_lose():
    """Two columns apart by 1e-9: the information's condition is beyond double precision."""
    generator = np.random.default_rng(0)
    common, apart = generator.standard_normal((2, 200))
    rows = np.stack([common, common + 1e-9 * apart], axis=1)
    own = apart - common * (common @ apart) / (common @ common)
    deviation = 1.0 / (1e-9 * np.linalg.norm(own))
    found = information.deviations_together(information.root_of(rows), 1e-12)
    np.testing.assert_allclose(found, deviation, rtol=1e-4)
    assert np.isinf(information.deviations_together(information.root_of(rows), 1e-6)).all()


def test_weights_that_matter_are_named_though_they_are_small():
    root = np.diag([1e4, 1.0]) @ np.array([[1.0, -0.01], [0.0, 1.0]])
    worst = information.combinations(root, 1e-9)[-1]
    assert worst.described(["a", "b"]) == "b + 0.01 a"
    assert worst.shares[0] > 0.99


def test_rounding_is_not_named_in_a_sum_that_is_not_determined():
    weights, shares = np.array([1.0, 1e-17]), np.array([np.nan, np.inf])
    sum_of_both = information.Combination(weights, np.inf, shares)
    assert sum_of_both.described(["a", "b"]) == "a"


@pytest.mark.parametrize(
    ("share", "text"),
    [(1.0, "100 %"), (0.01234, "1.2 %"), (12.34, "1200 %"), (2e-7, "2e-05 %"), (np.inf, "-")],
)
def test_shares_are_rounded_to_two_digits(share, text):
    assert percent(share) == text
