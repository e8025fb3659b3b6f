"""Quantities of motors: torque and current."""

import abc
from collections.abc import Collection
from typing import ClassVar

import equinox as eqx
from typing_extensions import override

from .._math.vectors import Scalar
from .._model.drives.drivers import AbstractDriveTorque
from .._model.drives.servo import Servo
from .._model.scene import Scene
from .base import AbstractQuantity, Instant, require_known


class AbstractMotorQuantity(AbstractQuantity):
    """Base class of quantities of a drive, one of the force elements of a scene."""

    drive: str = eqx.field(static=True)

    @override
    def check(self, scene: Scene) -> None:
        require_known("drive", self.drive, self.drives(scene))

    @abc.abstractmethod
    def drives(self, scene: Scene) -> Collection[str]:
        """Return the names of the drives to which the quantity applies."""

    def torque(self, now: Instant) -> Scalar:
        """Return a drive's torque on its second body, N m, right-handed about the drive's axis."""
        drive = now.scene.forces[self.drive]
        if isinstance(drive, Servo):
            return drive.present_torque(now.memory[self.drive], now.motions)
        assert isinstance(drive, AbstractDriveTorque)
        return drive.present_torque(now.motions, now.time)


class MotorTorque(AbstractMotorQuantity):
    """Torque of a `Motor`, `Servo`, `DriveTorque` or `TorsionalSpring` on its second body, N m.

    The torque is right-handed about the element's axis. For a user-defined
    `extend.AbstractDriveTorque` it is the result of `torque_at`.

    >>> torque = cj.quantities.MotorTorque("servo")
    """

    unit: ClassVar[str | None] = "N m"

    @override
    def drives(self, scene: Scene) -> Collection[str]:
        kinds = AbstractDriveTorque, Servo
        return [name for name, force in scene.forces.items() if isinstance(force, kinds)]

    @override
    def __call__(self, now: Instant) -> Scalar:
        return self.torque(now)


class MotorCurrent(AbstractMotorQuantity):
    """Current of a `Servo`, its torque over its `torque_constant`, A.

    >>> current = cj.quantities.MotorCurrent("servo")
    """

    unit: ClassVar[str | None] = "A"

    @override
    def drives(self, scene: Scene) -> Collection[str]:
        servos = {name: f for name, f in scene.forces.items() if isinstance(f, Servo)}
        return [name for name, servo in servos.items() if servo.torque_constant is not None]

    @override
    def __call__(self, now: Instant) -> Scalar:
        servo = now.scene.forces[self.drive]
        assert isinstance(servo, Servo) and servo.torque_constant is not None
        return self.torque(now) / servo.torque_constant
