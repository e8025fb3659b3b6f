"""Base class of the quantities, and the instant of a run at which they are evaluated."""

import abc
from collections.abc import Callable, Collection
from dataclasses import replace
from functools import cached_property
from typing import ClassVar, Literal, TypeVar, get_args

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree
from typing_extensions import override

from .._dynamics.absolute_coordinates import AbsoluteCoordinates
from .._dynamics.contact_events import ContactGaps, contact_gaps
from .._dynamics.contact_forces import NO_BRISTLES, Bristles, EntrySpeeds, LoadedContact
from .._dynamics.coordinates import Motions
from .._dynamics.energy import bristle_energy
from .._dynamics.equations_of_motion import Dynamics
from .._dynamics.sampled_forces import NO_MEMORIES, Memories, holding, initial_memories
from .._dynamics.system import System
from .._fields.checks import as_number, errors_about, nearest, require
from .._fields.types import ArrayLike
from .._math.smoothing import norm_and_direction, where
from .._math.vectors import Condition, Scalar, Vector
from .._model.bodies import BodyState
from .._model.scene import Scene

T = TypeVar("T")
NEAR = 1e-6
"""Part of a step by which an instant just before a jump at its end is earlier: more than rounding
errors of times and penetrations."""


class Instant:
    """A scene and its motion at one time of a run: the argument of quantities.

    Vectors are not arrays but have the scalar fields `x`, `y` and `z`. Properties are computed on
    first use. Values of contacts are by name of joint and label of contact, such as
    ``contacts["pin"]["V"]``.

    - `time`: the scene's time, s.
    - `work[name]`: energies since the start, J: dissipated by "normal damping", "friction", "film"
      and "stabilisation", or "supplied" by drives and loads; "friction" includes the energy in
      bristles. Empty unless the run has ``Settings(ledger=True)``.

    Runs create instants. The example makes one from a `System` (a scene with its equations of
    motion), the time since the system's `origin`, s, and the variables. An instant is a PyTree, but
    one that JAX has rebuilt knows no other instants of its step: its `inside` raises an error.

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
        memory: Memories = NO_MEMORIES,
        inside: "Callable[[Scalar], Instant] | None" = None,
        jumps: Condition | None = None,
    ):
        self.time, self.work = system.scene_time(own_time), work
        self.scene = system.scene
        """The scene, whose vectors are `Vector`s, not arrays."""
        self.entry_speeds = entry_speeds
        """Entry speeds of the contacts, m/s, ``entry_speeds[joint][contact]``. An entry speed is
        the penetration rate at the onset of a contact, zero while the contact is open, and 1e9 m/s
        if the rate is unknown because the onset was before the start of the run. Contacts whose law
        doesn't use the entry speed are left out."""
        self.bristles = bristles
        """Bristle deflections, m, ``bristles[joint][contact]``: vectors in the axes of the joint's
        first body; zero while the contact is open. Contacts without bristles are left out."""
        self._system, self._own_time, self._variables = system, own_time, variables
        # Function of the fraction of the step, as in `inside`; ``None`` unless a step ends here.
        self._inside = inside
        self.jumps = jumps
        """Whether the step that ends here ends at a breakpoint, or at an onset or end of a contact,
        where quantities may jump; ``None`` in a scene without jumps."""
        # What JAX may trace of an instant.
        self._parts = system, own_time, variables, entry_speeds, work, bristles, memory

    def inside(self, fraction: Scalar) -> "Instant":
        """Return the instant at a fraction, 0 to 1, of the step that ends here, by dense output.

        **Raises:** `ValueError` if this instant isn't the end of a step.
        """
        if self._inside is None:
            raise ValueError("Only an instant at the end of a step has instants `inside` the step.")
        return self._inside(fraction)

    @cached_property
    def middle(self) -> "Instant":
        """The instant halfway through the step that ends here."""
        return self.inside(0.5)

    @property
    def just_before(self) -> "Instant":
        """The instant just before the end of the step that ends here. At the end, loads, contact
        forces and sampled forces, as of a `Servo`, may jump, and with them accelerations."""
        return self.inside(self.last_fraction)

    @property
    def last_fraction(self) -> Scalar:
        """Fraction of the step, as in `inside`, at the instant `just_before`: 1, or slightly less
        if quantities may jump at the step's end (see `jumps`)."""
        return 1.0 if self.jumps is None else where(self.jumps, 1.0 - NEAR, 1.0)

    def before_and_after(self, value_of: "Callable[[Instant], Scalar]") -> tuple[Scalar, Scalar]:
        """Return the numbers that `value_of` computes from the instants just before and just after
        the end of the step that ends here; without a jump there, they are equal."""
        value = value_of(self)
        # The memory of sampled forces may change at the end of any step, also without `jumps`.
        if self.memory:
            return value_of(self.just_before), value
        if self.jumps is None:
            return value, value
        return where(self.jumps, value_of(self.just_before), value), value

    @cached_property
    def memory(self) -> Memories:
        """Numbers that sampled forces, such as a `Servo`, remember, ``memory[force][name]``; if
        these are unknown, the numbers with which a run would start here."""
        *_, memory = self._parts
        return memory or initial_memories(self._system, self._variables, self._own_time, {})

    @cached_property
    def motions(self) -> Motions:
        """Motion of each body and of "ground" by name: `position` and `velocity` of the centre of
        mass, m and m/s in global axes, the `rotation` matrix from body axes to global axes, and the
        angular velocity `spin`, rad/s in body axes."""
        return self._system.motions(self._variables)

    @cached_property
    def bodies(self) -> dict[str, BodyState]:
        """State of each body by name, with Euler parameters, scalar first, as `orientation`."""
        return self._system.decode(self._variables)

    @cached_property
    def contacts(self) -> dict[str, dict[str, LoadedContact]]:
        """Each contact by the name of its joint and its label. It has a `contact`, the geometry,
        such as the penetration ``contact.gap.depth``, m; a `normal_force`, N; and the `friction` on
        the joint's second body, N in global axes, ``None`` without a friction law. Open contacts
        have forces of zero."""
        return self._system.contact_forces(self._variables, self.entry_speeds, self.bristles)

    @cached_property
    def bristle_energy(self) -> Scalar | None:
        """Recoverable energy of the bristles, J; ``None`` in a scene without bristles."""
        if not self.bristles:
            return None
        return bristle_energy(self.scene, self.motions, self.contacts, self.bristles)

    @cached_property
    def contact_gaps(self) -> ContactGaps:
        """Penetration of each contact: `depth`, m, measured from the onset of the contact's force,
        and negative while the contact is open; and its `rate`, m/s."""
        return contact_gaps(self.scene, self.motions)

    @cached_property
    def dynamics(self) -> Dynamics:
        """Solution of the equations of motion: accelerations, scalar constraint equations with
        their Jacobians (`rows`), and Lagrange multipliers. In joint coordinates, `rows` and
        `multipliers` lack the joints that the coordinates satisfy by themselves."""
        return self._solved(self._system, self._variables)

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
        return self._solved(absolute, absolute.encode(self.bodies))

    def _solved(self, system: System, variables: PyTree) -> Dynamics:
        system = holding(system, self.memory)
        return system.dynamics(variables, self.entry_speeds, self._own_time, bristles=self.bristles)


