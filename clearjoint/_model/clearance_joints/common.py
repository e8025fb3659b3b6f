"""Shared parts of the clearance joints: base classes, argument checks, flat walls."""

import abc
import operator
from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Float
from typing_extensions import override

from ..._fields.checks import as_shown, checkable, require, require_numbers
from ..._fields.types import Single, Triple
from ..._math.vectors import Scalar, Vector, subtract
from ..bodies import GROUND
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
"""Smallest penetration that `_resting_depth` tries, m from the onset of the force: far below the
rounding errors of coordinates."""
LEAST_TRANSVERSE_LOAD = 1e-6
"""Component of a load towards a wall (across a bearing's axis, or along the normal of flat walls),
as a fraction of the load, up to which it counts as a rounding error."""


class AbstractOneLawJoint(AbstractContactJoint):
    """Base class of joints whose contacts share a `law` and a `friction`, ``None`` for none."""

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
    """Base class of joints with two frictionless flat flanks, which stop a relative rotation."""

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

    def _contact_at(
        self,
        motions: Motions,
        gap: Gap,
        normal: Vector,
        on_first: Vector,
        on_second: Vector,
        line_first: Vector | None = None,
        line_second: Vector | None = None,
    ) -> Contact:
        """Return a contact, with its slip if there is friction. Arguments are those of `Contact`;
        `on_first` and `on_second` are its `arm_first` and `arm_second`."""
        slip = None
        if self.friction is not None:
            first, second = (motions[name] for name in self.pair())
            sliding = second.velocity_at(on_second) - first.velocity_at(on_first)
            slip = slip_velocity(sliding, normal, sliding.dot(normal))
        return Contact(gap, normal, on_first, on_second, slip, line_first, line_second)

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
        return self._contact_at(motions, gap, outward, on_first, on_second, centre_in_first, centre)

    def _offset_at_flat_wall(
        self, normal: Triple, clearance: Single, load: Float[np.ndarray, "3"], contacts: int = 1
    ) -> Float[np.ndarray, "3"] | None:
        """Return the displacement of the second body, (3,) m in the first body's axes, from the
        middle between two parallel walls of the first to where it rests against one of them;
        ``None`` if the load is along the walls.

        **Arguments:** `normal`: of the walls, (3,), any length. `clearance`: of the centred body on
        either side, m. `load`: force of the second body on the first, (3,) N in the first's axes.
        `contacts`: number of contacts that share the load.
        """
        upward = np.asarray(normal) / np.linalg.norm(normal)
        component = load @ upward
        # A load along the walls alone presses the body against neither of them.
        if not abs(component) > LEAST_TRANSVERSE_LOAD * np.linalg.norm(load):
            return None
        distance = clearance + self._resting_depth(float(abs(component)), [self.law] * contacts)
        return distance * np.sign(component) * upward

    def _resting_depth(self, load: Scalar, laws: Sequence[AbstractContactLaw]) -> float:
        """Return the penetration, m, at most `deepest_penetration`, at which contacts with the same
        depth and the given laws together carry a load, N, at rest."""
        # Importing `scipy.optimize` takes long, and few programs need it.
        from scipy.optimize import root_scalar

        deepest = float(self.deepest_penetration())
        # The surfaces' distance at which the first force begins. Depths are counted from there.
        ahead = max(float(law.onset_offset()) for law in laws)

        def excess(logarithm: float) -> float:
            """Return the logarithm of force over load at the depth with the given `logarithm`: for
            a power law a nearly linear function. It is zero at the depth that is sought."""
            gap = self._gap(np.exp(logarithm) - ahead, 0.0)
            force = sum(float(law.elastic_force(gap)) for law in laws)
            # The bound keeps the logarithm finite where the force is zero.
            return float(np.log(max(force, 1e-300) / load))

        low, high = np.log(LEAST_DEPTH), np.log(deepest + ahead)
        # The force is too small even at the largest penetration.
        if excess(high) <= 0.0:
            return deepest
        # The force is large enough right at its onset, where that of some laws jumps.
        if excess(low) >= 0.0:
            return LEAST_DEPTH - ahead
        root = root_scalar(excess, bracket=(low, high), xtol=1e-14).root
        return float(np.exp(root) - ahead)


def require_smaller_clearance(clearance: Single, radius: Single, radius_name: str) -> None:
    values, expected = (clearance, radius), f"smaller than {radius_name} {{1}} m"
    require_numbers(operator.lt, "clearance", values, expected, "check the units (m)")


def require_right_angle(argument: str, direction: Triple, other: str, axis: Triple) -> None:
    # While JAX traces one of the two, the check is omitted.
    if (arrays := checkable(direction, axis)) is not None:
        numbers, axis_numbers = arrays
        lengths = ((numbers**2).sum() * (axis_numbers**2).sum()) ** 0.5
        # The bound of the cosine allows for the rounding of given numbers.
        is_right = abs((numbers * axis_numbers).sum()) < 1e-9 * lengths
        expected = f"perpendicular to `{other}` = {as_shown(axis_numbers)}"
        require(is_right, argument, numbers, expected, "change one of the two directions")


class AbstractCentredJoint(AbstractFrictionJoint):
    """Base class of joints that hold a point of one body near a point of another. `attachments`
    returns these two points, of the first and of the second body, in this order."""

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
        # `point_from` loses no digits for a body whose position is measured from this joint's
        # `anchor`. With the ground as second body, only the first body can be such a body.
        if second == GROUND:
            return -motions[first].point_from(on_second, on_first)
        return motions[second].point_from(motions[first].point(on_first), on_second)
