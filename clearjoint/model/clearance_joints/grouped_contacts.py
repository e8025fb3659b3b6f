"""A group of clearance joints with the same structure, evaluated together.

Each method of a joint or law is mapped over the group, so that user-defined classes work unchanged.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import PyTree

from ...math.groups import each
from ...math.vectors import Scalar, Vector
from ..bodies import Motion, Wrench
from ..contact.bristles import AbstractBristleFriction
from ..contact.gap import Gap
from ..contact.laws import AbstractContactLaw
from ..joints.base import AbstractContactJoint, Contact, Motions


class GroupedContactJoint(AbstractContactJoint):
    """Contact joints of one structure that differ only in their numbers and their bodies.

    Where a method of a single joint returns a number, the same method of the group returns an array
    (N,) with an entry for each of the N joints. Joints that have constraint rows, or an anchor (a
    point on the ground near which rounding errors are reduced), are not grouped. The methods `rows`
    and `anchor` of a group therefore keep their defaults, which return nothing.

    - `joint`: the first joint, with each number replaced by an array (N,) over the group.
    - `members`: the N joints as the user gave them.
    - `first`, `second`: names of the joints' first and second bodies. Each is the ground's name, or
      a `GroupName` that lists the bodies in the order of the joints.
    """

    joint: AbstractContactJoint
    members: tuple[AbstractContactJoint, ...]
    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)

    def pair(self) -> tuple[str, str]:
        """Return the name of the group of first bodies and that of the group of second bodies."""
        return self.first, self.second

    def laws(self) -> dict[str, AbstractContactLaw]:
        """Return the grouped normal law of each contact by label."""
        return {
            label: GroupedContactLaw(
                joint=self.joint,
                label=label,
                uses_entry_speed=law.uses_entry_speed,
                force_jumps=law.force_jumps,
            )
            for label, law in self.joint.laws().items()
        }

    def deepest(self) -> dict[str, Scalar]:
        """Return the largest meaningful penetrations by label, (N,) m."""
        return each(lambda joint: joint.deepest(), self.joint)

    def contacts(self, motions: Motions) -> dict[str, Contact]:
        """Return the geometry of each contact by label, with arrays (N,) over the group."""
        return self._each_at(motions, "contacts")

    def _each_at(self, motions: Motions, method: str) -> PyTree:
        """Return the results of a method whose only argument is `motions`, with arrays (N,).

        **Arguments:** `motions`: of the groups of bodies, by name. `method`: its name.
        """
        # A single joint looks up its bodies by the names of the first joint's bodies.
        names = self.joint.pair()

        def of(joint: AbstractContactJoint, *pair: Motion) -> PyTree:
            return getattr(joint, method)(dict(zip(names, pair, strict=True)))

        return each(of, self.joint, motions[self.first], motions[self.second])

    def film_wrenches(self, motions: Motions) -> dict[str, Wrench]:
        """Return the wrenches of the films, with arrays (N,), by name of the group of bodies."""
        wrenches = self._each_at(motions, "film_wrenches")
        groups = dict(zip(self.joint.pair(), self.pair(), strict=True))
        return {groups[name]: wrench for name, wrench in wrenches.items()}

    def friction_force(self, name: str, contact: Contact, normal_force: Scalar) -> Vector | None:
        """Return the friction forces, N in global axes; ``None`` without friction."""

        def of(
            joint: AbstractContactJoint, contact: Contact, normal_force: Scalar
        ) -> Vector | None:
            return joint.friction_force(name, contact, normal_force)

        return each(of, self.joint, contact, normal_force)

    def bristle_laws(self) -> dict[str, AbstractBristleFriction]:
        """Return the grouped bristle law by label, for the contacts that have bristles."""
        return {
            label: GroupedBristleLaw(joint=self.joint, label=label)
            for label in self.joint.bristle_laws()
        }


class GroupedContactLaw(AbstractContactLaw):
    """Normal laws of the contact `label` in all N joints of a group; results are (N,).

    - `joint`: the grouped joint, whose numbers are arrays (N,).
    - `uses_entry_speed`, `force_jumps`: those of the single laws.
    """

    joint: AbstractContactJoint
    label: str = eqx.field(static=True)
    uses_entry_speed: bool = eqx.field(static=True)  # pyright: ignore
    force_jumps: bool = eqx.field(static=True)

    def _each(self, method: str, *arguments: Gap | Scalar | None) -> Scalar:
        """Return the results (N,) of the laws' method of a given name."""

        def of(joint: AbstractContactJoint, *arguments: Gap | Scalar | None) -> Scalar:
            return getattr(joint.laws()[self.label], method)(*arguments)

        return each(of, self.joint, *arguments)

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Return the normal forces, N."""
        return self._each("force", gap, entry_speed)

    def elastic_force(self, gap: Gap) -> Scalar:
        """Return the elastic parts of the forces, N."""
        return self._each("elastic_force", gap)

    def stored_energy(self, gap: Gap) -> Scalar:
        """Return the elastic energies, J."""
        return self._each("stored_energy", gap)

    def onset_offset(self) -> Scalar:
        """Return the distances between the surfaces at which the forces begin, m."""
        return self._each("onset_offset")

    def slope_jumps(self) -> bool:
        """Return whether the derivatives of the forces by the depth may jump at the onset."""
        return self.joint.laws()[self.label].slope_jumps()


class GroupedBristleLaw(AbstractBristleFriction):
    """Bristle laws of the contact `label` in all N joints of a group; results are (N,).

    `joint` is the grouped joint, whose numbers are arrays (N,).
    """

    joint: AbstractContactJoint
    label: str = eqx.field(static=True)

    def _each(self, method: str, *arguments: Vector | Scalar) -> PyTree:
        """Return the results (N,) of the laws' method of a given name."""

        def of(joint: AbstractContactJoint, *arguments: Vector | Scalar) -> PyTree:
            return getattr(joint.bristle_laws()[self.label], method)(*arguments)

        return each(of, self.joint, *arguments)

    def rate(self, deflection: Vector, slip: Vector) -> Vector:
        """Return the rates of the deflections, m/s, for deflections, m, and slips, m/s."""
        return self._each("rate", deflection, slip)

    def ratio(self, deflection: Vector, rate: Vector, slip: Vector) -> Vector:
        """Return the ratios of friction to normal force, for deflections, m, their rates, m/s, and
        slips, m/s."""
        return self._each("ratio", deflection, rate, slip)

    def sliding_ratio(self, slip_speed: Scalar) -> Scalar:
        """Return the ratios of friction to normal force in steady dry sliding at a speed in m/s."""
        return self._each("sliding_ratio", slip_speed)

    def full_deflection(self) -> Scalar:
        """Return the approximate deflections in steady sliding, m."""
        return jnp.asarray(self._each("full_deflection"), float)
