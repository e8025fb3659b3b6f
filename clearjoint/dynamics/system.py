"""A scene with the formulation of its equations of motion, evaluated at an instant.

Each compiled function makes one `System` at its entry; steps, outputs and reports use it.
"""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from ..math.groups import min_
from ..math.vectors import ZERO, Condition, Scalar, is_zero
from ..model.bodies import BodyState, Motion
from ..model.joints.base import ByLabel, Motions, Row
from ..model.scene import Scene
from .contact_events import ContactGap, ContactGaps, contact_gaps
from .contact_forces import (
    NO_BRISTLES,
    Bristles,
    Closed,
    EntrySpeeds,
    LoadedContact,
    contact_forces,
)
from .coordinates import AbstractMechanics, MotionVariables, Speeds
from .energy import ledger_powers, mechanical_energy
from .equations_of_motion import (
    Dynamics,
    applied_wrenches,
    constraint_rows,
    flattened,
    solved,
)
from .formulation import Formulation
from .grouping.condensing import whole
from .grouping.coordinates import grouped
from .multipliers import response, row_rate

FARTHEST = 1e-3
"""m or rad: largest violation of a constraint before a run stops. Stabilised constraints drift by a
thousandth of this at usual tolerances."""


class Prescribed(NamedTuple):
    """Value of a constraint, m or rad, and its first and second rate while the bodies are at
    rest."""

    value: Scalar
    rate: Scalar
    second_rate: Scalar


