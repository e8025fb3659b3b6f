"""Penetration and slip of a contact, and base classes of laws and stiffnesses for its normal force.

The journal is the inner surface of a joint, and the bearing is the outer one.
"""

import abc
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import PyTree
from typing_extensions import override

from ..._fields.cautions import LawRangeWarning, caution
from ..._fields.checks import concrete, require, require_numbers, require_shape, require_type
from ..._fields.objects import AbstractConverting, optional_quantity, quantity
from ..._fields.types import Single
from ..._math.interpolation import Slope
from ..._math.smoothing import positive_power
from ..._math.vectors import Scalar, Vector
from ..tree_dataclass import tree_dataclass


@tree_dataclass
class Gap:
    """Penetration of a contact, its rate, and the radii of the surfaces.

    - `depth`: penetration, m, negative without contact.
    - `rate`: its time derivative, m/s, positive while the surfaces approach.
    - `bearing_radius` and radial `clearance`: m, ``None`` without a bearing. The clearance is given
      instead of the journal's radius, because a difference of radii would lose digits.
    - `reduced_radius`: m, for spheres that touch from outside: R1 R2/(R1 + R2) of two, and the
      radius of a sphere on a plane; otherwise ``None``.
    - `factor`: number by which the law's force is multiplied, and its time derivative, 1/s, for a
      stiffness that varies with the pose, as of meshing teeth; ``None`` for 1. A joint that sets
      `factor` wraps its law in a `VaryingLaw`, which multiplies.

    >>> gap = extend.Gap(depth=1e-6, rate=0.05, bearing_radius=10e-3, clearance=0.5e-3)
    >>> print(f"{gap.journal_radius:.4f} m")
    0.0095 m
    """

    depth: Scalar
    rate: Scalar
    bearing_radius: Scalar | None = None
    clearance: Scalar | None = None
    reduced_radius: Scalar | None = None
    factor: Slope | None = None

    @property
    def journal_radius(self) -> Scalar:
        """Bearing radius minus clearance, m; a `ValueError` for a gap that lacks one of them."""
        return radii_of(self)[1]


def radii_of(gap: Gap) -> tuple[Scalar, Scalar, Scalar]:
    """Return bearing radius, journal radius and clearance, m; a `ValueError` without radii."""
    radius, clearance = gap.bearing_radius, gap.clearance
    for argument, value in (("bearing_radius", radius), ("clearance", clearance)):
        needed = "a length in m, on which the law's stiffness depends"
        remedy = "give it, or a law whose stiffness is a number"
        require(value is not None, argument, value, needed, remedy)
    assert radius is not None and clearance is not None
    return radius, radius - clearance, clearance


def slip_velocity(relative: Vector, normal: Vector, rate: Scalar) -> Vector:
    """Return the tangential part, m/s, of the velocity `relative` of two surfaces. `rate`, m/s, is
    the component of this velocity along the unit vector `normal`.

    >>> normal, relative = extend.UNIT_X, extend.Vector(0.1, 0.2, 0.0)
    >>> extend.slip_velocity(relative, normal, rate=0.1).y
    0.2
    """
    return relative - normal * rate


class Limit(NamedTuple):
    """The range from `least` to `most` of a quantity, such as "penetration", in which a law is
    valid, and the quantity's `value` at a contact, all in `unit`. `law` names the law's class.

    >>> cylinder = cj.laws.JohnsonCylinder(207e9, 0.3, length=10e-3)
    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.1e-3)
    >>> cylinder.limits(gap)[0].quantity
    'penetration'
    """

    law: str
    quantity: str
    unit: str
    value: Scalar
    least: Scalar
    most: Scalar


def exceeded(limits: tuple[Limit, ...], quantity: str) -> list[str]:
    """Return a sentence for each of the `limits` of the named `quantity`, such as "penetration",
    whose `value` is outside its range."""
    sentences = []
    for limit in limits:
        numbers = [concrete(number) for number in (limit.value, limit.least, limit.most)]
        # ``None`` stands for a traced number, whose value is unknown.
        if limit.quantity != quantity or any(number is None for number in numbers):
            continue
        value, least, most = (float(number) for number in numbers if number is not None)
        if not least <= value <= most:
            sentences.append(
                f"`{limit.law}` holds for a {quantity} from {least:.4g} {limit.unit} to "
                f"{most:.4g} {limit.unit}, but it is {value:.4g} {limit.unit}."
            )
    return sentences


