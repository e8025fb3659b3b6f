"""Line contact of a journal along its bearing: the elastic force by length, radii and materials.

Each stands in the place of a stiffness in a law of the Hunt-Crossley family, so that it gets the
damping of any of them, and what they deliver stays: that depends on no elastic force. Here are what
all share and the forces that are explicit; the logarithmic laws are in `logarithmic_cylinders`.
"""

import abc
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ...fields.declarations import quantity
from ...fields.types import Single
from ...math.vectors import Scalar
from .gap import Gap
from .limits import Limit
from .materials import AbstractMaterialPair
from .stiffness import AbstractElasticity

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)
_PLACES, _PARTS = 0.5 * (_NODES + 1.0), 0.5 * _WEIGHTS
"""Of Gauss' quadrature over [0, 1]."""
_STRAIGHT_FROM = 0.99
"""Of the deepest penetration, where some formulas have an infinite stiffness."""


class AbstractCylinder(AbstractMaterialPair, AbstractElasticity):
    """A journal that touches its bearing along a line of a length, m.

    **Arguments:** as those of `RavnStiffness`, and the `length` of the line. Each base of a
    `ClearanceJoint` carries the whole law: give it half of the journal's length.

    A subclass gives `line_force`; what it does not say of the energy is integrated.

    ```python
    import clearjoint as cj
    import jax.numpy as jnp

    class Foundation(cj.extend.AbstractCylinder):
        def line_force(self, gap, depth):
            return depth * jnp.sqrt(depth / gap.clearance) / self.compliance()

    law = cj.laws.LankaraniNikravesh(0.9, Foundation(207e9, 0.3, length=10e-3))
    ```
    """

    length: Single = quantity(
        "m", positive=True, usual=(1e-5, 10.0), remedy="give it in m; 1 mm is 1e-3 m", kw_only=True
    )

    @abc.abstractmethod
    def line_force(self, gap: Gap, depth: Scalar) -> Scalar:
        """Force over length, N/m, at a positive depth, m; the gap tells the radii."""

    def line_energy(self, gap: Gap, depth: Scalar) -> Scalar:
        """The integral of `line_force`, J/m, at a positive depth; by Gauss' quadrature in the root
        of the depth, of which the force is a smooth function."""
        depths = [depth * place**2 for place in _PLACES]
        forces = [self.line_force(gap, at) for at in depths]
        parts = zip(_PARTS, _PLACES, forces, strict=True)
        return sum(part * 2.0 * place * force for part, place, force in parts) * depth

    def deepest(self, gap: Gap) -> Scalar | None:
        """The penetration in m up to which the formula holds, or ``None`` if there is no such."""
        del gap
        return None

    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        """The penetration, up to the deepest."""
        deepest = self.deepest(gap)
        if deepest is None:
            return ()
        return (Limit(type(self).__name__, "penetration", "m", gap.depth, 0.0, deepest),)

    def force(self, gap: Gap, exponent: float) -> Scalar:
        """Elastic force in N, straight from shortly before the deepest penetration on; the law's
        exponent plays no part."""
        del exponent
        touches, depth = _positive(gap)
        straight = self._straight(gap)
        if straight is None:
            load = self.line_force(gap, depth)
        else:
            beyond = jnp.maximum(depth - straight.depth, 0.0)
            load = self.line_force(gap, jnp.minimum(depth, straight.depth))
            load += straight.slope * beyond
        return jnp.where(touches, self.length * load, 0.0)

    def energy(self, gap: Gap, exponent: float) -> Scalar:
        """The force's integral over the penetration, J."""
        del exponent
        touches, depth = _positive(gap)
        straight = self._straight(gap)
        if straight is None:
            energy = self.line_energy(gap, depth)
        else:
            beyond = jnp.maximum(depth - straight.depth, 0.0)
            energy = self.line_energy(gap, jnp.minimum(depth, straight.depth))
            energy += beyond * (straight.load + 0.5 * straight.slope * beyond)
        return jnp.where(touches, self.length * energy, 0.0)

    def _straight(self, gap: Gap) -> "_Straight | None":
        """Where the force becomes straight, if it does."""
        deepest = self.deepest(gap)
        if deepest is None:
            return None
        depth = jnp.asarray(_STRAIGHT_FROM * deepest)
        along = jnp.ones_like(depth)
        load, slope = jax.jvp(lambda depth: self.line_force(gap, depth), (depth,), (along,))
        return _Straight(depth, load, slope)


class _Straight(NamedTuple):
    """A depth, m, the force over length there, N/m, and what it grows by from there on, N/m^2."""

    depth: Scalar
    load: Scalar
    slope: Scalar


def _positive(gap: Gap) -> tuple[Scalar, Scalar]:
    """Whether there is a penetration, and it, or a stand-in where there is none."""
    touches = gap.depth > 0.0
    return touches, jnp.where(touches, gap.depth, 1e-6)


def radii_of(gap: Gap) -> tuple[Scalar, Scalar, Scalar]:
    """Bearing radius, journal radius and radial clearance, m."""
    assert gap.bearing_radius is not None and gap.clearance is not None
    return gap.bearing_radius, gap.journal_radius, gap.clearance


