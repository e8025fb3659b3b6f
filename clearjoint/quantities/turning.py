"""Angular velocities and accelerations, of bodies and about joints: gyroscopes and tachometers."""

from collections.abc import Collection
from typing import ClassVar

import equinox as eqx

from ..dynamics.multipliers import row_rate
from ..math.vectors import Scalar, add
from ..model.bodies import GROUND
from ..model.scene import Scene
from .base import Axes, Component, part, require_axes, require_component
from .bodies import AbstractBodyQuantity
from .instant import Instant
from .joints import AbstractJointQuantity, turning_elements


class AngularVelocity(AbstractBodyQuantity):
    """Angular velocity of a body, rad/s: its magnitude, or a component. A gyroscope reads
    `AngularVelocity(body, component, axes="body")`.

    ```python
    import clearjoint as cj

    spin = cj.quantities.AngularVelocity("arm 2", "z")
    outputs = {"fastest": cj.Peak(spin, "rad/s")}
    ```

    **Arguments:** `body`: its name; `component`: "x", "y", "z", or ``None`` for the magnitude;
    `axes`: "global" or "body", in which the component is taken.

    **Raises:** `ValueError` for other components or axes.
    """

    body: str = eqx.field(static=True)
    component: Component | None = eqx.field(default=None, static=True)
    axes: Axes = eqx.field(default="global", static=True)
    unit: ClassVar[str | None] = "rad/s"

    def __check_init__(self):
        require_component(self.component, magnitude=True)
        require_axes(self.axes)

    def __call__(self, now: Instant) -> Scalar:
        """The angular velocity, rad/s."""
        motion = now.motions[self.body]
        spin = motion.spin if self.axes == "body" else motion.direction(motion.spin)
        return part(spin, self.component)


class AngularAcceleration(AbstractBodyQuantity):
    """Angular acceleration of a body, rad/s^2: its magnitude, or a component.

    ```python
    import clearjoint as cj

    jolt = cj.quantities.AngularAcceleration("arm 2", "z")
    ```

    **Arguments, raises:** as `AngularVelocity`.
    """

    body: str = eqx.field(static=True)
    component: Component | None = eqx.field(default=None, static=True)
    axes: Axes = eqx.field(default="global", static=True)
    unit: ClassVar[str | None] = "rad/s^2"
    of_ground: ClassVar[bool] = False

    def __check_init__(self):
        require_component(self.component, magnitude=True)
        require_axes(self.axes)

    def __call__(self, now: Instant) -> Scalar:
        """The angular acceleration, rad/s^2."""
        angular = now.dynamics.accelerations[self.body].angular
        if self.axes == "global":
            angular = now.motions[self.body].direction(angular)
        return part(angular, self.component)


class AbstractJointTurning(AbstractJointQuantity):
    """A rate of the angle of a joint, a driver or a drive torque; see `JointAngle`."""

    def joints(self, scene: Scene) -> Collection[str]:
        """Names of the joints and forces that have an angle."""
        return turning_elements(scene)


class JointAngularVelocity(AbstractJointTurning):
    """Rate of a `JointAngle`, rad/s: angular velocity of the joint's second body against its first,
    about the axis in the first.

    ```python
    import clearjoint as cj

    speed = cj.quantities.JointAngularVelocity("crank bearing")
    ```

    **Arguments:** `joint`: name of a revolute, cylindrical or clearance joint, of a driver, a drive
    torque, or of a joint of one's own with a method ``turn(motions)``.
    """

    joint: str = eqx.field(static=True)
    unit: ClassVar[str | None] = "rad/s"

    def __call__(self, now: Instant) -> Scalar:
        """The rate of the angle, rad/s."""
        return row_rate(
            turning_elements(now.scene)[self.joint].relative_angle(now.motions), now.motions
        )


class JointAngularAcceleration(AbstractJointTurning):
    """Second rate of a `JointAngle`, rad/s^2.

    ```python
    import clearjoint as cj

    acceleration = cj.quantities.JointAngularAcceleration("crank pin")
    ```

    **Arguments:** as `JointAngularVelocity`.
    """

    joint: str = eqx.field(static=True)
    unit: ClassVar[str | None] = "rad/s^2"

    def __call__(self, now: Instant) -> Scalar:
        """The second rate of the angle, rad/s^2."""
        row = turning_elements(now.scene)[self.joint].relative_angle(now.motions)
        total = row.bias
        for name, pair in row.jacobian.items():
            if name != GROUND:
                acceleration = now.dynamics.accelerations[name]
                total = add(total, pair.force.dot(acceleration.linear))
                total = add(total, pair.moment.dot(acceleration.angular))
        return total
