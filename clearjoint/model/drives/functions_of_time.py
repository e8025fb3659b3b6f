"""Functions of time that drives follow: polynomials, splines through tables, and one's own."""

import abc
from collections.abc import Callable
from typing import ClassVar, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ...fields.checks import as_number, checkable, require, require_finite
from ...fields.conversion import AbstractConverting, on_device
from ...fields.declarations import quantity
from ...fields.types import ArrayLike, Column, TableRows
from ...math.interpolation import Slope, hermite_value
from ...math.vectors import Scalar


class AbstractFunctionOfTime(AbstractConverting):
    """A function of time in s, that JAX can differentiate twice, with its numbers.

    Its unit is that of what follows it. `jumps` tells whether it may jump, which a torque or a load
    may, and no angle.

    ```python
    import clearjoint as cj
    import jax.numpy as jnp

    class Oscillation(cj.extend.AbstractFunctionOfTime):
        amplitude: float
        frequency: float  # rad/s

        def __call__(self, t):
            return self.amplitude * jnp.sin(self.frequency * t)

    drive = cj.PrescribedAngle("ground", "crank", (0, 0, 1), Oscillation(0.5, frequency=20.0))
    ```
    """

    jumps: ClassVar[bool] = False

    @abc.abstractmethod
    def __call__(self, t: Scalar) -> Scalar:
        """The value at a time in s."""

    def breakpoints(self) -> PyTree:
        """Times in s of its kinks and jumps, as an element's own `breakpoints`; none by default."""
        return ()


class _PlainFunction(AbstractFunctionOfTime):
    """A Python function: part of the program, without numbers of its own."""

    function: Callable[[jax.Array], Scalar] = eqx.field(static=True)

    def __call__(self, t: Scalar) -> Scalar:
        return self.function(jnp.asarray(t, dtype=float))


class Polynomial(AbstractFunctionOfTime):
    """The sum of coefficients times powers of the time, lowest first: (2.0,) is constant, and
    (0.1, 50.0) begins at 0.1 and grows by 50 a second.

    **Arguments:** `coefficients`: (N,), of one's unit by powers of s.

    **Raises:** `ValueError` for coefficients that are not a row of finite numbers.

    >>> cj.Polynomial((0.1, 50.0))(2.0).item()  # 0.1 + 50 t
    100.1
    """

    coefficients: Column = quantity("1", table=True)

    def __check_init__(self):
        shape = np.shape(self.coefficients)
        remedy = "pass the coefficients in a list, the constant first"
        require(len(shape) == 1 and shape != (0,), "coefficients", shape, "a row", remedy)
        require_finite("coefficients", self.coefficients)

    def __call__(self, t: Scalar) -> Scalar:
        """The value at a time in s."""
        value: Scalar = 0.0
        for k in reversed(range(self.coefficients.shape[0])):
            value = value * t + self.coefficients[k]
        return value


class Spline(AbstractFunctionOfTime):
    """Cubic polynomials between the times of a table, with its values and rates there.

    `Spline.through(times, values)` finds the rates by which curvature is continuous and zero at the
    ends. Before the first time and after the last the function goes on along its tangent.

    **Arguments:** `times` (N,) in s, rising; `values` (N,) and `rates` (N,) a second; of a force
    both may be (N, 3).

    **Raises:** `ValueError` for rows of different lengths, of fewer than two or unlike finite
    numbers, and for times that do not rise.

    >>> spline = cj.Spline.through([0.0, 1.0, 2.0], [0.0, 1.0, 0.0])
    >>> print(f"{spline(1.0):.1f}, {spline(0.5):.4f}")
    1.0, 0.6875
    """

    times: Column = quantity("s", table=True)
    values: TableRows = quantity("1", table=True)
    rates: TableRows = quantity("1/s", table=True)

    def __check_init__(self):
        require_rising(self.times)
        require_rows("values", self.values, np.shape(self.times))
        alike = f"of the shape {np.shape(self.values)} of `values`"
        rates = np.shape(self.rates)
        require(rates == np.shape(self.values), "rates", rates, alike, "give one a value")
        require_finite("rates", self.rates)

    @staticmethod
    def through(times: ArrayLike, values: ArrayLike) -> "Spline":
        """The natural cubic spline through a table (SciPy's `CubicSpline`).

        **Arguments:** `times` (N,) in s, rising; `values` (N,), or (N, 3) of a force.
        """
        from scipy.interpolate import CubicSpline

        times, values = as_number(times, "times", "s"), as_number(values, "values")
        require_rising(times)
        require_rows("values", values, np.shape(times))
        spline = CubicSpline(np.asarray(times), np.asarray(values), bc_type="natural")
        return Spline(times, values, spline(times, 1))

    def __call__(self, t: Scalar) -> Scalar:
        """The value at a time in s."""
        times, values, rates = map(on_device, (self.times, self.values, self.rates))
        k = jnp.clip(jnp.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
        length, within = times[k + 1] - times[k], jnp.clip(t, times[0], times[-1])
        start, end = (Slope(values[j], rates[j]) for j in (k, k + 1))
        value = hermite_value((within - times[k]) / length, start, end, length)
        before, after = jnp.minimum(t - times[0], 0.0), jnp.maximum(t - times[-1], 0.0)
        return value + before * rates[0] + after * rates[-1]

    def breakpoints(self) -> PyTree:
        """None: where its pieces meet, curvature is continuous."""
        return ()


FunctionOfTime: TypeAlias = AbstractFunctionOfTime | Callable[[jax.Array], Scalar] | float
"""A function of time as it is given."""


def as_function_of_time(value: FunctionOfTime) -> AbstractFunctionOfTime:
    """A function of time as elements store it.

    **Raises:** `ValueError` for what is neither a number nor a function.
    """
    if isinstance(value, AbstractFunctionOfTime):
        return value
    if callable(value):
        return _PlainFunction(value)
    number = as_number(value, "function")
    remedy = (
        "pass a number, a function of the time, or for a table Spline.through(times, values) or "
        "PiecewiseLinear(times, values)"
    )
    require(np.shape(number) == (), "function", value, "a function of the time", remedy)
    return Polynomial([number])


def require_rising(times: ArrayLike) -> None:
    """Check times, s, to rise."""
    shape = np.shape(times)
    remedy = "pass two at least, sorted, none of them twice"
    require(len(shape) == 1 and shape[0] > 1, "times", shape, "two times or more, in a row", remedy)
    require_finite("times", times)
    if (known := checkable(times)) is not None:
        (numbers,) = known
        require((numbers[1:] > numbers[:-1]).all(), "times", numbers, "rising", remedy)


def require_continuous(function: AbstractFunctionOfTime) -> None:
    """Check a function that an angle or a distance follows not to jump."""
    remedy = "take PiecewiseLinear(times, values), or Spline.through(times, values)"
    kind = type(function).__name__
    require(not function.jumps, "function", kind, "continuous, since bodies can't jump", remedy)


def require_rows(argument: str, values: ArrayLike, shape: tuple[int, ...]) -> None:
    """Check for a finite number, or three, at each of the times."""
    given, remedy = np.shape(values), "give one a time, or three of a force"
    expected = f"of the shape {shape} of `times`, or {(*shape, 3)}"
    require(given in (shape, (*shape, 3)), argument, given, expected, remedy)
    require_finite(argument, values)
