"""Parameters of a scene that a fit estimates, and their scales, which relate values to coordinates:
a typical change of a coordinate is of the order of 1, whatever the unit of the value."""

import abc
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from typing_extensions import override

from .._fields.checks import require, require_positive, require_shape, require_types
from .._math.vectors import Scalar, library
from .._model.bodies import State
from .._model.scene import Scene
from . import variations
from .paths import NumberPath, value_at
from .variations import AbstractSeriesVariation, AbstractVariation, Change, SceneNumber

WIDTH = 1.96
"""Half width of a 95 % interval of a coordinate whose standard deviation is 1."""
GONE = 5.0
"""Standard deviation of a logarithm above which an estimate is about zero or infinite."""


@dataclass(frozen=True)
class AbstractScale(abc.ABC):
    """A map from the real numbers, the coordinates, to the values that a parameter may have.

    A subclass defines `value`, its inverse `coordinate`, and `max_step`, the largest change of the
    coordinate in one step of a fit. Fields of a scale, such as bounds, are constants of the
    compiled program: a scale whose fields have other values causes a recompilation.

    ```python
    from dataclasses import dataclass

    import clearjoint as cj

    @dataclass(frozen=True)
    class Squared(cj.extend.AbstractScale):
        unit: float = 1.0
        max_step = 1.0

        def value(self, coordinate):
            return self.unit * coordinate**2

        def coordinate(self, value):
            return (value / self.unit) ** 0.5

    stiffness = cj.Parameter(lambda scene: scene.forces["spring"].stiffness, Squared(unit=100.0))
    ```
    """

    max_step: ClassVar[float]
    """Largest change of the coordinate in one step of a fit, which keeps a parameter that the data
    hardly determine from running away; infinite for no limit."""

    @abc.abstractmethod
    def value(self, coordinate: Scalar) -> Scalar:
        """Return the parameter's value at a coordinate; JAX must be able to differentiate it."""

    @abc.abstractmethod
    def coordinate(self, value: Scalar | np.ndarray) -> float:
        """Return the coordinate at which the parameter has a given value.

        **Raises:** `ValueError` for a value that the scale doesn't allow.
        """

    def slope(self, coordinate: Scalar) -> np.ndarray:
        """Return the derivative of the value by the coordinate, an array of shape ()."""
        return np.asarray(jax.jvp(self.value, (jnp.asarray(coordinate),), (jnp.ones(()),))[1])

    def uninformative_std(self, coordinate: float) -> float:
        """Return the standard deviation of the coordinate above which a parameter counts as not
        identifiable; by default 1, which on a `Log` scale is a factor of e in the value."""
        return 1.0

    def interval(self, coordinate: float, half: float, rising: bool) -> tuple[float, float]:
        """Return the ends of the confidence interval of an estimated value.

        By default these are the values at ``coordinate - half`` and ``coordinate + half``, where
        `half` is the half width of the coordinate's interval. A scale overrides this method if an
        end of its range, such as a friction of zero, has an infinite coordinate. Near this end
        `half` is very large, since the data hardly depend on the coordinate. `rising` tells whether
        the estimate went up from its first guess, towards the upper end of the range, or down.
        """
        return float(self.value(coordinate - half)), float(self.value(coordinate + half))

    def label(self, name: str) -> str:
        """Return a name for the coordinate of a parameter, by default the parameter's name."""
        return name


@dataclass(frozen=True)
class Linear(AbstractScale):
    """Scale of any value: value = unit * coordinate. The steps of a fit are not limited.

    `unit` is the size of a typical change of the value, in the parameter's unit; positive.

    >>> cj.Linear(unit=0.5).value(3.0)
    1.5
    """

    unit: float = 1.0
    max_step: ClassVar[float] = math.inf

    def __post_init__(self) -> None:
        require_positive("unit", self.unit, "give the size of a typical change")

    @override
    def value(self, coordinate: Scalar) -> Scalar:
        return self.unit * coordinate

    @override
    def coordinate(self, value: Scalar | np.ndarray) -> float:
        return _finite(value) / self.unit

    @override
    def uninformative_std(self, coordinate: float) -> float:
        """Return max(1, abs(coordinate)): a coordinate with this standard deviation has a value
        whose standard deviation is the value's magnitude or, if that is larger, `unit`."""
        return max(1.0, abs(float(coordinate)))

    @override
    def label(self, name: str) -> str:
        return name if self.unit == 1.0 else f"{name}/{self.unit:g}"


