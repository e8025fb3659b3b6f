"""Scales: maps between a parameter's value and the unbounded coordinate in which a fit works.

Coordinates are of the order of 1, so that parameters of different units can be compared.
"""

import abc
import math
from dataclasses import dataclass
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from ..fields.checks import require, require_positive, require_shape
from ..math.vectors import Scalar, library


@dataclass(frozen=True)
class AbstractScale(abc.ABC):
    """A map from the real numbers, the coordinates, to the values that a parameter may have.

    A subclass defines `value`, its inverse `coordinate`, and `max_step`, the largest change of the
    coordinate in one step of a fit. Fields of a scale, such as bounds, are constants of the
    compiled program: a scale with other fields causes a recompilation.

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
        """Return the parameter's value at a coordinate; JAX must be able to differentiate the
        function."""

    @abc.abstractmethod
    def coordinate(self, value: Scalar | np.ndarray) -> float:
        """Return the coordinate at which the parameter has a given value.

        **Raises:** `ValueError` for a value that the scale doesn't allow.
        """

    def slope(self, coordinate: Scalar) -> np.ndarray:
        """Return the derivative of the value by the coordinate, an array of shape ()."""
        return np.asarray(jax.jvp(self.value, (jnp.asarray(coordinate),), (jnp.ones(()),))[1])

    def uninformative_std(self, coordinate: float) -> float:
        """Return the standard deviation of the coordinate above which an estimate carries no
        information.

        A parameter with a larger one counts as not identifiable. The default is 1, the usual size
        of coordinates: on a `Log` scale, an uncertainty by a factor of e.

        **Arguments:** `coordinate`: estimated coordinate.
        """
        return 1.0

    def label(self, name: str) -> str:
        """Return text that names the coordinate of the parameter `name`; by default the name
        itself."""
        return name


@dataclass(frozen=True)
class Linear(AbstractScale):
    """Scale of any value: value = unit * coordinate.

    The steps of a fit are not limited.

    **Arguments:** `unit`: size of a typical change of the value, in the parameter's unit; positive.

    **Raises:** `ValueError` for a `unit` that is not positive.

    >>> cj.Linear(unit=0.5).value(3.0)
    1.5
    """

    unit: float = 1.0
    max_step: ClassVar[float] = math.inf

    def __post_init__(self) -> None:
        require_positive("unit", self.unit, "give the size of a typical change")

    def value(self, coordinate: Scalar) -> Scalar:
        """Return unit * coordinate."""
        return self.unit * coordinate

    def coordinate(self, value: Scalar | np.ndarray) -> float:
        """Return value / unit.

        **Raises:** `ValueError` unless the value is a single finite number.
        """
        return _finite(value) / self.unit

    def uninformative_std(self, coordinate: float) -> float:
        """Return max(1, abs(coordinate)): an error as large as the value, but at least `unit`."""
        return max(1.0, abs(float(coordinate)))

    def label(self, name: str) -> str:
        """Return the name divided by the unit, such as "length/0.01"; the name for unit 1."""
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

    def value(self, coordinate: Scalar) -> Scalar:
        """Return exp(coordinate)."""
        return library((coordinate,)).exp(coordinate)

    def coordinate(self, value: Scalar | np.ndarray) -> float:
        """Return log(value).

        **Raises:** `ValueError` for a value that is not a positive, finite number.
        """
        number = _finite(value)
        require(number > 0.0, "value", number, "positive", "take a Linear() scale")
        return math.log(number)

    def label(self, name: str) -> str:
        """Return "log" and the name, such as "log stiffness"."""
        return f"log {name}"


@dataclass(frozen=True)
class Bounded(AbstractScale):
    """Scale of values between two bounds: coordinate = log((value - low)/(high - value)).

    One step of a fit changes the coordinate by 1 at most.

    **Arguments:** `low`, `high`: bounds in the parameter's unit, which values only approach.

    **Raises:** `ValueError` unless both are single numbers and low < high.

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

    def value(self, coordinate: Scalar) -> Scalar:
        """Return low + (high - low)/(1 + exp(-coordinate))."""
        return self.low + (self.high - self.low) * jax.nn.sigmoid(coordinate)

    def coordinate(self, value: Scalar | np.ndarray) -> float:
        """Return log((value - low)/(high - value)).

        **Raises:** `ValueError` for a value that is not between the bounds.
        """
        number = _finite(value)
        inside = self.low < number < self.high
        bounds = f"between {self.low} and {self.high}"
        require(inside, "value", number, bounds, "start inside the bounds, or widen them")
        return math.log((number - self.low) / (self.high - number))

    def uninformative_std(self, coordinate: float) -> float:
        """Return pi/sqrt(3), about 1.8, for every coordinate.

        This is the standard deviation of the coordinate if only the bounds are known, with a value
        that is uniformly distributed between them.
        """
        return math.pi / math.sqrt(3.0)

    def label(self, name: str) -> str:
        """Return "logit" and the name, such as "logit friction"."""
        return f"logit {name}"


def _finite(value: Scalar | np.ndarray) -> float:
    """Return a value as a float.

    **Raises:** `ValueError` unless it is a single finite number.
    """
    require_shape("value", value, (), "pass a single number")
    return float(value)
