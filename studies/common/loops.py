"""Parts of a step, each in a native loop of its own, to be timed."""

import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from clearjoint.testing import Stepper

SMALL = 1e-9
"""s, by which the parts move on."""


def microseconds(turns: int, call: Callable[..., Any], *arguments: Any) -> float:
    """Time of a call for each of the turns it makes."""
    begin = time.perf_counter()
    jax.block_until_ready(call(*arguments))
    return (time.perf_counter() - begin) / turns * 1e6


def repeated(turn: Callable[..., Any], turns: Any, *values: Any) -> Any:
    """As many turns in a native loop; `relative_angle` takes and returns the values."""

    def go(now: Any) -> Any:
        return (now[0] + 1, *turn(*now[1:]))

    return jax.lax.while_loop(lambda now: now[0] < turns, go, (jnp.zeros((), int), *values))


def right_hand_sides(stepper: Stepper, step: Any, turns: Any) -> Any:
    """Right-hand sides, each a little further on."""

    def turn(y: Any) -> tuple[Any]:
        rates = stepper.rates(stepper.with_integrated(step, y))
        return (jax.tree.map(lambda value, rate: value + SMALL * rate, y, rates),)

    return repeated(turn, turns, stepper.integrated(step))


def solver_steps(stepper: Stepper, step: Any, turns: Any) -> Any:
    """The solver's steps alone."""
    return _summed(stepper.solver_step, step, turns)


def tried_steps(stepper: Stepper, step: Any, turns: Any) -> Any:
    """Attempted steps, as a run makes them."""
    return repeated(lambda step: (stepper.attempt(step),), turns, step)


def _summed(part: Callable[[Any, float], tuple[Any, Any]], step: Any, turns: Any) -> Any:
    """What a part says beside the step is summed, so that the compiler keeps it."""

    def turn(step: Any, total: Any) -> tuple[Any, Any]:
        after, more = part(step, SMALL)
        return after, total + more

    return repeated(turn, turns, step, jnp.zeros_like(step.t))
