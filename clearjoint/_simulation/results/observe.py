"""Observation of a motion: contacts, reactions, accelerations, drift and energies."""

import enum
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import PyTree
from typing_extensions import override

from ..._dynamics.absolute_coordinates import AbsoluteCoordinates
from ..._dynamics.bristles import initial_bristles
from ..._dynamics.coordinates import MotionVariables
from ..._dynamics.energy import bristle_energy, mechanical_energy
from ..._dynamics.equations_of_motion import Dynamics, constraint_wrenches
from ..._dynamics.formulation import Formulation
from ..._dynamics.sampled_forces import holding, initial_memories
from ..._dynamics.system import System
from ..._export.datasets import COMPONENT, AbstractTabular, Labelled, labelled_dataset, texts
from ..._fields.checks import as_shown, require, require_type
from ..._fields.objects import described, with_arrays
from ..._math.smoothing import norm_and_direction
from ..._math.vectors import ConstantFolded, Scalar, Vector, fold_constants, pack, unpack
from ..._model.bodies import GROUND, State
from ..._model.clearance_joints.journal_bases import BASES, HasJournal, axial_positions
from ..._model.joints.constraint_rows import row_rate
from ..._model.scene import Scene, require_scene
from ..._native import Native, over_rows
from ...quantities.base import Instant, Quantity, check_quantity
from ..step.types import Flags, Integers, Numbers, Vectors
from .nonsmooth_solution import NonsmoothSolution
from .solution import CONTACTS, LABELS, Solution, Trajectory, by_contact

if TYPE_CHECKING:
    import xarray as xr

Result = TypeVar("Result")
VARIABLES = {
    "force": "reaction_force",
    "moment": "reaction_moment",
    "linear": "acceleration",
    "angular": "angular_acceleration",
}
"""Variable of the dataset for each field of `Load` and `AccelerationSeries`."""


class MotionMode(enum.IntEnum):
    """Mode of motion of a journal: which of its two end circles (bases) touch the bearing's wall.

    `LINE_CONTACT`: both on the same side; `OPPOSITE_SIDES`: both, so that the journal is tilted.

    >>> cj.results.MotionMode(2).name
    'LINE_CONTACT'
    """

    FREE_FLIGHT = 0
    ONE_BASE = 1
    LINE_CONTACT = 2
    OPPOSITE_SIDES = 3


class ContactObservation(eqx.Module):
    """One contact of a clearance joint at N times.

    The joint connects a bearing on its first body and a journal on its second body. In other
    joints, such as a pin in a slot, these words stand for the surfaces of the first and the second
    body. The bases of a journal are its end circles, each of which is a contact. Equation numbers
    are those of Flores et al. 2006.

    - `penetration`: (N,) m, depth of overlap, negative where the surfaces are apart (eq. 13).
    - `penetration_rate`: (N,) m/s, positive while the surfaces approach (eq. 21).
    - `eccentricity`: (N,) m, distance from the bearing's axis to a point of the journal's axis: the
      base's centre (eq. 11) or, for a contact between the bases, the corresponding point between
      their centres. ``None`` for all other contacts.
    - `offset`: (N, 3) m, vector from the bearing's centre to this point, in the bearing's frame:
      two components across its axis, then the one along it. ``None`` without an `eccentricity`.
    - `normal_force`: (N,) N, magnitude.
    - `friction_force`: (N, 3) N, on the journal, in global axes; ``None`` without a friction law.
    - `normal`: (N, 3), unit vector in global axes, the direction in which the second body
      penetrates the first; for a base of a journal, from the bearing's axis to the contact.
    - `point_on_bearing`, `point_on_journal`: (N, 3) m, global positions of the two nearest points.
    """

    penetration: Numbers = described("m", "penetration, negative in flight")
    penetration_rate: Numbers = described("m/s", "rate of the penetration")
    eccentricity: Numbers | None = described(
        "m", "distance of the base's centre from the bearing's axis"
    )
    offset: Vectors | None = described("m", "the base's centre in the bearing's frame")
    normal_force: Numbers = described("N", "normal force")
    friction_force: Vectors | None = described("N", "friction force on the journal, global")
    normal: Vectors = described("1", "direction from bearing axis to contact, global")
    point_on_bearing: Vectors = described("m", "contact point on the bearing, global")
    point_on_journal: Vectors = described("m", "contact point on the journal, global")


