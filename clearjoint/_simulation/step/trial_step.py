"""One trial step of the solver with its tangents, before it is accepted or rejected."""

from dataclasses import replace
from typing import TypeAlias

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ..._compilation.xla import traced_once
from ..._dynamics.breakpoints import has_breakpoints, one_sided_time
from ..._dynamics.bristles import bristle_rates
from ..._dynamics.contact_events import ContactGaps, closed, touches, uses_entry_speed
from ..._dynamics.contact_forces import Closed, EntrySpeeds
from ..._dynamics.sampled_forces import holding
from ..._dynamics.system import System
from ..._fields.types import Single
from ..._math.stacked import Stacked, stacked, unstacked
from ..._math.vectors import Condition, Scalar
from ..._model.scene import Scene
from .dense_output import stabilised
from .method import SystemFamily
from .saltation import contacts_jump, slopes_jump
from .solvers import DenseInformation, UnrolledExplicit
from .step_state import Method, SolverState, Step, Variables, choose
from .time_map import AbstractTimeMap, FromOnset, WithinContact

Arguments: TypeAlias = tuple[System, EntrySpeeds]
"""The `args` of the differential equations."""
REJECTED_ERROR = 1e30
"""Error assigned to a trial whose result is not finite; it is large enough for any controller that
adapts the step to reject the trial."""


def rates_of(
    system: System, y: Variables, entry_speeds: EntrySpeeds, t: Scalar, closed: Closed | None = None
) -> Variables:
    """Return the rates of all integrated variables `y` at the time t, s, as arrays of the dtype of
    `t`; `Stacked` if the variables are. By default those contacts that penetrate are `closed`."""
    are_stacked, y = isinstance(y, Stacked), unstacked(y)
    # The system with its sampled forces as they were determined at their latest instants.
    held = holding(system, y.memory)
    dynamics = held.dynamics(y.motion, entry_speeds, t, closed, y.bristles)
    integrands = {
        name: integrand(system, t, y.motion, entry_speeds, y.bristles, y.memory)
        for name, integrand in system.formulation.integrands.items()
    }
    work = {**held.powers(dynamics, t), **integrands}
    no_rates = jax.tree.map(lambda _: 0.0, y.memory)
    rates = Variables(dynamics.variable_rates, work, bristle_rates(dynamics), no_rates)
    # diffrax requires arrays in place of Python numbers.
    rates = jax.tree.map(lambda rate: jnp.asarray(rate, dtype=jnp.result_type(t)), rates)
    return stacked(rates) if are_stacked else rates


def term_of(
    method: Method, step: Step | None = None, family: SystemFamily | None = None
) -> diffrax.ODETerm:
    """Return the differential equations as a diffrax term, a function of time, variables and
    `args`, the pair `(system, entry_speeds)`.

    In a step from `step`, forces that depend on time have at a breakpoint the value that holds
    inside of the step. If steps end at contact events, contacts stay open or closed as they are at
    the start of the step, so that the rates are smooth within it.

    The rates are traced once per term and reused for all stages. Each term traces anew, because the
    traced function uses values of the surrounding trace.

    **Arguments:** `step`: the state at the start of the step; with ``None``, forces have at a
    breakpoint the value after it, and contacts are closed where they penetrate; `family`: the
    system as a function of parameters, if the step has tangents.
    """
    traced_rates = traced_once(rates_of, family is not None and family.is_transposed)
    lands = step is not None and method.landing is not None
    closed_contacts = closed(step.contact_gaps) if step is not None and lands else None

    def rates(t: Single, y: Variables, args: Arguments) -> Variables:
        system, entry_speeds = args
        # At a breakpoint at the end of the step, forces have the values just before it.
        t = one_sided_time(system, t if step is None else step.t, t)
        return traced_rates(system, y, entry_speeds, t, closed_contacts)

    return diffrax.ODETerm(rates)


def error_order(method: Method) -> Single:
    order = method.solver.error_order(term_of(method))
    assert order is not None, "only solvers of stochastic equations have none"
    return order


class SolverStep(eqx.Module):
    """Result of a solver's step, or its tangents: variables, their error estimate, data for dense
    output, and solver state. Error estimate and data are `Stacked` if the variables are many."""

    y: Variables
    error: PyTree[Scalar]
    information: DenseInformation
    solver_state: SolverState


