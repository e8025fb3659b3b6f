"""Measured series of quantities with their noise, and conversion of units to SI by pint, in whose
application registry users can define their own."""

import math
import re
import tokenize
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from typing_extensions import override

from .._fields.checks import as_number, concrete, require, require_types
from .._fields.objects import AbstractReadable
from .._fields.types import ArrayLike
from .._model.scene import Scene
from ..quantities.base import Quantity, check_quantity, require_quantity

if TYPE_CHECKING:
    import pint
    import xarray as xr

LONGEST = 100
"""Largest number of characters in a unit."""
LARGEST_POWER = 1000
"""Largest product of all exponents in a unit. Exponents below 1 count as 1, and denominators are
left out. With larger powers, integers that pint computes would exhaust the memory."""
POWER = re.compile(r"\*\*\(?[+-]?(\d{1,2}(?:\.\d*)?)(?:/\d{1,2})?(?!\d)\)?")
"""A power with at most two digits before the decimal point or in a fraction: "**2", "**(-1/2)"."""
# The remedy in error messages about a unit.
SPELLING = 'write for example "mm", "deg", "N m", "m/s^2", "g_0" or "1"'


def to_si(unit: str, si: str | None) -> tuple[float, str]:
    """Return the factor that converts values from `unit` to the SI unit `si`, and this SI unit; by
    default, it is a combination of SI base units. Raise a `ValueError` if pint doesn't know `unit`;
    if it has another dimension, no constant factor (dB, degrees Celsius), large powers or more than
    `LONGEST` characters; or if it contains Hz, but `si` is a unit of angular speed."""
    import pint  # Importing it takes a quarter of a second, so it is imported only when needed.

    registry = pint.get_application_registry()
    source = _pint_unit(registry, unit, "unit")
    target = registry.get_base_units(source)[1] if si is None else _pint_unit(registry, si, "si")
    expected = f"a unit of {'SI' if si is None else si!r}"
    remedy = f"check the column and its channel; {source} has dimension {source.dimensionality}"
    require(source.is_compatible_with(target), "unit", unit, expected, remedy)
    # To pint, a radian is dimensionless, so that 1 Hz would silently become 1 rad/s.
    cycles = "hertz" in str(source) and "radian" in str(target)
    require(not cycles, "unit", unit, f"{expected}, not cycles", 'write "rpm" or "turn/s"')
    # A level or a temperature in degrees Celsius has no single factor: it would convert wrongly. A
    # conversion by a factor gives 0 for 0, and for 2 twice as much as for 1, apart from rounding.
    zero, factor, two = (registry.convert(number, source, target) for number in (0.0, 1.0, 2.0))
    linear = abs(zero) + abs(two - 2.0 * factor) <= 1e-12 * abs(factor)
    require(linear, "unit", unit, f"a multiple of {target}", "convert the values beforehand")
    if si is not None:
        return float(factor), si
    # A unit that is an SI unit already keeps the spelling of the user.
    return float(factor), unit if factor == 1.0 else f"{target:~C}" or "1"


_OF_A_PARSER = NotImplementedError, RecursionError, SyntaxError, tokenize.TokenError
_OF_NUMBERS = ArithmeticError, AssertionError, AttributeError, LookupError, TypeError, ValueError
_UNREADABLE = *_OF_A_PARSER, *_OF_NUMBERS
"""Errors that pint raises for texts that are no units; its own classes are subclasses. Any other
error, such as one by which a signal handler ends a program, is not about the unit."""


def _pint_unit(
    registry: "pint.registry.ApplicationRegistry", unit: str, argument: str
) -> "pint.Unit":
    from pint.util import string_preprocessor

    # Units come from headers of files, so pint's parser must not be given an expression that takes
    # it very long. Only powers with small exponents are accepted, and no power directly after
    # another: pint's preprocessor writes every power with "**", and after every accepted power has
    # become "#", neither "##" nor "**" may be left. Exponents of nested powers, as in (m**2*s)**2,
    # multiply, so their product is limited. In it, an exponent below 1 counts as 1, so that it does
    # not compensate for a large one.
    expected = f"a text of at most {LONGEST} characters"
    require(isinstance(unit, str) and len(unit) <= LONGEST, argument, unit, expected, SPELLING)
    plain = string_preprocessor(unit).replace(" ", "")
    powers = POWER.findall(plain)
    chained = "##" in (rest := POWER.sub("#", plain)) or "**" in rest
    small = math.prod(max(float(power), 1.0) for power in powers) <= LARGEST_POWER
    expected = "a unit whose powers are small numbers"
    require(small and not chained, argument, unit, expected, SPELLING)
    try:
        parsed = registry.Unit(unit)
        registry.get_base_units(parsed)  # Overflows for a prefix with a large power.
    except _UNREADABLE as error:
        raise ValueError(
            f"Argument `{argument}` must be a unit that pint knows, but is {unit!r}: {SPELLING}."
        ) from error
    return parsed