class Load(eqx.Module):
    """Reaction of an ideal joint on one of its bodies at N times: `force`, (N, 3) N, in global
    axes, and `moment`, (N, 3) N m, about the body's centre of mass, in body axes."""

    force: Vectors = described("N", "force of an ideal joint on a body, global")
    moment: Vectors = described("N m", "its moment about the centre of mass, body axes")


class AccelerationSeries(eqx.Module):
    """Acceleration of a body at N times: `linear`, (N, 3) m/s^2, of the centre of mass, in global
    axes, and `angular`, (N, 3) rad/s^2, the time derivative of the spin, in body axes."""

    linear: Vectors = described("m/s^2", "of the centre of mass, global")
    angular: Vectors = described("rad/s^2", "of the body, body axes")


class Observation(eqx.Module, AbstractTabular):
    """Contacts, reactions, accelerations, constraint drift and energies of a motion at N times.

    - `times`: (N,) s.
    - `contacts[joint][contact]`: penetration, forces and positions; `help` of an entry lists them.
    - `modes[joint]`: (N,) values of `MotionMode`, for each joint that has a journal.
    - `reactions[joint][body]`: the `force`, (N, 3) N in global axes, and the `moment`, (N, 3) N m
      about the body's centre of mass in body axes, that the constraints of a joint exert on each of
      its bodies except the ground (Flores et al. 2006, eq. 31). Ideal joints, drivers, and
      clearance joints that hold their journal axially have constraints.
    - `interpolated`: (N,), true at interpolated times (see `Trajectory`), or ``None``.
    - `reactions_unique`: whether the reactions are unique. If some constraints are redundant, they
      are not, and those of least norm are given.
    - `accelerations[body]`: `linear`, (N, 3) m/s^2, of the centre of mass in global axes, and
      `angular`, (N, 3) rad/s^2, in body axes.
    - `drift[joint]`: (N,), largest magnitude of the values of the joint's constraint equations,
      which are zero for an exact solution; in m, rad or without unit, as the equation.
    - `drift_rate[joint]`: (N,), the same for the time derivatives of these equations.
    - `energies[name]`: (N,) J. "kinetic", "gravity", "springs", "contacts" and "bristles" exist
      where the scene has them, and "mechanical" is their sum. With `Settings(ledger=True)`, there
      are also the energies dissipated since the start of the run, "normal damping", "friction",
      "film" and "stabilisation", and the energy "supplied" by drives and loads. If the run
      continues others, they count from the start of the earliest. "friction" does not contain the
      energy stored in bristles.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> solution = cj.simulate(scene, state, 0.02, save=cj.Saving(np.linspace(0, 0.02, 201)))
    >>> observed = cj.observe(scene, solution)
    >>> list(observed.energies)
    ['contacts', 'gravity', 'kinetic', 'mechanical']
    """

    times: Numbers
    contacts: dict[str, dict[str, ContactObservation]]
    modes: dict[str, Integers]
    reactions: dict[str, dict[str, Load]]
    accelerations: dict[str, AccelerationSeries]
    drift: dict[str, Numbers]
    drift_rate: dict[str, Numbers]
    energies: dict[str, Numbers]
    reactions_unique: bool = eqx.field(static=True)
    interpolated: Flags | None = None

    @override
    def __repr__(self) -> str:
        if np.ndim(self.times) != 1 or isinstance(self.times, Tracer) or not len(self.times):
            return eqx.tree_pformat(self)
        first, last = as_shown(np.asarray(self.times)[[0, -1]])
        lines = [f"Observation at {len(self.times)} instants from {first} s to {last} s"]
        for name in ("contacts", "reactions", "accelerations", "drift", "energies"):
            if part := getattr(self, name):
                lines.append(f"{name}: {', '.join(map(repr, part))}")
        return "\n  ".join(lines)

    @override
    def to_xarray(self) -> "xr.Dataset":
        """Return the observation as an `xarray.Dataset` with units.

        All variables are along "time", and vectors also along "component". The dimension between is

        - "contact", with labels such as "pin V", for `contacts`, NaN where a contact lacks a field;
        - "journal" for `mode` (values of `MotionMode`), and "joint" for `drift` and `drift_rate`;
        - "reaction", with labels such as "hinge on arm", for `reaction_force`, `reaction_moment`;
        - "body" for `acceleration` and `angular_acceleration`;
        - "energy_term" for `energy`.

        The attribute "comment" of the reactions says whether they are unique.
        """
        # Dictionaries of joints and contacts, or joints and bodies, become one dimension of labels.
        contacts = by_contact(self.contacts)
        reactions = {
            f"{joint} on {body}": load
            for joint, by_body in self.reactions.items()
            for body, load in by_body.items()
        }
        unique = "unique" if self.reactions_unique else "of least norm, since joints are redundant"
        modes = [np.asarray(mode, np.int8) for mode in self.modes.values()]
        flags = {
            "flag_values": np.array([mode.value for mode in MotionMode], np.int8),
            "flag_meanings": " ".join(mode.name.lower() for mode in MotionMode),
        }
        # For each variable: its second dimension, the series along it, unit, description and
        # further attributes.
        of_drift = "largest |Phi| of the joint, in m, rad or without unit"
        of_rate = "largest |rate of Phi| of the joint, in m/s, rad/s or 1/s"
        rows: dict[str, tuple[Any, ...]] = {
            **_rows_of(ContactObservation, contacts, CONTACTS),
            "mode": ("journal", modes, None, "mode of the journal", flags),
            **_rows_of(Load, reactions, "reaction", {"comment": unique}),
            **_rows_of(AccelerationSeries, self.accelerations, "body"),
            # Equations of one joint have different units, so that drift has no unit of its own.
            "drift": ("joint", [*self.drift.values()], None, of_drift),
            "drift_rate": ("joint", [*self.drift_rate.values()], None, of_rate),
            "energy": ("energy_term", [*self.energies.values()], "J", "energies and their ledger"),
        }
        # A variable is left out if the scene has no element with such a series.
        variables = {
            name: _stacked(dim, series, *rest)
            for name, (dim, series, *rest) in rows.items()
            if any(numbers is not None for numbers in series)
        }
        labels = {
            CONTACTS: contacts,
            "journal": self.modes,
            "reaction": reactions,
            "body": self.accelerations,
            "joint": self.drift,
            "energy_term": self.energies,
            **LABELS,
        }
        # A scene without contacts, for example, has no variable along "contact", and needs no
        # labels for it.
        used = {dim for variable in variables.values() for dim in variable.dims}
        coordinates = {d: Labelled((d,), texts([*own])) for d, own in labels.items() if d in used}
        times = {"time": Labelled(("time",), self.times, "s", "time")}
        return labelled_dataset("observation of a motion", variables, {**times, **coordinates})

    def ledger_residual(self) -> Numbers:
        """Return the energy that the ledger does not explain, (N,) J, a measure of the run's error.

        This is the change, since the first time, of the mechanical plus the dissipated energy less
        the supplied one, and zero for an exact solution. Without the ledger, it is the change of
        the mechanical energy. At `interpolated` times, whose states are less accurate, the result
        is interpolated between the other times; if there are none, it has these states' error.
        """
        losses = ("normal damping", "friction", "film", "stabilisation")
        dissipated = sum(self.energies.get(name, 0.0) for name in losses)
        balance = self.energies["mechanical"] + dissipated - self.energies.get("supplied", 0.0)
        if self.interpolated is not None and not np.all(self.interpolated):
            # The balance of interpolated states would be off by far more than the run's error.
            ends = ~np.asarray(self.interpolated)
            balance = np.interp(self.times, self.times[ends], np.asarray(balance)[ends])
        return balance - balance[:1]


