"""Identifiability of parameters from planned sensors, by Cramér-Rao bounds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from typing_extensions import override

from .._export.tables import aligned, number, percent
from .._fields.checks import as_number, require, require_shape, require_types
from .._fields.types import ArrayLike
from .._measurements.series import Measurements, Series
from .._model.bodies import State
from .._model.scene import Scene
from .._parametrisation.parameter import AbstractScale, Parameter, coordinates_of
from .._simulation.run.sensitivities import Sensitivities, sensitivities
from .._simulation.step import presets
from .._simulation.step.settings import Settings, settings_or, strictly_rising_times
from ..quantities.base import Quantity, check_quantity, require_quantity
from . import fisher_information as information
from .fisher_information import Combination


@dataclass(frozen=True)
class Sensor:
    """An instrument that samples one or more channels at the same times.

    **Arguments:**

    - `channels`: a measured quantity, or a list or tuple of them. A quantity is a scalar function
      of an `Instant`, the motion at one time, such as those of `clearjoint.quantities`.
    - `times`: (N,) strictly rising times, s.
    - `noise`: standard deviation of the samples' independent noise, in the channels' SI unit: a
      number, or (N,).

    The attribute `channels` is a tuple, even for one channel, and the attribute `noise` is (N,).

    **Raises:** `ValueError` for no channels or channels that are not functions, for times that are
    not finite or don't rise, and for noise of another shape or that is not finite and positive.

    >>> times = np.linspace(0.0, 0.1, 201)
    >>> probe = cj.Sensor(cj.quantities.JournalOffset("shoulder", "x"), times, noise=1e-6)
    >>> probe.times.shape
    (201,)
    """

    channels: tuple[Quantity, ...]
    times: Float[np.ndarray, " N"]
    noise: Float[np.ndarray, " N"]

    def __init__(self, channels: Quantity | Sequence[Quantity], times: ArrayLike, noise: ArrayLike):
        several = tuple(channels) if isinstance(channels, list | tuple) else (channels,)
        require(len(several) > 0, "channels", (), "one or more", "pass one of cj.quantities")
        for channel in several:
            require_quantity("channels", channel)
        row = np.asarray(strictly_rising_times(times))
        deviation = np.asarray(as_number(noise, "noise"))
        fits, expected = deviation.shape in ((), row.shape), f"a number or of shape {row.shape}"
        require(fits, "noise", deviation.shape, expected, "pass one for each time")
        positive = bool((np.isfinite(deviation) & (deviation > 0.0)).all())
        remedy = "give the standard deviation of the samples"
        require(positive, "noise", deviation, "finite and positive", remedy)
        # The class is frozen, so its fields are set in the dictionary of the object.
        vars(self).update(channels=several, times=row, noise=deviation * np.ones(len(row)))


Sensors = Mapping[str, Sensor | Series] | Measurements
"""Sensors or measured series by name, or `Measurements`; a series is a sensor with one channel."""


def as_sensors(sensors: Sensors, scene: Scene) -> dict[str, Sensor]:
    """Return sensors by name, after a check of their channels in the `scene`. A series becomes a
    sensor with its channel, times and noise."""
    by_name = sensors.series if isinstance(sensors, Measurements) else sensors
    remedy = 'pass for example {"probe": cj.Sensor(channel, times, noise)}'
    filled = isinstance(by_name, Mapping) and len(by_name) > 0
    require(filled, "sensors", sensors, "a dictionary with at least one sensor", remedy)
    require_types("sensors", by_name, Sensor | Series, "a Sensor or a Series", remedy)
    sensor_by_name = {}
    for name, s in by_name.items():
        sensor = s if isinstance(s, Sensor) else Sensor(s.channel, s.times, s.noise)
        for channel in sensor.channels:
            check_quantity(f"Sensor {name!r}", channel, scene)
        sensor_by_name[name] = sensor
    return sensor_by_name


def outputs_of(sensors: Mapping[str, Sensor]) -> dict[str, Quantity]:
    """Return the channels of all sensors by name: the name of the sensor, followed, if the sensor
    has several channels, by a number from 0 on: "probe 0". A fit of series with the same names
    shares the compiled program."""
    outputs: dict[str, Quantity] = {}
    for name, sensor in sensors.items():
        for k, channel in enumerate(sensor.channels):
            output = name if len(sensor.channels) == 1 else f"{name} {k}"
            require(output not in outputs, "sensors", name, "unique names", "rename it")
            outputs[output] = channel
    return outputs


def times_of(sensors: Mapping[str, Sensor]) -> Float[np.ndarray, " N"]:
    return np.unique(np.concatenate([sensor.times for sensor in sensors.values()]))


ACCURACY_OF_DERIVATIVES = 1e3
"""Approximate relative error of a sensitivity, over `rtol`: for the double pendulum it is 4e2 at
`rtol` 1e-9 and 2e3 at 1e-11."""


@dataclass(frozen=True)
class Identifiability:
    """Accuracy with which data from sensors can determine p parameters.

    Standard deviations are lower bounds: no unbiased estimate has smaller ones. They are valid for
    normal noise that is so small that outputs are linear in the parameters over changes of the size
    of these deviations. The methods `of` and `until` select sensors and shorten the record. A
    coordinate is a parameter's value on its scale, such as the logarithm of the value.

    - `names`, `scales`, `coordinates`: of the p parameters, in the order of all arrays (p,).
    - `sensors`, `sample_times`: (M,) name of the sensor and time, s, of each of the M samples of
      all channels, in order of time.
    - `rows`: (M, p), derivatives of each sample by the coordinates, divided by its noise.
    - `accuracy`: relative error of the derivatives. Combinations of parameters with a smaller
      relative effect count as undetermined.

    >>> probe = cj.Sensor(x, times, noise=1e-4)
    >>> report = cj.identifiability(scene, state, {"stiffness": stiffness}, {"probe": probe})
    >>> slopes = -0.5 * times * np.sin(10.0 * times)  # d x/d log k
    >>> bool(np.isclose(report.deviations[0], 1e-4 / np.linalg.norm(slopes), rtol=1e-4))
    True
    """

    names: tuple[str, ...]
    scales: tuple[AbstractScale, ...]
    coordinates: Float[np.ndarray, " p"]
    sensors: np.ndarray
    sample_times: Float[np.ndarray, " M"]
    rows: Float[np.ndarray, "M p"]
    accuracy: float

    def of(self, *sensors: str) -> "Identifiability":
        """Return the identifiability from the samples of the named sensors only."""
        available = sorted(set(self.sensors.tolist()))
        for name in sensors:
            require(name in available, "sensors", name, f"among {available}", "correct the name")
        require(len(sensors) > 0, "sensors", sensors, "at least one name", "name the sensors")
        return self._where(np.isin(self.sensors, sensors))

    def until(self, time: float) -> "Identifiability":
        """Return the identifiability from the samples up to `time`, s, only."""
        require_shape("time", time, (), "pass one time in s")
        early, first = self.sample_times <= time, float(self.times[0])
        expected = f"{first} s or later, the first sample"
        require(bool(early.any()), "time", time, expected, "raise it")
        return self._where(early)

    def _where(self, chosen: Bool[np.ndarray, " M"]) -> "Identifiability":
        sensors, times = self.sensors[chosen], self.sample_times[chosen]
        return replace(self, sensors=sensors, sample_times=times, rows=self.rows[chosen])

    @property
    def times(self) -> Float[np.ndarray, " N"]:
        """Times at which any sensor has a sample, (N,) s, rising, each once."""
        return np.unique(self.sample_times)

    @property
    def root(self) -> Float[np.ndarray, "p p"]:
        """Matrix R (p, p) with R^T R equal to the Fisher information of the coordinates."""
        return information.root_of(self.rows)

    @property
    def matrix(self) -> Float[np.ndarray, "p p"]:
        """Fisher information of the coordinates, (p, p)."""
        return self.root.T @ self.root

    @property
    def deviations(self) -> Float[np.ndarray, " p"]:
        """Standard deviations of the coordinates, (p,), if all parameters are estimated together;
        infinite for a parameter that the data don't determine. On a `Log` scale, they are relative
        errors of the values."""
        return information.deviations_together(self.root, self.accuracy)

    @property
    def deviations_alone(self) -> Float[np.ndarray, " p"]:
        """Standard deviations of the coordinates, (p,), if all other parameters are known; infinite
        for parameters without effect on the data."""
        # The diagonal of F = R^T R holds the squared norms of the columns of the root R.
        with np.errstate(divide="ignore"):
            return 1.0 / np.linalg.norm(self.root, axis=0)

    @property
    def labels(self) -> list[str]:
        """Label of each parameter's coordinate, such as "log K"."""
        return [scale.label(name) for scale, name in zip(self.scales, self.names, strict=True)]

    @property
    def values(self) -> Float[np.ndarray, " p"]:
        """Values of the parameters, (p,), SI."""
        pairs = zip(self.scales, self.coordinates, strict=True)
        return np.array([float(scale.value(u)) for scale, u in pairs])

    @property
    def slopes(self) -> Float[np.ndarray, " p"]:
        """Magnitude of the derivative of each value by its coordinate on the scale, (p,), SI."""
        pairs = zip(self.scales, self.coordinates, strict=True)
        return np.abs([float(scale.slope(u)) for scale, u in pairs])

    @property
    def value_deviations(self) -> Float[np.ndarray, " p"]:
        """Standard deviations of the values, (p,), SI, if all parameters are estimated together."""
        return self.slopes * self.deviations

    @property
    def limits(self) -> Float[np.ndarray, " p"]:
        """Largest standard deviation of each coordinate, (p,), with which an estimate still carries
        information: on a `Log` scale 1, a factor of e in the value."""
        pairs = zip(self.scales, self.coordinates, strict=True)
        return np.array([scale.uninformative_std(float(u)) for scale, u in pairs])

    @property
    def identifiable(self) -> dict[str, bool]:
        """Whether the standard deviation of each coordinate is within `limits`, by name."""
        within = self.deviations <= self.limits
        return dict(zip(self.names, within.tolist(), strict=True))

    @property
    def rank(self) -> int:
        """Number of independent combinations of parameters that the data determine, at most p."""
        return int(information.rank(self.root, self.accuracy))

    @property
    def condition(self) -> float:
        """Condition number of `rows` with their columns scaled to unit length; large if the data
        hardly determine some combination of the parameters. It is infinite, or very large by
        rounding, if a parameter has no effect on the data, and NaN if none has."""
        return float(information.condition(self.root))

    @property
    def correlation(self) -> Float[np.ndarray, "p p"]:
        """Correlation of the estimated coordinates, (p, p); NaN for undetermined parameters."""
        return information.correlation_together(self.root, self.accuracy)

    @property
    def combinations(self) -> tuple[Combination, ...]:
        """Combinations of coordinates with independent estimates, the most accurate first."""
        return information.combinations(self.root, self.accuracy)

    def over_time(self) -> np.ndarray:
        """Return the `deviations`, (N, p), by the samples up to each of the N `times`."""
        # The root of the rows so far, together with the new rows, has the same information as all
        # these rows, so that each row enters only one decomposition.
        root, roots, start = np.zeros((len(self.names),) * 2), [], 0
        for end in np.searchsorted(self.sample_times, self.times, side="right").tolist():
            root = information.root_of(np.concatenate([root, self.rows[start:end]]))
            roots.append(root)
            start = end
        return information.deviations_together(np.array(roots), self.accuracy)

    @override
    def __str__(self) -> str:
        sensors, times = ", ".join(dict.fromkeys(self.sensors.tolist())), self.times
        head = (
            f"Smallest standard deviations that data can reach: {sensors}; {len(times)} times from "
            f"{times[0]:g} to {times[-1]:g} s"
        )
        return "\n".join([head, "", *self._bounds(), "", *self._combination_lines()])

    def _bounds(self) -> list[str]:
        head = "parameter", "value", "together", "", "alone", *(f"r({n})" for n in self.names)
        rows: list[tuple[str, ...]] = [head]
        together, alone = self.value_deviations, self.slopes * self.deviations_alone
        for k, (name, is_identifiable) in enumerate(self.identifiable.items()):
            value = self.values[k]
            share = percent(together[k] / abs(value)) if value != 0.0 else "-"
            bounds = (number(together[k]), share) if is_identifiable else ("not identifiable", "-")
            correlations = [number(c, 3) for c in self.correlation[k]]
            rows.append((name, f"{value:.5g}", *bounds, number(alone[k]), *correlations))
        return aligned(rows)

    def _combination_lines(self) -> list[str]:
        labels = self.labels
        rows = [("combination, from best to worst", "deviation", "")]
        for combination in self.combinations:
            # The limit is that of the coordinate that contributes most to the sum, the one whose
            # weight is 1 or -1.
            deviation = combination.standard_deviation
            determined = deviation <= self.limits[np.abs(combination.weights).argmax()]
            note = "" if determined else "not determined"
            rows.append((combination.described(labels), number(deviation), note))
        lines = aligned(rows)
        for k, (name, is_identifiable) in enumerate(self.identifiable.items()):
            if not is_identifiable:
                deviation, limit = self.deviations[k], self.limits[k]
                size = f"{deviation:.2g}" if np.isfinite(deviation) else "infinite"
                lines.append(
                    f"{name} is not identifiable: the standard deviation of {labels[k]} is {size}. "
                    f"Above {limit:.2g} an estimate carries no information."
                )
        return lines


