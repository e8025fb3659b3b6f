"""Alike clearance joints in the place of one.

What a joint or its law says of one element is applied to each, so that both may be anybody's.
"""

import equinox as eqx
import jax.numpy as jnp

from ...math.groups import each
from ...math.vectors import Scalar, Vector
from ..bodies import Motion, Wrench
from ..contact.bristles import AbstractBristleFriction
from ..contact.gap import Gap
from ..contact.laws import AbstractContactLaw
from ..joints.base import AbstractContactJoint, Contact, Motions


class SeveralContactJoints(AbstractContactJoint):
    """Contact joints of one structure, which differ in their numbers and in the bodies they join.

    - `joint`: the first of them, with arrays of all their numbers.
    - `members`: all of them as they were given.
    - `first`, `second`: names of their bodies; each that of the ground, or a `GroupName` in the
      order of the joints.
    """

    joint: AbstractContactJoint
    members: tuple[AbstractContactJoint, ...]
    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)

    def pair(self) -> tuple[str, str]:
        """The first bodies and the second ones."""
        return self.first, self.second

    def laws(self) -> dict[str, AbstractContactLaw]:
        """The laws of each contact."""
        return {
            label: SeveralContactLaws(
                joint=self.joint,
                label=label,
                uses_entry_speed=law.uses_entry_speed,
                force_jumps=law.force_jumps,
            )
            for label, law in self.joint.laws().items()
        }

    def deepest(self) -> dict[str, Scalar]:
        """The greatest sensible penetrations of each joint's contacts, m."""
        return each(lambda joint: joint.deepest(), self.joint)

    def contacts(self, motions: Motions) -> dict[str, Contact]:
        """The geometry of each joint's contacts."""
        names = self.joint.pair()

        def of(joint: AbstractContactJoint, *pair: Motion) -> dict[str, Contact]:
            return joint.contacts(dict(zip(names, pair, strict=True)))

        return each(of, self.joint, motions[self.first], motions[self.second])

    def film_wrenches(self, motions: Motions) -> dict[str, Wrench]:
        """What the film of each joint does to its bodies."""
        names = self.joint.pair()

        def of(joint: AbstractContactJoint, *pair: Motion) -> dict[str, Wrench]:
            return joint.film_wrenches(dict(zip(names, pair, strict=True)))

        wrenches = each(of, self.joint, motions[self.first], motions[self.second])
        together = dict(zip(names, self.pair(), strict=True))
        return {together[name]: wrench for name, wrench in wrenches.items()}

    def friction_force(self, name: str, contact: Contact, normal_force: Scalar) -> Vector | None:
        """Friction of each joint on its second body, N, or ``None``."""

        def of(
            joint: AbstractContactJoint, contact: Contact, normal_force: Scalar
        ) -> Vector | None:
            return joint.friction_force(name, contact, normal_force)

        return each(of, self.joint, contact, normal_force)

    def bristle_laws(self) -> dict[str, AbstractBristleFriction]:
        """The bristle laws of each contact that has one."""
        return {
            label: SeveralBristleLaws(joint=self.joint, label=label)
            for label in self.joint.bristle_laws()
        }


class SeveralContactLaws(AbstractContactLaw):
    """The laws of one contact of several joints."""

    joint: AbstractContactJoint
    label: str = eqx.field(static=True)
    uses_entry_speed: bool = eqx.field(static=True)  # pyright: ignore
    force_jumps: bool = eqx.field(static=True)

    def _each(self, method: str, *arguments: Gap | Scalar | None) -> Scalar:
        def of(joint: AbstractContactJoint, *arguments: Gap | Scalar | None) -> Scalar:
            return getattr(joint.laws()[self.label], method)(*arguments)

        return each(of, self.joint, *arguments)

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Normal forces in N."""
        return self._each("force", gap, entry_speed)

    def elastic_force(self, gap: Gap) -> Scalar:
        """Their parts that come from stored energy, N."""
        return self._each("elastic_force", gap)

    def stored_energy(self, gap: Gap) -> Scalar:
        """Elastic energies in J."""
        return self._each("stored_energy", gap)

    def onset_offset(self) -> Scalar:
        """Distances ahead of the surface at which the forces begin, m."""
        return self._each("onset_offset")

    def slope_jumps(self) -> bool:
        """Whether their slopes may jump."""
        return self.joint.laws()[self.label].slope_jumps()


class SeveralBristleLaws(AbstractBristleFriction):
    """The bristle laws of one contact of several joints."""

    joint: AbstractContactJoint
    label: str = eqx.field(static=True)

    def rate(self, deflection: Vector, slip: Vector) -> Vector:
        """Rates of the deflections, m/s."""

        def of(joint: AbstractContactJoint, deflection: Vector, slip: Vector) -> Vector:
            return joint.bristle_laws()[self.label].rate(deflection, slip)

        return each(of, self.joint, deflection, slip)

    def ratio(self, deflection: Vector, rate: Vector, slip: Vector) -> Vector:
        """Friction over normal forces."""

        def of(joint: AbstractContactJoint, *vectors: Vector) -> Vector:
            return joint.bristle_laws()[self.label].ratio(*vectors)

        return each(of, self.joint, deflection, rate, slip)

    def sliding_ratio(self, slip_speed: Scalar) -> Scalar:
        """Dry friction over normal forces after long slips at speeds in m/s."""

        def of(joint: AbstractContactJoint, slip_speed: Scalar) -> Scalar:
            return joint.bristle_laws()[self.label].sliding_ratio(slip_speed)

        return each(of, self.joint, slip_speed)

    def full_deflection(self) -> Scalar:
        """The deflections that errors are judged against, m."""

        def of(joint: AbstractContactJoint) -> Scalar:
            return jnp.asarray(joint.bristle_laws()[self.label].full_deflection(), float)

        return each(of, self.joint)