def _rows_of(
    kind: type[eqx.Module], parts: Mapping[str, PyTree], dim: str, *attributes: Mapping[str, object]
) -> dict[str, tuple[Any, ...]]:
    """Return the arguments of `_stacked` for each field of the class `kind`, by name of the field's
    variable in the dataset. `parts`: objects of the class, one for each label along `dim`;
    `attributes`: none, or one dictionary of further attributes, which all these variables get."""
    rows = {}
    for f in fields(kind):
        series = [getattr(part, f.name) for part in parts.values()]
        rows[VARIABLES.get(f.name, f.name)] = dim, series, *f.metadata.values(), *attributes
    return rows


def _stacked(
    dim: str,
    series: Sequence[Numbers | Vectors | None],
    unit: str | None,
    text: str,
    attributes: Mapping[str, object] = {},
) -> Labelled:
    """Return K series at N times as one variable, (N, K), or (N, K, 3) for vectors, with the second
    dimension `dim` and the description `text`. A series ``None`` becomes NaN; not all may be."""
    # All series have the shape of any that is not ``None``.
    shape = next(np.shape(row) for row in series if row is not None)
    lacking = np.full(shape, np.nan)
    values = np.stack([lacking if row is None else np.asarray(row) for row in series], 1)
    return Labelled(("time", dim, COMPONENT)[: values.ndim], values, unit, text, attributes)