def identifiability(
    scene: Scene,
    state: State,
    parameters: Mapping[str, Parameter],
    sensors: Sensors,
    settings: Settings | None = None,
    *,
    start_time: float = 0.0,
) -> Identifiability:
    """Compute, by one run, how accurately data from sensors can determine parameters.

    **Arguments:**

    - `parameters`: parameters by name. The run is computed at their values, by default the numbers
      in `scene` and `state`.
    - `sensors`: `Sensor`s or measured `Series` by name, or `Measurements`, whose values are unused.
    - `settings`: by default `clearjoint.presets.derivatives`.

    **Raises:** `ValueError` for unsupported arguments, such as settings with a `controller` instead
    of tolerances; `SimulationError` if the run fails.

    >>> probe = cj.Sensor(x, times, noise=1e-4)
    >>> report = cj.identifiability(scene, state, {"stiffness": stiffness}, {"probe": probe})
    >>> report.identifiable
    {'stiffness': True}
    """
    settings = settings_or(settings, presets.derivatives)
    settings.require_tolerances("the accuracy of derivatives depends on them")
    by_name = as_sensors(sensors, scene)
    times = times_of(by_name)
    outputs, end_time = outputs_of(by_name), float(times[-1])
    run = sensitivities(
        scene, state, end_time, parameters, outputs, times, settings, start_time=start_time
    )
    coordinates = coordinates_of(scene, state, parameters)
    return identifiability_from(run, parameters, coordinates, by_name, settings)


