"""How a run is computed: solver, controller and landing, with the formulation of its equations."""

import equinox as eqx
import jax
import numpy as np
from jaxtyping import PyTree

from ...dynamics.formulation import Formulation
from ...dynamics.system import System
from ...fields.caching import cached_by_numbers
from ...math.vectors import ConstantFolded, unpack
from ...model.scene import Scene
from .landing import Landing
from .settings import Settings
from .solvers import default_controller, ready_solver
from .step_state import Method


class Scheme(eqx.Module):
    """How motions are computed, whatever moves: how equations of motion are set up, and how they
    are integrated."""

    method: Method
    formulation: Formulation

    @staticmethod
    def of(settings: Settings, redundant: bool = False) -> "Scheme":
        """The scheme that settings ask for; `redundant`: whether constraints depend on each other,
        unless the settings say it."""
        redundant = redundant if settings.redundant is None else settings.redundant
        choices = settings.coordinates, settings.stabilisation, redundant, settings.ledger
        rtol, atol, tolerance = settings.rtol, settings.atol, settings.landing_tolerance
        atol = rtol * 1e-5 if atol is None else atol
        controller = settings.controller
        method = Method(
            ready_solver(settings.solver, rtol, atol),
            default_controller(rtol, atol) if controller is None else controller,
            None if tolerance is None else Landing(tolerance),
        )
        return _with_arrays(Scheme(method, Formulation(*choices)))

    @staticmethod
    def on_host(settings: Settings, redundant: bool = False) -> "Scheme":
        """The same with numpy's numbers, made once for settings that are alike."""
        return _on_host(vars(settings), redundant)

    def system(self, scene: Scene) -> System:
        """The system to integrate, of a scene in scalar form."""
        return System.of(scene, self.formulation)

    def unpacked(self, folded_scene: ConstantFolded) -> System:
        """The system to integrate, of a scene in packed form."""
        return self.system(unpack(folded_scene))


@cached_by_numbers
def _on_host(settings: dict[str, PyTree], redundant: bool) -> Scheme:
    return jax.device_get(Scheme.of(Settings(**settings), redundant))


def _with_arrays(scheme: Scheme) -> Scheme:
    """The scheme with its floats as arrays, so that changing one compiles nothing anew. Zeros stay:
    they tell the controller which terms to leave out."""
    return jax.tree.map(
        lambda leaf: jax.device_put(leaf) if _is_number(leaf) else leaf,
        scheme,
    )


def _is_number(leaf: object) -> bool:
    return isinstance(leaf, np.ndarray) or (isinstance(leaf, float) and leaf != 0.0)