class Trial(eqx.Module):
    """A trial step of a `system` from the state `step`, as the solver of a `method` computed it.

    - `family`: the system as a function of parameters, if the step has tangents.
    - `t1`: end of the step, s; `time_map`: ``None`` if time is uniform in the step.
    - `outcome`, `tangents`, `solver_result`: results of the solver, their derivatives by the
      parameters (``None`` in runs without tangents), and the solver's result code.
    - `gaps`: the contact gaps at the end.
    - `finite`: whether the solver's results are finite; if not, the variables are those at the
      start of the step, and the errors are `REJECTED_ERROR`.
    """

    method: Method
    system: System
    family: SystemFamily | None
    step: Step
    t1: Scalar
    time_map: AbstractTimeMap | None
    outcome: SolverStep
    tangents: SolverStep | None
    solver_result: diffrax.RESULTS
    gaps: ContactGaps = eqx.field(default_factory=dict)
    finite: Condition = True


def time_map_of(method: Method, step: Step, t1: Scalar) -> AbstractTimeMap | None:
    """Return the time map that places the stages of a step from `step` to `t1`, s; ``None`` if time
    is uniform in the step."""
    # Only if steps end at contact events does an onset coincide with the start of a step.
    if method.landing is None or not step.contact_gaps:
        return None
    # The `step` of other solvers takes no time map.
    if not isinstance(method.solver, UnrolledExplicit):
        return None
    begins, since = step.proposal.begins_contact, step.proposal.time_since_onset
    if since is None:
        # A run without derivatives, which does not keep this time. In such runs, `WithinContact`
        # saved no steps, and a run with a journal that rolls along the wall took more steps.
        return FromOnset(begins)
    gaps, second_rates = step.contact_gaps, step.second_rates
    until_end = method.landing.time_to_next_event(gaps, second_rates, ends_only=True)
    return WithinContact.of(t1 - step.t, touches(step.contact_gaps), begins, since, until_end)


def try_step(
    method: Method, system: System, step: Step, t1: Scalar, family: SystemFamily | None
) -> Trial:
    """Compute the trial step from `step` to `t1`, s. If a number in the solver's result is not
    finite, the trial gets errors with which the step-size controller will reject it."""
    trial = solved_step(method, system, step, t1, family)
    outcome, tangents = trial.outcome, trial.tangents
    if tangents is None:
        finite = all_finite((outcome.y, outcome.error))
    else:
        assert step.tangents is not None
        finite = all_finite((outcome.y, outcome.error, tangents.y, tangents.error))
        tangents = _or_rejected(finite, tangents, step.tangents.y)
    outcome = _or_rejected(finite, outcome, step.y)
    trial = replace(trial, outcome=outcome, tangents=tangents, finite=finite)
    return with_gaps(trial)


def solved_step(
    method: Method, system: System, step: Step, t1: Scalar, family: SystemFamily | None
) -> Trial:
    """Compute the solver's step from `step` to `t1`, s, with stabilised constraints and normalised
    variables, and its tangents by the parameters of `family`, unless that is ``None``. The result
    is not checked for numbers that are not finite, and has no contact gaps (see `with_gaps`)."""
    # With the Python value False, the solver reuses the rates of the last step without a branch.
    made_jump = step.proposal.made_jump if may_jump(method, system.scene) else False
    time_map = time_map_of(method, step, t1)
    options = {} if time_map is None else {"time_map": time_map}

    # Stabilisation and normalisation are part of the function that `family` differentiates, so that
    # the tangents belong to the variables as they are after both.
    def advance(
        system: System, y: Variables, entry_speeds: EntrySpeeds, solver_state: SolverState
    ) -> tuple[SolverStep, diffrax.RESULTS]:
        args = system, entry_speeds
        if slopes_may_jump(method, system.scene):
            # The solver has kept the rates at the end of the last step, computed with the contacts
            # that were closed in that step. If a contact has begun or ended, the kept rates still
            # hold, but their tangents do not, because the slope of a force jumps. The solver's
            # state is then computed anew.
            kept = solver_state

            def computed_anew() -> SolverState:
                return method.solver.init(term_of(method, step, family), step.t, t1, y, args)

            has_event = step.proposal.made_jump
            solver_state = jax.lax.cond(has_event, computed_anew, lambda: kept)
        term = term_of(method, step, family)
        y1, error, information, solver_state, result = method.solver.step(
            term, step.t, t1, y, args, solver_state, made_jump, **options
        )
        y1 = stabilised(system, y1, one_sided_time(system, step.t, t1))
        y1, solver_state = _without_drift(system, y1, solver_state)
        return SolverStep(y1, error, information, solver_state), result

    # The arguments of `advance` after the system.
    start = step.y, step.entry_speeds, step.solver_state
    tangents = None
    if family is None:
        outcome, result = advance(system, *start)
    else:
        # Runge-Kutta methods commute with differentiation: differentiating the step, error estimate
        # included, is the same step of the variational equations.
        assert step.tangents is not None
        along = step.tangents.y, step.tangents.entry_speeds, step.tangents.solver_state
        outcome, result, tangents = family.with_auxiliary(advance, start, along)
    return Trial(method, system, family, step, t1, time_map, outcome, tangents, result)