def caution_beyond(limits: tuple[Limit, ...], quantity: str) -> None:
    """Issue a `LawRangeWarning` for each of the limits on `quantity` that its value violates."""
    for sentence in exceeded(limits, quantity):
        caution(sentence, LawRangeWarning)


SOLIDS = 1e9, 2e12
"""Range of Young's modulus, Pa, from plastics to diamond, outside which a warning is issued."""
_GIVE_MODULUS = "give E in Pa; 1 GPa is 1e9 Pa"


class AbstractElasticity(AbstractConverting):
    """Base class of the elastic force of a contact, which laws accept as their `stiffness`.

    The force is K delta^n, with a stiffness K, the penetration delta and the law's exponent n, or
    any other function of delta, which ignores n.

    >>> foundation = cj.laws.LiuCylinder(207e9, 0.3, length=10e-3)
    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.1e-3)
    >>> print(f"{foundation.force(gap, exponent=1.5):.0f} N")
    126 N
    """

    @abc.abstractmethod
    def force(self, gap: Gap, exponent: float) -> Scalar:
        """Return the elastic force, N, zero without penetration."""

    @abc.abstractmethod
    def energy(self, gap: Gap, exponent: float) -> Scalar:
        """Return the stored energy, J: the integral of the force over the penetration."""

    def begins_flat(self, exponent: float) -> bool:
        """Return whether the derivative of the force by the penetration is zero at the onset, for
        the law's `exponent` n; ``False`` by default. See `AbstractContactLaw.slope_jumps`."""
        return False

    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        """Return the limits of validity of the elastic force at a gap; none by default."""
        return ()


class AbstractStiffness(AbstractElasticity):
    """Base class of stiffnesses K, N/m^n, for laws with the elastic force K delta^n.

    ```python
    import clearjoint as cj

    class LinerStiffness(cj.extend.AbstractStiffness):
        modulus: float  # Pa
        thickness: float  # m
        length: float  # m

        def value(self, gap):
            return self.modulus * gap.bearing_radius * self.length / self.thickness  # N/m

    liner = LinerStiffness(modulus=3e9, thickness=1e-3, length=10e-3)
    law = cj.laws.Hertz(liner, exponent=1.0)
    ```
    """

    @abc.abstractmethod
    def value(self, gap: Gap) -> Scalar:
        """Return the stiffness K, N/m^n, for the radii of a gap."""

    @override
    def begins_flat(self, exponent: float) -> bool:
        return isinstance(exponent, int | float) and exponent > 1.0

    @override
    def force(self, gap: Gap, exponent: float) -> Scalar:
        return self.value(gap) * positive_power(gap.depth, exponent)

    @override
    def energy(self, gap: Gap, exponent: float) -> Scalar:
        return self.value(gap) * positive_power(gap.depth, exponent + 1) / (exponent + 1)


class GivenStiffness(AbstractStiffness):
    """An explicit constant stiffness, N/m^n.

    **Raises:** `ValueError` if it is not positive. **Warns:** `UnusualValueWarning` below 1e6.

    >>> cj.laws.GivenStiffness(1e9).value(extend.Gap(depth=1e-6, rate=0.0)).item()
    1000000000.0
    """

    stiffness: Single = quantity(
        "N/m^n", positive=True, usual=(1e6, math.inf), remedy="give K in N and m"
    )

    @override
    def value(self, gap: Gap) -> Scalar:
        return self.stiffness


class AbstractMaterialPair(AbstractConverting):
    """Base class of elasticities that depend on the materials of bearing and journal. Arguments are
    those of `RavnStiffness`."""

    young_modulus: Single = quantity("Pa", positive=True, usual=SOLIDS, remedy=_GIVE_MODULUS)
    poisson_ratio: Single = quantity("1", within=(-1.0, 0.5), remedy="give nu of the material")
    journal_young_modulus: Single | None = optional_quantity(
        "Pa", positive=True, usual=SOLIDS, remedy=_GIVE_MODULUS
    )
    journal_poisson_ratio: Single | None = optional_quantity(
        "1", within=(-1.0, 0.5), remedy="give nu of the material"
    )

    def compliance(self) -> Scalar:
        """Return 1/E*, 1/Pa: the sum of (1 - nu^2)/E of both materials."""
        modulus, ratio = self.journal_young_modulus, self.journal_poisson_ratio
        modulus = self.young_modulus if modulus is None else modulus
        ratio = self.poisson_ratio if ratio is None else ratio
        return (1 - self.poisson_ratio**2) / self.young_modulus + (1 - ratio**2) / modulus


