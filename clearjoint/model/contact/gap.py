"""Penetration of a contact and slip of its surfaces: the inputs of contact and friction laws."""

from dataclasses import dataclass

import jax

from ...math.vectors import Scalar, Vector


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class Gap:
    """Penetration of a contact, its rate, and the radii of the surfaces.

    - `depth`: penetration, m, negative without contact (eq. 13).
    - `rate`: its time derivative, m/s (eq. 21).
    - `bearing_radius` and radial `clearance`: m, ``None`` for flat surfaces. The clearance is given
      instead of the journal's radius, because a difference of radii would lose digits.

    >>> extend.Gap(depth=1e-6, rate=0.05, bearing_radius=10e-3, clearance=0.5e-3)
    Gap(depth=1e-06, rate=0.05, bearing_radius=0.01, clearance=0.0005)
    """

    depth: Scalar
    rate: Scalar
    bearing_radius: Scalar | None = None
    clearance: Scalar | None = None

    @property
    def journal_radius(self) -> Scalar:
        """Bearing radius minus clearance, m."""
        assert self.bearing_radius is not None and self.clearance is not None
        return self.bearing_radius - self.clearance


def slip_velocity(relative: Vector, normal: Vector, rate: Scalar) -> Vector:
    """Return the tangential part of a relative velocity, m/s.

    **Arguments:** `relative`: velocity, m/s. `normal`: unit vector. `rate`: component of the
    velocity along the normal, m/s.

    >>> normal, relative = extend.UNIT_X, extend.Vector(0.1, 0.2, 0.0)
    >>> extend.slip_velocity(relative, normal, rate=0.1).y
    0.2
    """
    return relative - normal * rate
