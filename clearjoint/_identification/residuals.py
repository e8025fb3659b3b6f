"""Residuals, (prediction - measurement) / noise, as functions of the parameters' coordinates.

Runs at several coordinates are made one after the other. With derivatives, a `jax.vmap` of them
would take longer (1.3 times with 8 runs, 3 times with 50), because the runs wait for each other at
each sample, and would take minutes to compile.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._compilation.xla import Compiled
from .._fields.checks import require
from .._fields.objects import on_device
from .._fields.types import ArrayLike
from .._information.fisher_information import covariance
from .._math.smoothing import wrapped
from .._math.vectors import Scalar
from .._measurements.series import Measurements
from .._model.bodies import State
from .._model.scene import Scene
from .._parametrisation import readings as sensor_readings
from .._parametrisation.parameter import (
    Parameter,
    check_parameters,
    coordinates_of,
    free_parameters,
)
from .._parametrisation.parametrised_scene import parametrised
from .._parametrisation.readings import NO_ERRORS, SensorErrors, in_scene, sensor_errors
from .._result_codes import RESULTS
from .._simulation.run.outputs import EXAMPLE, RECORDED, requested_by
from .._simulation.run.run_checks import derivative_scheme
from .._simulation.run.sampling import Sampled, TangentRun, sampled
from .._simulation.step import presets
from .._simulation.step.settings import (
    Settings,
    check_span,
    checked_times,
    rising_times,
    settings_or,
)
from ..quantities.base import Quantity

APART = 1e-7
"""Half the interval, s, of the central difference that gives the rate of a delayed output: short
compared with the duration of a contact, long compared with the rounding of times."""
NO_RECORDERS = requested_by(None, None).recorders()
"""The recorders of a run of `sensitivities` that records no outputs, whose compiled programs a fit
shares by passing the same recorders."""
UNREACHED = 1e6
"""Residual of a sample that the run did not reach: an optimiser rejects the step."""


class Experiment(eqx.Module):
    """A scene with p parameters and measured quantities, to be run for many parameter values by one
    compiled program.

    - `base`: the run to the last sample; the method `run` replaces the parameters' coordinates in
      it. Its `outputs` are the measured quantities of the series. Its `times` are the sample times,
      s, of which the last one is repeated until their number is 64, 512, 4096 and so on, so that
      records of similar length share a program.
    - `names`: those of the series, in their order.
    - `sensors`: errors of the sensors, such as a delay, that are parameters.
    - `free`: indices of the parameters that are not `held`; ``None`` if none is held.
    - `whole`: coordinates (p,) of all parameters, of which only those of held parameters are used;
      ``None`` if none is held.
    """

    base: TangentRun
    names: tuple[str, ...] = eqx.field(static=True)
    sensors: SensorErrors = NO_ERRORS
    free: tuple[int, ...] | None = eqx.field(static=True, default=None)
    whole: np.ndarray | None = None

    def with_held(self, coordinates: ArrayLike) -> np.ndarray:
        """Return coordinates (..., p) of all parameters from those of the free parameters."""
        of_free = np.asarray(coordinates)
        if self.free is None or self.whole is None:
            return of_free
        of_all = np.broadcast_to(self.whole, (*of_free.shape[:-1], len(self.whole))).copy()
        of_all[..., self.free] = of_free
        return of_all

    def run(self, coordinates: ArrayLike, end_time: Scalar) -> Sampled:
        """Run the scene at coordinates of the free parameters, and return readings of the sensors.

        Readings later than `end_time`, s, are meaningless. An output with a delay is evaluated at
        `times` minus the delay, but not before the start of the run; with a negative delay, the run
        ends later than `end_time`. If the run fails, readings at times that it does not reach are
        meaningless and `reached` is false there; with delays, these readings are NaN and `reached`
        is true everywhere.
        """
        of_all, end_time = on_device(self.with_held(coordinates)), on_device(end_time)
        delayed = _instants(self, of_all, end_time) if self.sensors.delays else None
        # Every output is evaluated at all times of `delayed`, whatever its delay.
        base = self.base
        times, end = (base.times, end_time) if delayed is None else (delayed.times, delayed.end)
        run = sampled(replace(base, family=base.family.at(of_all), times=times, end_time=end))
        if delayed is not None:
            run = _delayed(self, of_all, delayed, run)
        # The other errors of sensors, such as a bias, change the reading at a given time.
        if self.sensors.of_values:
            elapsed = base.times - base.start_time
            readings, slopes = sensor_readings.with_sensor_errors(
                self.sensors, run.values, run.derivatives, elapsed, of_all
            )
            run = replace(run, values=readings, derivatives=slopes)
        if self.free is None:
            return run
        # The run has the derivatives by all parameters. Those by held ones are left out.
        free = list(self.free)
        slopes = {name: np.asarray(rows)[:, free] for name, rows in run.derivatives.items()}
        return replace(run, derivatives=slopes)


class _Instants(NamedTuple):
    """Times at which a run with D delays is sampled, for T sample times.

    - `times`: all these times, rising, ((1 + 3 D) T,) s. `end`: end of the run, s.
    - `indices`: indices in `times`, (1 + 3 D, T), in a row for the times without delay and, for
      each delay, in three rows for the delayed times and those `APART` earlier and later.
    - `inside`: whether each delayed time is at or after the start, (D, T).
    """

    times: jax.Array
    end: jax.Array
    indices: jax.Array
    inside: jax.Array


@Compiled
def _instants(runs: Experiment, coordinates: jax.Array, end_time: jax.Array) -> _Instants:
    # Value of each delay, s; `index` is that of its parameter.
    delays = [runs.sensors.value(index, coordinates) for index, _ in runs.sensors.delays]
    # A series with a negative delay is compared with the motion after its sample times, so that the
    # run must last longer than to the last sample.
    end = end_time + jnp.maximum(0.0, -jnp.min(jnp.stack(delays)))
    # Samples after the end time have no weight. Their times are replaced by the end time, because
    # the run does not reach them.
    undelayed = jnp.minimum(runs.base.times, end_time)
    rows, inside = [undelayed], []
    for delay in delays:
        delayed = undelayed - delay
        inside.append(delayed >= runs.base.start_time)
        # The two neighbours of a delayed time give the rate of the output, by a central difference.
        # The run has no motion before its start and after its end.
        rows += [
            jnp.clip(delayed + shift, runs.base.start_time, end) for shift in (0.0, -APART, APART)
        ]
    unsorted = jnp.concatenate(rows)
    order = jnp.argsort(unsorted)
    # Sorting a permutation gives its inverse: the index of each time in the sorted array.
    indices = jnp.argsort(order).reshape(len(rows), -1)
    return _Instants(unsorted[order], end, indices, jnp.stack(inside))


@Compiled
def _delayed(
    runs: Experiment, coordinates: jax.Array, instants: _Instants, sampled: Sampled
) -> Sampled:
    """Return the run `sampled`, which has all outputs at all `instants`, with each output only at
    the T sample times minus its own delay. In the result, outputs are NaN at times that the run did
    not reach, and `reached` is true throughout."""
    sampled_times, _, indices, inside = instants
    delay_of = {name: k for k, (_, names) in enumerate(runs.sensors.delays) for name in names}
    values, derivatives = {}, {}
    for name, output in runs.base.outputs.items():
        output_values = jnp.where(sampled.reached, sampled.values[name], jnp.nan)
        if name not in delay_of:
            values[name] = output_values[indices[0]]
            derivatives[name] = sampled.derivatives[name][indices[0]]
            continue
        k = delay_of[name]
        parameter = runs.sensors.delays[k][0]  # Index of the delay among all parameters.
        # The three rows of delay k, (T,) each; row 0 is that of the times without delay.
        at, before, after = indices[1 + 3 * k : 4 + 3 * k]
        # The derivative with respect to the delay is minus the rate of the output, from a central
        # difference. Before the start (not `inside`) the state is constant, so the rate is zero.
        change = output_values[after] - output_values[before]
        period = getattr(output, "period", None)
        if period is not None:  # An angle that jumps from pi to -pi has not changed by -2 pi.
            change = wrapped(change, period)
        # Where both times are clipped to the start they are equal; 1 replaces a division by zero.
        apart = sampled_times[after] - sampled_times[before]
        rate = jnp.where(inside[k], change / jnp.where(apart > 0.0, apart, 1.0), 0.0)
        scale = runs.base.family.scales[parameter]
        # Chain rule: derivatives are by the delay's coordinate on its scale.
        coordinate = coordinates[parameter]
        slope = jax.grad(lambda u, scale=scale: jnp.asarray(scale.value(u)))(coordinate)
        values[name] = output_values[at]
        derivatives[name] = sampled.derivatives[name][at].at[:, parameter].add(-rate * slope)
    # Outputs at times that were not reached are NaN, which `Samples.residuals` recognises.
    reached = jnp.ones_like(indices[0], bool)
    return replace(sampled, values=values, derivatives=derivatives, reached=reached)


def experiment(
    scene: Scene,
    state: State,
    parameters: Mapping[str, Parameter],
    outputs: Mapping[str, Quantity],
    times: ArrayLike,
    start_time: float,
    settings: Settings | None,
) -> Experiment:
    """Return the `Experiment` of a scene; by default, `settings` are `presets.derivatives`."""
    check_parameters(parameters)
    requested = requested_by(outputs, save=None)
    # Residuals are at sample times, so that outputs that are recorded at steps are refused.
    requested.refuse(RECORDED, "a quantity in a fit or a minimisation", "pass the quantity itself")
    require(len(outputs) > 0, "outputs", {}, "not empty", EXAMPLE)
    settings = settings_or(settings, presets.derivatives)
    requested.check(scene, settings.ledger)
    scheme = derivative_scheme(scene, state, settings, start_time)
    end_time = float(rising_times(times)[-1])
    check_span(start_time, end_time)
    rising = checked_times(start_time, end_time, times)
    sensors = sensor_errors(parameters, outputs)
    # The zeros are placeholders for coordinates that `Experiment.run` receives.
    family = parametrised(scene, state, in_scene(parameters), np.zeros(len(parameters)))
    span = start_time, end_time
    base = TangentRun.of(scheme, family, dict(outputs), rising, span, settings, NO_RECORDERS)
    runs = Experiment(base, tuple(outputs), sensors)
    # With held parameters, runs have the same compiled program as without. They get coordinates of
    # the free parameters only, which replace entries of `whole`.
    indices = {name: k for k, name in enumerate(parameters)}
    free = [indices[name] for name in free_parameters(parameters)]
    if len(free) == len(parameters):
        return runs
    return replace(runs, free=tuple(free), whole=coordinates_of(scene, state, parameters))


class Samples(eqx.Module):
    """Samples of S measured series on T common times.

    `weights` are inverse standard deviations of the noise. `values` and `weights` are zero where a
    series has no sample, and at the padding after the last time. `periods`: period of each series'
    quantity, such as 2 pi of an angle; ``None`` if it is not periodic.
    """

    values: Float[np.ndarray, "S T"]
    weights: Float[np.ndarray, "S T"]
    periods: tuple[float | None, ...] = eqx.field(static=True)

    @property
    def count(self) -> int:
        """Number of samples in all series."""
        return int(np.count_nonzero(self.weights))

    def until(self, times: ArrayLike, end_time: float) -> "Samples":
        """Return a copy with zero weight for samples after `end_time`, s. `times` are the T common
        times, which may be followed by padding."""
        inside = np.asarray(times)[: self.weights.shape[1]] <= end_time
        return Samples(self.values, np.where(inside, self.weights, 0.0), self.periods)

    def residuals(self, predicted: jax.Array | np.ndarray) -> Float[jax.Array, "S T"]:
        """Return (prediction - value) / noise. For a periodic quantity, the nearest multiple of its
        period is subtracted from the difference. A residual is zero where there is no sample, and
        `UNREACHED` where the prediction is NaN."""
        difference = predicted - self.values
        # Of all values that differ by whole periods, the nearest counts.
        rows = [
            row if period is None else wrapped(row, period)
            for row, period in zip(difference, self.periods, strict=True)
        ]
        weighted = jnp.stack(rows) * self.weights
        weighted = jnp.where(jnp.isnan(weighted), UNREACHED, weighted)
        return jnp.where(self.weights > 0.0, weighted, 0.0)


def samples(measurements: Measurements, count: int) -> Samples:
    """Return the `Samples` of all series, on `Measurements.times` padded to `count` times."""
    times = measurements.times()
    series = measurements.series.values()
    values, weights = np.zeros((2, len(series), count))
    for k, measured in enumerate(series):
        at = np.searchsorted(times, measured.times)
        values[k, at], weights[k, at] = measured.values, 1.0 / measured.noise
    return Samples(values, weights, tuple(measured.period for measured in series))


@dataclass(frozen=True)
class RunMisfit:
    """Residuals and their Jacobian from one run, for S series at T times, M = S T.

    - `residuals`: (M,) series after series, zero where a series has no sample; `UNREACHED` at
      samples that the run does not reach, where the `jacobian` is zero. In a window of `identify`
      (argument `grow`), p residuals of a prior follow, and p further rows of `jacobian`.
    - `predicted`: (S, T) values of the outputs, SI; meaningless at times that it does not reach.
    """

    coordinates: Float[np.ndarray, " p"]
    residuals: Float[np.ndarray, " M"]
    jacobian: Float[np.ndarray, "M p"]
    predicted: Float[np.ndarray, "S T"]
    result: RESULTS

    @property
    def chi_squared(self) -> float:
        return float(self.residuals @ self.residuals)

    @cached_property
    def covariance(self) -> Float[np.ndarray, "p p"]:
        """Covariance of the coordinates if the residuals have unit variance."""
        return covariance(self.jacobian)


def run_misfit(
    runs: Experiment, data: Samples, end_time: float, coordinates: ArrayLike
) -> RunMisfit:
    run = runs.run(coordinates, end_time)
    residuals, jacobian = map(np.asarray, _weighted(runs, run, data))
    predicted = np.stack([np.asarray(run.values[name]) for name in runs.names])
    return RunMisfit(np.array(coordinates, float), residuals, jacobian, predicted, run.result)


@Compiled
def _weighted(runs: Experiment, run: Sampled, data: Samples) -> tuple[jax.Array, jax.Array]:
    values = jnp.stack([run.values[name] for name in runs.names])
    derivatives = jnp.stack([run.derivatives[name] for name in runs.names])
    usable = run.reached & jnp.isfinite(values)
    derivatives = jnp.where(usable[..., None], derivatives, 0.0)
    jacobian = derivatives * data.weights[..., None]
    residuals = data.residuals(jnp.where(usable, values, jnp.nan))
    return residuals.ravel(), jacobian.reshape(-1, jacobian.shape[-1])
