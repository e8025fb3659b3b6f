"""Data that a run carries from step to step: variables, contacts, tangents, and the next
proposal."""

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
"""State of a diffrax solver between steps; for `UnrolledExplicit` the rates at the end of the
step."""
ControllerState: TypeAlias = PyTree[Scalar]
"""State of a diffrax step-size controller between steps."""


class Method(eqx.Module):
    """Integration method.

    - `solver`, `controller`: diffrax's, ready for single steps.
    - `landing`: where steps end at contact events; ``None`` if steps go across these events.
    - `derivative_tolerance`: factor by which the tolerances of tangents are larger than those of
      the variables; ``None`` in runs without tangents.
    """

    solver: diffrax.AbstractSolver
    controller: diffrax.AbstractStepSizeController
    landing: Landing | None
    derivative_tolerance: Scalar | None = None


class Variables(eqx.Module):
    """The integrated variables, or their rates, which have the same form.

    - `motion`: coordinates and velocities, as the formulation defines them, in SI units.
    - `work`: integrals of the energy ledger by name, J; empty without a ledger.
    - `bristles`: deflections, m, as `bristles[joint][contact]`; empty without bristle laws.
    """

    motion: MotionVariables
    work: dict[str, Scalar]
    bristles: Bristles = eqx.field(default_factory=dict)


class Tangents(eqx.Module):
    """Tangents: derivatives with respect to p parameters, of fields of a `Step`.

    Each field has the structure of the field of `Step` with the same name, and each leaf has an
    additional first axis of length p. The unit of a leaf is that of the variable, per unit of the
    parameter on its scale (a `Log` scale has no unit).
    """

    y: Variables
    entry_speeds: EntrySpeeds
    solver_state: SolverState


class Proposal(eqx.Module):
    """The step to try next. All times and lengths are in s.

    - `t_next`: end of the step, unless an event or the end of the run comes first.
    - `full_length`: length that the step would have if no event had cut earlier steps short.
    - `begins_contact`: whether a contact begins at the start of the step.
    - `time_since_onset`: time from the latest onset of a contact to the start of the step, infinite
      if there was none; ``None`` in runs without derivatives.
    - `entry_length`: length of the latest step that began with an onset and was not cut short.
    - `made_jump`: whether rates may have jumped at the start of the step, after the solver computed
      the rates that it keeps.
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

    - `t`: end of the latest accepted step, s since the `origin` of the `System`.
    - `y`, `entry_speeds` (m/s), `contact_gaps` (m and m/s): variables and contacts at t.
    - `second_rates`: second derivative of each penetration at t, m/s^2, by joint and contact; zero
      if the solver keeps no rates.
    - `solver_state`, `proposal`: input of the next trial.
    - `result`: the result code so far.
    - `attempts`, `accepted`: number of trials so far, and of those that were accepted.
    - `tangents`: derivatives of the state; ``None`` in runs without derivatives.
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
    """The state after a trial step, with the data for dense output inside this step.

    - `step`: the new state if the trial was accepted; otherwise the old one with a new proposal.
    - `kept`: whether the trial was accepted.
    - `t_start`, `entry_speeds_start`: time, s, and entry speeds, m/s, at the start of the trial.
    - `information`: the solver's data for dense output.
    - `time_map`: how time passes in the trial; ``None`` if time is uniform in all steps.
    - `tangents`: derivatives of the data for dense output; ``None`` in runs without derivatives.
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
    """Return `first` if `condition`, a scalar, is true, otherwise `second`; leaf by leaf, in
    PyTrees of one structure."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), first, second)
