"""Film of a short bearing."""

import math

import jax.numpy as jnp

from ...fields.declarations import quantity
from ...fields.types import Single
from ...math.functions import polar_angle
from ...math.smoothing import norm_and_direction
from ...math.vectors import Vector
from .laws import AbstractFilm, FilmGap


class CaponeFilm(AbstractFilm):
    r"""Film of a short bearing with rotation and squeeze, from the region of positive pressure.

    $$F = -\frac{\mu R L^3}{2 c^2 \rho} (3 V |u| x + G u + 2 Q\, n \times u)$$

    Here x is the offset, u = |u| e its rate and n the axis; rho = 1 - x.x, d = x.e,
    q = n.(x cross e), G = 2/sqrt(rho) (pi/2 + atan(d/sqrt(rho))), V = (2 + d G)/rho and
    Q = q/(1 - q^2). The force is exact in the limit of a small length-to-diameter ratio L/D. At an
    eccentricity ratio of 0.5 it is too large by 6 % for L/D = 1/4, and by 69 % for L/D = 1.

    **Arguments:** `viscosity`: mu, Pa s.

    **Source:** G. Capone 1986, 1991; G. Adiletta, A. R. Guido, C. Rossi 1996 (there in components
    along fixed axes).

    >>> gap = extend.FilmGap(
    ...     axis=extend.UNIT_Z,
    ...     offset=extend.Vector(0.5, 0.0, 0.0),
    ...     rate=extend.Vector(0.0, -100.0, 0.0),
    ...     spin=200.0,
    ...     bearing_radius=25e-3,
    ...     clearance=50e-6,
    ...     length=12.5e-3,
    ... )
    >>> force = cj.films.CaponeFilm(viscosity=0.02).force(gap)
    >>> print(f"{force.x:.1f} N, {force.y:.1f} N")
    -69.4 N, 94.5 N
    """

    viscosity: Single = quantity("Pa s", positive=True, remedy="give mu in Pa s")

    def force(self, gap: FilmGap) -> Vector:
        """Return the force on the journal, N: the integral of the positive pressures."""
        offset, rate = gap.offset, gap.rate
        speed, direction = norm_and_direction(rate)
        rho = 1.0 - offset.dot(offset)
        root = jnp.sqrt(rho)
        along = offset.dot(direction)
        across = gap.axis.dot(offset.cross(direction))
        wedge = 2.0 / root * (0.5 * math.pi + polar_angle(along, root))
        squeeze = (2.0 + along * wedge) / rho
        transverse = across / (1.0 - across * across)
        scale = self.viscosity * gap.bearing_radius * gap.length**3 / (2.0 * gap.clearance**2)
        flow = (
            offset * (3.0 * squeeze * speed)
            + rate * wedge
            + gap.axis.cross(rate) * (2.0 * transverse)
        )
        return flow * (-scale / rho)
