"""Parts of programs that XLA's CPU compiler makes one function of machine code of."""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

import equinox as eqx
import jax
from jax.experimental.xla_metadata import set_xla_metadata

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
_ONE_FUNCTION = {"xla_cpu_small_call": "true", "inlineable": "false"}
"""Attributes of a call by which the compiler knows that it is to be a function of its own."""


def in_one_function(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """The function of PyTrees, to be called inside of programs.

    On CPUs XLA starts a kernel for each fusion of operations, and fuses again and again what
    several of them need. A run's step of some thousand operations on scalars then takes forty
    times as long as in one function, and ten times as long to compile. JAX's name for a call's
    attributes, `set_xla_metadata`, is experimental.
    """
    call = eqx.filter_jit(function)

    @wraps(function)
    def called(*arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        if jax.default_backend() != "cpu":
            return function(*arguments, **options)
        with set_xla_metadata(**_ONE_FUNCTION):
            return call(*arguments, **options)

    return called
