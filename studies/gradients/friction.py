"""A friction law learned as a network from coast-downs of a crank-rocker.

The pin "crank foot" has clearance and Stribeck friction. The crank is let go at three speeds, and
its centre is measured with noise. A network of 321 weights in place of the law is fitted to the
three records by the method of Levenberg and Marquardt, and predicts the coast-down from a fourth
speed.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import count

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import ArrayLike, Float, PyTree
from matplotlib.figure import Figure
from typing_extensions import override

import clearjoint as cj
from clearjoint.extend import Instant, norm_and_direction
from clearjoint.plot import style
from clearjoint.testing import optimise_programs

PIN, ANGLE, SPEEDS, HELD_OUT = "crank foot", -0.9, (0.0, 9.0, 22.0), 12.0
"""Angle, rad, and speeds of the crank at the start, rad/s.

From 0 and 9 rad/s it swings about its lowest position, so that the slip passes through all low
speeds; from 22 rad/s it turns round. Near 15 rad/s it would almost stop at its highest position.
"""
END, WINDOWS = 0.6, (1 / 3, 1 / 2, 2 / 3, 5 / 6, 1.0)
"""Length of a record, s, and the parts of it that are fitted one after the other: with a law that
is not yet right, only the first impacts are predicted."""
NOISE, SAMPLES = 5e-6, 24
"""Standard deviation of the noise, m, and number of samples of a record."""
SETTINGS = replace(cj.presets.derivatives, rtol=1e-7)
UNIT_SPEED, CENTRE = 0.01, 1.9
"""Slip speed, m/s, far below which the network's input is proportional to the speed, and far above
to its logarithm, since friction changes most at low speeds; and middle of that input's range."""
REGULARISATION = 5e-3
"""Speed below which friction vanishes, m/s. It is not learned."""
WEIGHT = 1.0
"""Standard deviation of a weight before the fit: without a prior, the records would not determine
all weights."""
PROMISE, ITERATIONS, TRIALS = 0.02, 8, 10
"""A window is fitted when the linear model promises less than this decrease of the mean square of
the residuals, or after so many iterations, each with at most so many trials of a damping."""


class Stribeck(cj.extend.AbstractFriction):
    """The law to be found."""

    @override
    def ratio(self, slip_speed):
        excess = 0.12 * jnp.exp(-((slip_speed / 0.08) ** 2))
        return (0.08 + excess + 0.1 * slip_speed) * jnp.tanh(slip_speed / REGULARISATION)


class NeuralFriction(cj.extend.AbstractFriction):
    """The ratio of friction to normal force as a network of the slip speed."""

    network: eqx.nn.MLP

    @override
    def ratio(self, slip_speed):
        place = jnp.log1p(jnp.asarray(slip_speed) / UNIT_SPEED) - CENTRE
        change = self.network(place[None])
        return 0.1 * (1.0 + change) * jnp.tanh(slip_speed / REGULARISATION)


# Made when the study runs: before `cj.configure`, JAX makes arrays of single precision.
@cache
def first_network() -> eqx.nn.MLP:
    """Return the network before the fit."""
    return eqx.nn.MLP(1, "scalar", 16, 2, jax.nn.tanh, key=jax.random.key(0))


@cache
def flattened() -> tuple[jax.Array, Callable[[jax.Array], PyTree]]:
    """Return the weights of the network before the fit, (p,), and the function that gives weights,
    (p,), the form of the network's."""
    return ravel_pytree(eqx.filter(first_network(), eqx.is_inexact_array))


def values_of(weights: ArrayLike) -> dict[str, PyTree]:
    """Return weights, (p,), as a predictor takes them."""
    return {"network": flattened()[1](jnp.asarray(weights))}


def friction_of(weights: ArrayLike) -> NeuralFriction:
    """Return the law of weights, (p,)."""
    return NeuralFriction(eqx.combine(values_of(weights)["network"], first_network()))


def crank_rocker(friction: cj.extend.AbstractFriction, speed: float) -> tuple[cj.Scene, cj.State]:
    """Return the mechanism with a bushing of 0.1 mm clearance."""
    law = cj.laws.LankaraniNikravesh(restitution=0.5, stiffness=2e7)
    return cj.mechanisms.four_bar(
        {PIN: 1e-4}, angle=ANGLE, speed=speed, law=law, friction=friction, bearing_radius=0.012
    )


