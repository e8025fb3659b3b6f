"""Residuals, predictions less measurements, as functions of the parameters' coordinates.

A run gives values and all their derivatives at once, error-controlled
(`clearjoint.simulation.run.sensitivities`). `predictions` hands both to JAX by a rule of
differentiation, so that `jax.linearize`, `jax.grad` and every optimiser built on them see these
derivatives at the cost of one run.

Runs at several coordinates are made one after the other. With derivatives, side by side under
`jax.vmap` they take longer (1.3 times with 8 runs, 3 times with 50), since they wait for each other
at each sample, and minutes to compile.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..compilation import Compiled
from ..fields.checks import require
from ..fields.conversion import on_device
from ..fields.types import ArrayLike
from ..math.vectors import Scalar
from ..measurements.series import Measurements
from ..model.bodies import State
from ..model.scene import Scene
from ..parametrisation.parameter import PASS_PARAMETERS, Parameter, check_parameters
from ..parametrisation.parametrised_scene import ParametrisedScene, parametrised
from ..parametrisation.variations import MadeByFunction, SeriesDelay, unchanged
from ..quantities.base import Quantity
from ..result_codes import RESULTS
from ..simulation.run.derivative_runs import derivative_scheme
from ..simulation.run.sampling import NOTHING_ELSE, Sampled, padded, sampled_compiled
from ..simulation.run.sensitivities import check_outputs
from ..simulation.step import presets
from ..simulation.step.method import Scheme
from ..simulation.step.settings import Settings, settings_or
from ..simulation.step.spans import check_span, checked_times

APART = 1e-7
"""Distance, s, of the instants whose difference tells how fast a delayed output changes: short
beside contacts, long beside the rounding of times."""
UNREACHED = 1e6
"""Residual of a sample that the run did not reach, in standard deviations: so large that an
optimiser turns back."""


class Experiment(eqx.Module):
    """Runs of a scene at any values of its parameters, observed as it is measured.

    - `family`: scene and initial state as functions of the parameters. Its own `values` are not
      used; `run` takes coordinates.
    - `outputs`: what is measured, by name; `names` are these in the order of arrays.
    - `times`: (T,) s, rising, the last one repeated up to one of few numbers of times.
    - `delays`: of each delay among the parameters its number, and the names of its outputs.
    - `start_time`, s; `first_step`, s, and `max_steps`: as in `Settings`.
    """

    scheme: Scheme
    family: ParametrisedScene
    outputs: dict[str, Quantity]
    times: jax.Array
    start_time: jax.Array
    first_step: jax.Array
    max_steps: jax.Array
    names: tuple[str, ...] = eqx.field(static=True)
    delays: tuple[tuple[int, tuple[str, ...]], ...] = eqx.field(static=True, default=())

    def run(self, coordinates: ArrayLike, end_time: Scalar) -> Sampled:
        """The outputs and their derivatives along a run at coordinates (p,), up to a time, s; later
        if an output leads. Outputs are those at the times less their delays."""
        if not self.delays:
            return self._sampled(coordinates, self.times, on_device(end_time))
        instants, end = _instants(self, on_device(coordinates), on_device(end_time))
        found = self._sampled(coordinates, instants.rising, end)
        return _delayed(self, on_device(coordinates), instants, found)

    def _sampled(self, coordinates: ArrayLike, times: jax.Array, end_time: jax.Array) -> Sampled:
        return sampled_compiled(
            self.scheme,
            self.family.at(coordinates),
            self.outputs,
            times,
            self.start_time,
            end_time,
            self.first_step,
            self.max_steps,
            NOTHING_ELSE,
        )

    def delay(self, number: int, coordinates: jax.Array) -> jax.Array:
        """The value, s, of a delay at coordinates (..., p)."""
        return jnp.asarray(self.family.scales[number].value(coordinates[..., number]))


class _Instants(eqx.Module):
    """Times at which a run with delays is looked at.

    - `rising`: (N,) all of them, s.
    - `own`: (T,) where the times without a delay are among these.
    - `at`, `before`, `after`: (T,) by the number of a delay, where the times less it are, and those
      a little earlier and later; `inside`: which of them are after the start.
    """

    rising: jax.Array
    own: jax.Array
    at: dict[int, jax.Array]
    before: dict[int, jax.Array]
    after: dict[int, jax.Array]
    inside: dict[int, jax.Array]


@Compiled
def _instants(
    runs: Experiment, coordinates: jax.Array, end_time: jax.Array
) -> tuple[_Instants, jax.Array]:
    """Times at which to look, and the end of the run, s."""
    values = {number: runs.delay(number, coordinates) for number, _ in runs.delays}
    end = end_time + jnp.maximum(0.0, -jnp.min(jnp.stack(list(values.values()))))
    own = jnp.minimum(runs.times, end_time)
    rows, inside = [own], {}
    for number, delay in values.items():
        shifted = own - delay
        inside[number] = shifted >= runs.start_time
        rows += [jnp.clip(shifted + d, runs.start_time, end) for d in (0.0, -APART, APART)]
    every = jnp.concatenate(rows)
    order = jnp.argsort(every)
    places = jnp.argsort(order).reshape(len(rows), -1)
    where = {n: places[1 + 3 * k : 4 + 3 * k] for k, n in enumerate(values)}
    at, before, after = ({n: rows[k] for n, rows in where.items()} for k in range(3))
    return _Instants(every[order], places[0], at, before, after, inside), end


@Compiled
def _delayed(
    runs: Experiment, coordinates: jax.Array, instants: _Instants, found: Sampled
) -> Sampled:
    """Outputs and derivatives at the times less their delays, of what was found at all instants;
    NaN where the run did not come so far."""
    delay_of = {name: number for number, names in runs.delays for name in names}
    values, derivatives = {}, {}
    for name, output in runs.outputs.items():
        seen = jnp.where(found.reached, found.values[name], jnp.nan)
        number = delay_of.get(name)
        if number is None:
            values[name], derivatives[name] = (
                seen[instants.own],
                found.derivatives[name][instants.own],
            )
            continue
        at, before, after = (
            rows[number] for rows in (instants.at, instants.before, instants.after)
        )
        change = seen[after] - seen[before]
        period = getattr(output, "period", None)
        if period is not None:
            change = change - period * jnp.round(change / period)
        apart = instants.rising[after] - instants.rising[before]
        rate = jnp.where(instants.inside[number], change / jnp.where(apart > 0.0, apart, 1.0), 0.0)
        scale = runs.family.scales[number]
        slope = jax.grad(lambda u, scale=scale: jnp.asarray(scale.value(u)))(coordinates[number])
        values[name] = seen[at]
        derivatives[name] = found.derivatives[name][at].at[:, number].add(-rate * slope)
    reached = jnp.ones_like(instants.own, bool)
    return eqx.tree_at(
        lambda run: (run.values, run.derivatives, run.reached),
        found,
        (values, derivatives, reached),
    )


def experiment(
    scene: Scene,
    state: State,
    parameters: Mapping[str, Parameter],
    outputs: Mapping[str, Quantity],
    times: ArrayLike,
    start_time: float,
    settings: Settings | None,
) -> Experiment:
    """Runs of a scene at any values of `parameters`, with `outputs` at rising times (N,), s."""
    check_parameters(parameters)
    require(len(parameters) > 0, "parameters", {}, "at least one Parameter", PASS_PARAMETERS)
    check_outputs(outputs, scene)
    settings = settings_or(settings, presets.derivatives)
    scheme = derivative_scheme(scene, state, settings, start_time)
    end_time = float(np.max(times))
    check_span(start_time, end_time)
    rising = checked_times(start_time, end_time, times, "times")
    delays = _delays(parameters, outputs)
    still = MadeByFunction(unchanged, "s")
    in_scene = {
        name: Parameter(still, parameter.scale, value=0.0) if number in dict(delays) else parameter
        for number, (name, parameter) in enumerate(parameters.items())
    }
    family = parametrised(scene, state, in_scene, np.zeros(len(parameters)))
    return Experiment(
        scheme,
        family,
        dict(outputs),
        on_device(padded(rising, end_time)),
        on_device(start_time),
        on_device(settings.length_of_first_step(start_time, end_time)),
        on_device(settings.max_steps, int),
        tuple(outputs),
        delays,
    )


def _delays(
    parameters: Mapping[str, Parameter], outputs: Mapping[str, Quantity]
) -> tuple[tuple[int, tuple[str, ...]], ...]:
    """The numbers of the delays among the parameters, and the outputs that each is of."""
    found, taken = [], set()
    for number, (label, parameter) in enumerate(parameters.items()):
        if isinstance(parameter.variation, SeriesDelay):
            names = parameter.variation.series
            for name in names:
                one = f"parameters[{label!r}]"
                known = f"a delay of measured series: {', '.join(outputs)}"
                require(name in outputs, one, name, known, "correct the name of the series")
                once = "the only delay of its series"
                require(name not in taken, one, name, once, "leave the series out of one of them")
                taken.add(name)
            found.append((number, names))
    return tuple(found)


def check_start(start_time: float, times: np.ndarray) -> None:
    """Check that a run begins before the first of the rising times of samples, or with it."""
    expected = f"no later than the first sample, at {times[0]} s"
    remedy = "start earlier, or leave samples out: measurements.between(...)"
    require(bool(start_time <= times[0]), "start_time", start_time, expected, remedy)


@eqx.filter_custom_jvp
def predictions(
    coordinates: Float[np.ndarray | jax.Array, " p"], runs: Experiment, end_time: Scalar
) -> Float[jax.Array, "S T"]:
    """The S outputs at T times, in the order of `runs.names`; NaN at times that the run did not
    reach. Differentiable along the coordinates."""
    return _arrays(runs, runs.run(coordinates, end_time))[0]


@predictions.def_jvp
def _predictions_along(
    primals: tuple[ArrayLike, Experiment, Scalar], tangents: tuple[jax.Array, None, None]
) -> tuple[jax.Array, jax.Array]:
    coordinates, runs, end_time = primals
    values, derivatives = _arrays(runs, runs.run(coordinates, end_time))
    return values, derivatives @ tangents[0]


def _arrays(runs: Experiment, run: Sampled) -> tuple[jax.Array, jax.Array]:
    """Values (S, T) and derivatives (S, T, p) of a run; at times that it did not reach NaN and
    zero."""
    values = jnp.stack([run.values[name] for name in runs.names])
    derivatives = jnp.stack([run.derivatives[name] for name in runs.names])
    fine = run.reached & jnp.isfinite(values)
    derivatives = jnp.where(fine[..., None], derivatives, 0.0)
    return jnp.where(fine, values, jnp.nan), derivatives


class Samples(eqx.Module):
    """Measurements of S series at the union of their times.

    - `values`: in SI; `weights`: one over the noise, zero where a series has no sample.
    - `periods`: of each series, such as 2 pi of an angle; ``None`` if it has none.
    """

    values: Float[np.ndarray, "S T"]
    weights: Float[np.ndarray, "S T"]
    periods: tuple[float | None, ...] = eqx.field(static=True)

    @property
    def count(self) -> int:
        """Number of samples in all series."""
        return int(np.count_nonzero(self.weights))

    def until(self, times: ArrayLike, end_time: float) -> "Samples":
        """The samples no later than `end_time`, s, from the times (T,) of all."""
        inside = np.asarray(times)[: self.weights.shape[1]] <= end_time
        return Samples(self.values, np.where(inside, self.weights, 0.0), self.periods)

    def residuals(self, predicted: jax.Array | np.ndarray) -> Float[jax.Array, "S T"]:
        """(Prediction - value) / noise; zero where there is no sample, and `UNREACHED` where the
        prediction is NaN."""
        difference = predicted - self.values
        rows = [
            row if period is None else row - period * jnp.round(row / period)
            for row, period in zip(difference, self.periods, strict=True)
        ]
        weighted = jnp.stack(rows) * self.weights
        weighted = jnp.where(jnp.isnan(weighted), UNREACHED, weighted)
        return jnp.where(self.weights > 0.0, weighted, 0.0)


def samples(measurements: Measurements, count: int) -> Samples:
    """The series at the union of their times, padded to `count` times without samples."""
    times = measurements.times()
    series = measurements.series.values()
    values, weights = np.zeros((2, len(series), count))
    for k, one in enumerate(series):
        at = np.searchsorted(times, one.times)
        values[k, at], weights[k, at] = one.values, 1.0 / one.noise
    return Samples(values, weights, tuple(one.period for one in series))


def residuals(
    coordinates: Float[np.ndarray | jax.Array, " p"],
    runs: Experiment,
    data: Samples,
    end_time: Scalar,
) -> Float[jax.Array, " M"]:
    """Predictions less measurements, in standard deviations of the noise, series after series.
    Differentiable along the coordinates."""
    return data.residuals(predictions(coordinates, runs, end_time)).ravel()


@dataclass(frozen=True)
class RunMisfit:
    """Residuals and their Jacobian from one run.

    - `coordinates`: of the parameters in the run.
    - `residuals`: in standard deviations; `jacobian`: their derivatives along the coordinates.
    - `predicted`: the values of the outputs, SI.
    - `result`: `RESULTS` code of the run; `time`: s, where it ended; `attempts`: steps tried.
    """

    coordinates: Float[np.ndarray, " p"]
    residuals: Float[np.ndarray, " M"]
    jacobian: Float[np.ndarray, "M p"]
    predicted: Float[np.ndarray, "S T"]
    result: RESULTS
    time: float
    attempts: int

    @property
    def chi_squared(self) -> float:
        """Sum of the squared residuals."""
        return float(self.residuals @ self.residuals)


def run_misfit(
    runs: Experiment, data: Samples, end_time: float, coordinates: ArrayLike
) -> RunMisfit:
    """Residuals and their Jacobian at coordinates (p,), from one run up to a time, s."""
    run = runs.run(coordinates, end_time)
    values, jacobian = _weighted(runs, run, data)
    return RunMisfit(
        np.array(coordinates, float),
        np.asarray(values),
        np.asarray(jacobian),
        np.stack([np.asarray(run.values[name]) for name in runs.names]),
        run.result,
        float(run.time),
        int(run.attempts),
    )


@Compiled
def _weighted(runs: Experiment, run: Sampled, data: Samples) -> tuple[jax.Array, jax.Array]:
    values, derivatives = _arrays(runs, run)
    jacobian = derivatives * data.weights[..., None]
    return data.residuals(values).ravel(), jacobian.reshape(-1, jacobian.shape[-1])
