"""Preparation of diffrax solvers and step-size controllers for the stepping loop."""

from functools import reduce

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from ...fields.checks import require
from ...math.vectors import Scalar
from .unrolled_runge_kutta import unrolled


def largest_component(tree: PyTree[Scalar]) -> jax.Array:
    """Return the largest absolute value of all leaves of a PyTree, (), as norm of an error.

    A mean norm would dilute the error of one impact among the bodies without contact.
    """
    # Leaves of one shape are compared elementwise before their maxima are taken. Nothing is
    # gathered into an array, which would keep the loop from becoming one native function.
    largest: dict[tuple[int, ...], Scalar] = {}
    for leaf in jax.tree.leaves(tree):
        shape = jnp.shape(leaf)
        largest[shape] = jnp.maximum(largest.get(shape, 0.0), jnp.abs(leaf))
    return reduce(jnp.maximum, [jnp.max(leaf) for leaf in largest.values()])


def default_controller(rtol: float, atol: float) -> diffrax.PIDController:
    """Return diffrax's PID controller with `largest_component` as norm, so that the tolerances hold
    for each variable."""
    return diffrax.PIDController(rtol=rtol, atol=atol, norm=largest_component)


def require_ordinary(solver: diffrax.AbstractSolver) -> None:
    """Check that a solver takes ordinary differential equations without splitting.

    **Raises:** `ValueError` that names the solver's class.
    """
    structure = solver.term_structure
    require(
        isinstance(structure, type) and issubclass(diffrax.ODETerm, structure),
        "solver",
        type(solver).__name__,
        "a solver of ordinary differential equations without splitting",
        "take one such as diffrax.Tsit5(), Dopri8() or Kvaerno5()",
    )


def ready_solver(
    solver: diffrax.AbstractSolver, rtol: float, atol: float
) -> diffrax.AbstractSolver:
    """Return a solver ready for single steps, as `diffrax.diffeqsolve` would prepare it.

    Explicit Runge-Kutta methods become `UnrolledExplicit`. Other Runge-Kutta methods loop over
    their stages by `lax.scan`, so that forward differentiation can follow. Implicit methods iterate
    their stages to `rtol` and `atol` (SI units), unless their root finder has tolerances of its
    own.
    """
    solver = unrolled(solver)
    if isinstance(solver, diffrax.AbstractRungeKutta) and solver.scan_kind is None:
        solver = eqx.tree_at(
            lambda s: s.scan_kind, solver, "lax", is_leaf=lambda leaf: leaf is None
        )
    if isinstance(solver, diffrax.AbstractImplicitSolver) and not _has_tolerances(solver):
        finder = diffrax.VeryChord(rtol, atol, largest_component)
        solver = eqx.tree_at(lambda s: s.root_finder, solver, finder)
    return solver


def _has_tolerances(solver: diffrax.AbstractImplicitSolver) -> bool:
    """Whether the root finder has numbers as tolerances. Its default is a marker, which only
    `diffrax.diffeqsolve` replaces by the tolerances of the controller."""
    rtol = getattr(solver.root_finder, "rtol", None)
    return isinstance(rtol, int | float | jax.Array)
