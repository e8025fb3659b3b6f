"""Contacts, reactions, accelerations, constraint drift and energies, computed from a solution."""

from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial
from typing import TYPE_CHECKING, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from ...dynamics.absolute_coordinates import AbsoluteCoordinates
from ...dynamics.bristles import initial_bristles
from ...dynamics.energy import bristle_energy, mechanical_energy
from ...dynamics.equations_of_motion import Dynamics
from ...dynamics.formulation import Formulation
from ...dynamics.multipliers import row_rate
from ...dynamics.system import System
from ...export.tabular import AbstractTabular
from ...fields.checks import as_shown, require
from ...fields.conversion import with_arrays
from ...math.vectors import ConstantFolded, Scalar, Vector, fold_constants, pack, unpack
from ...model.bodies import GROUND, NO_WRENCH, State, Wrench
from ...model.clearance_joints.journal_bases import BASES, HasJournal
from ...model.scene import Scene
from ...native import Native, over_rows
from ..step.types import Integers, Numbers, Vectors
from .motion_modes import MotionMode
from .nonsmooth_solution import NonsmoothSolution
from .observation_tables import Observed, observation_dataset
from .solution import Solution, Trajectory

if TYPE_CHECKING:
    import xarray as xr

Parts = TypeVar("Parts")
CHUNK = 512
"""Number of states that one call of the compiled program observes."""


class ContactObservation(eqx.Module):
    """One contact of a clearance joint at N times.

    - `penetration`: (N,) m, negative where the surfaces are apart (eq. 13).
    - `penetration_rate`: (N,) m/s, positive while the surfaces approach (eq. 21).
    - `eccentricity`: (N,) m (eq. 11). ``None`` for contacts that aren't bases of a journal.
    - `offset`: (N, 3) m, the centre of the base in the frame of the bearing: two components across
      the bearing's axis, then the one along it. ``None`` for contacts that aren't bases.
    - `normal_force`: (N,) N, magnitude.
    - `friction_force`: (N, 3) N, on the journal, global. ``None`` for contacts without friction.
    - `normal`: (N, 3), unit vector from the bearing's axis to the contact, global.
    - `point_on_bearing`, `point_on_journal`: (N, 3) m, points of the two surfaces, global.
    """

    penetration: Numbers
    penetration_rate: Numbers
    eccentricity: Numbers | None
    offset: Vectors | None
    normal_force: Numbers
    friction_force: Vectors | None
    normal: Vectors
    point_on_bearing: Vectors
    point_on_journal: Vectors


class Load(eqx.Module):
    """Reaction of an ideal joint on one of its bodies at N times.

    - `force`: (N, 3) N, global.
    - `moment`: (N, 3) N m, about the body's centre of mass, in body axes.
    """

    force: Vectors
    moment: Vectors


class AccelerationSeries(eqx.Module):
    """Acceleration of a body at N times.

    - `linear`: (N, 3) m/s^2, of the centre of mass, global.
    - `angular`: (N, 3) rad/s^2, time derivative of the spin, in body axes.
    """

    linear: Vectors
    angular: Vectors


