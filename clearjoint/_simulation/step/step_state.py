"""Data a run carries between steps: variables, contacts, derivatives, and the next step to try."""

import enum
from functools import partial
from typing import TypeAlias, TypeVar

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
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
"""Data that a diffrax solver keeps; for `UnrolledExplicit`, the rates at the end of the step."""
ControllerState: TypeAlias = PyTree[Scalar]
"""Data that a diffrax step-size controller keeps from one step to the next."""


class Method(eqx.Module):
    """Integration method of a run.

    - `landing`: the rule by which steps end at contact events; ``None`` if steps go across events.
    - `derivative_tolerance`: factor by which the tolerances of tangents are larger than those of
      the variables; ``None`` in runs without tangents.
    - `rotating`: names of the bodies whose rotation in a step is limited (see `.rotation_limit`).
    """

    solver: diffrax.AbstractSolver
    controller: diffrax.AbstractStepSizeController
    landing: Landing | None
    derivative_tolerance: Scalar | None = None
    rotating: frozenset[str] = eqx.field(default=frozenset(), static=True)


class Variables(eqx.Module):
    """The integrated variables of a run. Their rates per s have the same form.

    - `motion`: coordinates and velocities of the bodies, as the formulation defines them, SI.
    - `work`: integrals of the energy ledger by name, J; empty without a ledger.
    - `bristles`: deflections, m, as `bristles[joint][contact]`.
    - `memory`: memories of sampled forces, as `memory[force][name]`, whose rates are zero.
    """

    motion: MotionVariables
    work: dict[str, Scalar]
    bristles: Bristles = eqx.field(default_factory=dict)
    memory: dict[str, dict[str, Scalar]] = eqx.field(default_factory=dict)


class Tangents(eqx.Module):
    """Derivatives of three fields of a `Step` with respect to the coordinates of p parameters, such
    as the logarithm of a parameter on a logarithmic scale. Coordinates are pure numbers, so that
    each derivative has the unit of its variable. Each array has a first axis of length p."""

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
    """

    t_next: Scalar
    full_length: Scalar
    begins_contact: Condition
    time_since_onset: Scalar | None
    entry_length: Scalar
    made_jump: Condition
    controller_state: ControllerState


class Step(eqx.Module):
    """The complete state of a run between two steps: `t` is the end of the latest accepted step, s.

    - `entry_speeds`: m/s, by joint and contact, of contacts whose law uses entry speeds.
    - `second_rates`: second time derivative of each penetration at t, m/s^2, by joint and contact;
      zero unless the solver is an `UnrolledExplicit`.
    - `result`: result code of the run; `attempts`, `accepted`: numbers of trial steps, and of those
      that were accepted, since the start of the run.
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


class Rejection(enum.StrEnum):
    """Why a step was rejected and tried again with a shorter length. The value of each member is
    the text in tables.

    - `ERROR`: the estimated error of variables or derivatives exceeds the tolerances.
    - `NOT_FINITE`: a variable or its error is NaN or infinite.
    - `DRIVER`: the angle or distance that a driver prescribes is not smooth over the step.
    - `ROTATION`: a body rotates by more than 0.75 rad; only in runs whose steps are searched for
      contact events, crossings or peaks that depend on its rotation.
    - `CONTACT`: a contact begins or ends before the end of the step, which is repeated up to there.

    >>> print(cj.results.Rejection.CONTACT)
    contact event
    """

    ERROR = "error estimate"
    NOT_FINITE = "not finite"
    DRIVER = "driver"
    ROTATION = "rotation"
    CONTACT = "contact event"


class Rejected(eqx.Module):
    """The end `t1` of a trial step, s, and by `Rejection` whether it was rejected for this reason;
    at most one is true. Reasons that cannot occur in the run are left out."""

    t1: Scalar
    reasons: dict[str, Condition]


class Attempt(eqx.Module):
    """The state after a trial step, with the data for dense output inside this step.

    - `step`: the new state if the trial was `accepted`; otherwise the old one with a new
      proposal, result code and number of attempts.
    - `t_start`, `entry_speeds_start`: time, s, and entry speeds, m/s, at the start of the trial.
    - `information`: data for dense output; `time_map`: ``None`` if time is uniform in the step.
    - `tangents`: derivatives of the data for dense output; ``None`` in runs without tangents.
    - `rejected`: whether and why the trial was rejected; ``None`` in a record of accepted attempts.
    """

    step: Step
    accepted: Condition
    t_start: Scalar
    entry_speeds_start: EntrySpeeds
    information: DenseInformation
    time_map: AbstractTimeMap | None
    tangents: "TangentsInside | None" = None
    rejected: Rejected | None = None


class TangentsInside(eqx.Module):
    """Derivatives, by the parameters, of the fields of an `Attempt` that have the same names."""

    entry_speeds_start: EntrySpeeds
    information: DenseInformation


def choose(condition: Condition, first: T, second: T) -> T:
    """Return `first` if the scalar `condition` is true, otherwise `second`, leaf by leaf."""
    return jax.tree.map(partial(where, condition), first, second)


def without_weak_types(tree: T) -> T:
    """Return a PyTree whose leaves have no weak types, like the results of loops. A program that
    first gets a weak type, and later the result of a loop, would be compiled twice."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=jnp.result_type(leaf)), tree)