class System(eqx.Module):
    """A scene in scalar form and the formulation of its equations of motion.

    In the methods, `variables` are those of the formulation's coordinates, times t are in s since
    `origin`, `entry_speeds` are those of the contacts in m/s.

    `origin`: the scene's time in s at which t is zero; ``None`` if t is the scene's time. Runs that
    start long after time zero use it: near t = 0 floating-point numbers are dense enough for the
    shortest steps.

    >>> scene, state = extend.unpack(cj.mechanisms.double_pendulum())
    >>> system = extend.System(scene, extend.Formulation())
    >>> variables = system.encode(state.bodies)
    >>> list(system.motions(variables))
    ['ground', 'arm 2', 'arm 3']
    """

    scene: Scene
    formulation: Formulation
    origin: Scalar | None = None

    @staticmethod
    def of(scene: Scene, formulation: Formulation) -> "System":
        """Return the system of a scene in scalar form, with elements of the same structure grouped.

        States and entry speeds then have the names of groups; see `clearjoint.math.groups`.
        """
        return System(*grouped(scene, formulation))

    def with_scene(self, scene: Scene) -> "System":
        """Return the system of another scene of the same structure."""
        return System(scene, self.formulation, self.origin)

    def clock(self, t: Scalar) -> Scalar:
        """Return the scene's time for a time t since `origin`, s."""
        return t if self.origin is None else self.origin + t

    def own_time(self, time: Scalar) -> Scalar:
        """Return the time since `origin` for a time of the scene, s."""
        return time if self.origin is None else time - self.origin

    def ungrouped(self) -> Scene:
        """Return the scene with its groups split into single elements."""
        return whole(self.scene)

    def encode(self, bodies: dict[str, BodyState]) -> MotionVariables:
        """Return the variables of a state in scalar form."""
        return self.formulation.coordinates.encode(self.scene, bodies)

    def decode(self, variables: MotionVariables) -> dict[str, BodyState]:
        """Return the state of the variables, in scalar form."""
        return self.formulation.coordinates.decode(self.scene, variables)

    def without_drift(self, variables: MotionVariables) -> MotionVariables:
        """Return the variables of the same motion, normalised; see `AbstractCoordinates`."""
        return self.formulation.coordinates.without_drift(self.scene, variables)

    def with_speeds(self, variables: MotionVariables, others: MotionVariables) -> MotionVariables:
        """Return `variables` with the speeds of `others`."""
        return self.formulation.coordinates.with_speeds(self.scene, variables, others)

    def motions(self, variables: MotionVariables) -> Motions:
        """Return pose and twist of each body, the ground included."""
        return self.formulation.coordinates.motions(self.scene, variables)

    def mechanics(self, variables: MotionVariables) -> AbstractMechanics:
        """Return the mechanics of the coordinates: the equations of motion before forces."""
        return self.formulation.coordinates.mechanics(self.scene, variables)

    def rows(self, motions: Motions, t: Scalar) -> ByLabel[Row]:
        """Return the constraint rows that the coordinates do not eliminate, by joint and label."""
        return constraint_rows(self.scene, self.formulation.coordinates, motions, self.clock(t))

    def dynamics(
        self,
        variables: MotionVariables,
        entry_speeds: EntrySpeeds,
        t: Scalar,
        closed: Closed | None = None,
        bristles: Bristles = NO_BRISTLES,
    ) -> Dynamics:
        """Solve the equations of motion.

        **Arguments:** `closed`: the contacts that have a force; those that penetrate if ``None``.
        `bristles`: deflections, m, if the scene has bristle laws.
        """
        mechanics = self.mechanics(variables)
        forces = contact_forces(self.scene, mechanics.motions, entry_speeds, closed, bristles)
        return self._solved(mechanics, forces, t)

    def dynamics_under(
        self, variables: MotionVariables, forces: ByLabel[LoadedContact], t: Scalar
    ) -> Dynamics:
        """Solve the equations of motion under given contact forces; `{}` for none."""
        return self._solved(self.mechanics(variables), forces, t)

    def _solved(
        self,
        mechanics: AbstractMechanics,
        forces: ByLabel[LoadedContact],
        t: Scalar,
    ) -> Dynamics:
        wrenches = applied_wrenches(self.scene, mechanics.motions, forces, self.clock(t))
        rates = mechanics.free_rates(wrenches)
        rows = self.rows(mechanics.motions, t)
        return solved(self.formulation, mechanics, forces, rows, rates)

    def rates(
        self,
        variables: MotionVariables,
        entry_speeds: EntrySpeeds,
        t: Scalar,
        closed: Closed | None = None,
        bristles: Bristles = NO_BRISTLES,
    ) -> tuple[MotionVariables, dict[str, Scalar]]:
        """Return the time derivatives of the variables, and those of the energy ledger, W."""
        dynamics = self.dynamics(variables, entry_speeds, t, closed, bristles)
        powers = self.powers(dynamics, t)
        return dynamics.variable_rates, powers

    def powers(self, dynamics: Dynamics, t: Scalar) -> dict[str, Scalar]:
        """Return the powers of the energy ledger by name, W; empty if it is not integrated."""
        return ledger_powers(self.scene, dynamics, self.clock(t)) if self.formulation.ledger else {}

    def energies(self, variables: MotionVariables, t: Scalar) -> dict[str, Scalar]:
        """Return kinetic, gravitational and elastic energies, J, as far as the scene has them."""
        return mechanical_energy(self.scene, self.motions(variables), self.clock(t))

    def contact_gaps(self, variables: MotionVariables) -> ContactGaps:
        """Return depth and rate of each contact from the onset of its force, by joint and label."""
        return contact_gaps(self.scene, self.motions(variables))

    def second_rates(
        self, variables: MotionVariables, variable_rates: MotionVariables
    ) -> ByLabel[Scalar]:
        """Return the second time derivatives of the contacts' depths, m/s^2, for given time
        derivatives of the variables."""

        def rates(variables: MotionVariables) -> ByLabel[Scalar]:
            return jax.tree.map(
                lambda gap: gap.rate,
                self.contact_gaps(variables),
                is_leaf=lambda node: isinstance(node, ContactGap),
            )

        return jax.jvp(rates, (variables,), (variable_rates,))[1]

    def contact_forces(
        self,
        variables: MotionVariables,
        entry_speeds: EntrySpeeds,
        bristles: Bristles = NO_BRISTLES,
    ) -> ByLabel[LoadedContact]:
        """Return geometry and forces of all contacts, by joint and contact label."""
        return contact_forces(self.scene, self.motions(variables), entry_speeds, bristles=bristles)

    def project(self, variables: MotionVariables, t: Scalar) -> MotionVariables:
        """Return the variables with positions, then velocities, projected onto the constraints."""
        return self.project_velocities(self.project_positions(variables, t), t)

    def project_positions(self, variables: MotionVariables, t: Scalar) -> MotionVariables:
        """Do one Newton step of the positions towards Phi = 0, in the metric of the mass matrix."""
        mechanics = self.mechanics(variables)
        rows = flattened(self.rows(mechanics.motions, t))
        if not rows:
            return variables
        targets = [-row.value for row in rows]
        return mechanics.after_displacement(self._correction(mechanics, rows, targets))

    def project_velocities(self, variables: MotionVariables, t: Scalar) -> MotionVariables:
        """Return the variables with the velocities nearest to the given ones, in the metric of the
        mass matrix, for which the rate of Phi is zero."""
        mechanics = self.mechanics(variables)
        rows = flattened(self.rows(mechanics.motions, t))
        if not rows:
            return variables
        targets = [-row_rate(row, mechanics.motions) for row in rows]
        return mechanics.after_speed_change(self._correction(mechanics, rows, targets))

    def _correction(
        self, mechanics: AbstractMechanics, rows: Sequence[Row], targets: Sequence[Scalar]
    ) -> Speeds:
        """Return the smallest change of positions or speeds that changes rows by their targets."""
        directions = [mechanics.projected(row.jacobian) for row in rows]
        return response(mechanics, directions, targets, self.formulation.solver())[0]

    def is_constrained(self, variables: MotionVariables, t: Scalar) -> bool:
        """Whether the coordinates leave any constraint."""
        return bool(jax.eval_shape(lambda: self.rows(self.motions(variables), t)))

    def prescribed(self, variables: MotionVariables, t: Scalar) -> list[Prescribed]:
        """Return value and rates of each constraint that depends on time, for bodies at rest."""
        motions = {
            name: Motion(motion.position, motion.rotation, ZERO, ZERO)
            for name, motion in self.motions(variables).items()
        }
        rows = flattened(self.rows(motions, t))
        return [
            Prescribed(row.value, row.time_rate, row.bias)
            for row in rows
            if not is_zero(row.time_rate)
        ]

    def constraints_violated(self, variables: MotionVariables, t: Scalar) -> Condition | None:
        """Whether any constraint is violated by more than `FARTHEST`, or by more than the smallest
        clearance of a journal if that is less; ``None`` without constraints."""
        if not self.is_constrained(variables, t):
            return None
        motions = self.motions(variables)
        values = [jnp.abs(row.value) for row in flattened(self.rows(motions, t))]
        farthest: Scalar = FARTHEST
        for joint in self.scene.contact_joints().values():
            for contact in joint.contacts(motions).values():
                if contact.gap.clearance is not None:
                    farthest = jnp.minimum(farthest, min_(contact.gap.clearance))
        return functools.reduce(jnp.maximum, values) > farthest