@dataclass(frozen=True)
class Log(AbstractScale):
    """Scale of positive values: value = exp(coordinate).

    One step of a fit changes the value by a factor of e at most.

    >>> scale = cj.Log()
    >>> print(f"{scale.coordinate(1.0):.1f}, {scale.value(0.0):.1f}")
    0.0, 1.0
    """

    max_step: ClassVar[float] = 1.0

    @override
    def value(self, coordinate: Scalar) -> Scalar:
        return library((coordinate,)).exp(coordinate)

    @override
    def coordinate(self, value: Scalar | np.ndarray) -> float:
        number = _finite(value)
        require(number > 0.0, "value", number, "positive", "take a Linear() scale")
        return math.log(number)

    @override
    def interval(self, coordinate: float, half: float, rising: bool) -> tuple[float, float]:
        """Return the values at ``coordinate - half`` and ``coordinate + half``, with zero as the
        lower end if `half` exceeds 1. If `half` exceeds 9.8 (a standard deviation of 5), the
        coordinate has run to infinity: up if `rising`, else down. The estimate v is then infinite
        or zero in practice, and the data depend about linearly on 1/v or v, so that the interval
        is from v / (1 + half) to infinity, or from 0 to v (1 + half)."""
        if half <= 1.0:
            return super().interval(coordinate, half, rising)
        value = float(self.value(coordinate))
        if half <= GONE * WIDTH:
            return 0.0, value * math.exp(half)
        return (value / (1.0 + half), math.inf) if rising else (0.0, value * (1.0 + half))

    @override
    def label(self, name: str) -> str:
        return f"log {name}"


@dataclass(frozen=True)
class Bounded(AbstractScale):
    """Scale of values between two bounds: coordinate = log((value - low)/(high - value)).

    One step of a fit changes the coordinate by 1 at most. Only a value strictly between the bounds
    has a coordinate. Far coordinates, such as 40, give a value that is rounded to a bound.

    **Raises:** `ValueError` unless both bounds are single finite numbers and low < high.

    >>> scale = cj.Bounded(0.0, 1.0)
    >>> print(f"{scale.value(0.0):.2f}, {scale.value(5.0):.3f}")
    0.50, 0.993
    """

    low: float
    high: float
    max_step: ClassVar[float] = 1.0

    def __post_init__(self) -> None:
        for name in ("low", "high"):
            require_shape(name, getattr(self, name), (), "pass a single number")
        above = f"above low = {self.low}"
        require(self.low < self.high, "high", self.high, above, "swap the bounds")

    @override
    def value(self, coordinate: Scalar) -> Scalar:
        return self.low + (self.high - self.low) * jax.nn.sigmoid(coordinate)

    @override
    def coordinate(self, value: Scalar | np.ndarray) -> float:
        number = _finite(value)
        inside = self.low < number < self.high
        bounds = f"between {self.low} and {self.high}"
        require(inside, "value", number, bounds, "start inside the bounds, or widen them")
        return math.log((number - self.low) / (self.high - number))

    @override
    def interval(self, coordinate: float, half: float, rising: bool) -> tuple[float, float]:
        """Return the values at ``coordinate - half`` and ``coordinate + half`` if `half` is at most
        1.96, as for a coordinate with a standard deviation of 1 or less. Otherwise, return the
        value plus and minus `half` times its derivative by the coordinate, cut off at the bounds.
        `rising` is not used."""
        if half <= WIDTH:
            return super().interval(coordinate, half, rising)
        value, change = float(self.value(coordinate)), half * float(self.slope(coordinate))
        return max(self.low, value - change), min(self.high, value + change)

    @override
    def uninformative_std(self, coordinate: float) -> float:
        """Return pi/sqrt(3) at the coordinate zero: the standard deviation of the coordinate of a
        value that is uniformly distributed between the bounds. Towards the bounds the result rises,
        so that it corresponds to the same standard deviation of the value everywhere."""
        return math.pi / math.sqrt(3.0) * math.cosh(0.5 * coordinate) ** 2

    @override
    def label(self, name: str) -> str:
        return f"logit {name}"


def _finite(value: Scalar | np.ndarray) -> float:
    require_shape("value", value, (), "pass a single number")
    return float(value)


