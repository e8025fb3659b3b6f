"""Simulation of a scene from a state: checks, the host's loop over segments, and the outcome."""

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp

from ..dynamics.coordinates import AbstractCoordinates
from ..dynamics.joint_coordinates.coordinates import JointCoordinates
from ..dynamics.journals import warn_of_journals_outside
from ..dynamics.stabilisation import AbstractStabilisation
from ..fields.checks import concrete, require, require_count
from ..math.vectors import structured
from ..model.bodies import State
from ..model.scene import Scene
from ..results import RESULTS
from .adjoint import loops_for
from .host_run import HostLoop, OnePiece
from .impact_table import ImpactCollector
from .method import make_formulation, make_scheme
from .run_checks import check_precision, check_structure, check_values
from .run_ends import default_first_step
from .segments import begin
from .solution import SimulationError, Solution
from .spans import check_span, checked_times

RECORD_ROWS = 16_384


def simulate(
    scene: Scene,
    state: State,
    end_time: Any,
    *,
    save_at: Any = None,
    start_time: Any = 0.0,
    rtol: Any = 1e-6,
    atol: Any = None,
    solver: diffrax.AbstractSolver | None = None,
    controller: diffrax.AbstractStepSizeController | None = None,
    first_step: Any = None,
    coordinates: AbstractCoordinates | None = None,
    stabilisation: AbstractStabilisation | None = None,
    landing_tolerance: Any = 1e-12,
    ledger: bool = False,
    record_steps: bool = False,
    record_impacts: bool = False,
    max_steps: int = 10_000_000,
    redundant: bool | None = None,
    throw: bool = True,
    progress: bool = True,
    allow_float32: bool = False,
    adjoint: diffrax.RecursiveCheckpointAdjoint | None = None,
) -> Solution:
    """Integrate the equations of motion of a scene.

    Compiled once for each structure of the scene and choice of method: no change of a number
    compiles anew, unless a component of a vector becomes zero or one or ceases to be. Works under
    `jax.vmap` and `jax.jvp`, and with an `adjoint` under `jax.grad` and `jax.vjp`; then it raises
    no error, records neither steps nor impacts, and runs in one piece. Put `jax.jit` around the
    outermost of them, or each call compiles anew. `clearjoint.presets` names three settings, and
    what each gives and costs.

    These derivatives are those of the computed steps, not of the motion: their error is far above
    that of the states (measured by `studies.benchmark`). Take rtol 1e-9 and a landing tolerance of
    1e-13.

    **Arguments:**

    - `scene`, `state`: what moves, and from where. The state must satisfy the constraints (see
      `assemble`). Memory and ledger in it are continued.
    - `end_time`, `start_time`: s.
    - `save_at`: (N,) s, rising times between them at which to save the state. Dense output gives
      them; they do not change the steps.
    - `rtol`, `atol`: tolerances of the error of a step, relative and absolute (in SI units of each
      state; a hundred-thousandth of `rtol` unless given, since impacts amplify small
      misalignments; where nothing moves faster than 1e4 of these, give a smaller one).
      `controller` replaces them by a diffrax controller.
    - `solver`: any diffrax ODE solver; `diffrax.Tsit5()` unless given. Implicit ones want a
      looser `atol`, such as `rtol`/1000, to which they also solve their stages.
    - `first_step`: s; a millionth of the duration unless given.
    - `coordinates`: `JointCoordinates()`, which are faster, unless given; or
      `AbsoluteCoordinates()`, in which every ideal joint is a constraint, as in the paper.
    - `stabilisation`: `Baumgarte(5, 5)` unless given, `Projection()`, or `Unstabilised()`.
    - `landing_tolerance`: m, penetration within which steps land on the begin and end of contacts;
      ``None`` steps across them.
    - `ledger`: integrate the dissipated energies with the state.
    - `record_steps`, `record_impacts`: keep every accepted step; table all finished contacts.
    - `max_steps`: largest number of steps tried.
    - `redundant`: whether constraints depend on each other; found out unless given (under a
      transformation: taken as independent).
    - `throw`: raise `SimulationError` if the run fails, instead of returning its result code.
    - `progress`: show a bar on runs that take longer than two seconds.
    - `allow_float32`: run in single precision if JAX is set to it.
    - `adjoint`: `diffrax.RecursiveCheckpointAdjoint()` for reverse-mode differentiation; forward
      mode is then shut. The state after some steps is kept, and what lies between computed anew.
      Its `checkpoints` say how many are kept at once; 300 unless given, which was fastest up to
      36 000 steps. Any number serves any run. Nothing changes where nothing is differentiated.

    **Returns:** a `Solution`.

    **Warns:** `LeftBearingWarning` if a journal that nothing holds axially has slid out of its
    bearing in a state that the run keeps, and when; `UnusualValueWarning` for a start far in the
    wall of a bearing.

    **Raises:** `ValueError` for arguments that no run can use; `SimulationError`, which carries the
    solution so far, for a run that fails.
    """
    check_precision(allow_float32)
    require_count("max_steps", max_steps, "give a number of steps")
    _check_adjoint(adjoint)
    traced = _is_traced((scene, state, end_time, start_time))
    coordinates = JointCoordinates() if coordinates is None else coordinates
    names: tuple[str, ...] = ()
    if not traced:
        check_span(start_time, end_time)
        if save_at is not None:
            save_at = checked_times(start_time, end_time, save_at, "save_at")
        check_values(scene, state, rtol, atol, first_step, landing_tolerance)
        names = check_structure(scene, state, start_time, coordinates)
    if redundant is None:
        redundant = bool(names)
    formulation = make_formulation(coordinates, stabilisation, redundant, ledger)
    scheme = make_scheme(solver, controller, formulation, landing_tolerance, rtol, atol)
    if first_step is None:
        first_step = default_first_step(start_time, end_time)
    record = (record_steps or record_impacts) and not traced
    form = structured(scene)
    now = begin_compiled(
        scheme,
        form,
        state,
        _array(start_time),
        _array(end_time),
        _array(first_step),
        save_at is not None,
        RECORD_ROWS if record else None,
    )
    if traced:
        run = OnePiece(form, scheme, _array(end_time), names)
        return run.solution(now, _array(save_at), max_steps, loops_for(adjoint))
    host = HostLoop(form, scheme, _array(end_time), names)
    collector = ImpactCollector(form, formulation) if record_impacts else None
    solution = host.solution(now, save_at, max_steps, collector, record_steps, progress)
    kept = [(k.times, k.states) for k in (solution.steps, solution.saved) if k is not None]
    warn_of_journals_outside(scene, solution.time, solution.final, kept)
    if throw and solution.result != RESULTS.successful:
        raise SimulationError(
            f"The run ended at t = {float(solution.time):.9g} s: {RESULTS[solution.result]}",
            solution,
        )
    return solution


begin_compiled = eqx.filter_jit(begin)


def _check_adjoint(adjoint: Any) -> None:
    require(
        adjoint is None or isinstance(adjoint, diffrax.RecursiveCheckpointAdjoint),
        "adjoint",
        adjoint,
        "a diffrax.RecursiveCheckpointAdjoint or None",
        "pass diffrax.RecursiveCheckpointAdjoint() for jax.grad, and None for jax.jvp",
    )


def _is_traced(tree: Any) -> bool:
    """Whether JAX traces any of these, or everything: under `jax.jit` numbers need not be traced
    for what is computed from them to be."""
    return concrete(jnp.zeros(())) is None or any(
        concrete(leaf) is None for leaf in jax.tree.leaves(tree)
    )


def _array(value: Any) -> Any:
    return None if value is None else jnp.asarray(value, dtype=float)
