"""A friction law learned as a network from coast-downs of a crank-rocker.

The pin "crank foot" has clearance and Stribeck friction. The crank is let go at three speeds, and
its centre is measured with noise. A network of 321 weights in place of the law is fitted to the
three records, and predicts the coast-down from a fourth speed.
"""

import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from itertools import count
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import optax
from jaxtyping import Float
from matplotlib.figure import Figure
from typing_extensions import override

import clearjoint as cj
from clearjoint.testing import optimise_programs

PIN, SPEEDS, HELD_OUT = "crank foot", (0.0, 12.0, 25.0), 18.0
"""Speeds of the crank at the start, rad/s."""
NOISE, SAMPLES = 5e-6, 100
"""Standard deviation of the noise, m, and number of samples of a record."""
SETTINGS = replace(cj.presets.derivatives, rtol=1e-7)
UNIT_SPEED = 0.01
"""Slip speed, m/s, far below which the network's input is proportional to the speed, and far above
to its logarithm, since friction changes most at low speeds."""


class Stribeck(cj.extend.AbstractFriction):
    """The law to be found."""

    @override
    def ratio(self, slip_speed):
        excess = 0.12 * jnp.exp(-((slip_speed / 0.08) ** 2))
        return (0.08 + excess + 0.1 * slip_speed) * jnp.tanh(slip_speed / 5e-3)


class NeuralFriction(cj.extend.AbstractFriction):
    """The ratio of friction to normal force as a network of the slip speed."""

    network: eqx.nn.MLP

    @override
    def ratio(self, slip_speed):
        change = self.network(jnp.log1p(jnp.asarray(slip_speed) / UNIT_SPEED)[None])
        return 0.1 * (1.0 + change) * jnp.tanh(slip_speed / 5e-3)


def crank_rocker(friction: cj.extend.AbstractFriction, speed: float) -> tuple[cj.Scene, cj.State]:
    """Return the mechanism with a bushing of 0.1 mm clearance."""
    law = cj.laws.LankaraniNikravesh(restitution=0.5, stiffness=2e7)
    return cj.mechanisms.four_bar(
        {PIN: 1e-4}, speed=speed, law=law, friction=friction, bearing_radius=0.012
    )


class Record(NamedTuple):
    """Measured positions of the crank's centre, (N,) m each, at times, (N,) s."""

    speed: float
    times: Float[np.ndarray, " N"]
    positions: dict[str, Float[np.ndarray, " N"]]


POSITIONS = {axis: cj.quantities.Position("crank", axis) for axis in ("x", "y")}


def record(speed: float, end: float, random: np.random.Generator | None) -> Record:
    """Return the positions at a start with a speed, with noise if there is a random generator."""
    scene, state = crank_rocker(Stribeck(), speed)
    times = np.linspace(0.0, end, SAMPLES + 1)[1:]
    save = cj.Saving(times)
    run = cj.simulate(scene, state, end, SETTINGS, save, outputs=POSITIONS, progress=False)
    noise = {axis: 0.0 if random is None else random.normal(0, NOISE, SAMPLES) for axis in "xy"}
    return Record(speed, times, {axis: run.outputs[axis] + noise[axis] for axis in "xy"})


def predictor_of(network: eqx.nn.MLP, measured: Record) -> cj.Predictor:
    """Return the positions at the times of a record as a function of the weights."""
    scene, state = crank_rocker(NeuralFriction(network), measured.speed)
    paths = {"network": lambda scene: scene.joints[PIN].friction.network}
    times = measured.times
    return cj.predictor(scene, state, float(times[-1]), paths, POSITIONS, times, SETTINGS)


def residuals(predicted: Mapping[str, jax.Array], measured: Record) -> jax.Array:
    """Return differences in standard deviations of the noise, (2 N,)."""
    return jnp.concatenate([(predicted[a] - measured.positions[a]) / NOISE for a in "xy"])


class Fit(NamedTuple):
    """Misfit, mean square of the residuals, after each iteration; the trained network; the
    root mean square of the prediction's error at the held-out speed, m, before and after; and
    times, s, of a plain run, and of value and gradient of three runs."""

    misfits: list[float]
    network: eqx.nn.MLP
    held_out: tuple[float, float]
    plain: float
    gradient: float
    seconds: float


