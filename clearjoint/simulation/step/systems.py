"""Systems of the equations of motion as functions of parameters, for their derivatives."""

from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
from jaxtyping import PyTree

from ...dynamics.formulation import Formulation
from ...dynamics.system import System
from ...math.vectors import Scalar
from ...model.bodies import State
from ...model.scene import Scene
from ...parametrisation.parametrised_scene import Coordinates, ParametrisedScene

Value = TypeVar("Value")
Auxiliary = TypeVar("Auxiliary")


class SystemFamily(eqx.Module):
    """The equations of motion of a scene (`System`) as a function of p parameters.

    Alike elements of the scene are not combined to groups.

    **Arguments:**

    - `family`: the scene and its initial state as functions of the parameters.
    - `formulation`: formulation of the equations of motion.
    - `origin`: the scene's time, s, at which the time t of the systems is zero; ``None`` if t is
      the scene's time.
    """

    family: ParametrisedScene
    formulation: Formulation
    origin: Scalar | None = None

    @property
    def values(self) -> Coordinates:
        """The parameters on their scales at which derivatives are taken, (p,)."""
        return self.family.values

    def system(self) -> System:
        """Return the system of the scene at the parameters `values`."""
        return System(self.family.scene(self.values), self.formulation, self.origin)

    def start(self, values: Coordinates) -> State:
        """Return the initial state, in scalar form, at parameters on their scales, (p,)."""
        return self.family.start(values)

    def pushed(
        self,
        function: Callable[..., tuple[Value, Auxiliary]],
        primals: tuple[PyTree, ...],
        tangents: tuple[PyTree, ...],
    ) -> tuple[Value, Auxiliary, Value]:
        """Compute a function of the system and its derivatives with respect to the parameters.

        **Arguments:**

        - `function`: function of the system and of `primals`. It returns a pair: the value, which
          is differentiated, and an auxiliary result, which is not.
        - `primals`: arguments that follow the system; they may depend on the parameters.
        - `tangents`: derivatives of `primals` with respect to the parameters, (p, ...) each.

        **Returns:** the value, the auxiliary result, and the value's derivatives, (p, ...).
        """

        def of_scene(scene: Scene, *primals: PyTree) -> tuple[Value, Auxiliary]:
            return function(System(scene, self.formulation, self.origin), *primals)

        return self.family.pushed(of_scene, primals, tangents)