class RavnStiffness(AbstractMaterialPair, AbstractStiffness):
    r"""Contact of two spherical surfaces (P. Ravn 1998; Flores et al. 2006, section 4).

    $$K = \frac{4}{3 (s_i + s_j)} \sqrt{\frac{R_i R_j}{R_i - R_j}}, \quad s = \frac{1 - \nu^2}{E}$$

    Here i is the bearing and j the journal. The stiffness K, N/m^1.5, depends on the radii R and
    thus on the clearance R_i - R_j. For two spheres that touch from outside, as in `BallOnBall`,
    R_i + R_j takes the place of the clearance; for a sphere on a plane, as in `Stop`, the square
    root is that of its radius (H. Hertz). For cylinders that touch along a line, choose an
    `AbstractCylinder` instead.

    **Arguments:** `young_modulus`, `poisson_ratio`: E, Pa, and nu of the bearing.
    `journal_young_modulus`, `journal_poisson_ratio`: of the journal; those of the bearing by
    default. An `UnusualValueWarning` tells of moduli outside 1e9 to 2e12 Pa.

    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.5e-3)
    >>> print(f"{cj.laws.RavnStiffness(207e9, 0.3).value(gap):.4g} N/m^1.5")
    6.61e+10 N/m^1.5
    """

    @override
    def value(self, gap: Gap) -> Scalar:
        reduced = gap.reduced_radius
        if reduced is None:
            bearing, journal, clearance = radii_of(gap)
            reduced = bearing * journal / clearance
        return 4.0 / (3.0 * self.compliance()) * jnp.sqrt(reduced)


def as_stiffness(value: object) -> AbstractElasticity:
    """Return an elasticity unchanged, or a positive number in N/m^n as a `GivenStiffness`."""
    return value if isinstance(value, AbstractElasticity) else GivenStiffness(value)


UNKNOWN_ENTRY_SPEED = 1e9
"""Entry speed, m/s, of a closed contact whose onset was not recorded, such as one from before the
start. Damping, proportional to rate over entry speed, is then negligible."""


class AbstractContactLaw(AbstractConverting):
    """Base class of the laws of a contact's normal force.

    A subclass defines the force, its elastic part and the stored energy, and two class attributes:

    - `uses_entry_speed`: whether the law needs the entry speed of the current contact.
    - `force_jumps`: whether the force may be nonzero right after the onset or before separation, as
      with a parallel damper. Derivatives by parameters then include the effect of the jump, at the
      cost of one more evaluation of the equations of motion per step. A class that defines `force`
      without this attribute is assumed to jump.

    ```python
    import clearjoint as cj
    import jax.numpy as jnp
    from clearjoint.testing import check_law

    class Elastomer(cj.extend.AbstractContactLaw):
        stiffness: float  # N/m
        damping: float  # s/m
        uses_entry_speed = False
        force_jumps = False

        def elastic_force(self, gap):
            return self.stiffness * jnp.maximum(gap.depth, 0.0)

        def force(self, gap, entry_speed):
            return self.elastic_force(gap) * jnp.maximum(1.0 + self.damping * gap.rate, 0.0)

        def stored_energy(self, gap):
            return 0.5 * self.stiffness * jnp.maximum(gap.depth, 0.0) ** 2

    check_law(Elastomer(stiffness=1e8, damping=0.5))
    ```
    """

    if TYPE_CHECKING:  # pyright mistakes AbstractClassVar for a field
        uses_entry_speed: ClassVar[bool]
    else:
        uses_entry_speed: eqx.AbstractClassVar[bool]
    force_jumps = True

    def __init_subclass__(cls, **options: object):
        super().__init_subclass__(**options)
        if "force" in cls.__dict__ and "force_jumps" not in cls.__dict__:
            cls.force_jumps = True

    @abc.abstractmethod
    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        """Return the normal force, N, never negative. `entry_speed` is in m/s, and ``None`` for a
        law that doesn't use it."""

    @abc.abstractmethod
    def elastic_force(self, gap: Gap) -> Scalar:
        """Return the conservative part of the force, N: the derivative of the stored energy."""

    @abc.abstractmethod
    def stored_energy(self, gap: Gap) -> Scalar:
        """Return the elastic energy at a gap, J, zero before the force begins."""

    def onset_offset(self) -> Scalar:
        """Return the distance of the surfaces at which the force begins, m; 0 by default, positive
        for a law smoothed over a width, or for rough surfaces, whose asperities touch first."""
        return 0.0

    def slope_jumps(self) -> bool:
        """Return whether the force's derivative by the penetration may jump at the onset, as for a
        linear spring; ``True`` by default. The solver then corrects for the kink after each step
        that ends at a contact's onset or end, by one more evaluation of the equations of motion."""
        return True

    def prepared(self) -> "AbstractContactLaw":
        """Return an equal law that has computed what depends on its parameters alone, such as a
        damping factor found by a search; by default itself. Runs call this before their steps."""
        return self

    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        """Return the limits of validity at a gap; none by default. A joint with a clearance out of
        range, and a run that records impacts with a penetration out of range, warn."""
        return ()


