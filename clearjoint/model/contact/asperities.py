"""Contact of the asperities of two rough cylinders, which carries a part of the load beside a film.

The pressure between two rough planes depends on the ratio of their distance to their roughness (J.
A. Greenwood, J. H. Tripp 1970). Integrated around a journal that is nearly as large as its bearing,
it is a power of the penetration of the asperities.
"""

import math

import equinox as eqx

from ...fields.checks import require
from ...fields.conversion import AbstractConverting
from ...fields.declarations import quantity
from ...fields.types import Single
from ...math.smoothing import positive_power
from ...math.vectors import Scalar, square_root
from .gap import Gap, Limit
from .laws import AbstractContactLaw, require_instance

REACH = 4.0
"""Distance of the mean planes over the roughness below which asperities touch."""
FIT, EXPONENT = 4.4086e-5, 6.804
"""Fit of the integral F_5/2 of Greenwood and Tripp's pressure over the heights of the asperities by
FIT (4 - ratio)^EXPONENT, where the ratio is distance over roughness (Arcoumanis et al. 1997)."""
AROUND = math.sqrt(math.pi) * math.gamma(EXPONENT + 1.0) / math.gamma(EXPONENT + 1.5)
"""Integral of (1 - x^2)^EXPONENT from -1 to 1.

The integrand is the pressure over its maximum, and x the angle from the closest point over that at
the end of the arc of contact: the distance of the surfaces grows with the square of the angle.
"""


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
        """Return the mean pressure, Pa, at a distance of the mean planes, m.

        It is zero beyond `reach`.
        """
        return self._scale() * positive_power(REACH - distance / self.roughness, EXPONENT)

    def force(self, depth: Scalar, radius: Scalar, clearance: Scalar, length: Scalar) -> Scalar:
        """Return the force on a journal that touches its bearing with asperities, N.

        The pressure is integrated along the arc of contact, on which the distance grows with half
        the clearance times the square of the angle. The relative error is of the order of
        roughness over clearance.

        **Arguments:** in m. `depth`: by how much the smallest distance is below `reach`. `radius`:
        of the bearing. `clearance`: between the mean surfaces. `length`: of the journal.
        """
        # At an angle phi from the closest point, 4 - distance/sigma is
        # (depth - clearance phi^2/2)/sigma, which is zero at phi = sqrt(2 depth/clearance), the end
        # of the arc. With x = phi over this angle it is (depth/sigma) (1 - x^2). So the integral is
        # `AROUND` times (depth/sigma)^EXPONENT times half the arc, radius sqrt(2 depth/clearance),
        # whose factor sqrt(depth/sigma) is contained in `ratio`.
        ratio = positive_power(depth / self.roughness, EXPONENT + 0.5)
        arc = radius * square_root(2.0 * self.roughness / clearance)
        return self._scale() * AROUND * length * arc * ratio

    def _scale(self) -> Scalar:
        """Return the pressure, Pa, where the distance is 3 sigma."""
        factor = 16.0 * math.sqrt(2.0) * math.pi / 15.0 * FIT
        return factor * self.density**2 * square_root(self.sharpness) * self.modulus


class RoughCylinders(AbstractContactLaw):
    """Contact of a rough journal with its bearing: of asperities first, then of the walls.

    The force begins at a distance of four times the roughness, with the pressure of the asperities
    along the arc of contact. The force of the walls is added where the mean surfaces meet. In a
    `LubricatedJoint` without `transition`, film and asperities share the load.

    **Arguments:**

    - `asperities`: a `GreenwoodTripp`.
    - `length`: of the part of the journal to which the contact belongs, m. A `ClearanceJoint` has a
      contact at each of the journal's two ends, and both apply the full law: pass half the
      journal's length. If the joint's argument `line_points` is given, the law is that of the whole
      journal: pass its length.
    - `law`: of the walls. Its force begins with zero slope, such as Hertz's with an exponent above
      one.

    The surfaces must be cylinders: the force needs the bearing's radius and the clearance in `Gap`.

    **Raises:** `ValueError` if the length is not positive, `asperities` or `law` is of another
    class, or the force of `law` begins with a jump or a slope.

    ```python
    import clearjoint as cj

    rough = cj.laws.GreenwoodTripp(roughness=0.5e-6, modulus=1.14e11)
    law = cj.laws.RoughCylinders(rough, length=10e-3, law=cj.laws.Hertz(1e10))
    dry = cj.ClearanceJoint(
        "ground", "rotor", bearing_radius=25e-3, clearance=50e-6, journal_length=20e-3,
        law=law, friction=cj.frictions.RegularisedCoulomb(0.1), axial=cj.FixedAxially(),
    )
    joint = cj.LubricatedJoint(dry, cj.films.CaponeFilm(viscosity=0.02), transition=None)
    ```
    """

    asperities: GreenwoodTripp
    length: Single = quantity("m", positive=True, remedy="give the length of the contact in m")
    law: AbstractContactLaw  # pyright: ignore[reportGeneralTypeIssues]
    uses_entry_speed: bool = eqx.field(static=True, init=False)  # pyright: ignore
    force_jumps = False

    def __init__(self, asperities: GreenwoodTripp, length: Scalar, law: AbstractContactLaw):
        self.asperities, self.length, self.law = asperities, length, law
        # `__check_init__` refuses a `law` of another class afterwards, with a clear message.
        self.uses_entry_speed = bool(getattr(law, "uses_entry_speed", False))

    def __check_init__(self):
        require_instance("asperities", self.asperities, GreenwoodTripp)
        require_instance("law", self.law, AbstractContactLaw)
        # The mean surfaces meet while asperities are already in contact. This is no event, so that
        # steps don't end there, and a jump of the force or its slope would be inside of a step.
        fine = not (self.law.force_jumps or self.law.slope_jumps())
        given, remedy = type(self.law).__name__, "pass for example Hertz(1e10)"
        require(fine, "law", given, "a law whose force begins with zero slope", remedy)

    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Return the normal force of asperities and walls, N."""
        return self._of_asperities(gap) + self.law.force(gap, entry_speed)

    def elastic_force(self, gap: Gap) -> Scalar:
        """Return the elastic force of asperities and walls, N."""
        return self._of_asperities(gap) + self.law.elastic_force(gap)

    def stored_energy(self, gap: Gap) -> Scalar:
        """Return the integral of the elastic force over the penetration, J."""
        depth = gap.depth + self.asperities.reach
        # The force of the asperities is proportional to depth^(EXPONENT + 0.5).
        of_asperities = self._of_asperities(gap) * depth / (EXPONENT + 1.5)
        return of_asperities + self.law.stored_energy(gap)

    def onset_offset(self) -> Scalar:
        """Return the distance of the mean surfaces at which asperities begin to touch, m."""
        return self.asperities.reach

    def slope_jumps(self) -> bool:
        """Return ``False``: the force of asperities begins with zero slope."""
        return False

    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        """Return the validity limits of the law of the walls at a gap."""
        return self.law.limits(gap)

    def _of_asperities(self, gap: Gap) -> Scalar:
        """Return the force of the asperities, N."""
        radius, clearance = gap.bearing_radius, gap.clearance
        assert radius is not None and clearance is not None
        depth = gap.depth + self.asperities.reach
        return self.asperities.force(depth, radius, clearance, self.length)
