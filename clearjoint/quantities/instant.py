"""One instant of a run, the argument of quantities and sections."""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

import jax
from jaxtyping import PyTree

from ..dynamics.absolute_coordinates import AbsoluteCoordinates
from ..dynamics.contact_events import ContactGaps, contact_gaps
from ..dynamics.contact_forces import NO_BRISTLES, Bristles, EntrySpeeds, LoadedContact
from ..dynamics.coordinates import Motions
from ..dynamics.energy import bristle_energy
from ..dynamics.equations_of_motion import Dynamics
from ..dynamics.system import System
from ..math.groups import by_name
from ..math.vectors import Scalar
from ..model.bodies import BodyState
from ..model.scene import Scene


@jax.tree_util.register_pytree_node_class
class Instant:
    """A scene and its motion at one time of a run: the argument of quantities.

    Vectors are not arrays but have the scalar fields `x`, `y` and `z`. Properties are computed on
    first use. Bodies, joints and contacts have the names of the user's scene, even if the run
    computes several of the same kind together, as arrays.

    - `time`: s.
    - `work[name]`: energies that have been dissipated or supplied since the start, J; "friction"
      includes the energy in bristles. Empty unless the run keeps this ledger.

    Runs create instants. The example makes one from a `System`, which evaluates the equations of
    motion, and its variables, which are the coordinates and velocities. An instant is a PyTree;
    flattening drops the function that gives the instants `inside` its step.

    **Arguments:**

    - `system`: the equations of motion of the scene.
    - `own_time`: s, since the system's `origin`, a time of the scene near which a run starts;
      without an origin it is the scene's time. The attribute `time` is always the scene's.
    - `variables`: coordinates and velocities, as `system.encode` returns them.
    - `entry_speeds`, `bristles`: m/s and m, by joint and contact; empty if no law uses them.
    - `work`: see above.
    - `inside`: function that returns the instant at a fraction, 0 to 1, of the step that ends at
      this instant; ``None``, the default, if no step ends here.

    >>> scene, state = extend.unpack(cj.mechanisms.double_pendulum())
    >>> system = extend.System(scene, extend.Formulation())
    >>> variables = system.encode(state.bodies)
    >>> now = extend.Instant(system, 0.1, variables, entry_speeds={}, work={})
    >>> height = cj.quantities.Position("arm 2", "x")
    >>> print(f"{height(now):.1f} m at {now.time} s")
    0.5 m at 0.1 s
    """

    def __init__(
        self,
        system: System,
        own_time: Scalar,
        variables: PyTree,
        entry_speeds: EntrySpeeds,
        work: dict[str, Scalar],
        bristles: Bristles = NO_BRISTLES,
        inside: "Callable[[Scalar], Instant] | None" = None,
    ):
        self.time, self.work = system.clock(own_time), work
        self._system, self._own_time, self._variables = system, own_time, variables
        self._entry_speeds, self._bristles, self._inside = entry_speeds, bristles, inside
        self._parts = system, own_time, variables, entry_speeds, work, bristles

    def tree_flatten(self) -> tuple[tuple[PyTree, ...], None]:
        """Return the parts of the instant that JAX may trace, and ``None`` as no part is static.

        JAX calls this method.
        """
        return self._parts, None

    @classmethod
    def tree_unflatten(cls, _: None, parts: tuple[PyTree, ...]) -> "Instant":
        """Return the instant with the parts that `tree_flatten` returns.

        JAX calls this method.
        """
        return cls(*parts)

    @cached_property
    def scene(self) -> Scene:
        """The scene with the user's elements and names, whose vectors are `Vector`s, not arrays."""
        return self._system.ungrouped()

    @cached_property
    def entry_speeds(self) -> EntrySpeeds:
        """Entry speeds of the current contacts, m/s, ``entry_speeds[joint][contact]``.

        An entry speed is the penetration rate at the onset. Contacts whose law doesn't use it have
        no entry. It is zero without contact, and 1e9 m/s if the onset was before the start.
        """
        return by_name(self._entry_speeds)

    @cached_property
    def bristles(self) -> Bristles:
        """Bristle deflections, m, ``bristles[joint][contact]``; zero without contact.

        Each is a vector in the axes of the joint's first body. Contacts without bristles have no
        entry.
        """
        return by_name(self._bristles)

    def inside(self, fraction: Scalar) -> "Instant":
        """Return an earlier instant of the step that ends here, from the solver's dense output.

        **Arguments:** `fraction`: of the step's duration, between 0 at its start and 1 at its end.

        **Raises:** `ValueError` if this instant isn't the end of a step.
        """
        if self._inside is None:
            raise ValueError("Only an instant at the end of a step has instants `inside` the step.")
        return self._inside(fraction)

    @cached_property
    def middle(self) -> "Instant":
        """The instant halfway through the step that ends here; see `inside`."""
        return self.inside(0.5)

    @cached_property
    def motions(self) -> Motions:
        """Motion of each body by name: position, rotation matrix, velocity and spin."""
        return by_name(self._motions)

    @cached_property
    def bodies(self) -> dict[str, BodyState]:
        """State of each body by name: position, Euler parameters, velocity and spin."""
        return by_name(self._system.decode(self._variables))

    @cached_property
    def _motions(self) -> Motions:
        return self._system.motions(self._variables)

    @cached_property
    def contacts(self) -> dict[str, dict[str, LoadedContact]]:
        """Geometry, normal force and friction of all contacts, ``contacts[joint][contact]``."""
        forces = self._system.contact_forces(self._variables, self._entry_speeds, self._bristles)
        return by_name(forces)

    @cached_property
    def bristle_energy(self) -> Scalar | None:
        """Recoverable energy of the bristles, J; ``None`` in a scene without bristles."""
        if not self._bristles:
            return None
        return bristle_energy(self.scene, self.motions, self.contacts, self.bristles)

    @cached_property
    def contact_gaps(self) -> ContactGaps:
        """Penetration of each contact and its rate, m/s, ``contact_gaps[joint][contact]``.

        The penetration is measured from the depth at which the contact's force begins, m.
        """
        return by_name(contact_gaps(self._system.scene, self._motions))

    @cached_property
    def dynamics(self) -> Dynamics:
        """Solution of the equations of motion: accelerations, constraint rows and multipliers."""
        solved = self._system.dynamics(
            self._variables, self._entry_speeds, self._own_time, bristles=self._bristles
        )
        return replace(solved, contact_forces=by_name(solved.contact_forces))

    @cached_property
    def absolute_dynamics(self) -> Dynamics:
        """The `dynamics` in absolute coordinates, in which every ideal joint has multipliers."""
        # Joint coordinates eliminate ideal joints, whose multipliers are then unknown. The same
        # state in absolute coordinates has the same accelerations.
        formulation, coordinates = self._system.formulation, AbsoluteCoordinates()
        if isinstance(formulation.coordinates, AbsoluteCoordinates):
            return self.dynamics
        formulation = replace(formulation, coordinates=coordinates)
        absolute = System(self.scene, formulation, self._system.origin)
        variables = absolute.encode(by_name(self._system.decode(self._variables)))
        return absolute.dynamics(
            variables, self.entry_speeds, self._own_time, bristles=self.bristles
        )
