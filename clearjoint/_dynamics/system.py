"""Evaluation of a scene's equations of motion at an instant, in chosen coordinates."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import PyTree

from .._fields.leaves import with_leaves
from .._math.vectors import ZERO, Condition, Matrix, Scalar, Vector, add, is_zero
from .._model.bodies import GROUND, GROUND_MOTION, BodyState, Motion
from .._model.contact.laws import AbstractContactLaw, AbstractLawAround
from .._model.joints.base import ByLabel, Motions, Row, each_label
from .._model.joints.constraint_rows import row_rate
from .._model.joints.couplings import JointCoupling
from .._model.joints.ideal import AbstractDriveableJoint
from .._model.scene import Scene
from .contact_events import ContactGaps, contact_gaps
from .contact_forces import (
    NO_BRISTLES,
    Bristles,
    Closed,
    EntrySpeeds,
    LoadedContacts,
    contact_forces,
)
from .coordinates import AbstractMechanics, MotionVariables
from .energy import ledger_powers, mechanical_energy
from .equations_of_motion import Dynamics, applied_wrenches, constraint_rows, flattened
from .formulation import Formulation
from .multipliers import ConstraintEquations, row_weights

FARTHEST = 1e-3
"""Largest violation of a constraint, m or rad, at which a run continues, unless the smallest
clearance of the scene, m, is less. With the default stabilisation and tolerances, violations are
about a thousandth of this limit."""
LEAST_JUMP = 2e-6
"""Jump of the function of a `JointCoupling`, m or rad, up to which the jump counts as a rounding
error. A run may start with a constraint value of half this limit."""


def _is_single_law(part: PyTree) -> bool:
    return isinstance(part, AbstractContactLaw) and not isinstance(part, AbstractLawAround)


def _depends_on_time(row: Row) -> bool:
    # The rate of other rows is the Python number zero.
    return not is_zero(row.time_rate)


class System(eqx.Module):
    """A scene with the formulation of its equations of motion, evaluated at single instants.

    - `scene`: in scalar form: each vector is three separate scalars (see
      `clearjoint.extend.unpack`).
    - `formulation`: coordinates, stabilisation and solver.
    - `origin`: the scene's time, s, at which the methods' time t is zero; ``None`` if t is the
      scene's time. In runs with derivatives it is the start of the run, so that t is near zero,
      where floating-point numbers are dense enough for the shortest steps.

    In all methods, `variables` are those of the formulation's coordinates, t is in s since
    `origin`, `entry_speeds` are penetration rates at the onsets of the present contacts, m/s (zero
    for an open contact), and `bristles` are the deflections of bristle friction laws, m, in the
    axes of the joint's first body. Values of bodies and joints are dictionaries by name, and values
    of contacts and constraint rows by name of joint and label.

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
    def prepared(scene: Scene, formulation: Formulation, origin: Scalar | None = None) -> "System":
        """Return the system of a scene for many evaluations: what its contact laws compute from
        their parameters alone is computed once (see `AbstractContactLaw.prepared`)."""
        leaves, structure = jax.tree.flatten(scene, is_leaf=_is_single_law)
        laws = [leaf.prepared() if _is_single_law(leaf) else leaf for leaf in leaves]
        if any(law is not leaf for law, leaf in zip(laws, leaves, strict=True)):
            scene = with_leaves(scene, laws, structure)
        return System(scene, formulation, origin)

    def with_scene(self, scene: Scene) -> "System":
        """Return this system with another scene of the same structure."""
        return System(scene, self.formulation, self.origin)

    def scene_time(self, t: Scalar) -> Scalar:
        """Return the scene's time for a time since `origin`."""
        return t if self.origin is None else self.origin + t

    def own_time(self, time: Scalar) -> Scalar:
        """Return the time since `origin` for a time of the scene."""
        return time if self.origin is None else time - self.origin

    def encode(self, bodies: dict[str, BodyState]) -> MotionVariables:
        """Return the variables for given states of the bodies, in scalar form."""
        return self.formulation.coordinates.encode(self.scene, bodies)

    def decode(self, variables: MotionVariables) -> dict[str, BodyState]:
        """Return the states of the bodies, in scalar form."""
        return self.formulation.coordinates.decode(self.scene, variables)

    def without_drift(self, variables: MotionVariables) -> MotionVariables:
        """Return variables of the same motion with Euler parameters of about unit norm and angles,
        except those of screws, between -2 pi and 2 pi."""
        return self.formulation.coordinates.without_drift(self.scene, variables)

    def with_speeds(self, variables: MotionVariables, others: MotionVariables) -> MotionVariables:
        """Return variables with the positions of `variables` and the speeds of `others`."""
        return self.formulation.coordinates.with_speeds(self.scene, variables, others)

    def motions(self, variables: MotionVariables) -> Motions:
        """Return pose and velocities of each body and of "ground"."""
        return self.formulation.coordinates.motions(self.scene, variables)

    def mechanics(self, variables: MotionVariables) -> AbstractMechanics:
        """Return kinematics and mass matrix of the scene."""
        return self.formulation.coordinates.mechanics(self.scene, variables)

    def rows(self, motions: Motions, t: Scalar) -> ByLabel[Row]:
        """Return the constraint rows that the coordinates do not eliminate."""
        return constraint_rows(
            self.scene, self.formulation.coordinates, motions, self.scene_time(t)
        )

    def dynamics(
        self,
        variables: MotionVariables,
        entry_speeds: EntrySpeeds,
        t: Scalar,
        closed: Closed | None = None,
        bristles: Bristles = NO_BRISTLES,
    ) -> Dynamics:
        """Solve the equations of motion, with the contact forces that follow from the variables.

        `closed` says whether each contact has a force; if ``None``, the contacts that penetrate
        have one. If a contact with a force has an entry speed of zero, its present penetration rate
        is used or, if `closed` is given, its force is elastic.

        **Raises:** `ValueError` if `bristles` lacks a contact with a bristle friction law, or if
        such a contact is one of flat faces (has a `face_radius`).
        """
        mechanics = self.mechanics(variables)
        forces = contact_forces(self.scene, mechanics.motions, entry_speeds, closed, bristles)
        return self.dynamics_under(mechanics, forces, t)

    def dynamics_under(
        self, mechanics: AbstractMechanics, forces: LoadedContacts, t: Scalar
    ) -> Dynamics:
        """Solve the equations of motion for a result of `mechanics`, with given contact forces."""
        wrenches = applied_wrenches(self.scene, mechanics.motions, forces, self.scene_time(t))
        rates, rows = mechanics.free_rates(wrenches), self.rows(mechanics.motions, t)
        rotors = self.rotors(mechanics.motions)
        if not rows and not rotors:
            return Dynamics(mechanics, forces, rows, rates, {})
        # The second time derivative of each row that the stabilisation demands, minus the part that
        # does not depend on the rates.
        targets = [
            self.formulation.stabilisation.target(row.value, row_rate(row, mechanics.motions))
            - add(row.bias, mechanics.bias(row))
            for row in flattened(rows)
        ]
        # An armature's row yields, by its compliance (see `ConstraintEquations`), so that with this
        # target its multiplier is minus armature times second time derivative of the position.
        targets += [-add(row.bias, mechanics.bias(row)) for row, _ in rotors]
        equations = self.constraint_equations(mechanics, flattened(rows), rotors)
        rates, multipliers = equations.corrected(targets, rates)
        # `each_label` calls the function in the order of `flattened`, which is that of the list.
        values = iter(multipliers)
        by_label = each_label(lambda name, label: next(values), rows)
        return Dynamics(mechanics, forces, rows, rates, by_label)

    def rates(
        self,
        variables: MotionVariables,
        entry_speeds: EntrySpeeds,
        t: Scalar,
        closed: Closed | None = None,
        bristles: Bristles = NO_BRISTLES,
    ) -> tuple[MotionVariables, dict[str, Scalar]]:
        """Return the variables' time derivatives, and the powers of the energy ledger, W, from the
        method `powers`. Arguments as in `dynamics`."""
        dynamics = self.dynamics(variables, entry_speeds, t, closed, bristles)
        powers = self.powers(dynamics, t)
        return dynamics.variable_rates, powers

    def powers(self, dynamics: Dynamics, t: Scalar) -> dict[str, Scalar]:
        """Return the powers, W, whose integrals are the energy ledger; none without a ledger."""
        return (
            ledger_powers(self.scene, dynamics, self.scene_time(t))
            if self.formulation.ledger
            else {}
        )

    def energies(self, variables: MotionVariables, t: Scalar) -> dict[str, Scalar]:
        """Return the energies of the scene, J: "kinetic", and as far as the scene has them
        "gravity", "springs" and "contacts"."""
        return mechanical_energy(self.scene, self.motions(variables), self.scene_time(t))

    def contact_gaps(self, variables: MotionVariables) -> ContactGaps:
        """Return each contact's penetration, m, 0 at the onset of its force, and its rate, m/s."""
        return contact_gaps(self.scene, self.motions(variables))

    def second_rates(
        self, variables: MotionVariables, variable_rates: MotionVariables
    ) -> ByLabel[Scalar]:
        """Return the second time derivative of each contact's penetration, m/s^2."""

        def rates(variables: MotionVariables) -> ByLabel[Scalar]:
            gaps = self.contact_gaps(variables)
            return each_label(lambda name, label: gaps[name][label].rate, gaps)

        return jax.jvp(rates, (variables,), (variable_rates,))[1]

    def contact_forces(
        self,
        variables: MotionVariables,
        entry_speeds: EntrySpeeds,
        bristles: Bristles = NO_BRISTLES,
    ) -> LoadedContacts:
        """Return geometry and forces of each contact. **Raises:** as in `dynamics`."""
        return contact_forces(self.scene, self.motions(variables), entry_speeds, bristles=bristles)

    def project(self, variables: MotionVariables, t: Scalar) -> MotionVariables:
        """Return the variables corrected towards the constraints in position and velocity."""
        return self.project_velocities(self.project_positions(variables, t), t)

    def project_positions(self, variables: MotionVariables, t: Scalar) -> MotionVariables:
        """Return the variables after one Newton step of the positions: the smallest, in the metric
        of the mass matrix, that satisfies the linearised constraints."""
        mechanics = self.mechanics(variables)
        rows = flattened(self.rows(mechanics.motions, t))
        if not rows:
            return variables
        equations = self.constraint_equations(mechanics, rows)
        changes, _ = equations.response([-row.value for row in rows])
        return mechanics.after_displacement(changes)

    def project_velocities(self, variables: MotionVariables, t: Scalar) -> MotionVariables:
        """Return the variables with velocities corrected so that the constraints' rates are zero,
        by the smallest correction in the metric of the mass matrix."""
        mechanics = self.mechanics(variables)
        rows = flattened(self.rows(mechanics.motions, t))
        if not rows:
            return variables
        rotors = self.rotors(mechanics.motions)
        targets = [-row_rate(row, mechanics.motions) for row in rows] + [0.0] * len(rotors)
        changes, _ = self.constraint_equations(mechanics, rows, rotors).response(targets)
        return mechanics.after_speed_change(changes)

    def rotors(self, motions: Motions) -> list[tuple[Row, Scalar]]:
        """Return, for each joint with an armature that the coordinates do not eliminate, the row of
        the joint's position and the armature. Other armatures are in the mass matrix."""
        eliminated = self.formulation.coordinates.eliminated(self.scene)
        return [
            (joint.position(motions), joint.armature)
            for name, joint in self.scene.joints.items()
            if isinstance(joint, AbstractDriveableJoint)
            and joint.armature is not None
            and name not in eliminated
        ]

    def constraint_equations(
        self,
        mechanics: AbstractMechanics,
        rows: Sequence[Row],
        rotors: Sequence[tuple[Row, Scalar]] = (),
    ) -> ConstraintEquations:
        """Return the equations for the multipliers of the constraint `rows` and of the rows in
        `rotors`. Without `rotors`, the equations ignore the inertia of rotors. `mechanics` and
        `rotors` are results of the methods of the same names."""
        rows = [*rows, *(row for row, _ in rotors)]
        return ConstraintEquations(
            mechanics,
            [mechanics.projected(row.jacobian) for row in rows],
            self.formulation.solver(),
            row_weights(self.scene.bodies, rows) if self.formulation.redundant else None,
            [1.0 / armature for _, armature in rotors],
        )

    def is_constrained(self, t: Scalar) -> bool:
        """Return whether any constraint remains that the coordinates do not eliminate."""
        return self._has_row(t, lambda row: True)

    def is_driven(self, t: Scalar) -> bool:
        """Return whether any constraint that the coordinates do not eliminate depends on time."""
        return self._has_row(t, _depends_on_time)

    def _has_row(self, t: Scalar, of_kind: Callable[[Row], bool]) -> bool:
        # Which rows there are does not depend on the places of the bodies. Shapes stand for their
        # motions: to trace the motions of a long chain for this was a tenth of all tracing.
        def chosen(motions: Motions) -> list[Scalar]:
            rows = flattened(self.rows({GROUND: GROUND_MOTION, **motions}, t))
            return [row.value for row in rows if of_kind(row)]

        number: PyTree = jax.ShapeDtypeStruct((), jnp.result_type(float))
        vector = Vector(number, number, number)
        motion = Motion(vector, Matrix(vector, vector, vector), vector, vector)
        return bool(jax.eval_shape(chosen, dict.fromkeys(self.scene.bodies, motion)))

    def prescribed(self, variables: MotionVariables, t: Scalar) -> ByLabel[Row]:
        """Return the constraint rows that depend on time, without Jacobians, for bodies at rest, so
        that `time_rate` and `bias` are the first two time derivatives of a row's `value`."""
        moving = self.motions(variables).items()
        motions = {n: Motion(motion.position, motion.rotation, ZERO, ZERO) for n, motion in moving}
        prescribed: ByLabel[Row] = {}
        for name, family in self.rows(motions, t).items():
            for label, row in family.items():
                if _depends_on_time(row):
                    prescribed.setdefault(name, {})[label] = replace(row, jacobian={})
        return prescribed

    def constraints_violated(self, variables: MotionVariables, t: Scalar) -> Condition | None:
        """Return whether a constraint's value is NaN or exceeds in magnitude 1e-3 (m, rad or 1) or,
        if less, the smallest radial clearance in m; ``None`` if there are no constraints. A jump of
        a `JointCoupling`, whose leader has passed half a revolution, counts as a violation too."""
        if not self.is_constrained(t):
            return None
        motions = self.motions(variables)
        rows = self.rows(motions, t)
        values = [jnp.abs(row.value) for row in flattened(rows)]
        # A violation as large as a clearance would be as large as the motion in that joint.
        farthest: Scalar = FARTHEST
        for joint in self.scene.contact_joints().values():
            for contact in joint.contacts(motions).values():
                if contact.gap.clearance is not None:
                    farthest = jnp.minimum(farthest, contact.gap.clearance)
        # A violation that is not a number is larger than any limit.
        violated = jnp.logical_not(functools.reduce(jnp.maximum, values) <= farthest)
        for name, joint in self.scene.joints.items():
            if isinstance(joint, JointCoupling):
                # The row's value jumps where the leader has passed half a revolution. A value of
                # more than half the jump is nearer to the jump than to zero.
                (row,), jump = rows[name].values(), jnp.abs(joint.jump())
                violated |= (jump > LEAST_JUMP) & (jnp.abs(row.value) > 0.5 * jump)
        return violated
