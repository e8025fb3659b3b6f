"""Simulation with rigid contacts: impacts have no duration, and steps do not follow them."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from ...dynamics.coordinates import AbstractCoordinates
from ...dynamics.formulation import Formulation
from ...dynamics.joint_coordinates.coordinates import JointCoordinates
from ...dynamics.journals import warn_of_journals_outside
from ...dynamics.system import System
from ...fields.checks import concrete, require, require_positive, require_range
from ...fields.readable import AbstractReadable
from ...math.vectors import Scalar, Structured, pack, structured, unpack
from ...model.bodies import State
from ...model.scene import Scene
from ...results import RESULTS
from ..run_checks import check_precision, check_start
from ..saving import Saving, saving_or_nothing
from ..solution import Trajectory, raise_failure
from ..spans import check_span
from .moreau_jean import ContactStep, Rigid, advanced


class ContactTotals(AbstractReadable):
    """What a rigid contact did since the start.

    - `impacts`: steps with an impulse that follow one without. A contact that rolls may hop, which
      counts each time.
    - `impulse`: sum of the normal impulses, N s. There is no peak force: an impact takes no time.
    - `dissipated`: J, by restitution and friction.
    - `hardest`: largest impulse of a step, N s. `fastest`: largest approach speed with one, m/s.
    - `penetration`: deepest in the middle of a step, m.
    """

    impacts: Any
    impulse: Any
    dissipated: Any
    hardest: Any
    fastest: Any
    penetration: Any


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

    time: Any
    final: State
    result: RESULTS
    steps: Any
    saved: Trajectory | None
    history: dict[str, dict[str, ContactTotals]] | None
    saved_count: Any
    contacts: dict[str, dict[str, ContactTotals]]
    residual: Any
    formulation: Formulation
    redundant_constraints: tuple[str, ...] = eqx.field(static=True)


def simulate_nonsmooth(
    scene: Scene,
    state: State,
    end_time: Any,
    save: Saving | None = None,
    *,
    step: Any,
    start_time: Any = 0.0,
    restitution: Any = None,
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
    solution = _solution(run, stops, times is not None, formulation, names, traced)
    if not traced:
        kept = [] if solution.saved is None else [(solution.saved.times, solution.saved.states)]
        warn_of_journals_outside(scene, solution.time, solution.final, kept)
    if throw and not traced:
        raise_failure(solution)
    return solution


def require_restitution(scene: Scene, restitution: Any) -> None:
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


class _Now(eqx.Module):
    """A run between two steps; `touching` tells of each contact whether it had an impulse."""

    t: Scalar
    variables: Any
    touching: Any
    totals: Any
    residual: Scalar
    result: RESULTS
    steps: Scalar


class _Run(eqx.Module):
    """The end of a run in packed form, and the states, totals and results at all stops but the
    first."""

    end: _Now
    final: Any
    states: Any
    totals: Any
    results: Any


def _run(
    form: Structured,
    formulation: Formulation,
    state: State,
    stops: Any,
    longest: Any,
    restitution: Any,
) -> _Run:
    system = System(unpack(form), formulation)
    rigid = Rigid(system, _restitutions(system.scene, restitution))
    begin = _begin(rigid, system.encode(unpack(state.bodies)), stops[0])

    def to_stop(now: _Now, span: tuple[Any, Any]) -> tuple[_Now, Any]:
        start, stop = span
        count = jnp.ceil((stop - start) / longest * (1.0 - 1e-9))
        h = (stop - start) / jnp.maximum(count, 1.0)

        def goes(carried: tuple[_Now, Scalar]) -> Scalar:
            return (carried[1] < count) & (carried[0].result == RESULTS.successful)

        def go(carried: tuple[_Now, Scalar]) -> tuple[_Now, Scalar]:
            now, k = carried
            return _stepped(rigid, now, start + k * h, h), k + 1.0

        now, _ = jax.lax.while_loop(goes, go, (now, jnp.zeros(())))
        kept = pack(system.decode(now.variables)), now.totals, now.result
        return now, kept

    end, (states, totals, results) = jax.lax.scan(to_stop, begin, (stops[:-1], stops[1:]))
    return _Run(end, pack(system.decode(end.variables)), states, totals, results)


_run_compiled = eqx.filter_jit(_run)


def _restitutions(scene: Scene, restitution: Any) -> dict[str, dict[str, Scalar]]:
    return {
        name: {
            label: law.delivered_restitution() if restitution is None else restitution  # pyright: ignore
            for label, law in family.items()
        }
        for name, family in scene.laws().items()
    }


def _begin(rigid: Rigid, variables: Any, t: Any) -> _Now:
    """The run before its first step."""
    variables = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=float), variables)
    zero = jnp.zeros(())
    nothing = ContactTotals(jnp.zeros((), int), zero, zero, zero, zero, zero)
    laws = rigid.system.scene.laws()
    totals = {name: dict.fromkeys(family, nothing) for name, family in laws.items()}
    touching = {name: dict.fromkeys(family, jnp.asarray(False)) for name, family in laws.items()}
    none = jnp.zeros((), int)
    return _Now(t, variables, touching, totals, zero, RESULTS.successful, none)


def _stepped(rigid: Rigid, now: _Now, t: Scalar, h: Scalar) -> _Now:
    """The run a step further, or as it was if the step failed."""
    tried = advanced(rigid, now.variables, t, h)
    sums = [0.0 * leaf for leaf in jax.tree.leaves(tried.variables)]
    finite = sum(sums[1:], sums[0]) == 0.0
    touching = jax.tree.map(lambda one: one.impulse > 0.0, tried.contacts, is_leaf=_is_contact)
    totals = jax.tree.map(_added, now.totals, tried.contacts, now.touching, is_leaf=_is_contact)
    result = RESULTS.where(finite, now.result, RESULTS.non_finite)
    result = RESULTS.where(finite & ~tried.solved, RESULTS.solver_failed, result)
    result = RESULTS.where(finite & ~tried.shallow, RESULTS.step_too_long, result)
    good = finite & tried.solved & tried.shallow
    residual = jnp.maximum(now.residual, tried.residual)
    ahead = _Now(t + h, tried.variables, touching, totals, residual, result, now.steps + 1)
    kept = jax.tree.map(
        lambda new, old: jnp.where(good, new, old),
        eqx.tree_at(lambda n: n.result, ahead, now.result),
        now,
    )
    return eqx.tree_at(lambda n: n.result, kept, result)


def _is_contact(tree: Any) -> bool:
    return isinstance(tree, ContactTotals | ContactStep)


def _added(totals: ContactTotals, step: ContactStep, touched: Scalar) -> ContactTotals:
    pushes = step.impulse > 0.0
    approach = jnp.where(pushes, jnp.maximum(-step.opening, 0.0), 0.0)
    return ContactTotals(
        totals.impacts + (pushes & ~touched),
        totals.impulse + step.impulse,
        totals.dissipated + step.dissipated,
        jnp.maximum(totals.hardest, step.impulse),
        jnp.maximum(totals.fastest, approach),
        jnp.maximum(totals.penetration, step.penetration),
    )


def _solution(
    run: _Run,
    stops: Any,
    saves: bool,
    formulation: Formulation,
    names: tuple[str, ...],
    traced: bool,
) -> NonsmoothSolution:
    saved, history, count = None, None, None
    if saves:
        states, history = jax.tree.map(lambda leaf: leaf[:-1], (run.states, run.totals))
        count = (run.results == RESULTS.successful)[:-1].sum()
        memory = jax.tree.map(
            lambda totals: jnp.zeros_like(totals.impulse), history, is_leaf=_is_contact
        )
        saved = Trajectory(stops[1:-1], State(states, memory))
    solution = NonsmoothSolution(
        run.end.t,
        State(run.final),
        run.end.result,
        run.end.steps,
        saved,
        history,
        count,
        run.end.totals,
        run.end.residual,
        formulation,
        names,
    )
    return solution if traced else jax.device_get(solution)
