"""The contacts of one time step: directions, Delassus' matrix, and impulses that obey the laws.

Signorini's condition with Newton's restitution along the normal of each closed contact, U+ + e U-
>= 0, P >= 0, one of them zero, and Coulomb's friction across it. With two directions across, the
first along the slip, the cone is a pyramid; in planar motion that is exact. Normal and
tangential impulses are solved in turns, each for the other's last (P. D. Panagiotopoulos, A
nonlinear programming approach to the unilateral contact and friction boundary value problem, 1975).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp

from ...dynamics.contact_forces import contact_wrenches
from ...dynamics.coordinates import AbstractMechanics, Motions, Speeds
from ...dynamics.equations_of_motion import flattened
from ...dynamics.multipliers import response, row_rate
from ...dynamics.system import System
from ...math.linear_solvers import inner
from ...math.rotations import transverse_axes
from ...math.smoothing import norm_and_direction
from ...math.vectors import Condition, Scalar, Vector, add, multiply
from ...model.joints.base import AbstractContactJoint, Contact, Row
from ...model.scene import Scene
from .bounded_lcp import BoxProblem, Impulses, largest

ALTERNATIONS = 3000
TOLERANCE = 1e-9
"""Of the alternation between normal and tangential impulses."""
FAST = 1e3
"""Slip speed, m/s, at which a friction law is asked for its Coulomb coefficient."""

LEAST_FACTOR, LARGEST_FACTOR = 0.1, 1e4
"""Bounds of the factor by which a turn's change of the tangential impulses is extrapolated."""


class Turn(NamedTuple):
    """A turn of the alternation.

    `normal`, `tangential`: the impulses that it found, their `residual` and the number of `turns`
    so far; `tried`: the tangential impulses for the next turn; `change`, `factor`: by how much this
    one changed what it had tried, and by what that was multiplied.
    """

    normal: Impulses
    tangential: Impulses
    residual: Scalar
    turns: Scalar
    tried: Impulses
    change: Impulses
    factor: Scalar


@dataclass(frozen=True)
class Touch:
    """One contact at a configuration: joint and label, its `gap` in m (negative if closed) and the
    bearing's clearance, its normal row, whose rate is the opening velocity, the rows of slip, and
    Coulomb's coefficient."""

    joint: str
    label: str
    gap: Scalar
    clearance: Scalar | None
    normal: Row
    slip: tuple[Row, ...]
    coefficient: Scalar


def touches(scene: Scene, motions: Motions) -> list[Touch]:
    """All contacts of a scene's joints at a configuration."""
    return [
        _touch(name, label, joint, contact, motions)
        for name, joint in scene.contact_joints().items()
        for label, contact in joint.contacts(motions).items()
    ]


def _touch(
    name: str, label: str, joint: AbstractContactJoint, contact: Contact, motions: Motions
) -> Touch:
    on_first, on_second = contact.points_of_force(contact.slip is not None)

    def row(direction: Vector) -> Row:
        """Of the velocity of the second body against the first along a direction."""
        first, second = joint.pair()
        pairs = {
            second: motions[second].wrench(direction, on_second),
            first: motions[first].wrench(-direction, on_first),
        }
        return Row(0.0, pairs, 0.0)

    normal = row(-contact.normal)
    if contact.turning is not None:
        normal = Row(0.0, dict(contact_wrenches(joint, contact, 1.0, None, motions)), 0.0)
    size = -contact.gap.depth, contact.gap.clearance
    if contact.slip is None:
        return Touch(name, label, *size, normal, (), 0.0)
    along = _slip_direction(contact.slip, contact.normal)
    across = contact.normal.cross(along)
    fast = Contact(contact.gap, contact.normal, contact.arm_first, contact.arm_second, along * FAST)
    friction = joint.friction_force(label, fast, 1.0)
    coefficient = 0.0 if friction is None else norm_and_direction(friction)[0]
    return Touch(name, label, *size, normal, (row(along), row(across)), coefficient)


def _slip_direction(slip: Vector, normal: Vector) -> Vector:
    """That of the slip, or any across the normal if there is none."""
    speed, direction = norm_and_direction(slip)
    other, _ = transverse_axes(normal)
    rests = speed == 0.0
    parts = zip(direction, other, strict=True)
    return Vector(*(jnp.where(rests, b, a) for a, b in parts))