class AbstractElasticLaw(AbstractContactLaw):
    """Base class of laws with elastic force from `stiffness`, a number or an `AbstractElasticity`.

    >>> issubclass(cj.laws.Hertz, extend.AbstractElasticLaw), cj.laws.Hertz(1e9).stiffness
    (True, GivenStiffness(stiffness=1000000000.0))
    """

    stiffness: eqx.AbstractVar[AbstractElasticity]

    @classmethod
    @override
    def field_converter(cls, name: str) -> Callable[[PyTree], PyTree]:
        return as_stiffness if name == "stiffness" else super().field_converter(name)

    @override
    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        return self.stiffness.limits(gap)


class AbstractPowerLaw(AbstractElasticLaw):
    """Base class of laws with the elastic force K delta^n, N, for penetration delta, m. `stiffness`
    is K in N/m^n, or an `AbstractElasticity` whose force replaces K delta^n. `exponent` is n."""

    exponent: eqx.AbstractVar[float]

    @override
    def slope_jumps(self) -> bool:
        return not self.stiffness.begins_flat(self.exponent)

    @override
    def elastic_force(self, gap: Gap) -> Scalar:
        return self.stiffness.force(gap, self.exponent)

    @override
    def stored_energy(self, gap: Gap) -> Scalar:
        return self.stiffness.energy(gap, self.exponent)


def require_exponent(exponent: Single) -> None:
    condition = "at least 1", "use 1.5 for Hertz"
    require_shape("exponent", exponent, (), "pass a single number")
    require_numbers(lambda number: number >= 1.0, "exponent", (exponent,), *condition)


def require_rebound(restitution: Single) -> None:
    remedy = "its damping is infinite at 0; use a small value such as 0.01"
    expected = "positive for this law"
    require_numbers(lambda number: number > 0.0, "restitution", (restitution,), expected, remedy)


def require_instance(argument: str, value: object, *kinds: type, remedy: str = "") -> None:
    """Raise a `ValueError` unless a value is an object of one of the classes `kinds`; by default
    with the remedy to define a subclass or to pass an object of this package."""
    names = " or ".join(kind.__name__ for kind in kinds)
    # The user passed a class, probably one of `kinds`, in place of an object.
    if isinstance(value, type):
        remedy = f"call the class with its numbers, {value.__name__}(...)"
    remedy = remedy or f"subclass {names} or pass one of clearjoint's"
    article = "an" if names.startswith(tuple("AEIOU")) else "a"
    require(isinstance(value, kinds), argument, value, f"{article} {names}", remedy)


