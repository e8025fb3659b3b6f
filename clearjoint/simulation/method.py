"""How a run is computed: solver, controller and landing, with the formulation of its equations."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..dynamics.coordinates import AbstractCoordinates
from ..dynamics.formulation import Formulation
from ..dynamics.stabilisation import AbstractStabilisation, Baumgarte
from ..dynamics.system import System
from ..math.vectors import Scalar, Structured, unpack
from ..model.scene import Scene
from .landing import Landing
from .solvers import default_controller, ready_solver
from .step_state import Method


class Scheme(eqx.Module):
    """How motions are computed, whatever moves: how equations of motion are set up, and how they
    are integrated."""

    method: Method
    formulation: Formulation

    def system(self, scene: Scene) -> System:
        """The system to integrate, of a scene in scalar form."""
        return System.of(scene, self.formulation)

    def unpacked(self, form: Structured) -> System:
        """The system to integrate, of a scene in packed form."""
        return self.system(unpack(form))


def make_formulation(
    coordinates: AbstractCoordinates,
    stabilisation: AbstractStabilisation | None,
    redundant: bool,
    ledger: bool = False,
) -> Formulation:
    """The formulation for the arguments of `simulate`."""
    stabilisation = Baumgarte() if stabilisation is None else stabilisation
    return Formulation(coordinates, stabilisation, redundant, ledger)


def make_scheme(
    solver: diffrax.AbstractSolver | None,
    controller: diffrax.AbstractStepSizeController | None,
    formulation: Formulation,
    landing_tolerance: Scalar | None,
    rtol: Scalar,
    atol: Scalar | None,
) -> Scheme:
    """The scheme for the arguments of `simulate`."""
    atol = rtol * 1e-5 if atol is None else atol
    if controller is None:
        controller = default_controller(rtol, atol)
    landing = None if landing_tolerance is None else Landing(landing_tolerance)
    solver = ready_solver(diffrax.Tsit5() if solver is None else solver, rtol, atol)
    return _with_arrays(Scheme(Method(solver, controller, landing), formulation))


def _with_arrays(scheme: Scheme) -> Scheme:
    """The scheme with its floats as arrays, so that changing one compiles nothing anew. Zeros stay:
    they tell the controller which terms to leave out."""
    return jax.tree.map(
        lambda leaf: (
            jnp.asarray(leaf) if isinstance(leaf, float) and leaf != 0.0 else _on_device(leaf)
        ),
        scheme,
    )


def _on_device(leaf: object) -> object:
    return jnp.asarray(leaf) if isinstance(leaf, np.ndarray) else leaf
