"""Simulation of a scene from a state: checks, the host's loop over segments, and the outcome."""

from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from ..dynamics.coordinates import AbstractCoordinates
from ..dynamics.formulation import Formulation
from ..dynamics.stabilisation import AbstractStabilisation, Baumgarte
from .landing import Landing
from .solvers import default_controller, ready_solver
from .step_state import Method


def make_formulation(
    coordinates: AbstractCoordinates,
    stabilisation: AbstractStabilisation | None,
    redundant: bool,
    ledger: bool = False,
) -> Formulation:
    """The formulation for the arguments of `simulate`."""
    stabilisation = Baumgarte() if stabilisation is None else stabilisation
    return Formulation(coordinates, stabilisation, redundant, ledger)


def make_method(
    solver: diffrax.AbstractSolver | None,
    controller: diffrax.AbstractStepSizeController | None,
    formulation: Formulation,
    landing_tolerance: Any,
    rtol: Any,
    atol: Any,
) -> Method:
    """The method for the arguments of `simulate`."""
    atol = rtol * 1e-5 if atol is None else atol
    if controller is None:
        controller = default_controller(rtol, atol)
    landing = None if landing_tolerance is None else Landing(landing_tolerance)
    solver = ready_solver(diffrax.Tsit5() if solver is None else solver, rtol, atol)
    return _with_arrays(Method(solver, controller, formulation, landing))


def _with_arrays(method: Method) -> Method:
    """The method with its floats as arrays, so that changing one compiles nothing anew. Zeros stay:
    they tell the controller which terms to leave out."""
    return jax.tree.map(
        lambda leaf: jnp.asarray(leaf) if isinstance(leaf, float) and leaf != 0.0 else _kept(leaf),
        method,
    )


def _kept(leaf: Any) -> Any:
    return jnp.asarray(leaf) if isinstance(leaf, np.ndarray) else leaf
