"""Shared parts of the clearance joints: base classes, argument checks, flat walls."""

import abc
import operator
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Float
from typing_extensions import override

from ..._fields.checks import as_shown, checkable, require, require_numbers
from ..._fields.types import Single, Triple
from ..._math.vectors import Scalar, Vector, subtract
from ..bodies import GROUND, Motion
from ..contact.friction import AbstractBristleFriction, AbstractFriction, FrictionLaw
from ..contact.laws import (
    AbstractContactLaw,
    Gap,
    Limit,
    require_flat_law,
    require_instance,
    slip_velocity,
)
from ..joints.base import (
    AbstractConstraint,
    AbstractContactJoint,
    Contact,
    Motions,
    Row,
    require_distinct,
)

FLANKS = {"lower flank": -1.0, "upper flank": 1.0}
"""Labels of two flanks, and the sign of the second body's rotation that each flank stops."""
LEAST_DEPTH = 1e-18
"""Smallest penetration that `resting_depth` tries, m from the onset of the force: far below the
rounding errors of coordinates."""
LEAST_TRANSVERSE_LOAD = 1e-6
"""Component of a load towards a wall (across a bearing's axis, or along the normal of flat walls),
as a fraction of the load, up to which it counts as a rounding error."""


class AbstractOneLawJoint(AbstractContactJoint):
    """Base class of joints whose contacts share a `law` and a `friction` law or ``None``."""

    if TYPE_CHECKING:  # pyright mistakes AbstractVar for a field
        law: ClassVar[AbstractContactLaw]
    else:
        law: eqx.AbstractVar[AbstractContactLaw]
    friction: eqx.AbstractVar[FrictionLaw | None]

    @abc.abstractmethod
    def contact_labels(self) -> tuple[str, ...]:
        """Return the labels of the contacts that share `law` and `friction`."""

    @override
    def laws(self) -> dict[str, AbstractContactLaw]:
        return dict.fromkeys(self.contact_labels(), self.law)

    @abc.abstractmethod
    def deepest_penetration(self) -> Scalar:
        """Return the penetration, m, of a contact in `contact_labels` above which a run ends."""

    @override
    def deepest(self) -> dict[str, Scalar]:
        return dict.fromkeys(self.contact_labels(), self.deepest_penetration())

    @override
    def friction_force(self, name: str, contact: Contact, normal_force: Scalar) -> Vector | None:
        if self.friction is None or contact.slip is None:
            return None
        return self.friction.force(normal_force, contact.slip)

    @override
    def bristle_laws(self) -> dict[str, AbstractBristleFriction]:
        if isinstance(self.friction, AbstractBristleFriction):
            return dict.fromkeys(self.contact_labels(), self.friction)
        return {}

    def _gap(self, depth: Scalar, rate: Scalar) -> Gap:
        """Return the gap of a contact in `contact_labels` from depth, m, and rate, m/s, with the
        radii on which the law's stiffness may depend; without radii by default."""
        return Gap(depth, rate)

    @override
    def law_limits(self, name: str, depth: Scalar) -> tuple[Limit, ...]:
        return self.laws()[name].limits(self._gap(depth, 0.0))


class AbstractFlankJoint(AbstractOneLawJoint):
    """Base class of joints with two flat flanks without friction, which stop the second body's
    rotation."""

    friction: ClassVar[None] = None

    @override
    def __check_init__(self):
        require_flat_law(self.law, "flanks")

    @override
    def contact_labels(self) -> tuple[str, ...]:
        return tuple(FLANKS)

    @abc.abstractmethod
    def centred_rows(self, motions: Motions) -> dict[str, Row]:
        """Return the constraint row that holds the second body in the middle of the play."""

    @override
    def centred_joint(self) -> AbstractConstraint:
        return CentredInPlay(self)


class CentredInPlay(AbstractConstraint):
    joint: AbstractFlankJoint

    @override
    def body_names(self) -> tuple[str, ...]:
        return self.joint.pair()

    @override
    def rows(self, motions: Motions, t: Scalar) -> dict[str, Row]:
        return self.joint.centred_rows(motions)


class AbstractFrictionJoint(AbstractOneLawJoint):
    @override
    def __check_init__(self):
        require_distinct(*self.pair())
        require_instance("law", self.law, AbstractContactLaw)
        if self.friction is not None:
            require_instance("friction", self.friction, AbstractFriction, AbstractBristleFriction)

    def _slip(
        self, first: Motion, second: Motion, on_first: Vector, on_second: Vector, normal: Vector
    ) -> Vector | None:
        """Return the tangential velocity of the second body relative to the first at a contact, m/s
        in global axes; ``None`` without friction.

        **Arguments:** `first`, `second`: motions of the bodies. `on_first`, `on_second`: contact
        point, m from each body's centre of mass in its axes. `normal`: global unit vector.
        """
        if self.friction is None:
            return None
        sliding = second.velocity_at(on_second) - first.velocity_at(on_first)
        return slip_velocity(sliding, normal, sliding.dot(normal))

    def _contact_with_wall(
        self,
        motions: Motions,
        origin: Vector,
        normal: Vector,
        room: Scalar,
        centre: Vector,
        radius: Scalar,
    ) -> Contact:
        """Return the contact of a part of the second body (a cylinder, a sphere, or a corner of
        `radius` zero) with a flat wall of the first body.

        **Arguments:** `origin`: a point in front of the wall, m in the first body's axes. `normal`:
        unit vector in these axes, from the origin to the wall. `room`: distance along the normal,
        m, from the origin to the centre of the part when the part touches the wall. `centre`: of
        the part, m in the second body's axes. `radius`: of the part, m.
        """
        first, second = (motions[name] for name in self.pair())
        outward = first.direction(normal)
        apart = second.point(centre) - first.point(origin)
        depth = subtract(apart.dot(outward), room)
        centre_in_first = origin + first.components(apart)
        # Relative to the first body's point at the centre, so that a common rotation doesn't count.
        sliding = second.velocity_at(centre) - first.velocity_at(centre_in_first)
        # With friction, the force acts on both bodies at one point, midway between the surfaces, so
        # that it has no net moment. Without friction, it acts along the normal through the part's
        # centre. The last two arguments of `Contact` are points on this line that don't depend on
        # the penetration and take fewer operations.
        to_surface = subtract(radius, 0.5 * depth)
        on_first = centre_in_first + normal * to_surface
        on_second = centre + second.components(outward * to_surface)
        gap = self._gap(depth, sliding.dot(outward))
        slip = self._slip(first, second, on_first, on_second, outward)
        return Contact(gap, outward, on_first, on_second, slip, centre_in_first, centre)


