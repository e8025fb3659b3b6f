"""What an engineer looks at: contacts, modes, reactions, accelerations, drift and energies."""

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
"""Instants that are observed at once."""


class ContactObservation(eqx.Module):
    """One contact over time; arrays with the times in front.

    - `penetration` m and `penetration_rate` m/s (eqs 13 and 21); `eccentricity` m (eq. 11; ``None``
      for a shoulder), and `offset`, (N, 3) m, the base's centre in the bearing's own frame, which
      moves with it: across its axis and along it (``None`` likewise).
    - `normal_force` N; `friction_force` (N, 3) on the journal, global, N, or ``None``.
    - `normal`: (N, 3) from bearing axis to contact; `point_on_bearing`, `point_on_journal`: (N, 3)
      global, m.
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
    """What an ideal joint does to a body.

    `force`: (N, 3) global, N; `moment`: (N, 3) about the centre of mass, in body axes, N m.
    """

    force: Vectors
    moment: Vectors


class AccelerationSeries(eqx.Module):
    """Acceleration of a body over time.

    `linear`: (N, 3) of the centre of mass, global, m/s^2; `angular`: (N, 3) of the spin, body axes,
    rad/s^2.
    """

    linear: Vectors
    angular: Vectors


class Observation(eqx.Module, AbstractTabular):
    """Everything observed along a trajectory.

    - `times`: (N,) s.
    - `contacts[joint][contact]`: `ContactObservation`.
    - `modes[joint]`: (N,) `MotionMode` numbers of the clearance joints.
    - `reactions[joint][body]`: `Load` of the ideal joints (eq. 31). Not unique, and then of least
      norm, if the solution names redundant constraints; see `reactions_unique`.
    - `accelerations[body]`: `AccelerationSeries`.
    - `drift[joint]`, `drift_rate[joint]`: (N,) largest |Phi| and |rate of Phi| of the joint's rows.
    - `energies[name]`: (N,) J: "kinetic", "gravity", "springs", "contacts", "bristles" as far as
      the scene has them, their sum "mechanical", and of the ledger, if it was kept, the integrals
      "normal damping", "friction", "film", "stabilisation" (dissipated) and "supplied". What
      bristles hold, and so would give back, is no part of "friction".

    `to_xarray`, `to_dataframe`, `to_csv` and `to_netcdf` give all of it with units.

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
        """How many instants from when to when, and of which elements, in a few lines."""
        if np.ndim(self.times) != 1 or isinstance(self.times, Tracer) or not len(self.times):
            return eqx.tree_pformat(self)
        first, last = as_shown(np.asarray(self.times)[[0, -1]])
        lines = [f"Observation at {len(self.times)} instants from {first} s to {last} s"]
        for name in ("contacts", "reactions", "accelerations", "drift", "energies"):
            if part := getattr(self, name):
                lines.append(f"{name}: {', '.join(map(repr, part))}")
        return "\n  ".join(lines)

    def to_xarray(self) -> "xr.Dataset":
        """An `xarray.Dataset` along "time", with units: `penetration`, `normal_force` and so on
        along "contact", such as "pin V"; `mode`, codes of `MotionMode`, and `drift` along joints;
        `reaction_force` and `reaction_moment` along "reaction", such as "hinge on arm";
        `acceleration` and `angular_acceleration` along "body"; `energy` along "energy_term". What a
        contact lacks is NaN. See `AbstractTabular`.
        """
        parts = {part.name: getattr(self, part.name) for part in fields(self)}
        return observation_dataset(Observed(**parts))

    def ledger_residual(self) -> Numbers:
        """What the energy ledger does not account for since the first instant, (N,) J."""
        losses = ("normal damping", "friction", "film", "stabilisation")
        dissipated = sum(self.energies.get(name, 0.0) for name in losses)
        balance = self.energies["mechanical"] + dissipated - self.energies.get("supplied", 0.0)
        return balance - balance[0]


def observe(
    scene: Scene,
    solution: Solution | NonsmoothSolution,
    trajectory: Trajectory | None = None,
) -> Observation:
    """Observe a scene along a solution.

    In absolute coordinates whatever the run had: there every ideal joint has its multipliers, those
    that the run eliminated too, and redundant reactions do not depend on the run's coordinates.

    **Arguments:** `scene`: the one that was simulated. `trajectory`: `solution.steps`, say, for
    every accepted step; the saved states unless given.

    **Returns:** an `Observation` of numpy arrays.

    >>> scene, state = cj.mechanisms.double_pendulum()
    >>> solution = cj.simulate(scene, state, 0.02, save=cj.Saving(np.linspace(0, 0.02, 201)))
    >>> observed = cj.observe(scene, solution)
    >>> print(f"{observed.contacts['shoulder']['V'].eccentricity.max() * 1e3:.2f} mm")
    0.51 mm
    """
    kind, fine = type(solution).__name__, hasattr(solution, "formulation")
    require(fine, "solution", kind, "a Solution", "pass what simulate(scene, ...) returned")
    trajectory = solution.saved if trajectory is None else trajectory
    require(
        trajectory is not None,
        "solution",
        "without saved states",
        "one with states to observe",
        "pass save=Saving(times) or Saving(steps=True) to simulate()",
    )
    assert trajectory is not None
    ran, states = solution.formulation, trajectory.states
    absolute = Formulation(AbsoluteCoordinates(), ran.stabilisation, ran.redundant)
    rows = (
        np.asarray(trajectory.times),
        State(states.bodies, states.entry_speeds, bristles=states.bristles),
    )
    folded_scene, unique = fold_constants(with_arrays(scene)), not solution.redundant_constraints
    observation = in_chunks(
        lambda part: observe_compiled(folded_scene, absolute, unique, *part), rows
    )
    integrals = {name: np.asarray(integral) for name, integral in states.work.items()}
    if "friction" in integrals:
        held = observation.energies.get("bristles", 0.0)
        integrals["friction"] = integrals["friction"] - held
    return replace(observation, energies={**observation.energies, **integrals})


def in_chunks(
    look: Callable[[tuple[np.ndarray, State]], Parts], rows: tuple[np.ndarray, State]
) -> Parts:
    """What is observed of each row (numpy): of a fixed number at a time, so that their number
    compiles nothing."""
    count, rows = len(rows[0]), jax.tree.map(np.asarray, rows)
    parts = []
    for first in range(0, max(count, 1), CHUNK):
        part = jax.tree.map(lambda leaf, k=first: _filled(leaf[k : k + CHUNK]), rows)
        parts.append(jax.device_get(look(part)))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[:count], *parts)


def _filled(rows: np.ndarray) -> np.ndarray:
    """The rows, repeated until they are `CHUNK` of them; zeros if there are none."""
    return np.resize(rows, (CHUNK, *rows.shape[1:]))


@partial(Native, warns=False)
def observe_compiled(
    folded_scene: ConstantFolded, absolute: Formulation, unique: bool, times: Numbers, states: State
) -> Observation:
    """What there is to observe at times (N,) s, with N in front, in absolute coordinates; without
    the ledger's integrals, which states hold."""
    scene = unpack(folded_scene)
    system = System(scene, absolute)

    def at(t: Scalar, state: State) -> Observation:
        bristles = initial_bristles(scene, unpack(state.bristles))
        variables = system.encode(unpack(state.bodies))
        dynamics = system.dynamics(variables, state.entry_speeds, t, bristles=bristles)
        motions, forces = dynamics.motions, dynamics.contact_forces
        energies = mechanical_energy(scene, motions, t)
        if (held := bristle_energy(scene, motions, forces, bristles)) is not None:
            energies["bristles"] = held
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
