"""Segments of a run: compiled functions that take a number of steps and return to Python.

A segment ends at the end time, after the last time to save at, after a number of attempts, at a
failure, or when a buffer of recorded rows is full. Python then empties the buffers, shows progress
and starts the next segment.

Scene and states are passed in packed form, in which each vector is an array (3,).
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from ...math.vectors import Condition, ConstantFolded, Scalar
from ...model.bodies import State
from ..step.dense_output import look_inside
from ..step.loops import PLAIN, Loops
from ..step.method import Scheme
from ..step.types import Numbers
from .impact_recorder import ImpactRecorder
from .recorders import ROWS, LatestAttempt, ReductionRecorder, RowBuffer, StepRecorder
from .run_loop import Progress, Recorders, RunLoop, begin_run, named, state_of
from .saving import Saving

STEP_ROWS, IMPACT_ROWS = 4096, ROWS
"""Rows of the buffer of accepted steps, and of the buffer of each contact's impacts. When a buffer
is full, compiled code returns to Python, which empties all buffers. That of steps is the larger
one, because every accepted step writes a row. Their sizes are part of the compiled program."""
LATEST, STEPS, IMPACTS = "latest", "steps", "impacts"
SECTIONS, REDUCTIONS = "sections", "reductions"
"""Keys of the dictionaries of recorders and of records. `LATEST` is the latest accepted attempt,
`STEPS` the states after accepted steps. The values at `SECTIONS` and `REDUCTIONS` are dictionaries
by the name of the output."""


def recorders_of(save: Saving) -> Recorders:
    """Return the recorders of a single run for the results to `save`, in a dictionary with the keys
    above."""
    recorders: dict[str, Recorders] = {
        SECTIONS: save.section_recorders(),
        REDUCTIONS: {name: ReductionRecorder(of) for name, of in save.outputs.items()},
    }
    if save.times is not None:
        recorders[LATEST] = LatestAttempt()
    if save.steps:
        recorders[STEPS] = StepRecorder(STEP_ROWS)
    if save.impacts:
        recorders[IMPACTS] = ImpactRecorder(capacity=IMPACT_ROWS)
    return recorders


class SavedStates(eqx.Module):
    """States at N times to save at.

    - `states`: the states, whose leaves have an additional first axis of length N; each vector is
      three separate arrays.
    - `reached`: (N,), whether the run has reached each time.
    """

    states: State
    reached: jax.Array


def begin(
    scheme: Scheme,
    folded_scene: ConstantFolded,
    state: State,
    t0: Scalar,
    t_end: Scalar,
    first_step: Scalar,
    recorders: Recorders,
) -> Progress:
    """Return a run before its first step, with which the first segment begins.

    **Arguments:**

    - `scheme`: integration method and formulation of the equations of motion.
    - `folded_scene`, `state`: scene and initial state, in packed form.
    - `t0`, `t_end`, `first_step`: s, start, end and length of the first step, as arrays.
    - `recorders`: recorders in nested dictionaries, as `recorders_of` returns.
    """
    method, system = scheme.method, scheme.unpacked(folded_scene)
    step = begin_run(method, system, state, t0, t_end, first_step)
    now = RunLoop(method, system, t_end, recorders).start(step)
    # The result of a loop has no weak types. If this result had some, the second segment would be
    # compiled again.
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=jnp.result_type(leaf)), now)


def segment(
    scheme: Scheme,
    folded_scene: ConstantFolded,
    recorders: Recorders,
    now: Progress,
    save_times: Numbers | None,
    t_end: Scalar,
    attempts: Scalar,
    loops: Loops = PLAIN,
) -> tuple[Progress, SavedStates | None]:
    """Continue a run until its end, a failure, the limit of attempts, a full buffer, or the last
    time to save at, whichever comes first.

    **Arguments:** `now`: the run so far; `save_times`: (N,) s, not decreasing, times to save at, or
    ``None``; `t_end`: s, end of the run; `attempts`: largest number of attempts since the start of
    the run; `loops`: JAX's loops, or loops with checkpoints for reverse-mode differentiation; the
    others as in `begin`.

    **Returns:** the run after the segment, and the states at the N times, or ``None`` without
    times. At times that the run did not reach, its last state is repeated.
    """
    method, system = scheme.method, scheme.unpacked(folded_scene)
    loop = RunLoop(method, system, t_end, recorders, loops=loops, attempt=loops.attempt)
    if save_times is None:
        return loop.until(t_end, now, attempts, _has_room), None

    def save_next(now: Progress, time: Scalar) -> tuple[Progress, SavedStates]:
        # Steps are not shortened to end at the save time, because saving must not change the
        # motion. The state there is interpolated.
        now = loop.until(time, now, attempts, _has_room)
        state = state_of(system, *look_inside(method, system, now.records[LATEST], time))
        return now, SavedStates(named(state), jnp.asarray(time <= now.step.t))

    return loops.each(save_next, now, save_times)


def emptied(now: Progress) -> Progress:
    """Return the run `now` with empty buffers of steps and impacts, to be called after Python has
    read their rows."""
    read = {key: now.records[key] for key in (STEPS, IMPACTS) if key in now.records}
    empty = jax.tree.map(
        lambda part: part.emptied() if _is_buffer(part) else part, read, is_leaf=_is_buffer
    )
    return Progress(now.step, now.records | empty)


def _has_room(now: Progress) -> Condition:
    """Return whether no buffer of steps or impacts is full."""
    room: Condition = jnp.asarray(True)
    buffers = [now.records.get(key) for key in (STEPS, IMPACTS)]
    for part in jax.tree.leaves(buffers, is_leaf=_is_buffer):
        if isinstance(part, RowBuffer):
            room = room & jnp.logical_not(part.is_full())
    return room


def _is_buffer(tree: object) -> bool:
    """Return whether an object is a `RowBuffer`, at which JAX's tree functions stop."""
    return isinstance(tree, RowBuffer)