def require_smaller_clearance(clearance: Single, radius: Single, radius_name: str) -> None:
    values, expected = (clearance, radius), f"smaller than {radius_name} {{1}} m"
    require_numbers(operator.lt, "clearance", values, expected, "check the units (m)")


def require_right_angle(argument: str, direction: Triple, other: str, axis: Triple) -> None:
    if (both := checkable(direction, axis)) is not None:
        numbers, base = both
        lengths = ((numbers**2).sum() * (base**2).sum()) ** 0.5
        # The bound of the cosine allows for the rounding of given numbers.
        is_right = abs((numbers * base).sum()) < 1e-9 * lengths
        expected = f"perpendicular to `{other}` = {as_shown(base)}"
        require(is_right, argument, numbers, expected, "change one of the two directions")


class AbstractCentredJoint(AbstractFrictionJoint):
    """Base class of joints that hold a point of one body near a point of another. The two points
    are those of `attachments`, of the first and of the second body."""

    @override
    def pair(self) -> tuple[str, str]:
        (_, first, _), (_, second, _) = self.attachments()
        return first, second

    @override
    def anchor(self) -> tuple[str, Vector, Vector] | None:
        (_, first, on_first), (_, second, on_second) = self.attachments()
        if first == GROUND:
            return second, on_second, on_first
        if second == GROUND:
            return first, on_first, on_second
        return None

    def _offset(self, motions: Motions) -> Vector:
        """Return the vector from the first body's point to the second body's, m, global axes."""
        (_, first, on_first), (_, second, on_second) = self.attachments()
        if second == GROUND:
            return -motions[first].point_from(on_second, on_first)
        return motions[second].point_from(motions[first].point(on_first), on_second)


def offset_at_flat_wall(
    normal: Triple,
    clearance: Single,
    load: Float[np.ndarray, "3"],
    laws: Iterable[AbstractContactLaw],
    deepest: Scalar,
) -> Float[np.ndarray, "3"] | None:
    """Return the displacement, (3,) m in the axes of the walls' body, by which a load presses a
    centred part against one of two parallel walls and into it; ``None`` if it presses it to
    neither.

    **Arguments:** `normal`: of the walls, (3,), any length. `clearance`: of the centred part on
    either side, m. `load`: force of the part on the walls' body, (3,) N in its axes. `laws`: of the
    contacts that share the load. `deepest`: upper limit of their penetration, m.
    """
    upward = np.asarray(normal) / np.linalg.norm(normal)
    component = load @ upward
    # A load along the walls alone presses the part against neither of them.
    if not abs(component) > LEAST_TRANSVERSE_LOAD * np.linalg.norm(load):
        return None
    distance = clearance + resting_depth(laws, float(abs(component)), deepest)
    return distance * np.sign(component) * upward


def resting_depth(
    laws: Iterable[AbstractContactLaw],
    load: Scalar,
    deepest: Scalar,
    gap: Callable[[Scalar, Scalar], Gap] = Gap,
) -> float:
    """Return the penetration, m, at most `deepest`, at which contacts with the same depth and the
    given laws together carry a load, N, at rest. `gap` makes a gap from depth and rate."""
    # Importing it takes long, and few programs need it.
    from scipy.optimize import root_scalar

    laws = list(laws)
    # The surfaces' distance at which the first force begins. Depths are counted from there.
    ahead = max(float(law.onset_offset()) for law in laws)

    def excess(logarithm: float) -> float:
        """Return the logarithm of force over load, which is nearly linear for a power law."""
        present = gap(np.exp(logarithm) - ahead, 0.0)
        force = sum(float(law.elastic_force(present)) for law in laws)
        return float(np.log(max(force, 1e-300) / load))

    low, high = np.log(LEAST_DEPTH), np.log(float(deepest) + ahead)
    # The force is too small even at the largest penetration.
    if excess(high) <= 0.0:
        return float(deepest)
    # The force is large enough right at its onset, where that of some laws jumps.
    if excess(low) >= 0.0:
        return LEAST_DEPTH - ahead
    root = root_scalar(excess, bracket=(low, high), xtol=1e-14).root
    return float(np.exp(root) - ahead)
