"""How the loops of a run are carried out: plainly, or so that a reverse pass can go back over them.

JAX cannot go back through a `while_loop`, whose number of turns is not known beforehand. equinox
keeps the state of some turns (checkpoints) and computes the turns between them anew on the way
back, as `diffrax.RecursiveCheckpointAdjoint` does.
"""

import abc
from collections.abc import Callable
from typing import Any

import diffrax
import equinox as eqx
import equinox.internal as eqxi
import jax
import jax.numpy as jnp

from ..dynamics.system import System
from ..math.vectors import Scalar
from .step_state import Attempt, Method, Step
from .stepping import attempt

CHECKPOINTS = 300
"""Unless told. Measured: with 894 steps 4471 took 4.4 times as long, and with 36 000 steps 120 took
1.5 times as long."""
REMEDY = (
    "Reverse-mode differentiation of `simulate` needs checkpoints: pass "
    "adjoint=diffrax.RecursiveCheckpointAdjoint() to it. For few parameters forward mode, "
    "jax.jvp or jax.jacfwd, takes less time and needs none."
)


class AbstractLoops(eqx.Module):
    """What a run repeats."""

    @abc.abstractmethod
    def attempt(self, method: Method, system: System, step: Step, t_end: Scalar) -> Attempt:
        """Try one step."""

    @abc.abstractmethod
    def repeat(self, goes: Callable, go: Callable, start: Any) -> Any:
        """Like `jax.lax.while_loop`."""

    @abc.abstractmethod
    def each(self, visit: Callable, start: Any, places: Any) -> tuple[Any, Any]:
        """Like `jax.lax.scan`."""

    @abc.abstractmethod
    def closed(self, outcome: Any) -> Any:
        """The outcome, which says what is missing if it cannot be gone back from."""


class PlainLoops(AbstractLoops):
    """JAX's loops, which forward differentiation can follow."""

    def attempt(self, method: Method, system: System, step: Step, t_end: Scalar) -> Attempt:
        """Try one step."""
        return attempt(method, system, step, t_end)

    def repeat(self, goes: Callable, go: Callable, start: Any) -> Any:
        """`jax.lax.while_loop`."""
        return jax.lax.while_loop(goes, go, start)

    def each(self, visit: Callable, start: Any, places: Any) -> tuple[Any, Any]:
        """`jax.lax.scan`."""
        return jax.lax.scan(visit, start, places)

    def closed(self, outcome: Any) -> Any:
        """Raises a `RuntimeError` where a reverse pass would begin."""
        return eqxi.nondifferentiable_backward(outcome, msg=REMEDY)


PLAIN = PlainLoops()


class CheckpointedLoops(AbstractLoops):
    """Loops that reverse differentiation can follow, with so many `checkpoints` each."""

    checkpoints: int = eqx.field(static=True)

    def attempt(self, method: Method, system: System, step: Step, t_end: Scalar) -> Attempt:
        """Try one step; a trial that overflowed has no derivatives."""
        return _attempt_without_overflow(method, system, step, t_end)

    def repeat(self, goes: Callable, go: Callable, start: Any) -> Any:
        """equinox's loop with checkpoints."""
        return eqxi.while_loop(goes, go, start, kind="checkpointed", checkpoints=self.checkpoints)

    def each(self, visit: Callable, start: Any, places: Any) -> tuple[Any, Any]:
        """JAX's loop, keeping the state at each place and nothing of the way there."""
        return jax.lax.scan(jax.checkpoint(visit, prevent_cse=False), start, places)

    def closed(self, outcome: Any) -> Any:
        """The outcome."""
        return outcome


_attempt = eqx.filter_jit(attempt)


def loops_for(adjoint: diffrax.RecursiveCheckpointAdjoint | None) -> AbstractLoops:
    """The loops that an adjoint asks for."""
    if adjoint is None:
        return PLAIN
    checkpoints = adjoint.checkpoints
    return CheckpointedLoops(CHECKPOINTS if checkpoints is None else checkpoints)


@eqx.filter_custom_jvp
def _attempt_without_overflow(method: Method, system: System, step: Step, t_end: Scalar) -> Attempt:
    return _attempt(method, system, step, t_end)


@_attempt_without_overflow.def_jvp
def _(primals: tuple[Any, ...], tangents: tuple[Any, ...]) -> tuple[Attempt, Attempt]:
    """A trial that overflows is rejected, so that its tangents are multiplied by zero; but going
    backwards that zero would meet their infinite slopes, and make NaN. So none enter it."""
    tangents = jax.tree.map(_tangent, primals, tangents, is_leaf=_is_none)
    inputs, others = eqx.partition(primals, eqx.is_inexact_array)

    def numbers(inputs: Any) -> tuple[Any, Any]:
        return eqx.partition(_attempt(*eqx.combine(inputs, others)), eqx.is_inexact_array)

    tried, push, rest = jax.linearize(numbers, inputs, has_aux=True)
    finite = _is_finite(tried.information)

    def gated(tree: Any) -> Any:
        return jax.tree.map(lambda leaf: jnp.where(finite, leaf, 0.0), tree)

    pushed = gated(push(gated(tangents)))
    step = jax.tree.map(lambda new, old: jnp.where(finite, new, old), pushed.step, tangents[2])
    return eqx.combine(tried, rest), eqx.tree_at(lambda a: a.step, pushed, step)


def _is_none(leaf: Any) -> bool:
    return leaf is None


def _tangent(primal: Any, tangent: Any) -> Any:
    missing = tangent is None and eqx.is_inexact_array(primal)
    return jnp.zeros_like(primal) if missing else tangent


def _is_finite(tree: Any) -> Scalar:
    """Whether all numbers are finite, and their squares."""
    total: Scalar = 0.0
    for leaf in jax.tree.leaves(tree):
        total = total + jnp.sum(leaf * leaf) * 0.0
    return total == 0.0
