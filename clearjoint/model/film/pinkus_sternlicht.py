"""Film of an infinitely long bearing, as cited in the clearance literature."""

import math

import jax.numpy as jnp

from ...fields.declarations import quantity
from ...fields.types import Single
from ...math.smoothing import norm_and_direction
from ...math.vectors import Vector
from .laws import AbstractFilm, FilmGap


class PinkusSternlichtFilm(AbstractFilm):
    """Film of an infinitely long bearing with squeeze; use it only to reproduce published results.

    With the eccentricity ratio e, its rate e', and w the sum of the spins minus twice the rate of
    the offset's angle, let k^2 = (1 - e^2) ((w/(2 e'))^2 + 1/e^2). For e' > 0 the radial and
    tangential forces, over mu L R^3/c^2, are

        -6 e' (4 k e^2 + (2 + e^2) pi) (k + 3)/((2 + e^2) (1 - e^2)^1.5 (k + 3/2)),
        6 pi e w (k + 3)/((2 + e^2) (1 - e^2)^0.5 (k + 3/2)).

    For e' < 0, k replaces k + 3, and the radial force is 6 e' (4 k e^2 - (2 + e^2) pi) .... The
    cited papers print its leading sign wrongly; the force would jump at e' = 0.

    The formula is approximate: its error is 1 to 23 % for moderate squeeze and 34 % where squeeze
    dominates. An infinitely long bearing carries far more than a short one.

    **Arguments:** `viscosity`: mu, Pa s.

    **Source:** O. Pinkus, B. Sternlicht 1961, as in P. Ravn, S. Shivaswamy, B. J. Alshaer, H. M.
    Lankarani 2000 and P. Flores, J. Ambrosio, J. C. P. Claro, H. M. Lankarani, C. S. Koshy 2006.

    >>> gap = extend.FilmGap(
    ...     axis=extend.UNIT_Z,
    ...     offset=extend.Vector(0.5, 0.0, 0.0),
    ...     rate=extend.Vector(0.0, -100.0, 0.0),
    ...     spin=200.0,
    ...     bearing_radius=25e-3,
    ...     clearance=50e-6,
    ...     length=12.5e-3,
    ... )
    >>> force = cj.films.PinkusSternlichtFilm(viscosity=0.02).force(gap)
    >>> print(f"{force.x:.1f} N, {force.y:.1f} N")
    -1111.1 N, 3023.0 N
    """

    viscosity: Single = quantity("Pa s", positive=True, remedy="give mu in Pa s")

    def force(self, gap: FilmGap) -> Vector:
        """Return the force on the journal, N.

        The formula is rearranged so that nothing is divided by the eccentricity or its rate.
        """
        offset, rate = gap.offset, gap.rate
        square = offset.dot(offset)
        rho = 1.0 - square
        root = jnp.sqrt(rho)
        speed, _ = norm_and_direction(rate)
        closing, size = offset.dot(rate), jnp.abs(offset.dot(rate))
        # All terms are multiplied by e e', so that nothing is divided by e or e'.
        k_product = speed * root  # k e e'
        moves = speed > 0.0
        numerator = k_product + jnp.where(closing > 0.0, 3.0, 0.0) * size
        factor = jnp.where(moves, numerator / jnp.where(moves, k_product + 1.5 * size, 1.0), 1.0)
        rotation = rate * (12.0 * math.pi / root)
        squeeze = offset * ((18.0 * math.pi * closing + 24.0 * k_product) / (rho * root))
        scale = self.viscosity * gap.length * gap.bearing_radius**3 / gap.clearance**2
        return (rotation + squeeze) * (-scale * factor / (2.0 + square))
