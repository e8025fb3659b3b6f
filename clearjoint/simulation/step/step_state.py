"""Data that a run carries from step to step."""

from typing import TypeAlias, TypeVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ...dynamics.contact_events import ContactGaps
from ...dynamics.contact_forces import Bristles, EntrySpeeds
from ...dynamics.coordinates import MotionVariables
from ...math.vectors import Condition, Scalar
from ...model.joints.base import ByLabel
from ...result_codes import RESULTS
from .landing import Landing
from .time_map import AbstractTimeMap
from .unrolled_runge_kutta import DenseInformation

T = TypeVar("T")

SolverState: TypeAlias = PyTree[Scalar]
"""State of a diffrax solver between steps."""
ControllerState: TypeAlias = PyTree[Scalar]
"""State of a diffrax step-size controller between steps."""


class Method(eqx.Module):
    """Integration method: solver, step-size controller and landing.

    `landing` is ``None`` if steps go across contact events. `derivative_tolerance`: tolerance of
    the tangents, in tolerances of the state; ``None`` in runs without tangents.
    """

    solver: diffrax.AbstractSolver
    controller: diffrax.AbstractStepSizeController
    landing: Landing | None
    derivative_tolerance: Scalar | None = None


class Variables(eqx.Module):
    """The integrated variables: those of the coordinates, the integrals of the energy ledger in J,
    and bristle deflections in m (empty without bristle laws). Their rates have the same form."""

    motion: MotionVariables
    work: dict[str, Scalar]
    bristles: Bristles = eqx.field(default_factory=dict)


class Tangents(eqx.Module):
    """Derivatives of the state of a `Step` with respect to the coordinates of p parameters.

    Each field has the structure of the field of `Step` with the same name, and each leaf has an
    additional first axis of length p. Units are those of the variables, per unit of a coordinate.
    """

    y: Variables
    entry_speeds: EntrySpeeds
    solver_state: SolverState


class Proposal(eqx.Module):
    """The step to try next.

    - `t_next`: s, its end, unless an event or the end of the run comes first.
    - `full_length`: s, its length if no event had cut the steps before it short.
    - `begins_contact`: whether a contact begins at its start.
    - `time_since_onset`: s, time since a contact last began, infinite if none has; ``None`` in runs
      without derivatives.
    - `entry_length`: s, length of the last step that began a contact and was not cut short.
    - `made_jump`: whether rates may have jumped since the solver computed those that it keeps.
    - `controller_state`: state of the step-size controller.
    """

    t_next: Scalar
    full_length: Scalar
    begins_contact: Condition
    time_since_onset: Scalar | None
    entry_length: Scalar
    made_jump: Condition
    controller_state: ControllerState


class Step(eqx.Module):
    """The complete state of a run between two steps.

    - `t`: s, the end of the last accepted step; `y`, `entry_speeds` (m/s), `contact_gaps` and
      `second_rates` (of the gaps, m/s^2; zero if the solver keeps no rates) are those at t.
    - `solver_state`, `proposal`: input of the next trial.
    - `result`: the result code so far.
    - `attempts`, `accepted`: number of trials, and of accepted ones.
    - `tangents`: ``None`` in runs without derivatives.
    """

    t: Scalar
    y: Variables
    entry_speeds: EntrySpeeds
    contact_gaps: ContactGaps
    second_rates: ByLabel[Scalar]
    solver_state: SolverState
    proposal: Proposal
    result: RESULTS
    attempts: Scalar
    accepted: Scalar
    tangents: Tangents | None = None


class Attempt(eqx.Module):
    """The state after a trial step, with the data for dense output inside it.

    - `step`: the new state if the trial was accepted, otherwise the old one with a new proposal.
    - `kept`: whether the trial was accepted.
    - `t_start`, `entry_speeds_start`: s and m/s, at the start of the trial.
    - `information`: the solver's data for dense output.
    - `time_map`: of the trial; ``None`` if time is uniform in all steps.
    - `tangents`: the same data for the derivatives; ``None`` in runs without derivatives.
    """

    step: Step
    kept: Condition
    t_start: Scalar
    entry_speeds_start: EntrySpeeds
    information: DenseInformation
    time_map: AbstractTimeMap | None
    tangents: "TangentsInside | None" = None


class TangentsInside(eqx.Module):
    """Data for dense output of the derivatives with respect to p parameters inside a step.

    They are the derivatives of the fields of `Attempt` with the same names, with a first axis of
    length p in each leaf.
    """

    entry_speeds_start: EntrySpeeds
    information: DenseInformation


def choose(condition: Condition, first: T, second: T) -> T:
    """Return the first of two PyTrees if a condition is true, else the second, leaf by leaf."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), first, second)
