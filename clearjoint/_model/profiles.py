"""Deviations of a bearing's wall or a journal from a circle, and where the two come closest.

A profile is given by its support function p(u): the distance from the centre to the tangent that is
perpendicular to the unit vector u. With support functions the penetration of two convex shapes is
exact. Let p_J be that of a journal, p_B that of the bearing's wall, and e the vector from the
bearing's centre to the journal's. The largest value of e.u + p_J(u) - p_B(u) over all u is the
penetration, and the u where it occurs is the normal of the contact. The radius measured along u
differs from p(u) by about s^2/(2 R) only, with the slope s of the deviation and the radius R: 5e-10
m for 3 um per rad and R = 10 mm. Deviations of the radius are therefore used as deviations of p(u).
"""

import abc
import operator
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from typing_extensions import override

from .._fields.checks import caution_unless, concrete, require, require_finite, require_numbers
from .._fields.objects import AbstractConverting, on_device, quantity
from .._fields.types import ArrayLike, Column
from .._math.smoothing import polar_angle
from .._math.vectors import Scalar, library

NEWTON_STEPS = 4
"""Number of Newton steps in the search for the closest approach. The search starts within a
sixteenth of a wave from the result; each step roughly squares this error, to rounding in four."""
ANGLES_PER_WAVE = 8
"""Number of angles, per wave of the highest harmonic, of which the best starts the search: the best
is within a sixteenth of a wave from the maximum, to which Newton's method therefore converges."""


NumberOrArray: TypeAlias = Float[Any, "..."]
"""A number, or an array of numbers."""


class Deviation(NamedTuple):
    """A profile's `value` at an angle, m (the distance from the centre to the tangent that is
    perpendicular to this direction, less the circle's radius), with its first derivative by the
    angle, `slope`, m/rad, and its second, `bend`, m/rad^2.

    >>> cj.profiles.Harmonics([2e-6]).at(0.0)._fields
    ('value', 'slope', 'bend')
    """

    value: NumberOrArray
    slope: NumberOrArray
    bend: NumberOrArray


class AbstractProfile(AbstractConverting):
    """Base class of periodic deviations of a bearing's wall or of a journal from a circle.

    The angle is measured about the axis of the part (bearing or journal), from x towards y of the
    part's frame, see `clearjoint.quantities.JournalOffset`. A positive deviation enlarges the
    radius: it removes material from a bearing and adds material to a journal. A subclass defines
    the deviation as a twice continuously differentiable function of the angle:

    ```python
    import clearjoint as cj
    import jax.numpy as jnp

    class Egg(cj.extend.AbstractProfile):
        height: float  # m

        def at(self, angle):
            wave = self.height * jnp.cos(2.0 * angle)
            return cj.extend.Deviation(wave, -2.0 * self.height * jnp.sin(2.0 * angle), -4.0 * wave)

        def angles(self):
            return 16
    ```
    """

    @abc.abstractmethod
    def at(self, angle: NumberOrArray) -> Deviation:
        """Return the deviation at an angle, rad, or at an array of angles."""

    @abc.abstractmethod
    def angles(self) -> int:
        """Return how many evenly spaced angles resolve the waves of the profile. The search for the
        closest approach begins at the best of 16 to 48 such angles: for waves above the sixth
        harmonic, it may find a penetration that is not the largest."""


class Harmonics(AbstractProfile):
    """Waves around the circumference: the sum over k of a_k cos(k angle) + b_k sin(k angle).

    The first harmonic shifts the circle, the second makes it oval, the third gives three lobes.

    **Arguments:** `cosines`: a_1, a_2, ..., a_K, (K,) m. `sines`: b_1, ..., b_K, (K,) m; zero by
    default. A `ValueError` unless both are (K,), K >= 1, and finite.

    >>> oval = cj.profiles.Harmonics([0.0, 5e-6])
    >>> print(f"{oval.at(0.0).value:.1e} m, {oval.at(np.pi / 2).value:.1e} m")
    5.0e-06 m, -5.0e-06 m
    """

    cosines: Column = quantity("m", table=True)
    sines: Column = quantity("m", table=True)

    def __init__(self, cosines: ArrayLike, sines: ArrayLike | None = None):
        self.cosines = cosines
        self.sines = np.zeros(np.shape(cosines)) if sines is None else sines

    @override
    def __check_init__(self):
        shape, of_sines = np.shape(self.cosines), np.shape(self.sines)
        remedy = "pass the coefficients in a list, that of the first harmonic first"
        require(len(shape) == 1 and shape != (0,), "cosines", shape, "a row", remedy)
        require(of_sines == shape, "sines", of_sines, f"of the shape {shape} of `cosines`", remedy)
        require_finite("cosines", self.cosines)
        require_finite("sines", self.sines)

    @override
    def at(self, angle: NumberOrArray) -> Deviation:
        cosines, sines = on_device(self.cosines), on_device(self.sines)
        numpy = library((angle,))
        # `c` and `s` are of the angle, `cosine` and `sine` of k times the angle.
        c, s = cosine, sine = numpy.cos(angle), numpy.sin(angle)
        value = slope = bend = numpy.zeros_like(cosine)
        for k in range(1, len(cosines) + 1):
            a, b = cosines[k - 1], sines[k - 1]
            wave = a * cosine + b * sine
            value = value + wave
            slope = slope + k * (b * cosine - a * sine)
            bend = bend - k * k * wave
            # The addition theorem is cheaper than a cosine and a sine for each harmonic.
            cosine, sine = cosine * c - sine * s, sine * c + cosine * s
        return Deviation(value, slope, bend)

    @override
    def angles(self) -> int:
        return ANGLES_PER_WAVE * np.shape(self.cosines)[0]


