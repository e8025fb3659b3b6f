"""Contact problem of one time step: the impulses at closed rigid contacts, those whose gap in the
middle of the step is not positive.

Along the normal of each closed contact, Signorini's condition with Newton's restitution e holds:
the velocities U- before and U+ after the step (positive if the contact opens) and the impulse P
satisfy U+ + e U- >= 0, P >= 0, and at least one of the two is zero. Across the normal, Coulomb's
law of friction holds, with a pyramid of two directions in place of the cone. The first direction is
along the slip, so that the pyramid is exact in planar motion.

Velocities at the contacts depend linearly on the impulses; the matrix is Delassus' matrix. Its rows
are directions of contacts: first the normals of all contacts, then the two tangential directions of
each contact with friction. Normal and tangential impulses are computed alternately, each for the
latest values of the other (P. D. Panagiotopoulos, A nonlinear programming approach to the
unilateral contact and friction boundary value problem, 1975). One computation of both is a turn.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial, reduce
from typing import NamedTuple

import jax
import jax.numpy as jnp

from ..._dynamics.contact_forces import LoadedContact, contact_wrenches
from ..._dynamics.coordinates import AbstractMechanics, Motions, Speeds
from ..._dynamics.equations_of_motion import flattened
from ..._dynamics.system import System
from ..._fields.checks import require, require_range
from ..._math.linear_solvers import inner
from ..._math.rotations import transverse_axes
from ..._math.smoothing import norm_and_direction, where
from ..._math.vectors import ZERO, Condition, Scalar, Vector, add, multiply
from ..._model.joints.base import (
    AbstractContactJoint,
    AbstractElement,
    Contact,
    Row,
    each_label,
)
from ..._model.joints.constraint_rows import row_rate
from ..._model.joints.joint_friction import JointFriction
from ..._model.scene import Scene
from .bounded_lcp import BoxProblem, Impulses, largest, largest_of

ALTERNATIONS = 3000
TOLERANCE = 1e-9
"""The alternation between normal and tangential impulses ends at this relative residual, or after
`ALTERNATIONS` turns, which bound the computing time of a problem that does not converge."""
FAST = 1e3
"""Slip speed in m/s at which the Coulomb coefficient of a friction law is evaluated, far above the
speeds below which friction laws are regularised."""

NEGLIGIBLE = 1e-9
"""Contact velocity in m/s that counts as rest. Residuals are divided by the velocities that the
impulses have to change, but at least by this value: the velocities of a block at rest are rounding
errors of 1e-17 m/s, and no residual is a small part of these."""
ROUNDED = 1e-3
"""The residuals of the normal and of the friction impulses are divided by the velocities that these
impulses have to change, but at least by this part of the largest velocity of either kind. The slip
velocities of a block at rest are rounding errors, 1e-16 of the normal velocities, and a residual
divided by such slip velocities could never be small."""

LEAST_FACTOR, LARGEST_FACTOR = 0.1, 1e4
"""Bounds of the factor by which a change of the tangential impulses is extrapolated. Without them,
the factor could be negative, or arbitrarily large if two successive changes are nearly equal."""


class Alternation(NamedTuple):
    """State after one turn of the alternation between normal and tangential impulses, N s.

    - `normal`, `tangential`: found in the turn. `residual`: as `ContactProblem.impulses` returns.
    - `change`: `tangential` less the tangential impulses at the start of the turn.
    - `tried`: tangential impulses for the next turn: those at the start plus `factor` * `change`.
    """

    normal: Impulses
    tangential: Impulses
    residual: Scalar
    turns: Scalar
    tried: Impulses
    change: Impulses
    factor: Scalar


class Touch(NamedTuple):
    """One contact, open or closed, at given poses and velocities of the bodies.

    A `Row` is a direction of relative motion: its rate is a linear function of the velocities of
    both bodies, and an impulse along it acts on both.

    - `gap`: m, negative if the surfaces overlap.
    - `deepest`: m, penetration beyond which the side of the contact is unknown: the clearance of a
      bearing, or what the joint allows; ``None`` without such limits.
    - `normal`: a `Row` whose rate is the opening velocity, m/s.
    - `slip`: two `Row`s whose rates are the velocities, m/s, of the second body relative to the
      first: along the slip at the given velocities, and across it; empty without friction.
    - `coefficient`: Coulomb's coefficient of friction; zero without friction.
    """

    joint: str
    label: str
    gap: Scalar
    deepest: Scalar | None
    normal: Row
    slip: tuple[Row, ...] = ()
    coefficient: Scalar = 0.0


def touches(scene: Scene, motions: Motions) -> list[Touch]:
    """Return all contacts of a scene, open or closed, at given `motions` of the bodies. Raise a
    `ValueError` for a thrust face whose friction has a moment, and for friction of an ideal joint.
    """
    return [
        _touch(name, label, joint, contact, motions)
        for name, joint in scene.contact_joints().items()
        for label, contact in joint.contacts(motions).items()
    ]


def _touch(
    name: str, label: str, joint: AbstractContactJoint, contact: Contact, motions: Motions
) -> Touch:
    # A face radius belongs to two flat faces, whose friction also resists their relative rotation.
    # Such a moment would need a third row of slip.
    has_no_moment = contact.face_radius is None
    expected = f"without a moment of friction at {label!r}"
    remedy = "leave `friction` and `radius` out of EndPlay, or take simulate()"
    require(has_no_moment, f"scene.joints[{name!r}]", type(joint).__name__, expected, remedy)
    # Friction in an ideal hinge or ball, which alone has a `lever`, is refused as well.
    _require_contact(name, joint, contact.lever)
    on_first, on_second = contact.points_of_force(has_friction=contact.slip is not None)

    def row(direction: Vector) -> Row:
        first, second = joint.pair()
        pairs = {
            second: motions[second].wrench(direction, on_second),
            first: motions[first].wrench(-direction, on_first),
        }
        return Row(value=0.0, jacobian=pairs, bias=0.0)

    # The normal is the direction in which the second body penetrates the first, so that the contact
    # opens in the opposite direction.
    normal = row(-contact.normal)
    # Contacts with a `SideForce`, or that act as a couple, such as the backlash of a hinge, have
    # other wrenches than a force along the normal: those of a normal force of 1 N. The elastic part
    # of a `SideForce` is left out, since rigid contacts store no energy.
    if contact.side is not None:
        contact = replace(contact, side=replace(contact.side, elastic=ZERO))
    if contact.turning is not None or contact.side is not None:
        unit_force = LoadedContact(contact, normal_force=1.0, elastic_force=1.0, friction=None)
        wrenches = dict(contact_wrenches(joint, unit_force, motions))
        normal = Row(value=0.0, jacobian=wrenches, bias=0.0)
    # Beyond either penetration, it is unknown on which side of the wall the contact is.
    limits = [contact.gap.clearance, joint.deepest().get(label)]
    limits = [limit for limit in limits if limit is not None]
    deepest = reduce(jnp.minimum, limits) if limits else None
    touch = Touch(name, label, -contact.gap.depth, deepest, normal)
    if contact.slip is None:
        return touch
    along = _slip_direction(contact.slip, contact.normal)
    across = contact.normal.cross(along)
    # Friction laws are regularised at low slip; far above that they give Coulomb's coefficient. It
    # is the magnitude of the friction at a normal force of 1 N.
    fast = Contact(contact.gap, contact.normal, contact.arm_first, contact.arm_second, along * FAST)
    friction = joint.friction_force(label, fast, 1.0)
    coefficient = 0.0 if friction is None else norm_and_direction(friction)[0]
    return touch._replace(slip=(row(along), row(across)), coefficient=coefficient)


def _slip_direction(slip: Vector, normal: Vector) -> Vector:
    """Return the direction of the slip velocity; at zero slip, a direction across `normal`."""
    speed, direction = norm_and_direction(slip)
    other, _ = transverse_axes(normal)
    return jax.tree.map(partial(where, speed == 0.0), other, direction)


class ContactProblem:
    """Changes of contact velocities by contact impulses, while ideal joints hold.

    **Arguments:** `mechanics`: masses and Jacobians at the positions in the middle of the step;
    `contacts`: all contacts there, open or closed, at least one; `t`: s, the time there.

    The attribute `rows` has the normals of all contacts, then both slip directions of each contact
    with friction. All lists of velocities, m/s, and impulses, N s, have this order.
    """

    def __init__(
        self, system: System, mechanics: AbstractMechanics, contacts: Sequence[Touch], t: Scalar
    ):
        # These rows are not the contacts' directions, `self.rows`, but the constraint equations of
        # ideal joints. If they are redundant, the joints' own impulses are those of least norm.
        # `constraint_equations` weights the rows, since the norm would otherwise add N s to N m s.
        rows = flattened(system.rows(mechanics.motions, t))
        rotors = system.rotors(mechanics.motions)
        projected = [mechanics.projected(row.jacobian) for row in rows]
        projected += [mechanics.projected(row.jacobian) for row, _ in rotors]
        equations = system.constraint_equations(mechanics, rows, rotors) if projected else None

        # Change of the speeds by a unit impulse along a direction, while ideal joints hold.
        def free_response(direction: Speeds) -> Speeds:
            rates = mechanics.solved(direction)
            if equations is None:
                return rates
            # The joints' own impulses cancel the velocities that would violate their constraints.
            targets = [-inner(row, rates) for row in projected]
            change, _ = equations.response(targets)
            return [add(a, b) for a, b in zip(rates, change, strict=True)]

        self.contacts = contacts
        self.rows = [touch.normal for touch in contacts]
        self.rows += [row for touch in contacts for row in touch.slip]
        # Delassus' matrix is symmetric, so only its lower triangle is computed.
        directions = [mechanics.projected(row.jacobian) for row in self.rows]
        self._responses = [free_response(direction) for direction in directions]
        self._matrix = [
            [inner(direction, other) for other in self._responses[: i + 1]]
            for i, direction in enumerate(directions)
        ]
        self._count = len(contacts)

    def velocities(self, motions: Motions) -> list[Scalar]:
        return [row_rate(row, motions) for row in self.rows]

    def kick(self, impulses: Sequence[Scalar]) -> Speeds:
        """Return the change of the coordinates' speeds by impulses along the first of the `rows`,
        such as all normals, and by the impulses of ideal joints that follow from them."""
        change: Speeds = [0.0] * len(self._responses[0])
        for part, impulse in zip(self._responses, impulses, strict=False):
            change = [add(a, multiply(b, impulse)) for a, b in zip(change, part, strict=True)]
        return change

    def velocities_after(
        self, velocities: Sequence[Scalar], impulses: Impulses, rows: range, columns: range
    ) -> list[Scalar]:
        """Return the velocities along `rows` after impulses along `columns`, from the `velocities`
        before them; both are ranges of indices in `self.rows`."""
        return [
            add(velocity, inner([self._matrix[max(i, j)][min(i, j)] for j in columns], impulses))
            for i, velocity in zip(rows, velocities, strict=True)
        ]

    def normal_impulses(
        self, closed: Sequence[Condition], aims: Sequence[Scalar], least: Scalar = NEGLIGIBLE
    ) -> tuple[Impulses, Scalar]:
        """Return the normal impulses of all contacts, zero at open ones, and the residual. With
        these impulses, each closed contact opens at least with the smallest velocity allowed.

        The residual is the largest violation of the contact conditions along the normals, divided
        by the largest magnitude among the `aims` of closed contacts, but at least by `least`, m/s.

        **Arguments:** `aims`: m/s, for each contact its opening velocity without impulses, less the
        smallest opening velocity that is allowed, such as -e U- for Newton's restitution.
        """
        normal = [row[: i + 1] for i, row in enumerate(self._matrix[: self._count])]
        # An open contact is fixed to an impulse of zero by equal bounds.
        upper = [jnp.where(shut, jnp.inf, 0.0) for shut in closed]
        return BoxProblem(normal, [0.0] * self._count, upper).solve(aims, least)

    def impulses(
        self, closed: Sequence[Condition], aims: Sequence[Scalar], slips: Sequence[Scalar]
    ) -> tuple[Impulses, Scalar]:
        """Return the impulses at the closed contacts along all `rows`, and the relative residual,
        which is above `TOLERANCE` if the alternation did not converge.

        The residual is the largest of three numbers. The residuals of the normal and of friction
        impulses are each divided by the largest velocity that these impulses have to change, and
        the opening velocity due to the last change of friction impulses by the largest of `aims`
        and `slips`. All velocities are at closed contacts (see also `ROUNDED` and `NEGLIGIBLE`).
        `aims`: for each contact, its opening velocity without impulses less the smallest one that
        is allowed, m/s; `slips`: slip velocities without impulses, m/s, in the order of the slip
        directions in `rows`.
        """
        if not slips:  # without friction
            return self.normal_impulses(closed, aims)
        # `owner` is the index of the contact to which each tangential row belongs; `block` is the
        # lower triangle of the matrix for these rows.
        count, size = self._count, len(self.rows)
        normals, tangents = range(count), range(count, size)
        owner = [k for k, touch in enumerate(self.contacts) for _ in touch.slip]
        coefficients = [self.contacts[k].coefficient for k in owner]
        block = [self._matrix[i][count : i + 1] for i in tangents]
        # The residual `opening` is divided by `scale`, the largest velocity that the impulses at
        # closed contacts have to change. The other two are divided by the largest velocity of their
        # own kind, but at least by `least_scale`.
        are_closed = [*closed, *(closed[k] for k in owner)]  # for all rows
        scale = jnp.maximum(largest_of(are_closed, [*aims, *slips]), NEGLIGIBLE)
        least_scale = jnp.maximum(ROUNDED * scale, NEGLIGIBLE)

        def go(now: Alternation) -> Alternation:
            # Normal impulses for the tangential ones that the last turn has extrapolated, then
            # friction within the bounds that these normal impulses give.
            tried = now.tried
            aims_with_friction = self.velocities_after(aims, tried, normals, tangents)
            normal, normal_residual = self.normal_impulses(closed, aims_with_friction, least_scale)
            bounds = [mu * normal[k] for mu, k in zip(coefficients, owner, strict=True)]
            problem = BoxProblem(block, [-bound for bound in bounds], bounds)
            slips_with_normal = self.velocities_after(slips, normal, tangents, normals)
            tangential, slip_residual = problem.solve(slips_with_normal, least_scale)
            # The normal impulses were solved for other tangential ones: the opening velocities that
            # the difference causes are the residual of the alternation.
            change = [a - b for a, b in zip(tangential, tried, strict=True)]
            changes = self.velocities_after([0.0] * count, change, normals, tangents)
            opening = largest_of(closed, changes) / scale
            residual = largest([normal_residual, slip_residual, opening])
            # Tangential impulses for the next turn.
            factor, turns = _extrapolation(now, change), now.turns + 1
            tried = [a + factor * b for a, b in zip(tried, change, strict=True)]
            return Alternation(normal, tangential, residual, turns, tried, change, factor)

        def goes(now: Alternation) -> Condition:
            return (now.residual > TOLERANCE) & (now.turns < ALTERNATIONS)

        # The first turn is taken before the loop, because no residual is known until then.
        zero = jnp.zeros(())
        still = [zero] * (size - count)
        start = Alternation(
            normal=[zero] * count,
            tangential=still,
            residual=zero,
            turns=jnp.zeros((), int),
            tried=still,
            change=still,
            factor=zero + 1,
        )
        last = jax.lax.while_loop(goes, go, go(start))
        return [*last.normal, *last.tangential], last.residual


def _extrapolation(last: Alternation, change: Impulses) -> Scalar:
    """Return the factor by which the `change` of the tangential impulses in a turn is extrapolated
    after the turn `last`, by Aitken's method (B. Irons, R. Tuck, A version of the Aitken
    accelerator for computer iteration, 1969). Without it, two bases of a journal that both stick
    and share axial impulses need thousands of turns."""
    bend = [a - b for a, b in zip(change, last.change, strict=True)]
    square = inner(bend, bend)
    factor = -last.factor * inner(last.change, bend) / jnp.where(square > 0.0, square, 1.0)
    # The first turn has no earlier change to compare with, and for two equal changes the factor
    # would be infinite.
    usable = (last.turns > 0) & (square > 0.0)
    return jnp.where(usable, jnp.clip(factor, LEAST_FACTOR, LARGEST_FACTOR), 1.0)


def _require_contact(name: str, joint: AbstractElement, lever: Scalar | None = None) -> None:
    # The friction of an ideal joint is bounded by a constant load, not by an impulse of the step.
    is_contact = lever is None and not isinstance(joint, JointFriction)
    expected = "a joint with contacts, not friction of an ideal joint"
    remedy = "leave it out, or take simulate()"
    require(is_contact, f"scene.joints[{name!r}]", type(joint).__name__, expected, remedy)


def require_restitution(scene: Scene, restitution: Scalar | None) -> None:
    """Check that every contact has a coefficient of restitution: the given number, 0 to 1, or, for
    ``None``, that of its law; raise a `ValueError` if not."""
    if restitution is not None:
        require_range("restitution", restitution, 0.0, 1.0, "1 is elastic, 0 is plastic")
        return
    for name, family in scene.laws().items():
        _require_contact(name, scene.joints[name])
        for label, law in family.items():
            delivers, kind = hasattr(law, "delivered_restitution"), type(law).__name__
            expected = f"of a law with delivered_restitution() at {label!r}"
            remedy = "pass restitution=, or give the law such a method"
            require(delivers, f"scene.joints[{name!r}]", kind, expected, remedy)


def restitutions(scene: Scene, restitution: Scalar | None) -> dict[str, dict[str, Scalar]]:
    """Return Newton's coefficient of restitution of each contact, as restitutions[joint][contact]:
    the given `restitution` or, if that is ``None``, the coefficient of the contact's law."""
    laws = scene.laws()
    if restitution is not None:
        return each_label(lambda name, label: restitution, laws)
    return each_label(lambda name, label: laws[name][label].delivered_restitution(), laws)  # pyright: ignore