CHUNK = 512
"""Number of states in each call of a compiled program, so that one program serves any number of
states. With fewer, there would be more calls; with more, more states to fill up the last call."""


def observe(
    scene: Scene, solution: Solution | NonsmoothSolution, trajectory: Trajectory | None = None
) -> Observation:
    """Compute contacts, reactions, accelerations, drift and energies along a solution.

    The equations of motion are solved again at each state, always in absolute coordinates: there
    every ideal joint has constraint equations, whose Lagrange multipliers give its reactions. The
    reactions of redundant joints therefore do not depend on the coordinates of the run.

    **Arguments:**

    - `scene`: the scene that was simulated.
    - `solution`: the result of `simulate` or `simulate_nonsmooth`. With `simulate_nonsmooth`, rigid
      contacts have impulses instead of forces, so that the contact forces, accelerations and
      reactions computed here are meaningless while a contact touches.
    - `trajectory`: the N times and states to observe, such as `solution.steps` for every accepted
      step; by default the saved states, `solution.saved`.

    **Returns:** an `Observation` of NumPy arrays.

    **Raises:** `ValueError` for a `solution` of another type, or without states to observe.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> solution = cj.simulate(scene, state, 0.02, save=cj.Saving(np.linspace(0, 0.02, 201)))
    >>> observed = cj.observe(scene, solution)
    >>> print(f"{observed.contacts['shoulder']['V'].eccentricity.max() * 1e3:.2f} mm")
    0.51 mm
    """
    require_scene(scene)
    # Both types of solutions have a formulation.
    kind, is_solution = type(solution).__name__, hasattr(solution, "formulation")
    require(is_solution, "solution", kind, "a Solution", "pass what simulate(scene, ...) returned")
    trajectory = solution.saved if trajectory is None else trajectory
    expected, shown = "one with states to observe", "without saved states"
    remedy = "pass save=Saving(times) or Saving(steps=True) to simulate()"
    require(trajectory is not None, "solution", shown, expected, remedy)
    assert trajectory is not None
    require_type("trajectory", trajectory, Trajectory, "a Trajectory", "pass solution.steps, say")
    in_motion, in_scene = sorted(trajectory.states.bodies), sorted(scene.bodies)
    expected, remedy = f"of the scene's bodies {in_scene}", "pass the scene that was simulated"
    require(in_motion == in_scene, "solution", in_motion, expected, remedy)
    # All but the energy ledger follows from each state alone. The ledger holds integrals over the
    # run (`work`), so it is left out here and its entries are added at the end.
    states = trajectory.states
    alone = State(
        states.bodies, states.entry_speeds, bristles=states.bristles, memory=states.memory
    )
    observation = _along(scene, solution, _observed, trajectory.times, alone)
    integrals = {name: np.asarray(integral) for name, integral in states.work.items()}
    if "friction" in integrals:
        # The ledger counts the elastic energy of bristles as dissipated by friction until they
        # release it. The observation has it as "bristles", so it is not counted a second time.
        elastic = observation.energies.get("bristles", 0.0)
        integrals["friction"] = integrals["friction"] - elastic
    return replace(
        observation,
        energies={**observation.energies, **integrals},
        reactions_unique=not solution.redundant_constraints,
        interpolated=trajectory.interpolated,
    )


