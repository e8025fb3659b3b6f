"""The torsional spring."""

import math

import equinox as eqx

from ...fields.declarations import quantity
from ...fields.types import Quadruple, Single, Triple
from ...math.functions import wrapped
from ...math.vectors import Scalar
from ..drives.rotation import AbstractDriveTorque
from ..joints.base import Motions

SI = "give it in SI units"


class TorsionalSpring(AbstractDriveTorque):
    """A linear torsional spring and damper about an axis that two bodies turn on.

    The angle counts from that at rest, within half a turn of it either way: there the spring snaps
    over, for what follows a second turn is no function of where the bodies are.

    **Arguments:** as `PrescribedRotation`, but `stiffness` N m/rad and `damping` N m s/rad, neither
    of them negative, and `rest_angle` rad, where the spring is slack.

    **Raises:** `ValueError` for values that no spring can have.

    >>> spring = cj.TorsionalSpring("ground", "lever", (0, 0, 1), stiffness=5.0, damping=0.1)
    >>> spring.body_names()
    ('ground', 'lever')
    """

    first: str = eqx.field(static=True)
    second: str = eqx.field(static=True)
    axis: Triple = quantity("1")
    stiffness: Single = quantity("N m/rad", shape=(), positive=True, zero=True, remedy=SI)
    damping: Single = quantity(
        "N m s/rad", shape=(), default=0.0, positive=True, zero=True, remedy=SI
    )
    rest_angle: Single = quantity("rad", shape=(), default=0.0)
    orientation: Quadruple = quantity("1", default=(1.0, 0.0, 0.0, 0.0))

    def torque_at(self, angle: Scalar, speed: Scalar, t: Scalar) -> Scalar:
        """Minus the stiffness times the twist, less the damping times the speed, N m."""
        del t
        return -(self.stiffness * self._twist(angle) + self.damping * speed)

    def stored_energy(self, motions: Motions, t: Scalar) -> Scalar:
        """Half the stiffness times the squared twist, J."""
        del t
        return 0.5 * self.stiffness * self._twist(self.relative_angle(motions).value) ** 2

    def supplied_power(self, motions: Motions, t: Scalar) -> Scalar:
        """Minus the damper's dissipation, W."""
        del t
        return -self.damping * self.speed(motions) ** 2

    def _twist(self, angle: Scalar) -> Scalar:
        return wrapped(angle - self.rest_angle, 2.0 * math.pi)
