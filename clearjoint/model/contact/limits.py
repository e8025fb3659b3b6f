"""Validity ranges of laws, and the warning outside them."""

from typing import NamedTuple

from ...fields.cautions import LawRangeWarning, caution
from ...fields.checks import concrete
from ...math.vectors import Scalar


class Limit(NamedTuple):
    """Value of a quantity of a contact, and the range of values for which a law is valid.

    - `law`: name of the law's class.
    - `quantity`: name of the quantity, such as "penetration" or "clearance".
    - `unit`: unit of the three numbers below, as text.
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
    """Return a sentence for each limit whose value is outside its range.

    Only limits of the given `quantity` are checked, and only those with known numbers, not traced
    by JAX.
    """
    sentences = []
    for limit in limits:
        numbers = [concrete(number) for number in (limit.value, limit.least, limit.most)]
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
