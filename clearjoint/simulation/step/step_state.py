"""What a run carries from step to step."""

from typing import TypeVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp

from ...dynamics.contact_events import ContactGaps
from ...dynamics.contact_forces import Bristles, EntrySpeeds
from ...dynamics.coordinates import MotionVariables
from ...math.vectors import Condition, Scalar
from ...result_codes import RESULTS
from .landing import Landing
from .time_map import AbstractTimeMap
from .types import ControllerState, DenseInformation, SecondRates, SolverState

T = TypeVar("T")


class Method(eqx.Module):
    """How to integrate: solver, step-size controller and landing.

    `derivative_tolerance`: of the tangents, in tolerances of the state; ``None`` in runs without.
    """

    solver: diffrax.AbstractSolver
    controller: diffrax.AbstractStepSizeController
    landing: Landing | None
    derivative_tolerance: Scalar | None = None


class Variables(eqx.Module):
    """What the solver integrates: the coordinates' variables, the ledger's integrals in J, and the
    deflections of bristles in m, none in scenes without bristle laws."""

    motion: MotionVariables
    work: dict[str, Scalar]
    bristles: Bristles = eqx.field(default_factory=dict)


class Tangents(eqx.Module):
    """Derivatives of a step's state with respect to p parameters, which come first in each leaf."""

    y: Variables
    entry_speeds: EntrySpeeds
    solver_state: SolverState


class Proposal(eqx.Module):
    """The step to try next.

    - `t_next`: s, where it ends, unless the run or an event cuts it short.
    - `full_length`: s, how long it would be if no event had cut the steps before it short.
    - `begins_contact`: whether a contact begins where it starts.
    - `since_begin`: s, time since a contact last began, infinite if none has; ``None`` in runs
      without derivatives.
    - `entry_length`: s, length of the last step that began a contact and was not cut short.
    - `made_jump`: whether the rates may have jumped since the solver computed those it keeps.
    - `controller_state`: of the step-size controller.
    """

    t_next: Scalar
    full_length: Scalar
    begins_contact: Condition
    since_begin: Scalar | None
    entry_length: Scalar
    made_jump: Condition
    controller_state: ControllerState


class Step(eqx.Module):
    """Everything between two steps: enough to go on from.

    `t` s, variables, `entry_speeds` and `contact_gaps` are those at the end of the last accepted
    step, and `attempts` and `accepted` count the steps so far. `second_rates` are zero where the
    solver does not tell the rates there. `tangents` is ``None`` in runs without derivatives.
    """

    t: Scalar
    y: Variables
    entry_speeds: EntrySpeeds
    contact_gaps: ContactGaps
    second_rates: SecondRates
    solver_state: SolverState
    proposal: Proposal
    result: RESULTS
    attempts: Scalar
    accepted: Scalar
    tangents: Tangents | None = None


class Attempt(eqx.Module):
    """A step after it was tried, and what is needed to look inside it.

    - `step`: after the trial, with the proposal for the next one.
    - `kept`: whether the trial was accepted; if not, `step` is where it was.
    - `t_start`, `entry_speeds_start`: s, and entry speeds, where it began.
    - `information`: what its dense output is made of.
    - `time_map`: how its time passed; ``None`` where it passes evenly in all steps.
    - `tangents`: what is needed to look at its derivatives; ``None`` without any.
    """

    step: Step
    kept: Condition
    t_start: Scalar
    entry_speeds_start: EntrySpeeds
    information: DenseInformation
    time_map: AbstractTimeMap | None
    tangents: "TangentsInside | None" = None


class TangentsInside(eqx.Module):
    """What is needed to look at the derivatives inside a step: as the fields of `Attempt`."""

    entry_speeds_start: EntrySpeeds
    information: DenseInformation


def choose(condition: Condition, first: T, second: T) -> T:
    """The first of two PyTrees where a condition holds, else the second, leaf by leaf."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), first, second)
