"""A normal law multiplied by a constant weight."""

from collections.abc import Callable
from typing import Self

import equinox as eqx

from ...math.vectors import Scalar
from .gap import Gap, Limit
from .laws import AbstractContactLaw


class WeightedLaw(AbstractContactLaw):
    """A contact law times a weight, for one of several contacts that share a line contact.

    The weights of all these contacts add up to 1, as those of a quadrature rule along the line.

    - `law`: the law of the whole contact.
    - `weight`: share of the law's force and energy.
    - `uses_entry_speed`, `force_jumps`: those of `law`.
    """

    law: AbstractContactLaw
    weight: float = eqx.field(static=True)
    uses_entry_speed: bool = eqx.field(static=True)  # pyright: ignore
    force_jumps: bool = eqx.field(static=True)

    @classmethod
    def of(cls, law: AbstractContactLaw, weight: float) -> Self:
        """Return a law multiplied by a weight."""
        return cls(law, weight, law.uses_entry_speed, law.force_jumps)

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Return the weight times the law's force, N."""
        return self.weight * self.law.force(gap, entry_speed)

    def elastic_force(self, gap: Gap) -> Scalar:
        """Return the weight times the law's elastic force, N."""
        return self.weight * self.law.elastic_force(gap)

    def stored_energy(self, gap: Gap) -> Scalar:
        """Return the weight times the law's energy, J."""
        return self.weight * self.law.stored_energy(gap)

    def onset_offset(self) -> Scalar:
        """Return the distance of the surfaces at which the law's force begins, m."""
        return self.law.onset_offset()

    def slope_jumps(self) -> bool:
        """Return whether the derivative of the law's force may jump at the onset."""
        return self.law.slope_jumps()

    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        """Return the validity limits of the law at a gap."""
        return self.law.limits(gap)

    @property
    def delivered_restitution(self) -> Callable[[], Scalar]:
        """Method of the law that returns the coefficient of restitution of a free impact.

        It is unchanged, because an impact in which force and mass have the same factor has the same
        motion. It is a property, so that ``hasattr`` tells whether the law has the method.

        **Raises:** `AttributeError` if the law has no such method.
        """
        return self.law.delivered_restitution  # pyright: ignore[reportAttributeAccessIssue]


def whole_law(law: AbstractContactLaw) -> AbstractContactLaw:
    """Return the law of the whole contact for a `WeightedLaw`, and any other law unchanged."""
    return law.law if isinstance(law, WeightedLaw) else law
