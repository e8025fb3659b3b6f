"""Numbers of an element that may change with time: a number or a function of time; three numbers,
each of them such, or a function of time that gives all three."""

from collections.abc import Callable
from functools import partial
from typing import TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ...fields.checks import as_number, require, require_shape
from ...fields.declarations import quantity
from ...fields.types import Single, Triple
from ...math.vectors import Scalar, Vector
from .functions_of_time import AbstractFunctionOfTime, FunctionOfTime, as_function_of_time

SingleInTime: TypeAlias = Single | AbstractFunctionOfTime
"""A number, or a function of time."""
TripleInTime: TypeAlias = Triple | AbstractFunctionOfTime | tuple[SingleInTime, ...]
"""Three numbers, each of them a number or a function of time, or a function that gives three."""
WAYS = "PiecewiseConstant, PiecewiseLinear or Spline.through for a table, or a function of the time"


class _PlainVectorFunction(AbstractFunctionOfTime):
    """A Python function that gives three numbers: part of the program."""

    function: Callable[[jax.Array], PyTree] = eqx.field(static=True)

    def __call__(self, t: Scalar) -> PyTree:
        return self.function(jnp.asarray(t, dtype=float))


def single_in_time(unit: str, **options: PyTree) -> PyTree:
    """A field of a number in a unit, or of a function of time that gives it."""
    return quantity(
        unit, converter=as_single_in_time, check=partial(_require_single, unit), **options
    )


def triple_in_time(unit: str, **options: PyTree) -> PyTree:
    """A field of three numbers in a unit, each of which may be a function of time."""
    return quantity(
        unit, converter=as_triple_in_time, check=partial(_require_triple, unit), **options
    )


def as_single_in_time(value: FunctionOfTime) -> SingleInTime:
    """A number or a function of time as elements store it."""
    return as_function_of_time(value) if callable(value) else as_number(value)


def as_triple_in_time(value: PyTree) -> PyTree:
    """Three numbers or functions of time as elements store them."""
    if isinstance(value, AbstractFunctionOfTime):
        return value
    if callable(value):
        return _PlainVectorFunction(value)
    if isinstance(value, tuple | list) and any(map(callable, value)):
        return tuple(map(as_single_in_time, value))
    return as_number(value)


def value_at(given: SingleInTime, t: Scalar) -> Scalar:
    """What a number in time is at a time, s."""
    if not isinstance(given, AbstractFunctionOfTime):
        return given
    value = given(t)
    shape = _shape(value)
    require(
        shape == (), "function", shape, "a function of time that gives one number", f"pass {WAYS}"
    )
    return value


def vector_at(given: PyTree, t: Scalar) -> Vector:
    """What three numbers in time (in scalar form) are at a time, s."""
    if isinstance(given, Vector):
        return given
    if isinstance(given, tuple):
        return Vector(*(value_at(part, t) for part in given))
    parts = given(t)
    shape, expected = _shape(parts), "a function of time that gives three numbers"
    remedy = "return (x, y, z), or pass three functions: force=(0.0, function, 0.0)"
    require(shape == (3,), "function", shape, expected, remedy)
    return Vector(*(parts[k] for k in range(3)))


def _shape(value: PyTree) -> tuple[int, ...]:
    return (len(value),) if isinstance(value, tuple | list) else jnp.shape(value)


def breakpoints_of(*given: PyTree) -> PyTree:
    """The breakpoints of all functions of time among numbers in time, s."""
    parts = [p for one in given for p in (one if isinstance(one, tuple) else (one,))]
    return tuple(p.breakpoints() for p in parts if isinstance(p, AbstractFunctionOfTime))


def _require_single(unit: str, argument: str, value: PyTree) -> None:
    if not isinstance(value, AbstractFunctionOfTime):
        require_shape(argument, value, (), f"pass a single number in {unit}, {WAYS}")


def _require_triple(unit: str, argument: str, value: PyTree) -> None:
    remedy = f"pass three components in {unit}, each of them a number or a function of time"
    if isinstance(value, tuple):
        require(len(value) == 3, argument, f"{len(value)} components", "three components", remedy)
        for part in value:
            _require_single(unit, argument, part)
    elif not isinstance(value, AbstractFunctionOfTime):
        require_shape(argument, value, (3,), remedy)
