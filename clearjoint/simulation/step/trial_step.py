"""One trial of the solver: a step, and its derivatives, before it is accepted or rejected."""

from dataclasses import replace

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ...compilation import traced_once
from ...dynamics.breakpoints import breakpoints, seen
from ...dynamics.contact_events import closed, touches, uses_entry_speed
from ...dynamics.contact_forces import Closed, EntrySpeeds
from ...dynamics.system import System
from ...fields.types import Single
from ...math.groups import sum_
from ...math.vectors import Condition, Scalar
from ...model.scene import Scene
from .dense_output import correct
from .rates import rates_of
from .saltation import contacts_jump, slopes_jump
from .step_state import Method, Step, Variables, choose
from .systems import SystemFamily
from .time_map import AbstractTimeMap, FromOnset, WithinContact
from .types import DenseInformation, SolverState
from .unrolled_runge_kutta import UnrolledExplicit

REJECTED_ERROR = 1e30
"""Of a trial that is not finite: no controller accepts it."""


def term_of(method: Method, step: Step | None = None) -> diffrax.ODETerm:
    """The rates of the variables as a diffrax term, whose arguments are system and memory.

    Of a `step` that lands on events: the rates with the contacts that are closed at its start. They
    are traced once for all stages of a step; and anew for another term, since what they read
    outside of their arguments may have changed.
    """
    traced_rates = traced_once(_rates)
    lands = step is not None and method.landing is not None
    closed_contacts = closed(step.contact_gaps) if step is not None and lands else None

    def rates(t: Single, y: Variables, args: tuple[System, EntrySpeeds]) -> Variables:
        system, entry_speeds = args
        t = seen(system, t if step is None else step.t, t)
        return traced_rates(system, y, entry_speeds, t, closed_contacts)

    return diffrax.ODETerm(rates)


def _rates(
    system: System,
    y: Variables,
    entry_speeds: EntrySpeeds,
    t: Single,
    closed_contacts: Closed | None,
) -> Variables:
    rates = rates_of(system, y, entry_speeds, t, closed_contacts)
    return jax.tree.map(lambda rate: jnp.asarray(rate, dtype=jnp.result_type(t)), rates)


def error_order(method: Method) -> Single:
    """The order of the solver's error estimate, which the controller needs."""
    order = method.solver.error_order(term_of(method))
    assert order is not None, "only solvers of stochastic equations have none"
    return order


class SolverStep(eqx.Module):
    """What a solver's step gives, or its derivatives along p parameters, which come first."""

    y: Variables
    error: Variables
    information: DenseInformation
    solver_state: SolverState


class Trial(eqx.Module):
    """A step as the solver made it.

    - `t1`: s, where it ends; `time_map`: how its time passes.
    - `outcome`: what it gives, and `tangents` the derivatives of that, ``None`` without any.
    - `finite`: whether both were finite. If not, the variables are those of the start.
    - `solver_result`: the solver's own code.
    """

    t1: Scalar
    time_map: AbstractTimeMap | None
    outcome: SolverStep
    tangents: SolverStep | None
    finite: Condition
    solver_result: diffrax.RESULTS


def time_map_of(method: Method, step: Step, t1: Scalar) -> AbstractTimeMap | None:
    """How time passes in the step up to t1; ``None`` where it passes evenly in all steps.

    Without derivatives, grading the steps out of a contact too gained nothing: as many steps, and
    more of them in a journal that rolls along the wall.
    """
    if method.landing is None or not step.contact_gaps:
        return None
    if not isinstance(method.solver, UnrolledExplicit):
        return None
    begins, since = step.proposal.begins_contact, step.proposal.since_begin
    if since is None:
        return FromOnset(begins)
    due = method.landing.time_to_contact_end(step.contact_gaps, step.second_rates)
    return WithinContact.of(t1 - step.t, touches(step.contact_gaps), begins, since, due)