@dataclass(frozen=True, init=False)
class Parameter:
    """A number of the scene that a fit estimates, and the scale of the estimate.

    A parameter may also be a number of the initial state (`Parameter.initial`), a value from which
    a function makes scene and state (`Parameter.change`), or an unknown error of the sensors of
    measured series: `Parameter.delay`, `Parameter.bias`, `Parameter.gain` and `Parameter.drift`.

    **Arguments:**

    - `path`: function that selects the number in a scene, such as ``lambda scene:
      scene.joints["pin"].clearance``. A path to several numbers ties them: they share one value.
    - `scale`: `Linear()` by default; `Log()` for positive numbers, `Bounded(low, high)` for numbers
      between bounds. A scale gives each value an unbounded coordinate, in which the fit works and
      by which derivatives are taken.
    - `value`: first guess, SI; ``None`` for the number's value in the scene or initial state.
    - `unit`: text that labels the values and converts nothing; by default the number's SI unit.

    **Raises:** `ValueError` if the path is no function, or the `scale` no `AbstractScale`.

    >>> parameter = cj.Parameter(lambda scene: scene.joints["shoulder"].clearance, cj.Log())
    >>> scene, state = cj.mechanisms.double_pendulum(clearance=0.5e-3)
    >>> print(f"{parameter.coordinate_in(scene, state):.4f}")  # log(0.5e-3)
    -7.6009
    """

    variation: AbstractVariation
    scale: AbstractScale
    value: float | None
    _is_held: bool = field(default=False, repr=False)

    def __init__(
        self,
        path: NumberPath | AbstractVariation,
        scale: AbstractScale | None = None,
        *,
        value: float | None = None,
        unit: str | None = None,
    ):
        variation = path if isinstance(path, AbstractVariation) else SceneNumber(path, unit)
        # The error for a class that was not called, such as cj.Log, names this class.
        kind = scale if isinstance(scale, type) else type(scale)
        remedy = "pass for example cj.Log() or cj.Bounded(0.0, 1.0)"
        is_scale = isinstance(scale, AbstractScale | None)
        require(is_scale, "scale", kind.__name__, "a scale, such as Linear(), or None", remedy)
        # The class is frozen, so its fields are set in the dictionary of the object.
        scale = Linear() if scale is None else scale
        vars(self).update(variation=variation, scale=scale, value=value)

    @staticmethod
    def initial(
        path: NumberPath,
        scale: AbstractScale | None = None,
        *,
        value: float | None = None,
        unit: str | None = None,
    ) -> "Parameter":
        """Return a parameter that is a number of the initial state, selected by a path such as
        ``lambda state: state.bodies["arm"].spin[2]``. Arguments and errors: as for `Parameter`."""
        return Parameter(variations.StateNumber(path, unit), scale, value=value)

    @staticmethod
    def change(
        make: Change, value: float, scale: AbstractScale | None = None, unit: str = "1"
    ) -> "Parameter":
        """Return a parameter whose value enters the scene and the initial state through a function.

        ``make(scene, state, value)`` returns the changed pair (scene, state). The first guess,
        `value`, is required, because the scene has no such number.
        """
        return Parameter(variations.MadeByFunction(make, unit), scale, value=value)

    @staticmethod
    def delay(*series: str, value: float = 0.0, scale: AbstractScale | None = None) -> "Parameter":
        """Return a parameter that is the delay, s, of the time stamps of measured series.

        A sample at time t is compared with the motion at t - delay. `identify`, `identify_many`,
        `minimise` and `posterior` accept delays. All named series have the same delay. The scale
        `Bounded(-1e-3, 1e-3)` keeps it within 1 ms.

        A sample whose time less the delay is before the start of the run is compared with the
        initial state: leave such samples out by `Measurements.between`. A delay common to all
        series is identifiable only if the initial state is known, or if the motion depends on time
        itself, for example by a driver, and not only on the time since its start.

        >>> delay = cj.Parameter.delay("probe x", "probe y")
        >>> delay.value
        0.0
        """
        return _of_sensors(variations.SeriesDelay, series, value, scale)

    @staticmethod
    def bias(*series: str, value: float = 0.0, scale: AbstractScale | None = None) -> "Parameter":
        """Return a parameter that is the bias of the sensors of measured series, in their unit.

        The reading of a sensor with errors is gain * y + bias + drift * t, for the quantity y and
        the time t since the start of the run. All named series have the same value, and so must
        have the same unit. `identify`, `identify_many`, `minimise`, `posterior`, `sensitivities`,
        `identifiability` and `fit_horizon` accept such a parameter; the last three take names of
        outputs or sensors in place of series. Residuals of a quantity with a period, such as an
        angle, are taken modulo the period.

        >>> bias = cj.Parameter.bias("encoder", value=0.01)
        >>> bias.value
        0.01
        """
        return _of_sensors(variations.SeriesBias, series, value, scale)

    @staticmethod
    def gain(*series: str, value: float = 1.0, scale: AbstractScale | None = None) -> "Parameter":
        """Return a parameter that is the gain of the sensors of measured series: the factor by
        which they multiply the quantity, see `Parameter.bias`.

        It is identifiable only if the true size of the motion shows elsewhere, such as in the
        frequency of a vibration, in the scene's known lengths, or in another sensor. The reading of
        an angle that jumps from pi to -pi jumps by 2 pi times the gain.

        >>> cj.Parameter.gain("torque", scale=cj.Bounded(0.8, 1.2)).value
        1.0
        """
        return _of_sensors(variations.SeriesGain, series, value, scale)

    @staticmethod
    def drift(*series: str, value: float = 0.0, scale: AbstractScale | None = None) -> "Parameter":
        """Return a parameter that is the drift of the sensors of measured series: the rate, in
        their unit per second, at which their bias changes from zero at the start of the run, see
        `Parameter.bias`.

        >>> cj.Parameter.drift("encoder").value
        0.0
        """
        return _of_sensors(variations.SeriesDrift, series, value, scale)

    def coordinate_in(self, scene: Scene, state: State) -> float:
        """Return the coordinate of `value` or, if `value` is ``None``, of the number in the scene
        or state, the first of tied numbers.

        **Raises:** `ValueError` for a value that the scale doesn't allow; if `value` is ``None``,
        also for a path that leads to no number, and for what is no number of the scene or state,
        such as an error of sensors.
        """
        value, variation = self.value, self.variation
        if value is None:
            if not isinstance(variation, variations.AbstractNumber):
                kind = type(variation).__name__
                raise ValueError(
                    f"Argument `value` must be a number for a {kind}, of which the scene has no "
                    "value, but is None: pass Parameter(..., value=...)."
                )
            value = value_at(variation.tree(scene, state), variation.path)
        return self.scale.coordinate(value)