def _observed(now: Instant) -> Observation:
    """Quantity: the observation at an instant in absolute coordinates, without the energy ledger.
    `observe` sets `reactions_unique`, which is not known here."""
    dynamics, scene = now.dynamics, now.scene
    motions, forces = dynamics.motions, dynamics.contact_forces
    energies = mechanical_energy(scene, motions, now.time)
    if (elastic := bristle_energy(scene, motions, forces, now.bristles)) is not None:
        energies["bristles"] = elastic
    # The sum is taken before the integrals of the ledger are added, in `observe`.
    energies["mechanical"] = sum(energies.values())
    drift, drift_rate = _drift(dynamics)
    accelerations = {
        name: AccelerationSeries(pack(part.linear), pack(part.angular))
        for name, part in dynamics.accelerations.items()
    }
    reactions = {
        joint: {
            body: Load(pack(wrench.force), pack(wrench.moment))
            for body, wrench in constraint_wrenches(dynamics, joint).items()
            if body != GROUND
        }
        for joint in dynamics.rows
    }
    return Observation(
        times=now.time,
        contacts=_contacts(scene, dynamics),
        modes=_modes(scene, dynamics),
        reactions=reactions,
        accelerations=accelerations,
        drift=drift,
        drift_rate=drift_rate,
        energies=energies,
        reactions_unique=False,
    )


def _contacts(scene: Scene, dynamics: Dynamics) -> dict[str, dict[str, ContactObservation]]:
    observations: dict[str, dict[str, ContactObservation]] = {}
    for name, family in dynamics.contact_forces.items():
        joint = scene.contact_joints()[name]
        first, second = (dynamics.motions[body] for body in joint.pair())
        observations[name] = {}
        # Only contacts at the bases, and at points between them, belong to a point of the journal's
        # axis, whose offset from the bearing is observed. Others, such as shoulders, have none.
        on_axis = axial_positions(family) if isinstance(joint, HasJournal) else {}
        for label, force in family.items():
            contact = force.contact
            eccentricity = offset = None
            if isinstance(joint, HasJournal) and label in on_axis:
                # In the frame of the bearing z is along the axis, so x and y are the eccentricity.
                across = joint.journal_offset(dynamics.motions, label)
                eccentricity = norm_and_direction(Vector(across.x, across.y, 0.0))[0]
                offset = pack(across)
            observations[name][label] = ContactObservation(
                penetration=contact.gap.depth,
                penetration_rate=contact.gap.rate,
                eccentricity=eccentricity,
                offset=offset,
                normal_force=force.normal_force,
                friction_force=None if force.friction is None else pack(force.friction),
                normal=pack(contact.normal),
                point_on_bearing=pack(first.point(contact.arm_first)),
                point_on_journal=pack(second.point(contact.arm_second)),
            )
    return observations


def _modes(scene: Scene, dynamics: Dynamics) -> dict[str, Integers]:
    modes = {}
    for name, joint in scene.joints.items():
        if isinstance(joint, HasJournal):
            v, w = (dynamics.contact_forces[name][base].contact for base in BASES)
            touches_v, touches_w = v.gap.depth > 0.0, w.gap.depth > 0.0
            # If the normals at both bases point to the same side, the journal lies along a line of
            # the wall; otherwise it is tilted from one side to the other.
            if_both_touch = jnp.where(
                v.normal.dot(w.normal) > 0.0, MotionMode.LINE_CONTACT, MotionMode.OPPOSITE_SIDES
            )
            otherwise = jnp.where(
                touches_v | touches_w, MotionMode.ONE_BASE, MotionMode.FREE_FLIGHT
            )
            modes[name] = jnp.where(touches_v & touches_w, if_both_touch, otherwise)
    return modes


