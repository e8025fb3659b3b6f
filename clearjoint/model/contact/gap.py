"""Penetration of a contact and slip of its surfaces, the inputs of laws, and ranges of validity."""

from dataclasses import dataclass
from typing import NamedTuple

import jax

from ...fields.cautions import LawRangeWarning, caution
from ...fields.checks import concrete
from ...math.vectors import Scalar, Vector


@jax.tree_util.register_dataclass
@dataclass(frozen=True, slots=True)
class Gap:
    """Penetration of a contact, its rate, and the radii of the surfaces.

    - `depth`: penetration, m, negative without contact.
    - `rate`: its time derivative, m/s, positive while the surfaces approach.
    - `bearing_radius` and radial `clearance`: m, ``None`` for flat surfaces. The clearance is given
      instead of the journal's radius, because a difference of radii would lose digits.

    >>> extend.Gap(depth=1e-6, rate=0.05, bearing_radius=10e-3, clearance=0.5e-3)
    Gap(depth=1e-06, rate=0.05, bearing_radius=0.01, clearance=0.0005)
    """

    depth: Scalar
    rate: Scalar
    bearing_radius: Scalar | None = None
    clearance: Scalar | None = None

    @property
    def journal_radius(self) -> Scalar:
        """Bearing radius minus clearance, m; only for a gap that has both."""
        assert self.bearing_radius is not None and self.clearance is not None
        return self.bearing_radius - self.clearance


def slip_velocity(relative: Vector, normal: Vector, rate: Scalar) -> Vector:
    """Return the tangential part of a relative velocity, m/s.

    **Arguments:** `relative`: velocity, m/s. `normal`: unit vector. `rate`: component of the
    velocity along the normal, m/s.

    >>> normal, relative = extend.UNIT_X, extend.Vector(0.1, 0.2, 0.0)
    >>> extend.slip_velocity(relative, normal, rate=0.1).y
    0.2
    """
    return relative - normal * rate


class Limit(NamedTuple):
    """A quantity of a contact: its value, and the range of values for which a law is valid.

    The method `limits` of a law returns one for each quantity that its validity depends on.

    - `law`: name of the law's class.
    - `quantity`: name of the quantity, such as "penetration" or "clearance".
    - `unit`: of the three numbers below, as text.
    - `value`: present value of the quantity.
    - `least`, `most`: ends of the valid range.

    >>> cylinder = cj.laws.JohnsonCylinder(207e9, 0.3, length=10e-3)
    >>> gap = extend.Gap(depth=1e-6, rate=0.0, bearing_radius=10e-3, clearance=0.1e-3)
    >>> limit = cylinder.limits(gap)[0]
    >>> limit.quantity, limit.unit
    ('penetration', 'm')
    """

    law: str
    quantity: str
    unit: str
    value: Scalar
    least: Scalar
    most: Scalar


def exceeded(limits: tuple[Limit, ...], quantity: str) -> list[str]:
    """Return a sentence, for a warning, on each limit whose value is outside its range.

    **Arguments:** `limits`: of a law. `quantity`: name of the quantity to check; other limits are
    ignored, and so are limits with numbers that JAX traces.
    """
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
    """Issue a `LawRangeWarning` for each limit of a `quantity` whose value is outside its range."""
    for sentence in exceeded(limits, quantity):
        caution(sentence, LawRangeWarning)
