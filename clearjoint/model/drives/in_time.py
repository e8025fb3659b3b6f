"""Fields of elements, such as a torque, that are constant numbers or functions of time."""

from functools import partial
from typing import TypeAlias

import jax.numpy as jnp
from jaxtyping import PyTree

from ...fields.checks import as_number, require, require_shape
from ...fields.declarations import quantity
from ...fields.types import Single, Triple
from ...math.vectors import Scalar, Vector
from .functions_of_time import (
    AbstractFunctionOfTime,
    FunctionOfTime,
    PlainFunction,
    as_function_of_time,
)

SingleInTime: TypeAlias = Single | AbstractFunctionOfTime
"""A number or a function of time."""
TripleInTime: TypeAlias = Triple | AbstractFunctionOfTime | tuple[SingleInTime, ...]
"""Three components, each a number or a function of time, or one function that returns three
numbers."""
ALTERNATIVES = "a table (PiecewiseConstant, PiecewiseLinear or Spline), or a function of time"


def single_in_time(unit: str, **options: PyTree) -> PyTree:
    """Declare a field with a number or a function of time; `options` are those of `quantity`."""
    return quantity(
        unit, converter=as_single_in_time, check=partial(_require_single, unit), **options
    )


def triple_in_time(unit: str, **options: PyTree) -> PyTree:
    """Declare a field with three numbers or functions; `options` are those of `quantity`."""
    return quantity(
        unit, converter=as_triple_in_time, check=partial(_require_triple, unit), **options
    )


def as_single_in_time(value: FunctionOfTime) -> SingleInTime:
    """Return a number as an array, or a function as an `AbstractFunctionOfTime`."""
    return as_function_of_time(value) if callable(value) else as_number(value)


def as_triple_in_time(value: PyTree) -> PyTree:
    """Return three numbers as an array, (3,), or functions as `AbstractFunctionOfTime`s.

    Three components of which one is a function become a tuple of three.
    """
    if isinstance(value, AbstractFunctionOfTime):
        return value
    if callable(value):
        return PlainFunction(value)
    if isinstance(value, tuple | list) and any(map(callable, value)):
        return tuple(map(as_single_in_time, value))
    return as_number(value)


def value_at(given: SingleInTime, t: Scalar) -> Scalar:
    """Return a number unchanged, or the value of a function of time at the time `t`, s.

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
    """Return the vector that a field holds at the time `t`, s.

    **Arguments:** `given`: a constant `Vector`, a tuple of three numbers or functions of time, or
    one function that returns three numbers.

    **Raises:** `ValueError` if a function returns another number of values.
    """
    if isinstance(given, Vector):
        return given
    if isinstance(given, tuple):
        return Vector(*(value_at(part, t) for part in given))
    parts = given(t)
    shape, expected = _shape(parts), "a function of time that returns three numbers"
    remedy = "return (x, y, z), or pass three functions: force=(0.0, function, 0.0)"
    require(shape == (3,), "function", shape, expected, remedy)
    return Vector(*(parts[k] for k in range(3)))


def _shape(value: PyTree) -> tuple[int, ...]:
    return (len(value),) if isinstance(value, tuple | list) else jnp.shape(value)


def breakpoints_of(*given: PyTree) -> PyTree:
    """Return the breakpoints of all functions of time in the given fields, s, as a tuple."""
    parts = [p for field in given for p in (field if isinstance(field, tuple) else (field,))]
    return tuple(p.breakpoints() for p in parts if isinstance(p, AbstractFunctionOfTime))


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