class Series(AbstractReadable):
    """Samples of one measured quantity, converted to SI.

    **Arguments:**

    - `channel`: the measured quantity, one of `clearjoint.quantities` or a user-defined function of
      an `Instant`. If the channel has an attribute `period`, such as 2 pi for an angle, residuals
      are taken modulo the period.
    - `times`: (N,) s, strictly rising.
    - `values`: (N,) in `unit`.
    - `noise`: standard deviation of the samples in `unit`: a number, or (N,).
    - `unit`: unit of `values` and `noise`, any that pint knows; by default that of the channel. For
      a channel without an attribute `unit`, such as a plain function, it is required, and the
      function must return values in the SI unit to which it is converted.
    - `name`: name of the series in error messages.

    The attributes `values` and `noise` (N,) are in SI, and `unit` is the SI unit.

    **Raises:** `ValueError` for shapes other than these, a series without samples, numbers that are
    not finite, times that don't rise strictly, noise that is not positive, a channel that is not a
    function, and a unit that is missing, unknown or of another dimension. If JAX traces any of the
    numbers, only the unit and the channel are checked.

    >>> angle = cj.quantities.JointAngle("elbow")
    >>> series = cj.Series(angle, [0.0, 0.1], [90.0, 91.0], noise=0.5, unit="deg")
    >>> series.values.round(4)  # rad
    array([1.5708, 1.5882])
    """

    channel: Quantity = eqx.field(static=True)
    times: Float[np.ndarray | jax.Array, " N"] = eqx.field(metadata={"unit": "s"})
    values: Float[np.ndarray | jax.Array, " N"]
    noise: Float[np.ndarray | jax.Array, " N"]
    unit: str = eqx.field(static=True)
    name: str | None = eqx.field(static=True)

    def __init__(
        self,
        channel: Quantity,
        times: ArrayLike,
        values: ArrayLike,
        noise: ArrayLike,
        unit: str | None = None,
        name: str | None = None,
    ):
        require_quantity("channel", channel)
        si = getattr(channel, "unit", None)
        unit = si if unit is None else unit
        expected = "given for a channel without a unit"
        require(unit is not None, "unit", unit, expected, 'pass it, for example unit="mm"')
        assert unit is not None
        # Without a unit of the channel, values are converted to the SI unit of the same dimension.
        factor, self.unit = to_si(unit, si)
        self.channel, self.name = channel, name
        self.times = as_number(times, "times", "s")
        self.values = as_number(values, "values", unit) * factor
        self.noise = as_number(noise, "noise", unit) * factor
        # A single deviation is repeated for each sample.
        if np.size(self.noise) == 1:
            self.noise = self.noise * np.ones(np.shape(self.values))

    @override
    def __check_init__(self):
        # Numbers that JAX traces have no known values, so they are not checked.
        rows = [concrete(row) for row in (self.times, self.values, self.noise)]
        if any(row is None for row in rows):
            return
        times, values, noise = map(np.asarray, rows)
        label = "" if self.name is None else f" of {self.name!r}"
        is_row = times.ndim == 1 and times.size > 0
        require(is_row, f"times{label}", times.shape, "a row of times", "pass shape (N,), N > 0")
        expected = f"of the shape {times.shape} of the times"
        remedy = "pass one value for each time"
        require(values.shape == times.shape, f"values{label}", values.shape, expected, remedy)
        require(noise.shape == times.shape, f"noise{label}", noise.shape, expected, remedy)
        require_each(np.isfinite(times), f"times{label}", times, "finite", "leave the sample out")
        require_each(np.isfinite(values), f"values{label}", values, "finite", "leave it out")
        positive = np.isfinite(noise) & (noise > 0.0)
        remedy = "give the standard deviation of the samples"
        require_each(positive, f"noise{label}", noise, "finite and positive", remedy)
        rising = np.append(True, np.diff(times) > 0.0)
        expected, remedy = "later than the time before", "sort the samples and merge repeated ones"
        require_each(rising, f"times{label}", times, expected, remedy)

    @property
    def period(self) -> float | None:
        """Period of the quantity, such as 2 pi rad for an angle; ``None`` without one."""
        return getattr(self.channel, "period", None)

    def __len__(self) -> int:
        return len(self.times)

    def residuals(self, prediction: ArrayLike) -> Float[jax.Array | np.ndarray, " N"]:
        """Return (prediction - values) / noise, (N,), for a `prediction`, (N,) in SI units. For a
        channel with a period, the nearest multiple of the period is subtracted from the difference,
        so that -pi and pi agree. A prediction of another shape raises a `ValueError`."""
        arrays = prediction, self.values, self.noise
        traced = any(concrete(array) is None for array in arrays)
        # JAX is used for JAX arrays only. It would compile its operations again for each number of
        # samples, which NumPy need not do.
        library = jnp if traced or isinstance(prediction, jax.Array) else np
        prediction, values, noise = map(library.asarray, arrays)
        shape, expected = prediction.shape, f"of shape {np.shape(self.values)}"
        remedy = "pass one value for each time"
        require(shape == np.shape(self.values), "prediction", shape, expected, remedy)
        difference = prediction - values
        if self.period is not None:
            difference = difference - self.period * library.round(difference / self.period)
        return difference / noise

    def with_noise(self, generator: np.random.Generator) -> "Series":
        """Return a copy with additional normally distributed noise of the standard deviation
        `noise`, as for synthetic measurements."""
        return replace(self, values=self.values + self.noise * generator.standard_normal(len(self)))

    def between(self, start: float, end: float) -> "Series | None":
        """Return the samples with start <= time < end, s, or ``None`` if there are none."""
        inside = (self.times >= start) & (self.times < end)
        if not inside.any():
            return None
        times, values = self.times[inside], self.values[inside]
        return replace(self, times=times, values=values, noise=self.noise[inside])