def identifiability_from(
    run: Sensitivities,
    parameters: Mapping[str, Parameter],
    coordinates: Float[np.ndarray, " p"],
    sensors: Mapping[str, Sensor],
    settings: Settings,
) -> Identifiability:
    """Return the `Identifiability` of p parameters at `coordinates` from a `run` with the outputs
    of all sensors at the times of all sensors. The first p derivatives of the run must be those by
    the parameters, with an accuracy that follows from the tolerance in `settings`."""
    p, names, times, rows = len(coordinates), [], [], []
    for name, sensor in sensors.items():
        at = np.searchsorted(run.times, sensor.times)
        channels = [run.derivatives[output][at, :p] for output in outputs_of({name: sensor})]
        # (N, channels, p): a sample of each channel at each of the sensor's N times.
        scaled = np.stack(channels, axis=1) / sensor.noise[:, None, None]
        rows.append(scaled.reshape(-1, p))
        times.append(np.repeat(sensor.times, len(channels)))
        names += [name] * len(rows[-1])
    # In order of time, the samples of a shorter record are the first rows.
    sample_times = np.concatenate(times)
    order = np.argsort(sample_times, kind="stable")
    of_sensors, all_rows = np.array(names)[order], np.concatenate(rows)[order]
    scales = tuple(parameter.scale for parameter in parameters.values())
    accuracy = ACCURACY_OF_DERIVATIVES * settings.rtol
    return Identifiability(
        tuple(parameters), scales, coordinates, of_sensors, sample_times[order], all_rows, accuracy
    )
