"""Simulation of a scene from an initial state: checks, the run, and warnings."""

from typing import Any

import diffrax
import equinox as eqx
import numpy as np

from ...dynamics.journals import warn_of_journals_outside
from ...export.provenance import setting_notes
from ...fields.cautions import LawRangeWarning, caution
from ...fields.checks import require
from ...fields.conversion import on_device, with_arrays
from ...math.vectors import Scalar, fold_constants
from ...model.bodies import State
from ...model.scene import Scene
from ...native import Native
from ...result_codes import RESULTS
from ..results.law_ranges import beyond_law_ranges
from ..results.solution import Solution, raise_failure
from ..step import presets
from ..step.dense_output import require_dense
from ..step.loops import loops_for
from ..step.method import Scheme
from ..step.settings import Settings, settings_or
from ..step.spans import check_span
from ..step.types import Numbers
from .host_run import Run
from .interruptions import RunInterrupted
from .run_checks import check_numbers, check_precision, check_start, in_domain, is_traced
from .saving import Saving, saving_or_nothing
from .segments import begin

STEP_ROWS, IMPACT_ROWS = 4096, 64
"""Rows of the buffers of accepted steps, and of the impacts of each contact. A run goes back to its
host when one is full."""
LEAVE_OUT = "leave it out, or call simulate() outside of the transformation"


def simulate(
    scene: Scene,
    state: State,
    end_time: Scalar,
    settings: Settings | None = None,
    save: Saving | None = None,
    *,
    start_time: Scalar = 0.0,
    adjoint: diffrax.RecursiveCheckpointAdjoint | None = None,
    throw: bool = True,
    progress: bool = True,
) -> Solution:
    """Integrate the equations of motion of a scene.

    The program is compiled once for each structure of the scene and each method. Changing values
    does not recompile it, unless a vector component changes to or from exactly 0 or 1 (those are
    folded as constants).

    The function works under `jax.vmap` and `jax.jvp`, and with an `adjoint` under `jax.grad` and
    `jax.vjp`. Put `jax.jit` around the outermost transformation, or each call compiles anew. A
    traced run raises no error. A value that would raise one otherwise, such as a clearance that is
    NaN, ends it before the first step with the result `domain`.

    Derivatives by these transformations are those of the computed steps, not of the motion. Their
    error is far above that of the states and falls slowly with the tolerance. Use
    `clearjoint.presets.derivatives` for them, or better `clearjoint.sensitivities`.

    **Arguments:**

    - `scene`, `state`: the mechanism and its initial state. The state must satisfy the constraints
      (see `assemble`). Its entry speeds, bristles and energy ledger are continued.
    - `end_time`, `start_time`: s.
    - `settings`: how to integrate; `clearjoint.presets.default` unless given.
    - `save`: results to keep besides the final state: states at given times, every step, impacts,
      sections (crossings in `solution.sections`), and reductions such as `Peak` (results in
      `solution.outputs`). Under a transformation, only states at given times.
    - `adjoint`: `diffrax.RecursiveCheckpointAdjoint()` for reverse-mode differentiation; forward
      mode is then unavailable. `checkpoints` is the number of states that are stored; the steps
      between them are computed again. The default of 300 was fastest up to 36 000 steps. Any
      number works for any run, and results without differentiation do not depend on it.
    - `throw`: raise `SimulationError` if the run fails, instead of returning its result code.
    - `progress`: show a progress bar for runs that take longer than two seconds, and while
      compiling.

    **Returns:** a `Solution`.

    **Raises:** `SimulationError` if the run fails; `RunInterrupted`, a `KeyboardInterrupt` with the
    solution so far, if a user stops it.

    **Warns:** `LeftBearingWarning` if a journal without axial support has slid out of its bearing
    in a saved state or at the end; `LawRangeWarning` if impacts are saved and one is deeper than
    the range of its law (`beyond_law_ranges`); `UnusualValueWarning` for a journal that starts deep
    in the wall of its bearing.

    >>> spring = cj.SpringDamper("ground", "ball", (0, 0, 0), (0, 0, 0), stiffness=100.0)
    >>> scene = cj.Scene({"ball": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}, forces={"spring": spring})
    >>> state = cj.State({"ball": cj.body_state((0.1, 0, 0))})  # 0.1 cos(10 t)
    >>> solution = cj.simulate(scene, state, 0.1 * np.pi, progress=False)
    >>> print(f"{solution.final.bodies['ball'].position[0]:.4f} m")
    -0.1000 m
    """
    settings, save = settings_or(settings, presets.default), saving_or_nothing(save)
    check_precision(settings.allow_float32)
    _check_adjoint(adjoint)
    scene, state = with_arrays((scene, state))
    traced = is_traced((scene, state, end_time, start_time, settings.numbers))
    redundant: tuple[str, ...] = ()
    times: Numbers | None = save.times
    admissible = None
    if traced:
        # Values are unknown while JAX traces: their checks become a condition of the program.
        save.require_times_alone("under a transformation of JAX", LEAVE_OUT)
        admissible = in_domain(
            lambda: _check_numbers(scene, state, start_time, end_time, settings, save)
        )
    else:
        check_span(start_time, end_time)
        times = save.times_between(start_time, end_time)
        redundant = check_start(scene, state, start_time, settings.coordinates)
        save.check(scene, settings.ledger)
    folded_scene = fold_constants(scene)
    scheme = (Scheme.of if traced else Scheme.on_host)(settings, bool(redundant))
    first_step = settings.length_of_first_step(start_time, end_time)
    span = start_time, end_time, first_step
    start, end, length = (_array(number, traced) for number in span)
    if save.sections or save.outputs:
        require_dense(scheme.method.solver)
    rows = STEP_ROWS if save.steps else None, IMPACT_ROWS if save.impacts else None
    saves, kept = times is not None, (save.section_recorders(), dict(save.outputs))
    now = begin_compiled(scheme, folded_scene, state, start, end, length, saves, *rows, *kept)
    run = Run(folded_scene, scheme, end, redundant)
    if traced:
        if admissible is not None:
            result = RESULTS.where(admissible, now.step.result, RESULTS.domain)
            now = eqx.tree_at(lambda progress: progress.step.result, now, result)
        save_at = None if times is None else on_device(times)
        return run.in_one_piece(now, save_at, settings.max_steps, loops_for(adjoint))
    solution, interrupted, left_bearing = run.on_host(
        now, times, settings.max_steps, progress, save.sections, setting_notes(settings)
    )
    _warn(scene, solution, left_bearing)
    if interrupted:
        raise RunInterrupted(solution)
    if throw:
        raise_failure(solution)
    return solution