def require_each(
    valid: np.ndarray, argument: str, values: np.ndarray, expected: str, remedy: str
) -> None:
    """Raise a `ValueError` that names the first entry that is not valid, if there is one."""
    if not valid.all():
        k = int(np.argmin(valid))
        require(False, f"{argument}[{k}]", float(values[k]), expected, remedy)


class Measurements(AbstractReadable):
    """Measured series by name, such as all records of one experiment; their times may differ.

    **Raises:** `ValueError` for an empty dictionary, for a name that is empty or not a string, and
    for an entry that is not a `Series`.

    >>> angle = cj.quantities.JointAngle("elbow")
    >>> encoder = cj.Series(angle, [0.0, 0.1, 0.2], [1.0, 1.1, 1.3], noise=0.01)
    >>> data = cj.Measurements({"encoder": encoder})
    >>> data.between(0.05, 0.3).times()
    array([0.1, 0.2])
    """

    series: dict[str, Series]

    def __init__(self, series: Mapping[str, Series]):
        remedy = 'pass for example {"probe": cj.Series(...)}'
        require_types("series", series, Series, "a Series", remedy)
        require(len(series) > 0, "series", {}, "a dictionary with at least one Series", remedy)
        self.series = dict(series)

    def __getitem__(self, name: str) -> Series:
        return self.series[name]

    def times(self) -> Float[np.ndarray, " T"]:
        """Return the times at which any series has a sample, (T,) s, rising, each time once."""
        return np.unique(np.concatenate([series.times for series in self.series.values()]))

    def between(self, start: float, end: float) -> "Measurements":
        """Return only the samples with start <= time < end, s, so that adjacent windows share none.
        Series without samples in the window are left out.

        **Raises:** `ValueError` for a window without samples.
        """
        parts = {name: series.between(start, end) for name, series in self.series.items()}
        inside = {name: series for name, series in parts.items() if series is not None}
        times = self.times()
        expected = "a window that contains samples"
        remedy = f"choose it between {times[0]} and {times[-1]} s, where the end is excluded"
        require(bool(inside), "start, end", (start, end), expected, remedy)
        return Measurements(inside)

    def check(self, scene: Scene) -> None:
        """Raise a `ValueError` if a scene lacks an element that the quantity of a series names."""
        for name, series in self.series.items():
            check_quantity(f"Series {name!r}", series.channel, scene)

    def with_noise(self, generator: np.random.Generator) -> "Measurements":
        """Return a copy in which each series has additional noise, as by `Series.with_noise`."""
        return Measurements({n: series.with_noise(generator) for n, series in self.series.items()})

    def to_dataset(self) -> "xr.Dataset":
        """Return an `xarray.Dataset` with the values of each series as "<name>" and the standard
        deviations of their noise as "<name>_noise", in SI units, along "time" if all series have
        the same times, otherwise each along "<name>_time". Times are in s.

        **Raises:** `ValueError` if the name of a series is also that of a dimension or of a noise.
        """
        import xarray as xr

        first_times, *others = (series.times for series in self.series.values())
        shared = all(np.array_equal(first_times, times) for times in others)
        variables, coordinates = {}, {}
        for name, series in self.series.items():
            # A dimension has one row of times: series with other times need their own.
            dimension, noise = "time" if shared else f"{name}_time", f"{name}_noise"
            attributes = {"units": series.unit, "ancillary_variables": noise}
            deviation = {"units": series.unit, "long_name": "one standard deviation"}
            variables[name] = (dimension, np.asarray(series.values), attributes)
            variables[noise] = (dimension, np.asarray(series.noise), deviation)
            coordinates[dimension] = (dimension, np.asarray(series.times), {"units": "s"})
        names = sorted([*variables, *coordinates])
        # Of two variables with the same name, the dictionary would have kept only the last.
        unique = len(variables) == 2 * len(self.series) and not set(variables) & set(coordinates)
        remedy = 'rename those called "time" or "..._noise"'
        expected = "series whose names differ from those of noise and time"
        require(unique, "series", names, expected, remedy)
        return xr.Dataset(variables, coordinates)
