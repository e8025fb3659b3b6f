"""One instant of one run, as outputs and sections see it."""

from collections.abc import Callable
from functools import cached_property
from typing import Any

import equinox as eqx

from .absolute import AbsoluteCoordinates
from .coordinates import Motions
from .dynamics import ContactForce, Dynamics, Formulation, Memory, contact_forces, evaluate
from .impacts import Reaches, reaches
from .scene import Scene
from .vectors import Scalar


class Instant:
    """A scene at a time, in scalar form. What is not asked for is not computed.

    `time` s; `scene`; `memory[joint][contact]` entry speeds, m/s; `work[name]` integrals of the
    energy ledger, J. At the end of a step, `middle` is the instant half-way through it.
    """

    def __init__(
        self,
        scene: Scene,
        formulation: Formulation,
        time: Scalar,
        variables: Any,
        memory: Memory,
        work: dict[str, Scalar],
        middle: "Callable[[], Instant] | None" = None,
    ):
        self.scene, self.time, self.memory, self.work = scene, time, memory, work
        self._formulation, self._variables = formulation, variables
        self._middle = middle

    @cached_property
    def middle(self) -> "Instant":
        """The middle of the step that ends here, by the solver's dense output."""
        if self._middle is None:
            raise ValueError("Only an instant that ends a step has a `middle`.")
        return self._middle()

    @cached_property
    def motions(self) -> Motions:
        """Pose and twist of each body."""
        return self._formulation.coordinates.motions(self.scene, self._variables)

    @cached_property
    def contacts(self) -> dict[str, dict[str, ContactForce]]:
        """Geometry and forces of all contacts, by joint and contact."""
        return contact_forces(self.scene, self.motions, self.memory)

    @cached_property
    def reaches(self) -> Reaches:
        """How deep each contact is from where its force begins, and how fast."""
        return reaches(self.scene, self.motions)

    @cached_property
    def dynamics(self) -> Dynamics:
        """The equations of motion solved: accelerations, constraint rows, multipliers."""
        return evaluate(self.scene, self._formulation, self._variables, self.memory, self.time)

    @cached_property
    def absolute_dynamics(self) -> Dynamics:
        """The same in absolute coordinates, where every ideal joint has its multipliers."""
        coordinates, absolute = self._formulation.coordinates, AbsoluteCoordinates()
        if isinstance(coordinates, AbsoluteCoordinates):
            return self.dynamics
        formulation = eqx.tree_at(lambda f: f.coordinates, self._formulation, absolute)
        variables = absolute.encode(self.scene, coordinates.decode(self.scene, self._variables))
        return evaluate(self.scene, formulation, variables, self.memory, self.time)