class Observation(eqx.Module, AbstractTabular):
    """Contacts, reactions, accelerations, constraint drift and energies of a motion at N times.

    Keys are the names of the scene's joints and bodies, and the labels of contacts, such as "V".

    - `times`: (N,) s.
    - `contacts[joint][contact]`: a `ContactObservation`.
    - `modes[joint]`: (N,) values of `MotionMode`, for each joint that has a journal.
    - `reactions[joint][body]`: the `Load` of an ideal joint on a body (eq. 31).
    - `reactions_unique`: whether no constraints are redundant. Otherwise the reactions are not
      unique, and those of least norm are given.
    - `accelerations[body]`: an `AccelerationSeries`.
    - `drift[joint]`: (N,), largest magnitude of the joint's constraint rows, in m, or 1 for rows
      that constrain directions. It is zero for an exact solution.
    - `drift_rate[joint]`: (N,), largest magnitude of the time derivatives of these rows.
    - `energies[name]`: (N,) J. "kinetic", "gravity", "springs", "contacts" and "bristles" exist
      where the scene has them; "mechanical" is their sum. If the run kept the energy ledger, there
      are its integrals since the start too: "normal damping", "friction", "film" and
      "stabilisation", dissipated, and "supplied". The elastic energy of bristles is not part of
      "friction".

    `to_xarray`, `to_dataframe`, `to_csv` and `to_netcdf` export all fields with their units.

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

    def __repr__(self) -> str:
        """Return text: the number of times, the first and last time, and the names of elements."""
        if np.ndim(self.times) != 1 or isinstance(self.times, Tracer) or not len(self.times):
            return eqx.tree_pformat(self)
        first, last = as_shown(np.asarray(self.times)[[0, -1]])
        lines = [f"Observation at {len(self.times)} instants from {first} s to {last} s"]
        for name in ("contacts", "reactions", "accelerations", "drift", "energies"):
            if part := getattr(self, name):
                lines.append(f"{name}: {', '.join(map(repr, part))}")
        return "\n  ".join(lines)

    def to_xarray(self) -> "xr.Dataset":
        """Return the observation as an `xarray.Dataset` with units.

        All variables have the dimension "time", and vectors have "component" ("x", "y", "z") last.
        The second dimension is

        - "contact", with labels such as "pin V", for `penetration`, `normal_force` and the other
          fields of `ContactObservation`. A contact without such a field has NaN there;
        - "journal" for `mode` (values of `MotionMode`), and "joint" for `drift` and `drift_rate`;
        - "reaction", with labels such as "hinge on arm", for `reaction_force`, `reaction_moment`;
        - "body" for `acceleration` and `angular_acceleration`;
        - "energy_term" for `energy`.

        See `AbstractTabular` for the export to other formats.
        """
        parts = {part.name: getattr(self, part.name) for part in fields(self)}
        return observation_dataset(Observed(**parts))

    def ledger_residual(self) -> Numbers:
        """Return the energy that the ledger does not explain, (N,) J, a measure of the run's error.

        It is the mechanical plus the dissipated less the supplied energy, less the value of this
        sum at the first time. An exact solution of a run with the ledger has zero.
        """
        losses = ("normal damping", "friction", "film", "stabilisation")
        dissipated = sum(self.energies.get(name, 0.0) for name in losses)
        balance = self.energies["mechanical"] + dissipated - self.energies.get("supplied", 0.0)
        return balance - balance[0]


def observe(
    scene: Scene,
    solution: Solution | NonsmoothSolution,
    trajectory: Trajectory | None = None,
) -> Observation:
    """Compute contacts, reactions, accelerations, drift and energies along a solution.

    The equations of motion are solved again at each state, always in absolute coordinates. In these
    every ideal joint has Lagrange multipliers, from which its reactions follow, also a joint that
    the coordinates of the run eliminated. So redundant reactions don't depend on those coordinates.

    **Arguments:**

    - `scene`: the scene that was simulated.
    - `solution`: the result of `simulate` or `simulate_nonsmooth`.
    - `trajectory`: the N times and states to observe, such as `solution.steps` for every accepted
      step; by default the saved states, `solution.saved`.

    **Returns:** an `Observation` of NumPy arrays, whose first axis has the length N.

    **Raises:** `ValueError` if `solution` is of another type, and if neither `trajectory` is given
    nor states were saved.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> solution = cj.simulate(scene, state, 0.02, save=cj.Saving(np.linspace(0, 0.02, 201)))
    >>> observed = cj.observe(scene, solution)
    >>> print(f"{observed.contacts['shoulder']['V'].eccentricity.max() * 1e3:.2f} mm")
    0.51 mm
    """
    kind, is_solution = type(solution).__name__, hasattr(solution, "formulation")
    require(is_solution, "solution", kind, "a Solution", "pass what simulate(scene, ...) returned")
    trajectory = solution.saved if trajectory is None else trajectory
    require(
        trajectory is not None,
        "solution",
        "without saved states",
        "one with states to observe",
        "pass save=Saving(times) or Saving(steps=True) to simulate()",
    )
    assert trajectory is not None
    used, states = solution.formulation, trajectory.states
    absolute = Formulation(AbsoluteCoordinates(), used.stabilisation, used.redundant)
    # All but the energy ledger follows from each state alone. The ledger holds integrals over the
    # run (`work`), so it is left out here and its entries are added at the end.
    times_and_states = (
        np.asarray(trajectory.times),
        State(states.bodies, states.entry_speeds, bristles=states.bristles),
    )
    # The program is compiled for the exact zeros and ones of the scene, which need no operations.
    folded_scene, unique = fold_constants(with_arrays(scene)), not solution.redundant_constraints
    observation = in_chunks(
        lambda part: observe_compiled(folded_scene, absolute, unique, *part), times_and_states
    )
    integrals = {name: np.asarray(integral) for name, integral in states.work.items()}
    if "friction" in integrals:
        # The ledger counts the elastic energy of bristles as dissipated by friction until they
        # release it. The observation has it as "bristles", so it is not counted a second time.
        elastic = observation.energies.get("bristles", 0.0)
        integrals["friction"] = integrals["friction"] - elastic
    return replace(observation, energies={**observation.energies, **integrals})


def in_chunks(
    look: Callable[[tuple[np.ndarray, State]], Parts], rows: tuple[np.ndarray, State]
) -> Parts:
    """Apply a compiled program to N times and states, `CHUNK` of them in each call.

    The arguments of the program always have the same shapes, so that a different number N does not
    compile the program again.

    **Arguments:** `look`: the program, a function of `CHUNK` times and states, whose results have
    a first axis of length `CHUNK`; `rows`: times, (N,) s, and states whose leaves have a first axis
    of length N.

    **Returns:** the results of all calls as NumPy arrays, joined to a first axis of length N.
    """
    count, rows = len(rows[0]), jax.tree.map(np.asarray, rows)
    parts = []
    for first in range(0, max(count, 1), CHUNK):
        part = jax.tree.map(lambda leaf, k=first: _filled(leaf[k : k + CHUNK]), rows)
        parts.append(jax.device_get(look(part)))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[:count], *parts)


def _filled(rows: np.ndarray) -> np.ndarray:
    """Return an array of `CHUNK` rows: the given rows, repeated as needed, or zeros without any."""
    return np.resize(rows, (CHUNK, *rows.shape[1:]))


@partial(Native, warns=False)
def observe_compiled(
    folded_scene: ConstantFolded, absolute: Formulation, unique: bool, times: Numbers, states: State
) -> Observation:
    """Return the observation at given times and states, without the integrals of the energy ledger.

    **Arguments:** `absolute`: the formulation in absolute coordinates; `unique`: the value of
    `Observation.reactions_unique`; `times`: (N,) s; `states`: in packed form, leaves with a first
    axis of length N.
    """
    scene = unpack(folded_scene)
    system = System(scene, absolute)

    def at(t: Scalar, state: State) -> Observation:
        """Return the observation at one time t, s; its arrays have no axis of times."""
        # Keeps the deflections of the state; contacts without one get zero.
        bristles = initial_bristles(scene, unpack(state.bristles))
        variables = system.encode(unpack(state.bodies))
        dynamics = system.dynamics(variables, state.entry_speeds, t, bristles=bristles)
        motions, forces = dynamics.motions, dynamics.contact_forces
        energies = mechanical_energy(scene, motions, t)
        if (elastic := bristle_energy(scene, motions, forces, bristles)) is not None:
            energies["bristles"] = elastic
        energies["mechanical"] = sum(energies.values())
        drift, drift_rate = _drift(dynamics)
        accelerations = {
            name: AccelerationSeries(pack(part.linear), pack(part.angular))
            for name, part in dynamics.accelerations.items()
        }
        observation = Observation(
            times=t,
            contacts=_contacts(scene, dynamics),
            modes=_modes(scene, dynamics),
            reactions=_reactions(dynamics),
            accelerations=accelerations,
            drift=drift,
            drift_rate=drift_rate,
            energies=energies,
            reactions_unique=unique,
        )
        return jax.tree.map(jnp.asarray, observation)

    return over_rows(at, times, states)


def _contacts(scene: Scene, dynamics: Dynamics) -> dict[str, dict[str, ContactObservation]]:
    observations: dict[str, dict[str, ContactObservation]] = {}
    for name, family in dynamics.contact_forces.items():
        joint = scene.contact_joints()[name]
        first, second = joint.pair()
        observations[name] = {}
        for label, force in family.items():
            gap = force.contact.gap
            eccentricity = offset = None
            if isinstance(joint, HasJournal) and label in BASES:
                eccentricity = gap.depth + joint.clearance
                offset = pack(joint.journal_offset(dynamics.motions, label))
            observations[name][label] = ContactObservation(
                penetration=gap.depth,
                penetration_rate=gap.rate,
                eccentricity=eccentricity,
                offset=offset,
                normal_force=force.normal_force,
                friction_force=None if force.friction is None else pack(force.friction),
                normal=pack(force.contact.normal),
                point_on_bearing=pack(dynamics.motions[first].point(force.contact.arm_first)),
                point_on_journal=pack(dynamics.motions[second].point(force.contact.arm_second)),
            )
    return observations


def _modes(scene: Scene, dynamics: Dynamics) -> dict[str, Integers]:
    modes = {}
    for name, joint in scene.joints.items():
        if isinstance(joint, HasJournal):
            v, w = (dynamics.contact_forces[name][base].contact for base in BASES)
            touching = (v.gap.depth > 0.0, w.gap.depth > 0.0)
            # Equal sides of the wall: the journal lies on a line; opposite sides: it is tilted.
            both = jnp.where(
                v.normal.dot(w.normal) > 0.0, MotionMode.LINE_CONTACT, MotionMode.OPPOSITE_SIDES
            )
            one = jnp.where(touching[0] | touching[1], MotionMode.ONE_BASE, MotionMode.FREE_FLIGHT)
            modes[name] = jnp.where(touching[0] & touching[1], both, one)
    return modes


def _reactions(dynamics: Dynamics) -> dict[str, dict[str, Load]]:
    reactions: dict[str, dict[str, Load]] = {}
    for name, rows in dynamics.rows.items():
        total: dict[str, Wrench] = {}
        for label, row in rows.items():
            multiplier = dynamics.multipliers[name][label]
            # A row's Jacobian is the wrench on each body for a multiplier of 1.
            for body, pair in row.jacobian.items():
                if body != GROUND:
                    scaled = Wrench(pair.force * multiplier, pair.moment * multiplier)
                    total[body] = total.get(body, NO_WRENCH) + scaled
        reactions[name] = {
            body: Load(_dense(wrench.force), _dense(wrench.moment))
            for body, wrench in total.items()
        }
    return reactions


def _dense(vector: Vector) -> Vectors:
    return jnp.stack([jnp.asarray(part, dtype=float) for part in (vector.x, vector.y, vector.z)])


def _drift(dynamics: Dynamics) -> tuple[dict[str, Scalar], dict[str, Scalar]]:
    def largest(values: list[Scalar]) -> Scalar:
        return jnp.max(jnp.abs(jnp.stack([jnp.asarray(value) for value in values])))

    values, rates = {}, {}
    for name, rows in dynamics.rows.items():
        values[name] = largest([row.value for row in rows.values()])
        rates[name] = largest([row_rate(row, dynamics.motions) for row in rows.values()])
    return values, rates
