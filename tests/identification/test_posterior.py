"""Posteriors against closed forms: free flights, whose position is linear in the velocity, linear
problems of several parameters, two minima of known weights, and ranks of the truth among points.
Normal priors of random widths have a closed form as well."""

import math
from dataclasses import dataclass, replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import kstest, norm

import clearjoint as cj
from clearjoint._identification.points import level
from clearjoint._identification.posterior.posterior import modes
from clearjoint._identification.posterior.tempering import (
    Mixture,
    Target,
    draw,
    effective_number,
    next_count,
    resampled,
)

TIMES, SPEED, NOISE, WIDTH = np.linspace(0.1, 1.0, 10), 0.7, 0.05, 2.0
SCENE = cj.Scene({"ball": cj.Body(1.0, (1.0, 1.0, 1.0))}, gravity=(0.0, 0.0, 0.0))
STATE = cj.State({"ball": cj.body_state((0.0, 0.0, 0.0), velocity=(SPEED, 0.0, 0.0))})
CHANNEL = cj.quantities.Position("ball", "x")
VELOCITY = {"speed": cj.Parameter.initial(lambda s: s.bodies["ball"].velocity[0])}


def squared(scene, state, value):
    """The flight whose speed is the square of a value."""
    velocity = jnp.asarray(state.bodies["ball"].velocity).at[0].set(value**2)
    return scene, eqx.tree_at(lambda s: s.bodies["ball"].velocity, state, velocity)


SQUARE = {"root": cj.Parameter.change(squared, 0.1, cj.Linear())}


def flights(seed=3):
    series = cj.Series(CHANNEL, TIMES, SPEED * TIMES, NOISE)
    return cj.Measurements({"x": series.with_noise(np.random.default_rng(seed))})


def found(parameters=VELOCITY, data=None, **options):
    data = flights() if data is None else data
    options = {"draws": 256, "spread": WIDTH, "progress": False} | options
    return cj.posterior(SCENE, STATE, data, parameters, **options)


@pytest.mark.slow
def test_a_free_flight_has_the_posterior_and_the_evidence_of_the_closed_form():
    data = flights()
    values = np.asarray(data["x"].values)
    deviation = NOISE / np.linalg.norm(TIMES)
    mean = float(values @ TIMES / (TIMES @ TIMES))
    misfit = np.sum((values - mean * TIMES) ** 2) / NOISE**2
    constant = -len(TIMES) * math.log(NOISE * math.sqrt(2 * math.pi))
    evidence = constant - 0.5 * misfit + math.log(math.sqrt(2 * math.pi) * deviation / (2 * WIDTH))
    result = found()
    assert result.means["speed"] == pytest.approx(mean, abs=4 * deviation / math.sqrt(100))
    assert result.standard_deviations["speed"] == pytest.approx(deviation, rel=0.15)
    assert abs(result.log_evidence - evidence) < 4 * result.log_evidence_error < 1.0
    best = constant - 0.5 * misfit
    assert result.log_likelihood.max() == pytest.approx(best, abs=0.01)
    assert result.failed == 0 and result.warnings == [] and result.weights.tolist() == [1.0]
    low, high = result.intervals["speed"]
    assert low == pytest.approx(mean - 1.96 * deviation, abs=0.5 * deviation)
    assert high == pytest.approx(mean + 1.96 * deviation, abs=0.5 * deviation)


@pytest.mark.slow
def test_two_minima_have_the_weights_of_the_prior():
    equal = found(SQUARE)
    assert len(equal.weights) == 2 and equal.weights[1] == pytest.approx(0.5, abs=0.12)
    assert {round(float(equal.coordinates[equal.modes == k].mean()), 1) for k in (0, 1)} == {
        -0.8,
        0.8,
    }
    tilted = found(SQUARE, log_prior=lambda values: np.where(values["root"] > 0, np.log(3.0), 0.0))
    assert tilted.weights[0] == pytest.approx(0.75, abs=0.12)
    assert tilted.samples["root"][tilted.modes == 0].min() > 0.0
    assert "2 separate minima" in str(tilted)


@pytest.mark.slow
def test_a_prior_of_zero_is_never_left_and_samples_at_an_end_of_the_box_are_reported():
    half = found(SQUARE, log_prior=lambda v: np.where(v["root"] > 0, 0.0, -np.inf))
    assert half.weights.tolist() == [1.0] and half.samples["root"].min() > 0.0
    narrow = found(guess={"speed": 0.0}, spread=0.68)
    assert "at an end of the box of speed" in narrow.warnings[0] and "Warning" in str(narrow)