@dataclass(frozen=True)
class Record:
    """Measured positions of the crank's centre, (N,) m each, at times, (N,) s."""

    speed: float
    times: Float[np.ndarray, " N"]
    positions: dict[str, Float[np.ndarray, " N"]]

    def until(self, end: float) -> "Record":
        """Return the part up to a time."""
        chosen = self.times <= end
        return Record(
            self.speed, self.times[chosen], {a: p[chosen] for a, p in self.positions.items()}
        )


POSITIONS = {axis: cj.quantities.Position("crank", axis) for axis in ("x", "y")}


def record(speed: float, end: float, samples: int, random: np.random.Generator | None) -> Record:
    """Return the positions at a start with a speed, with noise if there is a random generator."""
    scene, state = crank_rocker(Stribeck(), speed)
    times = np.linspace(0.0, end, samples + 1)[1:]
    save = cj.Saving(times)
    run = cj.simulate(scene, state, end, SETTINGS, save, outputs=POSITIONS, progress=False)
    noise = {axis: 0.0 if random is None else random.normal(0, NOISE, samples) for axis in "xy"}
    return Record(speed, times, {axis: run.outputs[axis] + noise[axis] for axis in "xy"})


def slip(now: Instant) -> jax.Array:
    """Return the slip speed at one end of the pin, m/s."""
    velocity = now.contacts[PIN]["V"].contact.slip
    assert velocity is not None  # the pin has friction
    return jnp.asarray(norm_and_direction(velocity)[0])


def loaded_slips(speeds: Sequence[float], end: float) -> Float[np.ndarray, " N"]:
    """Return slip speeds, m/s, at evenly spaced times of all coast-downs at which the pin is in
    contact."""
    found, outputs = [], {"slip": slip, "force": cj.quantities.ContactForce(PIN, "V")}
    for speed in speeds:
        scene, state = crank_rocker(Stribeck(), speed)
        save = cj.Saving(np.linspace(0.0, end, 2001))
        run = cj.simulate(scene, state, end, SETTINGS, save, outputs=outputs, progress=False)
        found.append(np.asarray(run.outputs["slip"])[np.asarray(run.outputs["force"]) > 0.0])
    return np.concatenate(found)


def predictor_of(measured: Record) -> cj.Predictor:
    """Return the positions at the times of a record as a function of the weights."""
    scene, state = crank_rocker(NeuralFriction(first_network()), measured.speed)
    paths = {"network": lambda scene: scene.joints[PIN].friction.network}
    times = measured.times
    return cj.predictor(scene, state, float(times[-1]), paths, POSITIONS, times, SETTINGS)


def residuals(predicted: Mapping[str, jax.Array], measured: Record) -> jax.Array:
    """Return differences in standard deviations of the noise, (2 N,)."""
    return jnp.concatenate([(predicted[a] - measured.positions[a]) / NOISE for a in "xy"])


@dataclass(frozen=True)
class Problem:
    """Residuals of records as functions of the weights, (p,)."""

    records: Sequence[Record]

    @cached_property
    def predictors(self) -> list[cj.Predictor]:
        """Positions of each record as a function of the weights."""
        return [predictor_of(measured) for measured in self.records]

    def residuals(self, weights: Float[np.ndarray, " p"]) -> Float[np.ndarray, " N"]:
        """Return the residuals, NaN for weights with which no run is possible."""
        values = values_of(weights)
        pairs = zip(self.predictors, self.records, strict=True)
        return np.concatenate([residuals(predict.or_nan(values), r) for predict, r in pairs])

    def jacobian(self, weights: Float[np.ndarray, " p"]) -> Float[np.ndarray, "N p"]:
        """Return the derivatives of the residuals, by one gradient in reverse mode for each."""

        def of_record(predict: cj.Predictor, measured: Record) -> Callable:
            return lambda flat: residuals(predict(values_of(flat)), measured)

        pairs = zip(self.predictors, self.records, strict=True)
        return np.concatenate(
            [jax.jacrev(of_record(*pair))(jnp.asarray(weights)) for pair in pairs]
        )


@dataclass(frozen=True)
class Point:
    """Weights, (p,), their residuals, and `normal`, (p, p), the inverse of the covariance of the
    weights by the linear model."""

    weights: Float[np.ndarray, " p"]
    residuals: Float[np.ndarray, " N"]
    normal: Float[np.ndarray, "p p"]

    @property
    def misfit(self) -> float:
        """Mean square of the residuals."""
        return float(np.mean(self.residuals**2))


