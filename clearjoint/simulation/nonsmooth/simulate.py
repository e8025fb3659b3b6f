"""Simulation with rigid contacts: impacts have no duration, and steps do not follow them."""

from dataclasses import replace
from functools import reduce

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Float, Int

from ...compilation import Compiled
from ...dynamics.breakpoints import breakpoints, seen, since_breakpoints
from ...dynamics.coordinates import AbstractCoordinates, MotionVariables
from ...dynamics.formulation import Formulation
from ...dynamics.joint_coordinates.coordinates import JointCoordinates
from ...dynamics.journals import warn_of_journals_outside
from ...dynamics.system import System
from ...fields.checks import concrete, require, require_positive, require_range
from ...fields.readable import AbstractReadable
from ...math.vectors import Condition, Scalar, Structured, pack, structured, unpack
from ...model.bodies import BodyState, State
from ...model.scene import Scene
from ...results import RESULTS
from ..aliases import Integers, Numbers
from ..run_checks import check_precision, check_start
from ..saving import Saving, saving_or_nothing
from ..solution import Trajectory, raise_failure
from ..spans import check_span
from ..step_state import choose
from .moreau_jean import ContactStep, Rigid, advance


class ContactTotals(AbstractReadable):
    """What a rigid contact did since the start.

    - `impacts`: steps with an impulse that follow one without. A contact that rolls may hop, which
      counts each time.
    - `impulse`: sum of the normal impulses, N s. There is no peak force: an impact takes no time.
    - `dissipated`: J, by restitution and friction.
    - `hardest`: largest impulse of a step, N s. `fastest`: largest approach speed with one, m/s.
    - `penetration`: deepest in the middle of a step, m.
    """

    impacts: Integers
    impulse: Numbers
    dissipated: Numbers
    hardest: Numbers
    fastest: Numbers
    penetration: Numbers


class NonsmoothSolution(AbstractReadable):
    """The outcome of `clearjoint.simulate_nonsmooth`.

    - `time`, `final`, `result`: as of `Solution`.
    - `steps`: how many were taken.
    - `saved`: the states at the requested times, and `history[joint][contact]` the `ContactTotals`
      up to each of them, both ``None`` if none were requested. `saved_count` of them were reached;
      the others repeat the last state.
    - `contacts[joint][contact]`: the `ContactTotals` of the run.
    - `residual`: largest violation of the contacts' laws in any step, over its largest velocity.
    - `formulation`, `redundant_constraints`: as of `Solution`. `observe` takes
      such a solution too, for all but forces.
    """

    time: Numbers
    final: State
    result: RESULTS
    steps: Integers
    saved: Trajectory | None
    history: dict[str, dict[str, ContactTotals]] | None
    saved_count: Integers | None
    contacts: dict[str, dict[str, ContactTotals]]
    residual: Numbers
    formulation: Formulation
    redundant_constraints: tuple[str, ...] = eqx.field(static=True)


def simulate_nonsmooth(
    scene: Scene,
    state: State,
    end_time: Scalar,
    save: Saving | None = None,
    *,
    step: Scalar,
    start_time: Scalar = 0.0,
    restitution: Scalar | None = None,
    coordinates: AbstractCoordinates | None = None,
    redundant: bool | None = None,
    throw: bool = True,
) -> NonsmoothSolution:
    """Simulate a scene with rigid contacts in fixed steps, by the midpoint rule of Moreau and Jean.

    A contact of a joint is unilateral: it never penetrates (but for half a step's approach), parts
    after an impact with the law's *delivered* restitution times the approach speed, and slides by
    Coulomb's law, with the coefficient that the friction law has at high slip. Stiffness and
    duration of impacts are absent, and so are peak forces; a step may be far longer than an impact.
    An impact happens in the middle of its step, so that its instant, and with it every state, is
    known to half a step: order one.

    A step ends at each breakpoint of a joint or force, and where a driver makes velocities jump,
    they jump with the least kinetic energy, as in `simulate`.

    Works under `jax.vmap`, `jax.jit` and `jax.jvp`, and then raises no error. But derivatives
    across impacts are not those of the motion: which step an impact falls into does not move with
    the parameters.

    **Arguments:**

    - `scene`, `state`, `end_time`, `start_time`, `throw`: as of `simulate`; `coordinates`,
      `redundant`: as of `Settings`.
    - `step`: s, the longest step. Between two times to save at, steps are equal.
    - `save`: the times at which to save the state; a step ends at each.
    - `restitution`: Newton's coefficient of every contact, 0 to 1, in place of the delivered one.

    **Raises:** `ValueError` for arguments that no run can use, such as a law that does not report
    the restitution that it delivers; `SimulationError` for a run that fails: the contacts of a step
    were not solved, a bearing was penetrated deeper than its clearance, or the state is not
    finite.
    """
    check_precision(False)
    save = saving_or_nothing(save)
    save.require_times_alone("of a run with rigid contacts", "take simulate() for it")
    times = save.times
    coordinates = JointCoordinates() if coordinates is None else coordinates
    numbers = scene, state, end_time, start_time, step, restitution
    traced = any(concrete(leaf) is None for leaf in jax.tree.leaves((numbers, jnp.zeros(()))))
    names: tuple[str, ...] = ()
    require_restitution(scene, restitution)
    if not traced:
        require_positive("step", step, "give the longest step in s")
        check_span(start_time, end_time)
        times = save.times_between(start_time, end_time)
        names = check_start(scene, state, start_time, coordinates)
    formulation = Formulation(
        coordinates, redundant=bool(names) if redundant is None else redundant
    )
    ends = (jnp.asarray([time], dtype=float) for time in (start_time, end_time))
    stops = jnp.concatenate([next(ends), jnp.asarray([] if times is None else times), *ends])
    chosen = None if restitution is None else jnp.asarray(restitution, dtype=float)
    run = _run_compiled(
        structured(scene), formulation, state, stops, jnp.asarray(step, dtype=float), chosen
    )
    solution = _solution(run, stops, times is not None, formulation, names)
    if traced:
        return solution
    solution = jax.device_get(solution)
    saved = solution.saved
    rows = [] if saved is None else [(saved.times, saved.states)]
    warn_of_journals_outside(scene, solution.time, solution.final, rows)
    if throw:
        raise_failure(solution)
    return solution


