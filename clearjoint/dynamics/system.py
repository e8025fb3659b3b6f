"""A scene ready to compute with: everything that steps, outputs and reports ask of a scene at an
instant, in one object that is made once, at the entry of each compiled function."""

import functools
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
from .coordinates import AbstractMechanics, MotionVariables
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
from .projection import projected_positions, projected_velocities

FARTHEST = 1e-3
"""m or rad: a joint or driver farther off what it prescribes is not followed. Stabilised
constraints drift by a thousandth of this at usual tolerances."""


class Prescribed(NamedTuple):
    """A constraint's value, m or rad, and its rates while bodies stand still."""

    value: Scalar
    rate: Scalar
    second_rate: Scalar


class System(eqx.Module):
    """A scene in scalar form and the formulation of its equations of motion.

    Variables are those of the formulation's coordinates. Times are in s, since the system's
    `origin`; `entry_speeds` holds the entry speeds of the contacts, m/s.

    `origin`: s, the time at which a clock of its own shows zero, so that long after time zero steps
    are as short as they have to be; ``None`` for the clock of the scene.

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
        """The system of a scene in scalar form, its alike elements put together.

        States and entry speeds go by the names of groups then; see `clearjoint.math.groups`.
        """
        return System(*grouped(scene, formulation))

    def with_scene(self, scene: Scene) -> "System":
        """The system of another scene of the same structure."""
        return System(scene, self.formulation, self.origin)

    def clock(self, t: Scalar) -> Scalar:
        """The scene's time, s, when the system's own clock shows t."""
        return t if self.origin is None else self.origin + t

    def own_time(self, time: Scalar) -> Scalar:
        """What the system's own clock shows at a time of the scene, s."""
        return time if self.origin is None else time - self.origin

    def ungrouped(self) -> Scene:
        """The scene with each element by itself."""
        return whole(self.scene)

    def encode(self, bodies: dict[str, BodyState]) -> MotionVariables:
        """The variables of a state in scalar form."""
        return self.formulation.coordinates.encode(self.scene, bodies)

    def decode(self, variables: MotionVariables) -> dict[str, BodyState]:
        """The state of the variables, in scalar form."""
        return self.formulation.coordinates.decode(self.scene, variables)

    def without_drift(self, variables: MotionVariables) -> MotionVariables:
        """The same motion in numbers that don't drift in many steps."""
        return self.formulation.coordinates.without_drift(self.scene, variables)

    def with_speeds(self, variables: MotionVariables, others: MotionVariables) -> MotionVariables:
        """The variables with the speeds of others; positions stay."""
        return self.formulation.coordinates.with_speeds(self.scene, variables, others)

    def motions(self, variables: MotionVariables) -> Motions:
        """Pose and twist of each body, the ground included."""
        return self.formulation.coordinates.motions(self.scene, variables)

    def mechanics(self, variables: MotionVariables) -> AbstractMechanics:
        """The equations of motion without forces."""
        return self.formulation.coordinates.mechanics(self.scene, variables)

    def rows(self, motions: Motions, t: Scalar) -> ByLabel[Row]:
        """The constraint equations that the coordinates leave, by joint and label."""
        return constraint_rows(self.scene, self.formulation.coordinates, motions, self.clock(t))

    def dynamics(
        self,
        variables: MotionVariables,
        entry_speeds: EntrySpeeds,
        t: Scalar,
        closed: Closed | None = None,
        bristles: Bristles = NO_BRISTLES,
    ) -> Dynamics:
        """The equations of motion solved. Only `closed` contacts push, if they are given; otherwise
        those that penetrate. A scene with bristle laws needs its `bristles`."""
        mechanics = self.mechanics(variables)
        forces = contact_forces(self.scene, mechanics.motions, entry_speeds, closed, bristles)
        return self._solved(mechanics, forces, t)

    def dynamics_under(
        self, variables: MotionVariables, forces: ByLabel[LoadedContact], t: Scalar
    ) -> Dynamics:
        """The equations of motion solved under given contact forces; none as if none touched."""
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
        """Time derivatives of the variables, and of the energy ledger's integrals in W."""
        dynamics = self.dynamics(variables, entry_speeds, t, closed, bristles)
        powers = self.powers(dynamics, t)
        return dynamics.variable_rates, powers

    def powers(self, dynamics: Dynamics, t: Scalar) -> dict[str, Scalar]:
        """Powers of the energy ledger by name, W; none unless it is kept."""
        return ledger_powers(self.scene, dynamics, self.clock(t)) if self.formulation.ledger else {}

    def energies(self, variables: MotionVariables, t: Scalar) -> dict[str, Scalar]:
        """Kinetic, gravitational and elastic energies, J, as far as the scene has them."""
        return mechanical_energy(self.scene, self.motions(variables), self.clock(t))

    def contact_gaps(self, variables: MotionVariables) -> ContactGaps:
        """Depth and rate of each contact from where its force begins, by joint and contact."""
        return contact_gaps(self.scene, self.motions(variables))

    def second_rates(
        self, variables: MotionVariables, variable_rates: MotionVariables
    ) -> ByLabel[Scalar]:
        """Second time derivatives of the contacts' depths along given rates of the variables,
        m/s^2."""

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
        """Geometry and forces of all contacts, by joint and contact."""
        return contact_forces(self.scene, self.motions(variables), entry_speeds, bristles=bristles)

    def project(self, variables: MotionVariables, t: Scalar) -> MotionVariables:
        """The variables with positions, and then velocities, on the constraints."""
        return self.project_velocities(self.project_positions(variables, t), t)

    def project_positions(self, variables: MotionVariables, t: Scalar) -> MotionVariables:
        """One Newton step of the positions towards Phi = 0, in the metric of the mass matrix."""
        mechanics = self.mechanics(variables)
        rows = flattened(self.rows(mechanics.motions, t))
        return (
            projected_positions(mechanics, rows, self.formulation.solver()) if rows else variables
        )

    def project_velocities(self, variables: MotionVariables, t: Scalar) -> MotionVariables:
        """The velocities nearest to the given ones, in the metric of the mass matrix, that satisfy
        the rate of Phi = 0."""
        mechanics = self.mechanics(variables)
        rows = flattened(self.rows(mechanics.motions, t))
        solver = self.formulation.solver()
        return projected_velocities(mechanics, rows, solver) if rows else variables

    def is_constrained(self, variables: MotionVariables, t: Scalar) -> bool:
        """Whether any constraint is left to project onto."""
        return bool(jax.eval_shape(lambda: self.rows(self.motions(variables), t)))

    def prescribed(self, variables: MotionVariables, t: Scalar) -> list[Prescribed]:
        """What each constraint that depends on time has at a time for bodies that stand still."""
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

    def is_apart(self, variables: MotionVariables, t: Scalar) -> Condition | None:
        """Whether any constraint is off by more than `FARTHEST`, or by a journal's clearance if
        one is smaller; ``None`` without constraints."""
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