def fitted(problem: Problem, start: Float[np.ndarray, " p"], iterations: int) -> list[Point]:
    """Return the points of a search by the method of Levenberg and Marquardt."""
    weights, found, damping, points = start, problem.residuals(start), 1.0, []
    identity, first = np.eye(len(start)), np.asarray(flattened()[0])

    def cost(weights: np.ndarray, found: np.ndarray) -> float:
        return float(found @ found + np.sum(((weights - first) / WEIGHT) ** 2))

    for _ in range(iterations + 1):
        slopes = problem.jacobian(weights)
        normal = slopes.T @ slopes + identity / WEIGHT**2
        descent = -(slopes.T @ found + (weights - first) / WEIGHT**2)
        points.append(Point(weights, found, normal))
        promised = descent @ np.linalg.solve(normal, descent)
        if promised < PROMISE * len(found) or len(points) > iterations:
            break
        before = cost(weights, found)
        for _ in range(TRIALS):
            step = np.linalg.solve(normal + damping * identity, descent)
            tried = problem.residuals(weights + step)
            decrease = before - cost(weights + step, tried)
            if decrease > 0.0:  # neither where no run is possible
                break
            damping *= 4.0
        else:
            break
        if decrease > 0.5 * (2.0 * descent @ step - step @ normal @ step):
            damping *= 0.1
        weights, found = weights + step, tried
    return points


@dataclass(frozen=True)
class Fit:
    """The search and what it found.

    - `windows`: points of the search in each of the growing windows.
    - `slips`: slip speeds of the records under load, m/s.
    - `held_out`: coast-down from the held-out speed, without noise; `before`, `after`: predictions
      of the first and of the last weights.
    - `plain`, `gradient`: processor times of a plain run, and of value and gradient, s; `seconds`:
      of the fit.
    """

    windows: list[list[Point]]
    slips: Float[np.ndarray, " slips"]
    held_out: Record
    before: dict[str, np.ndarray]
    after: dict[str, np.ndarray]
    plain: float
    gradient: float
    seconds: float

    @property
    def last(self) -> Point:
        """Point at the end of the search."""
        return self.windows[-1][-1]

    @property
    def held(self) -> tuple[float, float]:
        """Slip speeds between which 98 % of those under load lie, m/s."""
        return float(np.quantile(self.slips, 0.01)), float(np.quantile(self.slips, 0.99))

    def errors(self, predicted: dict[str, np.ndarray]) -> Float[np.ndarray, " N"]:
        """Return the distances of predicted positions from those at the held-out speed, m."""
        x, y = (predicted[axis] - self.held_out.positions[axis] for axis in "xy")
        return np.hypot(x, y)


def measure(quick: bool) -> Fit:
    """Fit the network to the records."""
    begun, random = time.process_time(), np.random.default_rng(1)
    speeds, end, samples = (SPEEDS[:1], 0.1, 4) if quick else (SPEEDS, END, SAMPLES)
    shares, iterations = (WINDOWS[-1:], 1) if quick else (WINDOWS, ITERATIONS)
    records = [record(speed, end, samples, random) for speed in speeds]
    windows, weights = [], np.asarray(flattened()[0])
    for share in shares:
        problem = Problem([r.until((share + 1e-9) * end) for r in records])
        windows.append(fitted(problem, weights, iterations))
        weights = windows[-1][-1].weights
    seconds = time.process_time() - begun
    held_out = record(HELD_OUT, end, 10 * samples, None)
    predict = predictor_of(held_out)
    both = [
        {axis: np.asarray(p) for axis, p in predict(values_of(w)).items()}
        for w in (flattened()[0], weights)
    ]
    return Fit(
        windows,
        loaded_slips(speeds, end),
        held_out,
        both[0],
        both[1],
        *timed(predict, end),
        seconds,
    )


def timed(predict: cj.Predictor, end: float) -> tuple[float, float]:
    """Return the processor times, s, of a plain run, and of value and gradient of one."""
    scene, state = crank_rocker(NeuralFriction(first_network()), HELD_OUT)
    both = jax.value_and_grad(lambda values: jnp.sum(predict(values)["x"]))
    rounds = count(1)

    def run() -> None:
        cj.simulate(scene, state, end, SETTINGS, progress=False)

    def value_and_gradient() -> None:
        # Runs of values that were computed before are kept.
        share = 1.0 + 1e-9 * next(rounds)
        both(jax.tree.map(lambda leaf: leaf * share, predict.values))

    times = []
    for call in (run, value_and_gradient):
        call()
        optimise_programs()
        begun = time.process_time()
        for _ in range(5):
            call()
        times.append((time.process_time() - begun) / 5)
    return times[0], times[1]