def require_restitution(scene: Scene, restitution: Scalar | None) -> None:
    """Check that every contact has a restitution."""
    if restitution is not None:
        require_range("restitution", restitution, 0.0, 1.0, "1 is elastic, 0 is plastic")
        return
    for name, family in scene.laws().items():
        for label, law in family.items():
            require(
                hasattr(law, "delivered_restitution"),
                f"scene.joints[{name!r}]",
                type(law).__name__,
                f"of a law with delivered_restitution() at {label!r}",
                "pass restitution=, or give the law such a method",
            )


class _Run(eqx.Module):
    """A run between two steps; `touching` tells of each contact whether it had an impulse."""

    t: Scalar
    variables: MotionVariables
    touching: dict[str, dict[str, Scalar]]
    totals: dict[str, dict[str, ContactTotals]]
    residual: Scalar
    result: RESULTS
    steps: Scalar


class _Stop(eqx.Module):
    """What is kept of a run at a time at which a step ends; bodies in packed form."""

    bodies: dict[str, BodyState]
    totals: dict[str, dict[str, ContactTotals]]
    result: RESULTS


class _Outcome(eqx.Module):
    """The end of a run with its bodies in packed form, and all stops but the first."""

    end: _Run
    bodies: dict[str, BodyState]
    stops: _Stop


def _run(
    form: Structured,
    formulation: Formulation,
    state: State,
    stops: Float[jax.Array, " stops"],
    longest: Scalar,
    restitution: Scalar | None,
) -> _Outcome:
    system = System(unpack(form), formulation)
    rigid = Rigid(system, _restitutions(system.scene, restitution))
    first = _first(rigid, system.encode(unpack(state.bodies)), stops[0])
    times, places = _with_breakpoints(system.scene, stops)

    def to_stop(now: _Run, span: tuple[Scalar, Scalar]) -> tuple[_Run, _Stop]:
        now = _past_kink(system, _to_stop(rigid, now, *span, longest), *span)
        return now, _Stop(pack(system.decode(now.variables)), now.totals, now.result)

    end, kept = jax.lax.scan(to_stop, first, (times[:-1], times[1:]))
    if places is not None:
        kept = jax.tree.map(lambda leaf: leaf[places], kept)
    return _Outcome(end, pack(system.decode(end.variables)), kept)


_run_compiled = Compiled(_run)


def _with_breakpoints(
    scene: Scene, stops: Float[jax.Array, " stops"]
) -> tuple[Float[jax.Array, " times"], Int[jax.Array, " rest"] | None]:
    """The stops and the breakpoints between them, rising; and where behind the first the stops
    behind the first are, ``None`` if there are no breakpoints."""
    elements = jax.tree.leaves(breakpoints(scene))
    if not elements:
        return stops, None
    inside = [jnp.clip(jnp.ravel(at).astype(float), stops[0], stops[-1]) for at in elements]
    times = jnp.sort(jnp.concatenate([stops, *inside]))
    return times, jnp.searchsorted(times, stops[1:], side="right") - 2


def _past_kink(system: System, now: _Run, start: Scalar, stop: Scalar) -> _Run:
    """The run with the velocities that drivers want from `stop` on, if one changes there."""
    since = since_breakpoints(system, start, stop)
    joints = [lands for name, (lands, _) in since.items() if name in system.scene.joints]
    if not joints:
        return now
    time = seen(system, stop, stop)
    variables = jax.lax.cond(
        reduce(jnp.logical_or, joints) & (now.result == RESULTS.successful),
        lambda variables: system.project_velocities(variables, time),
        lambda variables: variables,
        now.variables,
    )
    return replace(now, variables=variables)


