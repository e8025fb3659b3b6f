"""Functions of time for drives and loads, and declarations of the fields that hold them.

A table gives a function of time by its values at some increasing times. Breakpoints are the times
of the jumps and kinks of a function.
"""

import abc
from collections.abc import Callable
from functools import partial
from typing import ClassVar, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..._fields.checks import as_number, require, require_finite, require_numbers, require_shape
from ..._fields.objects import AbstractConverting, on_device, quantity
from ..._fields.types import ArrayLike, Column, Single, TableRows, Triple
from ..._math.interpolation import Slope, hermite_value
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
        """Return the value of the function, a number or the three components of a vector, at a time
        in s."""

    def breakpoints(self) -> PyTree:
        """Return the times in s of the function's kinks and jumps; an empty tuple by default.

        The result may be a number, an array, or a tuple of numbers and arrays. Integration steps
        end at these times. Runs that compute derivatives, such as those of `sensitivities`, raise
        an error for a function that compares, rounds or clips the time, unless its class defines
        this method.
        """
        return ()


class PlainFunction(AbstractFunctionOfTime):
    """A Python function of the time in s, which becomes part of the compiled program.

    A Python function that is passed to a drive or load is converted to this class. A Python
    function can't declare breakpoints: subclass `AbstractFunctionOfTime` for a function with jumps
    or kinks.
    """

    function: Callable[[jax.Array], PyTree] = eqx.field(static=True)

    def __call__(self, t: Scalar) -> Scalar:
        """Return the value, or three values, at a time in s."""
        return self.function(jnp.asarray(t, dtype=float))