def measure(quick: bool) -> Fit:
    """Fit the network to the records."""
    begun, random = time.process_time(), np.random.default_rng(1)
    speeds, end, iterations = (SPEEDS[:1], 0.1, 3) if quick else (SPEEDS, 0.4, 200)
    network = eqx.nn.MLP(1, "scalar", 16, 2, jax.nn.tanh, key=jax.random.key(0))
    records = [record(speed, end, random) for speed in speeds]
    predictors = [predictor_of(network, measured) for measured in records]

    def misfit(values: dict) -> jax.Array:
        runs = [predict(values) for predict in predictors]
        pairs = zip(runs, records, strict=True)
        return jnp.mean(jnp.concatenate([residuals(*pair) ** 2 for pair in pairs]))

    values, misfits = predictors[0].values, []
    rate = optax.cosine_decay_schedule(2e-2, iterations, 0.01)
    optimiser, gradient = optax.adam(rate), jax.value_and_grad(misfit)
    memory = optimiser.init(values)
    for _ in range(iterations):
        value, slopes = gradient(values)
        misfits.append(float(value))
        change, memory = optimiser.update(slopes, memory, values)
        values = optax.apply_updates(values, change)
    trained = eqx.combine(values["network"], network)
    expected = record(HELD_OUT, end, None)
    errors = []
    for candidate in (network, trained):
        found = predictor_of(candidate, expected)
        rows = residuals(found(found.values), expected) * NOISE
        errors.append(float(jnp.sqrt(jnp.mean(rows**2))))
    seconds = time.process_time() - begun
    costs = timed(predictors[-1], records[-1].speed, end)
    return Fit(misfits, trained, (errors[0], errors[1]), *costs, seconds)


def timed(predict: cj.Predictor, speed: float, end: float) -> tuple[float, float]:
    """Return the processor times, s, of a plain run, and of value and gradient of one."""
    scene, state = crank_rocker(NeuralFriction(network_of(predict)), speed)
    gradient = jax.value_and_grad(lambda values: jnp.sum(predict(values)["x"]))
    rounds = count(1)

    def value_and_gradient() -> None:
        # Runs of values that were computed before are kept.
        share = 1.0 + 1e-9 * next(rounds)
        gradient(jax.tree.map(lambda leaf: leaf * share, predict.values))

    calls = [partial(cj.simulate, scene, state, end, SETTINGS, progress=False), value_and_gradient]
    times = []
    for call in calls:
        call()
        optimise_programs()
        begun = time.process_time()
        for _ in range(5):
            call()
        times.append((time.process_time() - begun) / 5)
    return times[0], times[1]


def network_of(predict: cj.Predictor) -> eqx.nn.MLP:
    """Return the network with the weights that a predictor was made with."""
    template = eqx.nn.MLP(1, "scalar", 16, 2, jax.nn.tanh, key=jax.random.key(0))
    return eqx.combine(predict.values["network"], template)


def table(fit: Fit) -> list[tuple[str, ...]]:
    """Return rows of quantity and value."""
    first, last = fit.misfits[0], fit.misfits[-1]
    before, after = fit.held_out
    weights = sum(leaf.size for leaf in jax.tree.leaves(eqx.filter(fit.network, eqx.is_array)))
    return [
        ("weights", f"{weights}"),
        ("iterations", f"{len(fit.misfits)}"),
        (
            "mean square of the residuals, first → last",
            f"{first:.3g} → {last:.3g}",
        ),
        ("error at the held-out speed, before → after", f"{before:.2g} → {after:.2g} m"),
        ("value and gradient, in plain runs", f"{fit.gradient / fit.plain:.1f}"),
        ("all", f"{fit.seconds:.0f} s"),
    ]


def figure(fit: Fit) -> Figure:
    """Draw the curve of friction and the misfit."""
    drawn, (curve, history) = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    speeds = jnp.linspace(0.0, 0.45, 200)
    learned = jax.vmap(NeuralFriction(fit.network).ratio)(speeds)
    curve.plot(speeds, jax.vmap(Stribeck().ratio)(speeds), "k--", label="true")
    curve.plot(speeds, learned, label="network")
    curve.set(xlabel="slip speed, m/s", ylabel="friction / normal force", ylim=(0, 0.25))
    curve.legend()
    history.semilogy(fit.misfits)
    history.axhline(1.0, color="grey", linestyle=":", label="noise")
    history.set(xlabel="iteration", ylabel="mean square of residuals")
    history.legend()
    return drawn