@dataclass(frozen=True)
class Bent(cj.extend.AbstractScale):
    """A scale that converts single numbers only."""

    max_step = math.inf

    def value(self, coordinate):
        return jax.lax.cond(coordinate > 0.0, lambda: 2.0 * coordinate, lambda: coordinate)

    def coordinate(self, value):
        return 0.5 * value if value > 0.0 else value


@pytest.mark.slow
def test_scales_need_not_accept_arrays():
    parameters = {
        "speed": cj.Parameter.initial(lambda s: s.bodies["ball"].velocity[0], Bent()),
        "delay": cj.Parameter.delay("x", scale=Bent()),
    }
    seen = []

    def log_prior(values):
        seen.append(values["speed"])
        return np.zeros(len(values["speed"]))

    result = found(parameters, log_prior=log_prior, spread=0.3, draws=64)
    u = result.coordinates
    np.testing.assert_array_equal(result.samples["speed"], 2.0 * u[:, 0])
    np.testing.assert_array_equal(result.samples["delay"], np.where(u > 0.0, 2.0 * u, u)[:, 1])
    assert all(row.min() > 0.0 for row in seen)


@pytest.mark.slow
def test_few_effective_runs_are_reported():
    result = found(draws=64)
    assert result.warnings == [] and result.effective_sample_size >= 64.0
    (warning,) = replace(result, effective_sample_size=20.0).warnings
    distinct = f"The points, {len(np.unique(result.coordinates))} of which are distinct, "
    assert warning == f"{distinct}come from only 20 effective runs: increase `draws`."


@pytest.mark.parametrize(("top", "even"), [(2.0, True), (1.5, False)])
def test_points_that_fill_the_box_evenly_are_reported(top, even):
    """The whole box, or three quarters of it."""
    result = found(draws=64)
    points = np.linspace(SPEED - WIDTH, SPEED - WIDTH + top * WIDTH, 64)
    warnings = replace(result, coordinates=points[:, None]).warnings
    filled = "The points fill the box of speed evenly: the data hardly determine it."
    assert [text.startswith(filled) for text in warnings] == ([True] if even else [])


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


@pytest.mark.slow
def test_a_prior_much_narrower_than_the_box_is_drawn_from():
    """The data hardly matter; formerly one point had all the weight."""
    width = 2e-3
    data = cj.Measurements({"x": cj.Series(CHANNEL, TIMES, SPEED * TIMES, noise=10.0)})
    for seed in (2, 9):
        result = found(
            data=data,
            log_prior=lambda v: -0.5 * ((v["speed"] - SPEED) / width) ** 2,
            draws=64,
            seed=seed,
        )
        assert result.means["speed"] == pytest.approx(SPEED, abs=0.5 * width)
        assert result.standard_deviations["speed"] == pytest.approx(width, rel=0.3)
        assert result.distinct > 50 and result.effective_sample_size > 64 and not result.warnings
        constant = -len(TIMES) * math.log(10.0 * math.sqrt(2 * math.pi))
        assert abs(result.log_evidence - constant) < 4.0 * result.log_evidence_error < 0.4


def test_a_prior_that_is_zero_almost_everywhere_is_reported():
    def log_prior(values):
        return np.where(np.abs(values["speed"] - SPEED) < 1e-4, 0.0, -np.inf)

    options = {"guess": {"speed": SPEED + 1e-3}, "log_prior": log_prior, "draws": 64}
    message = r"almost all points of the box .*\(finite at 0 of 4096 points\).*reduce `spread`"
    with pytest.raises(ValueError, match=message):
        found(**options, spread=1e-4)
    # The advice: a box that the prior fills in part.
    result = found(**(options | {"guess": {"speed": SPEED}}), spread=1e-3)
    assert np.abs(result.samples["speed"] - SPEED).max() < 1e-4


def test_runs_that_fail_are_impossible_and_counted():
    spring = cj.SpringDamper("ground", "ball", (0, 0, 0), (0, 0, 0), stiffness=100.0)
    scene = cj.Scene({"ball": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}, forces={"spring": spring})
    state = cj.State({"ball": cj.body_state((0.1, 0, 0))})
    stiffness = {"k": cj.Parameter(lambda s: s.forces["spring"].stiffness, cj.Log())}
    data = cj.Measurements({"x": cj.Series(CHANNEL, TIMES, 0.1 * np.cos(10 * TIMES), 0.2)})
    options = {"draws": 64, "spread": 3.0, "progress": False}
    free = cj.posterior(scene, state, data, stiffness, **options)
    few = replace(cj.presets.identification, max_steps=60)
    cut = cj.posterior(scene, state, data, stiffness, few, **options)
    assert free.failed == 0 and 0 < cut.failed < cut.runs
    assert f"{cut.failed} of which failed or are impossible" in str(cut)
    assert np.isfinite(cut.log_likelihood).all()
    assert cut.samples["k"].max() < free.samples["k"].max()
    none = replace(cj.presets.identification, max_steps=1)
    with pytest.raises(ValueError, match="All points are impossible.*runs failed.*`guess`"):
        cj.posterior(scene, state, data, stiffness, none, **options)