class Polynomial(AbstractFunctionOfTime):
    """A polynomial in time.

    **Arguments:** `coefficients`: (N,), at least one, the constant first: c_0, c_1, c_2, ... of the
    polynomial c_0 + c_1 t + c_2 t^2 + ... The unit of c_k is the SI unit of the value, divided by
    s^k.

    **Raises:** `ValueError` if the coefficients are not one-dimensional, there are none, or one is
    not a finite number.

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
        """Return the value at a time in s."""
        # Horner's scheme.
        value: Scalar = 0.0
        for k in reversed(range(self.coefficients.shape[0])):
            value = value * t + self.coefficients[k]
        return value


class AbstractTable(AbstractFunctionOfTime):
    """Base class of functions of time given by a table.

    The table consists of `times`, (N,) s, increasing, at least two, and `values`, (N,), or (N, 3)
    for the components of a force or torque.

    **Raises:** `ValueError` if there are fewer than two times, an array has another shape, a number
    is not finite, or the times are not increasing.
    """

    times: Column = quantity("s", table=True)
    values: TableRows = quantity("1", table=True)

    def __check_init__(self):
        require_table(self.times, self.values)


class Spline(AbstractTable):
    """A cubic spline through a table of values and their rates.

    Between two times it is the cubic polynomial with the given values and rates at both (Hermite
    interpolation). `Spline.through(times, values)` computes rates for which the second derivative
    is continuous, and zero at the ends. Before the first and after the last time, the function
    continues along its tangent at that time.

    **Arguments:**

    - `times`: (N,) s, increasing, at least two.
    - `values`: (N,), or (N, 3) for a force or torque vector, in the SI unit of what the function
      prescribes.
    - `rates`: time derivatives of the values, of the same shape as `values`.

    **Raises:** `ValueError` if there are fewer than two times, an array has another shape, a number
    is not finite, or the times are not increasing.

    >>> spline = cj.Spline.through([0.0, 1.0, 2.0], [0.0, 1.0, 0.0])
    >>> print(f"{spline(1.0):.1f}, {spline(0.5):.4f}")
    1.0, 0.6875
    """

    rates: TableRows = quantity("1/s", table=True)

    def _check_together(self) -> None:
        expected = f"of the shape {np.shape(self.values)} of `values`"
        rates = np.shape(self.rates)
        require(rates == np.shape(self.values), "rates", rates, expected, "give one per value")
        require_finite("rates", self.rates)

    @staticmethod
    def through(times: ArrayLike, values: ArrayLike) -> "Spline":
        """Return the natural cubic spline through a table, from SciPy's `CubicSpline`.

        Its second derivative is continuous, and zero at both ends.

        **Arguments:** `times`, `values`: as for `Spline`; not traced by JAX, since SciPy can't use
        traced numbers.

        **Raises:** `ValueError` as for `Spline`.
        """
        from scipy.interpolate import CubicSpline

        times, values = as_number(times, "times", "s"), as_number(values, "values")
        require_table(times, values)
        spline = CubicSpline(np.asarray(times), np.asarray(values), bc_type="natural")
        return Spline(times, values, spline(times, 1))

    def __call__(self, t: Scalar) -> Scalar:
        """Return the value at a time in s."""
        times, values, rates = map(on_device, (self.times, self.values, self.rates))
        k = jnp.clip(jnp.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
        length, inside = times[k + 1] - times[k], jnp.clip(t, times[0], times[-1])
        start, end = (Slope(values[j], rates[j]) for j in (k, k + 1))
        value = hermite_value((inside - times[k]) / length, start, end, length)
        # Outside the table the Hermite value is that of the end, and the tangent continues it.
        before, after = jnp.minimum(t - times[0], 0.0), jnp.maximum(t - times[-1], 0.0)
        return value + before * rates[0] + after * rates[-1]

    def breakpoints(self) -> PyTree:
        """Return an empty tuple, since integration steps need not end at the times of the table.

        The class defines this method all the same, because runs that compute derivatives raise an
        error for a function that searches a table and inherits `breakpoints` from the base class.
        """
        return ()


class Increasing(eqx.Module):
    """Breakpoints of a table, (N,) s, known to be increasing, so that the next one is found without
    looking at all of them."""

    times: ArrayLike


FunctionOfTime: TypeAlias = AbstractFunctionOfTime | Callable[[jax.Array], Scalar] | float
"""Types that users may pass as a function of time."""


def as_function_of_time(value: FunctionOfTime) -> AbstractFunctionOfTime:
    """Return a number, a Python function or a function of time as an `AbstractFunctionOfTime`.

    A number becomes a constant `Polynomial`, and a Python function becomes a `PlainFunction`. An
    `AbstractFunctionOfTime` is returned unchanged.

    **Raises:** `ValueError` if the value is neither a single finite number nor a function.
    """
    if isinstance(value, AbstractFunctionOfTime):
        return value
    if callable(value):
        return PlainFunction(value)
    number = as_number(value, "function")
    remedy = (
        "pass a number, a function of the time, or for a table Spline.through(times, values) or "
        "PiecewiseLinear(times, values)"
    )
    require(np.shape(number) == (), "function", value, "a function of the time", remedy)
    return Polynomial([number])


def require_table(times: ArrayLike, values: ArrayLike) -> None:
    """Check that a table consists of at least two increasing times, (N,) s, and their values.

    All numbers must be finite. `values` has the shape (N,), or (N, 3) for vectors.

    **Raises:** `ValueError` for any other table; the message names the argument `times` or
    `values`.
    """
    shape = np.shape(times)
    remedy = "pass at least two times, sorted and without duplicates"
    require(len(shape) == 1 and shape[0] > 1, "times", shape, "a row of two or more times", remedy)
    require_finite("times", times)
    require_numbers(lambda t: (t[1:] > t[:-1]).all(), "times", (times,), "increasing", remedy)
    given, remedy = np.shape(values), "give one value per time, or three for a force"
    expected = f"of the shape {shape} of `times`, or {(*shape, 3)}"
    require(given in (shape, (*shape, 3)), "values", given, expected, remedy)
    require_finite("values", values)


def require_continuous(function: FunctionOfTime) -> None:
    """Check that a function that prescribes an angle or a distance doesn't jump.

    **Raises:** `ValueError` if its class attribute `jumps` is true.
    """
    remedy = "use PiecewiseLinear(times, values) or Spline.through(times, values)"
    kind, jumps = type(function).__name__, as_function_of_time(function).jumps
    require(not jumps, "function", kind, "continuous, since bodies can't jump", remedy)


class PiecewiseConstant(AbstractTable):
    """A step function from a table, for torques and loads that are switched.

    Each value holds from its time until the next; the first value also holds before the first time,
    the last value after the last time. All times but the first are declared as `breakpoints`, so
    that integration steps end there. The times may be parameters; derivatives by them include the
    effect of each jump.

    ```python
    import clearjoint as cj

    torque = cj.PiecewiseConstant([0.0, 0.2, 0.3], [2.0, -1.0, 0.0])  # N m, switched at 0.2, 0.3 s
    motor = cj.DriveTorque("ground", "crank", (0, 0, 1), torque)
    scene, state = cj.mechanisms.slider_crank(motor=motor)
    ```

    **Arguments:**

    - `times`: (N,) s, increasing, at least two.
    - `values`: (N,), or (N, 3) for a force or torque vector, in the SI unit of what the function
      prescribes.

    **Raises:** `ValueError` if there are fewer than two times, an array has another shape, a number
    is not finite, or the times are not increasing.
    """

    jumps: ClassVar[bool] = True

    def __call__(self, t: Scalar) -> Scalar:
        """Return the value at a time in s."""
        times, values = on_device(self.times), on_device(self.values)
        # At its time a new value holds already; before the first time, the first value.
        return values[jnp.maximum(jnp.searchsorted(times, t, side="right") - 1, 0)]

    def breakpoints(self) -> PyTree:
        """Return the times at which the value jumps, s: all but the first of the table."""
        return self.times[1:]


class PiecewiseLinear(AbstractTable):
    """Linear interpolation of a table, such as ramps and trapezoids.

    The first value holds before the first time, the last value after the last time. All times are
    declared as `breakpoints`, so that a step ends at each: for a densely sampled signal
    `Spline.through(times, values)` needs fewer steps.

    ```python
    import clearjoint as cj

    ramp = cj.PiecewiseLinear([0.0, 0.1, 0.4, 0.5], [0.0, 50.0, 50.0, 0.0])  # N
    forces = {"push": cj.AppliedLoad("arm", force=(0.0, ramp, 0.0))}
    ```

    **Arguments:**

    - `times`: (N,) s, increasing, at least two.
    - `values`: (N,), or (N, 3) for a force or torque vector, in the SI unit of what the function
      prescribes.

    **Raises:** `ValueError` as for `PiecewiseConstant`.
    """

    def __call__(self, t: Scalar) -> Scalar:
        """Return the value at a time in s."""
        times, values = on_device(self.times), on_device(self.values)
        # k is the index of the interval that contains t. Before the first time it is the first
        # interval, after the last time the last one, and t is clipped to the range of the table.
        k = jnp.clip(jnp.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
        inside = jnp.clip(t, times[0], times[-1])
        fraction = (inside - times[k]) / (times[k + 1] - times[k])
        return values[k] + fraction * (values[k + 1] - values[k])

    def breakpoints(self) -> PyTree:
        """Return all times of the table, s, at which the slope jumps."""
        return self.times


SingleInTime: TypeAlias = Single | AbstractFunctionOfTime
"""One number in a field, or a function of time."""
TripleInTime: TypeAlias = Triple | AbstractFunctionOfTime | tuple[SingleInTime, ...]
"""Vector in a field: three components, each a number or a function of time, or one function of time
that returns three numbers."""
ALTERNATIVES = "a table (PiecewiseConstant, PiecewiseLinear or Spline), or a function of time"


def single_in_time(unit: str, **options: PyTree) -> PyTree:
    """Declare a field of an element that holds a number or a function of time.

    **Arguments:** `unit`: SI unit of the value. `options`: further arguments of `quantity`, the
    function that declares a field with its unit and checks; for example `default`.
    """
    return quantity(
        unit, converter=as_single_in_time, check=partial(_require_single, unit), **options
    )


def triple_in_time(unit: str, **options: PyTree) -> PyTree:
    """Declare a field of an element that holds a vector, either constant or a function of time.

    The field's value is three components, each a number or a function, or one function that returns
    three numbers.

    **Arguments:** `unit`: SI unit of the components. `options`: further arguments of `quantity`,
    the function that declares a field with its unit and checks; for example `default`.
    """
    return quantity(
        unit, converter=as_triple_in_time, check=partial(_require_triple, unit), **options
    )


def as_single_in_time(value: FunctionOfTime) -> SingleInTime:
    """Return the value of a field declared by `single_in_time` in the form in which it is stored.

    A number becomes an array of shape (), a Python function becomes a `PlainFunction`, and an
    `AbstractFunctionOfTime` is returned unchanged. An array of another shape is refused later, when
    the element is made.

    **Raises:** `ValueError` if the value is neither a function nor a number or array of numbers.
    """
    return as_function_of_time(value) if callable(value) else as_number(value)


def as_triple_in_time(value: PyTree) -> PyTree:
    """Return the value of a field declared by `triple_in_time` in the form in which it is stored.

    Three numbers become an array of shape (3,). Three components become a tuple if at least one of
    them is a function. A Python function that returns three numbers becomes a `PlainFunction`, and
    an `AbstractFunctionOfTime` is returned unchanged. The number of components is checked later,
    when the element is made.

    **Raises:** `ValueError` if a component is neither a number nor a function.
    """
    if isinstance(value, tuple | list) and any(map(callable, value)):
        return tuple(map(as_single_in_time, value))
    return as_single_in_time(value)  # pyright: ignore[reportArgumentType]


def value_at(given: SingleInTime, t: Scalar) -> Scalar:
    """Return the value that a field declared by `single_in_time` has at the time `t`, s.

    **Arguments:** `given`: content of the field, a number or a function of time.

    **Raises:** `ValueError` if the function doesn't return one number.
    """
    if not isinstance(given, AbstractFunctionOfTime):
        return given
    value = given(t)
    shape = _shape(value)
    expected = "a function of time that returns one number"
    require(shape == (), "function", shape, expected, f"pass {ALTERNATIVES}")
    return value


def vector_at(given: PyTree, t: Scalar) -> Vector:
    """Return the vector that a field declared by `triple_in_time` has at the time `t`, s.

    **Arguments:** `given`: content of the field: a constant `Vector`, a tuple of three numbers or
    functions of time, or one function that returns three numbers or a `Vector`.

    **Raises:** `ValueError` if a function in a tuple doesn't return one number, or a function for
    the whole vector doesn't return three.
    """
    if isinstance(given, Vector):
        return given
    # Three separate components, of which at least one is a function.
    if isinstance(given, tuple):
        return Vector(*(value_at(part, t) for part in given))
    # One function of time for all components.
    parts = given(t)
    parts = tuple(parts) if isinstance(parts, Vector) else parts
    shape, expected = _shape(parts), "a function of time that returns three numbers"
    remedy = "return (x, y, z), or pass three functions: force=(0.0, function, 0.0)"
    require(shape == (3,), "function", shape, expected, remedy)
    return Vector(*(parts[k] for k in range(3)))


def _shape(value: PyTree) -> tuple[int, ...] | None:
    """Return the shape of a function's value; ``None`` for ``None``, the value of a function
    without ``return``."""
    if value is None:
        return None
    return (len(value),) if isinstance(value, tuple | list) else jnp.shape(value)


def breakpoints_of(*given: PyTree) -> PyTree:
    """Return the breakpoints of all functions of time in the given fields, s.

    Breakpoints are the times of jumps and kinks. The result is a tuple with one entry for each
    function of time, as its method `breakpoints` returns it. Constants have no entry, and the entry
    of a Python function is empty, because its breakpoints are unknown. Those of the tables of this
    module are `Increasing`.
    """
    parts = [p for field in given for p in (field if isinstance(field, tuple) else (field,))]
    return tuple(_breakpoints(p) for p in parts if isinstance(p, AbstractFunctionOfTime))


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
