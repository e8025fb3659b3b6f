"""Data that a run carries from step to step: variables, contacts, derivatives, and the next step to
try.

A run tries a step, accepts or rejects it, and tries the next one. Steps end at events: the onset or
the end of a contact, or a breakpoint, a time at which a driver or load is declared to change
abruptly. The tangents of a run are the derivatives of its variables with respect to p parameters.
They are integrated together with the variables. Times are on the clock of the run's `System`, which
counts the time from the system's `origin`, s; without an origin it shows the scene's time.
"""

from functools import partial
from typing import TypeAlias, TypeVar

import diffrax
import equinox as eqx
import jax
from jaxtyping import PyTree

from ..._dynamics.contact_events import ContactGaps
from ..._dynamics.contact_forces import Bristles, EntrySpeeds
from ..._dynamics.coordinates import MotionVariables
from ..._math.smoothing import where
from ..._math.vectors import Condition, Scalar
from ..._model.joints.base import ByLabel
from ..._result_codes import RESULTS
from .landing import Landing
from .solvers import DenseInformation
from .time_map import AbstractTimeMap

T = TypeVar("T")

SolverState: TypeAlias = PyTree[Scalar]
"""Data that a diffrax solver keeps from one step to the next. `UnrolledExplicit`, this package's
form of explicit Runge-Kutta methods, keeps the rates at the end of the step."""
ControllerState: TypeAlias = PyTree[Scalar]
"""Data that a diffrax step-size controller keeps from one step to the next."""


class Method(eqx.Module):
    """Integration method of a run.

    - `solver`, `controller`: diffrax's solver and step-size controller, ready for single steps.
    - `landing`: the rule by which steps end at the onset and the end of a contact; ``None`` if
      steps go across these events.
    - `derivative_tolerance`: factor by which the tolerances of tangents are larger than those of
      the variables; ``None`` in runs without tangents.
    - `rotating`: names of the bodies whose rotations a step limits (see `.rotation_limit`).
    """

    solver: diffrax.AbstractSolver
    controller: diffrax.AbstractStepSizeController
    landing: Landing | None
    derivative_tolerance: Scalar | None = None
    rotating: frozenset[str] = eqx.field(default=frozenset(), static=True)


class Variables(eqx.Module):
    """The integrated variables of a run. Their rates per s have the same form.

    - `motion`: coordinates and velocities of the bodies, as the formulation defines them, in SI
      units.
    - `work`: integrals of the energy ledger by name, J; empty without a ledger.
    - `bristles`: deflections of the surfaces in friction laws that can stick, m, as
      `bristles[joint][contact]`; empty without such laws.
    """

    motion: MotionVariables
    work: dict[str, Scalar]
    bristles: Bristles = eqx.field(default_factory=dict)


class Tangents(eqx.Module):
    """Derivatives of three fields of a `Step` with respect to p parameters.

    Each field has the structure of the field of `Step` with the same name, and each leaf has an
    additional first axis of length p. The derivatives are with respect to the parameters'
    coordinates, such as the logarithm of a parameter on a logarithmic scale. Coordinates are pure
    numbers, so that each leaf has the unit of the variable.
    """

    y: Variables
    entry_speeds: EntrySpeeds
    solver_state: SolverState


class Proposal(eqx.Module):
    """The step to try next. All times and lengths are in s.

    - `t_next`: end of the step, unless an event or the end of the run comes first.
    - `full_length`: length that the step would have if no event cut it short. It is `t_next` minus
      the start of the step, except if the step repeats a trial that passed an event: `t_next` is
      then the time of this event.
    - `begins_contact`: whether a contact begins at the start of the step.
    - `time_since_onset`: time from the latest onset of a contact to the start of the step, infinite
      if there was none; ``None`` in runs without tangents.
    - `entry_length`: length of the latest step that began with an onset and was not cut short by an
      event; before the first such step, the length of the run's first step.
    - `made_jump`: whether rates may have changed abruptly at the start of the step, so that the
      rates which the solver has kept are no longer valid.
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

    - `t`: end of the latest accepted step, s.
    - `y`: the integrated variables at t.
    - `entry_speeds`: m/s, by joint and contact; the penetration rate at the onset of the present
      contact, zero without contact. Contacts whose law uses no entry speed have no entry.
    - `contact_gaps`: penetration, m, and its rate, m/s, of each contact at t.
    - `second_rates`: second time derivative of each penetration at t, m/s^2, by joint and contact;
      zero if the solver keeps no rates.
    - `solver_state`: data that the solver keeps for the next trial; `proposal`: the step to try.
    - `result`: the result code so far.
    - `attempts`, `accepted`: number of trials so far, and of those that were accepted.
    - `tangents`: derivatives of the state; ``None`` in runs without tangents.
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
    """The state after a trial step, with the data for dense output (the solution inside this step).

    - `step`: the new state if the trial was accepted; otherwise the old one with a new proposal,
      result code and number of attempts.
    - `kept`: whether the trial was accepted.
    - `t_start`, `entry_speeds_start`: time, s, and entry speeds, m/s, at the start of the trial.
    - `information`: the solver's data for dense output.
    - `time_map`: function of the fraction x of the trial, 0 to 1, at which the solver's tableau
      places a stage. Its value is the part of the trial's time that has elapsed there; ``None`` if
      this part is x in all steps. See `.time_map`.
    - `tangents`: derivatives of the data for dense output; ``None`` in runs without tangents.
    """

    step: Step
    kept: Condition
    t_start: Scalar
    entry_speeds_start: EntrySpeeds
    information: DenseInformation
    time_map: AbstractTimeMap | None
    tangents: "TangentsInside | None" = None


class TangentsInside(eqx.Module):
    """Derivatives, with respect to p parameters, of the data for dense output inside a step.

    Each field is the derivative of the field of `Attempt` with the same name; each leaf has an
    additional first axis of length p.
    """

    entry_speeds_start: EntrySpeeds
    information: DenseInformation


def choose(condition: Condition, first: T, second: T) -> T:
    """Return the PyTree `first` if the scalar `condition` is true, otherwise `second`, selected
    leaf by leaf. Both have the same structure."""
    return jax.tree.map(partial(where, condition), first, second)