class ContactProblem:
    """Delassus' matrix of all contacts, with the constraints of the ideal joints kept."""

    def __init__(
        self,
        system: System,
        mechanics: AbstractMechanics,
        contacts: Sequence[Touch],
        t: Scalar,
    ):
        rows = flattened(system.rows(mechanics.motions, t))
        held = [mechanics.projected(row.jacobian) for row in rows]

        def free_response(direction: Speeds) -> Speeds:
            rates = mechanics.solved(direction)
            if not held:
                return rates
            targets = [-inner(row, rates) for row in held]
            change, _ = response(mechanics, held, targets, system.formulation.solver())
            return [add(a, b) for a, b in zip(rates, change, strict=True)]

        self.contacts = contacts
        self.rows = [touch.normal for touch in contacts]
        self.rows += [row for touch in contacts for row in touch.slip]
        directions = [mechanics.projected(row.jacobian) for row in self.rows]
        self._responses = [free_response(direction) for direction in directions]
        self._matrix = [
            [inner(direction, other) for other in self._responses[: i + 1]]
            for i, direction in enumerate(directions)
        ]
        self._count = len(contacts)

    def velocities(self, motions: Motions) -> list[Scalar]:
        """Those along all rows, m/s: opening velocities, and then slips."""
        return [row_rate(row, motions) for row in self.rows]

    def velocities_after(self, velocities: Sequence[Scalar], impulses: Impulses) -> list[Scalar]:
        """The velocities along all rows, m/s, after impulses along all of them, N s."""
        rows = range(len(self.rows))
        return self._with_impulses(rows, rows, velocities, impulses)

    def kick(self, impulses: Sequence[Scalar]) -> Speeds:
        """The change of the speeds by impulses along the first rows."""
        change: Speeds = [0.0] * len(self._responses[0])
        for part, impulse in zip(self._responses, impulses, strict=False):
            change = [add(a, multiply(b, impulse)) for a, b in zip(change, part, strict=True)]
        return change

    def _with_impulses(
        self, rows: range, columns: range, velocities: Sequence[Scalar], impulses: Impulses
    ) -> list[Scalar]:
        """Velocities of some rows after impulses along others."""
        return [
            add(velocity, inner([self._entry(i, j) for j in columns], impulses))
            for i, velocity in zip(rows, velocities, strict=True)
        ]

    def _entry(self, i: int, j: int) -> Scalar:
        return self._matrix[max(i, j)][min(i, j)]

    def normal_impulses(
        self, closed: Sequence[Condition], aims: Sequence[Scalar]
    ) -> tuple[Impulses, Scalar]:
        """Impulses of the closed contacts, N s, that make the velocities `aims` (those without
        impulses, less the least ones allowed) non-negative; and the relative residual."""
        normal = [row[: i + 1] for i, row in enumerate(self._matrix[: self._count])]
        upper = [jnp.where(shut, jnp.inf, 0.0) for shut in closed]
        return BoxProblem(normal, [0.0] * self._count, upper).solve(aims)

    def impulses(
        self, closed: Sequence[Condition], aims: Sequence[Scalar], slips: Sequence[Scalar]
    ) -> tuple[Impulses, Scalar]:
        """Normal and tangential impulses, N s, of the closed contacts; and the relative residual:
        the largest violation over the largest velocity of a closed contact.

        **Arguments:** `aims` as above, `slips`: velocities of the rows of slip without impulses.
        """
        if not slips:
            return self.normal_impulses(closed, aims)
        count, size = self._count, len(self.rows)
        normals, tangents = range(count), range(count, size)
        owner = [k for k, touch in enumerate(self.contacts) for _ in touch.slip]
        coefficients = [self.contacts[k].coefficient for k in owner]
        block = [self._matrix[i][count : i + 1] for i in tangents]
        live = [*closed, *(closed[k] for k in owner)]
        scale = _largest_of(live, [*aims, *slips])
        scale = jnp.where(scale > 0.0, scale, 1.0)

        def go(now: Turn) -> Turn:
            tried = now.tried
            aims_with_friction = self._with_impulses(normals, tangents, aims, tried)
            normal, normal_residual = self.normal_impulses(closed, aims_with_friction)
            bounds = [mu * normal[k] for mu, k in zip(coefficients, owner, strict=True)]
            problem = BoxProblem(block, [-bound for bound in bounds], bounds)
            tangential, slip_residual = problem.solve(
                self._with_impulses(tangents, normals, slips, normal)
            )
            change = [a - b for a, b in zip(tangential, tried, strict=True)]
            changes = self._with_impulses(normals, tangents, [0.0] * count, change)
            residual = largest(
                [normal_residual, slip_residual, _largest_of(closed, changes) / scale]
            )
            factor = _extrapolation(now, change)
            following = [a + factor * b for a, b in zip(tried, change, strict=True)]
            return Turn(normal, tangential, residual, now.turns + 1, following, change, factor)

        def goes(now: Turn) -> Condition:
            return (now.residual > TOLERANCE) & (now.turns < ALTERNATIONS)

        zero, nothing = jnp.zeros(()), [jnp.zeros(())] * (size - count)
        start = Turn([zero] * count, nothing, zero, jnp.zeros((), int), nothing, nothing, zero + 1)
        found = jax.lax.while_loop(goes, go, go(start))
        return [*found.normal, *found.tangential], found.residual


def _extrapolation(last: Turn, change: Impulses) -> Scalar:
    """The factor for a change after that of the last turn (B. Irons, R. Tuck, A version of the
    Aitken accelerator for computer iteration, 1969). Where bases stick and axial impulses pass from
    one to the other, plain turns go on for thousands."""
    bend = [a - b for a, b in zip(change, last.change, strict=True)]
    square = inner(bend, bend)
    factor = -last.factor * inner(last.change, bend) / jnp.where(square > 0.0, square, 1.0)
    usable = (last.turns > 0) & (square > 0.0)
    return jnp.where(usable, jnp.clip(factor, LEAST_FACTOR, LARGEST_FACTOR), 1.0)


def _largest_of(live: Sequence[Condition], numbers: Sequence[Scalar]) -> Scalar:
    """The largest magnitude of the numbers that are live."""
    return largest([jnp.where(one, number, 0.0) for one, number in zip(live, numbers, strict=True)])