def require_flat_law(law: object, surfaces: str) -> None:
    """Raise a `ValueError` unless a law suits flat `surfaces`, such as "flanks". The stiffness of
    an `AbstractElasticLaw` must be a number, since an `AbstractElasticity` may depend on radii."""
    require_instance("law", law, AbstractContactLaw)
    # Whether a law of another class reads the radii is not visible from outside.
    if isinstance(law, AbstractElasticLaw):
        remedy = f"{surfaces} are flat, so pass a number in N/m^n as the law's stiffness"
        expected = "a law with an explicit stiffness"
        require_type("law", law.stiffness, GivenStiffness, expected, remedy)


def require_round_law(law: object) -> None:
    """Raise a `ValueError` unless a law can be used between spheres that touch from outside."""
    require_instance("law", law, AbstractContactLaw)
    # The other stiffnesses by material are those of cylinders.
    if isinstance(law, AbstractElasticLaw) and isinstance(law.stiffness, AbstractMaterialPair):
        remedy = "pass RavnStiffness(E, nu) or a number in N/m^n as the law's stiffness"
        expected = "a law with a stiffness of spheres"
        require_type("law", law.stiffness, RavnStiffness, expected, remedy)


def contact_normal_force(law: AbstractContactLaw, gap: Gap, entry_speed: Scalar | None) -> Scalar:
    """Return the normal force of a contact, N. `entry_speed`: m/s; 0 stands for an onset just now:
    the current rate replaces it. ``None`` is for a law that doesn't use the entry speed.

    >>> law, gap = cj.laws.HuntCrossley(0.8, 1e9), extend.Gap(depth=1e-4, rate=0.1)
    >>> print(f"{extend.contact_normal_force(law, gap, entry_speed=0.1):.1f} N")  # 1000 (1 + 0.3)
    1300.0 N
    """
    if law.uses_entry_speed:
        assert entry_speed is not None
        entry_speed = jnp.where(entry_speed > 0.0, entry_speed, gap.rate)
    return law.force(gap, entry_speed)


class AbstractLawAround(AbstractContactLaw):
    """Base class of laws that change the force of another law, `law`."""

    law: AbstractContactLaw

    @property
    @override
    def uses_entry_speed(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.law.uses_entry_speed

    @override
    def limits(self, gap: Gap) -> tuple[Limit, ...]:
        return self.law.limits(gap)


class AbstractFactorLaw(AbstractLawAround):
    """Base class of a contact law times a factor that does not depend on the penetration."""

    @abc.abstractmethod
    def factor(self, gap: Gap) -> Scalar:
        """Return the factor of the law's force and energy at a gap."""

    @property
    @override
    def force_jumps(self) -> bool:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.law.force_jumps

    @override
    def force(self, gap: Gap, entry_speed: Scalar | None) -> Scalar:
        return self.factor(gap) * self.law.force(gap, entry_speed)

    @override
    def elastic_force(self, gap: Gap) -> Scalar:
        return self.factor(gap) * self.law.elastic_force(gap)

    @override
    def stored_energy(self, gap: Gap) -> Scalar:
        return self.factor(gap) * self.law.stored_energy(gap)

    @override
    def onset_offset(self) -> Scalar:
        return self.law.onset_offset()

    @override
    def slope_jumps(self) -> bool:
        return self.law.slope_jumps()

    @property
    def delivered_restitution(self) -> Callable[[], Scalar]:
        """Method `delivered_restitution` of the field `law`. It is a property, so that ``hasattr``
        is true only if `law` has this method."""
        return self.law.delivered_restitution  # pyright: ignore[reportAttributeAccessIssue]


class WeightedLaw(AbstractFactorLaw):
    """A law times the weight of one contact of a line contact; the weights add up to 1."""

    weight: float = eqx.field(static=True)

    @override
    def factor(self, gap: Gap) -> Scalar:
        return self.weight


class VaryingLaw(AbstractFactorLaw):
    """A contact law times ``gap.factor`` of each gap, for a stiffness that varies with the pose."""

    @override
    def factor(self, gap: Gap) -> Scalar:
        return 1.0 if gap.factor is None else gap.factor.value


def whole_law(law: AbstractContactLaw) -> AbstractContactLaw:
    """Return the user's law, without any `AbstractLawAround` around it. A `ClearanceJoint` with
    `line_points`, or a `LubricatedJoint` with a `transition`, computes with a law around it."""
    while isinstance(law, AbstractLawAround):
        law = law.law
    return law
