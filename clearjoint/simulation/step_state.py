"""What a run carries from step to step."""

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp

from ..dynamics.contact_events import Reaches
from ..dynamics.contact_forces import Memory
from ..math.vectors import Scalar
from ..results import RESULTS
from .landing import Landing


class Method(eqx.Module):
    """How to integrate: solver, step-size controller and landing."""

    solver: diffrax.AbstractSolver
    controller: diffrax.AbstractStepSizeController
    landing: Landing | None


class Variables(eqx.Module):
    """What the solver integrates: the coordinates' variables, and the ledger's integrals in J."""

    motion: Any
    work: dict[str, Scalar]


class Tangents(eqx.Module):
    """Derivatives of a step's state with respect to p parameters, which come first in each leaf."""

    y: Variables
    memory: Memory
    solver_state: Any


class Step(eqx.Module):
    """Everything between two steps: enough to go on from.

    `second_rates` are those of the contacts' depths, m/s^2. `intended` is the length of the next
    step, s, were it not cut short by an event; `enters` says that it is the first in a contact, of
    which `entering` is the length that held last. `tangents` is ``None`` unless they are wanted.
    """

    t: Scalar
    t_next: Scalar
    y: Variables
    memory: Memory
    reaches: Reaches
    second_rates: Any
    intended: Scalar
    enters: Scalar
    entering: Scalar
    solver_state: Any
    controller_state: Any
    jumped: Any
    result: RESULTS
    attempts: Scalar
    accepted: Scalar
    tangents: Tangents | None = None


class Attempt(eqx.Module):
    """A step, and what is needed to look inside it; `graded` as in `.unrolled_runge_kutta`."""

    step: Step
    kept: Scalar
    t_start: Scalar
    memory_start: Memory
    information: Any
    graded: Any
    tangents: "TangentsInside | None" = None


class TangentsInside(eqx.Module):
    """What is needed to look at the tangents inside a step."""

    memory_start: Memory
    information: Any


def choose(condition: Scalar, first: Any, second: Any) -> Any:
    """One of two PyTrees, leaf by leaf."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), first, second)
