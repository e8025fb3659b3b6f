"""Problems of rigid contacts: exhaustive search, slips and the text of a failure."""

import itertools
from typing import Any

import jax
import numpy as np
import pytest

import clearjoint as cj
from clearjoint._simulation.nonsmooth import simulate as nonsmooth_simulate
from clearjoint._simulation.nonsmooth.bounded_lcp import BoxProblem
from clearjoint._simulation.nonsmooth.contact_problem import (
    NEGLIGIBLE,
    Alternation,
    _extrapolation,
    _slip_direction,
)
from clearjoint.extend import ZERO, Vector
from tests.simulation.test_nonsmooth import ball


def test_an_unsolved_contact_problem_is_named(monkeypatch):
    monkeypatch.setattr(nonsmooth_simulate, "SOLVED", -1.0)
    # No other test uses these coordinates, so that a program with the changed limit is compiled.
    coordinates = cj.AbsoluteCoordinates()
    with pytest.raises(cj.SimulationError, match="rigid contacts in a fixed step were not found"):
        cj.simulate_nonsmooth(*ball(), 0.01, step=1e-3, coordinates=coordinates)


def searched(matrix: np.ndarray, start: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> Any:
    """The solution by trying every choice of held rows."""
    n = len(start)
    for choice in itertools.product((-1, 0, 1), repeat=n):
        side = np.array(choice)
        x = np.where(side < 0, lower, np.where(side > 0, upper, 0.0))
        free = side == 0
        if not np.isfinite(x).all():
            continue
        if free.any():
            x[free] = np.linalg.solve(matrix[np.ix_(free, free)], -(start + matrix @ x)[free])
        y = matrix @ x + start
        inside = (x >= lower - 1e-9).all() and (x <= upper + 1e-9).all()
        if inside and (y[side < 0] >= -1e-9).all() and (y[side > 0] <= 1e-9).all():
            return x
    raise AssertionError("no solution")


def test_box_problems_agree_with_exhaustive_search():
    """Among them two rows that are nearly parallel, as those of a short journal's bases."""
    random, n = np.random.default_rng(6), 4
    solve = jax.jit(
        lambda matrix, start, lower, upper: BoxProblem(
            [[matrix[i, j] for j in range(i + 1)] for i in range(n)], list(lower), list(upper)
        ).solve(list(start), NEGLIGIBLE)
    )
    for k in range(200):
        factor = random.normal(size=(n, n))
        factor[1] = factor[0] + 10.0 ** -random.integers(0, 4) * factor[1]
        matrix = factor @ factor.T
        start = random.normal(size=n)
        lower, upper = (-1.0, 0.7) if k % 2 else (0.0, np.inf)
        bounds = np.full(n, lower), np.full(n, upper)
        found, residual = solve(matrix, start, *bounds)
        expected = searched(matrix, start, *bounds)
        assert residual < 1e-9
        np.testing.assert_allclose(np.array(found), expected, rtol=1e-5, atol=1e-6)


def test_slips_of_two_bases_that_depend_on_each_other_are_solved():
    """Of an impact of a tilted journal: four rows in three directions, of which the velocities are
    off by 1e-7. Impulses go along the null space as far as a bound."""
    rows = [
        [0.09413355134020325],
        [0.06926778069618139, 0.3539959213075342],
        [0.09208015731088526, 0.05637422463558141, 0.09083252567272831],
        [0.06925863799924187, 0.35393845692654774, 0.056368673776098, 0.3538810085639335],
    ]
    start = [0.00015569487000782, 0.00035932763443788, 0.00016280394277092, 0.00035935992631982]
    bound = np.array(
        [0.007429329173331, 0.007429329173331, 0.00742881654654437, 0.00742881654654437]
    )
    found, residual = jax.jit(
        lambda q: BoxProblem(rows, list(-bound), list(bound)).solve(list(q), NEGLIGIBLE)
    )(np.array(start))
    assert residual < 1e-9
    matrix = np.array([[rows[max(i, j)][min(i, j)] for j in range(4)] for i in range(4)])
    x, y = np.array(found), matrix @ np.array(found) + start
    np.testing.assert_allclose(
        x, np.clip(x - y / np.diag(matrix), -bound, bound), rtol=0.0, atol=1e-10
    )


@pytest.mark.parametrize("slope", [-0.9, 0.3, 0.99])
def test_extrapolation_finds_the_fixed_point_of_a_line_in_its_second_turn(slope):
    """Aitken's method is exact for x -> slope (x - 5) + 5."""
    zero = np.zeros(())
    now = Alternation([], [], zero, np.asarray(0), [zero, zero], [zero, zero], np.asarray(7.0))
    for turn in (1, 2):
        change = [(slope - 1.0) * (x - 5.0 * k) for k, x in enumerate(now.tried)]
        factor = _extrapolation(now, change)
        assert turn > 1 or float(factor) == 1.0
        tried = [x + factor * by for x, by in zip(now.tried, change, strict=True)]
        now = now._replace(turns=turn, tried=tried, change=change, factor=factor)
    np.testing.assert_allclose(now.tried, [0.0, 5.0], rtol=1e-9)
    assert float(_extrapolation(now, now.change)) == 1.0  # two equal changes


def test_the_direction_of_slip_is_a_unit_vector_also_at_rest():
    along = _slip_direction(Vector(3e-9, 4e-9, 0.0), Vector(0.0, 0.0, 1.0))
    np.testing.assert_allclose([*along], (0.6, 0.8, 0.0), rtol=1e-12)
    normal = Vector(0.6, 0.0, 0.8)
    at_rest = _slip_direction(ZERO, normal)
    assert float(at_rest.dot(at_rest)) == pytest.approx(1.0, rel=1e-12)
    assert float(at_rest.dot(normal)) == pytest.approx(0.0, abs=1e-15)


def test_a_step_of_impulses_ends_at_the_first_bound():
    """From -1 to the bound 0 along 4, from 2 to 0.5 along -3; the others may go all the way."""
    eye = [[1.0], [0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0]]
    problem = BoxProblem(eye, [-9.0, 0.5, -9.0, -9.0], [0.0, 9.0, 9.0, 9.0])
    shares = problem._shares([-1.0, 2.0, 0.0, 1.0], [4.0, -3.0, 0.0, 2.0])
    np.testing.assert_allclose(shares, [0.25, 0.5, 1.0, 1.0], rtol=1e-15)
