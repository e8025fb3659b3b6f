"""Coordinates in which parameters are estimated: free of bounds, and of about unit size."""

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
    """A map from all real numbers, the coordinates, to the values that a parameter may have.

    `stride`: the farthest that one step of a fit changes the coordinate. The numbers of a scale,
    unlike a scene's, are constants of the compiled program: other numbers compile anew.

    ```python
    from dataclasses import dataclass

    import clearjoint as cj

    @dataclass(frozen=True)
    class Squared(cj.extend.AbstractScale):
        unit: float = 1.0
        stride = 1.0

        def value(self, coordinate):
            return self.unit * coordinate**2

        def coordinate(self, value):
            return (value / self.unit) ** 0.5

    stiffness = cj.Parameter(lambda scene: scene.forces["spring"].stiffness, Squared(unit=100.0))
    ```
    """

    stride: ClassVar[float]

    @abc.abstractmethod
    def value(self, coordinate: Scalar) -> Scalar:
        """The parameter at a coordinate."""

    @abc.abstractmethod
    def coordinate(self, value: Scalar | np.ndarray) -> float:
        """The coordinate of a parameter.

        **Raises:** `ValueError` for a value outside the scale.
        """

    def slope(self, coordinate: Scalar) -> np.ndarray:
        """Derivative of the value to the coordinate, ()."""
        return np.asarray(jax.jvp(self.value, (jnp.asarray(coordinate),), (jnp.ones(()),))[1])

    def vague(self, coordinate: float) -> float:
        """Standard deviation of the coordinate beyond which an estimate says nothing: one, the
        usual size of coordinates, unless a subclass overrides it."""
        return 1.0

    def called(self, name: str) -> str:
        """Label of the coordinate of a parameter of this name: the name itself, unless a subclass
        overrides it."""
        return name


@dataclass(frozen=True)
class Linear(AbstractScale):
    """Any value: the coordinate in units of `unit`.

    >>> cj.Linear(unit=0.5).value(3.0)
    1.5
    """

    unit: float = 1.0
    stride: ClassVar[float] = math.inf

    def __post_init__(self) -> None:
        require_positive("unit", self.unit, "give the size of a typical change")

    def value(self, coordinate: Scalar) -> Scalar:
        """The unit times the coordinate."""
        return self.unit * coordinate

    def coordinate(self, value: Scalar | np.ndarray) -> float:
        """The value over the unit."""
        return _finite(value) / self.unit

    def vague(self, coordinate: float) -> float:
        """The unit and the value itself, whichever is larger."""
        return max(1.0, abs(float(coordinate)))

    def called(self, name: str) -> str:
        """The name over the unit, such as "length/0.01"; the name alone if the unit is 1."""
        return name if self.unit == 1.0 else f"{name}/{self.unit:g}"


@dataclass(frozen=True)
class Log(AbstractScale):
    """Positive values: the natural logarithm.

    >>> scale = cj.Log()
    >>> print(f"{scale.coordinate(1.0):.1f}, {scale.value(0.0):.1f}")
    0.0, 1.0
    """

    stride: ClassVar[float] = 1.0

    def value(self, coordinate: Scalar) -> Scalar:
        """The exponential of the coordinate."""
        return library((coordinate,)).exp(coordinate)

    def coordinate(self, value: Scalar | np.ndarray) -> float:
        """The natural logarithm of the value."""
        number = _finite(value)
        require(number > 0.0, "value", number, "positive", "take a Linear() scale")
        return math.log(number)

    def called(self, name: str) -> str:
        """The name behind "log"."""
        return f"log {name}"


@dataclass(frozen=True)
class Bounded(AbstractScale):
    """Values between two bounds: the logarithm of the ratio of the distances to them.

    >>> scale = cj.Bounded(0.0, 1.0)
    >>> print(f"{scale.value(0.0):.2f}, {scale.value(5.0):.3f}")
    0.50, 0.993
    """

    low: float
    high: float
    stride: ClassVar[float] = 1.0

    def __post_init__(self) -> None:
        for name in ("low", "high"):
            require_shape(name, getattr(self, name), (), "pass a single number")
        require(
            self.low < self.high, "high", self.high, f"above low = {self.low}", "swap the bounds"
        )

    def value(self, coordinate: Scalar) -> Scalar:
        """low + (high - low)/(1 + exp(-coordinate))."""
        return self.low + (self.high - self.low) * jax.nn.sigmoid(coordinate)

    def coordinate(self, value: Scalar | np.ndarray) -> float:
        """log((value - low)/(high - value))."""
        number = _finite(value)
        inside = self.low < number < self.high
        bounds = f"between {self.low} and {self.high}"
        require(inside, "value", number, bounds, "start inside the bounds, or widen them")
        return math.log((number - self.low) / (self.high - number))

    def vague(self, coordinate: float) -> float:
        """The standard deviation pi/sqrt(3) that the coordinate of a value has which may lie
        anywhere between the bounds with equal probability."""
        return math.pi / math.sqrt(3.0)

    def called(self, name: str) -> str:
        """The name behind "logit"."""
        return f"logit {name}"


def _finite(value: Scalar | np.ndarray) -> float:
    require_shape("value", value, (), "pass a single number")
    return float(value)
