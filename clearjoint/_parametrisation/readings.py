"""Readings of sensors with errors, such as a bias, as functions of the errors' parameters."""

from collections.abc import Mapping
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .._compilation.xla import Compiled
from .._fields.checks import require
from .._model.bodies import State
from .._model.scene import Scene
from .parameter import AbstractScale, Parameter
from .variations import AbstractSeriesVariation, MadeByFunction, SeriesDelay, unchanged

Row = jax.Array | np.ndarray
"""Numbers of one output at several times, (T,), or coordinates, (p,)."""
Rows = Mapping[str, Row]


class SensorErrors(eqx.Module):
    """The parameters of a run that are errors of sensors, each with its index among all parameters,
    and the scales of all parameters."""

    errors: tuple[tuple[int, AbstractSeriesVariation], ...] = eqx.field(static=True, default=())
    scales: tuple[AbstractScale, ...] = eqx.field(static=True, default=())

    @property
    def delays(self) -> tuple[tuple[int, tuple[str, ...]], ...]:
        """The index of each delay among the parameters, with the names of its outputs."""
        return tuple((k, e.series) for k, e in self.errors if isinstance(e, SeriesDelay))

    @property
    def of_values(self) -> bool:
        """Whether any error changes the reading at a given time, as all errors but delays do."""
        return len(self.delays) < len(self.errors)

    def value(self, number: int, coordinates: jax.Array) -> jax.Array:
        """Return the value, (...), of the parameter of index `number` at coordinates (..., p)."""
        # A user-defined scale need not accept arrays.
        return jnp.vectorize(self.scales[number].value)(coordinates[..., number])

    def reading(self, name: str, quantity: Row, elapsed: Row, coordinates: Row) -> jax.Array:
        """Return the reading, (T,), of the output `name`, with all errors except a delay, from the
        quantity, (T,), the times `elapsed` since the start, (T,) s, and the coordinates, (p,)."""
        exact, since_start = jnp.asarray(quantity), jnp.asarray(elapsed)
        reading = exact
        for number, error in self.errors:
            if name in error.series:
                value = self.scales[number].value(coordinates[number])
                reading = reading + error.error(value, exact, since_start)
        return reading


NO_ERRORS = SensorErrors()


@Compiled
def with_sensor_errors(
    sensors: SensorErrors, values: Rows, derivatives: Rows, elapsed: Row, coordinates: Row
) -> tuple[dict[str, jax.Array], dict[str, jax.Array]]:
    """Return the readings of all sensors, (T,) each, and their derivatives, (T, p) each, by the
    `coordinates` of all p parameters of the run. The quantities, `values`, and their `derivatives`
    have the same shapes; `elapsed`: (T,) s, their times since the start of the run."""
    readings, slopes = jax.tree.map(jnp.asarray, (dict(values), dict(derivatives)))
    # Without duplicates, since a sensor may have several errors.
    with_errors = dict.fromkeys(name for _, error in sensors.errors for name in error.series)
    for name in with_errors:
        # As a default value, `name` belongs to this turn of the loop, whenever JAX calls it.
        def reading(quantity: Row, coordinates: Row, name: str = name) -> jax.Array:
            return sensors.reading(name, quantity, elapsed, coordinates)

        # A reading depends on the quantity at the same time only, so that one product with ones
        # gives the diagonal of its Jacobian.
        at = partial(reading, coordinates=coordinates)
        readings[name], factor = jax.jvp(at, (values[name],), (jnp.ones_like(values[name]),))
        of_errors = jax.jacfwd(reading, argnums=1)(values[name], coordinates)
        slopes[name] = factor[:, None] * derivatives[name] + of_errors
    return readings, slopes


@Compiled
def readings_of_runs(
    sensors: SensorErrors,
    values: Mapping[str, Float[jax.Array | np.ndarray, "n T"]],
    elapsed: Float[jax.Array | np.ndarray, " T"],
    coordinates: Float[jax.Array | np.ndarray, "n p"],
) -> dict[str, jax.Array]:
    """Return the readings of all sensors in n runs, (n, T) each, from the quantities, `values`, at
    the times `elapsed`, s, since the start. `coordinates`: of all p parameters in each run."""

    # The readings in one run, (T,) each.
    def of_run(values: Rows, coordinates: Row) -> dict[str, jax.Array]:
        return {n: sensors.reading(n, row, elapsed, coordinates) for n, row in values.items()}

    return jax.vmap(of_run)(values, coordinates)


def sensor_errors(
    parameters: Mapping[str, Parameter], outputs: Mapping[str, object]
) -> SensorErrors:
    """Return the `SensorErrors` of a run, whose `outputs` are given by name; raise a `ValueError`
    for an unknown output, and for two errors of the same kind for one output."""
    errors, taken = [], set()  # `taken`: pairs of a kind of error and the name of an output
    for number, (label, parameter) in enumerate(parameters.items()):
        error = parameter.variation
        if isinstance(error, AbstractSeriesVariation):
            for name in error.series:
                argument, noun = f"parameters[{label!r}]", error.noun
                expected = f"a {noun} of measured series: {', '.join(outputs)}"
                require(name in outputs, argument, name, expected, "correct the name of the series")
                expected = f"the only {noun} of its series"
                remedy = f"remove the series from one {noun}"
                require((type(error), name) not in taken, argument, name, expected, remedy)
                taken.add((type(error), name))
            errors.append((number, error))
    scales = tuple(parameter.scale for parameter in parameters.values())
    return SensorErrors(tuple(errors), scales) if errors else NO_ERRORS


def in_scene(parameters: Mapping[str, Parameter]) -> dict[str, Parameter]:
    """Return the parameters, each error of sensors replaced by a parameter that changes nothing."""
    still = MadeByFunction(unchanged, "1")
    return {
        name: Parameter(still, parameter.scale, value=parameter.value)
        if isinstance(parameter.variation, AbstractSeriesVariation)
        else parameter
        for name, parameter in parameters.items()
    }


def units_of(
    parameters: Mapping[str, Parameter], scene: Scene, state: State, series: Mapping[str, str]
) -> dict[str, str]:
    """Return the unit of each parameter's value. `series`: units of measured series, by name."""
    sensor_errors(parameters, series)  # raises an error for an unknown series
    units = {}
    for name, parameter in parameters.items():
        error = parameter.variation
        if isinstance(error, AbstractSeriesVariation):
            # The value is common to all series of the error, so it must have one unit.
            units_of_value = {error.unit_of(series[label]): None for label in error.series}
            expected, argument = "an error of series with the same unit", f"parameters[{name!r}]"
            remedy = f"pass a {error.noun} for each unit"
            require(len(units_of_value) == 1, argument, [*units_of_value], expected, remedy)
            units[name] = next(iter(units_of_value))
        else:
            units[name] = error.unit_in(scene, state)
    return units