def with_gaps(trial: Trial) -> Trial:
    return replace(trial, gaps=trial.system.contact_gaps(trial.outcome.y.motion))


def _without_drift(
    system: System, y: Variables, solver_state: SolverState
) -> tuple[Variables, SolverState]:
    """Return variables normalised by `System.without_drift`, and the solver's state for them. The
    solver keeps rates of the variables for its next step. Normalising is a change of variables, so
    these rates are multiplied by its Jacobian."""

    def matching(node: PyTree) -> PyTree:
        if not isinstance(node, Variables):
            return node
        motion = jax.jvp(system.without_drift, (y.motion,), (node.motion,))[1]
        return replace(node, motion=motion)

    state = jax.tree.map(matching, solver_state, is_leaf=lambda node: isinstance(node, Variables))
    return replace(y, motion=system.without_drift(y.motion)), state


def _or_rejected(finite: Condition, outcome: SolverStep, y: Variables) -> SolverStep:
    """Return the result of a step unchanged if it is `finite`; otherwise with the variables `y`, of
    the start of the step, and with an error that lets the controller reject the trial."""
    error = jax.tree.map(lambda e: jnp.where(finite, e, REJECTED_ERROR), outcome.error)
    return replace(outcome, y=choose(finite, outcome.y, y), error=error)


def may_jump(method: Method, scene: Scene) -> bool:
    """Return whether rates may jump between two steps, so that those which the solver has kept must
    be computed anew. Rates jump at breakpoints and where a contact begins to drag bristles. In runs
    whose steps end at contact events, they also jump where a contact's force does. (Other forces
    are zero at the onset, whatever the entry speed.) In runs whose steps go across contact events,
    they also jump where a contact gets a new entry speed."""
    if has_breakpoints(scene) or bool(scene.bristle_laws()):
        return True
    return uses_entry_speed(scene) if method.landing is None else contacts_jump(scene)


def slopes_may_jump(method: Method, scene: Scene) -> bool:
    """Return whether, where a contact begins or ends, rates are continuous but their slopes may
    jump: the rates that the solver has kept are then valid, but the tangents of these are not."""
    lands = method.landing is not None and isinstance(method.solver, UnrolledExplicit)
    return lands and slopes_jump(scene) and not may_jump(method, scene)


def all_finite(tree: PyTree[Scalar]) -> Condition:
    """Return whether all numbers of a PyTree are finite. 0 times a NaN or an infinity is NaN, so
    the sum of 0 times each number is 0 only if all numbers are finite."""
    zeros_by_shape: dict[tuple[int, ...], list[Scalar]] = {}
    for leaf in jax.tree.leaves(tree):
        # Leaves of one shape are added elementwise first, so that there is one reduction for each
        # shape.
        zeros_by_shape.setdefault(jnp.shape(leaf), []).append(leaf * 0.0)
    sums = [_pairwise_sum(zeros) for zeros in zeros_by_shape.values()]
    return sum(total if jnp.ndim(total) == 0 else jnp.sum(total) for total in sums) == 0.0


def _pairwise_sum(terms: list[Scalar]) -> Scalar:
    """Add by halves, so that a processor can do independent additions at the same time."""
    middle = len(terms) // 2
    return _pairwise_sum(terms[:middle]) + _pairwise_sum(terms[middle:]) if middle else terms[0]
