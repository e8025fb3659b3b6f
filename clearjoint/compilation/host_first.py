"""Functions that are computed once or twice a run: on the host, where they can be.

Some hundred scalar operations take numpy milliseconds, and XLA half a second to compile.
"""

from collections.abc import Callable
from functools import update_wrapper
from typing import Generic, ParamSpec, TypeVar

import equinox as eqx
import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree

from .compiled import Compiled

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


class HostFirst(Generic[Arguments, Result]):
    """A function of PyTrees, computed by numpy; and by a compiled program where something in it
    needs JAX, a derivative for instance, or fails with numpy's numbers."""

    __wrapped__: Callable[Arguments, Result]

    def __init__(self, function: Callable[Arguments, Result]):
        self._compiled = Compiled(function)
        self._need_jax: set[jax.tree_util.PyTreeDef] = set()  # pyright: ignore
        update_wrapper(self, function)

    def __call__(self, *arguments: Arguments.args, **options: Arguments.kwargs) -> Result:
        """The function's result."""
        structure = jax.tree.structure((arguments, options))
        if structure not in self._need_jax:
            found = self._by_numpy(*jax.tree.map(_on_host, (arguments, options)))
            if found:
                return found[0]
            self._need_jax.add(structure)
        return self._compiled(*arguments, **options)

    def programs(self) -> int:
        """How many programs have been compiled."""
        return self._compiled.programs()

    def _by_numpy(self, arguments: tuple[PyTree, ...], options: dict[str, PyTree]) -> list[Result]:
        """The result, and nothing if it takes JAX. While JAX traces, whatever it computes is
        traced, even of known numbers."""
        function: Callable[..., Result] = self.__wrapped__
        found: list[Result] = []
        with np.errstate(all="ignore"):
            try:
                jax.eval_shape(lambda: found.append(function(*arguments, **options)))
            except Exception:
                return []
        return [] if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(found)) else found


def _on_host(leaf: PyTree) -> PyTree:
    return np.asarray(leaf) if eqx.is_array(leaf) else leaf
