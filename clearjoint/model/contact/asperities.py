"""Contact of the asperities of two rough cylinders, which carries a part of the load beside a film.

The pressure between two rough planes depends on the ratio of their distance to their roughness (J.
A. Greenwood, J. H. Tripp 1970). Integrated around a journal that is nearly as large as its bearing,
it is a power of the penetration of the asperities.
"""

import math

import equinox as eqx

from ...fields.conversion import AbstractConverting
from ...fields.declarations import quantity
from ...fields.types import Single
from ...math.smoothing import positive_power
from ...math.vectors import Scalar, square_root
from .gap import Gap, Limit
from .laws import AbstractContactLaw

REACH = 4.0
"""Distance of the mean planes over the roughness below which asperities touch."""
FIT, EXPONENT = 4.4086e-5, 6.804
"""Fit of the integral F_5/2 of Greenwood and Tripp's pressure over the heights of the asperities by
FIT (4 - ratio)^EXPONENT, where the ratio is distance over roughness (Arcoumanis et al. 1997)."""
AROUND = math.sqrt(math.pi) * math.gamma(EXPONENT + 1.0) / math.gamma(EXPONENT + 1.5)
"""Integral of (1 - x^2)^EXPONENT from -1 to 1: the mean of the pressure along the arc of contact,
whose distance grows with the square of the angle, over its maximum, times 2."""


class GreenwoodTripp(AbstractConverting):
    r"""Pressure of the asperities of two rough surfaces.

    $$p = \frac{16 \sqrt{2} \pi}{15} (\sigma \beta \eta)^2 \sqrt{\sigma/\beta}\, E'
    F_{5/2}(h/\sigma)$$

    Here h is the distance of the surfaces' mean planes, sigma the standard deviation of the sum of
    both profiles, beta the radius of curvature of the asperities, and eta their number per area.
    F_5/2 is 4.4086e-5 (4 - h/sigma)^6.804 below a distance of 4 sigma, and zero above. From 0 to 2
    sigma, this fit deviates by at most 11 % from the integral for a normal distribution of heights.
    At 2.5 sigma it is 35 % too small; the pressure there is 0.2 % of that at zero distance.

    **Arguments:**

    - `roughness`: sigma, m: the root of the sum of the squares of both surfaces' roughness (rms).
    - `modulus`: E', Pa, with 1/E' = (1 - nu1^2)/E1 + (1 - nu2^2)/E2; 1.14e11 Pa for steel on steel.
    - `density`: sigma beta eta, without unit; usually 0.03 to 0.05.
    - `sharpness`: sigma/beta, without unit; usually 1e-4 to 1e-2.

    **Raises:** `ValueError` if a value is not positive.

    **Source:** J. A. Greenwood, J. H. Tripp 1970; C. Arcoumanis, P. Ostovar, R. Mortier 1997.

    >>> rough = cj.laws.GreenwoodTripp(roughness=0.5e-6, modulus=1.14e11)
    >>> print(f"{rough.pressure(1e-6) / 1e6:.2f} MPa")
    0.13 MPa
    """

    roughness: Single = quantity("m", positive=True, remedy="give the rms value in m")
    modulus: Single = quantity("Pa", positive=True, remedy="give E' in Pa; 1 GPa is 1e9 Pa")
    density: Single = quantity("1", default=0.04, positive=True)
    sharpness: Single = quantity("1", default=1e-3, positive=True)

    @property
    def reach(self) -> Scalar:
        """Distance of the mean planes below which asperities touch, 4 sigma, m."""
        return REACH * self.roughness

    def pressure(self, distance: Scalar) -> Scalar:
        """Return the mean pressure, Pa, at a distance of the mean planes, m."""
        return self._scale() * positive_power(REACH - distance / self.roughness, EXPONENT)

    def force(self, depth: Scalar, radius: Scalar, clearance: Scalar, length: Scalar) -> Scalar:
        """Return the force on a journal that touches its bearing with asperities, N.

        The pressure is integrated along the arc of contact, on which the distance grows with half
        the clearance times the square of the angle. The relative error is of the order of
        roughness over clearance.

        **Arguments:** in m. `depth`: by how much the smallest distance is below `reach`. `radius`:
        of the bearing. `clearance`: between the mean surfaces. `length`: of the journal.
        """
        ratio = positive_power(depth / self.roughness, EXPONENT + 0.5)
        arc = radius * square_root(2.0 * self.roughness / clearance)
        return self._scale() * AROUND * length * arc * ratio

    def _scale(self) -> Scalar:
        """Return the pressure, Pa, where the distance is 3 sigma."""
        return (
            16.0
            * math.sqrt(2.0)
            * math.pi
            / 15.0
            * FIT
            * self.density**2
            * square_root(self.sharpness)
            * self.modulus
        )


class AsperityLaw(AbstractContactLaw):
    """Contact of asperities, and of the walls themselves once the mean surfaces meet.

    The penetration is counted from the distance at which the asperities begin to touch.

    - `asperities`: their pressure.
    - `length`: of the part of the journal to which the contact belongs, m.
    - `law`: of the walls; its penetration begins where the mean surfaces meet.
    - `uses_entry_speed`: that of `law`.
    """

    asperities: GreenwoodTripp
    length: Single
    law: AbstractContactLaw
    uses_entry_speed: bool = eqx.field(static=True)  # pyright: ignore
    force_jumps = False

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Return the normal force of asperities and walls, N."""
        return self._of_asperities(gap) + self.law.force(self._between_walls(gap), entry_speed)

    def elastic_force(self, gap: Gap) -> Scalar:
        """Return the elastic force of asperities and walls, N."""
        return self._of_asperities(gap) + self.law.elastic_force(self._between_walls(gap))

    def stored_energy(self, gap: Gap) -> Scalar:
        """Return the integral of the elastic force over the penetration, J."""
        of_asperities = self._of_asperities(gap) * gap.depth / (EXPONENT + 1.5)
        return of_asperities + self.law.stored_energy(self._between_walls(gap))

    def slope_jumps(self) -> bool:
        """Return ``False``: the force of asperities starts with zero slope."""
        return False

    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        """Return the validity limits of the law of the walls at a gap."""
        return self.law.limits(self._between_walls(gap))

    def _of_asperities(self, gap: Gap) -> Scalar:
        walls = self._between_walls(gap)
        assert walls.bearing_radius is not None and walls.clearance is not None
        sizes = walls.bearing_radius, walls.clearance, self.length
        return self.asperities.force(gap.depth, *sizes)

    def _between_walls(self, gap: Gap) -> Gap:
        """Return the gap of the mean surfaces."""
        reach = self.asperities.reach
        clearance = None if gap.clearance is None else gap.clearance + reach
        return Gap(gap.depth - reach, gap.rate, gap.bearing_radius, clearance)
