"""Numerical scheme of a run: the integration method, and the formulation of the equations of motion
(coordinates, stabilisation of the constraints, and energy ledger)."""

from collections.abc import Callable
from typing import TypeAlias, TypeVar

import diffrax
import equinox as eqx
import jax
import numpy as np
from jaxtyping import PyTree

from ..._dynamics.formulation import Formulation
from ..._dynamics.system import System
from ..._fields.caching import cached_by_numbers
from ..._math.vectors import Scalar
from ..._model.scene import Scene
from ..._native.functions import keep_flattened
from ..._parametrisation.parametrised_scene import AbstractSceneFamily
from .landing import Landing
from .settings import Settings
from .solvers import largest_component, ready_solver
from .step_state import Method


class Scheme(eqx.Module):
    """Integration method and formulation of the equations of motion of a run. It contains no data
    of a scene, so that runs of different scenes may use the same scheme."""

    method: Method
    formulation: Formulation

    @staticmethod
    def of(settings: Settings, redundant: bool = False) -> "Scheme":
        """Return the scheme for the settings of a run, with the scheme's nonzero numbers as JAX
        arrays; `redundant` takes the place of `settings.redundant` if that is ``None``."""
        redundant = redundant if settings.redundant is None else settings.redundant
        coordinates, stabilisation = settings.coordinates, settings.stabilisation
        formulation = Formulation(coordinates, stabilisation, redundant, settings.ledger)
        rtol, atol, tolerance = settings.rtol, settings.atol, settings.landing_tolerance
        # Impacts amplify errors of variables that are nearly zero, such as the misalignment of a
        # journal. The relative tolerance must hold for these too, so `atol` is far below `rtol`.
        atol = rtol * 1e-5 if atol is None else atol
        usual = diffrax.PIDController(rtol=rtol, atol=atol, norm=largest_component)
        method = Method(
            ready_solver(settings.solver, rtol, atol),
            usual if settings.controller is None else settings.controller,
            None if tolerance is None else Landing(tolerance),
        )

        def array(leaf: object) -> object:
            # JAX compiles a program for each value of a Python number, but only one for all values
            # of an array. As arrays, other tolerances use the same program. Zeros remain Python
            # numbers, because diffrax's controller omits terms whose coefficient is such a zero.
            is_number = isinstance(leaf, np.ndarray) or (isinstance(leaf, float) and leaf != 0.0)
            return jax.device_put(leaf) if is_number else leaf

        return jax.tree.map(array, Scheme(method, formulation))

    @staticmethod
    def on_host(settings: Settings, redundant: bool = False) -> "Scheme":
        """Return the scheme as `of` does, but with NumPy arrays, for calls from Python in which JAX
        traces nothing. The result is cached for equal settings."""
        return _on_host(vars(settings), redundant)

    def system(self, scene: Scene) -> System:
        return System.prepared(scene, self.formulation)


@cached_by_numbers
def _on_host(settings: dict[str, PyTree], redundant: bool) -> Scheme:
    return keep_flattened(jax.device_get(Scheme.of(Settings(**settings), redundant)))


Value = TypeVar("Value")
Auxiliary = TypeVar("Auxiliary")
Trees: TypeAlias = tuple[PyTree, ...]


class SystemFamily(eqx.Module):
    """A scene's equations of motion (`System`) and initial state as functions of the coordinates of
    p parameters, such as the logarithm of a parameter on a logarithmic scale.

    - `family`: the scene as a function of the parameters, with their present values.
    - `origin`: the scene's time, s, at which the systems' time is zero; ``None`` if both are equal.
    - `is_transposed`: whether JAX will transpose the derivatives, as for a gradient.
    """

    family: AbstractSceneFamily
    formulation: Formulation
    origin: Scalar | None = None
    is_transposed: bool = eqx.field(default=False, static=True)

    def system(self) -> System:
        scene = self.family.scene(self.family.values)
        return System.prepared(scene, self.formulation, self.origin)

    def with_derivatives(
        self, function: Callable[..., Value], primals: Trees, tangents: Trees
    ) -> tuple[Value, Value]:
        """Return ``function(system, *primals)`` and its derivatives by the parameters. Arrays of
        these, and of `tangents`, the derivatives of `primals`, have a first axis for parameters."""
        value, _, derivatives = self.with_auxiliary(
            lambda *arguments: (function(*arguments), None), primals, tangents
        )
        return value, derivatives

    def with_auxiliary(
        self, function: Callable[..., tuple[Value, Auxiliary]], primals: Trees, tangents: Trees
    ) -> tuple[Value, Auxiliary, Value]:
        """Evaluate a function of the system and of `primals`, and differentiate it with respect to
        the parameters, through the system and through `primals`, whose derivatives are `tangents`.
        The function returns a value and an auxiliary result, which is not differentiated. Return
        the value, the auxiliary result, and the derivatives of the value, whose arrays have a first
        axis for the parameters."""

        def of_scene(scene: Scene, *primals: PyTree) -> tuple[Value, Auxiliary]:
            return function(System.prepared(scene, self.formulation, self.origin), *primals)

        return self.family.with_derivatives(of_scene, primals, tangents)
