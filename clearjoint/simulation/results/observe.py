"""Observation of a solution: contacts, modes, reactions, accelerations, drift and energies."""

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
"""Number of states in a call of the compiled program."""


class ContactObservation(eqx.Module):
    """One contact at N times.

    - `penetration` in m and `penetration_rate` in m/s (eqs 13 and 21).
    - `eccentricity` in m (eq. 11) and `offset`, (N, 3) m, the centre of the base in the frame of
      the bearing, across its axis and along it; both ``None`` for a shoulder.
    - `normal_force` in N; `friction_force`: (N, 3) N on the journal, global, or ``None``.
    - `normal`: (N, 3), from the bearing's axis to the contact; `point_on_bearing`,
      `point_on_journal`: (N, 3) m, global.
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
    """Reaction of an ideal joint on a body.

    `force`: (N, 3) global, N; `moment`: (N, 3) about the centre of mass, in body axes, N m.
    """

    force: Vectors
    moment: Vectors


class AccelerationSeries(eqx.Module):
    """Acceleration of a body at N times.

    `linear`: (N, 3) m/s^2, of the centre of mass, global; `angular`: (N, 3) rad/s^2, rate of the
    spin, body axes.
    """

    linear: Vectors
    angular: Vectors


class Observation(eqx.Module, AbstractTabular):
    """Observation of a motion at N times.

    - `times`: (N,) s.
    - `contacts[joint][contact]`: `ContactObservation`.
    - `modes[joint]`: (N,) `MotionMode` numbers of the clearance joints.
    - `reactions[joint][body]`: `Load` of the ideal joints (eq. 31). With redundant constraints they
      are not unique, and those of least norm are given; see `reactions_unique`.
    - `accelerations[body]`: `AccelerationSeries`.
    - `drift[joint]`, `drift_rate[joint]`: (N,) largest |Phi| and |rate of Phi| of the joint's rows.
    - `energies[name]`: (N,) J: "kinetic", "gravity", "springs", "contacts" and "bristles" if the
      scene has them, their sum "mechanical", and if the run kept the energy ledger the integrals
      "normal damping", "friction", "film", "stabilisation" (dissipated) and "supplied". The elastic
      energy of bristles is not part of "friction".

    `to_xarray`, `to_dataframe`, `to_csv` and `to_netcdf` export all of it with units.

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
        """Return a few lines: the number of times, the first and the last, and the elements."""
        if np.ndim(self.times) != 1 or isinstance(self.times, Tracer) or not len(self.times):
            return eqx.tree_pformat(self)
        first, last = as_shown(np.asarray(self.times)[[0, -1]])
        lines = [f"Observation at {len(self.times)} instants from {first} s to {last} s"]
        for name in ("contacts", "reactions", "accelerations", "drift", "energies"):
            if part := getattr(self, name):
                lines.append(f"{name}: {', '.join(map(repr, part))}")
        return "\n  ".join(lines)

    def to_xarray(self) -> "xr.Dataset":
        """Return an `xarray.Dataset` along "time", with units.

        - `penetration`, `normal_force` and so on along "contact", such as "pin V", NaN for contacts
          without them; `mode` (codes of `MotionMode`) along "journal"; `drift` along "joint".
        - `reaction_force` and `reaction_moment` along "reaction", such as "hinge on arm".
        - `acceleration` and `angular_acceleration` along "body"; `energy` along "energy_term".

        See `AbstractTabular`.
        """
        parts = {part.name: getattr(self, part.name) for part in fields(self)}
        return observation_dataset(Observed(**parts))

    def ledger_residual(self) -> Numbers:
        """Return the energy since the first time that the ledger does not explain, (N,) J."""
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

    The observation uses absolute coordinates for any run: there every ideal joint has multipliers,
    also those that the run's coordinates eliminated, and redundant reactions do not depend on the
    run's coordinates.

    **Arguments:**

    - `scene`: the scene that was simulated.
    - `solution`: what `simulate` or `simulate_nonsmooth` returned.
    - `trajectory`: the N times and states to observe, such as `solution.steps` for every accepted
      step; by default the saved states.

    **Returns:** an `Observation` of numpy arrays, whose first axis has the length N.

    **Raises:** `ValueError` without a trajectory if the solution has no saved states.

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
    """Apply a compiled program to times and states, `CHUNK` of them at a time.

    The program thus always has arguments of the same shape and is not compiled again for another
    number N of times.

    **Arguments:** `look`: the program, for `CHUNK` times and states; `rows`: (N,) times, s, and
    states whose leaves have a first axis of length N, on the host.

    **Returns:** the results as NumPy arrays, joined along their first axis of length N.
    """
    count, rows = len(rows[0]), jax.tree.map(np.asarray, rows)
    parts = []
    for first in range(0, max(count, 1), CHUNK):
        part = jax.tree.map(lambda leaf, k=first: _filled(leaf[k : k + CHUNK]), rows)
        parts.append(jax.device_get(look(part)))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[:count], *parts)


def _filled(rows: np.ndarray) -> np.ndarray:
    """Return `CHUNK` rows by repeating the given ones; zeros if there are none."""
    return np.resize(rows, (CHUNK, *rows.shape[1:]))


@partial(Native, warns=False)
def observe_compiled(
    folded_scene: ConstantFolded, absolute: Formulation, unique: bool, times: Numbers, states: State
) -> Observation:
    """Return the observation at times (N,) s, without the ledger's integrals."""
    scene = unpack(folded_scene)
    system = System(scene, absolute)

    def at(t: Scalar, state: State) -> Observation:
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
