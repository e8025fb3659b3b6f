"""Springs, dampers and applied loads."""

import equinox as eqx

from ...fields.checks import require_point
from ...fields.declarations import quantity
from ...fields.types import Single, Triple
from ...math.smoothing import norm_and_direction
from ...math.vectors import Scalar, Vector
from ..bodies import Wrench
from ..joints.base import AbstractForce, Attachment, Motions
from ..joints.pairs import AbstractPairAtPoints
from ..pen import AbstractPen, Marker

SI = "give it in SI units"


class SpringDamper(AbstractPairAtPoints, AbstractForce):
    """A linear spring and damper between a point of each of two bodies.

    **Arguments:** names; points (3,) m in body axes; `stiffness` N/m, `damping` N s/m, and
    `free_length` m, none of them negative. The force has no direction where the points coincide
    and is zero there.
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    point_first: Triple = quantity("m", check=require_point)
    point_second: Triple = quantity("m", check=require_point)
    stiffness: Single = quantity("N/m", positive=True, zero=True, remedy=SI)
    damping: Single = quantity("N s/m", default=0.0, positive=True, zero=True, remedy=SI)
    free_length: Single = quantity("m", default=0.0, positive=True, zero=True, remedy=SI)

    def _stretch(self, motions: Motions) -> tuple[Scalar, Scalar, Vector]:
        first, second = motions[self.first], motions[self.second]
        apart = second.point(self.point_second) - first.point(self.point_first)
        length, direction = norm_and_direction(apart)
        velocity = second.velocity_at(self.point_second) - first.velocity_at(self.point_first)
        return length - self.free_length, velocity.dot(direction), direction

    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        """Equal and opposite forces along the line between the points."""
        del t
        stretch, rate, direction = self._stretch(motions)
        force = direction * (self.stiffness * stretch + self.damping * rate)
        return {
            self.first: motions[self.first].wrench(force, self.point_first),
            self.second: motions[self.second].wrench(-force, self.point_second),
        }

    def stored_energy(self, motions: Motions, t: Scalar) -> Scalar:
        """Half the stiffness times the squared stretch, J."""
        del t
        return 0.5 * self.stiffness * self._stretch(motions)[0] ** 2

    def supplied_power(self, motions: Motions, t: Scalar) -> Scalar:
        """Minus the damper's dissipation, W."""
        del t
        return -self.damping * self._stretch(motions)[1] ** 2

    def draw(self, pen: AbstractPen) -> None:
        """A spring."""
        pen.spring(*self.ends())


class AppliedLoad(AbstractForce):
    """A constant force and torque on a body, given in global axes.

    **Arguments:** `body`; `force` (3,) N at `point` (3,) m in body axes; `torque` (3,) N m.
    A load that changes with time or motion is a subclass of `AbstractForce`.
    """

    body: str = eqx.field(static=True)
    force: Triple = quantity("N", shape=(3,), default=(0.0, 0.0, 0.0))
    torque: Triple = quantity("N m", shape=(3,), default=(0.0, 0.0, 0.0))
    point: Triple = quantity("m", check=require_point, default=(0.0, 0.0, 0.0))

    def body_names(self) -> tuple[str, ...]:
        """Name of the body that it acts on."""
        return (self.body,)

    def attachments(self) -> tuple[Attachment, ...]:
        """Where the force acts."""
        return (("point", self.body, self.point),)

    def wrenches(self, motions: Motions, t: Scalar) -> dict[str, Wrench]:
        """The load carried to the centre of mass."""
        del t
        motion = motions[self.body]
        return {self.body: motion.wrench(self.force, self.point) + motion.torque(self.torque)}

    def draw(self, pen: AbstractPen) -> None:
        """An arrow."""
        pen.load(Marker(self.body, self.point), self.force)
