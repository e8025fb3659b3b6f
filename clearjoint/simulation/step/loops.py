"""How the loops of a run are carried out: plainly, or so that a reverse pass can go back over them.

JAX cannot go back through a `while_loop`, whose number of turns is not known beforehand. equinox
keeps the state of some turns (checkpoints) and computes the turns between them anew on the way
back, as `diffrax.RecursiveCheckpointAdjoint` does.
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
"""Of an adjoint that does not say how many. Measured: with 894 steps 4471 took 4.4 times as long,
and with 36 000 steps 120 took 1.5 times as long."""
REMEDY = (
    "Reverse-mode differentiation of `simulate` needs checkpoints: pass "
    "adjoint=diffrax.RecursiveCheckpointAdjoint() to it. For few parameters forward mode, "
    "jax.jvp or jax.jacfwd, takes less time and needs none."
)


Carry = TypeVar("Carry")
Item = TypeVar("Item")
Visit = TypeVar("Visit")


class AbstractLoops(eqx.Module):
    """The loops of a run, and the step inside them, as a way of differentiation wants them."""

    @abc.abstractmethod
    def attempt(self, method: Method, system: System, step: Step, t_end: Scalar) -> Attempt:
        """Try one step, as `clearjoint.simulation.step.stepping.attempt` does."""

    @abc.abstractmethod
    def repeat(
        self, goes: Callable[[Carry], Condition], go: Callable[[Carry], Carry], start: Carry
    ) -> Carry:
        """Apply `go` to a state as long as `goes` holds of it, like `jax.lax.while_loop`."""

    @abc.abstractmethod
    def each(
        self,
        visit: Callable[[Carry, Item], tuple[Carry, Visit]],
        start: Carry,
        places: Item,
    ) -> tuple[Carry, Visit]:
        """Visit places one after the other, like `jax.lax.scan`; places and visits have their
        number in front."""

    @abc.abstractmethod
    def closed(self, outcome: Carry) -> Carry:
        """The outcome of a run. A reverse pass that cannot go back over it raises an error."""


class PlainLoops(AbstractLoops):
    """JAX's loops, which forward differentiation can follow."""

    def attempt(self, method: Method, system: System, step: Step, t_end: Scalar) -> Attempt:
        """Try one step by `clearjoint.simulation.step.stepping.attempt` itself."""
        return attempt(method, system, step, t_end)

    def repeat(
        self, goes: Callable[[Carry], Condition], go: Callable[[Carry], Carry], start: Carry
    ) -> Carry:
        """JAX's loop, whose number of turns is not known beforehand."""
        return jax.lax.while_loop(goes, go, start)

    def each(
        self,
        visit: Callable[[Carry, Item], tuple[Carry, Visit]],
        start: Carry,
        places: Item,
    ) -> tuple[Carry, Visit]:
        """JAX's loop over a known number of places."""
        return jax.lax.scan(visit, start, places)

    def closed(self, outcome: Carry) -> Carry:
        """The outcome; a reverse pass that begins at it raises a `RuntimeError`."""
        return eqxi.nondifferentiable_backward(outcome, msg=REMEDY)


PLAIN = PlainLoops()


class CheckpointedLoops(AbstractLoops):
    """Loops that reverse differentiation can follow; each keeps its state at so many
    `checkpoints`."""

    checkpoints: int = eqx.field(static=True)

    def attempt(self, method: Method, system: System, step: Step, t_end: Scalar) -> Attempt:
        """Try one step; a trial that overflowed has no derivatives."""
        return _attempt_without_overflow(method, system, step, t_end)

    def repeat(
        self, goes: Callable[[Carry], Condition], go: Callable[[Carry], Carry], start: Carry
    ) -> Carry:
        """equinox's loop, which keeps its state at the checkpoints."""
        return eqxi.while_loop(goes, go, start, kind="checkpointed", checkpoints=self.checkpoints)

    def each(
        self,
        visit: Callable[[Carry, Item], tuple[Carry, Visit]],
        start: Carry,
        places: Item,
    ) -> tuple[Carry, Visit]:
        """JAX's loop, keeping the state at each place and nothing of the way there."""
        return jax.lax.scan(jax.checkpoint(visit, prevent_cse=False), start, places)

    def closed(self, outcome: Carry) -> Carry:
        """The outcome as it is, since a reverse pass can go back over these loops."""
        return outcome


_attempt = Compiled(attempt)


def loops_for(adjoint: diffrax.RecursiveCheckpointAdjoint | None) -> AbstractLoops:
    """Loops that can be differentiated the way that an `adjoint` of `simulate` asks for."""
    if adjoint is None:
        return PLAIN
    checkpoints = adjoint.checkpoints
    return CheckpointedLoops(CHECKPOINTS if checkpoints is None else checkpoints)


@eqx.filter_custom_jvp
def _attempt_without_overflow(method: Method, system: System, step: Step, t_end: Scalar) -> Attempt:
    return _attempt(method, system, step, t_end)


@_attempt_without_overflow.def_jvp
def _(primals: tuple[PyTree, ...], tangents: tuple[PyTree, ...]) -> tuple[Attempt, Attempt]:
    """A trial that overflows is rejected, so that its tangents are multiplied by zero; but going
    backwards that zero would meet their infinite slopes, and make NaN. So none enter it."""
    tangents = jax.tree.map(_tangent, primals, tangents, is_leaf=_is_none)
    inputs, others = eqx.partition(primals, eqx.is_inexact_array)

    def numbers(inputs: PyTree) -> tuple[PyTree, PyTree]:
        return eqx.partition(_attempt(*eqx.combine(inputs, others)), eqx.is_inexact_array)

    outcome, derivative, rest = jax.linearize(numbers, inputs, has_aux=True)
    finite = _is_finite(outcome.information)

    def gated(tree: Carry) -> Carry:
        return jax.tree.map(lambda leaf: jnp.where(finite, leaf, 0.0), tree)

    along = gated(derivative(gated(tangents)))
    step = choose(finite, along.step, tangents[2])
    return eqx.combine(outcome, rest), replace(along, step=step)


def _is_none(leaf: object) -> bool:
    return leaf is None


def _tangent(primal: PyTree, tangent: PyTree) -> PyTree:
    missing = tangent is None and eqx.is_inexact_array(primal)
    return jnp.zeros_like(primal) if missing else tangent


def _is_finite(tree: PyTree[Scalar]) -> Condition:
    """Whether all numbers are finite, and their squares."""
    total: Scalar = 0.0
    for leaf in jax.tree.leaves(tree):
        total = total + jnp.sum(leaf * leaf) * 0.0
    return total == 0.0