def _of_sensors(
    kind: type[AbstractSeriesVariation],
    series: tuple[str, ...],
    value: float,
    scale: AbstractScale | None,
) -> Parameter:
    remedy = f'pass their names in the measurements, such as Parameter.{kind.noun}("probe")'
    named = len(series) > 0 and all(isinstance(name, str) for name in series)
    require(named, "series", series, "names of series", remedy)
    return Parameter(kind(series), scale, value=value)


PASS_PARAMETERS = 'pass {"clearance": cj.Parameter(lambda scene: scene.joints["pin"].clearance)}'


def held(parameter: Parameter, value: float) -> Parameter:
    """Return a copy of a parameter that a fit holds at a `value`, SI, and leaves out of its result.
    The fit's runs share the compiled programs of a fit in which the parameter is free."""
    copy = Parameter(parameter.variation, parameter.scale, value=value)
    vars(copy).update(_is_held=True)
    return copy


def free_parameters(parameters: Mapping[str, Parameter]) -> dict[str, Parameter]:
    """Return the parameters that are not `held`."""
    return {name: p for name, p in parameters.items() if not p._is_held}


def check_parameters(parameters: Mapping[str, Parameter]) -> None:
    require_types("parameters", parameters, Parameter, "a Parameter", PASS_PARAMETERS)
    require(len(parameters) > 0, "parameters", {}, "at least one Parameter", PASS_PARAMETERS)


def step_limits(parameters: Mapping[str, Parameter]) -> np.ndarray:
    """Return the largest change of each parameter's coordinate in one step of a fit, (p,)."""
    return np.array([parameter.scale.max_step for parameter in parameters.values()])


def values_of_points(
    parameters: Mapping[str, Parameter], points: Float[np.ndarray, "n p"]
) -> dict[str, Float[np.ndarray, " n"]]:
    # A user-defined scale need not accept arrays, so JAX vectorises it. One call for each number
    # would be slow, since JAX may compile in each.
    pairs = zip(parameters.items(), map(jnp.asarray, points.T), strict=True)
    return {n: np.asarray(jax.vmap(p.scale.value)(row), float) for (n, p), row in pairs}


def values_at(
    parameters: Mapping[str, Parameter], coordinates: Float[np.ndarray, " p"]
) -> dict[str, float]:
    pairs = zip(parameters.items(), coordinates, strict=True)
    return {name: float(parameter.scale.value(u)) for (name, parameter), u in pairs}


def coordinates_of(scene: Scene, state: State, parameters: Mapping[str, Parameter]) -> np.ndarray:
    return np.array([p.coordinate_in(scene, state) for p in parameters.values()])
