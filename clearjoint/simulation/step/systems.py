"""The equations of motion of a scene as functions of parameters, for derivatives with respect to
these parameters."""

from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
from jaxtyping import PyTree

from ...dynamics.formulation import Formulation
from ...dynamics.system import System
from ...math.vectors import Scalar
from ...model.scene import Scene
from ...parametrisation.parametrised_scene import ParametrisedScene

Value = TypeVar("Value")
Auxiliary = TypeVar("Auxiliary")


class SystemFamily(eqx.Module):
    """A scene's equations of motion (`System`) and initial state as functions of p parameters.

    Runs without derivatives compute elements of the same structure together, as groups. Here every
    element is computed on its own.

    - `family`: the scene and its initial state as functions of the parameters.
    - `formulation`: coordinates, stabilisation of the constraints, and energy ledger.
    - `origin`: the scene's time, s, at which the time t of the systems is zero; ``None`` if t is
      the scene's time.
    """

    family: ParametrisedScene
    formulation: Formulation
    origin: Scalar | None = None

    def system(self) -> System:
        """Return the equations of motion for the values of the parameters at which derivatives are
        taken."""
        return System(self.family.scene(self.family.values), self.formulation, self.origin)

    def pushed(
        self,
        function: Callable[..., tuple[Value, Auxiliary]],
        primals: tuple[PyTree, ...],
        tangents: tuple[PyTree, ...],
    ) -> tuple[Value, Auxiliary, Value]:
        """Evaluate a function of the system, and differentiate it with respect to the parameters.

        The derivatives are total ones: through the system, which depends on the parameters, and
        through the function's further arguments.

        **Arguments:**

        - `function`: function of the system and of `primals`. It returns a pair of PyTrees: the
          value, which is differentiated, and an auxiliary result, which is not.
        - `primals`: the arguments of `function` after the system.
        - `tangents`: derivatives of `primals` with respect to the parameters: PyTrees of the same
          structures, whose leaves have an additional first axis of length p.

        **Returns:** the value, the auxiliary result, and the value's derivatives, with a first axis
        of length p in each leaf.
        """

        def of_scene(scene: Scene, *primals: PyTree) -> tuple[Value, Auxiliary]:
            return function(System(scene, self.formulation, self.origin), *primals)

        return self.family.pushed(of_scene, primals, tangents)
