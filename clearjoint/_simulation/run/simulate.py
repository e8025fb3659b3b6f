"""Simulation of a scene from an initial state: the function `simulate`."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..._compilation.xla import one_call
from ..._dynamics.journals import overdamped_contacts, warn_of_journals_outside
from ..._export.datasets import setting_notes
from ..._fields.cautions import LawRangeWarning, caution
from ..._fields.objects import on_device
from ..._math.vectors import Scalar
from ..._model.bodies import State
from ..._model.scene import Scene
from ..._native import Native
from ..._native.functions import folded
from ..._result_codes import RESULTS, result_number
from ..results.impact_table import beyond_law_ranges
from ..results.solution import Solution, raise_failure
from ..step import presets
from ..step.dense_output import require_dense
from ..step.method import Scheme
from ..step.settings import Settings, check_span, settings_or
from ..step.types import Numbers
from . import run_checks
from .host_run import Run, begin, recorders_of
from .outputs import RECORDED, Output, requested_by
from .saving import EXCEPT_TIMES, Saving
from .terminal import RunInterrupted

SHORT_STEPS = RESULTS.max_steps_reached, RESULTS.step_too_small
"""Result codes of runs that may have failed because contacts made the equations stiff."""
UNDER_JAX = "under a transformation of JAX"
LEAVE_OUT = "leave it out, or call simulate() outside of the transformation"


def simulate(
    scene: Scene,
    state: State,
    end_time: Scalar,
    settings: Settings | None = None,
    save: Saving | None = None,
    *,
    outputs: Mapping[str, Output] | None = None,
    start_time: Scalar = 0.0,
    throw: bool = True,
    progress: bool = True,
) -> Solution:
    """Integrate the equations of motion of a scene.

    The program is compiled once for each structure of the scene and each integration method. Scenes
    with other numbers use it too, unless a vector component changes to or from exactly 0 or 1.

    The function works under `jax.vmap` and `jax.jvp`, not under `jax.grad` and `jax.vjp`. Put
    `jax.jit` around the outermost transformation, or each call compiles anew. A traced number that
    is invalid, such as a clearance that is NaN, raises no error: the run ends before its first step
    with the result `RESULTS.domain`. A traced run does not check the state against the constraints.

    Derivatives by `jax.jvp` are derivatives of the computed steps, not of the exact motion. Their
    error is far above the error of the states, and falls slowly with the tolerance. Prefer
    `clearjoint.sensitivities`, or `clearjoint.predictor`, which works under `jax.grad`.

    **Arguments:**

    - `scene`: the mechanism.
    - `state`: its initial state, which must satisfy the constraints (see `assemble`). The run also
      continues from the entry speeds, bristle deflections, memories and energy ledger in the state,
      if there are any (see `State`).
    - `end_time`, `start_time`: s; the end must be after the start.
    - `settings`: tolerances, solver and coordinates; `clearjoint.presets.default` unless given.
    - `save`: what to save besides the final state: states at given times or after every step, and
      the impacts. Under a transformation of JAX, only states at given times can be saved.
    - `outputs`: further results by name, in `solution.outputs`: reductions such as `Peak`, which
      are updated at every accepted step, a `Section`, an `ImpactTable`, `RejectedSteps`, and
      quantities such as `quantities.Position`, which are evaluated at the times of `save`. Under a
      transformation of JAX, only quantities.
    - `throw`: whether a run that fails raises `SimulationError`. If false, and always if JAX traces
      the run, a failed run returns a `Solution`, whose `result` is the code of the failure.
    - `progress`: show a progress bar for runs of more than two seconds, and while compiling.

    **Returns:** a `Solution`.

    **Raises:** `ValueError` for invalid arguments; `SimulationError` if the run fails and `throw`
    is true; `RunInterrupted`, a `KeyboardInterrupt` with the solution so far, after Ctrl-C.

    **Warns:** `LeftBearingWarning` if a journal without axial support has slid out of its bearing
    in a saved state or at the end; `LawRangeWarning` if impacts are saved, and one of them was
    deeper than the range of its law (see `beyond_law_ranges`); `UnusualValueWarning` for a journal
    that starts deep in the wall of its bearing.

    >>> spring = cj.SpringDamper("ground", "ball", (0, 0, 0), (0, 0, 0), stiffness=100.0)
    >>> scene = cj.Scene({"ball": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}, forces={"spring": spring})
    >>> state = cj.State({"ball": cj.body_state((0.1, 0, 0))})  # 0.1 cos(10 t)
    >>> solution = cj.simulate(scene, state, 0.1 * np.pi, progress=False)
    >>> print(f"{solution.final.bodies['ball'].position[0]:.4f} m")
    -0.1000 m
    """
    settings, requested = settings_or(settings, presets.default), requested_by(outputs, save)
    requested.check_names()
    save = requested.save
    run_checks.check_precision(settings.allow_float32)
    # 1. Checks of the arguments.
    flat = run_checks.flattened_arrays(scene, state)
    scene, state = flat.arguments
    traced = flat.traced or run_checks.is_traced((end_time, start_time, settings.numbers))

    def check_all_numbers() -> None:
        run_checks.check_numbers(scene, state)
        check_span(start_time, end_time)
        settings.check_numbers()
        save.times_between(scene, start_time, end_time)

    if traced:
        # Values are unknown while JAX traces: their checks become a condition of the program.
        save.require_none(EXCEPT_TIMES, UNDER_JAX, LEAVE_OUT)
        requested.refuse(RECORDED, f"a quantity {UNDER_JAX}", LEAVE_OUT)
        times, admissible = save.at(scene), run_checks.in_domain(check_all_numbers)
        redundant = ()
    else:
        admissible = None
        check_span(start_time, end_time)
        times = save.times_between(scene, start_time, end_time)
        redundant = run_checks.check_start(scene, state, start_time, settings.coordinates, flat)
    requested.check(scene, settings.ledger)
    # 2. The run before its first step. Vector components that are exactly 0 or 1 are constants of
    # the compiled program.
    folded_scene = folded(flat.parts[0])
    # Without tracers, the scheme is made of NumPy arrays and kept for equal settings, which saves
    # most of the time of a call. With redundant constraints, the equations of motion are solved by
    # another method.
    scheme = (Scheme.of if traced else Scheme.on_host)(settings, bool(redundant))
    first_step = settings.length_of_first_step(start_time, end_time)

    def array(number: Numbers) -> Any:
        # NumPy arrays are made faster, but cannot hold tracers.
        return on_device(number) if traced else np.asarray(number, float)

    start, end, length = map(array, (start_time, end_time, first_step))
    if requested.sections or requested.reductions:
        require_dense(scheme.method.solver)
    recorders = recorders_of(requested)
    beginning = scheme, folded_scene, flat.parts[1], start, end, length, recorders
    with one_call():
        step, records, status = begin_compiled.in_parts(*beginning)
        # 3. The steps, in one piece if JAX traces the run, otherwise in segments.
        save_at = on_device(times) if traced and times is not None else times
        run = Run(
            folded_scene, scheme, requested, recorders, end, save_at, settings.max_steps, redundant
        )
        if traced:
            return run.in_one_piece(step.tree, records.tree, admissible)
        rest = records.tree, status.tree, progress, setting_notes(vars(settings))
        solution, interrupted, left_bearing = run.on_host(step, *rest)
    _warn(scene, solution, left_bearing)
    if interrupted:
        raise RunInterrupted(solution)
    if throw:
        # If steps became too short, the error names contacts whose damping may be the cause.
        is_short = result_number(solution.result) in map(result_number, SHORT_STEPS)
        final = solution.final, solution.time
        raise_failure(solution, causes=overdamped_contacts(scene, *final) if is_short else [])
    return solution


begin_compiled = Native(begin)


def _warn(scene: Scene, solution: Solution, left_bearing: bool) -> None:
    rows = [(t.times, t.states) for t in (solution.steps, solution.saved) if t is not None]
    if rows or left_bearing:
        warn_of_journals_outside(scene, solution.time, solution.final, rows)
    if solution.impacts is not None:
        for sentence in beyond_law_ranges(scene, solution.impacts):
            caution(sentence, LawRangeWarning)
