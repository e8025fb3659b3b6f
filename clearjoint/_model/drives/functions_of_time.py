"""Functions of time for drives and loads, and declarations of the fields that hold them."""

import abc
from collections.abc import Callable
from functools import partial
from typing import ClassVar, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree
from typing_extensions import override

from ..._fields.checks import as_number, require, require_finite, require_numbers, require_shape
from ..._fields.objects import AbstractConverting, on_device, quantity
from ..._fields.types import ArrayLike, Column, Single, TableRows, Triple
from ..._math.interpolation import Slope, hermite_value
from ..._math.smoothing import value_and_slope
from ..._math.vectors import Scalar, Vector


class AbstractFunctionOfTime(AbstractConverting):
    """Base class of functions of time that JAX can differentiate twice between their breakpoints.

    The argument is the time in s. The value is in the SI unit of the angle, distance, torque or
    force that the function prescribes. The class attribute `jumps`, false by default, states
    whether the value may jump: a torque or load may, but an angle or distance may not.

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
        """Return the value, a number or the three components of a vector, at a time in s."""

    def breakpoints(self) -> PyTree:
        """Return the times in s of the function's kinks and jumps, at which steps end; none by
        default. The result may be a number, an array, or a tuple of both. Runs that compute
        derivatives, such as those of `sensitivities`, raise an error for a function that compares,
        rounds or clips the time, unless its class defines this method."""
        return ()


class PlainFunction(AbstractFunctionOfTime):
    """A Python function of the time in s, which becomes part of the compiled program."""

    function: Callable[[jax.Array], PyTree] = eqx.field(static=True)

    @override
    def __call__(self, t: Scalar) -> Scalar:
        try:
            return self.function(jnp.asarray(t, dtype=float))
        except (jax.errors.ConcretizationTypeError, jax.errors.TracerArrayConversionError) as error:
            raise ValueError(
                f"Argument `function` must be a function of time that JAX can trace, but is "
                f"{self.function!r}: compute with jax.numpy in place of math, numpy, if and float."
            ) from error


class Polynomial(AbstractFunctionOfTime):
    """A polynomial in time, c_0 + c_1 t + c_2 t^2 + ...

    **Arguments:** `coefficients`: (N,), N at least 1, the constant first; the unit of c_k is the SI
    unit of the value over s^k. A `ValueError` for another shape, or numbers that are not finite.

    >>> cj.Polynomial((0.1, 50.0))(2.0).item()  # 0.1 + 50 t
    100.1
    """

    coefficients: Column = quantity("1", table=True)

    @override
    def __check_init__(self):
        shape = np.shape(self.coefficients)
        remedy = "pass the coefficients in a list, the constant first"
        require(len(shape) == 1 and shape != (0,), "coefficients", shape, "a row", remedy)
        require_finite("coefficients", self.coefficients)

    @override
    def __call__(self, t: Scalar) -> Scalar:
        # Horner's scheme.
        value: Scalar = 0.0
        for k in reversed(range(self.coefficients.shape[0])):
            value = value * t + self.coefficients[k]
        return value


class AbstractTable(AbstractFunctionOfTime):
    """Base class of functions of time given by a table: two or more increasing `times`, (N,) s, and
    `values` in the SI unit of what the function prescribes, (N,) or, for a vector, (N, 3)."""

    times: Column = quantity("s", table=True)
    values: TableRows = quantity("1", table=True)

    @override
    def __check_init__(self):
        require_table(self.times, self.values)


class Spline(AbstractTable):
    """A cubic spline through a table of values and their rates.

    Between two times it is the cubic polynomial with the given values and rates at both (Hermite
    interpolation), and outside the table its tangent. `Spline.through(times, values)` computes the
    rates of the natural spline. Choose it for dense samples: steps need not end at its times.

    **Arguments:** `times`: (N,) s, increasing, at least two. `values`: (N,), or (N, 3) for a force
    or torque vector, in the SI unit of what the function prescribes. `rates`: time derivatives of
    the values, of the same shape.

    >>> spline = cj.Spline.through([0.0, 1.0, 2.0], [0.0, 1.0, 0.0])
    >>> print(f"{spline(1.0):.1f}, {spline(0.5):.4f}")
    1.0, 0.6875
    """

    rates: TableRows = quantity("1/s", table=True)

    @override
    def _check_together(self) -> None:
        expected = f"of the shape {np.shape(self.values)} of `values`"
        rates = np.shape(self.rates)
        require(rates == np.shape(self.values), "rates", rates, expected, "give one per value")
        require_finite("rates", self.rates)

    @staticmethod
    def through(times: ArrayLike, values: ArrayLike) -> "Spline":
        """Return the natural cubic spline through a table, from SciPy's `CubicSpline`: its second
        derivative is continuous, and zero at both ends. JAX may not trace the arguments."""
        from scipy.interpolate import CubicSpline

        times, values = as_number(times, "times", "s"), as_number(values, "values")
        require_table(times, values)
        spline = CubicSpline(np.asarray(times), np.asarray(values), bc_type="natural")
        return Spline(times, values, spline(times, 1))

    @override
    def __call__(self, t: Scalar) -> Scalar:
        times, values, rates = map(on_device, (self.times, self.values, self.rates))
        # k is the index of the interval that contains t; outside the table, of the first or the
        # last interval.
        k = jnp.clip(jnp.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
        # Outside the table, its end replaces t. The derivative of `jnp.clip` is 1/2 at both ends: a
        # run would begin at the first time with a wrong acceleration.
        inside = jnp.where(t < times[0], times[0], jnp.where(t > times[-1], times[-1], t))
        length = times[k + 1] - times[k]
        start, end = (Slope(values[j], rates[j]) for j in (k, k + 1))
        value = hermite_value((inside - times[k]) / length, start, end, length)
        # Outside the table the Hermite value is that of the end, and the tangent continues it.
        before = jnp.where(t < times[0], t - times[0], 0.0)
        after = jnp.where(t > times[-1], t - times[-1], 0.0)
        return value + before * rates[0] + after * rates[-1]

    @override
    def breakpoints(self) -> PyTree:
        return ()


class Increasing(eqx.Module):
    """Breakpoints of a table, (N,) s, known to be increasing, so that bisection finds the next
    breakpoint after a time."""

    times: ArrayLike


FunctionOfTime: TypeAlias = AbstractFunctionOfTime | Callable[[jax.Array], Scalar] | float
"""Types that users may pass as a function of time."""


def as_function_of_time(
    value: FunctionOfTime, argument: str = "function", unit: str = "1"
) -> AbstractFunctionOfTime:
    if isinstance(value, AbstractFunctionOfTime):
        return value
    if callable(value):
        return PlainFunction(value)
    number = as_number(value, argument, unit)
    remedy = (
        "pass a number, a function of the time, or for a table Spline.through(times, values) or "
        "PiecewiseLinear(times, values)"
    )
    require(np.shape(number) == (), argument, value, "a function of the time", remedy)
    return Polynomial([number])


def require_table(times: ArrayLike, values: ArrayLike) -> None:
    shape = np.shape(times)
    remedy = "pass at least two times, sorted and without duplicates"
    require(len(shape) == 1 and shape[0] > 1, "times", shape, "a row of two or more times", remedy)
    require_finite("times", times)
    require_numbers(lambda t: (t[1:] > t[:-1]).all(), "times", (times,), "increasing", remedy)
    of_values, remedy = np.shape(values), "give one value per time, or three for a force"
    expected = f"of the shape {shape} of `times`, or {(*shape, 3)}"
    require(of_values in (shape, (*shape, 3)), "values", of_values, expected, remedy)
    require_finite("values", values)


def require_continuous(function: FunctionOfTime) -> None:
    remedy = "use PiecewiseLinear(times, values) or Spline.through(times, values)"
    name, jumps = type(function).__name__, as_function_of_time(function).jumps
    require(not jumps, "function", name, "continuous, since bodies can't jump", remedy)


class PiecewiseConstant(AbstractTable):
    """A step function from a table, for torques and loads that are switched.

    Each value holds from its time until the next; the first value also holds before the first time,
    the last value after the last time. Integration steps end at all times but the first. The times
    may be parameters; derivatives by them include the effect of each jump.

    **Arguments:**

    - `times`: (N,) s, increasing, at least two.
    - `values`: (N,), or (N, 3) for a force or torque vector, in the SI unit of what it prescribes.

    >>> torque = cj.PiecewiseConstant([0.0, 0.2, 0.3], [2.0, -1.0, 0.0])  # N m
    >>> torque(0.25).item()
    -1.0
    """

    jumps: ClassVar[bool] = True

    @override
    def __call__(self, t: Scalar) -> Scalar:
        times, values = on_device(self.times), on_device(self.values)
        # At its time a new value holds already; before the first time, the first value.
        return values[jnp.maximum(jnp.searchsorted(times, t, side="right") - 1, 0)]

    @override
    def breakpoints(self) -> PyTree:
        return self.times[1:]


class PiecewiseLinear(AbstractTable):
    """Linear interpolation of a table, such as ramps and trapezoids.

    The first value holds before the first time, the last value after the last time. A step ends at
    each time: for a densely sampled signal `Spline.through` needs fewer steps. Arguments are those
    of `PiecewiseConstant`.

    >>> ramp = cj.PiecewiseLinear([0.0, 0.1, 0.4, 0.5], [0.0, 50.0, 50.0, 0.0])  # N
    >>> print(f"{ramp(0.05):.1f}")
    25.0
    """

    @override
    def __call__(self, t: Scalar) -> Scalar:
        times, values = on_device(self.times), on_device(self.values)
        # k is the index of the interval that contains t. Before the first time it is the first
        # interval, after the last time the last one, and t is replaced by the end of the table. At
        # its time a new slope holds already: with `jnp.clip`, whose derivative is 1/2 at both ends,
        # a driven body began a run at the first time with half of its speed.
        k = jnp.clip(jnp.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
        inside = jnp.where(t < times[0], times[0], jnp.where(t < times[-1], t, times[-1]))
        fraction = (inside - times[k]) / (times[k + 1] - times[k])
        return values[k] + fraction * (values[k + 1] - values[k])

    @override
    def breakpoints(self) -> PyTree:
        return self.times


SingleInTime: TypeAlias = Single | AbstractFunctionOfTime
"""One number in a field, or a function of time."""
TripleInTime: TypeAlias = Triple | AbstractFunctionOfTime | tuple[SingleInTime, ...]
"""Vector in a field: three components, each a number or a function of time, or one function of time
that returns three numbers."""
ALTERNATIVES = "a table (PiecewiseConstant, PiecewiseLinear or Spline), or a function of time"


def single_in_time(unit: str, **options: PyTree) -> PyTree:
    """Declare a field for a number or a function of time; `options` are those of `quantity`."""
    check = partial(_require_single, unit)
    return quantity(unit, converter=as_single_in_time, check=check, **options)


def triple_in_time(unit: str, **options: PyTree) -> PyTree:
    """Declare a field for a `TripleInTime`; `options` are those of `quantity`."""
    check = partial(_require_triple, unit)
    return quantity(unit, converter=as_triple_in_time, check=check, **options)


def as_single_in_time(
    value: FunctionOfTime, argument: str = "value", unit: str = "1"
) -> SingleInTime:
    """Convert a number or function to what a field of `single_in_time` stores. An array of another
    shape than () is refused later, when the element is made."""
    return as_function_of_time(value) if callable(value) else as_number(value, argument, unit)


def as_triple_in_time(value: PyTree, argument: str = "value", unit: str = "1") -> PyTree:
    """Convert a vector to what a field of `triple_in_time` stores: a tuple if a component is a
    function, otherwise an array. The number of components is checked when the element is made."""
    if isinstance(value, tuple | list) and any(map(callable, value)):
        return tuple(as_single_in_time(part, argument, unit) for part in value)
    return as_single_in_time(value, argument, unit)  # pyright: ignore[reportArgumentType]


def value_at(content: SingleInTime, t: Scalar) -> Scalar:
    """Return the value at the time `t`, s. `content` is stored in a `single_in_time` field."""
    if not isinstance(content, AbstractFunctionOfTime):
        return content
    value = content(t)
    shape = _shape(value)
    expected = "a function of time that returns one number"
    require(shape == (), "function", shape, expected, f"pass {ALTERNATIVES}")
    return value


def value_and_rate(function: FunctionOfTime, t: Scalar) -> tuple[Scalar, Scalar]:
    return value_and_slope(partial(value_at, as_function_of_time(function)), t)


def vector_at(content: PyTree, t: Scalar) -> Vector:
    """Return the vector at the time `t`, s. `content` is stored in a `triple_in_time` field."""
    if isinstance(content, Vector):
        return content
    # Three separate components, of which at least one is a function.
    if isinstance(content, tuple):
        return Vector(*(value_at(part, t) for part in content))
    # One function of time for all components.
    parts = content(t)
    parts = tuple(parts) if isinstance(parts, Vector) else parts
    shape, expected = _shape(parts), "a function of time that returns three numbers"
    remedy = "return (x, y, z), or pass three functions: force=(0.0, function, 0.0)"
    require(shape == (3,), "function", shape, expected, remedy)
    return Vector(*(parts[k] for k in range(3)))


def _shape(value: PyTree) -> tuple[int, ...] | None:
    if value is None:
        return None
    return (len(value),) if isinstance(value, tuple | list) else jnp.shape(value)


def breakpoints_of(*contents: PyTree) -> PyTree:
    """Return the breakpoints, s, of each function of time in the `contents` of fields; numbers are
    left out. Those of a piecewise table are wrapped in `Increasing`, since they are in order. Those
    of a Python function are unknown, and its entry is empty."""
    # A vector may be a tuple of three components.
    fields = [content if isinstance(content, tuple) else (content,) for content in contents]
    values = [value for field in fields for value in field]
    functions = (value for value in values if isinstance(value, AbstractFunctionOfTime))
    return tuple(map(_breakpoints, functions))


def _breakpoints(function: AbstractFunctionOfTime) -> PyTree:
    times = function.breakpoints()
    # A subclass of a table may declare times in any order.
    of_table = (PiecewiseConstant.breakpoints, PiecewiseLinear.breakpoints)
    return Increasing(times) if type(function).breakpoints in of_table else times


def _require_single(unit: str, argument: str, value: PyTree) -> None:
    if not isinstance(value, AbstractFunctionOfTime):
        require_shape(argument, value, (), f"pass a single number in {unit}, {ALTERNATIVES}")


def _require_triple(unit: str, argument: str, value: PyTree) -> None:
    remedy = f"pass three components in {unit}, each a number or a function of time"
    if isinstance(value, tuple):
        require(len(value) == 3, argument, f"{len(value)} components", "three components", remedy)
        for part in value:
            _require_single(unit, argument, part)
    elif not isinstance(value, AbstractFunctionOfTime):
        require_shape(argument, value, (3,), remedy)