class AbstractPeriodicSpline(AbstractProfile):
    """Base class of periodic cubic splines with N evenly spaced knots; `angles` returns N."""

    @override
    def at(self, angle: NumberOrArray) -> Deviation:
        count = self.angles()
        knots_per_radian = count / (2.0 * np.pi)
        # The knots next to angles that are known before compilation are found by NumPy, so that
        # the compiled program need not search for them.
        numpy = library((angle,))
        turns = numpy.asarray(angle, float) / (2.0 * np.pi)
        position = (turns - numpy.floor(turns)) * count
        knot = numpy.floor(position)
        x = position - knot
        # Coefficients at the knot before the angle's interval, at both its ends, and after it.
        near = self.coefficients_around(knot.astype(int))
        a, b, c, d = (near[..., k] for k in range(4))
        # Powers of x of the four cubic B-splines that are not zero between two knots.
        linear, square, cubic = 0.5 * (c - a), 0.5 * (a + c) - b, (d - a) / 6.0 + 0.5 * (b - c)
        value = (a + 4.0 * b + c) / 6.0 + x * (linear + x * (square + x * cubic))
        slope = linear + x * (2.0 * square + x * 3.0 * cubic)
        bend = 2.0 * square + x * 6.0 * cubic
        return Deviation(value, slope * knots_per_radian, bend * knots_per_radian**2)

    @abc.abstractmethod
    def coefficients_around(self, knot: jax.Array | np.ndarray) -> jax.Array:
        """Return the coefficients, (..., 4) m, at four successive knots; the second is `knot`, an
        index from 0 to N - 1 for N knots, or N by rounding, which stands for knot 0."""


