"""A contact that takes over from a film with depth."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ...fields.types import Single
from ...math.vectors import Scalar
from ..contact.gap import Gap
from ..contact.laws import AbstractContactLaw
from ..contact.limits import Limit

NODES, WEIGHTS = (
    0.5 * (rule + shift)
    for rule, shift in zip(np.polynomial.legendre.leggauss(8), (1.0, 0.0), strict=True)
)


def share_of_contact(depth: Scalar, transition: Scalar) -> Scalar:
    """0 up to the surface, 1 from a depth `transition` on, m; smooth between."""
    part = jnp.clip(depth / transition, 0.0, 1.0)
    return part * part * (3.0 - 2.0 * part)


class FadingIn(AbstractContactLaw):
    """A law of which a part acts, from none at the surface to all at a depth `transition`, m."""

    law: AbstractContactLaw
    transition: Single
    has_memory: bool = eqx.field(static=True)  # pyright: ignore
    force_jumps = False

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """The part of the law's force, N."""
        return self._share(gap) * self.law.force(gap, entry_speed)

    def elastic_force(self, gap: Gap) -> Scalar:
        """The part of the law's elastic force, N."""
        return self._share(gap) * self.law.elastic_force(gap)

    def stored_energy(self, gap: Gap) -> Scalar:
        """The integral of the elastic force by parts, J: by Gauss's rule in the root of the depth,
        in which energies that grow with halves of powers are polynomials."""
        end = jnp.clip(gap.depth, 0.0, self.transition)
        removed: Scalar = 0.0
        for node, weight in zip(NODES, WEIGHTS, strict=True):
            depth = end * node * node
            part = depth / self.transition
            slope = 6.0 * part * (1.0 - part) / self.transition
            here = Gap(depth, gap.rate, gap.bearing_radius, gap.clearance)
            energy = self.law.stored_energy(here)
            removed = removed + weight * 2.0 * node * end * slope * energy
        return self._share(gap) * self.law.stored_energy(gap) - removed

    def slope_jumps(self) -> bool:
        """No: whatever the law does, its part begins flat."""
        return False

    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        """Those of the law."""
        return self.law.limits(gap)

    def _share(self, gap: Gap) -> Scalar:
        return share_of_contact(gap.depth, self.transition)
