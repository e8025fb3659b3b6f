"""Sensors of planned measurements: their channels, times and noise, without measured values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float

from ..fields.checks import as_number, require, require_names
from ..fields.types import ArrayLike
from ..model.scene import Scene
from ..quantities.base import Quantity, check_quantity


class SampledChannel(Protocol):
    """Interface of objects with a channel, times and noise, such as a measured `Series`."""

    @property
    def channel(self) -> Quantity:
        """The measured quantity: a scalar function of an `Instant`, the motion at one time."""
        ...

    @property
    def times(self) -> ArrayLike:
        """Times of the samples, (N,) s, strictly rising."""
        ...

    @property
    def noise(self) -> ArrayLike:
        """Standard deviation of the samples in the channel's SI unit, a number or (N,)."""
        ...


@dataclass(frozen=True)
class Sensor:
    """An instrument that samples one or more channels at the same times.

    **Arguments:**

    - `channels`: a measured quantity, or a list or tuple of them. A quantity is a scalar function
      of an `Instant`, the motion at one time, such as those of `clearjoint.quantities`.
    - `times`: (N,) s, strictly rising.
    - `noise`: standard deviation of the samples' independent noise, in the channels' SI unit: a
      number, or (N,).

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
        several = isinstance(channels, list | tuple)
        object.__setattr__(self, "channels", tuple(channels) if several else (channels,))
        object.__setattr__(self, "times", np.asarray(as_number(times, "times", "s")))
        deviation = np.asarray(as_number(noise, "noise"))
        _check(self.channels, self.times, deviation)
        object.__setattr__(self, "noise", deviation * np.ones(len(self.times)))


def _check(channels: tuple[Quantity, ...], times: np.ndarray, noise: np.ndarray) -> None:
    """Check the arguments of a `Sensor`.

    **Raises:** `ValueError` that names the wrong argument.
    """
    functions = len(channels) > 0 and all(callable(channel) for channel in channels)
    expected = "scalar functions of an Instant"
    require(functions, "channels", channels, expected, "pass one or several of cj.quantities")
    finite = times.ndim == 1 and times.size > 0 and bool(np.isfinite(times).all())
    rises = finite and bool((np.diff(times) > 0.0).all())
    expected = "a rising row of finite times, none of them twice"
    require(rises, "times", times, expected, "sort them, for example by numpy.unique")
    shaped = noise.shape in ((), times.shape)
    expected = f"a number or of shape {times.shape}"
    require(shaped, "noise", noise.shape, expected, "pass one for each time")
    positive = bool((np.isfinite(noise) & (noise > 0.0)).all())
    remedy = "give the standard deviation of the samples"
    require(positive, "noise", noise, "finite and positive", remedy)


class SeriesByName(Protocol):
    """Interface of objects with sampled channels by name, such as `Measurements`."""

    @property
    def series(self) -> Mapping[str, SampledChannel]:
        """Sampled channels by name."""
        ...


Sensors = Mapping[str, Sensor | SampledChannel] | SeriesByName
"""Sensors or measured series by name, or `Measurements`; a series is a sensor with one channel."""


def as_sensors(sensors: Sensors, scene: Scene) -> dict[str, Sensor]:
    """Return sensors by name, from a dictionary of `Sensor` or `Series`, or from `Measurements`.

    A series becomes a sensor with its channel, times and noise; its values are not used.

    **Raises:** `ValueError` for other types, an empty dictionary, names that are not non-empty
    texts, and for a channel of an element that the scene lacks.
    """
    by_name = sensors if isinstance(sensors, Mapping) else getattr(sensors, "series", {})
    remedy = 'pass for example {"probe": cj.Sensor(channel, times, noise)}'
    filled = isinstance(by_name, Mapping) and len(by_name) > 0
    require(filled, "sensors", sensors, "a dictionary with at least one sensor", remedy)
    require_names("sensors", by_name, remedy)
    sensor_by_name = {}
    for name, one in by_name.items():
        is_series = all(hasattr(one, part) for part in ("channel", "times", "noise"))
        fine = isinstance(one, Sensor) or is_series
        require(fine, f"sensors[{name!r}]", type(one).__name__, "a Sensor or a Series", remedy)
        sensor = one if isinstance(one, Sensor) else Sensor(one.channel, one.times, one.noise)
        for channel in sensor.channels:
            check_quantity(f"Sensor {name!r}", channel, scene)
        sensor_by_name[name] = sensor
    return sensor_by_name


def outputs_of(sensors: Mapping[str, Sensor]) -> dict[str, Quantity]:
    """Return the channels of all sensors by name.

    A channel has the name of its sensor. If the sensor has several channels, a number from zero on
    is appended, as in "probe 0". A fit uses the same names, and therefore the same program.

    **Raises:** `ValueError` for names that are not unique.
    """
    outputs: dict[str, Quantity] = {}
    for name, sensor in sensors.items():
        for k, channel in enumerate(sensor.channels):
            output = name if len(sensor.channels) == 1 else f"{name} {k}"
            require(output not in outputs, "sensors", name, "unique names", "rename it")
            outputs[output] = channel
    return outputs


def times_of(sensors: Mapping[str, Sensor]) -> Float[np.ndarray, " N"]:
    """Return the times at which any sensor has a sample, (N,) s, rising, each time once."""
    return np.unique(np.concatenate([sensor.times for sensor in sensors.values()]))