jax.tree_util.register_pytree_node(
    Instant, lambda now: (now._parts, None), lambda _, parts: Instant(*parts)
)
Component = Literal["x", "y", "z"]
"""Name of a vector component.

>>> probes = {axis: cj.quantities.JournalOffset("shoulder", axis) for axis in ("x", "y", "z")}
"""
Axes = Literal["global", "body"]
"""Axes in which a vector component is taken.

>>> sensor = cj.quantities.PointAcceleration("arm 2", (0.5, 0, 0), "x", axes="body")
"""
Quantity = Callable[[Instant], Scalar]
"""A scalar function of an instant, in SI units, such as those of `clearjoint.quantities`.

>>> def clock(now: extend.Instant) -> float:
...     return now.time
>>> outputs = {"latest": cj.Peak(clock, "s")}
"""


class AbstractQuantity(eqx.Module):
    """Base class of quantities: scalar functions of an instant of a run, with a unit and a check.

    - `unit`: SI unit of the value as text; ``None`` if it depends on the scene.
    - `period`: 2 pi for an angle, so that differences from measured angles are taken modulo 2 pi;
      otherwise ``None``.

    All fields of a subclass must be static, because a quantity is part of the compiled program.

    ```python
    from typing import ClassVar

    import clearjoint as cj
    import equinox as eqx

    class Height(cj.quantities.AbstractQuantity):
        body: str = eqx.field(static=True)
        unit: ClassVar[str] = "m"

        def __call__(self, now):
            return now.motions[self.body].position.z

        def check(self, scene):
            if self.body not in scene.bodies:
                raise ValueError(f"There is no body {self.body!r}.")

    outputs = {"top": cj.Peak(Height("arm 3"), "m")}
    ```
    """

    unit: ClassVar[str | None] = None
    period: ClassVar[float | None] = None

    @abc.abstractmethod
    def __call__(self, now: Instant) -> Scalar:
        """Return the value of the quantity at an instant, in the SI unit `unit`."""

    @abc.abstractmethod
    def check(self, scene: Scene) -> None:
        """Check, before a run, sweep or fit, that the scene has the elements that fields name.

        **Raises:** `ValueError` with a list of the scene's names.
        """