def _drift(dynamics: Dynamics) -> tuple[dict[str, Scalar], dict[str, Scalar]]:
    """Return by joint the largest magnitude of its constraint equations, and of their rates."""

    def largest(values: list[Scalar]) -> Scalar:
        return jnp.max(jnp.abs(jnp.stack([jnp.asarray(value) for value in values])))

    values, rates = {}, {}
    for name, rows in dynamics.rows.items():
        values[name] = largest([row.value for row in rows.values()])
        rates[name] = largest([row_rate(row, dynamics.motions) for row in rows.values()])
    return values, rates


def values_along(
    scene: Scene,
    solution: Solution,
    quantity: Quantity,
    trajectory: Trajectory,
    rates: bool = False,
) -> np.ndarray:
    """Return the values of a quantity at the N states of a trajectory, (N,); with `rates` their
    total time derivatives, for which entry speeds, bristles, memories and the energy ledger count
    as constant. Raise a `ValueError` if the scene lacks an element that the quantity names."""
    check_quantity("quantity", quantity, scene)
    values = _along(scene, solution, quantity, trajectory.times, trajectory.states, rates)
    return np.asarray(values, float)


def _along(
    scene: Scene,
    solution: Solution | NonsmoothSolution,
    quantity: Callable[[Instant], Result],
    times: Numbers,
    states: State,
    rates: bool = False,
) -> Result:
    """Return the results of `quantity` at N times and states, in absolute coordinates, as one
    PyTree, whose arrays have a first axis of length N; with `rates`, their time derivatives."""
    used = solution.formulation
    absolute = Formulation(AbsoluteCoordinates(), used.stabilisation, used.redundant)
    # The program is compiled for the exact zeros and ones of the scene, which need no operations.
    fixed = fold_constants(with_arrays(scene)), absolute, quantity, rates
    count, rows = len(times), jax.tree.map(np.asarray, (times, states))

    def chunk(rows: np.ndarray, first: int) -> np.ndarray:
        # Repeats rows to fill up the last chunk; makes zeros if there is no row at all.
        return np.resize(rows[first : first + CHUNK], (CHUNK, *rows.shape[1:]))

    chunks = []
    # Without states there is one chunk, from which the structure of the empty result follows.
    for first in range(0, max(count, 1), CHUNK):
        times_and_states = jax.tree.map(lambda leaf, first=first: chunk(leaf, first), rows)
        count_in_chunk = np.asarray(min(CHUNK, count - first))
        results = _along_compiled(*fixed, count_in_chunk, *times_and_states)
        chunks.append(jax.device_get(results))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[:count], *chunks)


# If native code cannot be made, XLA compiles this function. No warning is issued then, because it
# takes little time compared with a run.
@partial(Native, warns=False)
def _along_compiled(
    folded_scene: ConstantFolded,
    absolute: Formulation,
    quantity: Callable[[Instant], Result],
    rates: bool,
    count: Scalar,
    times: Numbers,
    states: State,
) -> Result:
    """Return the results of `quantity` or, with `rates`, their time derivatives, as in `_along`, at
    N times and states. Only those of the first `count` have a meaning."""
    system = System(unpack(folded_scene), absolute)

    def at(t: Scalar, state: State) -> Result:
        variables = system.encode(unpack(state.bodies))
        # The deflections of bristles are those of the state, and zero for contacts without any.
        bristles = initial_bristles(system.scene, unpack(state.bristles))
        memory = initial_memories(system, variables, t, state.memory)

        def value(t: Scalar, variables: MotionVariables) -> Result:
            parts = state.entry_speeds, unpack(state.work), bristles, memory
            return quantity(Instant(system, t, variables, *parts))

        if not rates:
            return jax.tree.map(jnp.asarray, value(t, variables))
        # In `held`, sampled forces keep their present memory, which counts as constant in time.
        held = holding(system, memory)
        speeds, _ = held.rates(variables, state.entry_speeds, t, bristles=bristles)
        # The direction of the derivative is that of the motion: time advances at the rate 1, and
        # the variables at their rates. `jax.jvp` demands floats, but components may be Python
        # numbers.
        as_floats = partial(jax.tree.map, partial(jnp.asarray, dtype=float))
        point, along = as_floats(((t, variables), (1.0, speeds)))
        return jax.jvp(lambda *now: as_floats(value(*now)), point, along)[1]

    return over_rows(at, count, times, states)
