"""Functions that XLA compiles at their first call."""

from collections.abc import Callable
from functools import update_wrapper, wraps
from typing import Generic, ParamSpec, TypeVar

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer
from jax.experimental.xla_metadata import set_xla_metadata
from jaxtyping import PyTree

from .tracing import begins_a_program, collector_at_rest, is_tracing, program_is_made_inside

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")
OPTIONS: dict[str, str | bool] = {"xla_backend_optimization_level": "1"}
"""XLA's compiler options: LLVM's level of optimisation is 1, which compiles faster than XLA's
default of 3."""
_ONE_FUNCTION = {"xla_cpu_small_call": "true", "inlineable": "false"}
"""Attributes of a call that make XLA's CPU compiler compile it as a function of its own."""


class Compiled(Generic[Arguments, Result]):
    """Function that XLA compiles at its first call, as by `equinox.filter_jit`.

    A change of anything other than the numbers of arrays in the arguments compiles a further
    program. JAX's cache on disk saves compiled programs. Python's garbage collector is off during a
    call; see `.tracing`.

    **Arguments:** `function`: function of PyTrees that JAX can trace.
    """

    __wrapped__: Callable[Arguments, Result]

    def __init__(self, function: Callable[Arguments, Result]):
        traced = begins_a_program(function)
        # JAX accepts compiler options only for programs that are not part of another one.
        self._inner = eqx.filter_jit(traced)
        self._outermost = eqx.filter_jit(traced, compiler_options=OPTIONS)  # pyright: ignore
        update_wrapper(self, function)

    def __call__(self, *arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        """Return the function's result, compiling a program first if none fits the arguments."""
        with collector_at_rest(), program_is_made_inside():
            # While JAX traces another program, this function becomes a part of that program.
            compiled = self._inner if is_tracing() else self._outermost
            return compiled(*arguments, **options)

    def programs(self) -> int:
        """Return the number of programs that have been compiled for this function in this
        process."""
        return self._inner._cached._cache_size() + self._outermost._cached._cache_size()


class HostFirst(Generic[Arguments, Result]):
    """Function of PyTrees that NumPy computes if it can, and otherwise a program of XLA.

    It serves for functions that are called once or twice in a run. NumPy takes milliseconds for
    some hundred scalar operations, but XLA takes half a second to compile them. NumPy can't compute
    a function that needs JAX, for instance for a derivative.

    **Arguments:** `function`: function of PyTrees of scalars and arrays.
    """

    __wrapped__: Callable[Arguments, Result]

    def __init__(self, function: Callable[Arguments, Result]):
        self._compiled = Compiled(function)
        self._need_jax: set[jax.tree_util.PyTreeDef] = set()  # pyright: ignore
        update_wrapper(self, function)

    def __call__(self, *arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        """Return the function's result, with NumPy arrays if NumPy has computed it."""
        # NumPy is not tried again for a structure of arguments for which it has failed once.
        structure = jax.tree.structure((arguments, options))
        if structure not in self._need_jax:
            results = self._by_numpy(arguments, options)
            if results:
                return results[0]
            self._need_jax.add(structure)
        return self._compiled(*arguments, **options)

    def programs(self) -> int:
        """Return the number of programs that XLA has compiled for this function in this process."""
        return self._compiled.programs()

    def _by_numpy(self, arguments: tuple[PyTree, ...], options: dict[str, PyTree]) -> list[Result]:
        """Return a list with the function's result, or an empty list if NumPy cannot compute it.

        **Arguments:** positional arguments and options of the function.
        """
        function: Callable[..., Result] = self.__wrapped__
        results: list[Result] = []
        with np.errstate(all="ignore"):
            try:
                arguments, options = jax.tree.map(_on_host, (arguments, options))
                # Under `eval_shape`, an operation of JAX is not compiled. It returns a tracer, also
                # for known numbers, by which it is detected.
                jax.eval_shape(lambda: results.append(function(*arguments, **options)))
            except Exception:
                # An error of the function itself is raised again when XLA compiles the function.
                return []
        return [] if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(results)) else results


def _on_host(leaf: PyTree) -> PyTree:
    return np.asarray(leaf) if eqx.is_array(leaf) else leaf


def in_one_function(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Wrap a function of PyTrees so that XLA's CPU compiler compiles it as one function.

    Otherwise XLA starts a kernel for each group of operations, and recomputes in each kernel what
    several of them need. A step of a run, with some thousand operations on scalars, would then take
    forty times as long, and ten times as long to compile. On other devices the function is not
    changed. `set_xla_metadata`, which gives attributes to a call, is experimental in JAX.
    """
    call = eqx.filter_jit(function)

    @wraps(function)
    def called(*arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        if jax.default_backend() != "cpu":
            return function(*arguments, **options)
        with set_xla_metadata(**_ONE_FUNCTION):
            return call(*arguments, **options)

    return called
