"""Modes, mixtures, draws and their weights in tempering."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import kstest, norm

from clearjoint._identification.points import chi_squared_over
from clearjoint._identification.posterior.posterior import modes
from clearjoint._identification.posterior.tempering import (
    Mixture,
    Target,
    draw,
    effective_number,
    next_count,
    resampled,
)
from tests.identification.test_posterior import WIDTH, found


def test_a_cloud_of_one_point_is_impossible(monkeypatch):
    def singular(*_):
        raise np.linalg.LinAlgError("Matrix is not positive definite")

    monkeypatch.setattr("clearjoint._identification.posterior.posterior.draw", singular)
    with pytest.raises(ValueError, match="Almost all points are impossible: .*`log_prior`"):
        found(draws=64)


@pytest.mark.slow
def test_copies_of_a_point_are_no_points():
    copies, even = np.repeat([[0.5, 1.0]], 40, axis=0), np.full(40, 1.0 / 40.0)
    with pytest.raises(np.linalg.LinAlgError, match="1 distinct points"):
        Mixture.around(copies, even)
    assert effective_number(copies, even) == pytest.approx(1.0)
    other = np.concatenate([copies[:20], copies[:20] + np.arange(20.0)[:, None]])
    # One point with the weight 21/40, and nineteen others.
    assert effective_number(other, even) == pytest.approx(1600.0 / (21.0**2 + 19.0))
    wide = Mixture.around(other, even)
    assert len(wide.centres) == 21 and wide.weights.sum() == pytest.approx(1.0)
    result = found(draws=64)
    same = replace(result, coordinates=np.full((64, 1), 0.5), effective_sample_size=1.0)
    assert same.distinct == 1 and "1 of which are distinct" in same.warnings[0]
    assert "64 points, 1 of which are distinct, from 1 effective runs" in str(same)


def linear(parameters, count=40, noise=0.1):
    """Design and data over the noise, mean, covariance and log evidence of a linear problem."""
    generator = np.random.default_rng(parameters)
    design = generator.standard_normal((count, parameters)) / noise
    values = design @ np.linspace(-0.3, 0.3, parameters) + generator.standard_normal(count)
    covariance = np.linalg.inv(design.T @ design)
    mean = covariance @ design.T @ values
    misfit = np.sum((values - design @ mean) ** 2)
    area = 0.5 * np.linalg.slogdet(2 * np.pi * covariance)[1] - parameters * math.log(2 * WIDTH)
    return design, values, mean, covariance, area - 0.5 * misfit


def target_of(residuals, parameters):
    """The posterior for a function of points that returns residuals (n, T), in a box."""

    def curves(points, count):
        squares = residuals(points)[:, :count] ** 2
        return np.pad(np.cumsum(squares, axis=1), ((0, 0), (1, 0)))

    ends = np.full(parameters, WIDTH)
    count = residuals(np.zeros((1, parameters))).shape[1]
    return Target(curves, count, -ends, ends, lambda points: np.zeros(len(points)))


@pytest.mark.parametrize("parameters", [1, 3])
def test_linear_problems_have_the_posterior_of_the_closed_form(parameters):
    design, values, mean, covariance, evidence = linear(parameters)
    target = target_of(lambda points: points @ design.T - values, parameters)
    draws = [draw(target, 500, np.random.default_rng(seed)) for seed in range(4)]
    points = np.concatenate([one.points for one in draws])
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), (points - mean).T)
    np.testing.assert_allclose(whitened.mean(axis=1), 0.0, atol=0.2)
    np.testing.assert_allclose(np.cov(whitened), np.eye(parameters), atol=0.25)
    errors = [(one.log_evidence - evidence) / one.error for one in draws]
    assert np.abs(errors).max() < 4.0 and all(0.01 < one.error < 0.1 for one in draws)
    assert set(modes(draws[0].points, draws[0].chi_squared)) == {0}
    ends = np.quantile(whitened, (0.025, 0.975), axis=1).T
    np.testing.assert_allclose(ends, np.tile((-1.96, 1.96), (parameters, 1)), atol=0.3)


@dataclass(frozen=True)
class Narrow:
    """Result of a random linear problem with a normal prior in a much wider box.

    `mean`, `size`: error of the points' mean and their standard deviation, in standard deviations
    of the posterior; `inside`: whether the intervals contain the truth; `error`, `stated`: of the
    logarithm of the evidence; `effective`: effective number of runs.
    """

    mean: np.ndarray
    size: np.ndarray
    inside: np.ndarray
    error: float
    stated: float
    effective: float


def narrow(seed, number):
    """One to three parameters, a prior of 1e-9 to 0.1 of the box, and data that are worse or up to
    a hundred times better than the prior, whose truth is drawn from the prior."""
    generator = np.random.default_rng(seed)
    parameters = int(generator.integers(1, 4))
    width = 10.0 ** generator.uniform(-9.0, -1.0, parameters)
    centre = generator.uniform(-0.4, 0.4, parameters)
    truth = centre + width * generator.standard_normal(parameters)
    noise = 10.0 ** generator.uniform(-2.0, 2.0)
    design = generator.standard_normal((10, parameters)) / width / noise
    values = design @ truth + generator.standard_normal(10)
    ends, scale = np.ones(parameters), 7.0  # The prior is given up to a constant.
    target = replace(
        target_of(lambda points: points @ design.T - values, parameters),
        low=-ends,
        high=ends,
        log_prior=lambda x: scale - 0.5 * (((x - centre) / width) ** 2).sum(axis=1),
    )
    drawn = draw(target, number, generator)
    # In units of the prior: its covariance is 1, and the design has no unit.
    slopes, misses = design * width, values - design @ centre
    covariance = np.linalg.inv(np.eye(parameters) + slopes.T @ slopes)
    spread = np.eye(10) + slopes @ slopes.T
    evidence = -0.5 * (misses @ np.linalg.solve(spread, misses) + np.linalg.slogdet(spread)[1])
    mean = covariance @ slopes.T @ misses
    whitened = np.linalg.solve(
        np.linalg.cholesky(covariance), ((drawn.points - centre) / width - mean).T
    )
    low, high = np.quantile(drawn.points, (0.025, 0.975), axis=0, method="weibull")
    return Narrow(
        whitened.mean(axis=1),
        whitened.std(axis=1),
        (low < truth) & (truth < high),
        drawn.log_evidence - evidence,
        drawn.error,
        drawn.effective,
    )


@pytest.mark.slow
def test_intervals_and_evidence_of_narrow_priors_are_as_good_as_stated():
    results = [narrow(seed, 200) for seed in range(100)]
    ratios = np.array([one.error / one.stated for one in results])
    inside = np.concatenate([one.inside for one in results])
    means, sizes = (np.concatenate([getattr(one, n) for one in results]) for n in ("mean", "size"))
    print(f"\n{len(results)} narrow priors: 95 % intervals with the truth {inside.mean():.3f} of")
    print(f"{len(inside)}; errors of the log evidence, stated 1: mean {ratios.mean():.2f},")
    print(f"deviation {ratios.std():.2f}, within 1.96 {np.mean(np.abs(ratios) < 1.96):.2f};")
    print(f"largest error of a mean {np.abs(means).max():.2f}, deviations {sizes.min():.2f} to")
    print(f"{sizes.max():.2f}, of the posterior's deviation")
    assert 0.90 < inside.mean() < 0.99
    assert abs(ratios.mean()) < 0.35 and 0.75 < ratios.std() < 1.25
    assert np.abs(means).max() < 0.4 and sizes.min() > 0.7 and sizes.max() < 1.3
    assert np.median([one.stated for one in results]) < 0.08
    assert min(one.effective for one in results) >= 200.0


@pytest.mark.slow
@pytest.mark.parametrize("parameters", [3, 6])
def test_the_evidence_has_no_bias_and_the_stated_error(parameters):
    design, values, _, _, evidence = linear(parameters)
    target = target_of(lambda points: points @ design.T - values, parameters)
    draws = [draw(target, 150, np.random.default_rng(seed)) for seed in range(12)]
    errors = np.array([one.log_evidence - evidence for one in draws])
    stated = np.array([one.error for one in draws])
    assert abs(errors.mean()) < 3.0 * stated.mean() / math.sqrt(12.0)
    assert 0.6 < (errors / stated).std() < 1.4 and stated.max() < 0.1
    assert min(one.effective for one in draws) >= 150.0


def test_the_evidence_of_a_posterior_that_the_box_cuts_off():
    low, high = np.zeros(1), np.full(1, 3.0)
    target = replace(target_of(lambda points: points, 1), low=low, high=high)
    drawn = draw(target, 500, np.random.default_rng(0))
    evidence = math.log(math.sqrt(2.0 * math.pi) * (norm.cdf(3.0) - 0.5) / 3.0)
    assert abs(drawn.log_evidence - evidence) < 4.0 * drawn.error < 0.3
    assert drawn.points.min() > 0.0


@pytest.mark.slow
def test_few_points_in_many_dimensions_have_a_large_error_but_not_a_small_wrong_one():
    design, values, _, _, evidence = linear(10)
    target = target_of(lambda points: points @ design.T - values, 10)
    drawn = draw(target, 64, np.random.default_rng(0))
    assert abs(drawn.log_evidence - evidence) < 4.0 * drawn.error and drawn.effective < 32.0


def rough(parameters, count=60, noise=0.1):
    """A function of points (n, p) that returns predictions (n, T) over the noise.

    They are linear in the parameters, and waves in two directions make many minima of chi squared,
    two standard deviations apart, in the second half of the record.
    """
    generator = np.random.default_rng(parameters)
    design = generator.standard_normal((count, parameters)) / noise
    directions = generator.standard_normal((2, parameters))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    waves = np.pi * math.sqrt(count) / noise * directions
    sizes = generator.standard_normal((count, 2)) * math.sqrt(24.0 / count)
    sizes[: count // 2] = 0.0
    return lambda points: points @ design.T + np.sin(points @ waves.T) @ sizes.T


@pytest.mark.slow
def test_the_truth_is_a_point_like_others_where_chi_squared_is_rough():
    # If the truth is drawn from the prior, its rank among points of the posterior is uniform
    # (S. Talts et al., Validating Bayesian inference algorithms with simulation-based calibration).
    predict, ranks = rough(3), []
    for seed in range(60):
        generator = np.random.default_rng(seed)
        truth = generator.uniform(-WIDTH, WIDTH, 3)
        clean = predict(truth[None])
        values = clean + generator.standard_normal(clean.shape)
        target = target_of(lambda points, values=values: predict(points) - values, 3)
        ranks.append((draw(target, 160, generator).points < truth).mean(axis=0))
    for row in np.transpose(ranks):
        assert kstest(row, "uniform").pvalue > 0.003
    inside = np.abs(np.array(ranks) - 0.5) < 0.475
    assert 0.88 < inside.mean() < 0.99


@pytest.mark.slow
def test_few_points_keep_the_ends_of_a_thin_curved_region():
    # The second and the third coordinate are standard normal; the first follows a parabola.
    def residuals(points):
        first, second, third = points.T
        bent = 2.3 * (second**2 - 1.0) + 2.3 * second * third
        return np.stack([first / 0.02 + bent, second, third], axis=1)

    def curves(points, count):
        squares = (residuals(points) ** 2).sum(axis=1)
        return np.multiply.outer(squares, np.linspace(0.0, 1.0, 41)[: count + 1] ** 3)

    ends = np.array([20.0, 100.0, 100.0])
    target = Target(curves, 40, -ends, ends, lambda points: np.zeros(len(points)))
    held = []
    for seed in range(8):
        points = draw(target, 200, np.random.default_rng(seed)).points[:, 1:]
        low, high = norm.cdf(np.quantile(points, (0.025, 0.975), axis=0, method="weibull"))
        held.append(high - low)
    assert 0.935 < np.mean(held) < 0.965 and np.min(held) > 0.85


def test_steps_along_the_record():
    curves = np.array([[0.0, 1.0, 4.0], [0.0, 3.0, np.inf]])
    assert chi_squared_over(curves, 0.5).tolist() == [0.5, 1.5]
    assert chi_squared_over(curves, 1.0).tolist() == [1.0, 3.0]
    assert chi_squared_over(curves, 1.5).tolist() == [2.5, np.inf]
    assert next_count(np.zeros((4, 3)), 0.0) == 2.0
    steep = np.array([[0.0, 0.0], [0.0, 100.0], [0.0, 200.0], [0.0, 300.0]])
    assert 0.0 < next_count(steep, 0.0) < 0.1
    # No run gets farther than one time.
    assert 0.9 < next_count(np.tile([0.0, 0.0, np.inf], (4, 1)), 0.0) <= 1.0
    weights = np.array([0.5, 0.25, 0.25, 0.0])
    assert resampled(weights, np.random.default_rng(0)).tolist() == [0, 0, 1, 2]


def test_modes_are_separate_minima_and_small_groups_join_the_nearest():
    generator = np.random.default_rng(1)
    for p in (1, 2, 4):
        cloud = generator.standard_normal((400, p))
        assert set(modes(cloud, (cloud**2).sum(axis=1))) == {0}
        centres = np.where(np.arange(400) < 100, 12.0, 0.0)
        shifted = cloud + centres[:, None]
        numbers = modes(shifted, (cloud**2).sum(axis=1))
        assert (numbers == np.where(centres > 0.0, 1, 0)).all()
    assert modes(np.repeat([[0.0], [9.0]], [64, 36], axis=0), np.zeros(100)).max() <= 1
