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

import clearjoint as cj
from tests.support.oscillator import on_spring

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


@pytest.fixture(scope="module")
def drawn():
    return found(draws=64)


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
    means = [float(equal.coordinates[equal.modes == k].mean()) for k in (0, 1)]
    assert sorted(means) == pytest.approx([-0.8, 0.8], abs=0.05)
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


def test_few_effective_runs_are_reported(drawn):
    assert drawn.warnings == [] and drawn.effective_sample_size >= 64.0
    (warning,) = replace(drawn, effective_sample_size=20.0).warnings
    distinct = f"The points, {len(np.unique(drawn.coordinates))} of which are distinct, "
    assert warning == f"{distinct}come from only 20 effective runs: increase `draws`."


@pytest.mark.parametrize(("top", "even"), [(2.0, True), (1.5, False)])
def test_points_that_fill_the_box_evenly_are_reported(drawn, top, even):
    """The whole box, or three quarters of it."""
    points = np.linspace(SPEED - WIDTH, SPEED - WIDTH + top * WIDTH, 64)
    warnings = replace(drawn, coordinates=points[:, None]).warnings
    filled = "The points fill the box of speed evenly: the data hardly determine it."
    assert [text.startswith(filled) for text in warnings] == ([True] if even else [])


@pytest.mark.slow
def test_a_prior_much_narrower_than_the_box_is_drawn_from():
    """The data hardly matter; formerly one point had all the weight."""
    width = 2e-3
    data = cj.Measurements({"x": cj.Series(CHANNEL, TIMES, SPEED * TIMES, noise=10.0)})

    def log_prior(values):
        return -0.5 * ((values["speed"] - SPEED) / width) ** 2

    for seed in (2, 9):
        result = found(data=data, log_prior=log_prior, draws=64, seed=seed)
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


@pytest.mark.slow
def test_runs_that_fail_are_impossible_and_counted():
    scene, state = on_spring()
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


def test_equal_seeds_give_equal_bits_for_any_number_of_threads(drawn):
    results = []
    for threads in (1, 2):
        cj.configure(threads=threads)
        results.append(found(draws=64, seed=5))
    cj.configure()
    first, second = results
    assert np.array_equal(first.coordinates, second.coordinates)
    assert first.log_evidence == second.log_evidence
    assert not np.array_equal(first.coordinates, drawn.coordinates)


def test_the_result_is_exported(drawn):
    table = drawn.to_dataframe()
    assert table.index.tolist() == ["speed"]
    az = pytest.importorskip("arviz")
    data = drawn.to_arviz()
    assert data["posterior"]["speed"].shape == (1, 64)
    assert data["posterior"].attrs["log_evidence"] == drawn.log_evidence
    assert data["posterior"].attrs["seed"] == 0 and data["sample_stats"]["mode"].shape == (1, 64)
    assert data["log_likelihood"]["record"].shape == (1, 64)
    assert az.summary(data).loc["speed", "mean"] == pytest.approx(drawn.means["speed"], abs=1e-3)


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
