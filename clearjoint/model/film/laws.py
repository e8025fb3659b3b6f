"""Film laws: the force of a lubricant on a journal, from where it is in its bearing and how it
moves there.

A film feels the speeds of both surfaces by half the sum of their spins alone: seen from axes that
turn so fast, the gap fills and empties by the journal's own motion only (O. Reynolds 1886). So laws
get the journal's rate in these axes, and need neither the spins nor the bearing's motion.
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
    """All that a film may know of the journal in its bearing.

    - `axis`: of the bearing, a unit vector. `offset` and `rate` are across it.
    - `offset`: from the bearing's axis to the journal's, over the clearance; its length is the
      eccentricity ratio, below 1.
    - `rate`: 1/s, the offset's in axes that turn with half the sum of the spins.
    - `spin`: rad/s, of the journal against the bearing, about the axis.
    - `bearing_radius`, radial `clearance`, `length` of the film: m.

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
    """A film of a lubricant of some `viscosity`, Pa s.

    A subclass gives the force on the journal. It must be finite, with its derivatives, without
    offset and without motion, where neither has a direction.

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
            turning = gap.rate * (2.0 / root)
            squeezing = gap.offset * (3.0 * gap.offset.dot(gap.rate) / root**3)
            size = self.viscosity * gap.length * gap.bearing_radius**3 / gap.clearance**2
            return (turning + squeezing) * (-12.0 * math.pi * size / (2.0 + square))

    film = LongFullFilm(viscosity=0.02)
    check_film(film)
    scene, state = cj.mechanisms.rotor_in_bearing(film=film)
    ```
    """

    viscosity: eqx.AbstractVar[Single]

    @abc.abstractmethod
    def force(self, gap: FilmGap) -> Vector:
        """Force on the journal across the axis, N. What it does with the `rate` is dissipated."""

    def drag(self, gap: FilmGap) -> Scalar:
        """Moment on the journal about the bearing's axis against the spin, N m.

        Of a film all around, 2 pi mu R^3 L spin/(c sqrt(1 - eps^2)) (A. Sommerfeld 1904).
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
        """What of a bearing's radius and a film's length, m, the law holds for, if not for all;
        beyond, one is warned."""
        del bearing_radius, length
        return ()