def check_quantity(argument: str, function: object, scene: Scene) -> None:
    """Check that a scene has the elements that `function` names, if it is an `AbstractQuantity`;
    errors call it `argument`."""
    if isinstance(function, AbstractQuantity):
        with errors_about(argument):
            function.check(scene)


def require_quantity(argument: str, function: object) -> None:
    """Raise an error about `argument` unless `function` is a quantity or function, not a class."""
    remedy = 'pass for example cj.quantities.Position("arm", "x")'
    is_function = callable(function) and not isinstance(function, type)
    require(is_function, argument, function, "a scalar function of an Instant", remedy)


def number_at(now: Instant, quantity: Quantity) -> jax.Array:
    """Return a quantity, one real number, or an array if the attribute `is_array` is true."""
    remedy = 'return one component, such as now.motions["arm"].position.x'
    may_be_array = bool(getattr(quantity, "is_array", False))
    return real_number("quantity", quantity, now, remedy, may_be_array)


def real_number(
    argument: str, function: Callable[[T], Scalar], at: T, remedy: str, may_be_array: bool = False
) -> jax.Array:
    """Return ``function(at)``; raise a `ValueError` about `argument` unless it is a real number."""
    value = function(at)
    is_array = isinstance(value, jax.Array | np.ndarray | np.generic | float | int)
    if not (is_array and np.isrealobj(value) and (may_be_array or np.shape(value) == ())):
        kind = f"{np.shape(value)} of {jnp.result_type(value)}" if is_array else type(value)
        actual = f"{getattr(function, '__qualname__', function)}, which returns {kind}"
        require(False, argument, actual, "a function that returns one real number", remedy)
    return jnp.asarray(value, dtype=float)


def require_known(argument: str, name: str, known: Collection[str]) -> None:
    """Check that the name passed as `argument` is `known`; the error suggests the most similar."""
    if name not in known:
        expected = f"one of the scene's {sorted(known)}"
        remedy = nearest(name, known, "correct the name, or add it to the scene")
        require(False, argument, name, expected, remedy)


def one_of(argument: str, *allowed: T) -> Callable[[T], T]:
    """Return a converter for the field `argument` that refuses values other than the `allowed`."""

    def checked(value: T) -> T:
        require(value in allowed, argument, value, f"one of {allowed}", "pass one of these")
        return value

    return checked


as_component: Callable[[Component], Component] = one_of("component", *get_args(Component))
component_or_none: Callable[[Component | None], Component | None] = one_of(
    "component", *get_args(Component), None
)
as_axes: Callable[[Axes], Axes] = one_of("axes", *get_args(Axes))
Numbers = tuple[float, ...]
"""Type of static fields with numbers. Unlike an array, a tuple compares and hashes by value."""


def numbers(values: ArrayLike, argument: str = "value", unit: str = "1") -> Numbers:
    """Return numbers, (N,), as a tuple; a single number gives a tuple of one."""
    array = np.atleast_1d(as_number(values, argument, unit))
    require(array.ndim == 1, argument, values, "a row of numbers", "pass a list of floats")
    return tuple(array.tolist())


def optional_numbers(
    values: ArrayLike | None, argument: str = "value", unit: str = "1"
) -> Numbers | None:
    """Return numbers as `numbers` does, or ``None`` unchanged."""
    return None if values is None else numbers(values, argument, unit)


class AbstractVectorQuantity(AbstractQuantity):
    """Base class of quantities that are a `component` of a vector or, with ``None``, its magnitude.
    A subclass names this base first, so that `component` follows the fields of its other bases."""

    component: Component | None = eqx.field(default=None, static=True, converter=component_or_none)

    @abc.abstractmethod
    def vector(self, now: Instant) -> Vector:
        """Return the vector at an instant, in the unit and axes of the quantity."""

    @override
    def __call__(self, now: Instant) -> Scalar:
        vector = self.vector(now)
        if self.component is None:
            return norm_and_direction(vector)[0]
        return getattr(vector, self.component)
