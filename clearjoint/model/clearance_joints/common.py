"""What joints with play have in common: a normal law and a friction for all of their contacts."""

import abc

import equinox as eqx

from ...fields.checks import as_shown, checkable, require
from ...fields.types import Single, Triple
from ...math.vectors import Scalar, Vector
from ..bodies import GROUND, Motion
from ..contact.bristles import AbstractBristleFriction
from ..contact.friction import AbstractFriction
from ..contact.laws import AbstractContactLaw
from ..joints.base import AbstractContactJoint, Contact
from ..joints.pairs import require_distinct

RIGHT_ANGLE = 1e-9
"""Cosine of the angle between two directions up to which they are at a right angle."""


class AbstractPlay(AbstractContactJoint):
    """A joint with play whose contacts share a normal `law` and a `friction`, or ``None``."""

    law: eqx.AbstractVar[AbstractContactLaw]
    friction: eqx.AbstractVar[AbstractFriction | AbstractBristleFriction | None]

    def __check_init__(self):
        require_distinct(*self.pair())
        require_law_and_friction(self.law, self.friction)

    @abc.abstractmethod
    def places(self) -> tuple[str, ...]:
        """Names of the contacts."""

    def laws(self) -> dict[str, AbstractContactLaw]:
        """The law, for each contact."""
        return dict.fromkeys(self.places(), self.law)

    def friction_force(self, name: str, contact: Contact, normal_force: Scalar) -> Vector | None:
        """Friction on the second body, N."""
        del name
        if self.friction is None or contact.slip is None:
            return None
        return self.friction.force(normal_force, contact.slip)

    def bristle_laws(self) -> dict[str, AbstractBristleFriction]:
        """The bristle law of each contact, if the joint has one."""
        if isinstance(self.friction, AbstractBristleFriction):
            return dict.fromkeys(self.places(), self.friction)
        return {}


def require_law_and_friction(law: object, friction: object) -> None:
    """Check the kinds of a normal law and of a friction, which may be ``None``."""
    kinds = {
        "law": (law, (AbstractContactLaw,)),
        "friction": (friction, (AbstractFriction, AbstractBristleFriction)),
    }
    for name, (value, allowed) in kinds.items():
        names = " or ".join(kind.__name__ for kind in allowed)
        require(
            isinstance(value, allowed) or (name == "friction" and value is None),
            name,
            value,
            f"an {names}",
            _remedy(value, names),
        )


def _remedy(value: object, names: str) -> str:
    """What to pass instead of a value that is none of the named classes."""
    if isinstance(value, type):
        return f"call the class with its numbers, {value.__name__}(...)"
    return f"subclass {names} or pass one of clearjoint's"


def require_smaller_clearance(clearance: Single, radius: Single, of: str) -> None:
    """Check that a radial clearance, m, is smaller than a radius, m, of which one is told
    what it is."""
    if (known := checkable(clearance, radius)) is not None:
        width, size = known
        expected = f"smaller than {of} {as_shown(size)} m"
        require(width < size, "clearance", width, expected, "check the units (m)")


def require_right_angle(argument: str, direction: Triple, other: str, axis: Triple) -> None:
    """Check that a direction (3,) is at a right angle to an axis (3,), both by name."""
    if (known := checkable(direction, axis)) is not None:
        numbers, base = known
        lengths = ((numbers**2).sum() * (base**2).sum()) ** 0.5
        require(
            abs((numbers * base).sum()) < RIGHT_ANGLE * lengths,
            argument,
            numbers,
            f"at a right angle to `{other}` = {as_shown(base)}",
            "turn one of them",
        )


def anchor_of(
    bodies: tuple[str, str], points: tuple[Vector, Vector]
) -> tuple[str, Vector, Vector] | None:
    """The anchor of a joint that keeps a point of each of two bodies together, if one body is the
    ground: the moving body, its point (body axes) and the ground's."""
    (first, second), (point_first, point_second) = bodies, points
    if first == GROUND:
        return second, point_second, point_first
    if second == GROUND:
        return first, point_first, point_second
    return None


def offset_between(
    bodies: tuple[str, str], motions: tuple[Motion, Motion], points: tuple[Vector, Vector]
) -> Vector:
    """From a point of the first body to one of the second, m, global; points in body axes. Where a
    body is the ground, with the digits of its anchor."""
    (first, second), (point_first, point_second) = motions, points
    if bodies[1] == GROUND:
        return -first.point_from(point_second, point_first)
    return second.point_from(first.point(point_first), point_second)
