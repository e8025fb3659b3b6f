"""What measurements leave unexplained, as a function of the parameters' coordinates.

A run gives values and all their derivatives at once, error-controlled
(`clearjoint.simulation.sensitivities`).
`predictions` hands both to JAX by a rule of differentiation, so that `jax.linearize`, `jax.grad`
and every optimiser built on them see these derivatives at the cost of one run.

Runs of several lanes follow each other: with derivatives, lanes side by side under `jax.vmap` take
longer than one after the other (1.3 times with 8, 3 times with 50: they wait for each other at each
sample) and minutes to compile.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..fields.checks import require
from ..measurements.series import Measurements
from ..model.bodies import State
from ..model.scene import Scene
from ..parametrisation.parameter import PASS_PARAMETERS, Parameter, check_parameters
from ..parametrisation.parametrised_scene import ParametrisedScene, parametrised
from ..results import RESULTS
from ..simulation.batch.reductions import Quantity
from ..simulation.method import Scheme
from ..simulation.run_ends import default_first_step
from ..simulation.sensitivities import Sampled, check_outputs, padded, sampled_compiled
from ..simulation.settings import Integration
from ..simulation.spans import check_span, checked_times

UNREACHED = 1e6
"""Residual of a sample that the run did not reach, in standard deviations: an optimiser that comes
there turns back."""


class Experiment(eqx.Module):
    """Runs of a scene over its parameters, looked at where it is measured.

    `family` holds coordinates that nobody looks at. `times`: (T,) s, padded.
    """

    scheme: Scheme
    family: ParametrisedScene
    outputs: dict[str, Quantity]
    times: jax.Array
    start_time: jax.Array
    first_step: jax.Array
    max_steps: jax.Array
    names: tuple[str, ...] = eqx.field(static=True)

    def run(self, coordinates: Any, end_time: Any) -> Sampled:
        """The run at coordinates (p,), as far as a time, s."""
        return sampled_compiled(
            self.scheme,
            self.family.at(coordinates),
            self.outputs,
            self.times,
            self.start_time,
            jnp.asarray(end_time, float),
            self.first_step,
            self.max_steps,
        )


def experiment(
    scene: Scene,
    state: State,
    parameters: Mapping[str, Parameter],
    outputs: Mapping[str, Quantity],
    times: Any,
    start_time: float,
    integration: Integration | None,
) -> Experiment:
    """The runs of a scene over parameters, looked at by outputs at rising times, s."""
    check_parameters(parameters)
    require(len(parameters) > 0, "parameters", {}, "at least one Parameter", PASS_PARAMETERS)
    check_outputs(outputs, scene)
    integration = Integration() if integration is None else integration
    scheme = integration.scheme(scene, state, start_time)
    end_time = float(np.max(times))
    check_span(start_time, end_time)
    times = checked_times(start_time, end_time, times, "times")
    family = parametrised(scene, state, parameters, np.zeros(len(parameters)))
    return Experiment(
        scheme,
        family,
        dict(outputs),
        jnp.asarray(padded(times, end_time)),
        jnp.asarray(start_time, float),
        jnp.asarray(default_first_step(start_time, end_time), float),
        jnp.asarray(integration.max_steps, int),
        tuple(outputs),
    )


def check_start(start_time: float, times: np.ndarray) -> None:
    """Check that a run begins before the first of the rising times of samples, or with it."""
    expected = f"no later than the first sample, at {times[0]} s"
    remedy = "start earlier, or leave samples out: measurements.between(...)"
    require(bool(start_time <= times[0]), "start_time", start_time, expected, remedy)


@eqx.filter_custom_jvp
def predictions(coordinates: Any, runs: Experiment, end_time: Any) -> jax.Array:
    """The outputs (S, T) at all times, in the order of `runs.names`; NaN where the run did not
    come. Differentiable along the coordinates (p,)."""
    return _stacked(runs, runs.run(coordinates, end_time))[0]


@predictions.def_jvp
def _predictions_along(primals: Any, tangents: Any) -> Any:
    coordinates, runs, end_time = primals
    values, derivatives = _stacked(runs, runs.run(coordinates, end_time))
    return values, derivatives @ tangents[0]


def _stacked(runs: Experiment, found: Sampled) -> tuple[jax.Array, jax.Array]:
    """Values (S, T), NaN where there are none, and derivatives (S, T, p), zero there."""
    values = jnp.stack([found.values[name] for name in runs.names])
    derivatives = jnp.stack([found.derivatives[name] for name in runs.names])
    fine = found.reached & jnp.isfinite(values)
    derivatives = jnp.where(fine[..., None], derivatives, 0.0)
    return jnp.where(fine, values, jnp.nan), derivatives


class Samples(eqx.Module):
    """Measurements on the times of all series: `values` (S, T) and `weights` (S, T), one over the
    noise, or zero where a series has no sample. `periods` of the series, or ``None``."""

    values: np.ndarray
    weights: np.ndarray
    periods: tuple[float | None, ...] = eqx.field(static=True)

    @property
    def count(self) -> int:
        """Number of samples."""
        return int(np.count_nonzero(self.weights))

    def until(self, times: Any, end_time: float) -> "Samples":
        """The samples no later than a time."""
        inside = np.asarray(times)[: self.weights.shape[1]] <= end_time
        return Samples(self.values, np.where(inside, self.weights, 0.0), self.periods)

    def residuals(self, predicted: Any) -> jax.Array:
        """(Prediction - value) / noise, (S, T): zero without a sample, `UNREACHED` for NaN."""
        difference = predicted - self.values
        rows = [
            row if period is None else row - period * jnp.round(row / period)
            for row, period in zip(difference, self.periods, strict=True)
        ]
        weighted = jnp.stack(rows) * self.weights
        weighted = jnp.where(jnp.isnan(weighted), UNREACHED, weighted)
        return jnp.where(self.weights > 0.0, weighted, 0.0)


def samples(measurements: Measurements, count: int) -> Samples:
    """The series on the union of their times, padded to a number of times."""
    times = measurements.times()
    series = measurements.series.values()
    values, weights = np.zeros((2, len(series), count))
    for k, one in enumerate(series):
        at = np.searchsorted(times, one.times)
        values[k, at], weights[k, at] = one.values, 1.0 / one.noise
    return Samples(values, weights, tuple(one.period for one in series))


def residuals(coordinates: Any, runs: Experiment, data: Samples, end_time: Any) -> jax.Array:
    """What the data leave unexplained at coordinates (p,), in standard deviations, (S * T,).

    Differentiable along the coordinates.
    """
    return data.residuals(predictions(coordinates, runs, end_time)).ravel()


@dataclass(frozen=True)
class Evaluated:
    """Residuals (M,) and Jacobian (M, p) at coordinates (p,), and the run they come from: values
    `predicted` (S, T), result, end s, steps tried."""

    coordinates: np.ndarray
    residuals: np.ndarray
    jacobian: np.ndarray
    predicted: np.ndarray
    result: RESULTS
    time: float
    attempts: int

    @property
    def chi_squared(self) -> float:
        """Sum of the squared residuals."""
        return float(self.residuals @ self.residuals)


def evaluate(runs: Experiment, data: Samples, end_time: float, coordinates: Any) -> Evaluated:
    """`residuals` with their Jacobian, from one run."""
    found = runs.run(coordinates, end_time)
    values, jacobian = _weighted(runs, found, data)
    return Evaluated(
        np.array(coordinates, float),
        *(np.asarray(part) for part in (values, jacobian)),
        np.stack([np.asarray(found.values[name]) for name in runs.names]),
        found.result,
        float(found.time),
        int(found.attempts),
    )


@eqx.filter_jit
def _weighted(runs: Experiment, found: Sampled, data: Samples) -> tuple[jax.Array, jax.Array]:
    values, derivatives = _stacked(runs, found)
    jacobian = derivatives * data.weights[..., None]
    return data.residuals(values).ravel(), jacobian.reshape(-1, jacobian.shape[-1])
