"""Systems as functions of parameters, for derivatives along these."""

from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
from jaxtyping import PyTree

from ...dynamics.formulation import Formulation
from ...dynamics.system import System
from ...math.vectors import Scalar
from ...model.bodies import State
from ...model.scene import Scene
from ...parametrisation.parametrised_scene import AbstractFamily, Coordinates

Value = TypeVar("Value")
Auxiliary = TypeVar("Auxiliary")


class SystemFamily(eqx.Module):
    """The systems of a family of scenes, without grouped elements; `origin` as of `System`."""

    family: AbstractFamily
    formulation: Formulation
    origin: Scalar | None = None

    @property
    def values(self) -> Coordinates:
        """The coordinates of the parameters at which derivatives are taken, (p,)."""
        return self.family.values

    def system(self) -> System:
        """Return the system of the scene at the coordinates `values`."""
        return System(self.family.scene(self.values), self.formulation, self.origin)

    def start(self, values: Coordinates) -> State:
        """Return the initial state at coordinates (p,), in scalar form."""
        return self.family.start(values)

    def pushed(
        self,
        function: Callable[..., tuple[Value, Auxiliary]],
        primals: tuple[PyTree, ...],
        tangents: tuple[PyTree, ...],
    ) -> tuple[Value, Auxiliary, Value]:
        """Return the value, auxiliary result and derivatives along the parameters of a function of
        the system and `primals`; see `AbstractFamily.pushed`."""

        def of_scene(scene: Scene, *primals: PyTree) -> tuple[Value, Auxiliary]:
            return function(System(scene, self.formulation, self.origin), *primals)

        return self.family.pushed(of_scene, primals, tangents)