def _to_stop(rigid: Rigid, now: _Run, start: Scalar, stop: Scalar, longest: Scalar) -> _Run:
    """The run after equal steps from one stop to the next."""
    count = jnp.ceil((stop - start) / longest * (1.0 - 1e-9))
    h = (stop - start) / jnp.maximum(count, 1.0)

    def goes(carry: tuple[_Run, Scalar]) -> Scalar:
        return (carry[1] < count) & (carry[0].result == RESULTS.successful)

    def go(carry: tuple[_Run, Scalar]) -> tuple[_Run, Scalar]:
        now, k = carry
        return _after_step(rigid, now, start + k * h, h), k + 1.0

    return jax.lax.while_loop(goes, go, (now, jnp.zeros(())))[0]


def _restitutions(scene: Scene, restitution: Scalar | None) -> dict[str, dict[str, Scalar]]:
    return {
        name: {
            label: law.delivered_restitution() if restitution is None else restitution  # pyright: ignore
            for label, law in family.items()
        }
        for name, family in scene.laws().items()
    }


def _first(rigid: Rigid, variables: MotionVariables, t: Scalar) -> _Run:
    """The run before its first step."""
    zero, none = jnp.zeros(()), jnp.zeros((), int)
    nothing = ContactTotals(none, zero, zero, zero, zero, zero)
    laws = rigid.system.scene.laws()
    return _Run(
        t=t,
        variables=jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=float), variables),
        touching={name: dict.fromkeys(family, jnp.asarray(False)) for name, family in laws.items()},
        totals={name: dict.fromkeys(family, nothing) for name, family in laws.items()},
        residual=zero,
        result=RESULTS.successful,
        steps=none,
    )


def _after_step(rigid: Rigid, now: _Run, t: Scalar, h: Scalar) -> _Run:
    """The run a step further, or as it was if the step failed."""
    end = advance(rigid, now.variables, t, h)
    sums = [0.0 * leaf for leaf in jax.tree.leaves(end.variables)]
    finite = sum(sums[1:], sums[0]) == 0.0
    touching = jax.tree.map(lambda one: one.impulse > 0.0, end.contacts, is_leaf=_is_contact)
    totals = jax.tree.map(_total, now.totals, end.contacts, now.touching, is_leaf=_is_contact)
    result = RESULTS.where(finite, now.result, RESULTS.non_finite)
    result = RESULTS.where(finite & ~end.solved, RESULTS.solver_failed, result)
    result = RESULTS.where(finite & ~end.shallow, RESULTS.step_too_long, result)
    following = _Run(
        t=t + h,
        variables=end.variables,
        touching=touching,
        totals=totals,
        residual=jnp.maximum(now.residual, end.residual),
        result=now.result,
        steps=now.steps + 1,
    )
    return replace(choose(finite & end.solved & end.shallow, following, now), result=result)


def _is_contact(tree: object) -> bool:
    return isinstance(tree, ContactTotals | ContactStep)


def _total(totals: ContactTotals, step: ContactStep, touched: Condition) -> ContactTotals:
    """The totals with those of a step; `touched` tells whether the one before had an impulse."""
    pushes = step.impulse > 0.0
    approach = jnp.where(pushes, jnp.maximum(-step.opening, 0.0), 0.0)
    return ContactTotals(
        impacts=totals.impacts + (pushes & ~touched),
        impulse=totals.impulse + step.impulse,
        dissipated=totals.dissipated + step.dissipated,
        hardest=jnp.maximum(totals.hardest, step.impulse),
        fastest=jnp.maximum(totals.fastest, approach),
        penetration=jnp.maximum(totals.penetration, step.penetration),
    )


def _solution(
    run: _Outcome,
    stops: Float[jax.Array, " stops"],
    saves: bool,
    formulation: Formulation,
    redundant_constraints: tuple[str, ...],
) -> NonsmoothSolution:
    saved, history, count = None, None, None
    if saves:
        rows = jax.tree.map(lambda leaf: leaf[:-1], run.stops)
        history, count = rows.totals, (run.stops.result == RESULTS.successful)[:-1].sum()
        memory = jax.tree.map(
            lambda totals: jnp.zeros_like(totals.impulse), history, is_leaf=_is_contact
        )
        saved = Trajectory(stops[1:-1], State(rows.bodies, memory))
    return NonsmoothSolution(
        time=run.end.t,
        final=State(run.bodies),
        result=run.end.result,
        steps=run.end.steps,
        saved=saved,
        history=history,
        saved_count=count,
        contacts=run.end.totals,
        residual=run.end.residual,
        formulation=formulation,
        redundant_constraints=redundant_constraints,
    )