class LiuCylinder(AbstractCylinder):
    r"""F = pi/2 E* L delta sqrt(delta/(2 (dR + delta))) (C. Liu, K. Zhang, R. Yang 2007).

    $$F = \frac{\pi}{2} E^* L \delta \sqrt{\frac{\delta}{2 (\Delta R + \delta)}}$$

    For large conformity too: dR is the clearance, 1/E* the sum of (1 - nu^2)/E.

    >>> cylinder = cj.laws.LiuCylinder(207e9, 0.3, length=20e-3)
    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.1e-3)
    >>> print(f"{cj.laws.Hertz(cylinder).elastic_force(gap):.0f} N")
    251 N
    """

    def line_force(self, gap: Gap, depth: Scalar) -> Scalar:
        """Force over length, N/m."""
        clearance = radii_of(gap)[2]
        root = jnp.sqrt(depth / (2.0 * (clearance + depth)))
        return 0.5 * jnp.pi / self.compliance() * depth * root


class PereiraCylinder(AbstractCylinder):
    r"""F = (0.965 dR + 0.0965) L E*/dR delta^n in mm, N and MPa (C. Pereira et al. 2011, 2014), for
    a journal inside of a bearing.

    $$F = \frac{(0.965 \Delta R + 0.0965) L E^*}{\Delta R} \delta^n$$

    n = Y dR^-0.005, with Y = 1.51 ln(1000 dR)^-0.151 up to a clearance dR of 0.34954 mm and
    0.0151 dR + 1.151 from there. It holds for clearances from 0.005 to 10 mm. Its damping is that
    of `LankaraniNikravesh`. All arguments are in SI units.

    >>> cylinder = cj.laws.PereiraCylinder(207e9, 0.3, length=20e-3)
    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.1e-3)
    >>> print(f"{cj.laws.Hertz(cylinder).elastic_force(gap):.0f} N")
    1009 N
    """

    def line_force(self, gap: Gap, depth: Scalar) -> Scalar:
        """Force over length, N/m: the same number as N/mm times a thousand."""
        clearance = 1e3 * radii_of(gap)[2]
        narrow = 1.51 * jnp.log(1e3 * jnp.clip(clearance, 5e-3, 0.34954)) ** -0.151
        slope = jnp.where(clearance < 0.34954, narrow, 0.0151 * clearance + 1.151)
        exponent = slope * clearance**-0.005
        modulus = 1e-6 / self.compliance()
        factor = (0.965 * clearance + 0.0965) * modulus / clearance
        return 1e3 * factor * (1e3 * depth) ** exponent

    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        """The clearance."""
        clearance = radii_of(gap)[2]
        return (Limit(type(self).__name__, "clearance", "m", clearance, 5e-6, 10e-3),)


_MOST_CONTACT = 0.8
"""b^2 of `PerssonCylinder` up to which its force is taken; at 0.8355 it is infinite."""


class PerssonCylinder(AbstractCylinder):
    r"""The load of a half-angle of contact by A. Persson 1964, exact for conformal contact of one
    material; the half-angle of a penetration by the overlap of the undeformed circles.

    $$\frac{E' \Delta R}{P} = \frac{2 - \ln(b^2 + 1) - 2 b^4}{\pi b^2 (b^2 + 1)}, \quad b =
    \tan\frac{\varepsilon}{2}$$

    E' dR/P = (2 - ln(b^2 + 1) - 2 b^4)/(pi b^2 (b^2 + 1)) with P = F/L, b = tan(half-angle/2) and
    E' = E/(1 - nu^2). Persson says nothing of the penetration. With the overlap, cos(half-angle) =
    dR/(dR + delta) as in `LiuCylinder`, the force is several times that of the other laws at small
    penetrations. It is here for `load` and `half_angle`, which tell where they end.

    >>> cylinder = cj.laws.PerssonCylinder(207e9, 0.3, length=20e-3)
    >>> load = cylinder.load(np.pi / 4, clearance=0.1e-3)  # of a half-angle of 45 degrees
    >>> print(f"{load:.3e} N/m")
    1.611e+05 N/m
    """

    def line_force(self, gap: Gap, depth: Scalar) -> Scalar:
        """Force over length, N/m."""
        clearance = radii_of(gap)[2]
        return self._line_load(depth / (2.0 * clearance + depth), clearance)

    def half_angle(self, gap: Gap) -> Scalar:
        """Half-angle of the contact at the depth of a gap, rad."""
        clearance = radii_of(gap)[2]
        return jnp.arccos(clearance / (clearance + jnp.maximum(gap.depth, 0.0)))

    def load(self, half_angle: Scalar, clearance: Scalar) -> Scalar:
        """The force in N that has a half-angle of contact, rad, at a radial clearance, m."""
        return self.length * self._line_load(jnp.tan(0.5 * half_angle) ** 2, clearance)

    def _line_load(self, square: Scalar, clearance: Scalar) -> Scalar:
        """Force over length, N/m, by b^2; E' of one material is twice E*."""
        numerator = 2.0 - jnp.log1p(square) - 2.0 * square**2
        modulus = 2.0 / self.compliance()
        return modulus * clearance * jnp.pi * square * (square + 1.0) / numerator

    def deepest(self, gap: Gap) -> Scalar:
        """Eight clearances, where nearly half of the bearing is in contact."""
        return 2.0 * _MOST_CONTACT / (1.0 - _MOST_CONTACT) * radii_of(gap)[2]
