"""The gap of a contact, and the sliding of its surfaces: what laws and friction are given."""

from dataclasses import dataclass

import jax

from ...math.vectors import Scalar, Vector


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class Gap:
    """All that a law may know of a contact.

    `depth`: penetration, m, negative in flight (eq. 13); `rate`: its time derivative, m/s (eq. 21);
    `bearing_radius` and radial `clearance`: m (``None`` for flat surfaces). The clearance is given,
    and not the journal's radius, since a difference of radii would spoil its last digits.

    >>> extend.Gap(depth=1e-6, rate=0.05, bearing_radius=10e-3, clearance=0.5e-3)
    Gap(depth=1e-06, rate=0.05, bearing_radius=0.01, clearance=0.0005)
    """

    depth: Scalar
    rate: Scalar
    bearing_radius: Scalar | None = None
    clearance: Scalar | None = None

    @property
    def journal_radius(self) -> Scalar:
        """Bearing radius less clearance, m."""
        assert self.bearing_radius is not None and self.clearance is not None
        return self.bearing_radius - self.clearance


def slip_velocity(relative: Vector, normal: Vector, rate: Scalar) -> Vector:
    """The tangential part of a relative velocity, m/s.

    >>> normal, relative = extend.UNIT_X, extend.Vector(0.1, 0.2, 0.0)
    >>> extend.slip_velocity(relative, normal, rate=0.1).y
    0.2
    """
    return relative - normal * rate