def test_equal_seeds_give_equal_bits_for_any_number_of_threads():
    results = []
    for threads, seed in ((1, 5), (2, 5), (2, 6)):
        cj.configure(threads=threads)
        results.append(found(draws=64, seed=seed))
    cj.configure()
    first, second, other = (one.coordinates for one in results)
    assert np.array_equal(first, second) and not np.array_equal(first, other)
    assert results[0].log_evidence == results[1].log_evidence


def test_the_result_is_exported():
    result = found(draws=64)
    table = result.to_dataframe()
    assert table.index.tolist() == ["speed"]
    az = pytest.importorskip("arviz")
    data = result.to_arviz()
    assert data["posterior"]["speed"].shape == (1, 64)
    assert data["posterior"].attrs["log_evidence"] == result.log_evidence
    assert data["posterior"].attrs["seed"] == 0 and data["sample_stats"]["mode"].shape == (1, 64)
    assert data["log_likelihood"]["record"].shape == (1, 64)
    assert az.summary(data).loc["speed", "mean"] == pytest.approx(result.means["speed"], abs=1e-3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"spread": 0.0}, "spread.*positive for each parameter.*possible error"),
        ({"spread": {"mass": 1.0}}, "spread.*mass.*name parameters: speed"),
        ({"draws": 3}, "draws.*a whole number from 32.*is 3"),
        ({"seed": -1}, "seed.*-1.*pass 0"),
        ({"guess": {"height": 1.0}}, "guess.*height.*name parameters: speed"),
        ({"log_prior": lambda values: 0.0}, r"log_prior.*of shape \(4096,\), but is \(\)"),
        ({"log_prior": lambda v: np.nan * v["speed"]}, "log_prior.*return -inf"),
        ({"start_time": 0.5}, "start_time.*0.5.*start earlier"),
        ({"parameters": {"speed": 3.0}}, "parameters.*a Parameter.*float"),
        ({"data": 3.0}, "measurements.*float.*pass cj.Measurements"),
    ],
)
def test_bad_input_is_named(options, message):
    with pytest.raises(ValueError, match="(?s)" + message):
        found(**options)


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


@pytest.mark.parametrize("seed", range(2))
def test_narrow_priors_have_the_posterior_and_the_evidence_of_the_closed_form(seed):
    result = narrow(seed, 100)
    assert np.abs(result.mean).max() < 0.5 and np.abs(result.size - 1.0).max() < 0.4
    assert abs(result.error) < 4.0 * result.stated < 0.6 and result.effective >= 100.0


@pytest.mark.slow
def test_intervals_and_evidence_of_narrow_priors_are_as_good_as_stated():
    results = [narrow(seed, 200) for seed in range(100)]
    ratios = np.array([one.error / one.stated for one in results])
    inside = np.concatenate([one.inside for one in results])
    means, sizes = (np.concatenate([getattr(one, n) for one in results]) for n in ("mean", "size"))
    print(f"\n{len(results)} narrow priors: 95 % intervals with the truth {inside.mean():.3f} of")
    print(
        f"{len(inside)}; errors of the log evidence over the stated ones: mean {ratios.mean():.2f},"
    )
    print(f"deviation {ratios.std():.2f}, within 1.96 {np.mean(np.abs(ratios) < 1.96):.2f};")
    print(f"largest error of a mean {np.abs(means).max():.2f}, deviations {sizes.min():.2f} to")
    print(f"{sizes.max():.2f}, of the posterior's deviation")
    assert 0.90 < inside.mean() < 0.99
    assert abs(ratios.mean()) < 0.35 and 0.75 < ratios.std() < 1.25
    assert np.abs(means).max() < 0.4 and sizes.min() > 0.7 and sizes.max() < 1.3
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
    assert level(curves, 0.5).tolist() == [0.5, 1.5]
    assert level(curves, 1.0).tolist() == [1.0, 3.0]
    assert level(curves, 1.5).tolist() == [2.5, np.inf]
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
