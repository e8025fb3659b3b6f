"""Quantities of motors: torque and current."""

from typing import ClassVar

import equinox as eqx
from typing_extensions import override

from .._fields.checks import require
from .._math.vectors import Scalar
from .._model.drives.drivers import AbstractDriveTorque
from .._model.drives.servo import Servo
from .._model.scene import Scene
from .base import AbstractQuantity, Instant, require_known


class MotorTorque(AbstractQuantity):
    """Torque of a `Motor`, `Servo`, `DriveTorque` or `TorsionalSpring` on its second body, N m.

    The torque is right-handed about the element's axis. For a user-defined
    `extend.AbstractDriveTorque` it is the result of `torque_at`.

    >>> torque = cj.quantities.MotorTorque("servo")
    """

    drive: str = eqx.field(static=True)
    unit: ClassVar[str | None] = "N m"

    @override
    def check(self, scene: Scene) -> None:
        kinds = AbstractDriveTorque, Servo
        drives = [name for name, force in scene.forces.items() if isinstance(force, kinds)]
        require_known("drive", self.drive, drives)

    @override
    def __call__(self, now: Instant) -> Scalar:
        drive = now.scene.forces[self.drive]
        if isinstance(drive, Servo):
            return drive.present_torque(now.memory[self.drive], now.motions)
        assert isinstance(drive, AbstractDriveTorque)
        return drive.present_torque(now.motions, now.time)


class MotorCurrent(AbstractQuantity):
    """Current of a `Servo`, its torque over its `torque_constant`, A.

    >>> current = cj.quantities.MotorCurrent("servo")
    """

    drive: str = eqx.field(static=True)
    unit: ClassVar[str | None] = "A"

    @override
    def check(self, scene: Scene) -> None:
        servos = {name: f for name, f in scene.forces.items() if isinstance(f, Servo)}
        require_known("drive", self.drive, servos)
        constant, expected = servos[self.drive].torque_constant, f"that of {self.drive!r} in N m/A"
        remedy = "give the Servo a torque_constant, or take MotorTorque"
        require(constant is not None, "torque_constant", None, expected, remedy)

    @override
    def __call__(self, now: Instant) -> Scalar:
        servo = now.scene.forces[self.drive]
        assert isinstance(servo, Servo) and servo.torque_constant is not None
        return MotorTorque(self.drive)(now) / servo.torque_constant
