"""One instant of one run, as outputs and sections see it."""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any

from ..dynamics.absolute_coordinates import AbsoluteCoordinates
from ..dynamics.contact_events import Reaches, reaches
from ..dynamics.contact_forces import ContactForce, Memory, contact_forces
from ..dynamics.coordinates import Motions
from ..dynamics.equations_of_motion import Dynamics
from ..dynamics.system import System
from ..math.groups import by_name
from ..math.vectors import Scalar
from ..model.scene import Scene


class Instant:
    """A scene at a time, in scalar form. What is not asked for is not computed.

    `time` s; `work[name]` integrals of the energy ledger, J. At the end of a step, `middle` is the
    instant half-way through it. All elements go by their own names, whether or not the run has put
    alike ones together.
    """

    def __init__(
        self,
        system: System,
        time: Scalar,
        variables: Any,
        memory: Memory,
        work: dict[str, Scalar],
        middle: "Callable[[], Instant] | None" = None,
    ):
        self.time, self.work = time, work
        self._system, self._memory, self._variables = system, memory, variables
        self._middle = middle

    @cached_property
    def scene(self) -> Scene:
        """The scene with each element by itself."""
        return self._system.ungrouped()

    @cached_property
    def memory(self) -> Memory:
        """Entry speeds of the contacts, m/s, by joint and contact; zero in flight."""
        return by_name(self._memory)

    @cached_property
    def middle(self) -> "Instant":
        """The middle of the step that ends here, by the solver's dense output."""
        if self._middle is None:
            raise ValueError("Only an instant that ends a step has a `middle`.")
        return self._middle()

    @cached_property
    def motions(self) -> Motions:
        """Pose and twist of each body."""
        return by_name(self._motions)

    @cached_property
    def _motions(self) -> Motions:
        return self._system.motions(self._variables)

    @cached_property
    def contacts(self) -> dict[str, dict[str, ContactForce]]:
        """Geometry and forces of all contacts, by joint and contact."""
        return by_name(contact_forces(self._system.scene, self._motions, self._memory))

    @cached_property
    def reaches(self) -> Reaches:
        """How deep each contact is from where its force begins, and how fast."""
        return by_name(reaches(self._system.scene, self._motions))

    @cached_property
    def dynamics(self) -> Dynamics:
        """The equations of motion solved: accelerations, constraint rows, multipliers."""
        found = self._system.dynamics(self._variables, self._memory, self.time)
        return replace(found, contact_forces=by_name(found.contact_forces))

    @cached_property
    def absolute_dynamics(self) -> Dynamics:
        """The same in absolute coordinates, where every ideal joint has its multipliers."""
        formulation, coordinates = self._system.formulation, AbsoluteCoordinates()
        if isinstance(formulation.coordinates, AbsoluteCoordinates):
            return self.dynamics
        absolute = System(self.scene, replace(formulation, coordinates=coordinates))
        variables = absolute.encode(by_name(self._system.decode(self._variables)))
        return absolute.dynamics(variables, self.memory, self.time)
