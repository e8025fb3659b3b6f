"""What a run is like inside a step, and on the constraints."""

from typing import Any

import diffrax
import jax.numpy as jnp

from ..dynamics.energy import mechanical_energy
from ..dynamics.formulation import Formulation
from ..dynamics.projection import project_positions, project_velocities
from ..dynamics.stabilisation import Projection
from ..fields.checks import require
from ..math.vectors import Scalar
from ..model.scene import Scene
from .step_state import Attempt, Method, Variables, choose
from .unrolled_runge_kutta import UnrolledExplicit, place_in_step


def look_inside(method: Method, scene: Scene, tried: Attempt, t: Scalar) -> tuple[Any, Any]:
    """Variables and memory at an instant of an accepted step, by the solver's dense output.

    The memory is that of the step's start: what the step's end changes holds from there on.
    """
    end = tried.step.t
    dense = method.solver.interpolation_cls(t0=tried.t_start, t1=end, **tried.information)
    y = choose(t >= end, tried.step.y, dense.evaluate(dense_time(tried, t)))
    if isinstance(method.formulation.stabilisation, Projection):
        y = Variables(projected(scene, method.formulation, y, t).motion, y.work)
    return y, choose(t >= end, tried.step.memory, tried.memory_start)


def dense_time(tried: Attempt, t: Scalar) -> Scalar:
    """The time at which the dense output of a graded step has what belongs to t."""
    if tried.graded is None:
        return t
    h = tried.step.t - tried.t_start
    x = (t - tried.t_start) / jnp.where(h > 0.0, h, 1.0)
    return tried.t_start + h * place_in_step(x, tried.graded)


def projected(scene: Scene, formulation: Formulation, y: Variables, t: Scalar) -> Variables:
    """The variables on the constraints; what the projection takes is booked in the ledger."""
    motion = project_velocities(
        scene, formulation, project_positions(scene, formulation, y.motion, t), t
    )
    work = y.work
    if formulation.ledger and "stabilisation" in work:
        taken = _energy(scene, formulation, y.motion, t) - _energy(scene, formulation, motion, t)
        work = {**work, "stabilisation": work["stabilisation"] + taken}
    return Variables(motion, work)


def _energy(scene: Scene, formulation: Formulation, variables: Any, t: Scalar) -> Scalar:
    motions = formulation.coordinates.motions(scene, variables)
    return sum(mechanical_energy(scene, motions, t).values())


def require_dense(solver: diffrax.AbstractSolver) -> None:
    """Check that a solver's dense output is known in scalar form."""
    require(
        isinstance(solver, UnrolledExplicit),
        "solver",
        type(solver).__name__,
        "an explicit Runge-Kutta method where sweeps save states, sections or statistics, or a run "
        "has derivatives",
        "take one such as diffrax.Tsit5(), or leave these outputs out",
    )
