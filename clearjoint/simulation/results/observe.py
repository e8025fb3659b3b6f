"""Compute contacts, reactions, accelerations, drift and energies from the states of a solution."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np

from ...dynamics.absolute_coordinates import AbsoluteCoordinates
from ...dynamics.bristles import initial_bristles
from ...dynamics.energy import bristle_energy, mechanical_energy
from ...dynamics.equations_of_motion import Dynamics
from ...dynamics.formulation import Formulation
from ...dynamics.multipliers import row_rate
from ...dynamics.system import System
from ...fields.checks import require
from ...fields.conversion import with_arrays
from ...math.smoothing import norm_and_direction
from ...math.vectors import ConstantFolded, Scalar, Vector, fold_constants, pack, unpack
from ...model.bodies import GROUND, NO_WRENCH, State, Wrench
from ...model.clearance_joints.journal_bases import BASES, HasJournal, axial_positions
from ...model.scene import Scene
from ...native import Native, over_rows
from ..step.types import Integers, Numbers
from .nonsmooth_solution import NonsmoothSolution
from .observation import AccelerationSeries, ContactObservation, Load, MotionMode, Observation
from .solution import Solution, Trajectory

Parts = TypeVar("Parts")
CHUNK = 512
"""Number of states for which one call of a compiled program computes results. It is the same in all
calls, so that one program serves any number of states. A smaller number would take more calls, and
a larger one would compute more states only to fill up the last call."""


def observe(
    scene: Scene, solution: Solution | NonsmoothSolution, trajectory: Trajectory | None = None
) -> Observation:
    """Compute contacts, reactions, accelerations, drift and energies along a solution.

    Drift is the violation of the constraint equations. Saved states contain positions and
    velocities, from which this function computes the other results.

    The equations of motion are solved again at each state, always in absolute coordinates. There
    every ideal joint has constraint equations, whose Lagrange multipliers give its reactions, even
    if the run used coordinates that need no equations for this joint. Therefore the reactions of
    redundant joints do not depend on the coordinates of the run.

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
    expected, given = "one with states to observe", "without saved states"
    remedy = "pass save=Saving(times) or Saving(steps=True) to simulate()"
    require(trajectory is not None, "solution", given, expected, remedy)
    assert trajectory is not None
    absolute, states = absolute_formulation(solution), trajectory.states
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


def absolute_formulation(solution: Solution | NonsmoothSolution) -> Formulation:
    """Return the formulation of the equations of motion that a solution was computed with, but in
    absolute coordinates and without an energy ledger.

    In absolute coordinates every ideal joint has constraint equations, and thus reactions.
    """
    used = solution.formulation
    return Formulation(AbsoluteCoordinates(), used.stabilisation, used.redundant)


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

    def chunk(rows: np.ndarray, first: int) -> np.ndarray:
        # Repeats rows to fill up the last chunk; makes zeros if there is no row at all.
        return np.resize(rows[first : first + CHUNK], (CHUNK, *rows.shape[1:]))

    parts = []
    for first in range(0, max(count, 1), CHUNK):
        part = jax.tree.map(lambda leaf, first=first: chunk(leaf, first), rows)
        parts.append(jax.device_get(look(part)))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves)[:count], *parts)


# If native code cannot be made, XLA compiles the observation without a warning, because it is short
# beside a run.
@partial(Native, warns=False)
def observe_compiled(
    folded_scene: ConstantFolded, absolute: Formulation, unique: bool, times: Numbers, states: State
) -> Observation:
    """Return the observation at given times and states, without the integrals of the energy ledger.

    **Arguments:** `folded_scene`: the scene, whose exact zeros and ones are compiled as constants;
    `absolute`: the formulation in absolute coordinates; `unique`: the value of
    `Observation.reactions_unique`; `times`: (N,) s; `states`: the N states, with vectors as arrays
    (N, 3).
    """
    scene = unpack(folded_scene)
    system = System(scene, absolute)

    def at(t: Scalar, state: State) -> Observation:
        """Return the observation at one time t, s; its arrays have no axis of times."""
        # The deflections of bristles are those of the state, and zero for contacts without any.
        bristles = initial_bristles(scene, unpack(state.bristles))
        variables = system.encode(unpack(state.bodies))
        dynamics = system.dynamics(variables, state.entry_speeds, t, bristles=bristles)
        motions, forces = dynamics.motions, dynamics.contact_forces
        energies = mechanical_energy(scene, motions, t)
        if (elastic := bristle_energy(scene, motions, forces, bristles)) is not None:
            energies["bristles"] = elastic
        # The sum is taken before the integrals of the ledger are added, in `observe`.
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
    """Return all contacts at one instant, by joint and label.

    **Arguments:** `dynamics`: the solved equations of motion, with the forces of all contacts.
    """
    observations: dict[str, dict[str, ContactObservation]] = {}
    for name, family in dynamics.contact_forces.items():
        joint = scene.contact_joints()[name]
        first, second = (dynamics.motions[body] for body in joint.pair())
        observations[name] = {}
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
    """Return the `MotionMode` of each journal at one instant, by joint."""
    modes = {}
    for name, joint in scene.joints.items():
        if isinstance(joint, HasJournal):
            v, w = (dynamics.contact_forces[name][base].contact for base in BASES)
            touches_v, touches_w = v.gap.depth > 0.0, w.gap.depth > 0.0
            # If the normals at both bases point to the same side, the journal lies along a line of
            # the wall; otherwise it is tilted from one side to the other.
            both = jnp.where(
                v.normal.dot(w.normal) > 0.0, MotionMode.LINE_CONTACT, MotionMode.OPPOSITE_SIDES
            )
            one = jnp.where(touches_v | touches_w, MotionMode.ONE_BASE, MotionMode.FREE_FLIGHT)
            modes[name] = jnp.where(touches_v & touches_w, both, one)
    return modes


def _reactions(dynamics: Dynamics) -> dict[str, dict[str, Load]]:
    """Return the reaction of each ideal joint on each body at one instant, by joint and body."""
    reactions: dict[str, dict[str, Load]] = {}
    for name, rows in dynamics.rows.items():
        total: dict[str, Wrench] = {}
        for label, row in rows.items():
            multiplier = dynamics.multipliers[name][label]
            # A constraint's Jacobian is the wrench on each body for a multiplier of 1.
            for body, pair in row.jacobian.items():
                if body != GROUND:
                    scaled = Wrench(pair.force * multiplier, pair.moment * multiplier)
                    total[body] = total.get(body, NO_WRENCH) + scaled
        reactions[name] = {
            body: Load(pack(wrench.force), pack(wrench.moment)) for body, wrench in total.items()
        }
    return reactions


def _drift(dynamics: Dynamics) -> tuple[dict[str, Scalar], dict[str, Scalar]]:
    """Return the largest magnitude of the values of each joint's constraint equations, and of their
    time derivatives, by joint. Both are zero for an exact solution."""

    def largest(values: list[Scalar]) -> Scalar:
        return jnp.max(jnp.abs(jnp.stack([jnp.asarray(value) for value in values])))

    values, rates = {}, {}
    for name, rows in dynamics.rows.items():
        values[name] = largest([row.value for row in rows.values()])
        rates[name] = largest([row_rate(row, dynamics.motions) for row in rows.values()])
    return values, rates
