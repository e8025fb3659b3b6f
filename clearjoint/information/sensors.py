"""Sensors of planned measurements: their channels, times and noise, without measured values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..fields.checks import as_number, require, require_types
from ..fields.types import ArrayLike
from ..measurements.series import Measurements, Series
from ..model.scene import Scene
from ..quantities.base import Quantity, check_quantity, require_quantity
from ..simulation.step.spans import check_strictly_rising


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
        several = tuple(channels) if isinstance(channels, list | tuple) else (channels,)
        require(len(several) > 0, "channels", (), "one or more", "pass one of cj.quantities")
        for channel in several:
            require_quantity("channels", channel)
        row = np.asarray(check_strictly_rising(times, "times"))
        deviation = np.asarray(as_number(noise, "noise"))
        fine, expected = deviation.shape in ((), row.shape), f"a number or of shape {row.shape}"
        require(fine, "noise", deviation.shape, expected, "pass one for each time")
        fine = bool((np.isfinite(deviation) & (deviation > 0.0)).all())
        remedy = "give the standard deviation of the samples"
        require(fine, "noise", deviation, "finite and positive", remedy)
        # The class is frozen, so its fields are set by `object`.
        object.__setattr__(self, "channels", several)
        object.__setattr__(self, "times", row)
        object.__setattr__(self, "noise", deviation * np.ones(len(row)))


Sensors = Mapping[str, Sensor | Series] | Measurements
"""Sensors or measured series by name, or `Measurements`; a series is a sensor with one channel."""


def as_sensors(sensors: Sensors, scene: Scene) -> dict[str, Sensor]:
    """Return sensors by name, from a dictionary of `Sensor` or `Series`, or from `Measurements`.

    A series becomes a sensor with its channel, times and noise; its values are not used.

    **Raises:** `ValueError` for other types, an empty dictionary, names that are not non-empty
    texts, and for a channel of an element that the scene lacks.
    """
    by_name = sensors.series if isinstance(sensors, Measurements) else sensors
    remedy = 'pass for example {"probe": cj.Sensor(channel, times, noise)}'
    filled = isinstance(by_name, Mapping) and len(by_name) > 0
    require(filled, "sensors", sensors, "a dictionary with at least one sensor", remedy)
    require_types("sensors", by_name, Sensor | Series, "a Sensor or a Series", remedy)
    sensor_by_name = {
        name: one if isinstance(one, Sensor) else Sensor(one.channel, one.times, one.noise)
        for name, one in by_name.items()
    }
    for name, sensor in sensor_by_name.items():
        for channel in sensor.channels:
            check_quantity(f"Sensor {name!r}", channel, scene)
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
