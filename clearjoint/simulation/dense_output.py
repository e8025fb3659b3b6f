"""What a run is like inside a step, and on the constraints."""

from typing import Any

import diffrax
import jax.numpy as jnp

from ..dynamics.system import System
from ..fields.checks import require
from ..math.vectors import Scalar
from .step_state import Attempt, Method, Variables, choose
from .unrolled_runge_kutta import UnrolledExplicit, place_in_step


def look_inside(method: Method, system: System, tried: Attempt, t: Scalar) -> tuple[Any, Any]:
    """Variables and memory at an instant of an accepted step, by the solver's dense output.

    The memory is that of the step's start: what the step's end changes holds from there on.
    """
    end = tried.step.t
    dense = method.solver.interpolation_cls(t0=tried.t_start, t1=end, **tried.information)
    y = choose(t >= end, tried.step.y, dense.evaluate(dense_time(tried, t)))
    return on_constraints(system, y, t), choose(t >= end, tried.step.memory, tried.memory_start)


def dense_time(tried: Attempt, t: Scalar) -> Scalar:
    """The time at which the dense output of a graded step has what belongs to t."""
    if tried.graded is None:
        return t
    h = tried.step.t - tried.t_start
    x = (t - tried.t_start) / jnp.where(h > 0.0, h, 1.0)
    return tried.t_start + h * place_in_step(x, tried.graded)


def corrected(system: System, y: Variables, t: Scalar) -> Variables:
    """The variables as the stabilisation wants them at the end of a step; what a projection takes
    is booked in the ledger."""
    return system.formulation.stabilisation.corrected(y, lambda y: _projected(system, y, t))


def on_constraints(system: System, y: Variables, t: Scalar) -> Variables:
    """The variables as they are saved inside a step: corrected too, but nothing is booked."""
    return Variables(corrected(system, y, t).motion, y.work)


def _projected(system: System, y: Variables, t: Scalar) -> Variables:
    motion, work = system.project(y.motion, t), y.work
    if system.formulation.ledger and "stabilisation" in work:
        taken = _energy(system, y.motion, t) - _energy(system, motion, t)
        work = {**work, "stabilisation": work["stabilisation"] + taken}
    return Variables(motion, work)


def _energy(system: System, motion: Any, t: Scalar) -> Scalar:
    return sum(system.energies(motion, t).values())


def require_dense(solver: diffrax.AbstractSolver) -> None:
    """Check that a solver's dense output is known in scalar form."""
    require(
        isinstance(solver, UnrolledExplicit),
        "solver",
        type(solver).__name__,
        "an explicit Runge-Kutta method where sweeps look inside steps (saved states, sections, "
        "peaks, statistics, impacts), or a run has derivatives",
        "take one such as diffrax.Tsit5(), or leave these outputs out",
    )
