"""Systems over parameters, for derivatives along these."""

from collections.abc import Callable
from typing import Any

import equinox as eqx

from ..dynamics.formulation import Formulation
from ..dynamics.system import System
from ..parametrisation.parametrised_scene import AbstractFamily


class SystemFamily(eqx.Module):
    """The systems of a family of scenes, each element by itself."""

    family: AbstractFamily
    formulation: Formulation

    @property
    def values(self) -> Any:
        """(p,) where the family is looked at, in scaled coordinates."""
        return self.family.values

    def system(self) -> System:
        """The system there."""
        return System(self.family.scene(self.values), self.formulation)

    def start(self, values: Any) -> Any:
        """The initial state, in scalar form."""
        return self.family.start(values)

    def pushed(
        self, function: Callable[..., tuple[Any, Any]], primals: tuple[Any, ...], tangents: Any
    ) -> tuple[Any, Any, Any]:
        """`AbstractFamily.pushed` for a function of system and `primals`."""

        def of_scene(scene: Any, *primals: Any) -> tuple[Any, Any]:
            return function(System(scene, self.formulation), *primals)

        return self.family.pushed(of_scene, primals, tangents)
