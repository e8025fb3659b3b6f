"""Error-controlled forward sensitivities: derivatives of what is measured along a motion.

Plain differentiation through an adaptive loop gives the derivative of the discretisation, which
near impacts is another function than that of the motion. Here the variational equations are
integrated beside the state and judged with it, the memory of an impact is differentiated at its
true onset, and steps land on onsets within 1e-13 m. How right they are, and what they cost, is
measured by `studies.benchmark`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int, PyTree
from numpy.typing import ArrayLike

from ..compilation import Compiled
from ..dynamics.contact_forces import Memory
from ..dynamics.system import System
from ..fields.checks import require, require_names
from ..math.vectors import Scalar, pack
from ..model.bodies import State
from ..model.scene import Scene
from ..parametrisation.parameter import Parameter, check_parameters, coordinates_of
from ..parametrisation.parametrised_scene import AbstractFamily, parametrised
from ..quantities.base import Quantity, check_quantity
from ..quantities.instant import Instant
from ..results import RESULTS
from . import presets
from .advance import Recorder, advance, latest_attempt
from .aliases import Gradients, Numbers
from .dense_output import Snapshot, correct, look_inside
from .derivative_runs import derivative_scheme
from .impact_recorder import (
    ImpactRecord,
    ImpactRecorder,
    ImpactRow,
    impacts_of,
    most,
)
from .impact_table import Impacts
from .method import Scheme
from .run_ends import final_result, named, state_of
from .saving import Saving, saving_or_nothing
from .sections import Crossings, SectionRecord, SectionRecorder, after_sections, crossings_of
from .settings import Settings, settings_or
from .solution import Trajectory, raise_failure
from .spans import check_span, checked_times
from .step_state import Attempt, Method, Step, Variables
from .stepping import blank_attempt, running
from .systems import SystemFamily
from .tables import Table
from .variational import look_at_tangents, start_with_tangents

LATEST, IMPACTS, SECTIONS = "latest", "impacts", "sections"
"""Names of what is recorded on the way."""
Run = tuple[Step, dict[str, PyTree]]
"""The latest step, and what is recorded, by name."""
FEW_TIMES, GROWTH = 64, 8
"""Numbers of times are rounded up to one of 64, 512, 4096, ..., so that hardly another compiles
anything. A time that is repeated is looked at once, so that those added cost next to nothing."""


class Kept(eqx.Module):
    """What is kept of a run beside quantities.

    `states`: whether the states at the times are; `impacts`: room for so many of each contact, or
    ``None`` to table none; `sections`: whose crossings are tabled.
    """

    states: bool = eqx.field(default=False, static=True)
    impacts: int | None = eqx.field(default=None, static=True)
    sections: dict[str, SectionRecorder] = eqx.field(default_factory=dict)


NOTHING_ELSE = Kept()
IMPACTS_AT_FIRST = 512
"""Of each contact; a run that has more is repeated with room for `GROWTH` times as many."""


class Sampled(eqx.Module):
    """What was measured at N instants, and its derivatives along p parameters.

    - `values[name]`: (N,), `derivatives[name]`: (N, p), with respect to the scales' coordinates.
    - `reached`: (N,) whether the run came so far.
    - `time`, `result`, `attempts`, `accepted`: where and how it ended, and its steps.
    - `states`, in scalar form with N in front, `impacts` and `sections`, if they are kept.
    """

    values: dict[str, Numbers]
    derivatives: dict[str, Gradients]
    reached: jax.Array
    time: Scalar
    result: RESULTS
    attempts: Scalar
    accepted: Scalar
    states: State | None = None
    impacts: ImpactRecord[Table] | None = None
    sections: dict[str, SectionRecord] = eqx.field(default_factory=dict)


def followed(
    scheme: Scheme,
    family: AbstractFamily,
    outputs: Mapping[str, Quantity],
    times: jax.Array,
    t0: Scalar,
    t_end: Scalar,
    first_step: Scalar,
    max_steps: Scalar,
    kept: Kept = NOTHING_ELSE,
) -> tuple[Sampled, Step, Step]:
    """Integrate state and derivatives, and look at quantities at rising times: what was seen, and
    the first and the last step. Traceable."""
    method, systems = scheme.method, SystemFamily(family, scheme.formulation)
    system = systems.system()
    first = start_with_tangents(method, systems, t0, t_end, first_step)
    records: dict[str, PyTree] = {LATEST: blank_attempt(method, system, first, t_end, systems)}
    recorders: dict[str, Recorder] = {LATEST: latest_attempt}
    if kept.impacts is not None:
        now, table = Snapshot(first.t, first.y, first.memory).instant(system), ImpactRow.none()
        records[IMPACTS] = ImpactRecorder().start(now, first, Table.like(table, kept.impacts))
        recorders[IMPACTS] = ImpactRecorder().after
    records[SECTIONS] = {name: of.start(system, first) for name, of in kept.sections.items()}
    recorders[SECTIONS] = after_sections

    def go(now: Run) -> Run:
        step, records = now
        return advance(method, system, step, t_end, records, recorders, family=systems)

    def sample(now: Run, row: tuple[Scalar, Scalar]) -> tuple[Run, PyTree]:
        time, is_new = row
        step, records = now = jax.lax.while_loop(
            lambda now: (now[0].t < time) & running(now[0], t_end, max_steps), go, now
        )
        last = records[LATEST]
        looks = jax.lax.cond(
            is_new,
            lambda: _looked_at(method, systems, outputs, last, time),
            lambda: _nothing(systems, outputs),
        )
        states = None
        if kept.states:
            states = named(state_of(system, *look_inside(method, system, last, time)))
        return now, (*looks, time <= step.t, states)

    is_new = jnp.diff(times, prepend=-jnp.inf) > 0.0
    (step, records), (*looks, reached, states) = jax.lax.scan(
        sample, (first, records), (times, is_new)
    )
    latest = jax.lax.cummax(jnp.where(is_new, jnp.arange(len(times)), 0))
    values, derivatives = jax.tree.map(lambda leaf: leaf[latest], looks)
    sampled = Sampled(
        values,
        derivatives,
        reached,
        step.t,
        final_result(step, t_end),
        step.attempts,
        step.accepted,
        states,
        records.get(IMPACTS),
        records[SECTIONS],
    )
    return sampled, first, step


def _nothing(
    family: SystemFamily, outputs: Mapping[str, Quantity]
) -> tuple[dict[str, Scalar], dict[str, Scalar]]:
    """What stands in the place of quantities at a time that has been looked at."""
    along = jnp.zeros(len(family.values))
    return dict.fromkeys(outputs, jnp.zeros(())), dict.fromkeys(outputs, along)


def _looked_at(
    method: Method,
    family: SystemFamily,
    outputs: Mapping[str, Quantity],
    tried: Attempt,
    time: Scalar,
) -> tuple[dict[str, Scalar], dict[str, Scalar]]:
    """Quantities at an instant of an accepted step, and their derivatives."""
    dense = look_inside(method, family.system(), tried, time)

    def observed(system: System, y: Variables, memory: Memory) -> tuple[dict[str, Scalar], None]:
        y = correct(system, y, time)
        now = Instant(system, time, y.motion, memory, y.work)
        return {name: jnp.asarray(of(now), float) for name, of in outputs.items()}, None

    values, _, derivatives = family.pushed(observed, dense, look_at_tangents(method, tried, time))
    return values, derivatives


@Compiled
def sampled_compiled(*arguments: PyTree) -> Sampled:
    """What was seen of `followed`."""
    return followed(*arguments)[0]


@dataclass(frozen=True)
class Sensitivities:
    """Quantities along a motion and their derivatives.

    - `times`: (N,) s, those asked for that were reached.
    - `values[name]`: (N,), in the quantity's unit.
    - `derivatives[name]`: (N, p), with respect to the coordinates of the parameters' scales (of a
      `Log` scale: to the logarithm), in the order of `parameters`.
    - `time`, `result`: where the run ended, s, and how, a `RESULTS` code.
    - `attempts`, `accepted`: steps tried and accepted.
    - `saved`: the states at the times to save at; `impacts`: the table of finished contacts; both
      ``None`` unless asked for.
    - `sections[name]`: the `Crossings` of each section asked for.
    """

    parameters: tuple[str, ...]
    times: np.ndarray
    values: dict[str, np.ndarray]
    derivatives: dict[str, np.ndarray]
    time: float
    result: RESULTS
    attempts: int
    accepted: int
    saved: Trajectory | None = None
    impacts: Impacts | None = None
    sections: Mapping[str, Crossings] = field(default_factory=dict)


def sensitivities(
    scene: Scene,
    state: State,
    end_time: float,
    parameters: Mapping[str, Parameter],
    outputs: Mapping[str, Quantity],
    times: ArrayLike,
    settings: Settings | None = None,
    save: Saving | None = None,
    *,
    start_time: float = 0.0,
    throw: bool = True,
) -> Sensitivities:
    """Integrate a scene with the derivatives of its motion along parameters.

    Derivatives are finite at the centred journal, at zero depth, slip and entry speed: there they
    are those of free flight (a contact has depth), of either side of the friction law, and of the
    damping at the law's `entry_speed_floor`. By the position of a journal that touches the wall at
    the start they say nothing: contact at the start counts as elastic, so the motion jumps there.

    **Arguments:**

    - `scene`, `state`, `start_time`, `end_time` s: as in `simulate`; the parameters' values are
      those of the scene.
    - `parameters`: what to differentiate along, by name; see `Parameter`.
    - `outputs`: functions of an `Instant`, such as `clearjoint.quantities`, by name.
    - `times`: (N,) s, rising, at which they are evaluated.
    - `settings`: how to integrate; `clearjoint.presets.derivatives` unless given.
    - `save`: states at times of their own, impacts and sections, to keep beside.
    - `throw`: raise `SimulationError`, with what was reached, if the run fails.

    **Raises:** `ValueError` for arguments that no run can use, and for elements that compare
    something with time but declare no `breakpoints`: derivatives would lack the jumps there;
    `SimulationError` for a run that fails. A force of a class of one's own that jumps where the
    motion decides ends the run there, with `RESULTS.force_jumped`.
    """
    check_outputs(outputs, scene)
    check_parameters(parameters)
    settings = settings_or(settings, presets.derivatives)
    scheme = derivative_scheme(scene, state, settings, start_time)
    check_span(start_time, end_time)
    asked = checked_times(start_time, end_time, times, "times")
    save = saving_or_nothing(save)
    save.require_no_steps("of a run with derivatives", "take simulate() for them")
    save.check(scene)
    saved = save.times_between(start_time, end_time)
    looked_at = asked if saved is None else np.union1d(asked, saved)
    coordinates = jnp.asarray(coordinates_of(scene, state, parameters))
    family = parametrised(scene, state, parameters, coordinates)
    span = (
        jnp.asarray(t, float)
        for t in (start_time, end_time, settings.length_of_first_step(start_time, end_time))
    )
    arguments = (
        scheme,
        family,
        dict(outputs),
        jnp.asarray(padded(looked_at, end_time)),
        *span,
        jnp.asarray(settings.max_steps, int),
    )
    sampled = _recorded(arguments, saved is not None, save.impacts, save.section_recorders())
    rows = _rows_reached(sampled, looked_at, asked)
    result = Sensitivities(
        tuple(parameters),
        asked[: len(rows)],
        {name: values[rows] for name, values in sampled.values.items()},
        {name: values[rows] for name, values in sampled.derivatives.items()},
        float(sampled.time),
        sampled.result,
        int(sampled.attempts),
        int(sampled.accepted),
        None if saved is None else _trajectory(sampled, looked_at, saved),
        None if sampled.impacts is None else impacts_of(sampled.impacts),
        crossings_of(sampled.sections),
    )
    if throw:
        raise_failure(result)
    return result


def _recorded(
    arguments: tuple[PyTree, ...],
    states: bool,
    impacts: bool,
    sections: dict[str, SectionRecorder],
) -> Sampled:
    """What was seen of a run (host arrays), with as much room for impacts as it has of them."""
    room = IMPACTS_AT_FIRST if impacts else None
    while True:
        kept = Kept(states, room, sections)
        sampled: Sampled = jax.device_get(sampled_compiled(*arguments, kept))
        if sampled.impacts is None or room is None or most(sampled.impacts) <= room:
            return sampled
        room *= GROWTH


def _rows_reached(
    sampled: Sampled, looked_at: Float[np.ndarray, " all"], times: Float[np.ndarray, " some"]
) -> Int[np.ndarray, " reached"]:
    """Where among all times that were looked at those of `times` are that the run came to."""
    rows = np.searchsorted(looked_at, times)
    return rows[sampled.reached[rows]]


def _trajectory(
    sampled: Sampled, looked_at: Float[np.ndarray, " all"], times: Float[np.ndarray, " some"]
) -> Trajectory:
    """The states at those of `times` that the run came to."""
    rows = _rows_reached(sampled, looked_at, times)
    states = jax.tree.map(lambda leaf: leaf[rows], sampled.states)
    return Trajectory(times[: len(rows)], pack(states))


def check_outputs(outputs: Mapping[str, Quantity], scene: Scene) -> None:
    """Check that outputs are functions by name, and that the scene has what they name.

    **Raises:** `ValueError` that names the output.
    """
    example = 'pass for example {"x": cj.quantities.Position("arm", "x")}'
    require_names("outputs", outputs, example)
    require(len(outputs) > 0, "outputs", {}, "not empty", example)
    for name, output in outputs.items():
        expected = "a scalar function of an Instant"
        require(callable(output), f"outputs[{name!r}]", output, expected, example)
        check_quantity(f"Output {name!r}", output, scene)


def padded(times: np.ndarray, end_time: float) -> np.ndarray:
    """The times, and the end time, at least once, as often as makes their number one of few."""
    return np.append(times, np.full(few(len(times) + 1) - len(times), float(end_time)))


def few(count: int) -> int:
    """The least of few numbers that is not below a number of times."""
    size = FEW_TIMES
    while size < count:
        size *= GROWTH
    return size