def try_step(
    method: Method, system: System, step: Step, t1: Scalar, family: SystemFamily | None
) -> Trial:
    """The solver's step up to t1, corrected as the stabilisation wants it."""
    made_jump = step.proposal.made_jump if may_jump(method, system.scene) else False
    time_map = time_map_of(method, step, t1)
    options = {} if time_map is None else {"time_map": time_map}

    def advance(
        system: System, y: Variables, entry_speeds: EntrySpeeds, solver_state: SolverState
    ) -> tuple[SolverStep, diffrax.RESULTS]:
        if slopes_may_jump(method, system.scene):
            solver_state = _after_jump(method, system, step, t1, (y, entry_speeds, solver_state))
        y1, error, information, solver_state, result = method.solver.step(
            term_of(method, step),
            step.t,
            t1,
            y,
            (system, entry_speeds),
            solver_state,
            made_jump,
            **options,
        )
        y1 = correct(system, y1, seen(system, step.t, t1))
        y1, solver_state = _without_drift(system, y1, solver_state)
        assert isinstance(error, Variables)
        return SolverStep(y1, error, information, solver_state), result

    start = step.y, step.entry_speeds, step.solver_state
    if family is None:
        outcome, result = advance(system, *start)
        finite, tangents = _all_finite((outcome.y, outcome.error)), None
    else:
        assert step.tangents is not None
        along = step.tangents.y, step.tangents.entry_speeds, step.tangents.solver_state
        outcome, result, tangents = family.pushed(advance, start, along)
        finite = _all_finite((outcome.y, outcome.error, tangents.y, tangents.error))
        tangents = _unless(finite, tangents, step.tangents.y)
    return Trial(t1, time_map, _unless(finite, outcome, step.y), tangents, finite, result)


def _after_jump(
    method: Method,
    system: System,
    step: Step,
    t1: Scalar,
    start: tuple[Variables, EntrySpeeds, SolverState],
) -> SolverState:
    """What the solver keeps of the last step, of a start of variables, memory and that: anew where
    a contact began or ended there, with the contacts that are closed since."""
    y, entry_speeds, kept = start

    def anew() -> SolverState:
        return method.solver.init(term_of(method, step), step.t, t1, y, (system, entry_speeds))

    return jax.lax.cond(step.proposal.made_jump, anew, lambda: kept)


def _without_drift(
    system: System, y: Variables, solver_state: SolverState
) -> tuple[Variables, SolverState]:
    """The variables in numbers that don't drift in many steps, and what the solver keeps of their
    rates to match."""

    def matching(node: PyTree) -> PyTree:
        if not isinstance(node, Variables):
            return node
        motion = jax.jvp(system.without_drift, (y.motion,), (node.motion,))[1]
        return replace(node, motion=motion)

    state = jax.tree.map(matching, solver_state, is_leaf=lambda node: isinstance(node, Variables))
    return replace(y, motion=system.without_drift(y.motion)), state


def _unless(finite: Condition, outcome: SolverStep, y: Variables) -> SolverStep:
    """The outcome if it is finite; else with the given variables, and an error beyond all
    bounds."""
    error = jax.tree.map(lambda e: jnp.where(finite, e, REJECTED_ERROR), outcome.error)
    return SolverStep(
        choose(finite, outcome.y, y), error, outcome.information, outcome.solver_state
    )


def may_jump(method: Method, scene: Scene) -> bool:
    """Whether the rates at the start of a step may differ from those at the end of the last one.

    A new memory changes them, a force that jumps does, and bristles begin to be dragged with the
    contact; but where steps land on the begin of contacts, memory changes where the force is still
    zero.
    """
    if bool(breakpoints(scene)) or bool(scene.bristle_laws()):
        return True
    return uses_entry_speed(scene) if method.landing is None else contacts_jump(scene)


def slopes_may_jump(method: Method, scene: Scene) -> bool:
    """Whether the rates at the start of a step are those at the end of the last one but for a slope
    that jumps where a contact begins or ends."""
    lands = method.landing is not None and isinstance(method.solver, UnrolledExplicit)
    return lands and slopes_jump(scene) and not may_jump(method, scene)


def _all_finite(tree: PyTree[Scalar]) -> Condition:
    """One test for all leaves: adding zero times each lets any NaN or infinity through. Leaves of
    one shape are added element by element before the elements are."""
    families: dict[tuple[int, ...], list[Scalar]] = {}
    for leaf in jax.tree.leaves(tree):
        families.setdefault(jnp.shape(leaf), []).append(leaf * 0.0)
    return sum(sum_(_sum(family)) for family in families.values()) == 0.0


def _sum(terms: list[Scalar]) -> Scalar:
    """The sum by halves: a processor adds those of a level side by side."""
    middle = len(terms) // 2
    return _sum(terms[:middle]) + _sum(terms[middle:]) if middle else terms[0]
