"""Interface of the film laws: the force of a lubricant on a journal from its position and rate.

A film depends on the spins of both surfaces only through half their sum: in axes that rotate with
this speed the gap changes by the journal's own motion only (O. Reynolds 1886). Film laws receive
the journal's rate in these axes, and need neither the separate spins nor the bearing's motion.
"""

import abc
import math
from dataclasses import dataclass

import equinox as eqx
import jax

from ...fields.conversion import AbstractConverting
from ...fields.types import Single
from ...math.vectors import Scalar, Vector, square_root
from ..contact.limits import Limit


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class FilmGap:
    """Position and motion of a journal in its bearing, as inputs of a film law.

    - `axis`: of the bearing, a unit vector. `offset` and `rate` are perpendicular to it.
    - `offset`: vector from the bearing's axis to the journal's, divided by the clearance; its
      length is the eccentricity ratio, below 1.
    - `rate`: of the offset, 1/s, as seen in axes that rotate with half the sum of the two spins.
    - `spin`: of the journal relative to the bearing about the axis, rad/s.
    - `bearing_radius`: m.
    - `clearance`: radius of the bearing less that of the journal, m.
    - `length`: of the film along the axis, m.

    >>> gap = extend.FilmGap(
    ...     axis=extend.UNIT_Z,
    ...     offset=extend.Vector(0.5, 0.0, 0.0),
    ...     rate=extend.Vector(0.0, -100.0, 0.0),
    ...     spin=200.0,
    ...     bearing_radius=25e-3,
    ...     clearance=50e-6,
    ...     length=12.5e-3,
    ... )
    >>> print(f"{gap.offset.dot(gap.offset) ** 0.5}")  # the eccentricity ratio
    0.5
    """

    axis: Vector
    offset: Vector
    rate: Vector
    spin: Scalar
    bearing_radius: Scalar
    clearance: Scalar
    length: Scalar


class AbstractFilm(AbstractConverting):
    """Base class of lubricant films with a dynamic `viscosity`, Pa s.

    A subclass defines the force on the journal. The force and its derivatives must be finite at
    zero offset and at zero rate, where these vectors have no direction. Test it with
    `clearjoint.testing.check_film`.

    ```python
    import math

    import clearjoint as cj
    import jax.numpy as jnp
    from clearjoint.testing import check_film

    class LongFullFilm(cj.extend.AbstractFilm):
        viscosity: float  # Pa s

        def force(self, gap):
            square = gap.offset.dot(gap.offset)
            root = jnp.sqrt(1.0 - square)
            rotation = gap.rate * (2.0 / root)
            squeeze = gap.offset * (3.0 * gap.offset.dot(gap.rate) / root**3)
            scale = self.viscosity * gap.length * gap.bearing_radius**3 / gap.clearance**2
            return (rotation + squeeze) * (-12.0 * math.pi * scale / (2.0 + square))

    film = LongFullFilm(viscosity=0.02)
    check_film(film)
    scene, state = cj.mechanisms.rotor_in_bearing(film=film)
    ```
    """

    viscosity: eqx.AbstractVar[Single]

    @abc.abstractmethod
    def force(self, gap: FilmGap) -> Vector:
        """Return the force on the journal, N, perpendicular to the axis.

        Its scalar product with the rate of the gap must not be positive: a film dissipates energy.
        """

    def drag(self, gap: FilmGap) -> Scalar:
        """Return the moment on the journal about the bearing's axis, N m; it opposes the spin.

        The default is that of a complete film, -2 pi mu R^3 L spin/(c sqrt(1 - eps^2)), with the
        viscosity mu, bearing radius R, length L, clearance c and eccentricity ratio eps (A.
        Sommerfeld 1904).
        """
        height = gap.clearance * square_root(1.0 - gap.offset.dot(gap.offset))
        return (
            -2.0
            * math.pi
            * self.viscosity
            * gap.bearing_radius**3
            * gap.length
            * (gap.spin / height)
        )

    def limits(self, bearing_radius: Scalar, length: Scalar) -> tuple[Limit, ...]:
        """Return the validity limits of the film law; an empty tuple by default.

        **Arguments:** `bearing_radius`, `length`: of the bearing and the film, m.
        """
        del bearing_radius, length
        return ()
