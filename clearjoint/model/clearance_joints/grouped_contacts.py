"""A group of clearance joints with the same structure, evaluated together.

Each method of a joint or law is mapped over the group, so that user-defined classes work unchanged.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import PyTree

from ...math.groups import each
from ...math.vectors import Scalar, Vector
from ..bodies import Motion, Wrench
from ..contact.friction import AbstractBristleFriction
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
            label: GroupedContactLaw(self.joint, label, law.uses_entry_speed, law.force_jumps)
            for label, law in self.joint.laws().items()
        }

    def deepest(self) -> dict[str, Scalar]:
        """Return, for each contact by label, the penetrations up to which its geometry is valid,
        (N,) m."""
        return each(lambda joint: joint.deepest(), self.joint)

    def contacts(self, motions: Motions) -> dict[str, Contact]:
        """Return the geometry of each contact by label, with arrays (N,) over the group."""
        return self._each_at(motions, "contacts")

    def _each_at(self, motions: Motions, method: str) -> PyTree:
        """Return the results of a method whose only argument is `motions`, with arrays (N,).

        **Arguments:** `motions`: of the groups of bodies, by name of the group. `method`: the
        method's name.
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
        """Return the friction forces on the second bodies, N in global axes, with components (N,);
        ``None`` without friction.

        **Arguments:** `name`: label of the contact. `contact`: its geometry, with arrays (N,).
        `normal_force`: (N,) N.
        """
        given = self.joint, contact, normal_force
        return each(lambda joint, *given: joint.friction_force(name, *given), *given)

    def bristle_laws(self) -> dict[str, AbstractBristleFriction]:
        """Return the grouped bristle law by label, for the contacts that have bristles."""
        return {label: GroupedBristleLaw(self.joint, label) for label in self.joint.bristle_laws()}


def _of_each_law(laws: str, name: str) -> PyTree:
    """Return a method for a grouped law, which calls the method `name` of the single laws of all
    joints in the group and returns arrays (N,).

    **Arguments:** `laws`: name of the joint's method that returns its laws by label, "laws" or
    "bristle_laws".
    """

    def method(self: "GroupedContactLaw | GroupedBristleLaw", *arguments: PyTree) -> PyTree:
        def of(joint: AbstractContactJoint, *arguments: PyTree) -> PyTree:
            return getattr(getattr(joint, laws)()[self.label], name)(*arguments)

        return each(of, self.joint, *arguments)

    return method


class GroupedContactLaw(AbstractContactLaw):
    """Normal laws of the contact `label` in all N joints of a group; results are (N,).

    - `joint`: the grouped joint, whose numbers are arrays (N,).
    - `uses_entry_speed`, `force_jumps`: whether the single laws need the entry speed, and whether
      their force may be nonzero at the onset or separation.
    """

    joint: AbstractContactJoint
    label: str = eqx.field(static=True)
    uses_entry_speed: bool = eqx.field(static=True)  # pyright: ignore
    force_jumps: bool = eqx.field(static=True)

    force = _of_each_law("laws", "force")
    elastic_force = _of_each_law("laws", "elastic_force")
    stored_energy = _of_each_law("laws", "stored_energy")
    onset_offset = _of_each_law("laws", "onset_offset")

    def slope_jumps(self) -> bool:
        """Return whether the derivatives of the forces by the depth may jump at the onset."""
        return self.joint.laws()[self.label].slope_jumps()


class GroupedBristleLaw(AbstractBristleFriction):
    """Bristle laws of the contact `label` in all N joints of a group; results are (N,).

    `joint` is the grouped joint, whose numbers are arrays (N,).
    """

    joint: AbstractContactJoint
    label: str = eqx.field(static=True)

    rate = _of_each_law("bristle_laws", "rate")
    ratio = _of_each_law("bristle_laws", "ratio")
    sliding_ratio = _of_each_law("bristle_laws", "sliding_ratio")
    stored_energy = _of_each_law("bristle_laws", "stored_energy")
    _full_deflections = _of_each_law("bristle_laws", "full_deflection")

    def full_deflection(self) -> Scalar:
        """Return the approximate deflections in steady sliding, m."""
        return jnp.asarray(self._full_deflections(), float)