def ratios(
    friction: cj.extend.AbstractFriction, speeds: Float[np.ndarray, " N"]
) -> Float[np.ndarray, " N"]:
    """Return a law's ratios of friction to normal force at slip speeds, m/s."""
    return np.asarray(jax.vmap(friction.ratio)(jnp.asarray(speeds)))


def deviations(point: Point, speeds: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
    """Return standard deviations of the learned ratios at slip speeds by the linear model."""

    def learned(flat: jax.Array) -> jax.Array:
        return jax.vmap(friction_of(flat).ratio)(jnp.asarray(speeds))

    slopes = np.asarray(jax.jacrev(learned)(jnp.asarray(point.weights)))
    return np.sqrt(np.sum(slopes * np.linalg.solve(point.normal, slopes.T).T, axis=1))


def table(fit: Fit) -> list[tuple[str, ...]]:
    """Return rows of quantity and value."""
    speeds = np.geomspace(*fit.held, 400)
    true, before, after = (
        ratios(law, speeds)
        for law in (Stribeck(), friction_of(flattened()[0]), friction_of(fit.last.weights))
    )
    first, last = (1e6 * np.sqrt(np.mean(fit.errors(p) ** 2)) for p in (fit.before, fit.after))
    iterations = sum(len(points) - 1 for points in fit.windows)
    return [
        ("weights", f"{len(fit.last.weights)}"),
        ("iterations", f"{iterations}"),
        (
            "mean square of the residuals, first → last",
            f"{fit.windows[0][0].misfit:.3g} → {fit.last.misfit:.3g}",
        ),
        ("slip speeds that the records hold", f"{fit.held[0]:.2g} to {fit.held[1]:.2g} m/s"),
        (
            "largest error of the law there, before → after",
            f"{np.abs(before - true).max():.2g} → {np.abs(after - true).max():.2g}",
        ),
        (
            "its peak, true; before → after",
            f"{true.max():.3f}; {before.max():.3f} → {after.max():.3f}",
        ),
        ("error at the held-out speed, before → after", f"{first:.3g} → {last:.2g} µm"),
        ("value and gradient, in plain runs", f"{fit.gradient / fit.plain:.1f}"),
        ("processor time of the fit", f"{fit.seconds:.0f} s"),
    ]


def figure(fit: Fit) -> Figure:
    """Draw the laws, and the errors of the predictions at the held-out speed."""
    drawn = Figure(figsize=(10.0, 4.0), layout="constrained")
    left, right = drawn.subplots(1, 2)
    speeds = np.geomspace(5e-4, 2.0, 400)
    laws = {
        "true": (Stribeck(), "k", "--"),
        "before": (friction_of(flattened()[0]), style.VERMILLION, "-"),
        "after": (friction_of(fit.last.weights), style.BLUE, "-"),
    }
    for name, (law, colour, dashes) in laws.items():
        left.semilogx(speeds, ratios(law, speeds), color=colour, linestyle=dashes, label=name)
    after, spread = ratios(laws["after"][0], speeds), 2.0 * deviations(fit.last, speeds)
    left.fill_between(
        speeds, after - spread, after + spread, color=style.SKY, alpha=0.5,
        label="± 2 standard deviations", linewidth=0.0,
    )  # fmt: skip
    left.axvspan(*fit.held, color=style.GREY, alpha=0.2, label="slip speeds of the records")
    left.set_ylim(0.0, 0.3)
    left.legend(loc="upper left", fontsize="small")
    style.dress(left, "slip speed, m/s", "friction / normal force")
    cases = (("before", fit.before, style.VERMILLION), ("after", fit.after, style.BLUE))
    for name, predicted, colour in cases:
        right.semilogy(fit.held_out.times, 1e6 * fit.errors(predicted), color=colour, label=name)
    right.axhline(1e6 * NOISE, color=style.GREY, linestyle=":", label="noise of the records")
    right.legend()
    style.dress(right, "time, s", f"error from {HELD_OUT:g} rad/s, µm")
    return drawn