begin_compiled = Native(begin)


def _array(number: Numbers, traced: bool) -> Any:
    """Return the number as an array of NumPy, which costs the host less, or of JAX if traced."""
    return on_device(number) if traced else np.asarray(number, float)


def _check_numbers(
    scene: Scene,
    state: State,
    start_time: Scalar,
    end_time: Scalar,
    settings: Settings,
    save: Saving,
) -> None:
    """Check every number of a run, but not whether the state satisfies the constraints."""
    check_numbers(scene, state)
    check_span(start_time, end_time)
    settings.check_numbers()
    save.times_between(start_time, end_time)


def _warn(scene: Scene, solution: Solution, left_bearing: bool) -> None:
    """Warn of journals outside their bearings in saved states, and of laws beyond their range."""
    kept = [(k.times, k.states) for k in (solution.steps, solution.saved) if k is not None]
    if kept or left_bearing:
        warn_of_journals_outside(scene, solution.time, solution.final, kept)
    if solution.impacts is not None:
        for sentence in beyond_law_ranges(scene, solution.impacts):
            caution(sentence, LawRangeWarning)


def _check_adjoint(adjoint: object) -> None:
    require(
        adjoint is None or isinstance(adjoint, diffrax.RecursiveCheckpointAdjoint),
        "adjoint",
        adjoint,
        "a diffrax.RecursiveCheckpointAdjoint or None",
        "pass diffrax.RecursiveCheckpointAdjoint() for jax.grad, and None for jax.jvp",
    )
