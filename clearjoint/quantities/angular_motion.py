"""Angular velocities and accelerations of bodies and joints."""

from collections.abc import Collection
from typing import ClassVar

import equinox as eqx

from ..dynamics.multipliers import row_rate
from ..math.vectors import Scalar, add
from ..model.bodies import GROUND
from ..model.scene import Scene
from .base import Axes, Component, component_or_magnitude, require_axes, require_component
from .bodies import AbstractBodyQuantity
from .instant import Instant
from .joints import AbstractJointQuantity, elements_with_angle


class AngularVelocity(AbstractBodyQuantity):
    """Angular velocity of a body, rad/s: its magnitude or a component.

    The signal of a gyroscope is `AngularVelocity(body, component, axes="body")`.

    ```python
    import clearjoint as cj

    spin = cj.quantities.AngularVelocity("arm 2", "z")
    outputs = {"fastest": cj.Peak(spin, "rad/s")}
    ```

    **Arguments:**

    - `body`: name of the body.
    - `component`: "x", "y", "z", or ``None``, the default, for the magnitude.
    - `axes`: "global", the default, or "body", in which the component is taken.

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
        """Return the angular velocity, rad/s."""
        motion = now.motions[self.body]
        spin = motion.spin if self.axes == "body" else motion.direction(motion.spin)
        return component_or_magnitude(spin, self.component)


class AngularAcceleration(AbstractBodyQuantity):
    """Angular acceleration of a body, rad/s^2: its magnitude or a component.

    ```python
    import clearjoint as cj

    jolt = cj.quantities.AngularAcceleration("arm 2", "z")
    ```

    **Arguments:**

    - `body`: name of the body, which can't be the ground.
    - `component`: "x", "y", "z", or ``None``, the default, for the magnitude.
    - `axes`: "global", the default, or "body", in which the component is taken.

    **Raises:** `ValueError` for other components or axes.
    """

    body: str = eqx.field(static=True)
    component: Component | None = eqx.field(default=None, static=True)
    axes: Axes = eqx.field(default="global", static=True)
    unit: ClassVar[str | None] = "rad/s^2"
    applies_to_ground: ClassVar[bool] = False

    def __check_init__(self):
        require_component(self.component, magnitude=True)
        require_axes(self.axes)

    def __call__(self, now: Instant) -> Scalar:
        """Return the angular acceleration, rad/s^2."""
        angular = now.dynamics.accelerations[self.body].angular
        if self.axes == "global":
            angular = now.motions[self.body].direction(angular)
        return component_or_magnitude(angular, self.component)


class AbstractAngleRate(AbstractJointQuantity):
    """A time derivative of the angle of a joint, driver or drive torque; see `JointAngle`."""

    def joints(self, scene: Scene) -> Collection[str]:
        """Return the names of the scene's joints and forces that have a relative angle."""
        return elements_with_angle(scene)


class JointAngularVelocity(AbstractAngleRate):
    """Rate of a `JointAngle`, rad/s: relative angular velocity about the first body's axis.

    ```python
    import clearjoint as cj

    speed = cj.quantities.JointAngularVelocity("crank bearing")
    ```

    **Arguments:** `joint`: name of a joint or force with an angle, as for `JointAngle`.
    """

    joint: str = eqx.field(static=True)
    unit: ClassVar[str | None] = "rad/s"

    def __call__(self, now: Instant) -> Scalar:
        """Return the rate of the angle, rad/s."""
        return row_rate(
            elements_with_angle(now.scene)[self.joint].relative_angle(now.motions), now.motions
        )


class JointAngularAcceleration(AbstractAngleRate):
    """Second time derivative of a `JointAngle`, rad/s^2.

    ```python
    import clearjoint as cj

    acceleration = cj.quantities.JointAngularAcceleration("crank pin")
    ```

    **Arguments:** `joint`: name of a joint or force with an angle, as for `JointAngle`.
    """

    joint: str = eqx.field(static=True)
    unit: ClassVar[str | None] = "rad/s^2"

    def __call__(self, now: Instant) -> Scalar:
        """Return the second time derivative of the angle, rad/s^2."""
        row = elements_with_angle(now.scene)[self.joint].relative_angle(now.motions)
        # The second derivative of a row is its bias plus the Jacobian times the accelerations.
        total = row.bias
        for name, pair in row.jacobian.items():
            if name != GROUND:
                acceleration = now.dynamics.accelerations[name]
                total = add(total, pair.force.dot(acceleration.linear))
                total = add(total, pair.moment.dot(acceleration.angular))
        return total
