"""Loops of a run: JAX's own, or loops with checkpoints, which support reverse-mode differentiation.

equinox's loop stores the state at some iterations (checkpoints), and in the reverse pass computes
the iterations between them again, as `diffrax.RecursiveCheckpointAdjoint` does.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import diffrax
import equinox as eqx
import equinox.internal as eqxi
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ..._compilation import Compiled
from ..._dynamics.system import System
from ..._math.vectors import Condition, Scalar
from .step_state import Attempt, Method, Step, choose
from .stepping import attempt
from .trial_step import all_finite

CHECKPOINTS = 300
"""Number of checkpoints if the argument `adjoint` of `simulate` does not specify it. A run of 894
steps took 4.4 times as long with 4471 checkpoints as with 300, and a run of 36 000 steps took 1.5
times as long with 120 as with 300."""
REMEDY = (
    "Reverse-mode differentiation of `simulate` needs checkpoints: pass "
    "adjoint=diffrax.RecursiveCheckpointAdjoint() to it. For few parameters forward mode, "
    "jax.jvp or jax.jacfwd, takes less time and needs none."
)

Carry = TypeVar("Carry")
Item = TypeVar("Item")
Output = TypeVar("Output")


class Loops(eqx.Module):
    """The loops of a run and the trial step inside them.

    **Arguments:** `checkpoints`: number of iterations whose state each loop of the method `repeat`
    stores, which makes reverse-mode differentiation possible. With ``None`` the loops are JAX's
    own, which take less time and support forward mode only.
    """

    checkpoints: int | None = eqx.field(default=None, static=True)

    def attempt(self, method: Method, system: System, step: Step, t_end: Scalar) -> Attempt:
        """Try one step from `step`, at most to `t_end`, s, and return its outcome. In loops with
        checkpoints, the derivatives of a trial whose numbers are not finite are left out, so that
        they do not spoil those of the run."""
        function = attempt if self.checkpoints is None else _attempt_with_finite_derivatives
        return function(method, system, step, t_end)

    def repeat(
        self, condition: Callable[[Carry], Condition], body: Callable[[Carry], Carry], start: Carry
    ) -> Carry:
        """Apply `body` as `jax.lax.while_loop` does."""
        if self.checkpoints is None:
            return jax.lax.while_loop(condition, body, start)
        return eqxi.while_loop(
            condition, body, start, kind="checkpointed", checkpoints=self.checkpoints
        )

    def each(
        self, body: Callable[[Carry, Item], tuple[Carry, Output]], start: Carry, items: Item
    ) -> tuple[Carry, Output]:
        """Apply `body` to one item after the other, as `jax.lax.scan` does."""
        if self.checkpoints is None:
            return jax.lax.scan(body, start, items)
        # The state before each item is stored, and all else is computed again in the reverse pass.
        return jax.lax.scan(jax.checkpoint(body, prevent_cse=False), start, items)

    def guarded(self, outcome: Carry) -> Carry:
        """Return the final result of a run unchanged, but such that reverse-mode differentiation
        raises a `RuntimeError` that names the remedy, if the loops do not support this mode."""
        if self.checkpoints is None:
            return eqxi.nondifferentiable_backward(outcome, msg=REMEDY)
        return outcome


PLAIN = Loops()
"""JAX's own loops, which support forward mode only."""


_attempt = Compiled(attempt)
"""The function `attempt` as a program of its own, so that JAX traces it once for several calls."""


def loops_for(adjoint: diffrax.RecursiveCheckpointAdjoint | None) -> Loops:
    """Return the loops for the argument `adjoint` of `simulate`."""
    if adjoint is None:
        return PLAIN
    return Loops(CHECKPOINTS if adjoint.checkpoints is None else adjoint.checkpoints)


@eqx.filter_custom_jvp
def _attempt_with_finite_derivatives(
    method: Method, system: System, step: Step, t_end: Scalar
) -> Attempt:
    """Try one step, but with derivatives that stay finite if the trial overflows."""
    return _attempt(method, system, step, t_end)


@_attempt_with_finite_derivatives.def_jvp
def _attempt_jvp(
    primals: tuple[PyTree, ...], tangents: tuple[PyTree, ...]
) -> tuple[Attempt, Attempt]:
    """Return the attempt and its tangents. For a trial that overflowed, the field `step` of the
    attempt keeps the tangents from before the trial, and the tangents of all other fields are zero.
    Such a trial is rejected, so its tangents are multiplied by zero. In the reverse pass, zero
    times the infinite derivatives of the trial would be NaN."""
    # Only arrays of floats are differentiated; the rest passes through unchanged.
    inputs, others = eqx.partition(primals, eqx.is_inexact_array)
    tangents = jax.tree.map(
        eqxi.materialise_zeros, inputs, tangents, is_leaf=lambda leaf: leaf is None
    )

    def numbers(inputs: PyTree) -> tuple[PyTree, PyTree]:
        return eqx.partition(_attempt(*eqx.combine(inputs, others)), eqx.is_inexact_array)

    outcome, derivative, rest = jax.linearize(numbers, inputs, has_aux=True)
    # Derivatives of a trial contain products of its numbers, so they may overflow where the numbers
    # themselves do not.
    finite = all_finite(jax.tree.map(jnp.square, outcome.information))

    def gated(tree: Carry) -> Carry:
        return jax.tree.map(lambda leaf: jnp.where(finite, leaf, 0.0), tree)

    # If the trial is not finite, both the input and the output of the derivative are set to zero,
    # so that neither pass multiplies zero by infinity. The step stays as it was before the trial,
    # and keeps the tangents that it had. They are those of the third argument, `step`.
    along = gated(derivative(gated(tangents)))
    step = choose(finite, along.step, tangents[2])
    return eqx.combine(outcome, rest), replace(along, step=step)
