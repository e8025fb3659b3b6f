"""Stiffness of meshing teeth over the mesh cycle."""

import abc
import math

import numpy as np
from typing_extensions import override

from ..._fields.checks import require_numbers
from ..._fields.objects import AbstractConverting, quantity
from ..._fields.types import ArrayLike, Column, Single
from ..._math.smoothing import value_and_slope
from ..._math.vectors import Scalar, library
from ..profiles import Harmonics, NumberOrArray, PeriodicSpline

SAMPLES = 256
"""Number of angles of the mesh cycle at which the factor of a stiffness must be positive."""
RISE = 2.0 * math.atanh(0.8)
"""Length of the interval of x in which (1 + tanh(x))/2 rises from 0.1 to 0.9: 2.2."""


class AbstractMeshStiffness(AbstractConverting):
    """Base class of stiffnesses of meshing teeth that vary over the mesh cycle.

    A subclass defines the factor of the law's force, positive and twice continuously
    differentiable, as a function with the period 2 pi of the mesh angle of `GearBacklash`:

    ```python
    import clearjoint as cj
    import jax.numpy as jnp

    class OneHarmonic(cj.extend.AbstractMeshStiffness):
        amplitude: float

        def factor(self, angle):
            return 1.0 + self.amplitude * jnp.cos(angle)
    ```
    """

    @abc.abstractmethod
    def factor(self, angle: NumberOrArray) -> NumberOrArray:
        """Return the factor of the law's force at a mesh angle, rad, or at an array of angles."""

    def factor_and_slope(self, angle: Scalar) -> tuple[Scalar, Scalar]:
        """Return the factor of the law's force at a mesh angle, rad, and its derivative, 1/rad."""
        return value_and_slope(self.factor, angle)


def require_positive_factor(stiffness: AbstractMeshStiffness) -> None:
    least = stiffness.factor(np.arange(SAMPLES) * (2.0 * np.pi / SAMPLES)).min()
    expected = "a factor of the law's force that is positive everywhere, but the least is {0}"
    remedy = "give smaller variations, relative to a mean of 1"
    require_numbers(lambda number: number > 0.0, "stiffness", (least,), expected, remedy)


class TeethInMesh(AbstractMeshStiffness):
    r"""The number of pairs of teeth in contact over its mean, the contact ratio.

    At a contact ratio of 1.6, two equally stiff pairs are in contact in 60 % of the mesh cycle, and
    one pair in the rest. The law's stiffness is the mean mesh stiffness, such as that of ISO 6336.
    With the whole part n of the contact ratio and the rest d, the factor is

    $$\frac{n + \frac12 (1 + \tanh a_+ \tanh a_-)}{n + d}, \quad a_\pm = \frac{2}{w} \sin \frac{\pi
    d \pm (\varphi - \varphi_0)}{2}$$

    **Arguments:**

    - `contact_ratio`: n + d, above 1.
    - `transition`: fraction of the mesh cycle in which the number of pairs changes from 10 % to 90
      % of a step, 0.01 to 0.4, and at most d and 1 - d. In the formula, w is 2 pi `transition`/2.2.
    - `middle`: rad, phi_0, the mesh angle phi in the middle of the contact of the larger number of
      pairs; 0 by default.

    >>> teeth = cj.profiles.TeethInMesh(1.6)
    >>> print(f"{teeth.factor(0.0):.3f}, {teeth.factor(np.pi):.3f}")  # 2/1.6, 1/1.6
    1.250, 0.625
    """

    contact_ratio: Single = quantity("1", shape=(), remedy="give the mean number of pairs")
    transition: Single = quantity(
        "1", default=0.1, within=(0.01, 0.4), remedy="give a part of the mesh cycle"
    )
    middle: Single = quantity("rad", shape=(), default=0.0)

    @override
    def _check_together(self) -> None:
        values = self.contact_ratio, self.transition
        above = "above 1", "one pair of teeth is in contact at least"
        require_numbers(lambda ratio, _: ratio > 1.0, "contact_ratio", values, *above)
        # The fraction d of the ratio must be at least the transition, and at most 1 minus it.
        require_numbers(
            lambda ratio, part: abs(ratio - library((ratio,)).floor(ratio) - 0.5) <= 0.5 - part,
            "contact_ratio",
            values,
            "farther from a whole number than the `transition`, {1}",
            "give a shorter transition; at a whole number the stiffness does not vary",
        )

    @override
    def factor(self, angle: NumberOrArray) -> NumberOrArray:
        numpy = library((angle, self.contact_ratio, self.transition, self.middle))
        pairs = numpy.floor(self.contact_ratio)
        # From `middle`, the larger number of pairs is in contact over this angle to either side.
        half_span = np.pi * (self.contact_ratio - pairs)
        scale = RISE / (np.pi * self.transition)
        # If the angle grows by 2 pi, `rise` and `fall` change their signs, but not their product.
        rise, fall = (
            numpy.tanh(scale * numpy.sin(0.5 * (half_span + sense * (angle - self.middle))))
            for sense in (1.0, -1.0)
        )
        return (pairs + 0.5 * (1.0 + rise * fall)) / self.contact_ratio


class StiffnessHarmonics(AbstractMeshStiffness):
    """Waves over the mesh cycle: 1 plus the sum over k of a_k cos(k angle) + b_k sin(k angle).

    **Arguments:** `cosines`: a_1, a_2, ..., a_K, (K,). `sines`: b_1, ..., b_K, (K,); zero by
    default. A `ValueError` unless both are (K,), K >= 1, and finite.

    >>> print(f"{cj.profiles.StiffnessHarmonics([0.2]).factor(np.pi):.1f}")
    0.8
    """

    cosines: Column = quantity("1", table=True)
    sines: Column = quantity("1", table=True)

    def __init__(self, cosines: ArrayLike, sines: ArrayLike | None = None):
        self.cosines = cosines
        self.sines = np.zeros(np.shape(cosines)) if sines is None else sines

    @override
    def __check_init__(self):
        self._waves()

    @override
    def factor(self, angle: NumberOrArray) -> NumberOrArray:
        return 1.0 + self._waves().at(angle).value

    def _waves(self) -> Harmonics:
        return Harmonics(self.cosines, self.sines)


class StiffnessSpline(AbstractMeshStiffness):
    """A periodic cubic spline over the mesh cycle, such as a table of computed stiffnesses. Use
    `StiffnessSpline.through(values)` for given values.

    **Arguments:** `coefficients`: (N,), N at least 4, of the cubic B-splines centred at the mesh
    angles 0, 2 pi/N, 4 pi/N, ...; a `ValueError` for another shape or numbers that are not finite.

    >>> table = 1.0 + 0.2 * np.cos(2.0 * np.arange(32) * np.pi / 32)
    >>> print(f"{cj.profiles.StiffnessSpline.through(table).factor(np.pi):.3f}")
    0.800
    """

    coefficients: Column = quantity("1", table=True)

    @override
    def __check_init__(self):
        self._spline()

    @staticmethod
    def through(values: ArrayLike) -> "StiffnessSpline":
        """Return the spline through values (N,) at the mesh angles 0, 2 pi/N, 4 pi/N, ... Each is
        the stiffness at its angle over that of the law."""
        return StiffnessSpline(PeriodicSpline.through(values).coefficients)

    @override
    def factor(self, angle: NumberOrArray) -> NumberOrArray:
        return self._spline().at(angle).value

    def _spline(self) -> PeriodicSpline:
        return PeriodicSpline(self.coefficients)
