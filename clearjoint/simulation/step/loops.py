"""Loops of a run: JAX's own, or loops with checkpoints for reverse-mode differentiation.

JAX cannot differentiate a `while_loop` in reverse mode, because the number of iterations is not
known beforehand. equinox's loop stores the state at some iterations (checkpoints), and in the
reverse pass recomputes the iterations between them, as `diffrax.RecursiveCheckpointAdjoint` does.
"""

import abc
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import diffrax
import equinox as eqx
import equinox.internal as eqxi
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ...compilation import Compiled
from ...dynamics.system import System
from ...math.vectors import Condition, Scalar
from .step_state import Attempt, Method, Step, choose
from .stepping import attempt

CHECKPOINTS = 300
"""Number of checkpoints if the adjoint does not specify it. A run of 894 steps took 4.4 times as
long with 4471 checkpoints; one of 36 000 steps took 1.5 times as long with 120."""
REMEDY = (
    "Reverse-mode differentiation of `simulate` needs checkpoints: pass "
    "adjoint=diffrax.RecursiveCheckpointAdjoint() to it. For few parameters forward mode, "
    "jax.jvp or jax.jacfwd, takes less time and needs none."
)

Carry = TypeVar("Carry")
Item = TypeVar("Item")
Output = TypeVar("Output")


class AbstractLoops(eqx.Module):
    """The loops of a run and the trial step inside them, for one mode of differentiation."""

    @abc.abstractmethod
    def attempt(self, method: Method, system: System, step: Step, t_end: Scalar) -> Attempt:
        """Try one step from `step`, at most to `t_end`, s; see the function `attempt` in
        `stepping`."""

    @abc.abstractmethod
    def repeat(
        self, condition: Callable[[Carry], Condition], body: Callable[[Carry], Carry], start: Carry
    ) -> Carry:
        """Return the carry after `body` was applied to `start` while `condition` holds, like
        `jax.lax.while_loop`."""

    @abc.abstractmethod
    def each(
        self,
        body: Callable[[Carry, Item], tuple[Carry, Output]],
        start: Carry,
        items: Item,
    ) -> tuple[Carry, Output]:
        """Apply `body` to one item after the other, like `jax.lax.scan`.

        **Arguments:** `body`: function of the carry and an item that returns the next carry and an
        output; `start`: the first carry; `items`: PyTree of N items, (N, ...) each.

        **Returns:** the last carry, and the N outputs, (N, ...) each.
        """

    @abc.abstractmethod
    def closed(self, outcome: Carry) -> Carry:
        """Return the `outcome` of a run unchanged; a reverse pass from it raises if the loops do
        not support reverse mode."""


class PlainLoops(AbstractLoops):
    """JAX's loops, which support forward mode only."""

    def attempt(self, method: Method, system: System, step: Step, t_end: Scalar) -> Attempt:
        """Try one step."""
        return attempt(method, system, step, t_end)

    def repeat(
        self, condition: Callable[[Carry], Condition], body: Callable[[Carry], Carry], start: Carry
    ) -> Carry:
        """Apply `jax.lax.while_loop`."""
        return jax.lax.while_loop(condition, body, start)

    def each(
        self,
        body: Callable[[Carry, Item], tuple[Carry, Output]],
        start: Carry,
        items: Item,
    ) -> tuple[Carry, Output]:
        """Apply `jax.lax.scan`."""
        return jax.lax.scan(body, start, items)

    def closed(self, outcome: Carry) -> Carry:
        """Return the outcome; a reverse pass from it raises a `RuntimeError` with the remedy."""
        return eqxi.nondifferentiable_backward(outcome, msg=REMEDY)


PLAIN = PlainLoops()


class CheckpointedLoops(AbstractLoops):
    """Loops that support reverse mode.

    **Arguments:** `checkpoints`: number of iterations whose state each loop stores.
    """

    checkpoints: int = eqx.field(static=True)

    def attempt(self, method: Method, system: System, step: Step, t_end: Scalar) -> Attempt:
        """Try one step; the derivatives of a trial that is not finite are zero."""
        return _attempt_without_overflow(method, system, step, t_end)

    def repeat(
        self, condition: Callable[[Carry], Condition], body: Callable[[Carry], Carry], start: Carry
    ) -> Carry:
        """Apply equinox's loop with checkpoints."""
        return eqxi.while_loop(
            condition, body, start, kind="checkpointed", checkpoints=self.checkpoints
        )

    def each(
        self,
        body: Callable[[Carry, Item], tuple[Carry, Output]],
        start: Carry,
        items: Item,
    ) -> tuple[Carry, Output]:
        """Apply `jax.lax.scan`; it stores the state before each item and recomputes the rest."""
        return jax.lax.scan(jax.checkpoint(body, prevent_cse=False), start, items)

    def closed(self, outcome: Carry) -> Carry:
        """Return the outcome unchanged."""
        return outcome


_attempt = Compiled(attempt)


def loops_for(adjoint: diffrax.RecursiveCheckpointAdjoint | None) -> AbstractLoops:
    """Return the loops for the `adjoint` argument of `simulate`; `PLAIN` if it is ``None``."""
    if adjoint is None:
        return PLAIN
    checkpoints = adjoint.checkpoints
    return CheckpointedLoops(CHECKPOINTS if checkpoints is None else checkpoints)


@eqx.filter_custom_jvp
def _attempt_without_overflow(method: Method, system: System, step: Step, t_end: Scalar) -> Attempt:
    return _attempt(method, system, step, t_end)


@_attempt_without_overflow.def_jvp
def _(primals: tuple[PyTree, ...], tangents: tuple[PyTree, ...]) -> tuple[Attempt, Attempt]:
    """Return the attempt and its tangents, with the tangents of a trial that overflowed cut off.

    Such a trial is rejected, so its tangents are multiplied by zero. In the reverse pass that zero
    would meet infinite slopes and give NaN.
    """
    tangents = jax.tree.map(_tangent, primals, tangents, is_leaf=_is_none)
    # Only arrays of floats are differentiated; the rest passes through unchanged.
    inputs, others = eqx.partition(primals, eqx.is_inexact_array)

    def numbers(inputs: PyTree) -> tuple[PyTree, PyTree]:
        return eqx.partition(_attempt(*eqx.combine(inputs, others)), eqx.is_inexact_array)

    outcome, derivative, rest = jax.linearize(numbers, inputs, has_aux=True)
    finite = _is_finite(outcome.information)

    def gated(tree: Carry) -> Carry:
        return jax.tree.map(lambda leaf: jnp.where(finite, leaf, 0.0), tree)

    # Zeros go in and come out, so that neither pass multiplies zero by infinity. The state of the
    # rejected step continues with the tangents it had.
    along = gated(derivative(gated(tangents)))
    step = choose(finite, along.step, tangents[2])
    return eqx.combine(outcome, rest), replace(along, step=step)


def _is_none(leaf: object) -> bool:
    return leaf is None


def _tangent(primal: PyTree, tangent: PyTree) -> PyTree:
    """Return `tangent`; zeros in place of ``None`` where `primal` is an array of floats."""
    missing = tangent is None and eqx.is_inexact_array(primal)
    return jnp.zeros_like(primal) if missing else tangent


def _is_finite(tree: PyTree[Scalar]) -> Condition:
    """Whether all numbers and their squares are finite. Each square is multiplied by zero, which
    gives NaN for an infinity or a NaN."""
    total: Scalar = 0.0
    for leaf in jax.tree.leaves(tree):
        total = total + jnp.sum(leaf * leaf) * 0.0
    return total == 0.0