class PeriodicSpline(AbstractPeriodicSpline):
    """A periodic cubic spline with evenly spaced knots, such as a measured or a worn profile. Use
    `PeriodicSpline.through(values)` for given values.

    **Arguments:** `coefficients`: (N,) m, N at least 4, of the cubic B-splines that are centred at
    the angles 0, 2 pi/N, 4 pi/N, ...; a `ValueError` for another shape, or non-finite numbers.

    >>> values = 1e-6 * np.cos(2.0 * np.arange(64) * 2.0 * np.pi / 64)
    >>> profile = cj.profiles.PeriodicSpline.through(values)
    >>> print(f"{profile.at(0.0).value:.3e} m, {profile.at(0.1).value:.3e} m")
    1.000e-06 m, 9.801e-07 m
    """

    coefficients: Column = quantity("m", table=True)

    @override
    def __check_init__(self):
        shape = np.shape(self.coefficients)
        remedy = "give the profile at four or more evenly spaced angles"
        require(len(shape) == 1 and shape[0] >= 4, "coefficients", shape, "a row", remedy)
        require_finite("coefficients", self.coefficients)

    @staticmethod
    def through(values: ArrayLike) -> "PeriodicSpline":
        """Return the spline through values (N,), m, at the angles 0, 2 pi/N, 4 pi/N, ..."""
        checked = PeriodicSpline(values).coefficients  # the values as an array
        library, count = jnp if isinstance(checked, jax.Array) else np, checked.shape[0]
        # At a knot the spline is (c[i - 1] + 4 c[i] + c[i + 1])/6, a circular convolution. Its
        # Fourier transform is that of c times these factors.
        factors = (2.0 + np.cos(2.0 * np.pi * np.arange(count // 2 + 1) / count)) / 3.0
        return PeriodicSpline(library.fft.irfft(library.fft.rfft(checked) / factors, count))

    @override
    def coefficients_around(self, knot: jax.Array | np.ndarray) -> jax.Array:
        return periodic(on_device(self.coefficients), knot)

    @override
    def angles(self) -> int:
        return np.shape(self.coefficients)[0]


def periodic(row: jax.Array, knot: jax.Array | np.ndarray) -> jax.Array:
    """Return four successive entries, (..., 4), of a periodic row; `knot` is the second's index."""
    # One gather for the four entries. The row continues after its end with its first three entries:
    # two for the periodic spline, and one since rounding may make the fraction of a turn exactly 1,
    # and the knot the length of the row.
    row = jnp.concatenate([row[-1:], row, row[:3]])
    return row.at[knot[..., None] + np.arange(4)].get(mode="promise_in_bounds")


class Approach(NamedTuple):
    """Direction in which a journal comes closest to the wall, and the contact there.

    - `cosine`, `sine`: of the direction's angle in the bearing's cross-section, from its x axis.
    - `depth`: penetration in this direction, m, negative without contact.
    - `journal`: deviation of the journal, with derivatives by the angle about its own axis.
    """

    cosine: Scalar
    sine: Scalar
    depth: Scalar
    journal: Deviation


class PlanarAxes(NamedTuple):
    """Components of a journal's x and y axes along the x and y axes of its bearing. The journal may
    be tilted, or its axis may point against the bearing's."""

    x_along_x: Scalar
    x_along_y: Scalar
    y_along_x: Scalar
    y_along_y: Scalar


_ROUND = Deviation(0.0, 0.0, 0.0)


class JournalInBearing(NamedTuple):
    """Position and profiles of a journal and its bearing in the bearing's cross-section.

    - `x`, `y`: position of the journal's centre, m.
    - `bearing`, `journal`: the profiles; ``None`` for a circle.
    - `axes`: the journal's axes, to which its profile refers, in the bearing's cross-section.
    """

    x: NumberOrArray
    y: NumberOrArray
    bearing: AbstractProfile | None
    journal: AbstractProfile | None
    axes: PlanarAxes

    def closest_approach(self, clearance: Scalar) -> Approach:
        """Return where the journal comes closest to the wall of its bearing, or penetrates it most.

        The search begins at the best of evenly spaced angles and ends with Newton steps, so it
        finds the largest of several maxima of `overlap` if the angles resolve them. At least one
        profile is needed. `clearance`, m, is the radius of the bearing's circle less the journal's.
        """
        # JAX does not differentiate the search, except for its last Newton step.
        constant = jax.lax.stop_gradient(self)
        profiles = self.bearing, self.journal
        counts = [profile.angles() for profile in profiles if profile is not None]
        # At least 16, which resolve two waves around the circumference (`ANGLES_PER_WAVE`), and at
        # most as many as native code turns into separate numbers; a longer array is kept in memory
        # and processed by slower loops.
        count = min(max(16, *counts), 48)
        spacing = 2.0 * np.pi / count
        angles = np.arange(count) * spacing
        overlap = constant.overlap(angles)
        # The angle of the largest overlap; of equal ones the largest angle. An argmax is avoided,
        # since XLA aborts when it compiles two of them in one program (jaxlib 0.10).
        start = jnp.max(jnp.where(overlap == jnp.max(overlap), angles, 0.0))

        # A loop, since steps that are written out would take longer to compile.
        def refine(k: jax.Array, angle: Scalar) -> Scalar:
            del k
            # Within one spacing, a step can't leave the highest maximum for another one.
            closer = angle + constant._newton_step(angle)
            return jnp.clip(closer, start - spacing, start + spacing)

        angle = jax.lax.fori_loop(0, NEWTON_STEPS - 1, refine, start)
        # The derivative of one step is that of the maximum (implicit function theorem).
        angle = angle + self._newton_step(angle)
        cosine, sine = jnp.cos(angle), jnp.sin(angle)
        of_journal, _, _ = self._journal_deviation(cosine, sine)
        return Approach(cosine, sine, self.overlap(angle) - clearance, of_journal)

    def overlap(self, angle: NumberOrArray) -> Scalar:
        """Return the penetration, m, at an angle, rad, for a clearance of zero."""
        numpy = library((angle,))
        cosine, sine = numpy.cos(angle), numpy.sin(angle)
        part, _, _ = self._journal_deviation(cosine, sine)
        return self.x * cosine + self.y * sine - self._wall(angle).value + part.value

    def _newton_step(self, angle: Scalar) -> Scalar:
        """Return the change of an angle, rad, by a Newton step to the maximum of `overlap`."""
        # `slope` and `bend` are the first and second derivative of the penetration by the angle.
        # `rate` and `change` are those of the angle about the journal's own axis, which may be
        # tilted, so that the derivatives of the journal's deviation contain them.
        x, y, cosine, sine = self.x, self.y, jnp.cos(angle), jnp.sin(angle)
        wall, (part, rate, change) = self._wall(angle), self._journal_deviation(cosine, sine)
        slope = y * cosine - x * sine - wall.slope + part.slope * rate
        bend = part.bend * rate * rate + part.slope * change - wall.bend - x * cosine - y * sine
        # The inner `where` avoids a division by zero, whose derivative would be NaN even if unused.
        return jnp.where(bend < 0.0, -slope / jnp.where(bend < 0.0, bend, -1.0), 0.0)

    def _wall(self, angle: NumberOrArray) -> Deviation:
        return _ROUND if self.bearing is None else self.bearing.at(angle)

    def _journal_deviation(self, cosine: Scalar, sine: Scalar) -> tuple[Deviation, Scalar, Scalar]:
        """Return the journal's deviation in a direction, db/da and d^2 b/da^2. The direction has
        the angles a about the bearing's axis and b about the journal's. `cosine`, `sine`: of a."""
        if self.journal is None:
            return _ROUND, 0.0, 0.0
        axes = self.axes
        # Components of the direction along the journal's axes. Their polar angle is that about the
        # journal's axis; for a journal that is not tilted, its rate is 1 or -1.
        along_x = axes.x_along_x * cosine + axes.x_along_y * sine
        along_y = axes.y_along_x * cosine + axes.y_along_y * sine
        square = along_x * along_x + along_y * along_y
        rate = (axes.x_along_x * axes.y_along_y - axes.x_along_y * axes.y_along_x) / square
        # Half the derivative of `square` by the angle. The numerator of `rate` is constant, so that
        # the derivative of `rate` is -2 rate half_slope/square.
        half_slope = along_x * (axes.x_along_y * cosine - axes.x_along_x * sine)
        half_slope = half_slope + along_y * (axes.y_along_y * cosine - axes.y_along_x * sine)
        deviation = self.journal.at(polar_angle(along_y, along_x))
        return deviation, rate, -2.0 * rate * half_slope / square


def require_room(
    clearance: Scalar, bearing: AbstractProfile | None, journal: AbstractProfile | None
) -> None:
    """Raise a `ValueError` if a centred journal may touch the wall at some relative rotation."""
    # Without profiles, any positive clearance leaves room.
    if bearing is None and journal is None:
        return
    # The highest point of the journal may face the point where the bearing is narrowest.
    least = _sampled(journal).value.max() - _sampled(bearing).value.min()
    expected = "larger than the {1} m by which the profiles of both parts narrow it"
    remedy = "check the unit (m) and the sign of the profiles: positive values enlarge the radius"
    require_numbers(operator.gt, "clearance", (clearance, least), expected, remedy)


def caution_two_contacts(
    clearance: Scalar, bearing: AbstractProfile | None, journal: AbstractProfile | None
) -> None:
    """Warn if the journal may touch the wall at two points that are close to each other. The model
    has one contact, the deepest. The journal touches at one point at most if the smallest radius of
    curvature of the wall exceeds the largest of the journal: R + h + h'' for a circle of radius R
    and a deviation h."""
    # Two circles touch at one point.
    if bearing is None and journal is None:
        return
    wall, part = _sampled(bearing), _sampled(journal)
    # The radius of the bearing's circle exceeds that of the journal's by the clearance.
    least = clearance + (wall.value + wall.bend).min() - (part.value + part.bend).max()
    # ``None`` stands for a number that JAX traces, which is unknown.
    if concrete(least) is not None:
        width = float(clearance)
        expected = (
            f"more than {width - float(least):.4g} m for profiles so curved, since only the "
            "deepest of several points of contact has a force,"
        )
        remedy = "give a larger clearance, or a profile with lower waves"
        caution_unless(bool(least > 0.0), "clearance", width, "m", expected, remedy)


def _sampled(profile: AbstractProfile | None) -> Deviation:
    """Return the deviation at evenly spaced angles, four times as many as resolve the profile; for
    a circle (``None``), a zero."""
    if profile is None:
        return Deviation(value=np.zeros(1), slope=np.zeros(1), bend=np.zeros(1))
    count = 4 * profile.angles()
    return profile.at(np.arange(count) * (2.0 * np.pi / count))
